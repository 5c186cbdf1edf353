//! Effects planted in simulated flights are found, and flights without one are let be.
//!
//! These flights share the force law with the diagnosis, so they show that it does what it should, not how well it does
//! on flights of other physics.

use std::path::Path;

use bench_diagnosis::{Calibration, Diagnosis, Problem, Track, TrackError, Verdict};
use bench_plant::effects::parse_effect;
use bench_recording::{Flight, Mode, Record, Session};
use bench_rig::{Mission, Model, Rig};
use bench_run::simulate;

fn rigs() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs")
}

fn rig() -> Rig {
    let mut rig = Rig::load(rigs().join("virtual.toml")).unwrap();
    rig.plant.model = Model::Vertical;
    rig
}

fn fly(rig: &Rig, mission: &str, seed: u64) -> Flight {
    let mission = Mission::load(rigs().join("missions").join(mission).with_extension("toml")).unwrap();
    let mut records: Vec<Record> = Vec::new();
    simulate(rig, &mission, seed, &mut records, |_| true).unwrap();
    Flight::from_records(Session::new(Mode::Sim), records)
}

/// Diagnoses the flights that a rig with an effect makes of the missions, against the rig without it.
fn diagnose(effect: Option<&str>) -> Diagnosis {
    let nominal = rig();
    let mut real = nominal.clone();
    real.effects.extend(effect.map(|text| parse_effect(text).unwrap()));
    let tracks: Vec<Track> = ["hop", "climb-040", "steps", "low-hover"]
        .iter()
        .zip(1..)
        .map(|(mission, seed)| Track::from_flight(mission, &fly(&real, mission, seed), &nominal).unwrap())
        .collect();
    Diagnosis::of(&Problem::new(&tracks, &nominal), &Calibration::built_in())
}

#[test]
fn flights_without_an_effect_show_none() {
    let diagnosis = diagnose(None);
    assert_eq!(diagnosis.verdict, Verdict::None, "{:#?}", diagnosis.candidates);
    assert!(diagnosis.numbers.iter().all(|number| number.sigmas.abs() < 3.0));
}

#[test]
fn effects_are_named_with_parameters_near_those_planted() {
    // Relative errors of a few sigma; sizes are plain on these flights.
    for (text, name, parameter, planted) in [
        ("rotor-lag:time_constant_s=0.12", "rotor-lag", "time_constant_s", 0.12),
        ("quadratic-drag:coefficient_n_s2_per_m2=0.05", "quadratic-drag", "coefficient_n_s2_per_m2", 0.05),
        ("ground-effect-shape:stretch=1.8,exponent=2", "ground-effect-shape", "stretch", 1.8),
    ] {
        let diagnosis = diagnose(Some(text));
        assert_eq!(diagnosis.verdict, Verdict::Effect, "{text}: {:#?}", diagnosis.candidates);
        assert_eq!(diagnosis.effects, [name], "{text}");
        let found = diagnosis.candidates[0].parameters.iter().find(|p| p.name == parameter).unwrap();
        assert!((found.value - planted).abs() < found.high - found.low + 0.05 * planted, "{text}: {found:?}");
        let k = &diagnosis.gap.k_step_m;
        let (before, after) = (k.nominal[1].unwrap().value, k.with_effect[1].unwrap().value);
        assert!(after < before, "{text}: {before} m before, {after} m after");
    }
}

#[test]
fn flights_that_tell_nothing_are_refused_in_words() {
    let rig = rig();
    let flight = fly(&rig, "climb-040", 1);
    let without = |change: fn(&mut Flight)| {
        let mut flight = flight.clone();
        change(&mut flight);
        Track::from_flight("f", &flight, &rig).unwrap_err()
    };
    assert!(matches!(without(|f| f.commands.clear()), TrackError::NoCommands { .. }));
    assert!(matches!(without(|f| f.positions.clear()), TrackError::NoPositions { .. }));
    let never = |f: &mut Flight| {
        f.commands.iter_mut().for_each(|command| command.sticks.throttle = 0.1);
        f.readbacks.iter_mut().for_each(|readback| readback.readback.sticks.throttle = 0.1);
    };
    assert!(matches!(without(never), TrackError::NeverFlew { .. }));
    assert!(matches!(without(|f| f.positions.truncate(30)), TrackError::TooShort { .. }));
    let nan = |f: &mut Flight| f.positions.iter_mut().for_each(|p| p.position_m[2] = f64::NAN);
    assert!(matches!(without(nan), TrackError::NoPositions { .. }));
}
