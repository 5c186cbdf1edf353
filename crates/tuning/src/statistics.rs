//! Percentiles of flights, of which some are lost.

use bench_statistics::Sorted;

/// What is not a number is of a flight that was lost, and the worst.
fn sorted(values: impl IntoIterator<Item = f64>) -> Sorted {
    Sorted::of(values.into_iter().map(|x| if x.is_nan() { f64::INFINITY } else { x }))
}

/// The value that so large a share of the values does not exceed, nearest rank; what is not a number counts as infinite.
pub fn percentile(values: impl IntoIterator<Item = f64>, share: f64) -> f64 {
    sorted(values).nearest_rank(share).unwrap_or(f64::NAN)
}

/// The same with its interval of 95 %: value, lower end, upper end. The ends are values themselves; with too few of them the upper
/// end is infinite.
pub(crate) fn percentile_between(values: impl IntoIterator<Item = f64>, share: f64) -> [f64; 3] {
    let values = sorted(values);
    let at = values.nearest_rank(share).unwrap_or(f64::NAN);
    let [low, high] = values.nearest_rank_interval_95(share).unwrap_or([f64::NAN; 2]);
    [at, low, high]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_values_and_failures_are_the_worst() {
        assert_eq!(percentile((1..=200).map(f64::from), 0.95), 190.0);
        assert_eq!(percentile([f64::NAN, 1.0], 1.0), f64::INFINITY);
        assert!(percentile([], 0.5).is_nan());
        assert_eq!(percentile_between([1.0, f64::NAN], 0.5), [1.0, f64::NEG_INFINITY, f64::INFINITY]);
    }
}
