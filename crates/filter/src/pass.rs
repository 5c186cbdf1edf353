//! One pass of the filter over the flights: what is asked of it, and no more.

use bench_rig::Rig;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use crate::{
    direction::Direction,
    filter::{LearnsFrom, fly},
    innovation::{Innovation, Innovations},
    k_step::KStepPredictors,
    law::Point,
    noise::Noise,
    perturbed::{Pairs, Sensitivities},
    probe::Probes,
    smooth::{Knot, Knots},
    track::Track,
};

/// Likelihood of all flights with its derivatives.
#[derive(Clone, Debug, Default)]
pub struct Pass {
    /// Negative log-likelihood.
    pub nll: f64,
    /// The same with other noise: [`crate::PROBES`].
    pub noise_nll: [f64; 4],
    /// Gradient of the log-likelihood, in the order of the directions.
    pub gradient: DVector<f64>,
    /// Fisher information, rows and columns in the order of the directions.
    pub information: DMatrix<f64>,
    /// The same of each track.
    pub tracks: Vec<TrackPass>,
}

/// One track's share of a pass.
#[derive(Clone, Debug, Default)]
pub struct TrackPass {
    /// Negative log-likelihood.
    pub nll: f64,
    /// The same with other noise.
    pub noise_nll: [f64; 4],
    /// Gradient of the log-likelihood.
    pub gradient: DVector<f64>,
    /// Fisher information.
    pub information: DMatrix<f64>,
}

/// A track as it is predicted.
#[derive(Clone, Debug, Default)]
pub struct Prediction {
    /// Negative log-likelihood.
    pub nll: f64,
    /// Every innovation that counts.
    pub innovations: Vec<Innovation>,
    /// Sum of squared errors, m^2, of predictions over each of [`crate::HORIZONS_S`] from the filtered state, with their number.
    pub k_step: [(f64, u32); 3],
}

/// Every innovation that counts, track by track.
pub fn innovations(predictions: &[Prediction]) -> impl Iterator<Item = &Innovation> {
    predictions.iter().flat_map(|track| &track.innovations)
}

/// Runs the filter over all tracks at a point, with derivatives along directions.
pub fn run(tracks: &[Track], rig: &Rig, point: &Point, noise: &Noise, directions: &[Direction]) -> Pass {
    run_for(tracks, rig, point, noise, directions, Pairs::All)
}

/// The same with the information of some pairs of directions alone.
pub fn run_for(
    tracks: &[Track],
    rig: &Rig,
    point: &Point,
    noise: &Noise,
    directions: &[Direction],
    pairs: Pairs,
) -> Pass {
    let flown: Vec<TrackPass> =
        tracks.par_iter().map(|track| run_track(track, rig, point, noise, directions, pairs)).collect();
    // In the tracks' order, so that sums do not depend on who finished first.
    let n = directions.len();
    let mut pass = Pass { gradient: DVector::zeros(n), information: DMatrix::zeros(n, n), ..Pass::default() };
    for one in flown {
        pass.nll += one.nll;
        for (sum, x) in pass.noise_nll.iter_mut().zip(one.noise_nll) {
            *sum += x;
        }
        pass.gradient += &one.gradient;
        pass.information += &one.information;
        pass.tracks.push(one);
    }
    pass
}

fn run_track(
    track: &Track,
    rig: &Rig,
    point: &Point,
    noise: &Noise,
    directions: &[Direction],
    pairs: Pairs,
) -> TrackPass {
    let probes = Probes::around(&noise.times(track.ln_noise.exp()));
    let mut passengers = (Sensitivities::new(point, rig, directions, pairs), probes);
    let nll = fly(track, rig, point, noise, LearnsFrom::All, &mut passengers);
    let (sensitivities, probes) = passengers;
    let (gradient, information) = sensitivities.into_sums();
    TrackPass { nll, noise_nll: probes.nll(), gradient, information }
}

/// Negative log-likelihood of one track, but for constants.
pub fn nll(track: &Track, rig: &Rig, point: &Point, noise: &Noise) -> f64 {
    fly(track, rig, point, noise, LearnsFrom::All, &mut ())
}

/// The same of all tracks.
pub fn nll_of_all(tracks: &[Track], rig: &Rig, point: &Point, noise: &Noise) -> f64 {
    let each: Vec<f64> = tracks.par_iter().map(|track| nll(track, rig, point, noise)).collect();
    each.into_iter().sum()
}

/// A track as a point predicts it: innovations, and errors over several seconds.
pub fn predict(track: &Track, rig: &Rig, point: &Point, noise: &Noise) -> Prediction {
    let mut passengers = (Innovations::default(), KStepPredictors::from(track.begin_s));
    let nll = fly(track, rig, point, noise, LearnsFrom::All, &mut passengers);
    let (innovations, k_step) = passengers;
    Prediction { nll, innovations: innovations.0, k_step: k_step.errors }
}

/// What the filter knew at each measurement of a track, for the smoother.
pub fn knots(track: &Track, rig: &Rig, point: &Point, noise: &Noise) -> Vec<Knot> {
    let mut knots = Knots::default();
    fly(track, rig, point, noise, LearnsFrom::Tracker, &mut knots);
    knots.into_knots()
}
