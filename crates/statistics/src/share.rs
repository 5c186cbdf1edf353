//! Shares with their intervals.

use serde::Serialize;
use statrs::distribution::{Beta, ContinuousCDF};

/// How many of how many, with an interval of 95 % of the probability behind it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Share {
    /// How many.
    pub count: usize,
    /// Out of how many.
    pub of: usize,
    /// Lower end of the interval, 0 to 1; 0 of none.
    pub low: f64,
    /// Upper end of the interval, 0 to 1; 1 of none.
    pub high: f64,
}

impl Share {
    /// With the score interval, which holds the probability in 95 % of cases in the mean over probabilities.
    ///
    /// Source: Wilson, Probable Inference, the Law of Succession, and Statistical Inference, Journal of the American Statistical
    /// Association 22(158), 1927.
    pub fn wilson(outcomes: impl IntoIterator<Item = bool>) -> Self {
        /// Standard normal deviate that 95 % lie within.
        const Z: f64 = 1.959_964;
        let (count, of) = counted(outcomes);
        if of == 0 {
            return Self { count, of, low: 0.0, high: 1.0 };
        }
        let n = of as f64;
        let share = count as f64 / n;
        let middle = share + Z * Z / (2.0 * n);
        let half = Z * (share * (1.0 - share) / n + Z * Z / (4.0 * n * n)).sqrt();
        let scale = 1.0 + Z * Z / n;
        let low = ((middle - half) / scale).max(0.0);
        Self { count, of, low, high: ((middle + half) / scale).min(1.0) }
    }

    /// With the exact interval, which holds the probability in 95 % of cases at least, whatever it is.
    ///
    /// Source: Clopper and Pearson, The Use of Confidence or Fiducial Limits Illustrated in the Case of the Binomial, Biometrika
    /// 26(4), 1934.
    pub fn clopper_pearson(outcomes: impl IntoIterator<Item = bool>) -> Self {
        let (count, of) = counted(outcomes);
        let (k, n) = (count as f64, of as f64);
        // Both of Beta's parameters are 1 or more where it is asked.
        let quantile = |a: f64, b: f64, p: f64| Beta::new(a, b).expect("both are positive").inverse_cdf(p);
        Self {
            low: if count == 0 { 0.0 } else { quantile(k, n - k + 1.0, 0.025) },
            high: if count == of { 1.0 } else { quantile(k + 1.0, n - k, 0.975) },
            count,
            of,
        }
    }

    /// The share, 0 to 1; 0 of none.
    pub fn value(&self) -> f64 {
        self.count as f64 / self.of.max(1) as f64
    }
}

/// How many happened, and out of how many.
fn counted(outcomes: impl IntoIterator<Item = bool>) -> (usize, usize) {
    outcomes.into_iter().fold((0, 0), |(count, of), outcome| (count + usize::from(outcome), of + 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wilsons_interval_is_the_published_one() {
        // Newcombe, Statistics in Medicine 17, 1998, table I: 81 of 263 gives 0.2553 to 0.3662.
        let share = Share::wilson((0..263).map(|i| i < 81));
        assert!((share.low - 0.2553).abs() < 5e-5 && (share.high - 0.3662).abs() < 5e-5, "{share:?}");
        // The same table: 0 of 20 gives 0 to 0.1611.
        let share = Share::wilson([false; 20]);
        assert!(share.low < 1e-9 && (share.high - 0.1611).abs() < 5e-5, "{share:?}");
    }

    #[test]
    fn clopper_and_pearsons_interval_is_the_published_one() {
        // Newcombe, table I: 81 of 263 gives 0.2527 to 0.3676, and 0 of 20 gives 0 to 0.1684.
        let share = Share::clopper_pearson((0..263).map(|i| i < 81));
        assert!((share.low - 0.2527).abs() < 5e-5 && (share.high - 0.3676).abs() < 5e-5, "{share:?}");
        let share = Share::clopper_pearson([false; 20]);
        assert!(share.low == 0.0 && (share.high - 0.1684).abs() < 5e-5, "{share:?}");
        // 8 of 10: 0.4439 to 0.9748; for n of n the lower end is 0.025^(1/n).
        let share = Share::clopper_pearson((0..10).map(|i| i < 8));
        assert!((share.low - 0.4439).abs() < 1e-4 && (share.high - 0.9748).abs() < 1e-4, "{share:?}");
        let all = Share::clopper_pearson([true; 600]);
        assert!((all.low - 0.025_f64.powf(1.0 / 600.0)).abs() < 1e-6 && all.high == 1.0, "{all:?}");
    }

    #[test]
    fn nothing_seen_tells_nothing() {
        let nothing = Share { count: 0, of: 0, low: 0.0, high: 1.0 };
        assert_eq!((Share::wilson([]), Share::clopper_pearson([])), (nothing, nothing));
        assert_eq!((nothing.value(), Share::wilson([true, false]).value()), (0.0, 0.5));
    }
}
