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

/// Phases in their order, each with the time of its first iteration, s.
fn phases(records: &[Record]) -> Vec<(Phase, f64)> {
    let mut phases: Vec<(Phase, f64)> = Vec::new();
    for record in records {
        if let Record::ControlState(state) = record
            && phases.last().is_none_or(|(phase, _)| *phase != state.phase)
        {
            phases.push((state.phase, state.time.seconds()));
        }
    }
    phases
}

/// Landings of the same mission touched down within 0.05 m/s of one another when this was written; this is three times as much, m/s. A fall from
/// the 0.7 m that were left of a landing which ended too early had 3.3 m/s.
const TOUCHDOWN_M_S: f64 = 0.15;

/// When it truly was above 5 mm for the last time, s, and its vertical speed then, m/s.
fn touchdown(records: &[Record]) -> Option<[f64; 2]> {
    let mut truth =
        records.iter().filter_map(|r| if let Record::Truth(truth) = r { Some(truth) } else { None });
    let last = truth.rfind(|truth| truth.position_m[2] > 0.005)?;
    Some([last.time.seconds(), last.velocity_m_s[2]])
}

#[test]
fn a_landing_that_is_asked_for_begins_in_the_next_iteration_and_ends_the_mission() {
    let (as_planned, planned) = fly("climb-040.toml", |_| Directive::GoOn);
    let (flown, records) = fly("climb-040.toml", once(8.0, Directive::Land));
    assert_eq!((&flown.ending, &as_planned.ending), (&Ending::Complete, &Ending::Complete));
    let names: Vec<_> = phases(&records).into_iter().map(|(phase, _)| phase).collect();
    assert_eq!(names, [Phase::Idle, Phase::Launch, Phase::Hold, Phase::Land, Phase::Idle]);
    let began_s = phases(&records)[3].1;
    assert!((began_s - 8.1).abs() < 0.011, "{began_s} s");
    assert!(events(&records).contains(&"asked to land"), "{:?}", events(&records));
    // It comes down as the planned landing does, only earlier.
    let ([planned_s, planned_m_s], [down_s, down_m_s]) =
        (touchdown(&planned).unwrap(), touchdown(&records).unwrap());
    let took_s = [down_s - began_s, planned_s - phases(&planned)[3].1];
    // From 0.4 m at 0.15 m/s: 5 cm of where it was when it began.
    assert!((took_s[0] - took_s[1]).abs() < 0.05 / 0.15, "{took_s:?} s");
    assert!((down_m_s - planned_m_s).abs() < TOUCHDOWN_M_S, "{down_m_s} m/s, planned {planned_m_s} m/s");
}

#[test]
fn a_landing_from_higher_than_planned_comes_down_all_the_way_before_the_throttle_rests() {
    let (_, planned) = fly("climb-040.toml", |_| Directive::GoOn);
    let planned_m_s = touchdown(&planned).unwrap()[1];
    for land_at_s in [10.0, f64::INFINITY] {
        // At 0.15 m/s the 6 s of the mission's landing are enough for 0.9 m.
        let (mut high, mut land) = (once(2.0, Directive::FlyAt(1.6)), once(land_at_s, Directive::Land));
        let (flown, records) = fly("climb-040.toml", |now_s| match high(now_s) {
            Directive::GoOn => land(now_s),
            directive => directive,
        });
        assert_eq!(flown.ending, Ending::Complete);
        let down_m_s = touchdown(&records).unwrap()[1];
        assert!((down_m_s - planned_m_s).abs() < TOUCHDOWN_M_S, "{down_m_s} m/s, planned {planned_m_s} m/s");
    }
}

#[test]
fn a_landing_is_flown_where_the_airframe_is_held() {
    let (flown, records) = fly("hold-3d.toml", once(9.0, Directive::Land));
    assert_eq!(flown.ending, Ending::Complete);
    let setpoint = |phase: Phase| {
        let mut states =
            records.iter().filter_map(|r| if let Record::ControlState(s) = r { Some(s) } else { None });
        let state = states.rfind(|state| state.phase == phase).copied();
        state.map(|state| ([state.setpoint_m[0], state.setpoint_m[1]], state.setpoint_heading_rad)).unwrap()
    };
    let held = setpoint(Phase::Hold);
    assert_ne!(held.0, [0.0; 2], "this tells nothing where the origin is held");
    let descends = records
        .iter()
        .filter_map(|r| if let Record::ControlState(s) = r { Some(s) } else { None })
        .find(|state| state.phase == Phase::Land)
        .unwrap();
    assert_eq!(([descends.setpoint_m[0], descends.setpoint_m[1]], descends.setpoint_heading_rad), held);
}

#[test]
fn a_landing_asked_for_again_before_take_off_or_where_there_is_none_is_answered() {
    // In the landing, and behind its end.
    for at_s in [20.0, 22.5] {
        let (flown, records) = fly("climb-040.toml", once(at_s, Directive::Land));
        assert_eq!(flown.ending, Ending::Complete);
        let told = events(&records);
        assert!(told.contains(&"asked to land, which it does already"), "at {at_s} s: {told:?}");
    }
    // Twice, before the first was heeded.
    let mut left = 2;
    let (flown, records) = fly("climb-040.toml", |now_s| {
        let asks = now_s >= 5.0 && left > 0;
        left -= i32::from(asks);
        if asks { Directive::Land } else { Directive::GoOn }
    });
    assert_eq!(flown.ending, Ending::Complete);
    assert_eq!(phases(&records).iter().filter(|(phase, _)| *phase == Phase::Land).count(), 1);
    // It stands: nothing takes off.
    let (flown, records) = fly("climb-040.toml", once(0.5, Directive::Land));
    assert_eq!(flown.ending, Ending::Complete);
    assert!(events(&records).contains(&"asked to land while it stands: the mission is over"));
    assert_eq!(touchdown(&records), None, "it never left the ground");
    // A hop has no landing.
    let (_, planned) = fly("hop.toml", |_| Directive::GoOn);
    let (_, records) = fly("hop.toml", once(1.5, Directive::Land));
    let told = events(&records);
    assert!(told.contains(&"asked to land, refused: the mission has no landing from here on"), "{told:?}");
    assert_eq!(phases(&planned), phases(&records));
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
