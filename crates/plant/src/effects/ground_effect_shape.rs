//! The ground effect has no edge.

use bench_rig::Rig;

use super::{Effect, EffectRng, EffectSpec, Parameter, Prior, Stage};
use crate::nominal::Air;

/// The nominal ground effect, which ends at a height, blended with one that fades exponentially.
pub(super) static SPEC: EffectSpec = EffectSpec {
    name: "ground-effect-shape",
    stage: Stage::Environment,
    summary: "the ground effect fades exponentially instead of ending at a height",
    law: "extra = (1 - b) extra_nominal(z) + b (multiplier - 1) exp(-z/length)",
    source: "He, Kou, Calaf, Leang, In-Ground-Effect Modeling and Nonlinear-Disturbance Observer for Multirotor Unmanned Aerial Vehicle Control, ASME Journal of Dynamic Systems, Measurement, and Control 141(7), 2019: exponential model",
    parameters: &[
        Parameter {
            key: "blend",
            unit: "1",
            meaning: "share b of the exponential shape",
            min: 0.0,
            max: 1.0,
            prior: Prior::LogNormal { median: 0.5, sigma_ln: 0.5 },
            neutral: Some(0.0),
        },
        Parameter {
            key: "length_m",
            unit: "m",
            meaning: "height over which the exponential falls by e",
            min: 0.002,
            max: 2.0,
            prior: Prior::LogNormal { median: 0.04, sigma_ln: 0.7 },
            neutral: None,
        },
    ],
    build,
};

fn build(values: &[f64], rig: &Rig, _: EffectRng) -> Box<dyn Effect> {
    Box::new(GroundEffectShape {
        blend: values[0],
        length_m: values[1],
        gain: rig.airframe.ground_effect.multiplier.value - 1.0,
    })
}

struct GroundEffectShape {
    blend: f64,
    length_m: f64,
    gain: f64,
}

impl Effect for GroundEffectShape {
    fn ground_effect(&self, air: &Air, ground_effect: &mut f64) {
        let exponential = self.gain * (-air.height_m.max(0.0) / self.length_m).exp();
        *ground_effect += self.blend * (exponential - *ground_effect);
    }
}

#[cfg(test)]
mod tests {
    use crate::{
        effects::testing::{air, effect, rig},
        nominal::Nominal,
    };

    #[test]
    fn the_blend_lies_between_line_and_exponential() {
        let nominal = Nominal::new(&rig().airframe);
        let shape = effect("ground-effect-shape", &[0.25, 0.02]);
        // Multiplier 1.3 to 5 cm: on the line 0.3, 0.18, 0; on the exponential 0.3, 0.3/e, 0.3/e^5.
        for (height_m, line, tail) in [(0.0, 0.3, 0.3), (0.02, 0.18, 0.110_364), (0.1, 0.0, 0.002_021)] {
            let air = air(height_m, 0.0);
            let mut extra = nominal.ground_effect(height_m);
            shape.ground_effect(&air, &mut extra);
            assert!((extra - (0.75 * line + 0.25 * tail)).abs() < 1e-6, "{extra} at {height_m} m");
        }
    }
}
