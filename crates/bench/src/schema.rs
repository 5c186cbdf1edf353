//! Schemas of all files that the bench reads and of all JSON that it prints, by name.

mod json;
mod outputs;
mod page;

use bench_campaign::sweep_keys;
use bench_recording::{diff::tolerance_keys, import::ImportMap};
use bench_rig::{Airframe, Calibration, Mission, Rig, keys::Form};
use bench_suite::suite_keys;
use serde_json::Value;

pub use outputs::OUTPUTS;

/// A kind of TOML file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Kind {
    Rig,
    Airframe,
    Mission,
    Map,
    Calibration,
    Tolerances,
    Suite,
    Sweep,
}

impl Kind {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::Rig,
        Self::Airframe,
        Self::Mission,
        Self::Map,
        Self::Calibration,
        Self::Tolerances,
        Self::Suite,
        Self::Sweep,
    ];

    /// The name of its schema.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Rig => "rig",
            Self::Airframe => "airframe",
            Self::Mission => "mission",
            Self::Map => "map",
            Self::Calibration => "calibration",
            Self::Tolerances => "tolerances",
            Self::Suite => "suite",
            Self::Sweep => "sweep",
        }
    }

    /// What such a file is, with its article.
    pub const fn words(self) -> &'static str {
        match self {
            Self::Rig => "a rig",
            Self::Airframe => "an airframe",
            Self::Mission => "a mission",
            Self::Map => "an import map",
            Self::Calibration => "a calibration",
            Self::Tolerances => "a tolerance file",
            Self::Suite => "a suite of tests",
            Self::Sweep => "a plan of a sweep",
        }
    }

    /// What its schema describes, in a line.
    pub const fn title(self) -> &'static str {
        match self {
            Self::Rig => "Rig file: the nominal model of a bench and how it is run",
            Self::Airframe => "Airframe file: one airframe with its hand controller",
            Self::Mission => "Mission file: what to fly, and what makes the flight a success",
            Self::Map => "Import map: which column of a CSV flight log is what, in which unit",
            Self::Calibration => "Calibration file: where the camera stands and how it sees",
            Self::Tolerances => "Tolerance file: what fields of two recordings may differ by",
            Self::Suite => "Suite file: which tests are flown, and what each flight is held to",
            Self::Sweep => "Plan of a sweep: which flights and diagnoses are run, and over what",
        }
    }

    /// Its keys.
    pub fn keys(self) -> Vec<Form> {
        match self {
            Self::Rig => Rig::keys(),
            Self::Airframe => Airframe::keys(),
            Self::Mission => Mission::keys(),
            Self::Map => ImportMap::keys(),
            Self::Calibration => Calibration::keys(),
            Self::Tolerances => tolerance_keys(),
            Self::Suite => suite_keys(),
            Self::Sweep => sweep_keys(),
        }
    }

    /// Its JSON Schema.
    pub fn schema(self) -> Value {
        let mut schema = json::document(self.name(), self.title(), &self.keys());
        if self == Self::Sweep {
            json::name_swept_effects(&mut schema);
        }
        schema
    }

    /// Its page of documentation.
    pub fn page(self) -> String {
        page::page(self)
    }
}
