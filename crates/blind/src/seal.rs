//! Seals: draws cases, flies them into neutral folders, and keeps what they are in a key apart.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicUsize, Ordering},
    },
    time::SystemTime,
};

use bench_recording::{Mode, Options, Recorder, Recording, Session};
use bench_rig::{Mission, Rig};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::{
    BlindError,
    cases::{self, Case, Truth},
    detect,
    hash::{self, Sha},
};

/// Schema of `seal.json`.
pub const SEAL_SCHEMA: &str = "bench.blind-seal/1";
/// Schema of a key.
pub const KEY_SCHEMA: &str = "bench.blind-key/1";
/// The seal's file in its folder.
pub const SEAL_FILE: &str = "seal.json";

/// What is to be sealed.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The rig whose flights are to be diagnosed; effects in it are refused.
    pub rig: Rig,
    /// Flown in turn in every case.
    pub missions: Vec<Mission>,
    /// How many cases, 1 to 9999.
    pub cases: usize,
    /// Everything random follows from it. Whoever knows it can make the key again.
    pub seed: u64,
    /// Also draw the kinds that are kept for a seal whose scores are published.
    pub with_reserved: bool,
}

/// `seal.json`: published before anybody answers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Seal {
    /// [`SEAL_SCHEMA`].
    pub schema: String,
    /// The bench that made it.
    pub bench_version: String,
    /// SHA-256 of the key file's bytes followed by the salt that is in it (as hexadecimal digits).
    pub key_sha256: String,
    /// Names of the missions, one a flight.
    pub missions: Vec<String>,
    /// Every sealed file with its SHA-256, case by case.
    pub files: BTreeMap<String, String>,
}

/// The key: what every case is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Key {
    /// [`KEY_SCHEMA`].
    pub schema: String,
    /// The bench that made it.
    pub bench_version: String,
    /// Makes the seal tell nothing of the key.
    pub salt: String,
    /// The generator's seed.
    pub seed: u64,
    /// Whether kinds kept for a published seal were drawn.
    pub with_reserved: bool,
    /// The rig's name.
    pub rig: String,
    /// Case to truth.
    pub cases: BTreeMap<String, Truth>,
}

impl Seal {
    /// The cases' names.
    pub fn cases(&self) -> BTreeSet<&str> {
        self.files.keys().filter_map(|file| Some(file.split_once('/')?.0)).collect()
    }

    /// A case's recordings in the order in which they were flown, as names inside the sealed folder.
    pub fn flights(&self, case: &str) -> Vec<String> {
        let named = (0..self.missions.len()).map(|i| format!("{case}/{}", flight_file(i)));
        named.filter(|file| self.files.contains_key(file)).collect()
    }
}

impl Plan {
    fn check(&self) -> Result<(), BlindError> {
        let refuse = |detail: String| Err(BlindError::Plan { detail });
        if !self.rig.effects.is_empty() {
            let name = &self.rig.name;
            return refuse(format!("rig {name} has effects; a diagnosis starts from the nominal rig"));
        }
        if !(1..=9999).contains(&self.cases) {
            return refuse(format!("{} cases asked for, expected 1 to 9999", self.cases));
        }
        if self.missions.is_empty() {
            return refuse("there is no mission to fly".to_owned());
        }
        Ok(())
    }
}

/// A name that tells a case's number and nothing else.
fn case_name(index: usize, cases: usize) -> String {
    let digits = cases.to_string().len().max(3);
    format!("case-{:0digits$}", index + 1)
}

/// Draws and flies all cases into `folder`, which must not exist, and writes the key. Calls `each` after each case with
/// how many are done.
pub fn seal(
    plan: &Plan,
    folder: &Path,
    key_file: &Path,
    each: impl Fn(usize) + Sync,
) -> Result<Seal, BlindError> {
    plan.check()?;
    refuse_places(folder, key_file)?;
    fs::create_dir_all(folder).map_err(BlindError::io("create", folder))?;
    let moment = SystemTime::now();
    let done = AtomicUsize::new(0);
    let largest = Mutex::new(vec![0_u64; plan.missions.len()]);
    let drawn = cases::draw(&plan.rig, plan.cases, plan.seed, plan.with_reserved);
    let flown: Vec<(String, Truth)> = drawn
        .into_par_iter()
        .enumerate()
        .map(|(i, case)| {
            let name = case_name(i, plan.cases);
            let (truth, sizes) = fly(plan, &folder.join(&name), case)?;
            let mut largest = largest.lock().unwrap_or_else(PoisonError::into_inner);
            for (largest, size) in largest.iter_mut().zip(sizes) {
                *largest = size.max(*largest);
            }
            each(done.fetch_add(1, Ordering::Relaxed) + 1);
            Ok((name, truth))
        })
        .collect::<Result<_, BlindError>>()?;
    let largest = largest.into_inner().unwrap_or_else(PoisonError::into_inner);

    let names: Vec<_> = flown.iter().map(|(name, _)| name.clone()).collect();
    let files = names
        .par_iter()
        .map(|name| even_out(plan, folder, name, &largest, moment))
        .collect::<Result<Vec<_>, _>>()?;
    let key = Key {
        schema: KEY_SCHEMA.to_owned(),
        bench_version: env!("CARGO_PKG_VERSION").to_owned(),
        salt: hash::of(format!("salt of {}", plan.seed).as_bytes()),
        seed: plan.seed,
        with_reserved: plan.with_reserved,
        rig: plan.rig.name.clone(),
        cases: flown.into_iter().collect(),
    };
    let key_text = json(&key);
    let seal = Seal {
        schema: SEAL_SCHEMA.to_owned(),
        bench_version: key.bench_version.clone(),
        key_sha256: key_hash(key_text.as_bytes(), &key.salt),
        missions: plan.missions.iter().map(|mission| mission.name.clone()).collect(),
        files: files.into_iter().flatten().collect(),
    };
    write(key_file, &key_text)?;
    write(&folder.join(SEAL_FILE), &json(&seal))?;
    Ok(seal)
}

/// SHA-256 of a key file's bytes followed by its salt.
pub(crate) fn key_hash(key: &[u8], salt: &str) -> String {
    Sha::new().and(key).and(salt.as_bytes()).finish()
}

fn refuse_places(folder: &Path, key_file: &Path) -> Result<(), BlindError> {
    for path in [folder, key_file] {
        if path.exists() {
            return Err(BlindError::Exists { path: path.to_owned() });
        }
    }
    let absolute = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    if absolute(key_file).starts_with(absolute(folder)) {
        return Err(BlindError::KeyInside { path: key_file.to_owned() });
    }
    Ok(())
}

fn flight_file(index: usize) -> String {
    format!("flight-{}.mcap", index + 1)
}

/// Flies a case into its folder and returns its truth and how long its files are, bytes.
fn fly(plan: &Plan, folder: &Path, mut case: Case) -> Result<(Truth, Vec<u64>), BlindError> {
    fs::create_dir_all(folder).map_err(BlindError::io("create", folder))?;
    let mut sizes = Vec::new();
    detect::fly_and_watch(&plan.rig, &plan.missions, &mut case, |i, flown| {
        let session = session(plan, &plan.missions[i], "");
        let mut recorder = Recorder::create(folder.join(flight_file(i)), &session, Options::SIMULATION)?;
        for record in &flown.records {
            recorder.record(*record);
        }
        sizes.push(recorder.finish()?.bytes);
        Ok(())
    })?;
    Ok((case.truth, sizes))
}

/// The same for every case: neither seed nor anything that differs from one to another.
fn session(plan: &Plan, mission: &Mission, filling: &str) -> Session {
    Session {
        mission_name: mission.name.clone(),
        mission_toml: Some(mission.to_toml() + filling),
        ..Session::new(Mode::Sim).with_rig(&plan.rig)
    }
}

/// Fills a case's recordings up, so that a flight's file is as long in every case whatever its content compresses to;
/// gives all of its files one time; returns their hashes.
fn even_out(
    plan: &Plan,
    folder: &Path,
    name: &str,
    largest: &[u64],
    moment: SystemTime,
) -> Result<Vec<(String, String)>, BlindError> {
    let own = folder.join(name);
    let mut files = Vec::new();
    for (i, (mission, largest)) in plan.missions.iter().zip(largest).enumerate() {
        let file = flight_file(i);
        fill_up(plan, mission, &own.join(&file), *largest)?;
        files.push(file);
    }
    write(&own.join("rig.toml"), &plan.rig.to_toml())?;
    files.push("rig.toml".to_owned());
    let hashed = |file: String| {
        let path = own.join(&file);
        set_time(&path, moment)?;
        Ok((format!("{name}/{file}"), hash::of_file(&path)?))
    };
    let hashes = files.into_iter().map(hashed).collect();
    set_time(&own, moment)?;
    hashes
}

/// Room for the line that says what the filling is.
const FILLING: &str = "\n# Filled up so that this flight's file is as long in every case:\n#";

fn fill_up(plan: &Plan, mission: &Mission, path: &Path, largest: u64) -> Result<(), BlindError> {
    let size = fs::metadata(path).map_err(BlindError::io("read", path))?.len();
    let missing = (largest - size) as usize;
    let filling = format!("{FILLING}{}\n", ".".repeat(missing));
    let bare: PathBuf = path.with_extension("bare");
    fs::rename(path, &bare).map_err(BlindError::io("rename", path))?;
    let mut recorder = Recorder::create(path, &session(plan, mission, &filling), Options::SIMULATION)?;
    for record in Recording::open(&bare)?.records()? {
        recorder.record(record?);
    }
    recorder.finish()?;
    fs::remove_file(&bare).map_err(BlindError::io("remove", &bare))
}

fn set_time(path: &Path, moment: SystemTime) -> Result<(), BlindError> {
    let file = fs::File::open(path).map_err(BlindError::io("open", path))?;
    file.set_modified(moment).map_err(BlindError::io("set the time of", path))
}

pub(crate) fn json(value: &impl Serialize) -> String {
    // Plain structs of text, numbers and maps with text for keys always have a JSON form.
    serde_json::to_string_pretty(value).unwrap_or_default() + "\n"
}

pub(crate) fn write(path: &Path, text: &str) -> Result<(), BlindError> {
    if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        fs::create_dir_all(folder).map_err(BlindError::io("create", folder))?;
    }
    fs::write(path, text).map_err(BlindError::io("write", path))
}
