use std::path::PathBuf;

use anyhow::bail;
use bench_campaign::LEAST_SETS;
use bench_diagnosis::Calibration;
use bench_rig::{Mission, Rig};

use super::Missions;
use crate::{files, progress::Progress};

/// Learns from simulated flights, and tells how far it is.
pub fn learn(rig: &Rig, missions: &Missions, sets: usize) -> anyhow::Result<Calibration> {
    if sets < LEAST_SETS {
        bail!("--calibrate {sets}: at least {LEAST_SETS} sets are needed to see a tail of false alarms");
    }
    let progress = Progress::of("calibrate");
    progress.begin("nominal flights", sets as f64, "sets");
    Ok(bench_campaign::learn(rig, &or_usual(missions)?, sets, &|| progress.step())?)
}

fn or_usual(missions: &Missions) -> anyhow::Result<Vec<Mission>> {
    if !missions.0.is_empty() {
        return Ok(missions.0.clone());
    }
    files::missions(&[PathBuf::from(files::BLIND_MISSIONS)])
}
