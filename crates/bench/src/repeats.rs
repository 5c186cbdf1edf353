//! Simulated repeats of what two recordings flew: what their differences may be. Kept in the cache.

use std::{
    fs,
    path::{Path, PathBuf},
};

use bench_recording::{
    Mode, Record, Recording, Session,
    diff::{Derived, Repeats},
};
use bench_rig::{Mission, Rig};
use bench_run::simulate_on;
use rayon::prelude::*;
use sha2::{Digest, Sha256};

/// Changes when simulations or their comparison do, so that what was kept before is not used.
const GENERATION: &str = "bench.repeats/2";
/// How many simulations.
const SIMULATIONS: u64 = 12;
/// Seed of the first of them, far from those that anybody picks.
const FIRST_SEED: u64 = 1 << 44;

/// What tolerances are derived from for two recordings, or why there is nothing to derive them from.
pub fn derived(a: &Path, b: &Path) -> anyhow::Result<Result<Derived, String>> {
    let [a, b] = [nominal(&Recording::open(a)?), nominal(&Recording::open(b)?)];
    let (rig, mission) = match (a, b) {
        (Ok(a), Ok(b)) if a.0.to_toml() != b.0.to_toml() => {
            return Ok(Err(format!("the rigs attached differ ({} and {})", a.0.name, b.0.name)));
        }
        (Ok(a), Ok(b)) if a.1.to_toml() != b.1.to_toml() => {
            return Ok(Err(format!("the missions attached differ ({} and {})", a.1.name, b.1.name)));
        }
        (Ok(a), Ok(_)) => a,
        (Err(why), _) => return Ok(Err(format!("A {why}"))),
        (_, Err(why)) => return Ok(Err(format!("B {why}"))),
    };
    Ok(Ok(of(rig, &mission)))
}

/// What tolerances are derived from for flights of a mission on a rig, which is the nominal one.
pub fn of(rig: Rig, mission: &Mission) -> Derived {
    let repeats = cached(&rig, mission).or_else(|| {
        let repeats = fly(&rig, mission)?;
        keep(&rig, mission, &repeats);
        Some(repeats)
    });
    Derived { mission: mission.name.clone(), rig, repeats }
}

/// The nominal rig and the mission that a recording was made with: effects that were added are what a comparison is to show.
/// Imported flights were made with none.
fn nominal(recording: &Recording) -> Result<(Rig, Mission), String> {
    let session = recording.session();
    if session.mode == Mode::Import {
        return Err("is an imported log".to_owned());
    }
    let (Some(rig), Some(mission)) = (&session.rig_toml, &session.mission_toml) else {
        return Err("has no rig and mission attached".to_owned());
    };
    let mut rig = Rig::read(Path::new("rig.toml"), rig)
        .map_err(|error| format!("has a rig attached that cannot be read: {error}"))?;
    if !session.extra.contains_key(Session::ADDED_EFFECTS) {
        // Recorded by a version that did not tell a rig's own effects from added ones.
        rig.effects.clear();
    }
    let mission = Mission::read(Path::new("mission.toml"), mission)
        .map_err(|error| format!("has a mission attached that cannot be read: {error}"))?;
    Ok((rig, mission))
}

/// `None` where the rig cannot be simulated: its own numbers then stand alone.
fn fly(rig: &Rig, mission: &Mission) -> Option<Repeats> {
    let flights = (0..SIMULATIONS)
        .into_par_iter()
        .map(|repeat| {
            let mut records: Vec<Record> = Vec::new();
            let plant = with_steps_elsewhere(rig, repeat);
            simulate_on(&plant, rig, mission, FIRST_SEED + repeat, &mut records, |_| true).ok()?;
            Some((Session::new(Mode::Sim), records))
        })
        .collect::<Option<Vec<_>>>()?;
    Repeats::of(rig, flights).ok()
}

/// The rig with the output's own steps where they may lie as well: which of two levels a wanted voltage becomes, nobody knows
/// before the readback, and an open loop drifts by it. The places of all repeats are spread evenly over a step.
fn with_steps_elsewhere(rig: &Rig, repeat: u64) -> Rig {
    let mut plant = rig.clone();
    if let Some(step) = rig.output.own_step {
        plant.airframe.sticks.min -= step * (repeat as f64 + 0.5) / SIMULATIONS as f64;
    }
    plant
}

fn cached(rig: &Rig, mission: &Mission) -> Option<Repeats> {
    serde_json::from_slice(&fs::read(path(rig, mission)?).ok()?).ok()
}

/// A cache that cannot be written costs the simulations of the next comparison, nothing else. Whoever reads at the same time
/// finds the whole of a file or none.
fn keep(rig: &Rig, mission: &Mission, repeats: &Repeats) {
    let write = || {
        let path = path(rig, mission)?;
        fs::create_dir_all(path.parent()?).ok()?;
        let partial = path.with_extension(format!("{}.part", std::process::id()));
        fs::write(&partial, serde_json::to_vec(repeats).ok()?).ok()?;
        fs::rename(&partial, &path).ok()
    };
    let _ = write();
}

fn path(rig: &Rig, mission: &Mission) -> Option<PathBuf> {
    let base = std::env::var_os("XDG_CACHE_HOME").map(PathBuf::from).filter(|path| path.is_absolute());
    let base = base.or_else(|| Some(PathBuf::from(std::env::var_os("HOME")?).join(".cache")))?;
    let mut hash = Sha256::new();
    let fields = bench_recording::Channel::ALL.into_iter().flat_map(bench_recording::Channel::fields);
    let fields: Vec<&str> = fields.map(|field| field.name).collect();
    for part in [GENERATION, env!("CARGO_PKG_VERSION"), &fields.join(" "), &rig.to_toml(), &mission.to_toml()]
    {
        hash.update(part.len().to_le_bytes());
        hash.update(part);
    }
    let name = hash.finalize().iter().take(8).fold(0_u64, |name, byte| name << 8 | u64::from(*byte));
    Some(base.join("bench/repeats").join(format!("{name:016x}.json")))
}
