//! The control computer is late now and then: soft real time.

use bench_rig::Airframe;
use rand::RngExt;
use rand_distr::{Distribution, Exp1};

use super::{Effect, EffectRng, EffectSpec, Parameter, Prior, Reading, Signature, Stage};

/// A share of the iterations starts late.
pub(super) static SPEC: EffectSpec = EffectSpec {
    name: "loop-overrun",
    stage: Stage::Loop,
    summary: "now and then an iteration starts late",
    law: "lateness = mean E with probability q, else 0; E exponential with mean one",
    source: "Cervin, Henriksson, Lincoln, Eker, Årzén, How Does Control Timing Affect Performance?, IEEE Control Systems Magazine 23(3), 2003: sampling jitter and latency",
    parameters: &[
        Parameter {
            key: "probability",
            unit: "1",
            meaning: "share q of iterations that is late",
            min: 0.0,
            max: 1.0,
            prior: Prior::LogNormal { median: 0.05, sigma_ln: 1.0 },
            neutral: Some(0.0),
            default: None,
        },
        Parameter {
            key: "mean_s",
            unit: "s",
            meaning: "mean lateness of a late iteration",
            min: 0.0,
            max: 5.0,
            prior: Prior::LogNormal { median: 0.03, sigma_ln: 0.9 },
            neutral: None,
            default: None,
        },
    ],
    signature: Signature { reading: Some(Reading::LateIterations), ..Signature::READING },
    build,
};

fn build(values: &[f64], _: &Airframe, rng: EffectRng) -> Box<dyn Effect> {
    Box::new(LoopOverrun { probability: values[0], mean_s: values[1], rng })
}

struct LoopOverrun {
    probability: f64,
    mean_s: f64,
    rng: EffectRng,
}

impl Effect for LoopOverrun {
    fn lateness_s(&mut self) -> f64 {
        let draw: f64 = self.rng.random();
        let lateness: f64 = Exp1.sample(&mut self.rng);
        if draw < self.probability { self.mean_s * lateness } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use crate::effects::testing::{effect, mean_and_deviation};

    #[test]
    fn a_share_of_the_iterations_is_late_by_the_mean_asked_for() {
        let mut overrun = effect("loop-overrun", &[0.25, 0.04]);
        let late: Vec<f64> =
            (0..20_000).map(|_| overrun.lateness_s()).filter(|lateness| *lateness > 0.0).collect();
        let (mean, _) = mean_and_deviation(&late);
        // 5000 of 20,000 with a deviation of 61; the mean of 5000 is known to 1.4 %. Five sigmas.
        assert!((late.len() as f64 - 5000.0).abs() < 306.0, "{}", late.len());
        assert!((mean / 0.04 - 1.0).abs() < 0.07, "{mean}");
    }
}
