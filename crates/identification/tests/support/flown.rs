//! Flights of the virtual rig, and of airframes that are a little other.
#![allow(dead_code, reason = "each test needs some of it")]

use std::path::Path;

use bench_filter::Track;
use bench_recording::{Flight, Mode, Record, Session};
use bench_rig::{Mission, Model, Rig};
use bench_run::simulate;

/// Where the rigs are.
pub fn rigs() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs")
}

/// The virtual rig with the vertical model and wide tolerances.
pub fn virtual_rig() -> Rig {
    let mut rig = Rig::load(rigs().join("virtual.toml")).unwrap();
    rig.plant.model = Model::Vertical;
    // Wide, as nobody has been on a balance yet; the mass alone is known.
    let a = &mut rig.airframe;
    a.mass_kg.sigma = 0.0;
    a.thrust.gain_n_per_unit.sigma = 0.08 * a.thrust.gain_n_per_unit.value;
    a.thrust.offset.sigma = 0.08;
    a.drag_n_s_per_m.sigma = 0.008;
    rig.tracker.latency_s.sigma = 0.03;
    rig
}

/// A mission as a rig flies it.
pub fn record(rig: &Rig, mission: &str, seed: u64) -> Flight {
    let mission = Mission::load(rigs().join("missions").join(mission).with_extension("toml")).unwrap();
    let mut records: Vec<Record> = Vec::new();
    simulate(rig, &mission, seed, &mut records, |_| true).unwrap();
    let mut session = Session::new(Mode::Sim);
    session.rig_toml = Some(rig.to_toml());
    Flight::from_records(session, records)
}

/// Flights of a real airframe, whose tracker believes what the prior rig says.
pub fn fly(real: &Rig, seeds: std::ops::Range<u64>, missions: &[&str]) -> Vec<Flight> {
    seeds.map(|seed| record(real, missions[seed as usize % missions.len()], seed)).collect()
}

/// Flights as a rig sees them.
pub fn tracks(flights: &[Flight], rig: &Rig) -> Vec<Track> {
    flights.iter().enumerate().map(|(i, f)| Track::from_flight(&format!("{i}"), f, rig).unwrap()).collect()
}

/// Missions that tell the rig's numbers.
pub const MISSIONS: [&str; 3] = ["steps", "climb-040", "low-hover"];
