//! What a figure would be of cases drawn again.

use rand::{Rng, RngExt};

use crate::Sorted;

/// The figures of as many cases drawn again with replacement, `draws` times over: percentiles of them are a percentile bootstrap. Draws
/// for which the figure is not defined are left out. The generator is asked for one index a case, case by case, draw by draw.
///
/// Source: Efron and Tibshirani, An Introduction to the Bootstrap, 1993, chapter 13.
pub fn bootstrap<T>(
    rng: &mut impl Rng,
    cases: &[T],
    draws: usize,
    figure: impl Fn(&[&T]) -> Option<f64>,
) -> Sorted {
    let mut again =
        || -> Vec<&T> { cases.iter().map(|_| &cases[rng.random_range(0..cases.len())]).collect() };
    Sorted::of((0..draws).filter_map(|_| figure(&again())))
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::mean;

    #[test]
    fn the_mean_of_many_cases_spreads_by_its_standard_error() {
        // Ten of each of 0 to 9: a variance of 8.25, of the mean of a hundred 0.0825.
        let cases: Vec<f64> = (0..100).map(|i| f64::from(i % 10)).collect();
        let drawn = bootstrap(&mut ChaCha8Rng::seed_from_u64(1), &cases, 4000, |drawn| {
            mean(drawn.iter().map(|x| **x))
        });
        assert_eq!(drawn.values().len(), 4000);
        let [low, high] = [0.025, 0.975].map(|share| drawn.closest(share).unwrap());
        // Either end of four thousand is known to some 4 % of the half width.
        let half = 1.96 * 0.0825_f64.sqrt();
        assert!((low - 4.5 + half).abs() < 0.15 * half && (high - 4.5 - half).abs() < 0.15 * half);
    }

    #[test]
    fn figures_that_are_not_defined_are_left_out() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        // Of two cases, a draw has both in half of the draws.
        let both = bootstrap(&mut rng, &[1.0, 2.0], 400, |drawn| {
            (drawn[0] != drawn[1]).then(|| drawn[0] + drawn[1])
        });
        // 200, give or take four deviations of ten.
        assert!((160..=240).contains(&both.values().len()) && both.values().iter().all(|sum| *sum == 3.0));
        assert_eq!(
            bootstrap(&mut rng, &[] as &[f64], 3, |drawn| mean(drawn.iter().map(|x| **x))).values(),
            []
        );
    }
}
