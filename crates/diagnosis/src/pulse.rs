//! Thrust that is missing for moments: pushes one way that come now and then, which neither a law nor wind explains.
//!
//! The smoother gives for each sighting what a sudden change of speed just before it would gain (auxiliary residuals:
//! de Jong, *Smoothing and interpolation with the state-space model*, Journal of the American Statistical Association
//! 84, 1989; Harvey and Koopman, *Diagnostic checking of unobserved-components time series models*, Journal of Business
//! and Economic Statistics 10, 1992). Wind pushes either way: only what is one-sided counts.

use nalgebra::{Matrix4, Vector4};
use rayon::prelude::*;
use statrs::function::erf::erfc;

use crate::{
    fit::{Fit, Problem},
    pass::{Covariance, State, trace_track},
    smooth::{Knot, backward},
};

/// At most one push is looked for in each span of such a length, s.
const SPAN_S: f64 = 1.0;
/// Changes of speed that are tried, m/s, and the probability of one in a span.
const SPEEDS_M_S: [f64; 4] = [0.03, 0.07, 0.15, 0.35];
const PROBABILITIES: [f64; 3] = [0.01, 0.04, 0.15];
/// What the choice among sizes, rates and the two signs is worth, nats.
const CHOICE_NATS: f64 = 3.2;

/// Gain of log-evidence, nats, of pushes one way on top of a fit, beyond what pushes the other way would gain; 0 for none.
pub fn pulses(problem: &Problem<'_>, fit: &Fit) -> f64 {
    let noise = fit.full_noise(problem);
    let spans: Vec<Vec<Shock>> = problem
        .tracks
        .par_iter()
        .flat_map_iter(|track| {
            let knots = trace_track(track, problem.rig, &fit.point, &noise);
            let smoothed = backward(&knots);
            let mut spans: Vec<Vec<Shock>> = Vec::new();
            let mut begin_s = f64::MIN;
            for (knot, smoothed) in knots.iter().zip(&smoothed) {
                if knot.time_s >= begin_s + SPAN_S {
                    begin_s = knot.time_s;
                    spans.push(Vec::new());
                }
                if let (Some(span), Some(shock)) = (spans.last_mut(), Shock::of(knot, smoothed)) {
                    span.push(shock);
                }
            }
            spans
        })
        .filter(|span| !span.is_empty())
        .collect();
    let gain = |sign: f64| {
        let mut best = 0.0_f64;
        for speed_m_s in SPEEDS_M_S {
            let odds: Vec<f64> = spans
                .iter()
                .map(|span| {
                    span.iter().map(|shock| shock.odds(sign, speed_m_s)).sum::<f64>() / span.len() as f64
                })
                .collect();
            for p in PROBABILITIES {
                best = best.max(odds.iter().map(|odds| (1.0 - p + p * odds).ln()).sum());
            }
        }
        best
    };
    let (down, up) = (gain(-1.0), gain(1.0));
    (down.max(up) - 1.5 * down.min(up) - CHOICE_NATS).max(0.0)
}

/// What the flight tells of a sudden change of speed before a sighting: gradient of the log-likelihood by it, s/m, and
/// its information, s^2/m^2.
struct Shock {
    gradient: f64,
    information: f64,
}

/// Evidence is capped so that its exponential is finite.
const MOST_NATS: f64 = 300.0;

/// Nearer the ground, legs and floor push too, and nearer a ceiling that, m.
const CLEAR_M: f64 = 0.12;

impl Shock {
    fn of(knot: &Knot, (x, p): &(State, Covariance)) -> Option<Self> {
        let clear_m = knot.predicted.0[0].min(x[0]).min(knot.seen_m).min(knot.below_ceiling_m);
        if knot.is_cut() || clear_m < CLEAR_M {
            return None;
        }
        let matrix = |m: &Covariance| Matrix4::from_fn(|i, j| m[i][j]);
        let (predicted, spread) = (Vector4::from(knot.predicted.0), matrix(&knot.predicted.1));
        let inverse = (spread + Matrix4::identity() * 1e-14).try_inverse()?;
        let gradient = (inverse * (Vector4::from(*x) - predicted))[1];
        let information = (inverse * (spread - matrix(p)) * inverse)[(1, 1)];
        (gradient.is_finite() && information.is_finite() && information > 0.0)
            .then_some(Self { gradient, information })
    }

    /// Odds of a change of this sign, half-normal in size, against none.
    fn odds(&self, sign: f64, speed_m_s: f64) -> f64 {
        let precision = self.information + speed_m_s.powi(-2);
        let (mean, sigma) = (self.gradient / precision, precision.sqrt().recip());
        let gain = 0.5 * self.gradient * mean + (sigma / speed_m_s).ln();
        // Twice the posterior's share on that side: the prior is folded.
        gain.min(MOST_NATS).exp() * erfc(-sign * mean / sigma * std::f64::consts::FRAC_1_SQRT_2)
    }
}
