//! The output has coarser steps than the rig says.

use bench_device::Sticks;
use bench_rig::Airframe;

use super::{Effect, EffectRng, EffectSpec, Parameter, Prior, Reading, Signature, Stage};

/// Sticks come in steps, counted from where each rests.
pub(super) static SPEC: EffectSpec = EffectSpec {
    name: "actuator-quantisation",
    stage: Stage::Actuator,
    summary: "the output moves in coarse steps; the readback shows it",
    law: "pin = rest + q round((command - rest)/q), q = step_fraction (max - min)",
    source: "Widrow and Kollár, Quantization Noise, 2008: uniform mid-tread quantiser",
    parameters: &[Parameter {
        key: "step_fraction",
        unit: "1",
        meaning: "step as a fraction of the stick range",
        min: 0.0,
        max: 0.25,
        prior: Prior::LogNormal { median: 0.01, sigma_ln: 0.9 },
        neutral: Some(0.0),
        default: None,
    }],
    signature: Signature { reading: Some(Reading::PinSteps), ..Signature::READING },
    build,
};

fn build(values: &[f64], airframe: &Airframe, _: EffectRng) -> Box<dyn Effect> {
    let sticks = &airframe.sticks;
    Box::new(ActuatorQuantisation {
        step: values[0] * (sticks.max - sticks.min),
        // A hand controller takes its sticks' places at switch-on for rest.
        rest: [sticks.min, sticks.centre, sticks.centre, sticks.centre],
    })
}

struct ActuatorQuantisation {
    step: f64,
    rest: [f64; 4],
}

impl Effect for ActuatorQuantisation {
    fn drive(&mut self, sticks: &mut Sticks) {
        if self.step == 0.0 {
            return;
        }
        let mut values = sticks.to_array();
        for (value, rest) in values.iter_mut().zip(self.rest) {
            *value = rest + self.step * ((*value - rest) / self.step).round();
        }
        *sticks = Sticks::from_array(values);
    }
}

#[cfg(test)]
mod tests {
    use bench_device::Sticks;

    use crate::effects::testing::effect;

    #[test]
    fn sticks_round_to_steps_from_their_rest() {
        // A tenth of 0 to 3.3 V: steps of 0.33 V from 0 V for throttle, from 1.65 V for the others.
        let mut sticks = Sticks { throttle: 1.9, pitch: 1.65, roll: 1.8, yaw: 1.83 };
        effect("actuator-quantisation", &[0.1]).drive(&mut sticks);
        for (value, expected) in sticks.to_array().into_iter().zip([1.98, 1.65, 1.65, 1.98]) {
            assert!((value - expected).abs() < 1e-12, "{value}, not {expected}");
        }
    }
}
