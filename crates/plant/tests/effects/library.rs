//! The library as a whole: names, ranges, what is neutral, what is visible, what stays finite.

use std::collections::HashSet;

use bench_plant::{
    body::Body,
    effects::{Effects, Frame, LIBRARY, Prior, Reading, Shows, Spread, read_as},
};
use bench_rig::{Model, Rig};
use nalgebra::Vector3;

use crate::bench::{Flight, entry, rig, sticks, typical};

/// Names and stages as the command line, rig files and results know them.
const TAXONOMY: [(&str, &[&str]); 6] = [
    (
        "tracker",
        &[
            "tracker-latency",
            "tracker-jitter",
            "tracker-scale",
            "tracker-noise",
            "tracker-dropout",
            "tracker-outliers",
        ],
    ),
    ("loop", &["loop-overrun"]),
    ("actuator", &["actuator-lag", "actuator-saturation", "actuator-quantisation", "actuator-backlash"]),
    ("propulsion", &["rotor-lag", "thrust-curve", "thrust-loss", "battery-discharge", "battery-load"]),
    ("environment", &["ground-effect-shape", "ground-effect-dynamic", "ceiling-effect", "gusts", "updraft"]),
    ("airframe", &["mass-change", "quadratic-drag", "descent-thrust-loss", "inflow-damping", "tilt-loss"]),
];

#[test]
fn the_library_is_the_taxonomy_in_its_order() {
    let expected: Vec<_> =
        TAXONOMY.iter().flat_map(|(stage, names)| names.iter().map(move |name| (*stage, *name))).collect();
    let library: Vec<_> = LIBRARY.iter().map(|spec| (spec.stage.name(), spec.name)).collect();
    assert_eq!(library, expected);
}

#[test]
fn every_parameter_has_one_key_a_range_that_holds_its_typical_and_neutral_values_and_a_proper_prior() {
    for spec in LIBRARY.iter().copied() {
        let keys: HashSet<_> = spec.parameters.iter().map(|p| p.key).collect();
        assert_eq!(keys.len(), spec.parameters.len(), "{}", spec.name);
        assert!(spec.parameters.iter().any(|p| p.neutral.is_some()), "{} can vanish", spec.name);
        for p in spec.parameters {
            let what = format!("{} {}", spec.name, p.key);
            assert!(p.min < p.max && p.min.is_finite() && p.max.is_finite(), "{what}");
            assert!((p.min..=p.max).contains(&p.prior.typical()), "{what}");
            assert!(p.neutral.is_none_or(|neutral| (p.min..=p.max).contains(&neutral)), "{what}");
            match p.prior {
                Prior::Normal { sigma, .. } => assert!(sigma > 0.0, "{what}"),
                Prior::LogNormal { median, sigma_ln } => {
                    assert!(median > 0.0 && sigma_ln > 0.0 && p.min >= 0.0, "{what}");
                }
            }
        }
    }
}

#[test]
fn what_a_row_says_of_its_effect_names_parameters_and_effects_that_are_there() {
    for spec in LIBRARY.iter() {
        let (name, row) = (spec.name, &spec.signature);
        for (key, most) in row.fitted_up_to {
            let p = spec.parameters.iter().find(|p| p.key == *key).expect(name);
            assert!((p.min..=p.max).contains(most), "{name}: {key}");
        }
        assert!(row.adds_to.iter().all(|(_, parameter)| *parameter < spec.parameters.len()), "{name}");
        for other in row.confounded_with {
            let other = LIBRARY.iter().find(|spec| spec.name == *other).expect(name);
            assert!(other.signature.confounded_with.contains(&name), "{name} and {}", other.name);
        }
        if let Shows::Spread(spread) = row.shows {
            let meant = match spread {
                Spread::MeasurementNoise | Spread::LateFrames => 1,
                Spread::Turbulence | Spread::LostFrames | Spread::WrongPlaces => 2,
            };
            assert_eq!(spec.parameters.len(), meant, "{name}");
        }
    }
}

#[test]
fn every_direct_reading_is_of_one_effect() {
    use Reading::{
        LateFrames, LateIterations, Latency, LostFrames, PinHysteresis, PinLag, PinLimit, PinSteps,
    };
    for reading in
        [PinLag, PinLimit, PinSteps, PinHysteresis, LateIterations, LostFrames, LateFrames, Latency]
    {
        let read = LIBRARY.iter().filter(|spec| spec.signature.reading == Some(reading)).count();
        assert_eq!(read, 1, "{reading:?}");
        assert_eq!(LIBRARY[read_as(reading)].signature.reading, Some(reading));
    }
}

/// A climb to 0.9 m and back to the ground with tilts on the way, then frames and iterations: all that shows.
fn everything_seen(rig: &Rig, dt_s: f64) -> Vec<f64> {
    let mut flight = Flight::new(rig);
    let mut seen = Vec::new();
    for (thrust_to_weight, tilt_rad, duration_s) in [
        (0.9, 0.0, 0.1),
        (1.3, 0.2, 0.4),
        (1.05, -0.2, 0.5),
        (0.8, 0.1, 0.6),
        (0.4, 0.0, 0.4),
        (1.1, 0.0, 0.5),
    ] {
        let mut held = sticks(rig, thrust_to_weight);
        held.pitch += tilt_rad / rig.airframe.sticks.tilt_rad_per_unit;
        for _ in 0..(duration_s / 0.1_f64).round() as u32 {
            flight.hold(0.1, dt_s, held);
            seen.extend(flight.body.position_m().iter());
            seen.extend(flight.body.velocity_m_s().iter());
            seen.push(flight.free_thrust_n);
        }
    }
    seen.extend(frames_and_timing(&mut flight.effects));
    seen
}

fn frames_and_timing(effects: &mut Effects) -> Vec<f64> {
    let mut seen = Vec::new();
    for _ in 0..500 {
        let mut frame = Frame { position_m: Vector3::new(0.1, -0.2, 0.4), latency_s: 0.3, lost: false };
        for effect in &mut effects.tracker {
            effect.expose(&mut frame);
        }
        seen.extend(frame.position_m.iter());
        seen.extend([frame.latency_s, f64::from(u8::from(frame.lost))]);
        seen.extend(effects.timing.iter_mut().map(|effect| effect.lateness_s()).filter(|late| *late != 0.0));
    }
    seen
}

#[test]
fn neutral_values_leave_everything_as_it_is_to_the_last_bit() {
    for model in [Model::Vertical, Model::SixDegree] {
        let nominal = everything_seen(&rig(model), 0.005);
        for spec in LIBRARY.iter().copied() {
            let values: Vec<_> =
                spec.parameters.iter().map(|p| p.neutral.unwrap_or(p.prior.typical())).collect();
            let mut rig = rig(model);
            rig.effects.push(entry(spec, &values));
            assert_eq!(everything_seen(&rig, 0.005), nominal, "{} {model:?}", spec.name);
        }
    }
}

#[test]
fn typical_values_can_be_seen() {
    let nominal = everything_seen(&rig(Model::SixDegree), 0.005);
    for spec in LIBRARY.iter().copied() {
        let mut rig = rig(Model::SixDegree);
        rig.effects.push(entry(spec, &typical(spec)));
        assert_ne!(everything_seen(&rig, 0.005), nominal, "{}", spec.name);
    }
}

#[test]
fn the_ends_of_every_range_keep_a_hop_finite() {
    for spec in LIBRARY.iter().copied() {
        // Every combination of lowest and highest values.
        for ends in 0..1_u32 << spec.parameters.len() {
            let values: Vec<_> = spec
                .parameters
                .iter()
                .enumerate()
                .map(|(i, p)| if ends >> i & 1 == 0 { p.min } else { p.max })
                .collect();
            for model in [Model::Vertical, Model::SixDegree] {
                let mut rig = rig(model);
                rig.effects.push(entry(spec, &values));
                let seen = everything_seen(&rig, 0.005);
                assert!(seen.iter().all(|x| x.is_finite()), "{} {values:?} {model:?}", spec.name);
            }
        }
    }
}

#[test]
fn the_same_seed_draws_the_same_and_another_effect_does_not_disturb_it() {
    let mut alone = rig(Model::Vertical);
    alone.effects.push(entry(LIBRARY[3], &typical(LIBRARY[3])));
    let mut accompanied = alone.clone();
    accompanied.effects.push(entry(LIBRARY[1], &typical(LIBRARY[1])));
    let positions = |rig: &Rig, seed| {
        let mut effects = Effects::from_rig(rig, seed).unwrap();
        (0..100)
            .map(|_| {
                let mut frame = Frame { position_m: Vector3::zeros(), latency_s: 0.3, lost: false };
                for effect in &mut effects.tracker {
                    effect.expose(&mut frame);
                }
                frame.position_m
            })
            .collect::<Vec<_>>()
    };
    assert_eq!(positions(&alone, 1), positions(&alone, 1));
    assert_eq!(positions(&alone, 1), positions(&accompanied, 1));
    assert_ne!(positions(&alone, 1), positions(&alone, 2));
}

#[test]
fn a_body_at_rest_stays_at_rest_under_every_typical_effect() {
    for spec in LIBRARY.iter().copied() {
        let mut rig = rig(Model::SixDegree);
        rig.effects.push(entry(spec, &typical(spec)));
        let mut flight = Flight::new(&rig);
        flight.hold(0.5, 0.01, sticks(&rig, 0.0));
        let Body::SixDegree(body) = &flight.body else { unreachable!() };
        assert_eq!(body.velocity_m_s, Vector3::zeros(), "{}", spec.name);
        assert_eq!(body.position_m.z, 0.0, "{}", spec.name);
    }
}
