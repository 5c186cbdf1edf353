//! Now and then the tracker takes something else for the marker.

use bench_rig::Airframe;
use nalgebra::Vector3;
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};

use super::{Effect, EffectRng, EffectSpec, Frame, Parameter, Prior, Signature, Spread, Stage};

/// A share of the frames shows a wrong place.
pub(super) static SPEC: EffectSpec = EffectSpec {
    name: "tracker-outliers",
    stage: Stage::Tracker,
    summary: "now and then a frame shows a wrong place",
    law: "p = p_true + sigma (N1, N2, N3) with probability q, else p_true",
    source: "Tukey, A survey of sampling from contaminated distributions, in Contributions to Probability and Statistics, 1960",
    parameters: &[
        Parameter {
            key: "probability",
            unit: "1",
            meaning: "share q of frames that is wrong",
            min: 0.0,
            max: 0.5,
            prior: Prior::LogNormal { median: 0.02, sigma_ln: 1.0 },
            neutral: Some(0.0),
            default: None,
        },
        Parameter {
            key: "sigma_m",
            unit: "m",
            meaning: "standard deviation of a wrong place about the right one, each axis",
            min: 0.0,
            max: 5.0,
            prior: Prior::LogNormal { median: 0.15, sigma_ln: 0.8 },
            neutral: None,
            default: None,
        },
    ],
    signature: Signature::spread(Spread::WrongPlaces),
    build,
};

fn build(values: &[f64], _: &Airframe, rng: EffectRng) -> Box<dyn Effect> {
    Box::new(TrackerOutliers { probability: values[0], sigma_m: values[1], rng })
}

struct TrackerOutliers {
    probability: f64,
    sigma_m: f64,
    rng: EffectRng,
}

impl Effect for TrackerOutliers {
    fn expose(&mut self, frame: &mut Frame) {
        // Drawn for every frame, so that the same seed puts more or fewer outliers in the same places.
        let draw: f64 = self.rng.random();
        let normal = Vector3::from_fn(|_, _| StandardNormal.sample(&mut self.rng));
        if draw < self.probability {
            frame.position_m += normal * self.sigma_m;
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::effects::testing::{effect, frame, mean_and_deviation};

    #[test]
    fn a_share_of_the_frames_is_wrong_and_the_others_are_exact() {
        let mut outliers = effect("tracker-outliers", &[0.1, 0.2]);
        let errors: Vec<f64> = (0..20_000)
            .map(|_| {
                let mut seen = frame();
                outliers.expose(&mut seen);
                seen.position_m.z - frame().position_m.z
            })
            .filter(|error| *error != 0.0)
            .collect();
        let (_, deviation) = mean_and_deviation(&errors);
        // 2000 of 20,000 with a deviation of 42; the deviation of 2000 draws is known to 1.6 %. Five sigmas.
        assert!((errors.len() as f64 - 2000.0).abs() < 212.0, "{}", errors.len());
        assert!((deviation / 0.2 - 1.0).abs() < 0.08, "{deviation}");
    }
}
