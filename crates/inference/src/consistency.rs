//! Whether a filter's innovations are those of a right model.

use bench_filter::Innovation;
use serde::Serialize;
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// Whether innovations are what a filter with a right model would see.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Consistency {
    /// Mean of squared innovations over their variance; 1 for a right model.
    pub mean_nis: f64,
    /// Probability that white innovations would look as correlated over ten lags (Ljung and Box), 0 to 1.
    pub whiteness_p: f64,
    /// Correlation of the innovations with the thrust, -1 to 1; 0 for a right model.
    pub thrust_correlation: f64,
}

const LAGS: usize = 10; // numerical

impl Consistency {
    /// Of innovations in the order of time; nothing wrong is found in a dozen or less.
    pub fn of(innovations: &[Innovation]) -> Self {
        let n = innovations.len();
        if n <= LAGS + 1 {
            return Self { mean_nis: 0.0, whiteness_p: 1.0, thrust_correlation: 0.0 };
        }
        let normed: Vec<f64> = innovations.iter().map(|i| i.residual_m / i.variance_m2.sqrt()).collect();
        let mean_nis = normed.iter().map(|x| x * x).sum::<f64>() / n as f64;
        let mean = normed.iter().sum::<f64>() / n as f64;
        let power: f64 = normed.iter().map(|x| (x - mean).powi(2)).sum::<f64>().max(1e-300);
        // Ljung and Box, On a measure of lack of fit in time series models, Biometrika 65(2), 1978.
        let q: f64 = (1..=LAGS)
            .map(|lag| {
                let r: f64 =
                    normed.iter().zip(&normed[lag..]).map(|(a, b)| (a - mean) * (b - mean)).sum::<f64>()
                        / power;
                (n * (n + 2)) as f64 * r * r / (n - lag) as f64
            })
            .sum();
        let thrust: Vec<f64> = innovations.iter().map(|i| i.axes[2]).collect();
        let mean_thrust = thrust.iter().sum::<f64>() / n as f64;
        let thrust_power: f64 = thrust.iter().map(|x| (x - mean_thrust).powi(2)).sum();
        let cross: f64 = normed.iter().zip(&thrust).map(|(a, b)| (a - mean) * (b - mean_thrust)).sum();
        let scale = (power * thrust_power).sqrt();
        Self {
            mean_nis,
            whiteness_p: ChiSquared::new(LAGS as f64).map_or(1.0, |chi_squared| chi_squared.sf(q)),
            thrust_correlation: if scale > 1e-12 { cross / scale } else { 0.0 },
        }
    }
}
