//! A diagnosis' calibration for one rig and its missions, learnt from simulated flights and kept in the cache.

#[cfg(feature = "studies")]
mod learn;

use std::{
    fs,
    path::{Path, PathBuf},
};

use anyhow::{Context, bail};
use bench_diagnosis::Calibration;
use bench_rig::{Mission, Rig};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::files;
#[cfg(feature = "studies")]
use learn::learn;

/// Changes when the diagnosis does, so that what it learnt before is not used.
const GENERATION: u32 = 12;

/// The missions that recordings carry. Flights without one (imported logs) are stood for by the others, or by the missions of
/// the blind check.
#[derive(Default)]
pub struct Missions(pub Vec<Mission>);

impl Missions {
    /// Each once.
    pub fn distinct(&self) -> Vec<Mission> {
        let mut distinct: Vec<Mission> = Vec::new();
        for mission in &self.0 {
            if !distinct.contains(mission) {
                distinct.push(mission.clone());
            }
        }
        distinct
    }

    fn text(&self) -> String {
        self.0.iter().map(Mission::to_toml).collect::<Vec<_>>().join("\n")
    }
}

/// `--calibration`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Wanted {
    /// The same everywhere.
    BuiltIn,
    /// What this machine learnt of the rig and the missions, if it did.
    Auto,
    /// What was learnt and written to a file.
    File(PathBuf),
}

impl From<&str> for Wanted {
    fn from(text: &str) -> Self {
        match text {
            "built-in" => Self::BuiltIn,
            "auto" => Self::Auto,
            file => Self::File(file.into()),
        }
    }
}

/// Which calibration was used, and why.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Choice {
    /// `built-in`, `learnt` (just now), `cache` or `file`.
    pub how: &'static str,
    /// In words.
    pub why: String,
    /// What gives the same answer on another machine, in words.
    pub again: String,
}

/// A calibration that was learnt, as it is kept: `bench.calibration/1`.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Kept {
    schema: String,
    /// Of the diagnosis that learnt it.
    generation: u32,
    /// Name of the rig.
    rig: String,
    rig_sha256: String,
    /// Names of the missions that were flown.
    missions: Vec<String>,
    missions_sha256: String,
    calibration: Calibration,
}

const SCHEMA: &str = "bench.calibration/1";

impl Kept {
    fn new(calibration: Calibration, rig: &Rig, missions: &Missions) -> Self {
        Self {
            schema: SCHEMA.to_owned(),
            generation: GENERATION,
            rig: rig.name.clone(),
            rig_sha256: sha256(&rig.to_toml()),
            missions: missions.distinct().into_iter().map(|mission| mission.name).collect(),
            missions_sha256: sha256(&missions.text()),
            calibration,
        }
    }

    fn read(path: &Path) -> anyhow::Result<Self> {
        let text = fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
        let advice = "`bench diagnose --calibrate --write-calibration FILE` writes one";
        let kept: Self = serde_json::from_str(&text)
            .with_context(|| format!("{} is no calibration, or a damaged one; {advice}", path.display()))?;
        if kept.schema != SCHEMA {
            bail!("{}: schema {:?}, expected {SCHEMA:?}; {advice}", path.display(), kept.schema);
        }
        if kept.generation != GENERATION {
            bail!(
                "{} was learnt by another version of the diagnosis ({}, this is {GENERATION}); {advice}",
                path.display(),
                kept.generation
            );
        }
        if !kept.calibration.is_sound() {
            bail!(
                "{} is damaged: a share is not from 0 to 1, or a weight no number; {advice}",
                path.display()
            );
        }
        Ok(kept)
    }

    /// Writes it as `--calibration FILE` takes it.
    pub fn write(&self, path: &Path) -> anyhow::Result<()> {
        files::write_and_say(path, &(serde_json::to_string_pretty(self)? + "\n"))
    }
}

fn sha256(text: &str) -> String {
    use std::fmt::Write as _;
    Sha256::digest(text.as_bytes()).iter().fold(String::new(), |mut out, byte| {
        // Writing to a String cannot fail.
        let _ = write!(out, "{byte:02x}");
        out
    })
}

fn path(rig: &Rig, missions: &Missions) -> Option<PathBuf> {
    let base = std::env::var_os("XDG_CACHE_HOME").map(PathBuf::from).filter(|path| path.is_absolute());
    let base = base.or_else(|| Some(PathBuf::from(std::env::var_os("HOME")?).join(".cache")))?;
    let of = sha256(&format!("{GENERATION}\n{}\n{}", rig.to_toml(), missions.text()));
    Some(base.join("bench/calibration").join(format!("{}.json", &of[..16])))
}

/// What makes probabilities, how it was chosen, and what should be known of it.
pub struct Chosen {
    pub calibration: Calibration,
    pub choice: Choice,
    pub warning: Option<String>,
    /// What was learnt, now or before; `None`: built in.
    pub kept: Option<Kept>,
}

const BUILT_IN_AGAIN: &str = "--calibration built-in, which is the same everywhere";
const WRITE_IT: &str = "--write-calibration FILE here, --calibration FILE there";

impl Chosen {
    fn built_in(why: String, warning: Option<String>) -> Self {
        let choice = Choice { how: "built-in", why, again: BUILT_IN_AGAIN.to_owned() };
        Self { calibration: Calibration::built_in(), choice, warning, kept: None }
    }

    fn kept(kept: Kept, how: &'static str, why: String, warning: Option<String>) -> Self {
        let choice = Choice { how, why, again: WRITE_IT.to_owned() };
        Self { calibration: kept.calibration.clone(), choice, warning, kept: Some(kept) }
    }
}

/// The calibration that is wanted for a rig and its missions.
pub fn choose(wanted: &Wanted, rig: &Rig, missions: &Missions) -> anyhow::Result<Chosen> {
    choose_from(wanted, path(rig, missions).filter(|path| path.exists()), rig, missions)
}

fn choose_from(
    wanted: &Wanted,
    cached: Option<PathBuf>,
    rig: &Rig,
    missions: &Missions,
) -> anyhow::Result<Chosen> {
    match (wanted, cached) {
        (Wanted::File(file), _) => {
            let kept = Kept::read(file)?;
            if kept.rig_sha256 != sha256(&rig.to_toml()) {
                bail!(
                    "{} was learnt for a rig {}, which is not like the rig {} of this diagnosis in all numbers: its probabilities do not hold here; calibrate for this rig, or use --calibration built-in",
                    file.display(),
                    kept.rig,
                    rig.name
                );
            }
            let warning = (kept.missions_sha256 != sha256(&missions.text())).then(|| {
                format!(
                    "the calibration {} was learnt on other missions ({}) than these flights'",
                    file.display(),
                    kept.missions.join(", ")
                )
            });
            Ok(Chosen::kept(kept, "file", format!("{} was asked for", file.display()), warning))
        }
        (Wanted::BuiltIn, None) => Ok(Chosen::built_in("it is the default".to_owned(), None)),
        (Wanted::BuiltIn, Some(_)) => Ok(Chosen::built_in(
            "it is the default; this machine has learnt one for this rig and these missions, which --calibration auto uses".to_owned(),
            None,
        )),
        (Wanted::Auto, None) => Ok(Chosen::built_in(
            "auto: this machine has learnt none for this rig and these missions".to_owned(),
            None,
        )),
        (Wanted::Auto, Some(path)) => Ok(match Kept::read(&path) {
            Ok(kept) => Chosen::kept(
                kept,
                "cache",
                "auto: this machine has learnt it for this rig and these missions".to_owned(),
                None,
            ),
            Err(error) => Chosen::built_in(
                "auto: what this machine has learnt cannot be used".to_owned(),
                Some(format!("the calibration in the cache is not used: {}", crate::words::causes(&error))),
            ),
        }),
    }
}

/// Learns a calibration for a rig and its missions, and keeps it.
pub fn learnt(rig: &Rig, missions: &Missions, sets: usize) -> anyhow::Result<Chosen> {
    let kept = Kept::new(learn(rig, missions, sets)?, rig, missions);
    if let Some(path) = path(rig, missions) {
        let folder = path.parent().context("the cache has no folder")?;
        fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        fs::write(&path, serde_json::to_vec_pretty(&kept)?)
            .with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(Chosen::kept(kept, "learnt", "--calibrate has just learnt it".to_owned(), None))
}

#[cfg(not(feature = "studies"))]
fn learn(_: &Rig, _: &Missions, _: usize) -> anyhow::Result<Calibration> {
    Err(crate::left_out::left_out("what --calibrate learns from", "studies"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn learnt(rig: &Rig) -> Kept {
        let calibration = Calibration::built_in().with_margins(vec![0.5; 60], "a test".to_owned());
        Kept::new(calibration, rig, &Missions::default())
    }

    #[test]
    fn a_calibration_is_used_where_it_is_asked_for_and_holds() {
        let scratch = tempfile::tempdir().unwrap();
        let file = scratch.path().join("learnt.json");
        let rig = files::rig(Path::new("virtual")).unwrap();
        let kept = learnt(&rig);
        kept.write(&file).unwrap();
        let chosen = |wanted: &str, cached: Option<&Path>, rig: &Rig| {
            choose_from(&wanted.into(), cached.map(Path::to_owned), rig, &Missions::default())
        };
        let how = |wanted, cached| chosen(wanted, cached, &rig).map(|chosen| chosen.choice.how).unwrap();
        // What a machine has learnt changes nothing unasked.
        assert_eq!(how("built-in", Some(file.as_path())), "built-in");
        assert_eq!(how("auto", None), "built-in");
        assert_eq!(how("auto", Some(file.as_path())), "cache");
        let named = chosen(file.to_str().unwrap(), None, &rig).unwrap();
        assert_eq!((named.choice.how, &named.calibration), ("file", &kept.calibration));
        assert!(named.warning.is_none());

        // Other missions are a warning, another rig is an error.
        let hop = Mission::load(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs/missions/hop.toml"))
            .unwrap();
        let other = choose_from(&Wanted::File(file.clone()), None, &rig, &Missions(vec![hop])).unwrap();
        assert!(other.warning.unwrap().contains("other missions"));
        let foreign = chosen(file.to_str().unwrap(), None, &files::rig(Path::new("foreign")).unwrap());
        let words = format!("{:#}", foreign.err().unwrap());
        assert!(words.contains("was learnt for a rig virtual"), "{words}");

        // A damaged one: told where it is named, and where it lies in the cache not used.
        let text = fs::read_to_string(&file).unwrap();
        for damaged in [
            text[..text.len() / 2].to_owned(),
            text.replace("\"doubt\": ", "\"doubt\": 7"),
            text.replace("\"generation\": ", "\"generation\": 9"),
            "{}".to_owned(),
        ] {
            fs::write(&file, &damaged).unwrap();
            assert!(chosen(file.to_str().unwrap(), None, &rig).is_err(), "{damaged}");
            let cached = chosen("auto", Some(file.as_path()), &rig).unwrap();
            assert_eq!(cached.choice.how, "built-in");
            assert!(cached.warning.unwrap().contains("is not used"));
        }
    }
}
