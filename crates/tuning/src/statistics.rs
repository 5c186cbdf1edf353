//! Shares with their intervals, and percentiles.

use serde::Serialize;
use statrs::distribution::{Beta, Binomial, ContinuousCDF, DiscreteCDF};

/// How many of how many, with the exact interval of 95 %.
///
/// Source: Clopper and Pearson, The Use of Confidence or Fiducial Limits Illustrated in the Case of the Binomial,
/// Biometrika 26(4), 1934.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Share {
    /// How many.
    pub count: usize,
    /// Out of how many.
    pub of: usize,
    /// Lower end of the interval.
    pub low: f64,
    /// Upper end of the interval.
    pub high: f64,
}

impl Share {
    /// Counts.
    pub fn of(outcomes: impl IntoIterator<Item = bool>) -> Self {
        let (mut count, mut of) = (0_usize, 0_usize);
        for outcome in outcomes {
            count += usize::from(outcome);
            of += 1;
        }
        let (k, n) = (count as f64, of as f64);
        let quantile = |a: f64, b: f64, p: f64| Beta::new(a, b).map_or(f64::NAN, |beta| beta.inverse_cdf(p));
        Self {
            low: if count == 0 { 0.0 } else { quantile(k, n - k + 1.0, 0.025) },
            high: if count == of { 1.0 } else { quantile(k + 1.0, n - k, 0.975) },
            count,
            of,
        }
    }

    /// The share; zero of none.
    pub fn value(&self) -> f64 {
        self.count as f64 / self.of.max(1) as f64
    }
}

/// The value that so large a share of the values does not exceed, nearest rank; what is not a number counts as infinite.
pub fn percentile(values: impl IntoIterator<Item = f64>, share: f64) -> f64 {
    let mut values: Vec<f64> =
        values.into_iter().map(|x| if x.is_nan() { f64::INFINITY } else { x }).collect();
    values.sort_by(f64::total_cmp);
    let rank = (share * values.len() as f64).ceil() as usize;
    values.get(rank.saturating_sub(1)).copied().unwrap_or(f64::NAN)
}

/// The same with its interval of 95 %: value, lower end, upper end. The ends are values themselves, by their rank, whatever the
/// values' distribution; with too few of them the upper end is infinite.
///
/// Source: David and Nagaraja, Order Statistics, 3rd edition, section 7.1.
pub(crate) fn percentile_between(values: impl IntoIterator<Item = f64>, share: f64) -> [f64; 3] {
    const TAIL: f64 = 0.025;
    let mut values: Vec<f64> =
        values.into_iter().map(|x| if x.is_nan() { f64::INFINITY } else { x }).collect();
    values.sort_by(f64::total_cmp);
    let at = percentile(values.iter().copied(), share);
    let Ok(below) = Binomial::new(share, values.len() as u64) else { return [at, f64::NAN, f64::NAN] };
    // The values below the percentile are binomial in number.
    let low = below.inverse_cdf(TAIL) as usize;
    let high = below.inverse_cdf(1.0 - TAIL) as usize + 1;
    let ranked = |rank: usize| values.get(rank.wrapping_sub(1)).copied();
    [at, ranked(low).unwrap_or(f64::NEG_INFINITY), ranked(high).unwrap_or(f64::INFINITY)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_are_those_of_the_tables() {
        // Clopper and Pearson for 8 of 10: 0.4439 to 0.9748; for n of n the lower end is 0.025^(1/n).
        let share = Share::of((0..10).map(|i| i < 8));
        assert!((share.low - 0.4439).abs() < 1e-4 && (share.high - 0.9748).abs() < 1e-4, "{share:?}");
        let all = Share::of([true; 600]);
        assert!((all.low - 0.025_f64.powf(1.0 / 600.0)).abs() < 1e-6 && all.high == 1.0, "{all:?}");
        let none = Share::of([false; 3]);
        assert!(none.low == 0.0 && none.high < 1.0, "{none:?}");
    }

    #[test]
    fn percentiles_are_values_and_failures_are_the_worst() {
        assert_eq!(percentile((1..=200).map(f64::from), 0.95), 190.0);
        assert_eq!(percentile([f64::NAN, 1.0], 1.0), f64::INFINITY);
        assert!(percentile([], 0.5).is_nan());
    }

    #[test]
    fn percentiles_have_the_intervals_of_order_statistics() {
        // 200 values: the number below the 95th percentile is binomial, with 184 and 196 at its tails (scipy.stats.binom.ppf).
        let [at, low, high] = percentile_between((1..=200).map(f64::from), 0.95);
        assert_eq!((at, low, high), (190.0, 184.0, 197.0));
        // Twenty tell no upper end: the highest is below it once in three times.
        assert_eq!(percentile_between((1..=20).map(f64::from), 0.95)[2], f64::INFINITY);
    }
}
