//! What is random over a flight: turbulence, gusts, a motor that misses. Drawn on a grid, straight lines between.

use crate::random::{Random, exponential, happens, normal, sign, uniform};

/// The grid's step, s.
pub(crate) const GRID_S: f64 = 0.005;

/// Turbulence that every room has: two low passes in a row, so that the air has no sudden speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Turbulence {
    pub sigma_m_s: f64,
    pub correlation_s: f64,
}

/// Gusts beyond that.
#[derive(Clone, Debug)]
pub(crate) enum Gust {
    /// Dryden's vertical spectrum, second order (MIL-HDBK-1797).
    Dryden { sigma_m_s: f64, correlation_s: f64 },
    /// Three first-order processes whose sum falls off nearly as von Kármán's -5/3.
    Karman { sigma_m_s: f64, correlation_s: f64 },
    /// One-minus-cosine gusts at random times (as certification rules have them).
    Bumps { sigma_m_s: f64, length_s: f64 },
}

/// A motor that misses: how often and for how long.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Miss {
    pub per_s: f64,
    pub length_s: f64,
}

/// A first-order process of variance one, sampled every [`GRID_S`].
fn coloured(count: usize, correlation_s: f64, random: &mut Random) -> Vec<f64> {
    let keep = (-GRID_S / correlation_s).exp();
    let drive = (1.0 - keep * keep).sqrt();
    let mut x = normal(random);
    (0..count)
        .map(|_| {
            x = keep * x + drive * normal(random);
            x
        })
        .collect()
}

/// White noise through two equal low passes, the second one's input mixed in; scaled to variance one.
///
/// `blend` 0 is the smooth process; Dryden's vertical spectrum (1 + 3 w^2)/(1 + w^2)^2 has blend `sqrt 3`.
fn second_order(count: usize, correlation_s: f64, blend: f64, random: &mut Random) -> Vec<f64> {
    let inner = coloured(count, correlation_s, random);
    let step = GRID_S / correlation_s;
    let mut outer = 0.0;
    // Inner variance 1, outer variance 1/2, covariance 1/2 (both of the same pole).
    let (a, b) = (blend, 1.0 - blend);
    let scale = (a * a + 0.5 * b * b + a * b).sqrt();
    // Runs in from rest once through, so that the process begins settled.
    for x in &inner {
        outer += step * (x - outer);
    }
    inner
        .iter()
        .map(|x| {
            outer += step * (x - outer);
            (a * x + b * outer) / scale
        })
        .collect()
}

impl Turbulence {
    pub(crate) fn series(self, count: usize, random: &mut Random) -> Vec<f64> {
        let mut speeds = second_order(count, self.correlation_s, 0.0, random);
        for speed in &mut speeds {
            *speed *= self.sigma_m_s;
        }
        speeds
    }
}

impl Gust {
    /// Deviation of the wind, m/s.
    pub(crate) fn sigma_m_s(&self) -> f64 {
        match *self {
            Self::Dryden { sigma_m_s, .. }
            | Self::Karman { sigma_m_s, .. }
            | Self::Bumps { sigma_m_s, .. } => sigma_m_s,
        }
    }

    pub(crate) fn series(&self, count: usize, random: &mut Random) -> Vec<f64> {
        match *self {
            Self::Dryden { sigma_m_s, correlation_s } => {
                let unit = second_order(count, correlation_s, 3.0_f64.sqrt(), random);
                unit.iter().map(|x| sigma_m_s * x).collect()
            }
            Self::Karman { sigma_m_s, correlation_s } => {
                let mut sum = vec![0.0; count];
                for (share, stretch) in [(0.55_f64, 1.6), (0.33, 0.45), (0.12, 0.12)] {
                    for (total, x) in sum.iter_mut().zip(coloured(count, stretch * correlation_s, random)) {
                        *total += sigma_m_s * share.sqrt() * x;
                    }
                }
                sum
            }
            Self::Bumps { sigma_m_s, length_s } => {
                let mut sum = vec![0.0; count];
                // A bump of height one has mean square 3/8 over its length; there is one every two lengths.
                let height = sigma_m_s / (3.0_f64 / 16.0).sqrt();
                let mut begin_s = length_s * exponential(random);
                while begin_s < count as f64 * GRID_S {
                    let (length, top) = (length_s * uniform(random, 0.6, 1.4), height * sign(random));
                    let first = (begin_s / GRID_S) as usize;
                    for (i, total) in sum.iter_mut().enumerate().skip(first) {
                        let part = (i as f64 * GRID_S - begin_s) / length;
                        if part >= 1.0 {
                            break;
                        }
                        *total += 0.5 * top * (1.0 - (std::f64::consts::TAU * part.max(0.0)).cos());
                    }
                    begin_s += length + length_s * exponential(random);
                }
                sum
            }
        }
    }
}

impl Miss {
    pub(crate) fn series(self, count: usize, random: &mut Random) -> Vec<f64> {
        let mut missing = false;
        (0..count)
            .map(|_| {
                let rate = if missing { 1.0 / self.length_s } else { self.per_s };
                missing ^= happens(random, rate * GRID_S);
                f64::from(u8::from(missing))
            })
            .collect()
    }
}

/// The straight line through a series on the grid.
pub(crate) fn at(series: &[f64], t_s: f64) -> f64 {
    let place = (t_s / GRID_S).max(0.0);
    let index = place as usize;
    match (series.get(index), series.get(index + 1)) {
        (Some(a), Some(b)) => a + (b - a) * (place - index as f64),
        _ => series.last().copied().unwrap_or(0.0),
    }
}
