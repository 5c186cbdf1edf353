//! What is told of a recorded flight is what was told as it flew.

use std::path::Path;

use bench_recording::{Flight, Mode, Record, Session};
use bench_rig::{Mission, Rig};
use bench_run::{Summary, simulate};

#[test]
fn the_figures_of_a_recording_are_those_of_the_flight() {
    let rigs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs");
    for (rig, mission) in [("virtual", "climb-040"), ("virtual", "hop"), ("loopback", "steps")] {
        let rig = Rig::load(rigs.join(format!("{rig}.toml"))).unwrap();
        let mission = Mission::load(rigs.join(format!("missions/{mission}.toml"))).unwrap();
        let mut records: Vec<Record> = Vec::new();
        let flown = simulate(&rig, &mission, 1, &mut records, |_| true).unwrap();
        let flight = Flight::from_records(Session::new(Mode::Sim), records);
        assert_eq!(
            Summary::of_flight(&flight, mission.criteria.settle_band_m),
            flown.summary,
            "{}",
            mission.name
        );
    }
}

#[test]
fn a_log_without_a_loop_has_the_figures_that_positions_tell() {
    let session = Session::new(Mode::Import);
    let summary = Summary::of_flight(&Flight::from_records(session, []), None);
    assert_eq!(summary, Summary::default());
}
