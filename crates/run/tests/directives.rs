//! What who watches a flight asks of it.

use std::path::{Path, PathBuf};

use bench_recording::Record;
use bench_rig::{Mission, Phase, Rig};
use bench_run::{Directive, Ending, Flown, StopReason, simulate};

fn rigs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs")
}

fn fly(mission: &str, mut asked: impl FnMut(f64) -> Directive) -> (Flown, Vec<Record>) {
    let rig = Rig::load(rigs().join("virtual.toml")).unwrap();
    let mission = Mission::load(rigs().join("missions").join(mission)).unwrap();
    let mut records = Vec::new();
    let flown = simulate(&rig, &mission, 3, &mut records, |progress| asked(progress.now.seconds())).unwrap();
    (flown, records)
}

/// Asks once, at the first iteration from `at_s` on.
fn once(at_s: f64, directive: Directive) -> impl FnMut(f64) -> Directive {
    let mut asked = false;
    move |now_s| {
        let now = now_s >= at_s && !std::mem::replace(&mut asked, now_s >= at_s);
        if now { directive } else { Directive::GoOn }
    }
}

/// Set-points of holds: time, s, and altitude, m.
fn held(records: &[Record]) -> Vec<(f64, f64)> {
    let states = records.iter().filter_map(|record| match record {
        Record::ControlState(state) if state.phase == Phase::Hold => Some(state),
        _ => None,
    });
    states.map(|state| (state.time.seconds(), state.setpoint_m[2])).collect()
}

fn events(records: &[Record]) -> Vec<&str> {
    records
        .iter()
        .filter_map(|r| if let Record::Event(event) = r { Some(event.text.as_str()) } else { None })
        .collect()
}

#[test]
fn an_altitude_is_flown_from_the_next_iteration_on_and_recorded() {
    let (flown, records) = fly("climb-040.toml", once(8.0, Directive::FlyAt(0.9)));
    assert_eq!(flown.ending, Ending::Complete);
    for (time_s, altitude_m) in held(&records) {
        let wanted_m = if time_s < 8.05 { 0.4 } else { 0.9 };
        assert!((altitude_m - wanted_m).abs() < 1e-12, "{altitude_m} m at {time_s} s");
    }
    let before_landing = records.iter().rev().find_map(|record| match record {
        Record::Truth(truth) if truth.time.seconds() < 18.6 => Some(truth.position_m[2]),
        _ => None,
    });
    assert!((before_landing.unwrap() - 0.9).abs() < 0.05, "{before_landing:?}");
    assert!(events(&records).contains(&"asked to hold 0.900 m"));
    let summary = flown.summary;
    assert!(summary.rms_error_m.unwrap() < 0.02 && summary.peak_m.unwrap() < 1.05, "{summary:?}");
}

#[test]
fn the_highest_altitude_of_the_envelope_is_reached_without_the_ceiling() {
    let (flown, _) = fly("climb-040.toml", once(2.0, Directive::FlyAt(1.6)));
    assert_eq!(flown.ending, Ending::Complete);
    assert!(flown.summary.peak_m.unwrap() > 1.55);
}

#[test]
fn what_the_mission_has_ahead_is_shifted_along_and_kept_within_the_envelope() {
    let (_, as_planned) = fly("steps.toml", |_| Directive::GoOn);
    let first_s = held(&as_planned)[0].0;
    let (_, shifted) = fly("steps.toml", once(0.2, Directive::FlyAt(held(&as_planned)[0].1 + 1.0)));
    assert_eq!(held(&as_planned).len(), held(&shifted).len());
    let mut limited = 0;
    for ((time_s, planned_m), (_, flown_m)) in held(&as_planned).into_iter().zip(held(&shifted)) {
        assert!((flown_m - (planned_m + 1.0).min(1.6)).abs() < 1e-9, "{flown_m} m at {time_s} s");
        limited += usize::from(planned_m + 1.0 > 1.6);
    }
    assert!(limited > 0 && first_s > 1.0);
}

#[test]
fn what_cannot_be_flown_is_refused_and_told() {
    for (at_s, altitude_m, words) in [
        (5.0, 1.7, "outside of the rig's 0.05 to 1.60 m"),
        (5.0, f64::NAN, "outside"),
        (21.0, 0.5, "holds no altitude"),
    ] {
        let (flown, records) = fly("climb-040.toml", once(at_s, Directive::FlyAt(altitude_m)));
        assert_eq!(flown.ending, Ending::Complete);
        assert!(held(&records).iter().all(|(_, held_m)| *held_m == 0.4));
        let told = events(&records);
        assert!(told.iter().any(|text| text.contains("refused") && text.contains(words)), "{told:?}");
    }
}

#[test]
fn a_press_of_stop_rests_the_throttle_in_the_next_iteration() {
    let (flown, records) = fly("climb-040.toml", once(5.0, Directive::Stop(StopReason::Pressed)));
    assert_eq!(flown.ending, Ending::Stopped(StopReason::Pressed));
    let commands: Vec<_> = records
        .iter()
        .filter_map(|record| if let Record::Command(command) = record { Some(*command) } else { None })
        .collect();
    let rest = commands[0].sticks.throttle;
    for command in &commands {
        let time_s = command.time.seconds();
        let rests = !(0.95..5.05).contains(&time_s);
        assert_eq!(command.sticks.throttle == rest, rests, "at {time_s} s");
    }
}
