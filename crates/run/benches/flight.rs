//! How fast the virtual bench flies: 20 s in closed loop, recorded and in memory, and the physics step alone.
//!
//! In `recorded` and `in_memory` an item is one second of flight, so items a second read as times real time; in `step` an
//! item is one integration step. A recorded flight includes making the file, writing it on the recorder's own thread, waiting for
//! that thread, and closing the file. For figures of one core, pin the process: `taskset -c 1 cargo bench -p bench-run`.

use std::{fs, hint::black_box, path::Path};

use bench_device::Sticks;
use bench_plant::{
    body::Body,
    effects::Effects,
    nominal::{Forces, Nominal},
};
use bench_recording::{Mode, Options, Record, Recorder, Session};
use bench_rig::{Mission, Model, PhaseAction, Rig};
use bench_run::{Ending, Sink, simulate};
use divan::{Bencher, counter::ItemsCount};
use tempfile::tempdir;

fn main() {
    divan::main();
}

const MODELS: [Model; 2] = [Model::Vertical, Model::SixDegree];

/// From the first tick to the last, s.
const FLIGHT_S: f64 = 20.0;

fn rig(model: Model) -> Rig {
    let mut rig = Rig::load(rigs().join("virtual.toml")).unwrap();
    rig.plant.model = model;
    rig
}

/// The climb to 0.4 m without its landing, held until the loop has run for [`FLIGHT_S`].
fn mission(rig: &Rig) -> Mission {
    let mut mission = Mission::load(rigs().join("missions/climb-040.toml")).unwrap();
    mission.phases.retain(|phase| !matches!(phase.action, PhaseAction::Land { .. }));
    let flown_s = simulate(rig, &mission, 0, &mut Vec::new(), |_| true).unwrap().summary.duration_s;
    mission.phases.last_mut().unwrap().duration_s += FLIGHT_S - flown_s;
    mission
}

fn rigs() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../rigs"))
}

fn fly(rig: &Rig, mission: &Mission, sink: &mut impl Sink) {
    let flown = simulate(rig, mission, 0, sink, |_| true).unwrap();
    assert_eq!(flown.ending, Ending::Complete);
    assert!((flown.summary.duration_s - FLIGHT_S).abs() < 1e-6);
}

/// To a new file in the system's folder for temporary files, with the options and the session of `bench sim`.
#[divan::bench(args = MODELS, sample_count = 200)]
fn recorded(bencher: Bencher, model: Model) {
    let (rig, folder) = (rig(model), tempdir().unwrap());
    let mission = mission(&rig);
    let session = Session { seed: Some(0), ..Session::new(Mode::Sim).with_rig(&rig).with_mission(&mission) };
    let path = folder.path().join("flight.mcap");
    // A new file each time: to empty that of the flight before would be a part of no flight.
    let new_file = || drop(fs::remove_file(&path));
    bencher.counter(ItemsCount::new(FLIGHT_S as u64)).with_inputs(new_file).bench_local_values(|()| {
        let mut recorder = Recorder::create(&path, &session, Options::SIMULATION).unwrap();
        fly(&rig, &mission, &mut recorder);
        recorder.finish().unwrap()
    });
}

/// To a list of records.
#[divan::bench(args = MODELS, sample_count = 200)]
fn in_memory(bencher: Bencher, model: Model) {
    let rig = rig(model);
    let mission = mission(&rig);
    let mut records: Vec<Record> = Vec::new();
    bencher.counter(ItemsCount::new(FLIGHT_S as u64)).bench_local(|| {
        records.clear();
        fly(&rig, &mission, &mut records);
    });
}

/// Steps of 1 ms in free flight, a little above hover with every stick off its centre.
#[divan::bench(args = MODELS, sample_count = 200)]
fn step(bencher: Bencher, model: Model) {
    const STEPS: u32 = 10_000;
    let airframe = rig(model).airframe;
    let (nominal, effects) = (Nominal::new(&airframe), Effects::default());
    let sticks = Sticks { throttle: 1.95, pitch: 1.7, roll: 1.6, yaw: 1.7 };
    let forces = Forces {
        nominal: &nominal,
        effects: &effects,
        free_thrust_n: nominal.free_thrust_n(sticks.throttle),
        mass_kg: nominal.mass_kg,
    };
    bencher.counter(ItemsCount::new(STEPS)).bench_local(|| {
        let mut body = Body::at_rest(model, &airframe);
        for _ in 0..STEPS {
            body.step(0.001, &forces, black_box(sticks));
        }
        body
    });
}
