//! What an operator may change of a mission.

use std::path::{Path, PathBuf};

use bench_rig::{ChangeError, Mission, PhaseAction, Rig};

fn rigs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs")
}

fn rig() -> Rig {
    Rig::load(rigs().join("virtual.toml")).unwrap()
}

fn mission(name: &str) -> Mission {
    Mission::load(rigs().join("missions").join(name)).unwrap()
}

#[test]
fn altitude_and_flight_time_change_the_holds_and_the_peaks_and_nothing_else() {
    let (rig, before) = (rig(), mission("climb-040.toml"));
    assert_eq!(before.altitude_m(), Ok(0.4));
    assert!((before.flight_time_s() - 17.7).abs() < 1e-12);
    let after = before.clone().at_altitude(0.6, &rig).unwrap().with_flight_time(10.0, &rig).unwrap();
    assert_eq!(after.altitude_m(), Ok(0.6));
    assert!((after.flight_time_s() - 10.0).abs() < 1e-12);
    assert!((after.criteria.peak_min_m.unwrap() - 0.6).abs() < 1e-12);
    assert!((after.criteria.peak_max_m.unwrap() - 1.2).abs() < 1e-12);
    let back = after.at_altitude(0.4, &rig).unwrap().with_flight_time(17.7, &rig).unwrap();
    for (plan, planned) in back.phases.iter().zip(&before.phases) {
        assert_eq!(plan.action, planned.action);
        assert!((plan.duration_s - planned.duration_s).abs() < 1e-9);
    }
    assert_eq!(Mission::read(Path::new("m.toml"), &back.to_toml()).unwrap(), back);
    // As it stands it is never refused, even below the envelope.
    let low = before.to_toml().replace("altitude_m = 0.4\n", "altitude_m = 0.03\n");
    let low = Mission::read(Path::new("m.toml"), &low).unwrap();
    assert_eq!(low.altitude_m(), Ok(0.03));
    assert_eq!(low.clone().at_altitude(0.03, &rig), Ok(low));
}

#[test]
fn a_landing_from_higher_up_gets_the_time_that_its_way_down_takes() {
    let (rig, before) = (rig(), mission("climb-040.toml"));
    let landing_s = |mission: &Mission| {
        let landing = mission.phases.iter().find_map(|plan| match plan.action {
            PhaseAction::Land { descent_m_s, .. } => Some((plan.duration_s, descent_m_s)),
            _ => None,
        });
        landing.unwrap()
    };
    let (planned_s, descent_m_s) = landing_s(&before);
    let (high_s, _) = landing_s(&before.clone().at_altitude(1.6, &rig).unwrap());
    assert!((high_s - planned_s - 1.2 / descent_m_s).abs() < 1e-12, "{high_s} s");
    // A mission that leaves too little time for its own altitude is not left with less than none.
    let hasty = before.to_toml().replace("duration_s = 6.0", "duration_s = 0.5");
    let hasty = Mission::read(Path::new("m.toml"), &hasty).unwrap();
    assert_eq!(landing_s(&hasty.at_altitude(0.1, &rig).unwrap()).0, 0.5);
}

#[test]
fn what_cannot_be_changed_says_why() {
    let rig = rig();
    for altitude_m in [0.0, 1.61, -0.5, f64::NAN, f64::INFINITY] {
        let refused = mission("climb-040.toml").at_altitude(altitude_m, &rig);
        assert!(matches!(refused, Err(ChangeError::Altitude { .. })), "{refused:?}");
    }
    for flight_time_s in [0.0, 1.6, 294.1, f64::NAN] {
        let refused = mission("climb-040.toml").with_flight_time(flight_time_s, &rig);
        assert!(matches!(refused, Err(ChangeError::FlightTime { .. })), "{refused:?}");
    }
    assert!(matches!(mission("hop.toml").at_altitude(0.5, &rig), Err(ChangeError::NoHold { .. })));
    assert!(matches!(mission("hop.toml").with_flight_time(5.0, &rig), Err(ChangeError::NoHold { .. })));
    let steps = mission("steps.toml");
    assert!(matches!(steps.clone().at_altitude(0.5, &rig), Err(ChangeError::ManyAltitudes { .. })));
    assert!(steps.flight_time_limits_s(&rig).is_ok());
}
