//! Flights through outputs that the simulator does not have.

use bench_device::VoltageOutput;
use bench_filter::Track;
use bench_plant::lab::{Lab, SharedWorld, SimulatedOutput};
use bench_recording::{Flight, Mode, Record, Session};
use bench_rig::Rig;

use crate::support::mission;

/// A mission as one rig flies it through an output, and another sees it.
pub fn track_through<V: VoltageOutput>(
    flown: &Rig,
    seen_by: &Rig,
    name: &str,
    seed: u64,
    through: impl FnOnce(SimulatedOutput, SharedWorld) -> V,
) -> Track {
    let Lab { mut clock, output, mut tracker, world } = Lab::new(flown, seed).unwrap();
    let mut records: Vec<Record> = Vec::new();
    let ends = (&mut clock, &mut through(output, world), &mut tracker);
    bench_run::fly(ends, seen_by, &mission(name), &mut records, |_, _| true);
    let flight = Flight::from_records(Session::new(Mode::Sim), records);
    Track::from_flight(name, &flight, seen_by).unwrap()
}
