//! The airframe held still on a rig, where a balance shows its thrust (paper, section 3.4, figure 8).

use bench_device::Sticks;
use bench_rig::{Output, Rig, StickRange};
use nalgebra::Vector3;

use crate::{
    effects::{EffectError, Effects},
    nominal::{Air, Forces, Nominal},
};

/// A throttle is held so long before the balance is read, s.
const SETTLE_S: f64 = 2.0;
/// Steps in which effects' states move on, s. Their laws are exact for any step with inputs held.
const STEP_S: f64 = 0.05;

/// An airframe of a rig that cannot move. Effects of actuator, propulsion and environment act as in flight, with a speed
/// of zero.
pub struct HeldAirframe {
    nominal: Nominal,
    effects: Effects,
    output: Output,
    sticks: StickRange,
}

impl HeldAirframe {
    /// Rotors at rest, battery as the rig says.
    pub fn new(rig: &Rig, seed: u64) -> Result<Self, EffectError> {
        Ok(Self {
            nominal: Nominal::new(&rig.airframe),
            effects: Effects::from_rig(rig, seed)?,
            output: rig.output,
            sticks: rig.airframe.sticks,
        })
    }

    /// Draws as much charge as so many minutes of hover do. Without an effect on the battery nothing changes.
    pub fn hover(&mut self, minutes: f64) {
        let steps = (minutes.max(0.0) * 60.0 / STEP_S).round() as u64;
        for _ in 0..steps {
            let mut thrust_n = self.nominal.weight_n;
            for effect in &mut self.effects.propulsion {
                effect.propel(STEP_S, &mut thrust_n);
            }
        }
    }

    /// Thrust once a throttle has been held for two seconds at a height above a surface, N. The throttle is what is
    /// commanded: the output's range and resolution act on it.
    pub fn thrust_n(&mut self, throttle: f64, height_m: f64) -> f64 {
        let mut asked = Sticks { throttle, ..self.sticks.at_rest() };
        for effect in &mut self.effects.actuator {
            effect.drive(&mut asked);
        }
        let pin = asked.map(|value| self.output.on_the_pin(&self.sticks, value));
        let mut free_thrust_n = 0.0;
        for _ in 0..(SETTLE_S / STEP_S).round() as u64 {
            let mut sticks = pin;
            for effect in &mut self.effects.actuator {
                effect.actuate(STEP_S, &mut sticks);
            }
            free_thrust_n = self.nominal.free_thrust_n(sticks.throttle);
            for effect in &mut self.effects.propulsion {
                effect.propel(STEP_S, &mut free_thrust_n);
            }
            let air = held(height_m, free_thrust_n);
            for effect in &mut self.effects.air {
                effect.advance(STEP_S, &air);
            }
        }
        let forces = Forces {
            nominal: &self.nominal,
            effects: &self.effects,
            free_thrust_n,
            mass_kg: self.nominal.mass_kg,
        };
        forces.thrust_n(&held(height_m, free_thrust_n))
    }
}

fn held(height_m: f64, free_thrust_n: f64) -> Air {
    Air { height_m, velocity_m_s: Vector3::zeros(), tilt_cos: 1.0, free_thrust_n }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::effects::parse_effect;

    fn rig() -> Rig {
        let mut rig =
            Rig::load(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs/virtual.toml")).unwrap();
        rig.output.bits = 0;
        rig
    }

    #[test]
    fn it_is_the_nominal_thrust_with_the_ground_effect() {
        let mut airframe = HeldAirframe::new(&rig(), 0).unwrap();
        let free_n = 0.1051 * (1.9 - 0.5);
        assert!((airframe.thrust_n(1.9, 1.0) - free_n).abs() < 1e-12);
        // Halfway up to 5 cm, half of 30 %.
        assert!((airframe.thrust_n(1.9, 0.025) - 1.15 * free_n).abs() < 1e-12);
        assert_eq!(airframe.thrust_n(0.4, 0.0), 0.0);
    }

    #[test]
    fn a_drawn_battery_gives_less() {
        let mut rig = rig();
        rig.effects.push(parse_effect("battery-discharge:loss_per_hover_minute=0.02").unwrap());
        let mut airframe = HeldAirframe::new(&rig, 0).unwrap();
        let fresh_n = airframe.thrust_n(1.9, 1.0);
        airframe.hover(3.0);
        // exp(-0.06), but for the two seconds of each reading.
        assert!((airframe.thrust_n(1.9, 1.0) / fresh_n - (-0.06_f64).exp()).abs() < 0.002);
    }
}
