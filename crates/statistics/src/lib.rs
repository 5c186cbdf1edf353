//! Statistics that several parts of the bench share.

/// Median of a normal's magnitude over its deviation.
pub const MEDIAN_OF_NORMAL: f64 = 0.6745;

/// The upper of the two middle values of an even number of them; `None` of none.
pub fn median_high(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

/// So many values from one to another, even in the logarithm; `n` is two at least, both ends positive.
pub fn evenly_in_log(from: f64, to: f64, n: usize) -> impl Iterator<Item = f64> {
    (0..n).map(move |i| from * (to / from).powf(i as f64 / (n - 1) as f64))
}
