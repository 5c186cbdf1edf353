//! Numbers planted in simulated flights are found, for any kind of airframe, and flights that tell nothing are refused.
//!
//! The flights share the force law with the fit: they show that it does what it should.

#[path = "support/flown.rs"]
mod flown;

use std::path::Path;

use bench_diagnosis::{Calibration, Diagnosis, Verdict};
use bench_filter::Track;
use bench_identification::{FlightIdentification, IdentifyError, identify_flights};
use bench_inference::Problem;
use bench_plant::effects::parse_effect;
use bench_recording::{Flight, Motion};
use bench_rig::{Actuation, Rig, Uncertain};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use flown::{MISSIONS, fly, record, tracks, virtual_rig};

fn number<'a>(found: &'a FlightIdentification, name: &str) -> &'a bench_identification::IdentifiedNumber {
    found.numbers.iter().find(|number| number.name == name).unwrap()
}

/// Holds a number against the truth: within four of its sigma, and told better than before.
fn near(found: &FlightIdentification, name: &str, truth: f64) {
    let number = number(found, name);
    assert!(number.identified, "{number:?}");
    assert!(number.after.1 < 0.81 * number.before.1, "{number:?}");
    let sigmas = (number.after.0 - truth) / number.after.1;
    assert!(sigmas.abs() < 4.0, "{number:?} is {sigmas} sigma from {truth}");
}

#[test]
fn planted_numbers_are_found_and_the_rest_is_left() {
    let prior = virtual_rig();
    let mut real = prior.clone();
    real.airframe.thrust.gain_n_per_unit.value *= 0.95;
    real.airframe.drag_n_s_per_m.value = 0.018;
    let found = identify_flights(&tracks(&fly(&real, 0..6, &MISSIONS), &prior), &prior).unwrap();
    near(&found, "thrust_hover", real.airframe.throttle_for(real.airframe.weight_n()));
    near(&found, "drag_n_s_per_m", 0.018);
    // Some thousand innovations, each of chi-squared's spread of root 2: 0.05 for their mean, and noise that was found from them.
    assert!((found.mean_nis - 1.0).abs() < 0.15, "{}", found.mean_nis);
    // What is written reads back, as the same rig.
    let again = Rig::read(Path::new("identified.toml"), &found.rig.to_toml()).unwrap();
    assert_eq!(again, found.rig);
    let hover = again.airframe.throttle_for(again.airframe.weight_n());
    assert!((hover - number(&found, "thrust_hover").after.0).abs() < 1e-9 * hover);
}

#[test]
fn flights_out_of_the_ground_effect_leave_it_as_it_was() {
    let prior = virtual_rig();
    let flights = fly(&prior, 0..4, &["steps"]);
    let aloft: Vec<Track> =
        tracks(&flights, &prior).into_iter().map(|track| track.above(0.15, &prior).unwrap()).collect();
    let found = identify_flights(&aloft, &prior).unwrap();
    for name in ["ground_effect_multiplier", "ground_effect_height_m"] {
        assert!(!number(&found, name).identified, "{name}");
    }
    assert_eq!(found.rig.airframe.ground_effect, prior.airframe.ground_effect);
}

#[test]
fn a_hover_that_was_never_flown_is_refused() {
    let real = virtual_rig();
    let mut prior = real.clone();
    // By these exact numbers it hovers a tenth above where it was flown, and nothing but each flight's own acceleration can make up for it.
    let exact = |value: f64| Uncertain { value, sigma: 0.0 };
    prior.airframe.thrust.gain_n_per_unit = exact(0.8 * real.airframe.thrust.gain_n_per_unit.value);
    prior.airframe.thrust.offset = exact(real.airframe.thrust.offset.value);
    let flights = tracks(&fly(&real, 0..3, &["climb-040"]), &prior);
    let error = identify_flights(&flights, &prior).unwrap_err();
    assert!(matches!(error, IdentifyError::HoverNeverFlown { .. } | IdentifyError::Trim { .. }), "{error}");
}

#[test]
fn flights_that_each_keep_a_load_of_their_own_are_refused() {
    let real = virtual_rig();
    let mut prior = real.clone();
    prior.airframe.thrust.gain_n_per_unit.sigma = 0.0;
    prior.airframe.thrust.offset.sigma = 0.0;
    let flights: Vec<Flight> = [0.8, 1.0, 1.25, 0.82, 1.2]
        .iter()
        .enumerate()
        .map(|(i, factor)| {
            let mut loaded = real.clone();
            loaded.airframe.mass_kg.value *= factor;
            record(&loaded, MISSIONS[i % 3], i as u64)
        })
        .collect();
    let error = identify_flights(&tracks(&flights, &prior), &prior).unwrap_err();
    let IdentifyError::Trim { trim_m_s2 } = error else { panic!("{error}") };
    // Loads differ by a fifth of the weight, one sigma.
    assert!((1.0..4.0).contains(&trim_m_s2), "{trim_m_s2}");
}

#[test]
fn the_tolerance_of_the_hover_covers_flights_that_differ() {
    let prior = virtual_rig();
    // Each flight on another battery: the gain differs by 2 %.
    let factors = [0.97, 1.0, 1.02, 0.99, 1.03, 0.99];
    let flights: Vec<Flight> = factors
        .iter()
        .enumerate()
        .map(|(i, factor)| {
            let mut real = prior.clone();
            real.airframe.thrust.gain_n_per_unit.value *= factor;
            record(&real, MISSIONS[i % 3], i as u64)
        })
        .collect();
    let found = identify_flights(&tracks(&flights, &prior), &prior).unwrap();
    let a = &prior.airframe;
    let range = a.weight_n() / a.thrust.gain_n_per_unit.value;
    let spread = 0.021 * range;
    let hover = number(&found, "thrust_hover");
    // Of six draws the deviation is known to a factor of two.
    assert!((0.5 * spread..2.0 * spread).contains(&hover.after.1), "{hover:?}, spread {spread}");
    assert!(hover.standard_error < hover.after.1, "{hover:?}");
}

#[test]
fn noise_of_what_is_felt_on_board_is_found_from_a_guess() {
    let real = virtual_rig();
    let mut prior = real.clone();
    let mut flights = fly(&real, 0..3, &MISSIONS);
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for flight in &mut flights {
        let felt = flight.truth.iter().map(|truth| Motion {
            time: truth.time,
            velocity_m_s: [
                None,
                None,
                Some(truth.velocity_m_s[2] + 0.03 * rng.sample::<f64, _>(StandardNormal)),
            ],
            ..Motion::default()
        });
        flight.motion = felt.collect();
    }
    let silent = identify_flights(&tracks(&flights, &prior), &prior).unwrap();
    assert_eq!(silent.rig.disturbance.velocity_noise_m_s, None);
    prior.disturbance.velocity_noise_m_s = Some(0.1);
    let found = identify_flights(&tracks(&flights, &prior), &prior).unwrap();
    // A thousand readings tell a deviation to a few per cent.
    let noise = found.rig.disturbance.velocity_noise_m_s.unwrap();
    assert!((noise / 0.03 - 1.0).abs() < 0.15, "{noise}");
    assert_eq!(found.rig.disturbance.acceleration_noise_m_s2, None);
}

/// An airframe of another kind of actuation, rate and latency than the virtual one's.
fn airframe(actuation: Actuation, range: [f64; 2], frame_hz: f64, loop_hz: f64, latency_s: f64) -> Rig {
    let mut rig = virtual_rig();
    let old = rig.airframe.sticks;
    let per = (range[1] - range[0]) / (old.max - old.min);
    let moved = |x: f64| range[0] + (x - old.min) * per;
    let a = &mut rig.airframe;
    a.actuation = actuation;
    a.thrust.offset = Uncertain { value: moved(a.thrust.offset.value), sigma: a.thrust.offset.sigma * per };
    a.thrust.gain_n_per_unit.value /= per;
    a.thrust.gain_n_per_unit.sigma /= per;
    a.sticks.min = range[0];
    a.sticks.max = range[1];
    a.sticks.centre = moved(old.centre);
    a.sticks.tilt_rad_per_unit /= per;
    a.sticks.yaw_rate_rad_s_per_unit /= per;
    rig.output.bits = 12;
    rig.tracker.frame_period_s = 1.0 / frame_hz;
    rig.control_loop.period_s = 1.0 / loop_hz;
    rig.tracker.latency_s = Uncertain { value: latency_s, sigma: 0.02 };
    rig.control.extrapolation_s = latency_s + 1.0 / loop_hz;
    rig.control.velocity_window_s = 0.2_f64.max(2.0 / frame_hz);
    rig
}

/// Identifies nominal flights, then diagnoses others: nominal ones, and some with an effect.
fn identify_then_diagnose(rig: &Rig, effect: &str, missions: &[&str]) -> [Diagnosis; 2] {
    let mut nominal = rig.clone();
    nominal.airframe.thrust.gain_n_per_unit.value *= 1.03;
    let found = identify_flights(&tracks(&fly(&nominal, 0..3, missions), rig), rig).unwrap();
    let mut changed = nominal.clone();
    changed.effects.push(parse_effect(effect).unwrap());
    [nominal, changed].map(|real| {
        let flights = tracks(&fly(&real, 10..13, missions), &found.rig);
        Diagnosis::of(&Problem::new(&flights, &found.rig), &Calibration::built_in())
    })
}

fn check(rig: &Rig, effect: &str, named: &str, missions: &[&str]) {
    let [nominal, changed] = identify_then_diagnose(rig, effect, missions);
    assert_eq!(nominal.verdict, Verdict::None, "{:#?}", nominal.candidates);
    let group: Vec<_> = changed.group.iter().map(|likeness| likeness.like).collect();
    assert!(
        changed.effects == [named] || (changed.verdict == Verdict::Effect && group.contains(&named)),
        "{effect}: {:#?}",
        &changed.candidates[..3]
    );
}

#[test]
fn a_latency_that_was_identified_is_the_latency_from_then_on() {
    let rig = virtual_rig();
    let mut real = rig.clone();
    // The tracker believes the rig; 0.06 s are two of its tolerances.
    real.effects.push(parse_effect("tracker-latency:extra_s=0.06").unwrap());
    let found = identify_flights(&tracks(&fly(&real, 0..3, &MISSIONS), &rig), &rig).unwrap();
    near(&found, "tracker_latency_s", 0.36);
    let flights = tracks(&fly(&real, 10..13, &MISSIONS), &found.rig);
    let diagnosis = Diagnosis::of(&Problem::new(&flights, &found.rig), &Calibration::built_in());
    assert_eq!(diagnosis.verdict, Verdict::None, "{:#?}", &diagnosis.candidates[..3]);
    let latency = diagnosis.numbers.iter().find(|number| number.name == "tracker_latency_s").unwrap();
    assert!(latency.sigmas.abs() < 3.0, "{latency:?}");
}

#[test]
fn a_fraction_at_500_hz_without_latency_is_identified_then_diagnosed() {
    let rig = airframe(Actuation::Fraction, [0.0, 1.0], 500.0, 250.0, 0.0);
    check(&rig, "quadratic-drag:coefficient_n_s2_per_m2=0.06", "quadratic-drag", &["climb-040", "hop"]);
}

#[test]
fn counts_at_5_hz_are_identified_then_diagnosed() {
    let mut rig = airframe(Actuation::Count, [1000.0, 2000.0], 5.0, 5.0, 0.1);
    // At 5 Hz the law must be slow to hold the airframe at all.
    rig.control.position_gain_per_s = 0.4;
    rig.control.speed_gain_per_s = 0.8;
    rig.control.integral_gain_per_s2 = 0.3;
    check(&rig, "thrust-loss:fraction=0.15", "thrust-loss", &MISSIONS);
}

#[test]
fn volts_through_half_a_second_are_identified_then_diagnosed() {
    let mut rig = airframe(Actuation::Volt, [0.0, 5.0], 30.0, 20.0, 0.5);
    rig.control.position_gain_per_s = 0.4;
    rig.control.speed_gain_per_s = 0.8;
    rig.control.integral_gain_per_s2 = 0.3;
    check(&rig, "tracker-latency:extra_s=0.15", "tracker-latency", &MISSIONS);
}

#[test]
fn what_tells_nothing_is_refused_in_words() {
    let rig = virtual_rig();
    let flights = fly(&rig, 0..3, &MISSIONS);
    let identify = |change: &dyn Fn(&mut Flight)| {
        let changed: Vec<Flight> = flights
            .iter()
            .map(|flight| {
                let mut flight = flight.clone();
                change(&mut flight);
                flight
            })
            .collect();
        identify_flights(&tracks(&changed, &rig), &rig).map(|_| ()).unwrap_err()
    };
    let throttle = |flight: &mut Flight, law: &dyn Fn(f64) -> f64| {
        flight.readbacks.clear();
        flight.commands.iter_mut().for_each(|command| command.sticks.throttle = law(command.sticks.throttle));
    };
    let hover = rig.airframe.throttle_for(rig.airframe.weight_n());

    assert!(matches!(
        identify_flights(&tracks(&flights[..2], &rig), &rig),
        Err(IdentifyError::TooFewFlights { usable: 2, least: 3 })
    ));
    let grounded = identify(&|f| f.positions.iter_mut().for_each(|p| p.position_m[2] = 0.0));
    assert!(matches!(grounded, IdentifyError::NeverAirborne { .. }), "{grounded}");
    let millimetres = identify(&|f| f.positions.iter_mut().for_each(|p| p.position_m[2] *= 1000.0));
    assert!(matches!(millimetres, IdentifyError::Altitude { .. }), "{millimetres}");
    let constant = identify(&|f| throttle(f, &|u| if u > 0.5 { hover } else { 0.0 }));
    assert!(matches!(constant, IdentifyError::ConstantThrottle { .. }), "{constant}");
    let falling = identify(&|f| throttle(f, &|u| if u > 0.5 { 2.0 * hover - u } else { 0.0 }));
    assert!(matches!(falling, IdentifyError::ThrustFalls { .. }), "{falling}");
    let strong = identify(&|f| throttle(f, &|u| if u > 0.5 { 0.5 + 0.3 * (u - 0.5) } else { 0.0 }));
    assert!(matches!(strong, IdentifyError::Thrust { .. }), "{strong}");
    let thousandth = {
        let mut rig = rig.clone();
        rig.airframe.mass_kg.value *= 1000.0;
        identify_flights(&tracks(&flights, &rig), &rig).map(|_| ()).unwrap_err()
    };
    assert!(thousandth.to_string().contains("too small by 1000"), "{thousandth}");
    // Beyond its tolerance by far, but not absurd.
    let far = {
        let mut rig = rig.clone();
        rig.airframe.thrust.gain_n_per_unit.sigma *= 0.05;
        rig.airframe.thrust.gain_n_per_unit.value *= 1.15;
        rig.airframe.thrust.offset.sigma *= 0.05;
        identify_flights(&tracks(&flights, &rig), &rig).map(|_| ()).unwrap_err()
    };
    assert!(far.to_string().contains("thrust_hover"), "{far}");
}

#[test]
fn errors_that_follow_one_another_are_seen_in_the_innovations() {
    let prior = virtual_rig();
    let flights = fly(&prior, 0..4, &MISSIONS);
    let own = identify_flights(&tracks(&flights, &prior), &prior).unwrap();
    assert!(own.is_white(), "{}", own.autocorrelation);
    // As an estimator on board errs: 8 mm, remembered for 0.3 s, a frame each 0.033 s.
    let kept = (-0.033_f64 / 0.3).exp();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut wandering = flights;
    for flight in &mut wandering {
        let mut error_m = 0.0;
        for position in &mut flight.positions {
            let normal: f64 = rng.sample(StandardNormal);
            error_m = kept * error_m + 0.008 * (1.0 - kept * kept).sqrt() * normal;
            position.position_m[2] += error_m;
        }
    }
    let followed = identify_flights(&tracks(&wandering, &prior), &prior).unwrap();
    assert!(!followed.is_white(), "{}", followed.autocorrelation);
}
