//! How each field is compared: one table.

use serde::{Deserialize, Serialize};

use crate::{Channel, Field, Kind, Record, Value};
use bench_device::TrackStatus;

/// What a field's value is taken to be between two of its samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Interpolation {
    /// On the line between them: measured and simulated motion.
    Linear,
    /// The earlier one: commands, set-points, phases, flags.
    Hold,
    /// Nothing: events, which happen at an instant.
    None,
}

/// Which number stands for a value, so that it can be compared across clocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Measure {
    /// The value.
    Value,
    /// The value less that of the record before: instants and counters, whose origin means nothing.
    Increment,
    /// Seconds since the record's own time: instants that belong to it.
    Age,
}

/// How one field is compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Law {
    pub interpolation: Interpolation,
    pub measure: Measure,
    /// Tells how the recording was made, not what flew.
    pub bookkeeping: bool,
    /// Radians that wrap at a full turn.
    pub wraps: bool,
    /// Values are names: equal or not, with nothing in between.
    pub names: bool,
    /// Values are equal or not: names and flags.
    pub exact: bool,
}

/// A field and its law.
pub(super) struct Entry {
    pub channel: Channel,
    pub field: &'static Field,
    /// Topic and name: `/tracker/position/position_m.z`.
    pub path: String,
    pub law: Law,
}

/// Every field of every channel, in the order of [`slots`].
pub(super) fn catalogue() -> Vec<Entry> {
    let entries = |channel: Channel| {
        channel.fields().iter().enumerate().map(move |(index, field)| Entry {
            channel,
            field,
            path: format!("{}/{}", channel.topic(), field.name),
            law: law(channel, field, index == 0),
        })
    };
    Channel::ALL.into_iter().flat_map(entries).collect()
}

/// Where each channel's fields begin in the [`catalogue`].
pub(super) fn slots() -> [usize; Channel::ALL.len()] {
    let mut next = 0;
    Channel::ALL.map(|channel| {
        let slot = next;
        next += channel.fields().len();
        slot
    })
}

fn law(channel: Channel, field: &Field, own_time: bool) -> Law {
    let event = channel == Channel::Event;
    let held = field.kind != Kind::Float
        || channel == Channel::Tick
        || field.unit == Field::ACTUATION
        || (channel == Channel::ControlState && !field.name.starts_with("estimate"));
    let measure = match field.name {
        "exposed_at_s" | "scheduled_s" => Measure::Age,
        "device_time_s" | "index" => Measure::Increment,
        _ if own_time => Measure::Increment,
        _ => Measure::Value,
    };
    Law {
        interpolation: match (event, held) {
            (true, _) => Interpolation::None,
            (false, true) => Interpolation::Hold,
            (false, false) => Interpolation::Linear,
        },
        measure,
        bookkeeping: measure != Measure::Value || event || channel == Channel::Tick,
        wraps: field.unit == "rad",
        names: field.kind == Kind::Text,
        exact: matches!(field.kind, Kind::Text | Kind::Bool),
    }
}

/// Numbers beyond this are taken as damage: their squares would not be finite.
const LARGEST: f64 = 1e100;

/// What became of one value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Cell {
    Missing,
    /// Not a finite number, or an absurd one.
    Unusable,
    Number(f64),
}

/// Turns records into numbers, field by field.
pub(super) struct Extractor {
    measures: Vec<Measure>,
    slots: [usize; Channel::ALL.len()],
    previous: Vec<Option<i128>>,
}

impl Extractor {
    pub fn new() -> Self {
        let entries = catalogue();
        Self {
            measures: entries.iter().map(|entry| entry.law.measure).collect(),
            slots: slots(),
            previous: vec![None; entries.len()],
        }
    }

    /// Gives slot and cell of each field of the record.
    pub fn each(&mut self, record: &Record, mut take: impl FnMut(usize, Cell)) {
        let first = self.slots[record.channel() as usize];
        let lost = matches!(record, Record::Position(position) if position.status == TrackStatus::Lost);
        for (slot, value) in (first..).zip(record.values()) {
            let cell = match value {
                Value::Float(_) if lost => Cell::Missing,
                Value::Float(x) if x.abs() <= LARGEST => Cell::Number(x),
                Value::Float(_) => Cell::Unusable,
                other => self.cell(slot, other, record),
            };
            take(slot, cell);
        }
    }

    /// The cell of a value that is no real number.
    fn cell(&mut self, slot: usize, value: Value, record: &Record) -> Cell {
        match (self.measures[slot], value) {
            (Measure::Age, Value::Time(time)) => Cell::Number(time.since_s(record.time())),
            (Measure::Increment, Value::Time(time)) => {
                self.increment(slot, time.nanos().into()).map_or(Cell::Missing, |ns| Cell::Number(ns * 1e-9))
            }
            (Measure::Increment, Value::Integer(count)) => {
                self.increment(slot, count.into()).map_or(Cell::Missing, Cell::Number)
            }
            (_, Value::Missing | Value::Float(_)) => Cell::Missing,
            (_, Value::Integer(count)) => Cell::Number(count as f64),
            (_, Value::Bool(flag)) => Cell::Number(f64::from(u8::from(flag))),
            (_, Value::Text(text)) => Cell::Number(name_number(text)),
            (_, Value::Time(time)) => Cell::Number(time.seconds()),
        }
    }

    fn increment(&mut self, slot: usize, now: i128) -> Option<f64> {
        self.previous[slot].replace(now).map(|before| (now - before) as f64)
    }
}

/// A number for a text: equal texts have equal ones. FNV-1a, cut to the 53 bits that a real number holds exactly.
pub(super) fn name_number(text: &str) -> f64 {
    let hash = text.bytes().fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
    });
    (hash >> 11) as f64
}

/// The difference of two angles, within half a turn.
pub(super) fn wrapped(angle_rad: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    if angle_rad.abs() <= PI { angle_rad } else { angle_rad - TAU * (angle_rad / TAU).round() }
}

/// `to` less `from`.
pub(super) fn difference(law: Law, from: f64, to: f64) -> f64 {
    if law.wraps { wrapped(to - from) } else { to - from }
}
