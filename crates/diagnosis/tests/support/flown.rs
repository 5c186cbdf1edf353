//! Flights of the simulator.

use bench_recording::{Flight, Mode, Record, Session};
use bench_rig::Rig;
use bench_run::simulate;

use crate::support::mission;

/// A mission as a rig flies it.
pub fn fly(rig: &Rig, name: &str, seed: u64) -> Flight {
    let mut records: Vec<Record> = Vec::new();
    simulate(rig, &mission(name), seed, &mut records, |_| true).unwrap();
    Flight::from_records(Session::new(Mode::Sim), records)
}
