//! How often the intervals that `identify flight` states hold the truth, over airframes drawn from a rig's tolerances.
//!
//! `tools/identification` draws as many as the results page tells of (`BENCH_DRAWS`).

use std::path::Path;

use bench_filter::Track;
use bench_identification::{IdentifyError, identify_flights};
use bench_plant::effects::parse_effect;
use bench_recording::{Flight, Mode, Record, Session};
use bench_rig::{GRAVITY_M_S2, Mission, Model, Rig, Uncertain};
use bench_run::simulate_on;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use rayon::prelude::*;

/// Launch trajectories as in the paper's section 3.5, and what comes after them in the ground effect and out of it.
const MISSIONS: [&str; 6] = ["hop", "steps", "climb-040", "low-hover", "hop", "steps"];
const NAMES: [&str; 4] = ["thrust_hover", "drag_n_s_per_m", "ground_effect_height_m", "tracker_latency_s"];

fn prior() -> Rig {
    let rigs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs");
    let mut rig = Rig::load(rigs.join("virtual.toml")).unwrap();
    rig.plant.model = Model::Vertical;
    // What a balance and a ruler tell of an airframe: its mass, and the rest roughly.
    let a = &mut rig.airframe;
    a.mass_kg.sigma = 0.0;
    a.thrust.gain_n_per_unit.sigma = 0.04 * a.thrust.gain_n_per_unit.value;
    a.drag_n_s_per_m.sigma = 0.4 * a.drag_n_s_per_m.value;
    a.ground_effect.height_m.sigma = 0.008;
    rig.tracker.latency_s.sigma = 0.02;
    rig
}

/// What differs between flights, one sigma: what the diagnosis takes for ordinary where a rig does not say (docs/diagnosis.md).
const TRIM_M_S2: f64 = 0.05;

/// Ordinary air in a room: deviation of the wind, even in the logarithm.
const AIR_M_S: [f64; 2] = [0.008, 0.06];

/// A number drawn from its tolerance, within two sigma as an airframe has that flies.
fn draw(number: &mut Uncertain, rng: &mut ChaCha8Rng) {
    let normal: f64 = loop {
        let normal: f64 = rng.sample(StandardNormal);
        if normal.abs() < 2.0 {
            break normal;
        }
    };
    number.value += number.sigma * normal;
}

/// Of each of [`NAMES`]: whether it was identified, and then whether its interval of 95 % holds the truth. `None` where the
/// flights were refused as contradicting the rig.
fn one(index: u64) -> Option<[Option<bool>; 4]> {
    let prior = prior();
    let mut real = prior.clone();
    let mut rng = ChaCha8Rng::seed_from_u64(1000 + index);
    draw(&mut real.airframe.thrust.gain_n_per_unit, &mut rng);
    draw(&mut real.airframe.drag_n_s_per_m, &mut rng);
    draw(&mut real.airframe.ground_effect.height_m, &mut rng);
    // The tracker goes on believing what the rig says.
    let mut latency_s = prior.tracker.latency_s;
    draw(&mut latency_s, &mut rng);
    let extra_s = latency_s.value - prior.tracker.latency_s.value;
    real.effects.push(parse_effect(&format!("tracker-latency:extra_s={extra_s}")).unwrap());
    let wind_m_s = AIR_M_S[0] * (AIR_M_S[1] / AIR_M_S[0]).powf(rng.random::<f64>());
    real.effects.push(parse_effect(&format!("gusts:sigma_m_s={wind_m_s},correlation_time_s=1")).unwrap());
    let rigs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs");
    let tracks: Vec<Track> = MISSIONS
        .iter()
        .zip(0..)
        .map(|(mission, flight)| {
            let mission = Mission::load(rigs.join("missions").join(mission).with_extension("toml")).unwrap();
            let mut records: Vec<Record> = Vec::new();
            // Another battery, another trim.
            let mut real = real.clone();
            let trim: f64 = rng.sample(StandardNormal);
            real.airframe.thrust.gain_n_per_unit.value *= 1.0 + TRIM_M_S2 / GRAVITY_M_S2 * trim;
            simulate_on(&real, &prior, &mission, 100 * index + flight, &mut records, |_| true).unwrap();
            let flight = Flight::from_records(Session::new(Mode::Sim), records);
            Track::from_flight("flight", &flight, &prior).unwrap()
        })
        .collect();
    let found = match identify_flights(&tracks, &prior) {
        Err(IdentifyError::Contradicts(_)) => return None,
        found => found.unwrap(),
    };
    let a = &real.airframe;
    let truth = [
        a.throttle_for(a.weight_n()),
        a.drag_n_s_per_m.value,
        a.ground_effect.height_m.value,
        latency_s.value,
    ];
    let mut held = [None; 4];
    for ((held, name), truth) in held.iter_mut().zip(NAMES).zip(truth) {
        let number = found.numbers.iter().find(|number| number.name == name).unwrap();
        if number.identified {
            *held = Some((number.after.0 - truth).abs() < 1.96 * number.standard_error);
        }
    }
    Some(held)
}

#[test]
fn stated_intervals_hold_the_truth_as_often_as_they_say() {
    let draws: u64 = std::env::var("BENCH_DRAWS").ok().and_then(|draws| draws.parse().ok()).unwrap_or(40);
    let all: Vec<[Option<bool>; 4]> = (0..draws).into_par_iter().filter_map(one).collect();
    // Every number lies within its tolerance: few may be refused.
    println!("coverage | flights taken for nominal | {} | {draws}", all.len());
    assert!(all.len() as f64 >= 0.95 * draws as f64, "{} of {draws} told something", all.len());
    for (i, name) in NAMES.iter().enumerate() {
        let told: Vec<bool> = all.iter().filter_map(|held| held[i]).collect();
        let (n, held) = (told.len() as f64, told.iter().filter(|held| **held).count() as f64);
        println!("coverage | {name} | {held} | {n}");
        assert!(n >= 0.5 * draws as f64, "{name} is identified in {n} of {draws}");
        // 90 to 98 %, and three deviations of so few draws.
        let spread = |p: f64| 3.0 * (p * (1.0 - p) / n).sqrt();
        let share = held / n;
        assert!(share > 0.90 - spread(0.90), "{name}: {held} of {n}");
        assert!(share <= 0.98 + spread(0.98), "{name}: {held} of {n}");
    }
}
