//! What every log is made of.

use std::{fmt, ops::ControlFlow};

/// A stream of samples that share their fields.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Topic {
    /// Its name in the log. The second sensor of a kind has `[1]` behind it; a table's topic has no name.
    pub name: String,
    /// The type of its messages where the log names one, such as `nav_msgs/msg/Odometry`; else empty.
    pub kind: String,
    /// In the order in which the log has them.
    pub fields: Vec<Field>,
}

/// One quantity of a topic.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Field {
    /// Its name: `q[0]` is an element of an array, `pose.position.z` one of a message in a message.
    pub name: String,
    /// The unit, where the log says it.
    pub unit: Option<String>,
}

impl Field {
    /// A field whose unit the log does not say.
    pub fn new(name: impl Into<String>) -> Self {
        Self { name: name.into(), unit: None }
    }
}

/// What stands in one field of one sample.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Cell<'a> {
    /// Nothing.
    #[default]
    Absent,
    /// A real number, which may be NaN or infinite if the log says so.
    Number(f64),
    /// A whole number, exact; times are in nanoseconds.
    Integer(i128),
    /// Bytes that are a text, or should be.
    Text(&'a [u8]),
}

/// One message of a topic, or one row of a table.
#[derive(Clone, Copy, Debug)]
pub struct Sample<'a> {
    /// Which topic: they are numbered from zero, in the order in which the visitor was told of them.
    pub topic: usize,
    /// The log's own stamp, ns; `None` in tables.
    pub time_ns: Option<i128>,
    /// The fields that the visitor asked for, in the order in which it did.
    pub cells: &'a [Cell<'a>],
    /// A table's row, or which message of its topic it is; counted from one.
    pub line: u64,
}

/// Who is told what is in a log.
pub trait Visitor {
    /// A topic, before its first sample. The answer says which of its fields are wanted, by their places; `None` spares its samples.
    fn topic(&mut self, topic: &Topic) -> Option<Vec<usize>>;

    /// A sample; [`ControlFlow::Break`] ends the reading.
    fn sample(&mut self, sample: Sample<'_>) -> ControlFlow<()>;

    /// A parameter of the autopilot.
    fn parameter(&mut self, _name: &str, _value: f64) {}

    /// What the log says of itself, such as the version of the firmware.
    fn about(&mut self, _key: &str, _value: &str) {}
}

/// What a log does not hold any more, as far as it can be told.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Losses {
    /// The file ends within a message, or before its own end.
    pub cut: bool,
    /// Messages or chunks that are there and cannot be read.
    pub damaged: u64,
    /// Bytes that were passed over to find the next message.
    pub skipped_bytes: u64,
    /// Gaps that the logger itself tells of.
    pub dropouts: u64,
    /// How long they were together, where the logger says it, s.
    pub dropout_s: f64,
}

impl Losses {
    /// Whether nothing was lost.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }
}

impl fmt::Display for Losses {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut said = Vec::new();
        if self.cut {
            said.push("it ends in the middle of a message".to_owned());
        }
        if self.damaged > 0 {
            said.push(format!("{} damaged messages", self.damaged));
        }
        if self.skipped_bytes > 0 {
            said.push(format!("{} bytes passed over", self.skipped_bytes));
        }
        match (self.dropouts, self.dropout_s) {
            (0, _) => {}
            (gaps, 0.0) => said.push(format!("{gaps} messages that the logger dropped")),
            (gaps, seconds) => said.push(format!("{gaps} drop-outs of the logger, {seconds:.3} s together")),
        }
        f.write_str(if said.is_empty() { "nothing lost" } else { "" })?;
        f.write_str(&said.join(", "))
    }
}
