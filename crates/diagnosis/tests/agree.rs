//! Flights of one condition agree, and those of two do not. `BENCH_SETS=40 cargo test -p bench-diagnosis --test agree -- --nocapture`
//! prints how often, of as many sets of each kind.

#[path = "support/flown.rs"]
mod flown;
mod support;

use bench_diagnosis::{Calibration, Diagnosis};
use bench_filter::Track;
use bench_inference::Problem;
use bench_plant::effects::parse_effect;
use bench_rig::{Rig, Uncertain};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use support::rig;

use flown::fly;

const MISSIONS: [&str; 4] = ["climb-040", "hop", "steps", "low-hover"];

fn sets() -> u64 {
    std::env::var("BENCH_SETS").ok().and_then(|text| text.parse().ok()).unwrap_or(1)
}

/// An airframe within the rig's tolerances, with an effect or without.
fn real(set: u64, effect: Option<&str>) -> Rig {
    let mut real = rig();
    let mut rng = ChaCha8Rng::seed_from_u64(set);
    let mut draw = |number: &mut Uncertain| {
        let normal: f64 = StandardNormal.sample(&mut rng);
        number.value += number.sigma * normal.clamp(-2.5, 2.5);
    };
    draw(&mut real.airframe.thrust.gain_n_per_unit);
    draw(&mut real.airframe.drag_n_s_per_m);
    draw(&mut real.airframe.ground_effect.height_m);
    draw(&mut real.tracker.latency_s);
    real.effects.extend(effect.map(|effect| parse_effect(effect).unwrap()));
    real
}

/// The four missions with each of the effects in turn.
fn diagnosed(set: u64, effects: &[Option<&str>]) -> Diagnosis {
    let seen_by = rig();
    let mut tracks = Vec::new();
    for (turn, effect) in effects.iter().enumerate() {
        let real = real(set, *effect);
        for (index, name) in MISSIONS.iter().enumerate() {
            let seed = 1000 * set + (10 * turn + index) as u64;
            tracks.extend(Track::from_flight(&format!("{turn} {name}"), &fly(&real, name, seed), &seen_by));
        }
    }
    assert_eq!(tracks.len(), MISSIONS.len() * effects.len());
    Diagnosis::of(&Problem::new(&tracks, &seen_by), &Calibration::built_in())
}

fn disagreeing(effects: &[Option<&str>]) -> u64 {
    let mut count = 0;
    for set in 0..sets() {
        let diagnosis = diagnosed(set, effects);
        if let Some(found) = &diagnosis.disagreement {
            count += 1;
            println!("  set {set}, {} leads: {found:?}", diagnosis.candidates[0].name);
        }
    }
    println!("{effects:?}: {count} of {} sets disagree", sets());
    count
}

#[test]
fn flights_of_one_condition_agree() {
    let of_one = [None, Some("rotor-lag:time_constant_s=0.12"), Some("mass-change:fraction=0.05")];
    let alarms: u64 = of_one.iter().map(|effect| disagreeing(&[*effect, *effect])).sum();
    assert_eq!(alarms, 0, "of {} sets", 3 * sets());
}

#[test]
fn flights_of_two_conditions_do_not() {
    for effects in [
        [None, Some("rotor-lag:time_constant_s=0.12")],
        [Some("rotor-lag:time_constant_s=0.05"), Some("rotor-lag:time_constant_s=0.15")],
        [None, Some("mass-change:fraction=0.05")],
    ] {
        let found = disagreeing(&effects);
        assert!(10 * found >= 9 * sets(), "{found} of {} sets", sets());
    }
}
