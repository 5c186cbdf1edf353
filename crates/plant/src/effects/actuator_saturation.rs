//! The output cannot give all of the range that the rig promises.

use bench_device::Sticks;
use bench_rig::Rig;

use super::{Effect, EffectRng, EffectSpec, Parameter, Prior, Stage};

/// Throttle beyond a limit does nothing.
pub(super) static SPEC: EffectSpec = EffectSpec {
    name: "actuator-saturation",
    stage: Stage::Actuator,
    summary: "the throttle output saturates before its end; the readback shows it",
    law: "pin = min(command, throttle at which nominal T = r W)",
    source: "Hu and Lin, Control Systems with Actuator Saturation: Analysis and Design, 2001",
    parameters: &[Parameter {
        key: "high_thrust_to_weight",
        unit: "1",
        meaning: "nominal thrust over weight r at which the throttle saturates",
        min: 0.5,
        max: 20.0,
        prior: Prior::LogNormal { median: 1.15, sigma_ln: 0.2 },
        neutral: Some(20.0),
        default: None,
    }],
    build,
};

fn build(values: &[f64], rig: &Rig, _: EffectRng) -> Box<dyn Effect> {
    let limit = rig.airframe.throttle_for(values[0] * rig.airframe.weight_n());
    Box::new(ActuatorSaturation { limit })
}

struct ActuatorSaturation {
    limit: f64,
}

impl Effect for ActuatorSaturation {
    fn drive(&mut self, sticks: &mut Sticks) {
        sticks.throttle = sticks.throttle.min(self.limit);
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
}
