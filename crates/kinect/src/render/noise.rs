//! Noise that is cheap a pixel: fields drawn once, laid over each frame at a random place.

use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Side of the square fields, a power of two; they repeat at their edges.
pub(super) const SIDE: usize = 512;

/// White noise along a line: standard normal times 32, cut at four sigmas. Longer by a row than its power of two, so that a
/// row can begin anywhere.
pub(super) struct Line(Vec<i8>);

const LINE: usize = 1 << 17;

impl Line {
    pub(super) fn new(rng: &mut ChaCha8Rng) -> Self {
        let mut values: Vec<i8> =
            (0..LINE).map(|_| (normal(rng) * 32.0).clamp(-127.0, 127.0) as i8).collect();
        values.extend_from_within(..1024);
        Self(values)
    }

    /// `length` values, at most 1024, from a place that `at` chooses.
    pub(super) fn from(&self, at: u32, length: usize) -> &[i8] {
        &self.0[at as usize % LINE..][..length]
    }
}

/// Standard normal noise, correlated over neighbours: white noise averaged over squares of `2 reach + 1`.
pub(super) fn field(rng: &mut ChaCha8Rng, reach: usize) -> Vec<f32> {
    let mut values: Vec<f32> = (0..SIDE * SIDE).map(|_| normal(rng) as f32).collect();
    let mut row = vec![0.0; SIDE];
    for stride in [1, SIDE] {
        for line in 0..SIDE {
            let begin = if stride == 1 { line * SIDE } else { line };
            for (i, out) in row.iter_mut().enumerate() {
                *out = (0..=2 * reach).map(|j| values[begin + (i + j) % SIDE * stride]).sum();
            }
            for (i, value) in row.iter().enumerate() {
                values[begin + i * stride] = *value;
            }
        }
    }
    let scale = 1.0 / (2 * reach + 1) as f32;
    for value in &mut values {
        *value *= scale;
    }
    values
}

/// The value below which a share of the field lies.
pub(super) fn quantile(field: &[f32], share: f64) -> f32 {
    let mut sorted = field.to_vec();
    let at = ((sorted.len() as f64 * share) as usize).min(sorted.len() - 1);
    *sorted.select_nth_unstable_by(at, f32::total_cmp).1
}

pub(super) fn normal(rng: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(rng)
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;

    #[test]
    fn a_field_has_unit_deviation_and_the_correlation_of_its_average() {
        let field = field(&mut ChaCha8Rng::seed_from_u64(1), 1);
        let count = field.len() as f32;
        let variance = field.iter().map(|x| x * x).sum::<f32>() / count;
        // 262144 values, nine of which share each draw: one sigma of the variance is about 0.6 %. Five of them.
        assert!((variance - 1.0).abs() < 0.03, "{variance}");
        let beside: f32 = field.chunks(SIDE).flat_map(|row| row.windows(2)).map(|w| w[0] * w[1]).sum();
        // Neighbours share two of three columns.
        assert!((beside / count - 2.0 / 3.0).abs() < 0.03, "{}", beside / count);
        let edge = quantile(&field, 0.1);
        let below = field.iter().filter(|x| **x < edge).count() as f32 / count;
        assert!((below - 0.1).abs() < 1e-4);
    }
}
