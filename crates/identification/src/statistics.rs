//! What the fits to balance readings share.

use statrs::distribution::{ContinuousCDF, FisherSnedecor, StudentsT};

/// Deviation of a normal distribution over its median absolute deviation.
const PER_MAD: f64 = 1.4826;
/// A reading so many deviations off is refused. One good reading in two thousand is.
pub const REFUSED_SIGMAS: f64 = 3.5;
/// Of this share of the readings the line must go through.
pub const MOST_REFUSED: f64 = 0.3;

/// The middle value, or the mean of the two middle ones; NaN of none.
pub fn median(values: &[f64]) -> f64 {
    bench_statistics::median(values.iter().copied()).unwrap_or(f64::NAN)
}

/// One sigma of normal values among wild ones, from the median of their absolute values. Of few values it is small by chance:
/// the factor is Rousseeuw and Leroy's, Robust Regression and Outlier Detection, 1987, section 5.1.
pub fn robust_sigma(residuals: &[f64], parameters: usize) -> f64 {
    let sizes: Vec<f64> = residuals.iter().map(|r| r.abs()).collect();
    let free = residuals.len().saturating_sub(parameters).max(1) as f64;
    PER_MAD * (1.0 + 5.0 / free) * median(&sizes)
}

/// Half width of an interval of 95 %, in standard errors.
pub fn half_width_95(degrees: f64) -> f64 {
    StudentsT::new(0.0, 1.0, degrees.max(1.0)).map_or(1.96, |t| t.inverse_cdf(0.975))
}

/// Probability that chance alone gives a ratio of value to standard error so large, either way.
pub fn two_sided_p(ratio: f64, degrees: f64) -> f64 {
    StudentsT::new(0.0, 1.0, degrees.max(1.0)).map_or(1.0, |t| 2.0 * t.sf(ratio.abs()))
}

/// Probability that chance alone gives a ratio of variances so large.
pub fn f_tail(ratio: f64, above: f64, below: f64) -> f64 {
    FisherSnedecor::new(above.max(1.0), below.max(1.0)).map_or(1.0, |f| f.sf(ratio.max(0.0)))
}

/// Variance of a reading, and the part of it that repeats do not average out.
///
/// Rounding to steps `q` is an error of its own for each reading only where noise `s` carries readings over steps. Else
/// repeats are rounded alike: the mean of many is off by a periodic function of the true value whose harmonics have the
/// amplitudes `q/(pi k) exp(-2 pi^2 k^2 s^2/q^2)` (Widrow and Kollár, Quantization Noise, 2008, chapter 9).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// Of one reading.
    pub variance: f64,
    /// What repeats at one setting have in common.
    pub shared: f64,
}

impl Spread {
    /// From the variance of single readings about what was fitted, and the balance's step. It is never less than rounding alone
    /// leaves.
    pub fn new(variance: f64, step: f64) -> Self {
        let rounding = step * step / 12.0;
        let variance = variance.max(rounding);
        let noise = variance - rounding;
        let shared = if step > 0.0 {
            let harmonic = |k: f64| {
                let of_rest = step * step / (2.0 * (std::f64::consts::PI * k).powi(2));
                of_rest * (-4.0 * (std::f64::consts::PI * k / step).powi(2) * noise).exp()
            };
            // Without noise the sum is that of 1/k^2: the rounding's own variance.
            (1..=50).map(|k| harmonic(f64::from(k))).sum::<f64>().min(rounding)
        } else {
            0.0
        };
        Self { variance, shared }
    }

    /// Of the mean of so many repeats.
    pub fn of_mean(self, count: usize) -> f64 {
        (self.variance - self.shared) / count.max(1) as f64 + self.shared
    }

    /// Degrees of freedom of `readings` at `settings` after fitting `parameters`: repeats that are rounded alike tell no more
    /// than one. The variance of a sample's variance goes with kurtosis less one: 2 of a normal error, 0.8 of rounding alone,
    /// whose spread fewer readings show as well.
    pub fn degrees(self, readings: usize, settings: usize, parameters: usize) -> f64 {
        let rounded = self.shared / self.variance.max(f64::MIN_POSITIVE);
        let repeats = readings.saturating_sub(settings) as f64 * (1.0 - rounded);
        let normal = (settings as f64 + repeats - parameters as f64).max(1.0);
        normal / (1.0 - 0.6 * rounded * rounded)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tails_are_those_of_tables() {
        assert!((half_width_95(10.0) - 2.228).abs() < 1e-3);
        assert!((two_sided_p(2.228, 10.0) - 0.05).abs() < 1e-4);
        assert!((f_tail(3.33, 5.0, 10.0) - 0.05).abs() < 1e-3);
    }

    #[test]
    fn rounding_is_shared_by_repeats_without_noise_and_not_with_noise_of_a_step() {
        let quiet = Spread::new(0.0, 1.0);
        assert!((quiet.of_mean(100) - 1.0 / 12.0).abs() < 2e-3, "{quiet:?}");
        let dithered = Spread::new(1.0 + 1.0 / 12.0, 1.0);
        assert!(dithered.of_mean(100) < 0.011, "{dithered:?}");
        // Eight settings that are free, of uniform errors: by (3 - 1) / (1.8 - 1) more.
        assert!((quiet.degrees(30, 10, 2) - 20.0).abs() < 1.5, "{}", quiet.degrees(30, 10, 2));
        assert!((dithered.degrees(30, 10, 2) - 28.0).abs() < 0.1);
    }

    #[test]
    fn wild_values_do_not_widen_the_scale() {
        let mut residuals: Vec<f64> = (-50..=50).map(|i| f64::from(i) / 25.0).collect();
        let clean = robust_sigma(&residuals, 2);
        residuals.iter_mut().step_by(10).for_each(|r| *r = 100.0);
        assert!(robust_sigma(&residuals, 2) < 1.3 * clean);
    }
}
