//! Figures with their intervals.

use serde::Serialize;

use crate::random::{self, Random};

/// How often something happened, with Wilson's interval of 95 %.
///
/// Source: Wilson, Probable Inference, the Law of Succession, and Statistical Inference, Journal of the American
/// Statistical Association 22(158), 1927.
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

/// Standard normal deviate that 95 % lie within.
const Z: f64 = 1.959_964;

impl Rate {
    pub(crate) fn of(outcomes: impl IntoIterator<Item = bool>) -> Self {
        let (mut count, mut of) = (0, 0);
        for outcome in outcomes {
            count += usize::from(outcome);
            of += 1;
        }
        let n = of as f64;
        if of == 0 {
            return Self { count, of, value: None, low: 0.0, high: 1.0 };
        }
        let share = count as f64 / n;
        let middle = share + Z * Z / (2.0 * n);
        let half = Z * (share * (1.0 - share) / n + Z * Z / (4.0 * n * n)).sqrt();
        let scale = 1.0 + Z * Z / n;
        let low = ((middle - half) / scale).max(0.0);
        Self { count, of, value: Some(share), low, high: ((middle + half) / scale).min(1.0) }
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
        let bootstrap = |random: &mut Random| {
            value?;
            let again: Vec<&T> = cases.iter().map(|_| &cases[random::below(random, cases.len())]).collect();
            figure(&again)
        };
        Self { value, ..Self::of_draws(cases.len(), bootstrap) }
    }

    /// The mean of draws, and where 95 % of them lie.
    pub(crate) fn of_draws(of: usize, draw: impl Fn(&mut Random) -> Option<f64>) -> Self {
        let mut random = random::stream(0, 0, 0, 0);
        let mut drawn: Vec<f64> = (0..DRAWS).filter_map(|_| draw(&mut random)).collect();
        drawn.sort_by(f64::total_cmp);
        let at = |share: f64| {
            (!drawn.is_empty()).then(|| drawn[((drawn.len() - 1) as f64 * share).round() as usize])
        };
        Self { value: mean(drawn.iter().copied()), low: at(0.025), high: at(0.975), of }
    }
}

pub(crate) fn mean(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0);
    for value in values {
        sum += value;
        count += 1;
    }
    (count > 0).then(|| sum / f64::from(count))
}

pub(crate) fn median(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    let half = values.len() / 2;
    match values.len() {
        0 => None,
        count if count % 2 == 1 => Some(values[half]),
        _ => Some(0.5 * (values[half - 1] + values[half])),
    }
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
    fn wilsons_interval_is_the_published_one() {
        // Newcombe, Statistics in Medicine 17, 1998, table I: 81 of 263 gives 0.2553 to 0.3662.
        let rate = Rate::of((0..263).map(|i| i < 81));
        assert!((rate.low - 0.2553).abs() < 5e-5 && (rate.high - 0.3662).abs() < 5e-5, "{rate:?}");
        // The same table: 0 of 20 gives 0 to 0.1611.
        let rate = Rate::of((0..20).map(|_| false));
        assert!(rate.low < 1e-9 && (rate.high - 0.1611).abs() < 5e-5, "{rate:?}");
    }

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
