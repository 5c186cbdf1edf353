//! Parameters that are drawn: each from a stream of its own, so that what a run draws depends on no other run.

use bench_plant::effects::{Parameter, Prior};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use sha2::{Digest as _, Sha256};

/// How a parameter comes about.
#[derive(Clone, Debug, PartialEq)]
pub enum Draw {
    /// It is given.
    Fixed(f64),
    /// Each of these makes a variant.
    Grid(Vec<f64>),
    /// From what the library expects.
    Prior,
    /// Evenly, from the first to the second.
    Uniform([f64; 2]),
    /// Evenly in the logarithm, from the first to the second, both above 0.
    LogUniform([f64; 2]),
    /// From a normal distribution.
    Normal {
        /// Its mean.
        mean: f64,
        /// Its standard deviation.
        sigma: f64,
    },
}

impl Draw {
    /// As text that is the same on every machine.
    pub(crate) fn definition(&self) -> String {
        match self {
            Self::Fixed(x) => format!("{x:?}"),
            Self::Grid(values) => format!("{values:?}"),
            Self::Prior => "prior".to_owned(),
            Self::Uniform(ends) => format!("uniform{ends:?}"),
            Self::LogUniform(ends) => format!("log-uniform{ends:?}"),
            Self::Normal { mean, sigma } => format!("normal[{mean:?}, {sigma:?}]"),
        }
    }

    /// How many variants it makes.
    pub(crate) fn points(&self) -> u64 {
        if let Self::Grid(values) = self { values.len() as u64 } else { 1 }
    }

    /// The least and the greatest that it says; `None` where the library says it.
    pub(crate) fn ends(&self) -> Option<[f64; 2]> {
        match self {
            Self::Fixed(x) => Some([*x, *x]),
            Self::Grid(values) => Some(
                values
                    .iter()
                    .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| [low.min(*x), high.max(*x)]),
            ),
            Self::Prior => None,
            Self::Uniform(ends) | Self::LogUniform(ends) => Some(*ends),
            // Its tails are cut at the parameter's range.
            Self::Normal { mean, .. } => Some([*mean, *mean]),
        }
    }

    /// The value for a seed and, of a grid, a point below [`Draw::points`]; within the parameter's range.
    pub(crate) fn value(&self, effect: &str, parameter: &Parameter, seed: u64, point: u64) -> f64 {
        let mut rng = stream(effect, parameter.key, seed);
        let drawn = match self {
            Self::Fixed(x) => return *x,
            Self::Grid(values) => return values[point as usize],
            Self::Uniform([low, high]) => low + (high - low) * rng.random::<f64>(),
            Self::LogUniform([low, high]) => low * (high / low).powf(rng.random::<f64>()),
            Self::Normal { mean, sigma } => mean + sigma * rng.sample::<f64, _>(StandardNormal),
            Self::Prior => {
                let deviations: f64 = rng.sample(StandardNormal);
                match parameter.prior {
                    Prior::Normal { mean, sigma } => mean + sigma * deviations,
                    Prior::LogNormal { median, sigma_ln } => median * (sigma_ln * deviations).exp(),
                }
            }
        };
        rounded(drawn).clamp(parameter.min, parameter.max)
    }
}

fn stream(effect: &str, key: &str, seed: u64) -> ChaCha8Rng {
    let hash = Sha256::digest(format!("bench.sweep.draw/1\n{effect}\n{key}\n{seed}"));
    ChaCha8Rng::from_seed(hash.into())
}

/// Six significant digits: libraries of mathematics differ in the last ones, and a command line stays readable.
fn rounded(x: f64) -> f64 {
    // What was just written reads back.
    format!("{x:.5e}").parse().unwrap_or(x)
}

#[cfg(test)]
mod tests {
    use bench_plant::effects::{LIBRARY, index_of};

    use super::*;

    fn parameter() -> &'static Parameter {
        &LIBRARY[index_of("rotor-lag").unwrap()].parameters[0]
    }

    fn drawn(draw: &Draw, count: u64) -> Vec<f64> {
        let mut drawn: Vec<f64> =
            (0..count).map(|seed| draw.value("rotor-lag", parameter(), seed, 0)).collect();
        drawn.sort_by(f64::total_cmp);
        drawn
    }

    /// By Kolmogorov and Smirnov, 1,000 draws leave their distribution by more than 1.95 / sqrt(1000) once in a thousand times.
    fn follows(drawn: &[f64], distribution: impl Fn(f64) -> f64) {
        let n = drawn.len() as f64;
        let off = |(i, x): (usize, &f64)| (distribution(*x) - (i as f64 + 0.5) / n).abs();
        let most = drawn.iter().enumerate().map(off).fold(0.0, f64::max);
        assert!(most < 1.95 / n.sqrt(), "{most}");
    }

    #[test]
    fn what_is_drawn_follows_its_distribution() {
        follows(&drawn(&Draw::Uniform([0.1, 0.3]), 1000), |x| (x - 0.1) / 0.2);
        follows(&drawn(&Draw::LogUniform([0.01, 1.0]), 1000), |x| (x / 0.01).ln() / 100_f64.ln());
        let Prior::LogNormal { median, .. } = parameter().prior else { panic!("the prior is log-normal") };
        let below = drawn(&Draw::Prior, 1000).iter().filter(|x| **x < median).count();
        // Four deviations of a binomial with a half.
        assert!(below.abs_diff(500) < 64, "{below}");
        let normal = drawn(&Draw::Normal { mean: 0.5, sigma: 0.1 }, 1000);
        let mean = normal.iter().sum::<f64>() / 1000.0;
        assert!((mean - 0.5).abs() < 4.0 * 0.1 / 1000_f64.sqrt(), "{mean}");
    }

    #[test]
    fn a_draw_stays_in_range_and_is_of_six_digits() {
        let wide = Draw::Normal { mean: 0.1, sigma: 1e3 };
        let Parameter { min, max, .. } = *parameter();
        assert!(drawn(&wide, 100).iter().all(|x| (min..=max).contains(x)));
        let x = Draw::Uniform([0.1, 0.3]).value("rotor-lag", parameter(), 7, 0);
        assert!(format!("{x}").len() <= 8, "{x}");
    }
}
