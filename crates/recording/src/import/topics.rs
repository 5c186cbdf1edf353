//! Logs of topics with stamps, and tables that are no text, as rows.

use std::{collections::BTreeMap, fmt, mem, ops::ControlFlow, path::Path};

use bench_logs::{Cell, Format, Losses, Sample, Survey, Topic, Visitor, scan};

use super::{
    ImportError, ImportMap,
    angle::Angle,
    log::{Row, find_columns},
    map::{ChannelMap, ColumnId, PhaseSource, Source},
    number::finite,
    report::{ColumnsReport, SkipReason},
};
use crate::Channel;

/// Samples are put in the order of their stamps as far as they are apart by less than this, ns.
const REORDERED_NS: i128 = 1_000_000_000;
/// A stamp that is this far ahead of all others is believed when the next one confirms it, ns.
const JUMP_NS: i128 = 60_000_000_000;

/// What stands in a column.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) enum Value {
    #[default]
    Absent,
    Number(f64),
    Integer(i128),
    Text(String),
}

/// A column in a row.
#[derive(Clone, Debug, Default)]
pub(super) struct Held {
    pub value: Value,
    /// Whether the row brought it; else it is what the last one before it brought.
    pub is_new: bool,
}

impl Value {
    fn of(cell: &Cell<'_>) -> Self {
        match cell {
            Cell::Absent => Self::Absent,
            Cell::Number(number) => Self::Number(*number),
            Cell::Integer(number) => Self::Integer(*number),
            Cell::Text(text) => Self::Text(String::from_utf8_lossy(text).trim().to_owned()),
        }
    }

    fn number(&self) -> f64 {
        match self {
            Self::Number(number) => *number,
            Self::Integer(number) => *number as f64,
            Self::Absent | Self::Text(_) => f64::NAN,
        }
    }

    /// The finite number that it is.
    pub fn finite(&self) -> Result<f64, SkipReason> {
        match self {
            Self::Absent => Err(SkipReason::Empty),
            Self::Text(text) => finite(text),
            Self::Number(number) if number.is_nan() => Err(SkipReason::Nan),
            Self::Number(number) if number.is_infinite() => Err(SkipReason::Infinite),
            Self::Number(_) | Self::Integer(_) => Ok(self.number()),
        }
    }
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Absent => Ok(()),
            Self::Number(number) => number.fmt(f),
            Self::Integer(number) => number.fmt(f),
            Self::Text(text) => text.fmt(f),
        }
    }
}

/// How a column comes from a topic's fields.
#[derive(Clone, Debug, PartialEq)]
enum Way {
    Field(usize),
    Angle(Angle, [usize; 4]),
}

/// The names by which a map may call a topic: its own, and its type, such as `nav_msgs/msg/Odometry`.
fn called(topic: &Topic) -> impl Iterator<Item = &str> {
    let kind = Some(topic.kind.as_str()).filter(|kind| kind.contains('/'));
    std::iter::once(topic.name.as_str()).chain(kind)
}

/// Finds a column such as `vehicle_attitude.q.roll` in a topic; `None` where the topic does not have it.
fn way(topic: &Topic, column: &str) -> Option<Way> {
    let name = called(topic).find_map(|name| column.strip_prefix(name)?.strip_prefix('.'))?;
    let place = |name: &str| topic.fields.iter().position(|field| field.name == name);
    if let Some(place) = place(name) {
        return Some(Way::Field(place));
    }
    let (of, angle) =
        Angle::ALL.iter().find_map(|(ending, angle)| Some((name.strip_suffix(ending)?, *angle)))?;
    let parts = |parts: [&str; 4]| -> Option<[usize; 4]> {
        let found: Option<Vec<usize>> = parts.iter().map(|part| place(&format!("{of}{part}"))).collect();
        found?.try_into().ok()
    };
    let quaternion = parts(["[0]", "[1]", "[2]", "[3]"]).or_else(|| parts([".w", ".x", ".y", ".z"]))?;
    Some(Way::Angle(angle, quaternion))
}

/// Whether a log has a column.
pub(super) fn has(survey: &Survey, column: &str) -> bool {
    survey.topics.iter().any(|found| way(&found.topic, column).is_some())
}

/// Whether a column stands in a topic.
pub(super) fn brings(topic: &Topic, column: &str) -> bool {
    way(topic, column).is_some()
}

/// A column that several topics of a log have, with their names.
pub(super) fn several<'c>(survey: &Survey, columns: &'c [String]) -> Option<(&'c str, Vec<String>)> {
    columns.iter().find_map(|column| {
        let topics = survey.topics.iter().filter(|found| brings(&found.topic, column));
        let names: Vec<String> = topics.map(|found| found.topic.name.clone()).collect();
        (names.len() > 1).then_some((column.as_str(), names))
    })
}

/// The names of a log's topics, with their fields where a column looks for one in vain.
pub(super) fn words(survey: &Survey, missing: &[String]) -> Vec<String> {
    let is_sought = |topic: &Topic| {
        called(topic).any(|name| {
            missing.iter().any(|column| column.strip_prefix(name).is_some_and(|rest| rest.starts_with('.')))
        })
    };
    let topics = survey.topics.iter().map(|found| &found.topic);
    topics
        .map(|topic| {
            if is_sought(topic) {
                let fields: Vec<&str> = topic.fields.iter().map(|field| field.name.as_str()).collect();
                format!("{} (with {})", topic.name, fields.join(", "))
            } else {
                topic.name.clone()
            }
        })
        .collect()
}

impl ImportMap {
    /// The columns without which these channels make no sense.
    pub(super) fn needed(&self, of: &[Channel]) -> impl Iterator<Item = &str> {
        let channels = self.channels.iter().filter(|map| of.contains(&map.table.channel));
        let quantities = channels.flat_map(|map| &map.quantities).filter(|quantity| quantity.target.required);
        let exposed = self.exposed.as_ref().filter(|_| of.contains(&Channel::Position));
        let columns = quantities.flat_map(|quantity| quantity.source.columns().iter().copied());
        columns
            .chain(exposed.map(|exposed| exposed.column))
            .map(|column| self.columns[column.0].name.as_str())
    }

    /// Takes out what a log does not have, and returns the names of the columns that were missed. A table of the map goes when what
    /// it needs is missing.
    pub(super) fn fit(&mut self, survey: &Survey) -> Vec<String> {
        let mut missed = Vec::new();
        let columns = &self.columns;
        let mut lacks = |of: &[ColumnId]| {
            let names = of.iter().map(|column| &columns[column.0].name);
            let missing: Vec<&String> = names.filter(|name| !has(survey, name)).collect();
            missed.extend(missing.iter().map(|name| (*name).clone()));
            !missing.is_empty()
        };
        let mut keeps = |channel: &mut ChannelMap, phase: &PhaseSource| {
            let lacks_phase = channel.table.channel == Channel::ControlState
                && phase.column().is_some_and(|column| lacks(&[column]));
            let mut is_whole = !lacks_phase;
            channel.quantities.retain(|quantity| {
                let lacks = lacks(quantity.source.columns());
                is_whole &= !(lacks && quantity.target.required);
                !lacks
            });
            is_whole && (channel.table.channel == Channel::ControlState || !channel.quantities.is_empty())
        };
        self.channels.retain_mut(|channel| keeps(channel, &self.phase));
        // When a position was exposed is no guess.
        if self.exposed.as_ref().is_some_and(|exposed| lacks(&[exposed.column])) {
            self.channels.retain(|channel| channel.table.channel != Channel::Position);
            self.exposed = None;
        }
        missed.sort();
        missed.dedup();
        missed
    }

    /// The columns that are still used once the map is fitted to a log.
    fn used(&self) -> Vec<ColumnId> {
        let mut used: Vec<ColumnId> = Vec::new();
        for channel in &self.channels {
            if channel.table.channel == Channel::ControlState {
                used.extend(self.phase.column());
            }
            used.extend(channel.quantities.iter().flat_map(|quantity| quantity.source.columns()));
        }
        used.extend(self.exposed.iter().map(|exposed| exposed.column));
        used
    }

    /// The names of the columns that are used, each once.
    pub(super) fn used_names(&self) -> Vec<String> {
        let mut names: Vec<String> =
            self.used().iter().map(|column| self.columns[column.0].name.clone()).collect();
        names.sort();
        names.dedup();
        names
    }
}

impl Source {
    pub(super) fn columns(&self) -> &[ColumnId] {
        match self {
            Self::Constant(_) => &[],
            Self::Columns { columns, .. } => columns,
        }
    }
}

impl PhaseSource {
    pub(super) fn column(&self) -> Option<ColumnId> {
        match self {
            Self::Constant(_) => None,
            Self::Names(column, _) | Self::Thresholds(column, _) => Some(*column),
        }
    }
}

/// Reads a log of topics, and hands over a row for each stamp at which a topic of the map has a sample.
pub(super) fn read_topics(
    map: &ImportMap,
    format: Format,
    path: &Path,
    take: &mut dyn FnMut(Row<'_>) -> Result<(), ImportError>,
) -> Result<(Losses, u64), ImportError> {
    let position = map.channels.iter().find(|channel| channel.table.channel == Channel::Position);
    let altitude = position
        .and_then(|channel| channel.quantities.iter().find_map(|quantity| quantity.source.columns().first()));
    let mut rows = Rows {
        map,
        used: map.used(),
        altitude: altitude.copied(),
        topics: Vec::new(),
        held: vec![Held::default(); map.columns.len()],
        waiting: BTreeMap::new(),
        samples: 0,
        newest_ns: None,
        ahead: None,
        wild: 0,
        line: 0,
        take,
        failed: None,
    };
    let losses = scan(path, format, &mut rows)?;
    rows.wild += u64::from(rows.ahead.take().is_some());
    while rows.failed.is_none() && rows.next_row().is_continue() {}
    match rows.failed {
        Some(error) => Err(error),
        None => Ok((losses, rows.wild)),
    }
}

type Cells = Vec<(ColumnId, Value)>;

struct Rows<'a> {
    map: &'a ImportMap,
    used: Vec<ColumnId>,
    /// Rows begin with the first of these.
    altitude: Option<ColumnId>,
    /// The columns of each topic, in the order of the cells asked for.
    topics: Vec<Vec<(ColumnId, Way)>>,
    held: Vec<Held>,
    /// By stamp and order in the file.
    waiting: BTreeMap<(i128, u64), Cells>,
    samples: u64,
    newest_ns: Option<i128>,
    /// A sample from far ahead that the next one confirms, or not.
    ahead: Option<(i128, Cells)>,
    /// Samples whose stamp nothing confirmed.
    wild: u64,
    line: u64,
    take: &'a mut dyn FnMut(Row<'_>) -> Result<(), ImportError>,
    failed: Option<ImportError>,
}

impl Visitor for Rows<'_> {
    fn topic(&mut self, topic: &Topic) -> Option<Vec<usize>> {
        let of = |column: &ColumnId| Some((*column, way(topic, &self.map.columns[column.0].name)?));
        let mut wanted = Vec::new();
        let mut at = |place: usize| {
            wanted.push(place);
            wanted.len() - 1
        };
        let columns: Vec<(ColumnId, Way)> = self
            .used
            .iter()
            .filter_map(of)
            .map(|(column, way)| match way {
                Way::Field(place) => (column, Way::Field(at(place))),
                Way::Angle(angle, places) => (column, Way::Angle(angle, places.map(&mut at))),
            })
            .collect();
        let is_used = !columns.is_empty();
        self.topics.push(columns);
        is_used.then_some(wanted)
    }

    fn sample(&mut self, sample: Sample<'_>) -> ControlFlow<()> {
        let Some(time) = sample.time_ns else { return ControlFlow::Continue(()) };
        let cells = sample.cells;
        let number = |place: &usize| Value::of(&cells[*place]).number();
        let values: Cells = self.topics[sample.topic]
            .iter()
            .map(|(column, way)| match way {
                Way::Field(place) => (*column, Value::of(&cells[*place])),
                Way::Angle(angle, places) => {
                    (*column, Value::Number(angle.of(places.each_ref().map(number))))
                }
            })
            .collect();
        let is_far = |of: i128| time - of > JUMP_NS;
        let is_near = self.newest_ns.is_none_or(|newest| !is_far(newest));
        match self.ahead.take() {
            Some((before, waiting)) if !is_near && (time - before).abs() <= JUMP_NS => {
                self.wait(before, waiting);
                self.wait(time, values);
            }
            other => {
                self.wild += u64::from(other.is_some());
                if is_near {
                    self.wait(time, values);
                } else {
                    self.ahead = Some((time, values));
                }
            }
        }
        let Some(newest) = self.newest_ns else { return ControlFlow::Continue(()) };
        while self.waiting.first_key_value().is_some_and(|((first, _), _)| newest - first > REORDERED_NS) {
            if self.next_row().is_break() {
                break;
            }
        }
        if self.failed.is_some() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}

impl Rows<'_> {
    fn wait(&mut self, time: i128, cells: Cells) {
        self.waiting.insert((time, self.samples), cells);
        self.samples += 1;
        self.newest_ns = self.newest_ns.max(Some(time));
    }

    /// Hands over all samples of the earliest stamp as a row; breaks where there is none, or the taker failed.
    fn next_row(&mut self) -> ControlFlow<()> {
        let Some(((time, _), cells)) = self.waiting.pop_first() else { return ControlFlow::Break(()) };
        for held in &mut self.held {
            held.is_new = false;
        }
        let mut put = |cells: Cells| {
            for (column, value) in cells {
                self.held[column.0] = Held { value, is_new: true };
            }
        };
        put(cells);
        while self.waiting.first_key_value().is_some_and(|((next, _), _)| *next == time) {
            put(self.waiting.pop_first().map(|(_, cells)| cells).unwrap_or_default());
        }
        // What came before the first altitude is known, and no part of the flight.
        if let Some(altitude) = self.altitude {
            if !self.held[altitude.0].is_new {
                return ControlFlow::Continue(());
            }
            self.altitude = None;
        }
        self.line += 1;
        match (self.take)(Row::of_cells(&self.held, self.line, Some(time))) {
            Ok(()) => ControlFlow::Continue(()),
            Err(error) => {
                self.failed = Some(error);
                ControlFlow::Break(())
            }
        }
    }
}

/// Reads a Parquet table, and hands over its rows.
pub(super) fn read_table(
    map: &ImportMap,
    path: &Path,
    take: &mut dyn FnMut(Row<'_>) -> Result<(), ImportError>,
) -> Result<ColumnsReport, ImportError> {
    let columns = ColumnsReport::default();
    let mut table = Table { map, path, take, held: Vec::new(), places: Vec::new(), columns, failed: None };
    scan(path, Format::Parquet, &mut table)?;
    table.failed.map_or(Ok(table.columns), Err)
}

struct Table<'a> {
    map: &'a ImportMap,
    path: &'a Path,
    take: &'a mut dyn FnMut(Row<'_>) -> Result<(), ImportError>,
    held: Vec<Held>,
    /// As [`find_columns`] found them.
    places: Vec<Option<usize>>,
    columns: ColumnsReport,
    failed: Option<ImportError>,
}

impl Visitor for Table<'_> {
    fn topic(&mut self, topic: &Topic) -> Option<Vec<usize>> {
        let columns: Vec<String> = topic.fields.iter().map(|field| field.name.clone()).collect();
        match find_columns(self.map, self.path, &columns) {
            Ok(places) => {
                let wanted = places.iter().copied().flatten().collect();
                self.places = places;
                self.columns = ColumnsReport::new(self.map, columns);
                Some(wanted)
            }
            Err(error) => {
                self.failed = Some(error);
                None
            }
        }
    }

    fn sample(&mut self, sample: Sample<'_>) -> ControlFlow<()> {
        let mut held = mem::take(&mut self.held);
        held.clear();
        let mut cells = sample.cells.iter();
        held.extend(self.places.iter().map(|place| {
            let cell = place.and_then(|_| cells.next());
            Held { value: cell.map_or(Value::Absent, Value::of), is_new: true }
        }));
        self.failed = (self.take)(Row::of_cells(&held, sample.line, None)).err();
        self.held = held;
        if self.failed.is_some() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}
