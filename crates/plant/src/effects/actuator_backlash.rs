//! Play between what is commanded and what the output does.

use bench_device::Sticks;
use bench_rig::Airframe;

use super::{Effect, EffectRng, EffectSpec, Parameter, Prior, Reading, Signature, Stage};

/// All four sticks pass a play operator.
pub(super) static SPEC: EffectSpec = EffectSpec {
    name: "actuator-backlash",
    stage: Stage::Actuator,
    summary: "the output follows only after the command has crossed some play; the readback shows it",
    law: "pin = clamp(pin_before, command - w/2, command + w/2), w = width_fraction (max - min)",
    source: "Nordin and Gutman, Controlling mechanical systems with backlash: a survey, Automatica 38(10), 2002",
    parameters: &[Parameter {
        key: "width_fraction",
        unit: "1",
        meaning: "play as a fraction of the stick range, all four sticks",
        min: 0.0,
        max: 0.5,
        prior: Prior::LogNormal { median: 0.015, sigma_ln: 0.8 },
        neutral: Some(0.0),
        default: None,
    }],
    signature: Signature { reading: Some(Reading::PinHysteresis), ..Signature::READING },
    build,
};

fn build(values: &[f64], airframe: &Airframe, _: EffectRng) -> Box<dyn Effect> {
    let range = airframe.sticks.max - airframe.sticks.min;
    Box::new(ActuatorBacklash { half_width: 0.5 * values[0] * range, held: None })
}

struct ActuatorBacklash {
    half_width: f64,
    /// In the middle of the play at the first input.
    held: Option<[f64; 4]>,
}

impl Effect for ActuatorBacklash {
    fn drive(&mut self, sticks: &mut Sticks) {
        let pins = sticks.to_array();
        let held = self.held.get_or_insert(pins);
        for (held, pin) in held.iter_mut().zip(pins) {
            *held = held.clamp(pin - self.half_width, pin + self.half_width);
        }
        *sticks = Sticks::from_array(*held);
    }
}

#[cfg(test)]
mod tests {
    use bench_device::Sticks;

    use crate::effects::testing::effect;

    #[test]
    fn a_stick_is_followed_half_a_width_behind_and_after_a_turn_only_a_width_later() {
        // A tenth of 3.3 V: half of the play is 0.165 V.
        let mut backlash = effect("actuator-backlash", &[0.1]);
        for (pin, expected) in [(1.0, 1.0), (1.1, 1.0), (1.5, 1.335), (1.2, 1.335), (1.0, 1.165)] {
            let mut sticks = Sticks::from_array([pin; 4]);
            backlash.drive(&mut sticks);
            for value in sticks.to_array() {
                assert!((value - expected).abs() < 1e-12, "{pin} gave {value}");
            }
        }
    }
}
