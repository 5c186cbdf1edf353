//! What a limit is about: a figure of the flight's summary, or a statistic of a recorded field.

use bench_recording::{Channel, Field, Kind};
use bench_rig::Phase;
use bench_run::Summary;

/// A figure of a flight's summary. A limit's key is made of its name: `peak_min_m`, `peak_max_m`, `peak_spread_max_m`.
#[derive(Clone, Copy, Debug)]
pub struct Measure {
    /// Its name, without unit.
    pub name: &'static str,
    /// The unit as keys end in it: `m`, `s`; empty for counts.
    pub unit: &'static str,
    /// What it is, in words that a sentence goes on with.
    pub meaning: &'static str,
    /// Its value; `None` where the flight does not define it.
    pub of: fn(&Summary) -> Option<f64>,
}

/// All of them. Names and units are those of a mission's criteria where these have them.
pub const MEASURES: [Measure; 14] = [
    measure("peak", "m", "highest altitude", |s| s.peak_m),
    measure("settling_time", "s", "time from a hold's beginning until the band is never left again", |s| {
        s.settling_time_s
    }),
    measure("overshoot", "m", "how far the altitude exceeds the hold's set-point", |s| s.overshoot_m),
    measure("rms_error", "m", "RMS altitude error over the last hold once settled", |s| s.rms_error_m),
    measure("lateral_rms_error", "m", "RMS horizontal error over the last hold once settled", |s| {
        s.lateral_rms_error_m
    }),
    measure("rebound", "m", "lowest altitude between the first two peaks", |s| s.rebound_m),
    measure("duration", "s", "time from the first iteration to the last", |s| Some(s.duration_s)),
    measure("overruns", "", "iterations that overran", |s| Some(s.overruns as f64)),
    measure("unanswered", "", "iterations whose outputs were not read back in time", |s| {
        Some(s.unanswered as f64)
    }),
    measure("positions", "", "positions received", |s| Some(s.positions as f64)),
    measure("lateness", "s", "latest start of an iteration after its schedule", |s| Some(s.lateness_max_s)),
    measure("lateness_p99", "s", "start of an iteration after its schedule, 99 of 100 of them", |s| {
        Some(s.timing.lateness_s.p99)
    }),
    measure(
        "round_trip_p50",
        "s",
        "time from handing the outputs over to having them read back, median",
        |s| Some(s.timing.round_trip_s.p50),
    ),
    measure("round_trip_p99", "s", "the same time, 99 of 100 of them", |s| Some(s.timing.round_trip_s.p99)),
];

const fn measure(
    name: &'static str,
    unit: &'static str,
    meaning: &'static str,
    of: fn(&Summary) -> Option<f64>,
) -> Measure {
    Measure { name, unit, meaning, of }
}

impl Measure {
    /// The key of a limit on it.
    pub fn key(&self, side: Side) -> String {
        let middle = match side {
            Side::Least => "min",
            Side::Most => "max",
            Side::Spread => "spread_max",
        };
        let end = if self.unit.is_empty() { String::new() } else { format!("_{}", self.unit) };
        format!("{}_{middle}{end}", self.name)
    }

    /// The measure of that name.
    pub fn named(name: &str) -> Option<&'static Self> {
        MEASURES.iter().find(|measure| measure.name == name)
    }
}

/// Which way a limit holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The value must not be below it.
    Least,
    /// The value must not be above it.
    Most,
    /// The greatest less the least value of a test's repeats must not be above it.
    Spread,
}

impl Side {
    /// All of them, in the order of a file.
    pub const ALL: [Self; 3] = [Self::Least, Self::Most, Self::Spread];

    /// Whether the limit is kept.
    pub fn holds(self, value: f64, limit: f64) -> bool {
        match self {
            Self::Least => value >= limit,
            Self::Most | Self::Spread => value <= limit,
        }
    }

    /// As said between a value and its limit.
    pub const fn words(self) -> &'static str {
        match self {
            Self::Least => "at least",
            Self::Most | Self::Spread => "at most",
        }
    }
}

/// One limit of a case.
#[derive(Clone, Debug, PartialEq)]
pub enum Limit {
    /// On a figure of the summary.
    Measure {
        /// Its name, one of [`MEASURES`].
        name: &'static str,
        /// Which way it holds.
        side: Side,
        /// In the measure's unit.
        limit: f64,
    },
    /// On a field of the recording.
    Field(FieldLimit),
}

/// A limit on a statistic of a recorded field.
#[derive(Clone, Debug, PartialEq)]
pub struct FieldLimit {
    /// Topic and name: `/tracker/position/position_m.z`.
    pub path: String,
    /// The channel that it is of.
    pub channel: Channel,
    /// Its place among the channel's fields.
    pub index: usize,
    /// What is made of its samples.
    pub statistic: Statistic,
    /// The samples of this phase alone; `None`: all.
    pub phase: Option<Phase>,
    /// For [`Statistic::Share`]: the value that is looked for.
    pub equals: Option<String>,
    /// The limits, each at most once.
    pub sides: Vec<(Side, f64)>,
    /// The unit of the limits as the file says it; empty where there is none.
    pub unit: String,
}

/// What is made of a field's samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Statistic {
    /// The least.
    Min,
    /// The greatest.
    Max,
    /// The greatest less the least.
    Range,
    /// The mean.
    Mean,
    /// The root of the mean square.
    Rms,
    /// The standard deviation about the mean.
    Deviation,
    /// The median.
    Median,
    /// 95 of 100 are not above it (nearest rank).
    P95,
    /// 99 of 100 are not above it (nearest rank).
    P99,
    /// The first.
    First,
    /// The last.
    Last,
    /// How many there are.
    Count,
    /// The share of samples that have the value given by `equals`, 0 to 1.
    Share,
}

impl Statistic {
    /// All with their names in files.
    pub const CHOICES: [(&'static str, Self); 13] = [
        ("min", Self::Min),
        ("max", Self::Max),
        ("range", Self::Range),
        ("mean", Self::Mean),
        ("rms", Self::Rms),
        ("deviation", Self::Deviation),
        ("median", Self::Median),
        ("p95", Self::P95),
        ("p99", Self::P99),
        ("first", Self::First),
        ("last", Self::Last),
        ("count", Self::Count),
        ("share", Self::Share),
    ];

    /// Its name in files.
    pub fn name(self) -> &'static str {
        Self::CHOICES.iter().find(|(_, statistic)| *statistic == self).map_or("", |(name, _)| name)
    }

    /// Whether it is in the field's unit; a number without unit otherwise.
    pub const fn has_unit(self) -> bool {
        !matches!(self, Self::Count | Self::Share)
    }

    /// Whether it can be made of values of a kind.
    pub const fn suits(self, kind: Kind) -> bool {
        match self {
            Self::Count => true,
            Self::Share => matches!(kind, Kind::Text | Kind::Bool),
            _ => matches!(kind, Kind::Float | Kind::Integer | Kind::Time),
        }
    }
}

impl FieldLimit {
    /// The field.
    pub fn field(&self) -> Field {
        self.channel.fields()[self.index]
    }

    /// What it is about, in a line: `max of /tracker/position/position_m.z in hold`.
    pub fn about(&self) -> String {
        let equals = self.equals.as_ref().map(|value| format!(" {value:?}")).unwrap_or_default();
        let phase = self.phase.map(|phase| format!(" in {phase}")).unwrap_or_default();
        format!("{} of {}{equals}{phase}", self.statistic.name(), self.path)
    }
}

/// Every field of a recording by its path.
pub(crate) fn fields() -> impl Iterator<Item = (String, Channel, usize, Field)> {
    Channel::ALL.into_iter().flat_map(|channel| {
        channel.fields().iter().enumerate().map(move |(index, field)| {
            (format!("{}/{}", channel.topic(), field.name), channel, index, *field)
        })
    })
}

#[cfg(test)]
mod tests {
    use bench_rig::Mission;

    use super::*;

    #[test]
    fn criteria_of_a_mission_are_limits_of_a_suite() {
        let forms = Mission::keys();
        let criteria = forms[0].keys.iter().find(|key| key.name == "criteria").unwrap();
        let bench_rig::keys::Kind::Table(forms) = &criteria.kind else { panic!("a table") };
        let limits: Vec<String> =
            MEASURES.iter().flat_map(|measure| Side::ALL.map(|side| measure.key(side))).collect();
        for key in forms[0].keys.iter().filter(|key| key.name != "settle_band_m") {
            assert!(limits.contains(&key.name), "{}", key.name);
        }
    }

    #[test]
    fn every_field_has_a_path_of_its_own() {
        let mut paths: Vec<_> = fields().map(|(path, ..)| path).collect();
        let all = paths.len();
        paths.sort();
        paths.dedup();
        assert_eq!(paths.len(), all);
        assert!(paths.contains(&"/tracker/position/position_m.z".to_owned()));
    }
}
