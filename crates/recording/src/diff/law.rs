//! How each field is compared: one table.

use serde::{Deserialize, Serialize};

use crate::{Channel, Field, Kind};

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

/// A field's place in the catalogue and among its channel's fields, by its path.
pub(super) fn find(entries: &[Entry], path: &str) -> (usize, usize) {
    let slot = entries.iter().position(|entry| entry.path == path).expect("a field");
    (slot, slot - slots()[entries[slot].channel as usize])
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
