//! Order statistics: medians and percentiles.

use statrs::distribution::{Binomial, DiscreteCDF};

/// The middle value, or the mean of the two middle ones; `None` of none. Values that are not numbers sort beyond the infinite ones.
pub fn median(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let sorted = Sorted::of(values).0;
    let half = sorted.len() / 2;
    match sorted.len() {
        0 => None,
        count if count % 2 == 1 => Some(sorted[half]),
        _ => Some(0.5 * (sorted[half - 1] + sorted[half])),
    }
}

/// The upper of the two middle values of an even number of them; `None` of none.
pub fn median_high(values: Vec<f64>) -> Option<f64> {
    let sorted = Sorted::of(values).0;
    sorted.get(sorted.len() / 2).copied()
}

/// Values in ascending order, of which percentiles are asked.
///
/// Hyndman and Fan, Sample Quantiles in Statistical Packages, The American Statistician 50(4), 1996, number the definitions of a
/// percentile of `n` values. Shares run from 0 to 1; one outside of that asks for the least or the largest value.
#[derive(Clone, Debug, PartialEq)]
pub struct Sorted(Vec<f64>);

impl Sorted {
    /// Of values in any order. What is not a number sorts by its sign bit beyond the infinite ones.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Self {
        let mut values: Vec<f64> = values.into_iter().collect();
        values.sort_by(f64::total_cmp);
        Self(values)
    }

    /// The values, ascending.
    pub fn values(&self) -> &[f64] {
        &self.0
    }

    /// The least value that at least such a share of the values does not exceed: nearest rank, Hyndman and Fan's type 1. `None` of none.
    pub fn nearest_rank(&self, share: f64) -> Option<f64> {
        let rank = (share * self.0.len() as f64).ceil() as usize;
        self.0.get(rank.saturating_sub(1).min(self.last()?)).copied()
    }

    /// The ends of the interval of 95 % of a percentile by nearest rank, lower and upper. They are values themselves, by their rank,
    /// whatever the values' distribution. With too few values an end is infinite. `None` where the share is not from 0 to 1.
    ///
    /// Source: David and Nagaraja, Order Statistics, 3rd edition, section 7.1.
    pub fn nearest_rank_interval_95(&self, share: f64) -> Option<[f64; 2]> {
        const TAIL: f64 = 0.025;
        // The values below the percentile are binomial in number.
        let below = Binomial::new(share, self.0.len() as u64).ok()?;
        let low = below.inverse_cdf(TAIL) as usize;
        let high = below.inverse_cdf(1.0 - TAIL) as usize + 1;
        let ranked = |rank: usize| self.0.get(rank.wrapping_sub(1)).copied();
        Some([ranked(low).unwrap_or(f64::NEG_INFINITY), ranked(high).unwrap_or(f64::INFINITY)])
    }

    /// Between the two values about position `share (n - 1)`, counted from 0, by linear interpolation: Hyndman and Fan's type 7.
    /// `None` of none.
    pub fn interpolated(&self, share: f64) -> Option<f64> {
        let at = (share * self.last()? as f64).clamp(0.0, self.last()? as f64);
        let (low, high) = (self.0[at.floor() as usize], self.0[at.ceil() as usize]);
        Some(low + (high - low) * at.fract())
    }

    /// The value next to position `share (n - 1)`, counted from 0, the upper one where two are as near: what type 7 interpolates,
    /// rounded to a value. `None` of none.
    pub fn closest(&self, share: f64) -> Option<f64> {
        let last = self.last()?;
        self.0.get(((last as f64 * share).round() as usize).min(last)).copied()
    }

    /// The least and the largest value when one in so many, rounded down, is left out at each end. `None` of none; `one_in` is three
    /// or more.
    pub fn trimmed_range(&self, one_in: usize) -> Option<[f64; 2]> {
        let cut = self.0.len() / one_in.max(3);
        Some([self.0[cut.min(self.last()?)], self.0[self.last()? - cut]])
    }

    /// Index of the largest value.
    fn last(&self) -> Option<usize> {
        self.0.len().checked_sub(1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counted(n: u32) -> Sorted {
        // In descending order, to be sorted.
        Sorted::of((1..=n).rev().map(f64::from))
    }

    #[test]
    fn medians_are_the_middle() {
        assert_eq!(median([5.0, 1.0, 3.0]), Some(3.0));
        assert_eq!(median([7.0, 1.0, 5.0, 3.0]), Some(4.0));
        assert_eq!(median([]), None);
        assert_eq!(median_high(vec![7.0, 1.0, 5.0, 3.0]), Some(5.0));
        assert_eq!(median_high(Vec::new()), None);
        // Where one of the two in the middle is infinite, so is their mean.
        assert_eq!(median([1.0, f64::INFINITY, f64::INFINITY, 2.0]), Some(f64::INFINITY));
    }

    #[test]
    fn percentiles_are_those_of_their_types() {
        // R, quantile(1:10, c(0.25, 0.5, 0.95)): type 1 gives 3, 5, 10; type 7 gives 3.25, 5.5, 9.55.
        let ten = counted(10);
        assert_eq!([0.25, 0.5, 0.95].map(|share| ten.nearest_rank(share).unwrap()), [3.0, 5.0, 10.0]);
        for (share, expected) in [(0.25, 3.25), (0.5, 5.5), (0.95, 9.55)] {
            assert!((ten.interpolated(share).unwrap() - expected).abs() < 1e-12);
        }
        // numpy.percentile(arange(1, 11), [25, 95], method="nearest"): 3 and 10.
        assert_eq!([0.25, 0.95].map(|share| ten.closest(share).unwrap()), [3.0, 10.0]);
        assert_eq!(ten.trimmed_range(4), Some([3.0, 8.0]));
    }

    #[test]
    fn any_share_of_any_number_of_values_has_an_answer() {
        let asked = |sorted: &Sorted, share| {
            [sorted.nearest_rank(share), sorted.interpolated(share), sorted.closest(share)]
        };
        for share in [-1.0, 0.0, 0.3, 1.0, 2.0] {
            assert_eq!(asked(&Sorted::of([]), share), [None; 3]);
            assert_eq!(asked(&counted(1), share), [Some(1.0); 3]);
        }
        assert_eq!(asked(&counted(4), 2.0), [Some(4.0); 3]);
        assert_eq!(asked(&counted(4), -2.0), [Some(1.0); 3]);
        assert_eq!((Sorted::of([]).trimmed_range(20), counted(1).trimmed_range(0)), (None, Some([1.0; 2])));
    }

    #[test]
    fn percentiles_have_the_intervals_of_order_statistics() {
        // 200 values: the number below the 95th percentile is binomial, with 184 and 196 at its tails (scipy.stats.binom.ppf).
        assert_eq!(counted(200).nearest_rank_interval_95(0.95), Some([184.0, 197.0]));
        // Twenty tell no upper end: the highest is below it once in three times.
        assert_eq!(counted(20).nearest_rank_interval_95(0.95).unwrap()[1], f64::INFINITY);
        assert_eq!(counted(20).nearest_rank_interval_95(1.5), None);
    }
}
