//! The air moves at random.

use bench_rig::Airframe;
use nalgebra::Vector3;
use rand_distr::{Distribution, StandardNormal};

use super::{Effect, EffectRng, EffectSpec, Parameter, Prior, Signature, Spread, Stage};
use crate::nominal::Air;

/// Three components of wind, each an Ornstein-Uhlenbeck process, act through the nominal drag.
pub(super) static SPEC: EffectSpec = EffectSpec {
    name: "gusts",
    stage: Stage::Environment,
    summary: "random wind acts through the drag",
    law: "F = Cf w, dw = -w/tau dt + sigma sqrt(2/tau) dB, each axis",
    source: "MIL-HDBK-1797, Flying Qualities of Piloted Aircraft, 1997: Dryden spectrum of first order; simulated exactly after Gillespie, Exact numerical simulation of the Ornstein-Uhlenbeck process and its integral, Physical Review E 54(2), 1996",
    parameters: &[
        Parameter {
            key: "sigma_m_s",
            unit: "m/s",
            meaning: "standard deviation of the wind on each axis",
            min: 0.0,
            max: 20.0,
            prior: Prior::LogNormal { median: 0.3, sigma_ln: 0.8 },
            neutral: Some(0.0),
            default: None,
        },
        Parameter {
            key: "correlation_time_s",
            unit: "s",
            meaning: "correlation time tau of the wind",
            min: 0.01,
            max: 60.0,
            prior: Prior::LogNormal { median: 1.0, sigma_ln: 0.8 },
            neutral: None,
            default: None,
        },
    ],
    signature: Signature::spread(Spread::Turbulence),
    build,
};

fn build(values: &[f64], airframe: &Airframe, mut rng: EffectRng) -> Box<dyn Effect> {
    let (sigma_m_s, correlation_time_s) = (values[0], values[1]);
    Box::new(Gusts {
        sigma_m_s,
        correlation_time_s,
        drag_n_s_per_m: airframe.drag_n_s_per_m.value,
        wind_m_s: normal(&mut rng) * sigma_m_s,
        mean_wind_m_s: Vector3::zeros(),
        rng,
    })
}

struct Gusts {
    sigma_m_s: f64,
    correlation_time_s: f64,
    drag_n_s_per_m: f64,
    /// At the end of the present step.
    wind_m_s: Vector3<f64>,
    /// Over the present step.
    mean_wind_m_s: Vector3<f64>,
    rng: EffectRng,
}

fn normal(rng: &mut EffectRng) -> Vector3<f64> {
    Vector3::from_fn(|_, _| StandardNormal.sample(rng))
}

impl Effect for Gusts {
    /// Draws the wind at the end of the step, then its mean over the step given both ends; both are exact for any step.
    fn advance(&mut self, dt_s: f64, _: &Air) {
        let x = dt_s / self.correlation_time_s;
        let start = self.wind_m_s;
        let fresh = self.sigma_m_s * (-(-2.0 * x).exp_m1()).sqrt();
        self.wind_m_s = start * (-x).exp() + normal(&mut self.rng) * fresh;
        // A bridge between two known ends has the mean tanh(x/2)/x (w0 + w1) and this variance.
        let half = (0.5 * x).tanh();
        let bridge = self.sigma_m_s * (2.0 * x - 4.0 * half).max(0.0).sqrt() / x;
        self.mean_wind_m_s = (start + self.wind_m_s) * (half / x) + normal(&mut self.rng) * bridge;
    }

    fn force(&self, _: &Air, force_n: &mut Vector3<f64>) {
        *force_n += self.mean_wind_m_s * self.drag_n_s_per_m;
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use crate::effects::testing::{air, effect, mean_and_deviation, rig};

    /// Means of the vertical wind over spans of `steps` steps of `dt_s`, for a wind of 0.5 m/s and 0.4 s.
    fn means(dt_s: f64, steps: usize, count: usize) -> Vec<f64> {
        let drag_n_s_per_m = rig().airframe.drag_n_s_per_m.value;
        let mut gusts = effect("gusts", &[0.5, 0.4]);
        let mut wind = || {
            gusts.advance(dt_s, &air(1.0, 0.0));
            let mut force_n = Vector3::zeros();
            gusts.force(&air(1.0, 0.0), &mut force_n);
            force_n.z / drag_n_s_per_m
        };
        (0..count).map(|_| (0..steps).map(|_| wind()).sum::<f64>() / steps as f64).collect()
    }

    #[test]
    fn the_mean_over_a_span_has_the_variance_of_theory_whatever_the_step() {
        // Variance of the mean of an Ornstein-Uhlenbeck process over x = 0.5 correlation times: 2 (e^-x - 1 + x)/x^2.
        let x: f64 = 0.5;
        let expected = 0.25 * 2.0 * ((-x).exp() - 1.0 + x) / (x * x);
        for (dt_s, steps) in [(0.2, 1), (0.02, 10)] {
            let means = means(dt_s, steps, 20_000);
            let (_, deviation) = mean_and_deviation(&means);
            // Neighbours correlate, which leaves about 20,000/4 independent values: 2 % a sigma; four of them.
            assert!((deviation * deviation / expected - 1.0).abs() < 0.08, "{dt_s}: {deviation}");
        }
    }

    #[test]
    fn spans_one_correlation_time_apart_correlate_by_1_over_e() {
        let means = means(0.01, 1, 40_000);
        let (_, deviation) = mean_and_deviation(&means);
        let product =
            means.iter().zip(&means[40..]).map(|(a, b)| a * b).sum::<f64>() / (means.len() - 40) as f64;
        // 400 s hold about 500 independent values: 4.5 % a sigma; four of them.
        assert!((product / (deviation * deviation) - (-1.0_f64).exp()).abs() < 0.18);
    }
}
