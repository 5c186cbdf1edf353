//! How large the gap is, and how far it shrinks: on flights left out of the fit, with intervals over flights.

use bench_filter::{Noise, Point, Prediction, Track, is_random, predict};
use bench_inference::{Consistency, Fit, Problem};
use bench_statistics::bootstrap;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::Serialize;

/// A figure with its interval of 90 % over flights; equal ends where there is one flight.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Figure {
    /// The figure.
    pub value: f64,
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

impl Figure {
    /// A figure of all flights with its interval over resampled ones, which holds the figure itself.
    pub(crate) fn over_flights<T>(seed: u64, flights: &[T], of: impl Fn(&[&T]) -> f64) -> Self {
        const RESAMPLES: usize = 400; // numerical
        let value = of(&flights.iter().collect::<Vec<_>>());
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let drawn = bootstrap(&mut rng, flights, RESAMPLES, |drawn| Some(of(drawn)));
        // A twentieth of the draws lies beyond either end.
        let [low, high] = drawn.trimmed_range(20).unwrap_or([value; 2]); // unit
        Self { value, low: low.min(value), high: high.max(value) }
    }
}

/// The gap at four levels: the rig as it is, its numbers re-fitted, with the effect, and what is left to noise.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Gap {
    /// Negative log-likelihood a measurement.
    pub metric: &'static str,
    /// The rig as it is.
    pub nominal: Figure,
    /// The rig's numbers re-fitted within their tolerances.
    pub parameters_only: Figure,
    /// With the best effect, numbers re-fitted.
    pub with_effect: Figure,
    /// What a right model would score.
    pub floor: Figure,
    /// Share of the gap above the floor that the effect's law closes beyond the re-fit; absent where re-fitted numbers
    /// leave no gap that stands out over flights, or no law of flight is named.
    pub closure: Option<Figure>,
    /// Whether each flight was predicted by a fit to the others.
    pub held_out: bool,
    /// RMS prediction errors, m, at 0.5, 1 and 2 s.
    pub k_step_m: KStep,
    /// The same flight by flight.
    pub flights: Vec<FlightGap>,
}

/// RMS prediction errors at 0.5, 1 and 2 s, m; `null` where flights are too short.
#[derive(Clone, Debug, Default, Serialize)]
pub struct KStep {
    /// The rig as it is.
    pub nominal: [Option<Figure>; 3],
    /// Its numbers re-fitted.
    pub parameters_only: [Option<Figure>; 3],
    /// With the best effect.
    pub with_effect: [Option<Figure>; 3],
}

/// One flight's gap.
#[derive(Clone, Debug, Serialize)]
pub struct FlightGap {
    /// Its name.
    pub name: String,
    /// Measurements held against a prediction.
    pub measurements: usize,
    /// Negative log-likelihood a measurement: the rig as it is, re-fitted, with the effect, floor.
    pub nll: [f64; 4],
    /// How the rig as it is predicts it.
    pub nominal: Consistency,
    /// How the best hypothesis predicts it.
    pub with_effect: Consistency,
}

/// Fewest flights of which one can be left out.
const LEAST_FLIGHTS: usize = 3;

/// What one flight adds up to at the levels rig, re-fitted, with effect.
struct Sums {
    measurements: f64,
    nll: [f64; 3],
    floor: f64,
    /// Level, horizon: sum of squares and number.
    predictions: [[(f64, f64); 3]; 3],
}

/// Measures the gap of the null and of a better fit.
pub fn gap(problem: &Problem<'_>, null: &Fit, best: &Fit) -> Gap {
    let held_out = problem.tracks.len() >= LEAST_FLIGHTS;
    // All levels at the same noise, or a level could pay for its errors by calling them noise; unless noise is the
    // effect.
    let with_effect = best.full_noise(problem);
    let without = Noise {
        jitter_s: null.noise.jitter_s,
        outlier_probability: null.noise.outlier_probability,
        outlier_m: null.noise.outlier_m,
        stale_probability: null.noise.stale_probability,
        stale_frames: null.noise.stale_frames,
        ..if best.random.is_empty() { with_effect } else { null.noise }
    };
    let flown: Vec<[Prediction; 3]> = (0..problem.tracks.len())
        .into_par_iter()
        .map(|i| {
            let track = &problem.tracks[i];
            let fly = |point: &Point, noise: &Noise| predict(track, problem.rig, point, noise);
            let point = |fit: &Fit| if held_out { fit.point_without(i) } else { fit.point.clone() };
            [fly(&problem.nominal, &without), fly(&point(null), &without), fly(&point(best), &with_effect)]
        })
        .collect();
    let sums: Vec<Sums> = flown.iter().map(sums).collect();
    let flights = problem
        .tracks
        .iter()
        .zip(&flown)
        .zip(&sums)
        .map(|((track, passes), sums)| flight_gap(track, passes, sums));
    let level = |k: usize| figure(&sums, |all| total(all, |s| s.nll[k]) / total(all, |s| s.measurements));
    let floor_of = |all: &[&Sums]| total(all, |s| s.floor) / total(all, |s| s.measurements);
    let closure_of = |all: &[&Sums]| {
        let n = total(all, |s| s.measurements);
        let (before, after) = (total(all, |s| s.nll[1]) / n, total(all, |s| s.nll[2]) / n);
        let above = before - floor_of(all);
        if above > 1e-6 { ((before - after) / above).clamp(-1.0, 1.0) } else { 0.0 }
    };
    let left = figure(&sums, |all| total(all, |s| s.nll[1] - s.floor));
    let has_law = best.point.effects.iter().any(|(effect, _)| !is_random(*effect));
    let k_step = |k: usize| {
        [0, 1, 2].map(|h| {
            let rms = |all: &[&Sums]| {
                (total(all, |s| s.predictions[k][h].0) / total(all, |s| s.predictions[k][h].1).max(1.0))
                    .sqrt()
            };
            (sums.iter().any(|s| s.predictions[k][h].1 > 0.0)).then(|| figure(&sums, rms))
        })
    };
    Gap {
        metric: "mean negative log-likelihood of a measurement, nats",
        nominal: level(0),
        parameters_only: level(1),
        with_effect: level(2),
        floor: figure(&sums, floor_of),
        closure: (has_law && left.low > 0.0).then(|| figure(&sums, closure_of)),
        held_out,
        k_step_m: KStep { nominal: k_step(0), parameters_only: k_step(1), with_effect: k_step(2) },
        flights: flights.collect(),
    }
}

fn total(all: &[&Sums], of: impl Fn(&Sums) -> f64) -> f64 {
    all.iter().map(|s| of(s)).sum()
}

/// A figure of all flights, and its spread over resampled flights.
fn figure(sums: &[Sums], of: impl Fn(&[&Sums]) -> f64) -> Figure {
    Figure::over_flights(1, sums, of)
}

fn sums(passes: &[Prediction; 3]) -> Sums {
    let right = &passes[2].innovations;
    Sums {
        measurements: right.len() as f64,
        // Of measurements alone: what was felt on board is another unit.
        nll: [0, 1, 2].map(|k| passes[k].innovations.iter().map(|i| i.nll).sum()),
        floor: right.iter().map(|i| 0.5 + 0.5 * i.variance_m2.ln()).sum(),
        predictions: [0, 1, 2].map(|k| passes[k].k_step.map(|(sum, n)| (sum, f64::from(n)))),
    }
}

fn flight_gap(track: &Track, passes: &[Prediction; 3], sums: &Sums) -> FlightGap {
    let n = sums.measurements.max(1.0);
    FlightGap {
        name: track.name.clone(),
        measurements: passes[2].innovations.len(),
        nll: [sums.nll[0] / n, sums.nll[1] / n, sums.nll[2] / n, sums.floor / n],
        nominal: Consistency::of(&passes[0].innovations),
        with_effect: Consistency::of(&passes[2].innovations),
    }
}
