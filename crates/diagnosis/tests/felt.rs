//! Vertical speed and acceleration measured on board are used where the rig says how good they are.

#[path = "support/flown.rs"]
mod flown;
mod support;

use bench_diagnosis::{Calibration, Diagnosis, Verdict};
use bench_filter::Track;
use bench_inference::Problem;
use bench_plant::effects::parse_effect;
use bench_recording::{Flight, Motion};
use bench_rig::Rig;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

const VELOCITY_NOISE_M_S: f64 = 0.02;
const ACCELERATION_NOISE_M_S2: f64 = 0.1;
/// What the accelerometer shows at rest.
const ZERO_M_S2: f64 = 0.3;
const MISSIONS: [&str; 3] = ["hop", "climb-040", "steps"];

fn rig(says: bool) -> Rig {
    let mut rig = support::rig();
    rig.disturbance.velocity_noise_m_s = says.then_some(VELOCITY_NOISE_M_S);
    rig.disturbance.acceleration_noise_m_s2 = says.then_some(ACCELERATION_NOISE_M_S2);
    rig
}

/// Flights with what a sensor on board would have measured of them.
fn flights(effect: Option<&str>) -> Vec<Flight> {
    let mut real = rig(false);
    real.effects.extend(effect.map(|text| parse_effect(text).unwrap()));
    let fly = |(mission, seed): (&&str, u64)| {
        let mut flight = flown::fly(&real, mission, seed);
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut noise = |sigma: f64| sigma * rng.sample::<f64, _>(StandardNormal);
        flight.motion = flight
            .truth
            .windows(3)
            .map(|w| {
                let speed = |i: usize| w[i].velocity_m_s[2];
                let acceleration = (speed(2) - speed(0)) / w[2].time.since_s(w[0].time);
                Motion {
                    time: w[1].time,
                    velocity_m_s: [None, None, Some(speed(1) + noise(VELOCITY_NOISE_M_S))],
                    vertical_acceleration_m_s2: Some(
                        acceleration + ZERO_M_S2 + noise(ACCELERATION_NOISE_M_S2),
                    ),
                    attitude_rad: [None; 3],
                }
            })
            .collect();
        flight
    };
    MISSIONS.iter().zip(1..).map(fly).collect()
}

fn diagnose(flights: &[Flight], rig: &Rig) -> Diagnosis {
    let tracks: Vec<Track> =
        flights.iter().zip(MISSIONS).map(|(f, name)| Track::from_flight(name, f, rig).unwrap()).collect();
    Diagnosis::of(&Problem::new(&tracks, rig), &Calibration::built_in())
}

fn evidence(diagnosis: &Diagnosis, name: &str) -> f64 {
    diagnosis.candidates.iter().find(|candidate| candidate.name == name).unwrap().evidence_gain
}

#[test]
fn motion_felt_on_board_adds_evidence_for_what_is_there() {
    let flights = flights(Some("quadratic-drag:coefficient_n_s2_per_m2=0.01"));
    let (without, with) = (diagnose(&flights, &rig(false)), diagnose(&flights, &rig(true)));
    let name = "quadratic-drag";
    // Odds of 20 to 1.
    assert!(
        evidence(&with, name) > evidence(&without, name) + 3.0,
        "{} with, {} without",
        evidence(&with, name),
        evidence(&without, name)
    );
    assert_eq!(with.effects, [name], "{:#?}", with.candidates);
    let found = with.candidates[0].parameters[0].value;
    assert!((found / 0.01 - 1.0).abs() < 0.2, "{found}");
}

#[test]
fn where_nothing_is_wrong_motion_changes_nothing() {
    let flights = flights(None);
    let said = diagnose(&flights, &rig(true));
    assert_eq!(said.verdict, Verdict::None, "{:#?}", said.candidates);
    // A rig that is silent lets it be.
    let mut bare = flights.clone();
    for flight in &mut bare {
        flight.motion.clear();
    }
    let (silent, bare) = (diagnose(&flights, &rig(false)), diagnose(&bare, &rig(false)));
    assert_eq!(silent.candidates[0].probability, bare.candidates[0].probability);
}
