//! A diagnosis' calibration for one rig and its missions, learnt from simulated flights and kept in the cache.

mod causes;

use std::{fs, path::PathBuf};

use anyhow::{Context, bail};
use bench_diagnosis::{Calibration, Outcome, Problem, Track, Verdict, alarm_margin, verdict};
use bench_recording::{Flight, Mode, Record, Session};
use bench_rig::{EffectEntry, Location, Mission, Model, Rig, Uncertain};
use bench_run::simulate;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use rayon::prelude::*;
use sha2::{Digest, Sha256};

use crate::{files, progress::Progress};

/// Changes when the diagnosis does, so that what it learnt before is not used.
const GENERATION: &str = "bench.calibration/9";
/// Fewest sets that show a tail of false alarms.
const LEAST_SETS: usize = 50;
/// Sets with causes for each nominal one.
const WITH_CAUSES: usize = 3;
/// Seed of the first of them, far from those of the nominal ones.
const FIRST_WITH_CAUSES: u64 = 1 << 40;
/// Ordinary turbulence, m/s: drawn evenly in the logarithm.
const TURBULENCE_M_S: (f64, f64) = (0.008, 0.06);

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

    fn or_usual(&self) -> anyhow::Result<Vec<Mission>> {
        if !self.0.is_empty() {
            return Ok(self.0.clone());
        }
        files::missions(&[PathBuf::from(files::BLIND_MISSIONS)])
    }

    fn text(&self) -> String {
        self.0.iter().map(Mission::to_toml).collect::<Vec<_>>().join("\n")
    }
}

fn path(rig: &Rig, missions: &Missions) -> Option<PathBuf> {
    let base = std::env::var_os("XDG_CACHE_HOME").map(PathBuf::from).filter(|path| path.is_absolute());
    let base = base.or_else(|| Some(PathBuf::from(std::env::var_os("HOME")?).join(".cache")))?;
    let mut hash = Sha256::new();
    for part in [GENERATION, &rig.to_toml(), &missions.text()] {
        hash.update(part.len().to_le_bytes());
        hash.update(part);
    }
    let name = hash.finalize().iter().take(8).fold(0_u64, |name, byte| name << 8 | u64::from(*byte));
    Some(base.join("bench/calibration").join(format!("{name:016x}.json")))
}

/// What was learnt before for this rig and these missions.
pub fn cached(rig: &Rig, missions: &Missions) -> Option<Calibration> {
    serde_json::from_slice(&fs::read(path(rig, missions)?).ok()?).ok()
}

/// Flies nominal flights within the rig's tolerances and sees how near each set comes to a false alarm, then flights with causes
/// of the library and sees how often each kind of verdict is right. Keeps what that teaches.
pub fn learn(rig: &Rig, missions: &Missions, sets: usize) -> anyhow::Result<Calibration> {
    if sets < LEAST_SETS {
        bail!("--calibrate {sets}: at least {LEAST_SETS} sets are needed to see a tail of false alarms");
    }
    let flown = missions.or_usual()?;
    let progress = Progress::of("calibrate");
    progress.begin("nominal flights", ((1 + WITH_CAUSES) * sets) as f64, "sets");
    let built_in = Calibration::built_in();
    let margins = (0..sets as u64)
        .into_par_iter()
        .map(|set| {
            let tracks = tracks(&drawn(rig, set), rig, &flown, set)?;
            if tracks.is_empty() {
                bail!("none of the missions' simulated flights can be diagnosed on this rig");
            }
            let margin = alarm_margin(&Problem::new(&tracks, rig), &built_in);
            progress.step();
            Ok(margin)
        })
        .collect::<anyhow::Result<Vec<f64>>>()?;
    let learnt = built_in.with_margins(margins, format!("calibrated for rig {}", rig.name));
    progress.doing("flights with causes");
    let untold = learnt.untold();
    let outcomes = causes::planned(rig, WITH_CAUSES * sets)
        .into_par_iter()
        .enumerate()
        .map(|(case, causes)| {
            let set = FIRST_WITH_CAUSES + case as u64;
            let mut real = rig.clone();
            real.effects.extend(causes.iter().cloned());
            let tracks = tracks(&drawn(&real, set), rig, &flown, set)?;
            // A case of which there is no flight tells nothing.
            let outcome = (!tracks.is_empty()).then(|| {
                let told = verdict(&Problem::new(&tracks, rig), &untold);
                let named = |cause: &EffectEntry| told.effects.contains(&cause.name.as_str());
                let right = told.verdict != Verdict::Unknown
                    && told.effects.len() == causes.len()
                    && causes.iter().all(named);
                Outcome { told, right }
            });
            progress.step();
            Ok(outcome)
        })
        .collect::<anyhow::Result<Vec<Option<Outcome>>>>()?;
    drop(progress);
    let outcomes: Vec<Outcome> = outcomes.into_iter().flatten().collect();
    if outcomes.is_empty() {
        bail!(
            "none of the missions' simulated flights with an effect or without can be diagnosed on this rig"
        );
    }
    let learnt = learnt.with_outcomes(&outcomes);
    if let Some(path) = path(rig, missions) {
        let folder = path.parent().context("the cache has no folder")?;
        fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        fs::write(&path, serde_json::to_vec_pretty(&learnt)?)
            .with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(learnt)
}

/// A set of flights of a rig as another one sees them. A flight that tells nothing is left out, as of real ones.
fn tracks(real: &Rig, rig: &Rig, flown: &[Mission], set: u64) -> anyhow::Result<Vec<Track>> {
    let mut tracks = Vec::new();
    for (index, mission) in flown.iter().enumerate() {
        let mut records: Vec<Record> = Vec::new();
        simulate(real, mission, set * 1000 + index as u64, &mut records, |_| true)?;
        let flight = Flight::from_records(Session::new(Mode::Sim), records);
        tracks.extend(Track::from_flight(&mission.name, &flight, rig));
    }
    Ok(tracks)
}

/// An airframe within the rig's tolerances in ordinary air.
fn drawn(rig: &Rig, set: u64) -> Rig {
    let mut rng = ChaCha8Rng::seed_from_u64(set);
    let mut rig = rig.clone();
    // Vertical flights tell altitude alone, and that is what is diagnosed.
    rig.plant.model = Model::Vertical;
    let mut draw = |number: &mut Uncertain| {
        let sigmas: f64 = rng.sample(StandardNormal);
        number.value += number.sigma * sigmas.clamp(-2.5, 2.5);
    };
    let a = &mut rig.airframe;
    draw(&mut a.mass_kg);
    draw(&mut a.thrust.gain_n_per_unit);
    draw(&mut a.thrust.offset);
    draw(&mut a.ground_effect.multiplier);
    draw(&mut a.ground_effect.height_m);
    draw(&mut a.drag_n_s_per_m);
    draw(&mut rig.tracker.latency_s);
    let (low, high) = TURBULENCE_M_S;
    let sigma_m_s = log_uniform(&mut rng, low, high);
    if rig.effects.iter().all(|effect| effect.name != "gusts") {
        rig.effects.push(EffectEntry {
            name: "gusts".to_owned(),
            parameters: vec![
                ("sigma_m_s".to_owned(), sigma_m_s, 0),
                ("correlation_time_s".to_owned(), 0.3 + 1.2 * rng.random::<f64>(), 0),
            ],
            at: Location { file: "calibration".into(), line: 0 },
        });
    }
    rig
}

fn log_uniform(rng: &mut impl Rng, low: f64, high: f64) -> f64 {
    low * (high / low).powf(rng.random::<f64>())
}
