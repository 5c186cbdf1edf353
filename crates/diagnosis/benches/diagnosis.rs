//! How fast ten flights of 30 s with ten frames a second are diagnosed: the whole library with pairs, on all cores.
//!
//! Flights are in memory. An item is a flight. For figures of two cores, pin the process:
//! `taskset -c 0,1 cargo bench -p bench-diagnosis`.

use std::path::Path;

use bench_diagnosis::{Calibration, Diagnosis, Verdict};
use bench_filter::Track;
use bench_inference::Problem;
use bench_plant::effects::parse_effect;
use bench_recording::{Flight, Mode, Record, Session};
use bench_rig::{Mission, Model, PhaseAction, Rig};
use bench_run::simulate;
use divan::{Bencher, counter::ItemsCount};

fn main() {
    divan::main();
}

const FLIGHTS: u64 = 10;
const FLIGHT_S: f64 = 30.0;
const FRAME_PERIOD_S: f64 = 0.1;

fn rigs() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../rigs"))
}

fn rig() -> Rig {
    let mut rig = Rig::load(rigs().join("foreign.toml")).unwrap();
    rig.plant.model = Model::Vertical;
    rig.tracker.frame_period_s = FRAME_PERIOD_S;
    rig
}

/// Flights of steps and of low hover by turns, landings left out, made to last [`FLIGHT_S`].
fn tracks(nominal: &Rig, effect: Option<&str>) -> Vec<Track> {
    let mut real = nominal.clone();
    real.effects.extend(effect.map(|text| parse_effect(text).unwrap()));
    (0..FLIGHTS)
        .map(|seed| {
            let name = if seed % 2 == 0 { "steps" } else { "low-hover" };
            let mut mission =
                Mission::load(rigs().join("missions").join(name).with_extension("toml")).unwrap();
            mission.phases.retain(|phase| !matches!(phase.action, PhaseAction::Land { .. }));
            let planned_s: f64 = mission.phases.iter().map(|phase| phase.duration_s).sum();
            mission.phases.last_mut().unwrap().duration_s += FLIGHT_S - planned_s;
            let mut records: Vec<Record> = Vec::new();
            simulate(&real, &mission, seed, &mut records, |_| true).unwrap();
            let flight = Flight::from_records(Session::new(Mode::Sim), records);
            Track::from_flight(name, &flight, nominal).unwrap()
        })
        .collect()
}

fn diagnose(bencher: Bencher, effect: Option<&str>, expected: Verdict) {
    let rig = rig();
    let tracks = tracks(&rig, effect);
    let calibration = Calibration::built_in();
    // A wrong verdict would be another search, and another time.
    assert_eq!(Diagnosis::of(&Problem::new(&tracks, &rig), &calibration).verdict, expected);
    bencher
        .counter(ItemsCount::new(FLIGHTS))
        .bench_local(|| Diagnosis::of(&Problem::new(&tracks, &rig), &calibration));
}

#[divan::bench(sample_count = 20, sample_size = 1)]
fn without_effect(bencher: Bencher) {
    diagnose(bencher, None, Verdict::None);
}

#[divan::bench(sample_count = 20, sample_size = 1)]
fn with_effect(bencher: Bencher) {
    diagnose(bencher, Some("rotor-lag:time_constant_s=0.1"), Verdict::Effect);
}
