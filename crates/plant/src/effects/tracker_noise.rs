//! The tracker is noisier than the rig says.

use bench_rig::Airframe;
use nalgebra::Vector3;
use rand_distr::{Distribution, StandardNormal};

use super::{Effect, EffectRng, EffectSpec, Frame, Parameter, Prior, Signature, Spread, Stage};

/// White Gaussian noise on each axis, on top of the nominal noise.
pub(super) static SPEC: EffectSpec = EffectSpec {
    name: "tracker-noise",
    stage: Stage::Tracker,
    summary: "white noise on positions beyond the nominal noise",
    law: "p = p_true + sigma (N1, N2, N3)",
    source: "Khoshelham and Oude Elberink, Accuracy and Resolution of Kinect Depth Data for Indoor Mapping Applications, Sensors 12(2), 2012: random error",
    parameters: &[Parameter {
        key: "sigma_m",
        unit: "m",
        meaning: "standard deviation on each axis, beyond the nominal noise",
        min: 0.0,
        max: 0.5,
        prior: Prior::LogNormal { median: 0.004, sigma_ln: 0.8 },
        neutral: Some(0.0),
        default: None,
    }],
    signature: Signature::spread(Spread::MeasurementNoise),
    build,
};

fn build(values: &[f64], _: &Airframe, rng: EffectRng) -> Box<dyn Effect> {
    Box::new(TrackerNoise { sigma_m: values[0], rng })
}

struct TrackerNoise {
    sigma_m: f64,
    rng: EffectRng,
}

impl Effect for TrackerNoise {
    fn expose(&mut self, frame: &mut Frame) {
        let normal = Vector3::from_fn(|_, _| StandardNormal.sample(&mut self.rng));
        frame.position_m += normal * self.sigma_m;
    }
}

#[cfg(test)]
mod tests {
    use crate::effects::testing::{effect, frame, mean_and_deviation};

    #[test]
    fn noise_is_white_with_the_deviation_asked_for() {
        let mut noise = effect("tracker-noise", &[0.004]);
        let altitudes: Vec<f64> = (0..20_000)
            .map(|_| {
                let mut seen = frame();
                noise.expose(&mut seen);
                seen.position_m.z - frame().position_m.z
            })
            .collect();
        let (mean, deviation) = mean_and_deviation(&altitudes);
        let lag_one: f64 = altitudes.windows(2).map(|pair| pair[0] * pair[1]).sum::<f64>() / 20_000.0;
        // Five sigmas of the estimates: sigma/sqrt(n), 1/sqrt(2n), 1/sqrt(n).
        assert!(mean.abs() < 0.004 * 0.036, "mean {mean}");
        assert!((deviation / 0.004 - 1.0).abs() < 0.025, "deviation {deviation}");
        assert!((lag_one / 0.004_f64.powi(2)).abs() < 0.036, "correlation of neighbours");
    }
}
