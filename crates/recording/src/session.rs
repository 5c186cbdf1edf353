use std::{borrow::Cow, collections::BTreeMap, fmt, path::Path, str::FromStr};

use bench_rig::{Mission, Rig};

use crate::RecordingError;

/// Where the records of a recording come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Mode {
    /// A simulation in lockstep.
    Sim,
    /// Hardware in the loop, in real time.
    Hil,
    /// Converted from another format.
    Import,
}

impl Mode {
    /// All modes.
    pub const ALL: [Self; 3] = [Self::Sim, Self::Hil, Self::Import];

    /// The name in recordings and on the screen.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Sim => "sim",
            Self::Hil => "hil",
            Self::Import => "import",
        }
    }
}

impl fmt::Display for Mode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Mode {
    type Err = ();

    fn from_str(name: &str) -> Result<Self, ()> {
        Self::ALL.into_iter().find(|mode| mode.name() == name).ok_or(())
    }
}

/// What is known of a recording before its first message. A simulated session holds nothing that differs between two
/// runs of the same thing: no wall-clock time, no host name.
#[derive(Clone, Debug, PartialEq)]
pub struct Session {
    /// Where the records come from.
    pub mode: Mode,
    /// The rig's name; empty where it is not known.
    pub rig_name: String,
    /// The rig file, attached as `rig.toml`.
    pub rig_toml: Option<String>,
    /// What [`Session::rig_toml`] says, where the writer has it at hand: viewers' scene is made of it, without reading the text
    /// again. `None` in sessions that were read.
    pub rig: Option<Box<Rig>>,
    /// The mission's name; empty where there was none.
    pub mission_name: String,
    /// The mission file, attached as `mission.toml`.
    pub mission_toml: Option<String>,
    /// The seed of a simulation's noise.
    pub seed: Option<u64>,
    /// The recording's origin, ns since 1970 (UTC): log times and time stamps for viewers count from then on. `None`: from zero,
    /// as in simulations, whose bytes repeat.
    pub epoch_unix_ns: Option<u64>,
    /// Anything else, such as the start's wall-clock time and the host of a hardware run.
    pub extra: BTreeMap<String, String>,
}

impl Session {
    /// A session of which nothing else is known.
    pub fn new(mode: Mode) -> Self {
        Self {
            mode,
            rig_name: String::new(),
            rig_toml: None,
            rig: None,
            mission_name: String::new(),
            mission_toml: None,
            seed: None,
            epoch_unix_ns: None,
            extra: BTreeMap::new(),
        }
    }
}

impl Session {
    /// In [`Session::extra`]: the effects that were added to the nominal rig, as `--effect` takes them, with semicolons between. The rig
    /// attached is the nominal one.
    pub const ADDED_EFFECTS: &str = "added_effects";

    /// What is known of a simulated flight before its first record; `added` are effects as `--effect` takes them.
    pub fn simulated(nominal: &Rig, added: &[String], mission: &Mission, seed: u64) -> Self {
        Self {
            seed: Some(seed),
            extra: BTreeMap::from([(Self::ADDED_EFFECTS.to_owned(), added.join("; "))]),
            ..Self::new(Mode::Sim).with_rig(nominal).with_mission(mission)
        }
    }

    /// With a rig: its name, the attached text, and the rig itself.
    #[must_use]
    pub fn with_rig(self, rig: &Rig) -> Self {
        Self {
            rig_name: rig.name.clone(),
            rig_toml: Some(rig.to_toml()),
            rig: Some(Box::new(rig.clone())),
            ..self
        }
    }

    /// With a mission: its name and the attached text.
    #[must_use]
    pub fn with_mission(self, mission: &Mission) -> Self {
        Self { mission_name: mission.name.clone(), mission_toml: Some(mission.to_toml()), ..self }
    }

    /// The rig as it was given, or as it is attached; `None` where neither can be had.
    pub(crate) fn rig(&self) -> Option<Cow<'_, Rig>> {
        match (&self.rig, &self.rig_toml) {
            (Some(rig), _) => Some(Cow::Borrowed(rig)),
            (None, Some(text)) => Rig::read(Path::new(RIG_ATTACHMENT), text).ok().map(Cow::Owned),
            (None, None) => None,
        }
    }
}

/// The latest version of the channels, their messages and the metadata; raised when a reader of the version before would err.
pub(crate) const SCHEMA_VERSION: u32 = 2;
/// That of recordings whose log times count from zero.
const SCHEMA_VERSION_WITHOUT_EPOCH: u32 = 1;

/// Version of the bench that is compiled in.
pub(crate) const BENCH_VERSION: &str = env!("CARGO_PKG_VERSION");

/// The MCAP metadata record of a session.
pub(crate) const SESSION_METADATA: &str = "bench";
/// The MCAP metadata record of [`Session::extra`].
pub(crate) const EXTRA_METADATA: &str = "bench.extra";
/// The MCAP metadata record that closes a recording.
pub(crate) const END_METADATA: &str = "bench.end";

/// Attachment with the rig file.
pub(crate) const RIG_ATTACHMENT: &str = "rig.toml";
/// Attachment with the mission file.
pub(crate) const MISSION_ATTACHMENT: &str = "mission.toml";

/// In [`END_METADATA`]: how many records found the queue full.
pub(crate) const DROPPED: &str = "dropped";
/// In [`END_METADATA`]: present where the recording was made by `recover`.
pub(crate) const RECOVERED: &str = "recovered";

const MODE: &str = "mode";
const SEED: &str = "seed";
const EPOCH: &str = "epoch_unix_ns";
const RIG: &str = "rig";
const MISSION: &str = "mission";
const BENCH: &str = "bench_version";
const SCHEMA: &str = "schema_version";
const PLATFORM: &str = "platform";

/// A session as recorded, and by what.
#[derive(Clone, Debug)]
pub(crate) struct RecordedSession {
    pub session: Session,
    pub schema_version: u32,
    pub bench_version: String,
    pub platform: String,
}

impl Session {
    /// The metadata record [`SESSION_METADATA`].
    pub(crate) fn to_metadata(&self) -> BTreeMap<String, String> {
        let version = self.epoch_unix_ns.map_or(SCHEMA_VERSION_WITHOUT_EPOCH, |_| SCHEMA_VERSION);
        let mut metadata = BTreeMap::from([
            (MODE.to_owned(), self.mode.to_string()),
            (RIG.to_owned(), self.rig_name.clone()),
            (MISSION.to_owned(), self.mission_name.clone()),
            (BENCH.to_owned(), BENCH_VERSION.to_owned()),
            (SCHEMA.to_owned(), version.to_string()),
            (PLATFORM.to_owned(), format!("{}-{}", std::env::consts::ARCH, std::env::consts::OS)),
        ]);
        if let Some(seed) = self.seed {
            metadata.insert(SEED.to_owned(), seed.to_string());
        }
        if let Some(epoch_ns) = self.epoch_unix_ns {
            metadata.insert(EPOCH.to_owned(), epoch_ns.to_string());
        }
        metadata
    }
}

impl RecordedSession {
    /// The inverse of [`Session::to_metadata`], without what other records and the attachments hold.
    pub fn from_metadata(path: &Path, metadata: &BTreeMap<String, String>) -> Result<Self, RecordingError> {
        let text = |key: &str| metadata.get(key).cloned().unwrap_or_default();
        let bad = |key: &'static str, expected: &'static str| RecordingError::BadSession {
            path: path.to_owned(),
            key,
            value: text(key),
            expected,
        };
        let schema_version = text(SCHEMA).parse().map_err(|_| bad(SCHEMA, "a whole number"))?;
        if schema_version > SCHEMA_VERSION {
            return Err(RecordingError::NewerSchema {
                path: path.to_owned(),
                found: schema_version,
                known: SCHEMA_VERSION,
            });
        }
        let mode = text(MODE).parse().map_err(|()| bad(MODE, "sim, hil or import"))?;
        let number = |key: &'static str| match metadata.get(key) {
            Some(number) => number.parse().map(Some).map_err(|_| bad(key, "a whole number")),
            None => Ok(None),
        };
        let (seed, epoch_unix_ns) = (number(SEED)?, number(EPOCH)?);
        Ok(Self {
            session: Session {
                seed,
                epoch_unix_ns,
                rig_name: text(RIG),
                mission_name: text(MISSION),
                ..Session::new(mode)
            },
            schema_version,
            bench_version: text(BENCH),
            platform: text(PLATFORM),
        })
    }
}
