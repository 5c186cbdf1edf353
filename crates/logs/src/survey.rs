//! What a log holds, without what it says: the first of two readings, from which a map is chosen.

use std::{collections::BTreeMap, ops::ControlFlow, path::Path};

use crate::{Format, LogError, Losses, Sample, Topic, Visitor, scan};

/// What a log holds.
#[derive(Clone, Debug, Default)]
pub struct Survey {
    /// In the order of their first samples.
    pub topics: Vec<Surveyed>,
    /// The autopilot's parameters, by name; the last value of each.
    pub parameters: BTreeMap<String, f64>,
    /// What the log says of itself, by key.
    pub about: BTreeMap<String, String>,
    /// What is lost.
    pub losses: Losses,
}

/// A topic and what came of it.
#[derive(Clone, Debug)]
pub struct Surveyed {
    /// The topic.
    pub topic: Topic,
    /// How many samples.
    pub samples: u64,
    /// The earliest and the latest stamp, ns; `None` in tables.
    pub span_ns: Option<[i128; 2]>,
}

impl Survey {
    /// Reads a log for what it holds.
    pub fn of(path: &Path, format: Format) -> Result<Self, LogError> {
        let mut survey = Self::default();
        let losses = scan(path, format, &mut survey)?;
        Ok(Self { losses, ..survey })
    }
}

impl Visitor for Survey {
    fn topic(&mut self, topic: &Topic) -> Option<Vec<usize>> {
        self.topics.push(Surveyed { topic: topic.clone(), samples: 0, span_ns: None });
        Some(Vec::new())
    }

    fn sample(&mut self, sample: Sample<'_>) -> ControlFlow<()> {
        let topic = &mut self.topics[sample.topic];
        topic.samples += 1;
        if let Some(time) = sample.time_ns {
            let [first, last] = topic.span_ns.get_or_insert([time; 2]);
            *first = time.min(*first);
            *last = time.max(*last);
        }
        ControlFlow::Continue(())
    }

    fn parameter(&mut self, name: &str, value: f64) {
        self.parameters.insert(name.to_owned(), value);
    }

    fn about(&mut self, key: &str, value: &str) {
        self.about.insert(key.to_owned(), value.to_owned());
    }
}
