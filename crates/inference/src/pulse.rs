//! Thrust that is missing for moments: pushes one way that come now and then, which neither a law nor wind explains.
//!
//! The smoother gives for each measurement what a sudden change of speed just before it would gain (auxiliary residuals:
//! de Jong, *Smoothing and interpolation with the state-space model*, Journal of the American Statistical Association
//! 84, 1989; Harvey and Koopman, *Diagnostic checking of unobserved-components time series models*, Journal of Business
//! and Economic Statistics 10, 1992). Wind pushes either way: only what is one-sided counts.

use bench_filter::{Covariance, Knot, Noise, State, added, backward, knots};
use nalgebra::{Matrix4, Vector4};
use rayon::prelude::*;
use statrs::function::erf::erfc;

use crate::fit::{Fit, Problem};

/// At most one push is looked for in each span of such a length, s.
const SPAN_S: f64 = 1.0; // numerical
/// For how long pushes last that are tried, s; what they change speed by, m/s; and the probability of one in a span.
const LENGTHS_S: [f64; 2] = [0.0, 0.4]; // numerical
const SPEEDS_M_S: [f64; 4] = [0.03, 0.07, 0.15, 0.35]; // numerical
const PROBABILITIES: [f64; 4] = [0.01, 0.04, 0.15, 0.4]; // numerical
/// So many choices, the two signs among them, are worth their logarithm in nats.
const CHOICES: usize = 2 * CALMER.len() * LENGTHS_S.len() * SPEEDS_M_S.len() * PROBABILITIES.len(); // numerical

/// Turbulence that is tried, over the fit's, which may have taken pushes in.
const CALMER: [f64; 3] = [1.0, 0.5, 0.25]; // numerical

/// Gain of log-evidence, nats, of pushes one way on top of a fit, beyond what pushes the other way would gain; 0 for none.
pub fn pulses(problem: &Problem<'_>, fit: &Fit) -> f64 {
    let gains = CALMER.par_iter().map(|calmer| {
        let noise = Noise { turbulence: calmer * fit.noise.turbulence, ..fit.noise };
        let price = problem.objective(&fit.point, &noise, &fit.free) - fit.objective;
        pulses_in(problem, fit, &noise) - if *calmer < 1.0 { price } else { 0.0 }
    });
    gains.reduce(|| 0.0, f64::max)
}

/// The same in noise other than the fit's.
fn pulses_in(problem: &Problem<'_>, fit: &Fit, noise: &Noise) -> f64 {
    let noise = added(&fit.point, noise, problem.rig);
    let flights: Vec<Vec<Place>> = problem
        .tracks
        .par_iter()
        .map(|track| {
            let knots = knots(track, problem.rig, &fit.point, &noise);
            knots.iter().zip(&backward(&knots)).map(|(knot, smoothed)| Place::of(knot, smoothed)).collect()
        })
        .collect();
    let shocks = LENGTHS_S.map(|length_s| -> Vec<Vec<Shock>> {
        flights.iter().flat_map(|places| spans(places, length_s)).filter(|span| !span.is_empty()).collect()
    });
    let gain = |sign: f64| {
        let mut best = 0.0_f64;
        for spans in &shocks {
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
        }
        best
    };
    let (down, up) = (gain(-1.0), gain(1.0));
    (down.max(up) - 1.5 * down.min(up) - (CHOICES as f64).ln()).max(0.0)
}

/// What a flight tells of pushes that last for so long and begin in each of its spans.
fn spans(places: &[Place], length_s: f64) -> Vec<Vec<Shock>> {
    let mut spans: Vec<Vec<Shock>> = Vec::new();
    let mut begin_s = f64::MIN;
    for (i, place) in places.iter().enumerate() {
        if place.time_s >= begin_s + SPAN_S {
            begin_s = place.time_s;
            spans.push(Vec::new());
        }
        let lasting = places[i..].iter().take_while(|other| other.time_s <= place.time_s + length_s).count();
        if let (Some(span), Some(shock)) = (spans.last_mut(), Shock::over(&places[i..i + lasting])) {
            span.push(shock);
        }
    }
    spans
}

/// What the flight tells, at one measurement, of a sudden change of the state before it.
struct Place {
    time_s: f64,
    /// None near ground or ceiling.
    told: Option<Told>,
}

struct Told {
    /// Gradient of the log-likelihood by the change, and its information.
    gradient: Vector4<f64>,
    information: Matrix4<f64>,
    /// What the measurement leaves of the change.
    left: Matrix4<f64>,
    /// How the state moved here from the measurement before.
    transition: Matrix4<f64>,
}

impl Place {
    fn of(knot: &Knot, (x, p): &(State, Covariance)) -> Self {
        let clear_m = knot.predicted.0[0].min(x[0]).min(knot.seen_m).min(knot.below_ceiling_m);
        let told = || {
            if knot.is_cut() || clear_m < CLEAR_M {
                return None;
            }
            let matrix = |m: &Covariance| Matrix4::from_fn(|i, j| m[i][j]);
            let (predicted, spread) = (Vector4::from(knot.predicted.0), matrix(&knot.predicted.1));
            let inverse = (spread + Matrix4::identity() * 1e-14).try_inverse()?;
            Some(Told {
                gradient: inverse * (Vector4::from(*x) - predicted),
                information: inverse * (spread - matrix(p)) * inverse,
                left: matrix(&knot.filtered.1) * inverse,
                transition: matrix(&knot.transition),
            })
        };
        Self { time_s: knot.time_s, told: told() }
    }
}

/// What the flight tells of a change of speed, sudden or in equal parts before measurements in a row: gradient of the log-likelihood by it,
/// s/m, and its information, s^2/m^2.
struct Shock {
    gradient: f64,
    information: f64,
}

/// Evidence is capped so that its exponential is finite.
const MOST_NATS: f64 = 300.0;

/// Nearer the ground, legs and floor push too, and nearer a ceiling that, m.
const CLEAR_M: f64 = 0.12;

impl Shock {
    fn over(places: &[Place]) -> Option<Self> {
        let share = (places.len() as f64).recip();
        let part = Vector4::new(0.0, share, 0.0, 0.0);
        let (mut gradient, mut information) = (0.0, 0.0);
        // What the parts so far have made of the state before a measurement.
        let mut moved = Vector4::zeros();
        let mut left = Matrix4::zeros();
        for place in places {
            let told = place.told.as_ref()?;
            moved = told.transition * left * moved;
            gradient += part.dot(&told.gradient);
            information += part.dot(&(told.information * (part + 2.0 * moved)));
            moved += part;
            left = told.left;
        }
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
