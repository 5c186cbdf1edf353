//! Statistics that several parts of the bench share.
//!
//! Each function gives its definition by the name it has in the literature, since percentiles and intervals have several. Nothing here
//! draws from a generator of its own: who wants a bootstrap hands one over, seeded.

use nalgebra::{Cholesky, Dyn};
use statrs::distribution::{ContinuousCDF as _, Normal};

mod bootstrap;
mod order;
mod share;

pub use self::{
    bootstrap::bootstrap,
    order::{Sorted, median, median_high},
    share::Share,
};

/// Median of a normal's magnitude over its deviation.
pub const MEDIAN_OF_NORMAL: f64 = 0.6745;

/// Further off than so many deviations a normal number is once in 16,000: it is something else.
pub const FAR_SIGMAS: f64 = 4.0;

/// The arithmetic mean; `None` of none. Sums in the order given.
pub fn mean(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0_u32);
    for value in values {
        sum += value;
        count += 1;
    }
    (count > 0).then(|| sum / f64::from(count))
}

/// The root of the mean square, in the unit of the values; `None` of none. Sums in the order given.
pub fn root_mean_square(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    mean(values.into_iter().map(|x| x * x)).map(f64::sqrt)
}

/// So many values from one to another, even in the logarithm; `n` is two at least, both ends positive.
pub fn evenly_in_log(from: f64, to: f64, n: usize) -> impl Iterator<Item = f64> {
    (0..n).map(move |i| from * (to / from).powf(i as f64 / (n - 1) as f64))
}

/// The value that a standard normal one stays below with a probability above 0 and below 1; infinite at the ends and beyond.
pub fn normal_quantile(probability: f64) -> f64 {
    Normal::standard().inverse_cdf(probability.clamp(0.0, 1.0))
}

/// The logarithm of the determinant of a positive definite matrix, from its factor `L` of `L L'`: twice the sum of `ln L[i][i]`, in
/// the order of the rows.
pub fn ln_det(factor: &Cholesky<f64, Dyn>) -> f64 {
    2.0 * factor.l_dirty().diagonal().iter().map(|d| d.ln()).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use nalgebra::DMatrix;

    use super::*;

    #[test]
    fn means_are_those_of_textbooks_and_none_have_none() {
        assert_eq!(mean([1.0, 2.0, 6.0]), Some(3.0));
        assert_eq!(root_mean_square([3.0, -4.0, 0.0, 0.0]), Some(2.5));
        assert_eq!((mean([]), root_mean_square([])), (None, None));
    }

    #[test]
    fn the_normal_quantile_is_the_tabulated_one() {
        for (probability, tabulated) in
            [(0.5, 0.0), (0.975, 1.959_964), (0.999, 3.090_232), (0.025, -1.959_964)]
        {
            assert!((normal_quantile(probability) - tabulated).abs() < 5e-7, "{probability}");
        }
        assert_eq!((normal_quantile(1.0), normal_quantile(-1.0)), (f64::INFINITY, f64::NEG_INFINITY));
    }

    #[test]
    fn values_even_in_the_logarithm_have_a_constant_ratio() {
        let decades: Vec<f64> = evenly_in_log(0.1, 100.0, 4).collect();
        for (made, expected) in decades.iter().zip([0.1, 1.0, 10.0, 100.0]) {
            assert!((made / expected - 1.0).abs() < 1e-12, "{decades:?}");
        }
    }

    #[test]
    fn the_determinant_of_hilberts_matrix_is_the_known_one() {
        // Of order three it is 1/2160 (Choi, Tricks or Treats with the Hilbert Matrix, American Mathematical Monthly 90, 1983).
        let hilbert = DMatrix::from_fn(3, 3, |i, j| ((i + j + 1) as f64).recip());
        let ln = ln_det(&hilbert.cholesky().unwrap());
        // Its condition number, 524, times a few roundings.
        assert!((ln + 2160.0_f64.ln()).abs() < 1e-12, "{ln}");
        let none = DMatrix::<f64>::zeros(0, 0);
        assert_eq!(ln_det(&none.cholesky().unwrap()), 0.0);
    }
}
