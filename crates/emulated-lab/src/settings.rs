use std::{io, path::Path, path::PathBuf};

use bench_plant::effects::parse_effect;
use bench_rig::{Calibration, Rig};
use serde::{Deserialize, Serialize};

/// What there is in the lab: the file `lab.toml`.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// The rig that the lab is like; it must have a calibration.
    pub rig: PathBuf,
    /// Effects that the lab has, and the rig file does not: `NAME:param=value,...`.
    #[serde(default)]
    pub effects: Vec<String>,
    /// Seed of everything random.
    #[serde(default)]
    pub seed: u64,
    /// The board's firmware, built for Linux. With it the airframe flies; without it, the camera shows the reel and there is no board.
    #[serde(default)]
    pub board: Option<PathBuf>,
    /// What the board's throttle output is off by beyond what its memory says, V.
    #[serde(default)]
    pub board_drift_v: f64,
    /// Where to write what really happened in a flight, as CSV.
    #[serde(default)]
    pub truth: Option<PathBuf>,
    /// As long as this file is there, something stands before the airframe, and the camera of a lab that flies does not see it.
    #[serde(default)]
    pub hidden_while: Option<PathBuf>,
    /// What goes wrong between camera and host.
    #[serde(default)]
    pub faults: Faults,
}

/// What goes wrong between camera and host.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct Faults {
    /// Probability that a packet is lost.
    pub loss: f64,
    /// Frames begin later by up to this, s.
    pub jitter_s: f64,
    /// From so many seconds after the streams were started on, nothing comes ...
    pub stall_at_s: f64,
    /// ... for so long, s.
    pub stall_s: f64,
}

impl Settings {
    /// Reads `lab.toml` in a folder.
    pub fn read(folder: &Path) -> io::Result<Self> {
        let path = folder.join("lab.toml");
        let text = std::fs::read_to_string(&path)
            .map_err(|error| io::Error::other(format!("cannot read {}: {error}", path.display())))?;
        toml::from_str(&text).map_err(|error| io::Error::other(format!("{}: {error}", path.display())))
    }

    /// Writes `lab.toml` into a folder.
    pub fn write(&self, folder: &Path) -> io::Result<()> {
        let text = toml::to_string(self).map_err(io::Error::other)?;
        std::fs::write(folder.join("lab.toml"), text)
    }

    /// The rig with the lab's effects.
    pub fn lab_rig(&self) -> io::Result<Rig> {
        let mut rig = Rig::load(&self.rig).map_err(io::Error::other)?;
        for effect in &self.effects {
            rig.effects.push(parse_effect(effect).map_err(io::Error::other)?);
        }
        Ok(rig)
    }
}

/// The camera of a rig.
pub(crate) fn calibration(rig: &Rig) -> io::Result<&Calibration> {
    let missing = || {
        io::Error::other(format!("rig {} has no calibration, so nobody knows what its camera sees", rig.name))
    };
    rig.calibration.as_ref().ok_or_else(missing)
}
