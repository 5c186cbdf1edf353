//! Figures with their intervals.

use bench_statistics::{Share, Sorted, bootstrap, mean};
use serde::Serialize;

use crate::random::{self, Random};

/// How often something happened, with Wilson's interval of 95 %.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Rate {
    /// How often.
    pub count: usize,
    /// Out of how many.
    pub of: usize,
    /// The share; absent without cases.
    pub value: Option<f64>,
    /// Lower end of the interval.
    pub low: f64,
    /// Upper end of the interval.
    pub high: f64,
}

impl Rate {
    pub(crate) fn of(outcomes: impl IntoIterator<Item = bool>) -> Self {
        let share = Share::wilson(outcomes);
        let Share { count, of, low, high } = share;
        Self { count, of, value: (of > 0).then(|| share.value()), low, high }
    }
}

/// A figure with the interval of 95 % that cases drawn again from these would give (percentile bootstrap).
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Figure {
    /// The figure; absent where these cases do not define it.
    pub value: Option<f64>,
    /// Lower end of the interval.
    pub low: Option<f64>,
    /// Upper end of the interval.
    pub high: Option<f64>,
    /// From how many cases.
    pub of: usize,
}

const DRAWS: usize = 1000;

impl Figure {
    pub(crate) fn of<T>(cases: &[T], figure: impl Fn(&[&T]) -> Option<f64>) -> Self {
        let as_they_are: Vec<&T> = cases.iter().collect();
        let value = figure(&as_they_are);
        let again = |drawn: &[&T]| value.and_then(|_| figure(drawn));
        Self::between(value, &bootstrap(&mut generator(), cases, DRAWS, again), cases.len())
    }

    /// The mean of draws, and where 95 % of them lie.
    pub(crate) fn of_draws(of: usize, draw: impl Fn(&mut Random) -> Option<f64>) -> Self {
        let mut random = generator();
        let drawn = Sorted::of((0..DRAWS).filter_map(|_| draw(&mut random)));
        Self::between(mean(drawn.values().iter().copied()), &drawn, of)
    }

    fn between(value: Option<f64>, drawn: &Sorted, of: usize) -> Self {
        Self { value, low: drawn.closest(0.025), high: drawn.closest(0.975), of }
    }
}

/// The same for each figure, so that figures of the same cases are of the same draws.
fn generator() -> Random {
    random::stream(0, 0, 0, 0)
}

/// Probability that a positive case scores above a negative one, ties counted half (Mann and Whitney's statistic).
pub(crate) fn auroc(scored: &[(f64, bool)]) -> Option<f64> {
    let mut sorted: Vec<_> = scored.to_vec();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let positives = sorted.iter().filter(|(_, positive)| *positive).count() as f64;
    let negatives = sorted.len() as f64 - positives;
    if positives == 0.0 || negatives == 0.0 {
        return None;
    }
    let (mut below, mut won) = (0.0, 0.0);
    for ties in sorted.chunk_by(|a, b| a.0 == b.0) {
        let positive = ties.iter().filter(|(_, positive)| *positive).count() as f64;
        let negative = ties.len() as f64 - positive;
        won += positive * (below + 0.5 * negative);
        below += negative;
    }
    Some(won / (positives * negatives))
}

/// Share of positives found when no more than 5 % of negatives are taken for positive.
pub(crate) fn found_at_5_percent(scored: &[(f64, bool)]) -> Option<f64> {
    let mut negatives: Vec<f64> =
        scored.iter().filter(|(_, positive)| !positive).map(|(score, _)| *score).collect();
    let positives: Vec<f64> =
        scored.iter().filter(|(_, positive)| *positive).map(|(score, _)| *score).collect();
    if negatives.is_empty() || positives.is_empty() {
        return None;
    }
    negatives.sort_by(|a, b| b.total_cmp(a));
    let allowed = (0.05 * negatives.len() as f64).floor() as usize;
    let threshold = negatives[allowed.min(negatives.len() - 1)];
    mean(positives.iter().map(|score| f64::from(u8::from(*score > threshold))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn auroc_is_the_share_of_pairs_in_order() {
        let scored = [(0.9, true), (0.8, false), (0.7, true), (0.7, false), (0.1, false)];
        // Of six pairs: 0.9 wins three, 0.7 wins one and ties one.
        assert_eq!(auroc(&scored), Some(4.5 / 6.0));
        assert_eq!(auroc(&[(0.5, true)]), None);
    }

    #[test]
    fn at_most_5_percent_of_the_negatives_pass() {
        let mut scored: Vec<_> = (0..40).map(|i| (f64::from(i), false)).collect();
        scored.extend([(37.5, true), (38.5, true), (0.0, true)]);
        // Two of forty may pass: 39 and 38 do.
        assert_eq!(found_at_5_percent(&scored), Some(2.0 / 3.0 - 1.0 / 3.0 + 1.0 / 3.0));
    }

    #[test]
    fn a_bootstrap_interval_holds_the_mean_and_shrinks_with_the_root_of_the_count() {
        let width = |count: i32| {
            let cases: Vec<f64> = (0..count).map(|i| f64::from(i % 10)).collect();
            let figure = Figure::of(&cases, |cases| mean(cases.iter().map(|x| **x)));
            assert_eq!(figure.value, Some(4.5));
            assert!(figure.low < figure.value && figure.value < figure.high);
            figure.high.unwrap() - figure.low.unwrap()
        };
        let ratio = width(100) / width(1600);
        // Expected 4; a thousand draws leave some 5 % of noise in each.
        assert!((3.3..4.8).contains(&ratio), "{ratio}");
    }
}
