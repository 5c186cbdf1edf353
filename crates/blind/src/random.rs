//! Random numbers: one stream a purpose, so that switching one thing on changes no other draw.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

pub(crate) type Random = ChaCha8Rng;

/// The stream of a purpose: seed, case, flight and purpose are the generator's whole key.
pub(crate) fn stream(seed: u64, case: u64, flight: u64, purpose: u64) -> Random {
    let mut key = [0; 32];
    for (bytes, number) in key.chunks_exact_mut(8).zip([seed, case, flight, purpose]) {
        bytes.copy_from_slice(&number.to_le_bytes());
    }
    ChaCha8Rng::from_seed(key)
}

pub(crate) fn normal(random: &mut Random) -> f64 {
    StandardNormal.sample(random)
}

/// A standard normal number within `bound` of zero.
pub(crate) fn normal_within(random: &mut Random, bound: f64) -> f64 {
    loop {
        let x = normal(random);
        if x.abs() <= bound {
            return x;
        }
    }
}

pub(crate) fn uniform(random: &mut Random, low: f64, high: f64) -> f64 {
    low + (high - low) * random.random::<f64>()
}

/// Uniform in the logarithm; both ends above zero.
pub(crate) fn log_uniform(random: &mut Random, low: f64, high: f64) -> f64 {
    uniform(random, low.ln(), high.ln()).exp()
}

/// Exponential with mean one.
pub(crate) fn exponential(random: &mut Random) -> f64 {
    -(1.0 - random.random::<f64>()).ln()
}

pub(crate) fn happens(random: &mut Random, probability: f64) -> bool {
    random.random::<f64>() < probability
}

/// 1 or -1.
pub(crate) fn sign(random: &mut Random) -> f64 {
    if happens(random, 0.5) { 1.0 } else { -1.0 }
}

/// One of the numbers below `count`, which is above zero.
pub(crate) fn below(random: &mut Random, count: usize) -> usize {
    random.random_range(0..count)
}

/// Puts the items into random order (Fisher and Yates).
pub(crate) fn shuffle<T>(random: &mut Random, items: &mut [T]) {
    for last in (1..items.len()).rev() {
        items.swap(last, below(random, last + 1));
    }
}
