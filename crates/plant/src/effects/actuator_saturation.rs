//! The output cannot give all of the range that the rig promises.

use bench_device::Sticks;
use bench_rig::Airframe;

use super::{Effect, EffectRng, EffectSpec, Parameter, Prior, Reading, Signature, Stage};

/// Throttle beyond a limit does nothing, nor, where there is one, below a floor; the stick at its end stops the motors.
pub(super) static SPEC: EffectSpec = EffectSpec {
    name: "actuator-saturation",
    stage: Stage::Actuator,
    summary: "the throttle output saturates before its end; the readback shows it",
    law: "pin = min(max(command, throttle at which nominal T = f W), throttle at which T = r W)",
    source: "Hu and Lin, Control Systems with Actuator Saturation: Analysis and Design, 2001",
    parameters: &[
        Parameter {
            key: "high_thrust_to_weight",
            unit: "1",
            meaning: "nominal thrust over weight r at which the throttle saturates",
            min: 0.5,
            max: 20.0,
            prior: Prior::LogNormal { median: 1.15, sigma_ln: 0.2 },
            neutral: Some(20.0),
            default: None,
        },
        Parameter {
            key: "low_thrust_to_weight",
            unit: "1",
            meaning: "nominal thrust over weight f below which the throttle does not go but to its end; 0 for none",
            min: 0.0,
            max: 20.0,
            prior: Prior::LogNormal { median: 0.85, sigma_ln: 0.2 },
            neutral: Some(0.0),
            default: Some(0.0),
        },
    ],
    signature: Signature { reading: Some(Reading::PinLimit), ..Signature::READING },
    build,
};

fn build(values: &[f64], airframe: &Airframe, _: EffectRng) -> Box<dyn Effect> {
    let throttle_for = |ratio: f64| airframe.throttle_for(ratio * airframe.weight_n());
    let low = if values[1] > 0.0 { throttle_for(values[1]) } else { f64::NEG_INFINITY };
    Box::new(ActuatorSaturation { off: airframe.sticks.min, low, high: throttle_for(values[0]) })
}

struct ActuatorSaturation {
    off: f64,
    low: f64,
    high: f64,
}

impl Effect for ActuatorSaturation {
    fn drive(&mut self, sticks: &mut Sticks) {
        if sticks.throttle > self.off {
            sticks.throttle = sticks.throttle.max(self.low).min(self.high);
        }
    }
}

#[cfg(test)]
mod tests {
    use bench_device::Sticks;

    use crate::effects::testing::{effect, rig};

    #[test]
    fn throttle_stops_where_thrust_reaches_the_ratio_and_is_untouched_below() {
        let airframe = rig().airframe;
        let mut saturation = effect("actuator-saturation", &[1.1]);
        for (asked, given) in [(0.9, 0.9), (1.1, 1.1), (1.6, 1.1)] {
            let throttle = airframe.throttle_for(asked * airframe.weight_n());
            let mut sticks = Sticks { throttle, ..Sticks::default() };
            saturation.drive(&mut sticks);
            let ratio = airframe.thrust_n(sticks.throttle) / airframe.weight_n();
            assert!((ratio - given).abs() < 1e-12, "{asked} gave {ratio}");
        }
    }

    #[test]
    fn throttle_does_not_go_below_a_floor_but_off() {
        let airframe = rig().airframe;
        let mut saturation = effect("actuator-saturation", &[20.0, 0.8]);
        for (asked, given) in [(0.3, 0.8), (0.9, 0.9)] {
            let throttle = airframe.throttle_for(asked * airframe.weight_n());
            let mut sticks = Sticks { throttle, ..Sticks::default() };
            saturation.drive(&mut sticks);
            let ratio = airframe.thrust_n(sticks.throttle) / airframe.weight_n();
            assert!((ratio - given).abs() < 1e-12, "{asked} gave {ratio}");
        }
        let mut sticks = Sticks { throttle: airframe.sticks.min, ..Sticks::default() };
        saturation.drive(&mut sticks);
        assert_eq!(sticks.throttle, airframe.sticks.min);
    }
}
