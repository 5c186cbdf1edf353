//! A model held against open-loop flights: right models pass with bands that hold, wrong ones fail.

use std::path::Path;

use bench_filter::Track;
use bench_identification::{IdentifyError, OpenLoop, Tolerance, VerifyVerdict, verify};
use bench_plant::effects::parse_effect;
use bench_recording::{Flight, Mode, Record, Session};
use bench_rig::{Mission, Model, Rig, Uncertain};
use bench_run::simulate;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

fn rigs() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs")
}

fn virtual_rig() -> Rig {
    let mut rig = Rig::load(rigs().join("virtual.toml")).unwrap();
    rig.plant.model = Model::Vertical;
    rig
}

fn mission(text: &str) -> Mission {
    Mission::read(Path::new("mission.toml"), text).unwrap()
}

/// Four seconds of a hop.
fn hop(thrust_to_weight: f64) -> Mission {
    mission(&format!(
        "name = \"hop\"\ndescription = \"a short hop\"\n[[phase]]\nkind = \"open\"\nthrust_to_weight = {thrust_to_weight}\nduration_s = 4.0\n"
    ))
}

/// A flight of a real airframe, held against a rig.
fn fly(real: &Rig, rig: &Rig, mission: &Mission, seed: u64) -> OpenLoop {
    let mut records: Vec<Record> = Vec::new();
    simulate(real, mission, seed, &mut records, |_| true).unwrap();
    let mut session = Session::new(Mode::Sim);
    session.rig_toml = Some(rig.to_toml());
    let flight = Flight::from_records(session, records);
    OpenLoop { track: Track::from_flight(&format!("hop {seed}"), &flight, rig).unwrap(), until_s: None }
}

/// An airframe within the rig's tolerances.
fn drawn(rig: &Rig, seed: u64) -> Rig {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut real = rig.clone();
    let mut draw = |number: &mut Uncertain| {
        let normal: f64 = rng.sample(StandardNormal);
        number.value += number.sigma * normal;
    };
    let a = &mut real.airframe;
    draw(&mut a.mass_kg);
    draw(&mut a.thrust.gain_n_per_unit);
    draw(&mut a.thrust.offset);
    draw(&mut a.ground_effect.multiplier);
    draw(&mut a.ground_effect.height_m);
    draw(&mut a.drag_n_s_per_m);
    real
}

#[test]
fn bands_hold_airframes_within_the_tolerances() {
    let rig = virtual_rig();
    // What the controller commands follows the rig, not the airframe that flies.
    let throttle = |real: &Rig| {
        rig.airframe.throttle_for(0.98 * rig.airframe.weight_n()) - real.airframe.thrust.offset.value
    };
    let flights: Vec<OpenLoop> = (0..16)
        .map(|seed| {
            let real = drawn(&rig, seed);
            let thrust = real.airframe.thrust.gain_n_per_unit.value * throttle(&real);
            fly(&real, &rig, &hop(thrust / real.airframe.weight_n()), seed)
        })
        .collect();
    let found = verify(&flights, &rig, &Tolerance { ahead_m: 0.1, ..Tolerance::default() }).unwrap();
    let peaks = found.flights.iter().filter(|f| (f.peak_m[2]..=f.peak_m[3]).contains(&f.peak_m[0])).count();
    // Of 16 at 95 %, fewer than 12 has a probability of 2e-4.
    assert!(peaks >= 12, "{peaks} of 16 peaks are in their bands");
    let inside = found.flights.iter().map(|f| f.inside).sum::<f64>() / 16.0;
    assert!(inside > 0.85, "{inside}");
}

#[test]
fn a_right_model_predicts_and_a_wrong_one_fails() {
    let mut rig = virtual_rig();
    // Known well, as after flights, and so is what a flight keeps of its own: the band is narrow.
    rig.disturbance.trim_m_s2 = Some(0.01);
    let a = &mut rig.airframe;
    a.mass_kg.sigma = 0.0;
    a.thrust.gain_n_per_unit.sigma = 0.0001;
    a.thrust.offset.sigma = 0.0005;
    a.ground_effect.multiplier.sigma = 0.003;
    a.ground_effect.height_m.sigma = 0.0005;
    let flights = [fly(&rig, &rig, &hop(0.98), 1)];
    let right =
        verify(&flights, &rig, &Tolerance { trajectory_m: Some(0.02), ..Tolerance::default() }).unwrap();
    assert!(right.passed, "{:?}", right.checks);

    let mut wrong = rig.clone();
    wrong.airframe.ground_effect.multiplier.value = 1.2;
    let found =
        verify(&flights, &wrong, &Tolerance { trajectory_m: Some(0.02), ..Tolerance::default() }).unwrap();
    assert!(!found.passed);
    let trajectory = &found.checks[1];
    assert!(!trajectory.passed && trajectory.name.contains("trajectory"), "{:?}", found.checks);
    assert!(found.flights[0].consistency.whiteness_p < 1e-3);
    // The same flights give the same bands.
    let again = verify(&flights, &wrong, &Tolerance::default()).unwrap();
    assert_eq!(found.flights[0].trajectory.band_95_m, again.flights[0].trajectory.band_95_m);
}

#[test]
fn what_acts_in_flight_and_is_not_in_the_rig_shows() {
    let rig = virtual_rig();
    let mut real = rig.clone();
    real.effects.push(parse_effect("tracker-latency:extra_s=0.25").unwrap());
    let flights = [fly(&real, &rig, &hop(1.02), 2)];
    let found = verify(&flights, &rig, &Tolerance::default()).unwrap();
    // However wide the band.
    assert_eq!(found.verdict, VerifyVerdict::Failed, "{:?}", found.checks);
}

#[test]
fn a_band_that_nearly_any_flight_is_within_is_not_informative() {
    let mut rig = virtual_rig();
    let flights = [fly(&rig, &rig, &hop(0.98), 1)];
    let wide = verify(&flights, &rig, &Tolerance::default()).unwrap();
    assert_eq!((wide.verdict, wide.passed), (VerifyVerdict::NotInformative, false), "{:?}", wide.checks);
    // 2 % of the gain are more than 1 % of the mass and 10 mV of 1.4 V.
    assert_eq!(wide.widened_by[0].name, "thrust_gain", "{:?}", wide.widened_by);
    assert!(wide.narrowed_by[0].contains("bench identify thrust"), "{:?}", wide.narrowed_by);
    let limit = Tolerance { band_m: Some(5.0), ..Tolerance::default() };
    assert_eq!(verify(&flights, &rig, &limit).unwrap().verdict, VerifyVerdict::Passed);

    // What is known better no longer leads.
    rig.airframe.thrust.gain_n_per_unit.sigma = 0.0001;
    let narrower = verify(&flights, &rig, &Tolerance::default()).unwrap();
    assert_eq!(narrower.widened_by[0].name, "mass_kg", "{:?}", narrower.widened_by);
    assert!(narrower.flights[0].band_m < wide.flights[0].band_m);
}

#[test]
fn flights_that_tell_nothing_are_refused() {
    let rig = virtual_rig();
    let grounded = [fly(&rig, &rig, &hop(0.5), 3)];
    let told = verify(&grounded, &rig, &Tolerance::default()).unwrap_err();
    assert!(matches!(told, IdentifyError::NeverAirborne { .. }), "{told}");
    let mut short = fly(&rig, &rig, &hop(0.98), 4);
    short.until_s = Some(short.track.begin_s + 0.2);
    let told = verify(&[short], &rig, &Tolerance::default()).unwrap_err().to_string();
    assert!(told.contains("before a closed loop took over"), "{told}");
}
