//! By how much the airframe's numbers differ between flights, and what that leaves of how well they are known.

use bench_statistics::ln_det;
use nalgebra::{DMatrix, DVector};

/// What one flight says about the numbers, at the fit to all flights: gradient and information of its log-likelihood.
pub struct Says {
    /// Gradient.
    pub gradient: DVector<f64>,
    /// Information.
    pub information: DMatrix<f64>,
}

/// Evidence, nats, that a spread must gain to count: one free number, chosen among a few.
const WORTH: f64 = 2.0;
/// Sizes that are tried, in prior deviations.
const LOWEST: f64 = 0.03;
const STEPS: i32 = 24;
const RATIO: f64 = 1.25;

/// One sigma between flights of each number: the most likely ones if flight i has `theta + d_i`, `d_i` being normal.
/// Near the fit to all a flight's log-likelihood is a parabola, so that `d_i` is integrated out exactly:
///
/// ```text
/// ln L_i = 1/2 g'(F + 1/T)^-1 g - 1/2 ln|1 + T F|,   T = diag(tau^2)
/// ```
///
/// Numbers that make up for one another would each take the whole spread, so they are added one at a time, best first.
pub fn between_flights(flights: &[Says], prior_sigma: &[f64], may_differ: &[bool]) -> Vec<f64> {
    let n = prior_sigma.len();
    let mut tau = vec![0.0; n];
    let mut now = 0.0;
    loop {
        let mut best = (now + WORTH, None);
        for i in (0..n).filter(|i| may_differ[*i] && tau[*i] == 0.0) {
            for k in 0..STEPS {
                let mut tried = tau.clone();
                tried[i] = prior_sigma[i] * LOWEST * RATIO.powi(k);
                let value = evidence(flights, &tried);
                if value > best.0 {
                    best = (value, Some(tried));
                }
            }
        }
        let Some(better) = best.1 else { return tau };
        (now, tau) = (best.0, better);
    }
}

fn selected(tau: &[f64]) -> Vec<usize> {
    (0..tau.len()).filter(|i| tau[*i] > 0.0).collect()
}

fn evidence(flights: &[Says], tau: &[f64]) -> f64 {
    let own = selected(tau);
    flights
        .iter()
        .map(|says| {
            let g = DVector::from_fn(own.len(), |i, _| says.gradient[own[i]]);
            let mut a = DMatrix::from_fn(own.len(), own.len(), |i, j| says.information[(own[i], own[j])]);
            for (k, i) in own.iter().enumerate() {
                a[(k, k)] += tau[*i].powi(-2);
            }
            // |1 + T F| = |T| |F + 1/T|
            let ln_t: f64 = own.iter().map(|i| 2.0 * tau[*i].ln()).sum();
            a.cholesky().map_or(f64::NEG_INFINITY, |c| 0.5 * g.dot(&c.solve(&g)) - 0.5 * (ln_det(&c) + ln_t))
        })
        .sum()
}

/// Information about the common numbers, when those of each flight differ by `tau`: `sum of F - F (F + 1/T)^-1 F`.
pub fn common_information(flights: &[Says], tau: &[f64]) -> DMatrix<f64> {
    let own = selected(tau);
    let n = tau.len();
    flights.iter().fold(DMatrix::zeros(n, n), |sum, says| {
        let f = &says.information;
        let mut a = DMatrix::from_fn(own.len(), own.len(), |i, j| f[(own[i], own[j])]);
        for (k, i) in own.iter().enumerate() {
            a[(k, k)] += tau[*i].powi(-2);
        }
        let columns = DMatrix::from_fn(own.len(), n, |k, j| f[(own[k], j)]);
        let lost = a.cholesky().map(|c| columns.transpose() * c.solve(&columns));
        sum + lost.map_or_else(|| f.clone(), |lost| f - lost)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Flights whose one number was measured to be `values`, each with a deviation of `sigma`, seen from their mean.
    fn flights(values: &[f64], sigma: f64) -> Vec<Says> {
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let information = sigma.powi(-2);
        values
            .iter()
            .map(|x| Says {
                gradient: DVector::from_element(1, (x - mean) * information),
                information: DMatrix::from_element(1, 1, information),
            })
            .collect()
    }

    #[test]
    fn a_spread_beyond_what_was_measured_is_found_and_one_within_is_not() {
        let plain = flights(&[-1.0, 0.4, 1.1, -0.6, 0.1], 0.01);
        let tau = between_flights(&plain, &[10.0], &[true]);
        // The root mean square of the values, to the grid's step of 25 %.
        assert!((0.6..0.95).contains(&tau[0]), "{tau:?}");
        let hidden = flights(&[-1.0, 0.4, 1.1, -0.6, 0.1], 1.0);
        assert_eq!(between_flights(&hidden, &[10.0], &[true]), [0.0]);
        assert_eq!(between_flights(&plain, &[10.0], &[false]), [0.0]);
    }

    #[test]
    fn the_mean_of_five_spread_flights_is_known_to_the_spread_over_root_five() {
        let plain = flights(&[-1.0, 0.4, 1.1, -0.6, 0.1], 0.01);
        let information = common_information(&plain, &[0.8])[(0, 0)];
        assert!((information.powf(-0.5) - 0.8 / 5_f64.sqrt()).abs() < 1e-3);
        // Without a spread, each flight's information counts in full.
        assert!((common_information(&plain, &[0.0])[(0, 0)] - 5e4).abs() < 1e-6);
    }
}
