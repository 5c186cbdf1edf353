//! Flights of which only the stretches aloft are predicted.

#[path = "support/flown.rs"]
mod flown;
mod support;

use bench_diagnosis::{Calibration, Diagnosis, Verdict};
use bench_filter::{Track, TrackError};
use bench_inference::Problem;
use bench_plant::effects::parse_effect;
use flown::fly;
use support::rig;

fn diagnose(effect: Option<&str>) -> Diagnosis {
    let nominal = rig();
    let mut real = nominal.clone();
    real.effects.extend(effect.map(|text| parse_effect(text).unwrap()));
    let tracks: Vec<Track> = (1..4)
        .map(|seed| {
            let mut flight = fly(&real, "steps", seed);
            // A floor that gives way, an estimate that wanders there: nothing below is worth anything.
            for position in flight.positions.iter_mut().filter(|p| p.position_m[2] < 0.12) {
                position.position_m[2] = 0.06 + 0.05 * position.arrived_at.seconds().sin();
            }
            Track::from_flight("steps", &flight, &nominal).unwrap().above(0.15, &nominal).unwrap()
        })
        .collect();
    assert!(tracks.iter().flat_map(|t| &t.measurements).all(|s| !(s.counts && s.z_m < 0.15)));
    Diagnosis::of(&Problem::new(&tracks, &nominal), &Calibration::built_in())
}

#[test]
fn what_is_below_neither_raises_an_alarm_nor_hides_an_effect() {
    let nominal = diagnose(None);
    assert_eq!(nominal.verdict, Verdict::None, "{:#?}", &nominal.candidates[..3]);
    let lag = diagnose(Some("rotor-lag:time_constant_s=0.15"));
    assert_eq!(lag.verdict, Verdict::Effect, "{:#?}", &lag.candidates[..3]);
    let like = lag.group.iter().any(|likeness| likeness.like == "rotor-lag");
    assert!(like || lag.effects == ["rotor-lag"], "{:#?}", &lag.candidates[..3]);
}

#[test]
fn a_flight_that_is_never_so_high_is_too_short() {
    let rig = rig();
    let track = Track::from_flight("steps", &fly(&rig, "steps", 1), &rig).unwrap();
    assert!(matches!(track.above(3.0, &rig), Err(TrackError::TooShort { measurements: 0, .. })));
}

#[test]
fn a_log_denser_than_the_frames_is_thinned_and_its_tears_do_not_count() {
    let mut rig = rig();
    rig.tracker.frame_period_s = 0.01;
    rig.tracker.noise_m = 0.0002;
    rig.tracker.resolution_m = 0.0;
    let mut flight = fly(&rig, "steps", 1);
    let torn_s = 15.0;
    for position in flight.positions.iter_mut().filter(|p| p.exposed_at.seconds() > torn_s) {
        position.position_m[2] += 0.05;
    }
    rig.tracker.frame_period_s = 0.1;
    let track = Track::from_flight("torn", &flight, &rig).unwrap();
    let gaps = track.measurements.windows(2).map(|pair| pair[1].exposed_s - pair[0].exposed_s);
    assert!(gaps.into_iter().all(|gap| gap > 0.09));
    let carried: Vec<f64> = track.measurements.iter().filter(|s| s.carried).map(|s| s.exposed_s).collect();
    assert!(!carried.is_empty());
    assert!(carried.iter().any(|time_s| (time_s - torn_s).abs() < 0.2), "{carried:?}");
}
