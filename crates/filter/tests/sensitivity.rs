//! The sensitivities of the innovations are what finite differences of them say.

use std::path::Path;

use bench_filter::{Coordinate, Direction, Input, Measurement, Noise, Point, Track, is_random, predict, run};
use bench_plant::effects::{LIBRARY, Stage};
use bench_rig::Rig;

fn rig() -> Rig {
    Rig::load(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs/virtual.toml")).unwrap()
}

/// Ten seconds from 0.4 m on, with a throttle that swings and steps about the one that hovers, seen as a point predicts it: the
/// innovations there are zero, so that gains which change with a parameter change nothing.
fn track(rig: &Rig, point: &Point, noise: &Noise) -> Track {
    let hover = rig.airframe.throttle_for(rig.airframe.weight_n());
    let inputs = (0..100)
        .map(|k| {
            let time_s = 0.1 * f64::from(k);
            let step = if k % 40 < 20 { 0.004 } else { -0.004 };
            Input { time_s, throttle: hover * (1.0 + 0.012 * (1.7 * time_s).sin() + step) }
        })
        .collect();
    let measurements = (0..300).map(|k| {
        let exposed_s = 0.05 + f64::from(k) / 30.0;
        Measurement { exposed_s, believed_s: exposed_s, z_m: 0.4, counts: k > 0, carried: k == 0 }
    });
    let mut track = Track { inputs, measurements: measurements.collect(), end_s: 10.0, ..Track::default() };
    // A measurement moves those after it alone: each round leaves one more where it is predicted.
    for _ in 0..300 {
        let predicted = predict(&track, rig, point, noise).innovations;
        let counted = track.measurements.iter_mut().filter(|measurement| measurement.counts);
        for (measurement, innovation) in counted.zip(&predicted) {
            measurement.z_m -= innovation.residual_m;
        }
        if predicted.iter().all(|innovation| innovation.residual_m.abs() < 1e-12) {
            break;
        }
    }
    track
}

/// A push is held over a step, where that of a law with a state of its own changes within it, and a form is moved by a finite
/// step: information, which is the square of a slope, is off by up to 1.4 % (the form of the drag), and by less than 0.4 % for the
/// numbers of the rig.
const ALLOWED: f64 = 0.016;
/// Information below which a flight tells nothing of a coordinate: what is left of a difference of rounded numbers.
const NOTHING: f64 = 1e-6;

/// Slopes of all innovations by a coordinate, over their deviation, by differences: central ones, or one-sided ones where the
/// coordinate may not be less.
fn differences(track: &Track, rig: &Rig, point: &Point, noise: &Noise, at: Coordinate, h: f64) -> Vec<f64> {
    let moved = |h: f64| {
        let mut point = point.clone();
        *point.get_mut(at) += h;
        predict(track, rig, &point, noise).innovations
    };
    let least = match at {
        Coordinate::Nuisance(_) => f64::NEG_INFINITY,
        Coordinate::Effect { slot, parameter } => point.parameter(slot, parameter).min,
    };
    let below = if point.get(at) - h < least { 0.0 } else { h };
    let pairs = moved(h).into_iter().zip(moved(-below));
    pairs.map(|(up, down)| (up.residual_m - down.residual_m) / (h + below) / up.variance_m2.sqrt()).collect()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Holds the information over coordinates, each with a step, against that of finite differences, for what `about` names.
fn hold(point: &Point, coordinates: &[(Coordinate, f64)], about: &str) {
    let rig = rig();
    let noise = Noise::nominal(&rig);
    let track = track(&rig, point, &noise);
    let directions: Vec<Direction> =
        coordinates.iter().map(|(at, h)| Direction::Coordinate(*at, *h)).collect();
    let pass = run(std::slice::from_ref(&track), &rig, point, &noise, &directions);
    let slopes: Vec<Vec<f64>> =
        coordinates.iter().map(|(at, h)| differences(&track, &rig, point, &noise, *at, *h)).collect();
    for (i, a) in slopes.iter().enumerate() {
        for (j, b) in slopes.iter().enumerate() {
            let scale = (dot(a, a) * dot(b, b)).sqrt();
            if scale < NOTHING {
                assert!(pass.information[(i, j)].abs() < NOTHING, "{about}: {:?}", coordinates[i].0);
                continue;
            }
            let off = (pass.information[(i, j)] - dot(a, b)).abs() / scale;
            assert!(off < ALLOWED, "{about}: {:?} with {:?}: {off}", coordinates[i].0, coordinates[j].0);
        }
    }
    // Flights that are as predicted pull nowhere.
    for (i, slope) in slopes.iter().enumerate() {
        assert!(pass.gradient[i].abs() < 1e-3 * dot(slope, slope).sqrt().max(1e-12), "{about}: {i}");
    }
}

#[test]
fn information_over_the_numbers_of_the_rig_is_that_of_finite_differences() {
    let (point, sigma) = Point::nominal(&rig());
    let free: Vec<(Coordinate, f64)> = sigma
        .iter()
        .filter(|(_, sigma)| **sigma > 0.0)
        .map(|(number, sigma)| (Coordinate::Nuisance(number), 0.03 * sigma))
        .collect();
    assert!(free.len() > 3);
    hold(&point, &free, "the rig's numbers");
}

#[test]
fn information_over_the_parameters_of_each_law_is_that_of_finite_differences() {
    let (nominal, _) = Point::nominal(&rig());
    let mut held = 0;
    for (effect, spec) in LIBRARY.iter().enumerate() {
        if is_random(effect) || matches!(spec.stage, Stage::Loop) {
            continue;
        }
        let values: Vec<f64> =
            spec.parameters.iter().map(|p| p.default.unwrap_or(p.prior.typical())).collect();
        let coordinates: Vec<(Coordinate, f64)> = spec
            .parameters
            .iter()
            .enumerate()
            .map(|(parameter, p)| {
                let size = 0.003 * values[parameter].abs().max(p.prior.typical().abs()).max(1e-3);
                (Coordinate::Effect { slot: 0, parameter }, size)
            })
            .collect();
        let point = Point { effects: vec![(effect, values)], ..nominal.clone() };
        hold(&point, &coordinates, spec.name);
        held += 1;
    }
    assert!(held > 12, "{held}");
}
