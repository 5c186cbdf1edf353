//! What became of every row.

use std::{
    collections::BTreeMap,
    fmt,
    path::{Path, PathBuf},
};

use bench_logs::{Format, Losses, Survey, Topic};
use serde::Serialize;

use super::{ImportMap, topics};

/// Name and version of the report's form as JSON.
const SCHEMA: &str = "bench.import/1";

/// Why a row was not used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum SkipReason {
    /// It has more or fewer cells than the header.
    CellCount,
    /// A cell is empty.
    Empty,
    /// A cell holds NaN.
    Nan,
    /// A cell holds an infinity, or a number too large for a float.
    Infinite,
    /// A cell holds something that is no number.
    NotANumber,
    /// A cell holds something that is no date and time.
    NotATime,
    /// A cell holds a number outside the range that the map declares.
    OutOfRange,
    /// The map does not say what this phase is.
    UnknownPhase,
    /// Its time is that of the row before.
    TimeRepeated,
    /// Its time is before that of the row before.
    TimeBack,
}

impl fmt::Display for SkipReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::CellCount => "not as many cells as the header",
            Self::Empty => "empty",
            Self::Nan => "NaN",
            Self::Infinite => "infinite",
            Self::NotANumber => "not a number",
            Self::NotATime => "not a date and time",
            Self::OutOfRange => "out of range",
            Self::UnknownPhase => "a phase that the map does not name",
            Self::TimeRepeated => "time repeated",
            Self::TimeBack => "time went back",
        })
    }
}

/// Rows that were skipped for one reason in one column. A row counts once, by the first fault found in it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Skipped {
    /// Why.
    pub reason: SkipReason,
    /// The column; empty where the row as a whole is at fault.
    pub column: String,
    /// How many rows.
    pub count: u64,
    /// Line of the first of them in the log, counted from one.
    pub first_line: u64,
    /// What stood in the column there.
    pub first_found: String,
}

impl fmt::Display for Skipped {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { reason, column, count, first_line, first_found } = self;
        write!(f, "{count} skipped, {reason}")?;
        if !column.is_empty() {
            write!(f, " in {column}")?;
        }
        write!(f, " (first: line {first_line}, {first_found:?})")
    }
}

/// The range of one imported quantity, to see at a glance whether its unit was right.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct QuantityRange {
    /// Table and key in the map, such as `position.z`.
    pub name: String,
    /// The recording's unit.
    pub unit: &'static str,
    /// The smallest value that was recorded.
    pub min: f64,
    /// The largest value that was recorded.
    pub max: f64,
}

/// What an import did; `rows` = `used` + `filtered` + all of `skipped`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ImportReport {
    /// `bench.import/1`.
    pub schema: &'static str,
    /// The log.
    pub log: PathBuf,
    /// The map's name.
    pub map: String,
    /// The rig's name, where one is attached.
    pub rig: Option<String>,
    /// The recording.
    pub output: PathBuf,
    /// Rows below the header.
    pub rows: u64,
    /// Rows that went into the recording.
    pub used: u64,
    /// Rows left out because the map keeps others only.
    pub filtered: u64,
    /// Rows left out because something is wrong with them.
    pub skipped: Vec<Skipped>,
    /// Positions left out because they were exposed before the recording's origin.
    pub positions_before_origin: u64,
    /// The log's time at the recording's origin (its first used row), s.
    pub time_offset_s: f64,
    /// From the first to the last used row, s.
    pub duration_s: f64,
    /// What became of a log of topics; `None` of tables.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub topics: Option<TopicsReport>,
    /// What became of a table's columns; `None` of logs of topics.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub columns: Option<ColumnsReport>,
    /// Messages by channel.
    pub channels: BTreeMap<&'static str, u64>,
    /// Ranges of what was imported, in the order of the map's tables.
    pub quantities: Vec<QuantityRange>,
}

/// What became of a table's columns.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ColumnsReport {
    /// The columns that were used, sorted.
    pub used: Vec<String>,
    /// The optional columns that the table does not have, sorted.
    pub missing: Vec<String>,
    /// The columns that the map does not name, in the table's order.
    pub unused: Vec<String>,
}

/// What became of a log of topics.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TopicsReport {
    /// What the log is, in words.
    pub format: &'static str,
    /// The columns that were used, sorted.
    pub used: Vec<String>,
    /// The columns that the map names and the log does not have, sorted.
    pub missing: Vec<String>,
    /// Topics of which nothing was used, in the log's order.
    pub unused: Vec<UnusedTopic>,
    /// Whether a throttle was found.
    pub has_throttle: bool,
    /// What the log does not hold any more.
    pub losses: LossReport,
    /// Samples that were left out because their time is a minute and more after all others'.
    pub wild_stamps: u64,
}

/// A topic of which nothing was used.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct UnusedTopic {
    /// Its name in the log.
    pub topic: String,
    /// How many samples it has.
    pub samples: u64,
}

/// What a log does not hold any more, as far as it can be told.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct LossReport {
    /// It ends in the middle of a message.
    pub cut: bool,
    /// Messages that are there and cannot be read.
    pub damaged: u64,
    /// Bytes that were passed over.
    pub skipped_bytes: u64,
    /// Gaps that the logger tells of.
    pub dropouts: u64,
    /// How long they were together, where the logger says it, s.
    pub dropout_s: f64,
}

impl From<Losses> for LossReport {
    fn from(losses: Losses) -> Self {
        let Losses { cut, damaged, skipped_bytes, dropouts, dropout_s } = losses;
        Self { cut, damaged, skipped_bytes, dropouts, dropout_s }
    }
}

impl From<LossReport> for Losses {
    fn from(losses: LossReport) -> Self {
        let LossReport { cut, damaged, skipped_bytes, dropouts, dropout_s } = losses;
        Self { cut, damaged, skipped_bytes, dropouts, dropout_s }
    }
}

impl ColumnsReport {
    pub(super) fn new(map: &ImportMap, columns: Vec<String>) -> Self {
        let mut named: Vec<String> = map.columns.iter().map(|column| column.name.clone()).collect();
        named.sort();
        named.dedup();
        let (used, missing) = named.into_iter().partition(|name| columns.contains(name));
        let is_unused = |column: &String| map.columns.iter().all(|named| named.name != *column);
        Self { used, missing, unused: columns.into_iter().filter(is_unused).collect() }
    }
}

impl TopicsReport {
    pub(super) fn new(
        format: Format,
        survey: &Survey,
        used: Vec<String>,
        missing: Vec<String>,
        has_throttle: bool,
    ) -> Self {
        let is_used = |topic: &Topic| used.iter().any(|column| topics::brings(topic, column));
        let topics = survey.topics.iter().filter(|found| !is_used(&found.topic));
        let unused = topics
            .map(|found| UnusedTopic { topic: found.topic.name.clone(), samples: found.samples })
            .collect();
        let losses = survey.losses.into();
        Self { format: format.words(), used, missing, unused, has_throttle, losses, wild_stamps: 0 }
    }

    /// Flights behind the first in a memory that holds several.
    fn more_flights(&self) -> usize {
        let is_blackbox = self.format == Format::Blackbox.words();
        self.unused.iter().filter(|unused| is_blackbox && unused.topic.starts_with("main[")).count()
    }

    /// What was lost, in words.
    pub fn lost(&self) -> Vec<String> {
        let losses = Losses::from(self.losses);
        let mut lost = Vec::new();
        if !losses.is_none() {
            lost.push(format!("lost of the log: {losses}"));
        }
        if self.wild_stamps > 0 {
            lost.push(format!(
                "{} samples left out: their time is a minute and more after all others'",
                self.wild_stamps
            ));
        }
        lost
    }

    fn explained(&self) -> String {
        let unused =
            self.unused.iter().map(|UnusedTopic { topic, samples }| format!("{topic} ({samples} samples)"));
        explained([self.used.clone(), self.missing.clone(), unused.collect()])
    }
}

/// What of a log was used, missed and left, in lines.
fn explained(lists: [Vec<String>; 3]) -> String {
    let titles = ["used:", "named by the map, not in the log:", "in the log, not used:"];
    let mut lines = Vec::new();
    for (title, list) in titles.into_iter().zip(lists).filter(|(_, list)| !list.is_empty()) {
        lines.push(title.to_owned());
        lines.extend(list.into_iter().map(|line| format!("  {line}")));
    }
    // The last line ends too.
    lines.push(String::new());
    lines.join("\n")
}

impl ImportReport {
    pub(super) fn new(log: &Path, map: &str, rig: Option<&str>, output: &Path) -> Self {
        Self {
            schema: SCHEMA,
            log: log.to_owned(),
            map: map.to_owned(),
            rig: rig.map(str::to_owned),
            output: output.to_owned(),
            rows: 0,
            used: 0,
            filtered: 0,
            skipped: Vec::new(),
            positions_before_origin: 0,
            time_offset_s: 0.0,
            duration_s: 0.0,
            topics: None,
            columns: None,
            channels: BTreeMap::new(),
            quantities: Vec::new(),
        }
    }

    /// What of the log was used, missed and left, in lines.
    pub fn explained(&self) -> String {
        let topics = self.topics.as_ref().map(TopicsReport::explained);
        let columns = self
            .columns
            .clone()
            .map(|ColumnsReport { used, missing, unused }| explained([used, missing, unused]));
        topics.or(columns).unwrap_or_default()
    }

    /// How many rows were skipped, for whatever reason.
    pub fn skipped_rows(&self) -> u64 {
        self.skipped.iter().map(|skipped| skipped.count).sum()
    }

    /// Counts a row that cannot be used.
    pub(super) fn skip(&mut self, reason: SkipReason, column: &str, line: u64, found: &str) {
        let known = self.skipped.iter_mut().find(|known| known.reason == reason && known.column == column);
        match known {
            Some(known) => known.count += 1,
            None => self.skipped.push(Skipped {
                reason,
                column: column.to_owned(),
                count: 1,
                first_line: line,
                first_found: found.chars().take(40).collect(),
            }),
        }
    }
}

impl fmt::Display for ImportReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{} -> {}", self.log.display(), self.output.display())?;
        writeln!(
            f,
            "rows {}, used {}, filtered {}, skipped {}",
            self.rows,
            self.used,
            self.filtered,
            self.skipped_rows()
        )?;
        for skipped in &self.skipped {
            writeln!(f, "  {skipped}")?;
        }
        if self.positions_before_origin > 0 {
            writeln!(
                f,
                "{} positions left out: exposed before the first used row",
                self.positions_before_origin
            )?;
        }
        for line in self.topics.iter().flat_map(TopicsReport::lost) {
            writeln!(f, "{line}")?;
        }
        match self.topics.as_ref().map_or(0, TopicsReport::more_flights) {
            0 => {}
            more => writeln!(
                f,
                "{more} more in the file, of which nothing was taken: a copy of the map may name main[1] in place of main, and so on"
            )?,
        }
        if self.topics.as_ref().is_some_and(|topics| !topics.has_throttle) {
            writeln!(f, "no throttle in the log: the flight can be viewed and compared, not diagnosed")?;
        }
        if let Some(ColumnsReport { missing, .. }) =
            self.columns.as_ref().filter(|columns| !columns.missing.is_empty())
        {
            writeln!(f, "not in the log, and optional: {}", missing.join(", "))?;
        }
        writeln!(f, "duration {:.3} s, from {:.3} s of the log's time", self.duration_s, self.time_offset_s)?;
        for (topic, count) in &self.channels {
            writeln!(f, "  {topic}: {count} messages")?;
        }
        for QuantityRange { name, unit, min, max } in &self.quantities {
            writeln!(f, "  {name}: {min:.4} to {max:.4} {unit}")?;
        }
        Ok(())
    }
}
