//! A ceiling, or a lid over the test volume, draws the rotors up.

use bench_rig::Airframe;

use super::{Axis, Effect, EffectRng, EffectSpec, Parameter, Prior, Signature, Stage, power};
use crate::nominal::Air;

/// Thrust grows exponentially towards a surface above, which stops the airframe.
pub(super) static SPEC: EffectSpec = EffectSpec {
    name: "ceiling-effect",
    stage: Stage::Environment,
    summary: "thrust grows near a surface above, which stops the airframe",
    law: "T' = T (1 + gain exp(-(max(0, ceiling - z)/decay)^p))",
    source: "Hsiao and Chirarattananon, Ceiling Effects for Hybrid Aerial-Surface Locomotion of Small Rotorcraft, IEEE/ASME Transactions on Mechatronics 24(5), 2019: the effect on small rotors; its exponential fit as in the ground-effect model of He, Kou, Calaf, Leang, 2019",
    parameters: &[
        Parameter {
            key: "gain",
            unit: "1",
            meaning: "fraction of thrust gained at the ceiling",
            min: 0.0,
            max: 3.0,
            prior: Prior::LogNormal { median: 0.4, sigma_ln: 0.5 },
            neutral: Some(0.0),
            default: None,
        },
        Parameter {
            key: "ceiling_m",
            unit: "m",
            meaning: "height of the ceiling above the take-off surface",
            min: 0.05,
            max: 100.0,
            prior: Prior::LogNormal { median: 0.8, sigma_ln: 0.5 },
            neutral: None,
            default: None,
        },
        Parameter {
            key: "decay_m",
            unit: "m",
            meaning: "distance over which the gain falls by e",
            min: 0.002,
            max: 5.0,
            prior: Prior::LogNormal { median: 0.06, sigma_ln: 0.7 },
            neutral: None,
            default: None,
        },
        Parameter {
            key: "exponent",
            unit: "1",
            meaning: "power of the distance in the exponential",
            min: 0.3,
            max: 4.0,
            prior: Prior::LogNormal { median: 1.0, sigma_ln: 0.55 },
            neutral: None,
            default: Some(1.0),
        },
    ],
    signature: Signature { axes: &[Axis::Altitude], ..Signature::LAW },
    build,
};

fn build(values: &[f64], _: &Airframe, _: EffectRng) -> Box<dyn Effect> {
    Box::new(CeilingEffect { gain: values[0], ceiling_m: values[1], decay_m: values[2], exponent: values[3] })
}

struct CeilingEffect {
    gain: f64,
    ceiling_m: f64,
    decay_m: f64,
    exponent: f64,
}

impl Effect for CeilingEffect {
    fn thrust(&self, air: &Air, thrust_n: &mut f64) {
        let distance_m = (self.ceiling_m - air.height_m).max(0.0);
        *thrust_n *= 1.0 + self.gain * (-power(distance_m / self.decay_m, self.exponent)).exp();
    }

    fn ceiling_m(&self) -> f64 {
        // Without gain there is no ceiling.
        if self.gain > 0.0 { self.ceiling_m } else { f64::INFINITY }
    }
}

#[cfg(test)]
mod tests {
    use crate::effects::testing::{air, effect};

    #[test]
    fn the_gain_is_full_at_the_ceiling_and_falls_by_e_over_the_decay() {
        let ceiling = effect("ceiling-effect", &[0.4, 1.0, 0.1]);
        let gain_at = |height_m| {
            let mut thrust_n = 1.0;
            ceiling.thrust(&air(height_m, 0.0), &mut thrust_n);
            thrust_n - 1.0
        };
        assert!((gain_at(1.0) - 0.4).abs() < 1e-12);
        assert!((gain_at(0.9) - 0.4 * (-1.0_f64).exp()).abs() < 1e-12);
        assert!(gain_at(0.0) < 0.4 * 5e-5);
    }

    #[test]
    fn the_gain_may_fall_with_another_power_of_the_distance() {
        let ceiling = effect("ceiling-effect", &[0.4, 1.0, 0.1, 2.0]);
        let mut thrust_n = 1.0;
        ceiling.thrust(&air(0.8, 0.0), &mut thrust_n);
        assert!((thrust_n - 1.0 - 0.4 * (-4.0_f64).exp()).abs() < 1e-12);
    }
}
