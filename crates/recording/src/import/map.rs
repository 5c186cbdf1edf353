//! The mapping file: which column is what, in which unit.

use std::{
    fs,
    path::{Path, PathBuf},
};

use bench_device::Sticks;
use bench_logs::Format;
use bench_rig::{
    Actuation, Location, Phase, Problem, Rig, RigError,
    visit::{self, Range, Reader},
};

use super::{
    angle::Angle,
    number::TimeUnit,
    target::{Table, Target},
};
use crate::Channel;

/// A mapping file: how the columns of a flight log become the channels of a recording. `docs/import.md` tells how to
/// write one.
#[derive(Clone, Debug)]
pub struct ImportMap {
    /// Its name, recorded with what was imported.
    pub name: String,
    /// The rig file that is attached when no other rig is given; a path that can be opened from here.
    pub rig: Option<PathBuf>,
    /// The unit of the sticks.
    pub actuation: Actuation,
    pub(super) file: PathBuf,
    pub(super) text: String,
    pub(super) delimiter: u8,
    /// Whether the first line of a table names its columns; else they are called by their numbers, from one.
    pub(super) has_header: bool,
    /// The kind of log of topics that it is for; `None`: tables.
    pub(super) log: Option<Format>,
    /// Where the time of a row stands; in logs of topics each sample has its own.
    pub(super) time: Option<TimeColumn>,
    pub(super) filters: Vec<Filter>,
    /// The loop's nominal period, where ticks are wanted.
    pub(super) tick_period: Option<Setting>,
    /// How far positions lag behind the rows that hold them, where these do not say when they were exposed.
    pub(super) latency: Setting,
    /// When the positions were exposed, on the log's clock.
    pub(super) exposed: Option<TimeColumn>,
    /// Time between two frames, where a row holds the newest of them and does not say when it arrived.
    pub(super) frame_period: Option<Setting>,
    pub(super) phase: PhaseSource,
    pub(super) channels: Vec<ChannelMap>,
    /// Every column that is named anywhere; a [`ColumnId`] is a place in this list.
    pub(super) columns: Vec<ColumnUse>,
}

/// A place in [`ImportMap::columns`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ColumnId(pub usize);

/// A column where the map names it.
#[derive(Clone, Debug)]
pub(super) struct ColumnUse {
    pub name: String,
    pub at: Location,
    pub key: String,
    /// Whether a table may lack it, as a whole or in some rows.
    pub optional: bool,
}

#[derive(Clone, Debug)]
pub(super) struct TimeColumn {
    pub column: ColumnId,
    pub unit: TimeUnit,
}

/// Keeps the rows whose column is at least `at_least` and below `below`.
#[derive(Clone, Debug)]
pub(super) struct Filter {
    pub column: ColumnId,
    pub at_least: f64,
    pub below: f64,
}

/// A time that the map gives or leaves to the rig.
#[derive(Clone, Debug)]
pub(super) enum Setting {
    Given(f64),
    /// To be taken from the rig; where and at which key the map says so.
    FromRig(Location, String),
}

#[derive(Clone, Debug)]
pub(super) enum PhaseSource {
    Constant(Phase),
    /// By what the cell says.
    Names(ColumnId, Vec<(String, Phase)>),
    /// By the highest of these numbers that the cell reaches; they rise.
    Thresholds(ColumnId, Vec<(f64, Phase)>),
}

/// One table of the map.
#[derive(Clone, Debug)]
pub(super) struct ChannelMap {
    pub table: &'static Table,
    pub quantities: Vec<Quantity>,
    pub changes_only: bool,
    /// At most one message in each stretch of this length, s.
    pub every_s: Option<f64>,
    /// An empty or NaN cell means that this row has no message of the channel, not that the row is bad.
    pub may_be_absent: bool,
}

#[derive(Clone, Debug)]
pub(super) struct Quantity {
    pub target: &'static Target,
    pub source: Source,
}

#[derive(Clone, Debug)]
pub(super) enum Source {
    /// In the recording's unit.
    Constant(f64),
    /// What `make` makes of `columns`, each within `valid`, times `factor` plus `shift`.
    Columns { columns: Vec<ColumnId>, make: Make, valid: Option<Range>, factor: f64, shift: f64 },
}

/// What becomes of the numbers of several columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Make {
    Mean,
    MeanOfSquares,
    /// Of a quaternion, real part first, rad.
    Angle(Angle),
}

impl ImportMap {
    /// Reads a mapping file.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, RigError> {
        let path = path.as_ref();
        let text = fs::read_to_string(path).map_err(|source| RigError::Read {
            what: "import map",
            path: path.to_owned(),
            source,
        })?;
        Self::read(path, &text)
    }

    /// Reads a map from text; `file` serves messages, and the rig's path is taken from its folder.
    pub fn read(file: &Path, text: &str) -> Result<Self, RigError> {
        let root = visit::parse(file, text)?;
        let mut map = Self {
            name: String::new(),
            rig: None,
            actuation: Actuation::default(),
            file: file.to_owned(),
            text: text.to_owned(),
            delimiter: b',',
            has_header: true,
            log: None,
            time: None,
            filters: Vec::new(),
            tick_period: None,
            latency: Setting::Given(0.0),
            exposed: None,
            frame_period: None,
            phase: PhaseSource::Constant(Phase::Idle),
            channels: Vec::new(),
            columns: Vec::new(),
        };
        let mut problems = Vec::new();
        Reader::read(file, "", &root, &mut problems, |reader| map.fill(reader));
        if problems.is_empty() { Ok(map) } else { Err(RigError::Invalid(problems)) }
    }

    /// The kind of log of topics that the map is for; `None`: tables.
    pub fn log(&self) -> Option<Format> {
        self.log
    }

    /// The rig that the map names, if it names one.
    pub fn load_rig(&self) -> Result<Option<Rig>, RigError> {
        self.rig.as_ref().map(Rig::load).transpose()
    }

    /// Whether the map has sticks, whose unit a rig must share.
    pub(super) fn has_sticks(&self) -> bool {
        self.channels.iter().any(|map| matches!(map.table.channel, Channel::Command | Channel::Readback))
    }
}

impl Setting {
    /// The time in seconds; `from_rig` reads it from the rig, if there is one.
    pub fn resolve(&self, rig: Option<&Rig>, from_rig: impl FnOnce(&Rig) -> f64) -> Result<f64, Problem> {
        match (self, rig) {
            (Self::Given(seconds), _) => Ok(*seconds),
            (Self::FromRig(..), Some(rig)) => Ok(from_rig(rig)),
            (Self::FromRig(at, key), None) => Err(Problem::Contradiction {
                at: at.clone(),
                key: key.clone(),
                detail: "is to be taken from the rig, but there is none; give one (--rig) or a number here"
                    .to_owned(),
            }),
        }
    }
}

/// The sticks of channels that map only some of them: the rig's centre, or zero without a rig.
pub(super) fn sticks_at_rest(rig: Option<&Rig>) -> Sticks {
    let centre = rig.map_or(0.0, |rig| rig.airframe.sticks.centre);
    Sticks { throttle: 0.0, pitch: centre, roll: centre, yaw: centre }
}
