//! More flights tell more, and what a model leaves out grows with them: neither is to lead a diagnosis astray.

#[path = "support/flown.rs"]
mod flown;
mod support;

use bench_diagnosis::{Calibration, Diagnosis, Verdict};
use bench_filter::Track;
use bench_inference::Problem;
use bench_plant::effects::parse_effect;
use bench_rig::Rig;
use flown::fly;
use support::rig;

const MISSIONS: [&str; 7] = [
    "blind/1-hop-high",
    "blind/2-hop-low",
    "blind/4-climb-080",
    "blind/5-steps",
    "blind/6-low",
    "blind/7-chirp",
    "blind/8-drops",
];

/// So many flights of the missions in turn, as flown by one rig and diagnosed on another.
fn diagnosed(real: &Rig, nominal: &Rig, flights: u64) -> Diagnosis {
    let tracks: Vec<Track> = (0..flights)
        .map(|seed| {
            let name = MISSIONS[seed as usize % MISSIONS.len()];
            Track::from_flight(name, &fly(real, name, 1 + seed), nominal).unwrap()
        })
        .collect();
    Diagnosis::of(&Problem::new(&tracks, nominal), &Calibration::built_in())
}

#[test]
fn many_flights_without_an_effect_raise_no_alarm() {
    let rig = rig();
    let mut real = rig.clone();
    real.effects.push(parse_effect("gusts:sigma_m_s=0.01,correlation_time_s=0.8").unwrap());
    let diagnosis = diagnosed(&real, &rig, 70);
    assert_eq!(diagnosis.verdict, Verdict::None, "{:#?}", &diagnosis.candidates[..3]);
}

#[test]
fn a_plain_effect_is_named_from_however_many_flights() {
    let mut rig = rig();
    rig.tracker.frame_period_s = 0.1;
    let mut real = rig.clone();
    real.effects.push(parse_effect("rotor-lag:time_constant_s=0.1").unwrap());
    for flights in [18, 60] {
        let diagnosis = diagnosed(&real, &rig, flights);
        assert_eq!(diagnosis.effects, ["rotor-lag"], "{flights} flights: {:#?}", &diagnosis.candidates[..3]);
    }
}
