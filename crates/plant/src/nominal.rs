//! The paper's force law (sections 3.2 and 3.3), with the hooks for what it lacks.

use bench_rig::Airframe;
use nalgebra::Vector3;

use crate::{
    effects::Effects,
    lanes::Real,
    rigid::{ForceLaw, Instant},
};

/// The nominal airframe's numbers, ready for the inner loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nominal {
    /// Mass, kg.
    pub mass_kg: f64,
    /// Weight, N.
    pub weight_n: f64,
    /// Thrust per unit of throttle, N.
    pub gain_n_per_unit: f64,
    /// Throttle at which thrust begins.
    pub offset: f64,
    /// Ground-effect multiplier less one.
    pub ground_effect_gain: f64,
    /// Where the ground effect ends, m.
    pub ground_effect_height_m: f64,
    /// Linear drag, N s/m.
    pub drag_n_s_per_m: f64,
}

impl Nominal {
    /// The nominal values of an airframe.
    pub fn new(airframe: &Airframe) -> Self {
        Self {
            mass_kg: airframe.mass_kg.value,
            weight_n: airframe.weight_n(),
            gain_n_per_unit: airframe.thrust.gain_n_per_unit.value,
            offset: airframe.thrust.offset.value,
            ground_effect_gain: airframe.ground_effect.multiplier.value - 1.0,
            ground_effect_height_m: airframe.ground_effect.height_m.value,
            drag_n_s_per_m: airframe.drag_n_s_per_m.value,
        }
    }

    /// Thrust out of the ground effect for a throttle, N (figure 9).
    #[inline]
    pub fn free_thrust_n(&self, throttle: f64) -> f64 {
        (self.gain_n_per_unit * (throttle - self.offset)).max(0.0)
    }

    /// Thrust multiplier less one at a height (figure 10).
    #[inline]
    pub fn ground_effect(&self, height_m: f64) -> f64 {
        ground_effect(self.ground_effect_gain, self.ground_effect_height_m, height_m)
    }
}

/// The ground effect's law: `gain` on the ground, nothing from `until_m` on.
#[inline(always)]
pub(crate) fn ground_effect<T: Real>(gain: T, until_m: T, height_m: T) -> T {
    let zero = gain.constant(0.0);
    height_m.below(until_m, || gain * (gain.constant(1.0) - height_m.at_least(zero) / until_m))
}

/// Vertical thrust for a thrust out of the ground effect, N.
#[inline(always)]
pub(crate) fn vertical_thrust_n<T: Real>(free_thrust_n: T, ground_effect: T) -> T {
    free_thrust_n * (free_thrust_n.constant(1.0) + ground_effect)
}

/// Linear drag, N.
#[inline(always)]
pub(crate) fn drag_n<T: Real>(drag_n_s_per_m: T, velocity_m_s: &[T; 3]) -> [T; 3] {
    let [x, y, z] = *velocity_m_s;
    [x * -drag_n_s_per_m, y * -drag_n_s_per_m, z * -drag_n_s_per_m]
}

/// What a force law may look at: the airframe in its environment at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Air {
    /// Height above the take-off surface, m.
    pub height_m: f64,
    /// Velocity in the world frame, m/s.
    pub velocity_m_s: Vector3<f64>,
    /// Cosine of the angle between the body's z and the vertical.
    pub tilt_cos: f64,
    /// Thrust out of the ground effect at this instant, N.
    pub free_thrust_n: f64,
}

/// The forces of one integration step, during which sticks and effects' states are held.
pub struct Forces<'a> {
    /// The nominal numbers.
    pub nominal: &'a Nominal,
    /// The effects that act.
    pub effects: &'a Effects,
    /// Thrust out of the ground effect, effects of actuator and propulsion included, N.
    pub free_thrust_n: f64,
    /// Mass with effects, kg.
    pub mass_kg: f64,
}

impl Forces<'_> {
    /// Vertical thrust of all rotors, ground effect included, N. The nominal stabiliser keeps this the same at any tilt.
    #[inline]
    pub fn thrust_n(&self, air: &Air) -> f64 {
        let ground_effect = self.nominal.ground_effect(air.height_m);
        let thrust_n = if self.effects.air.is_empty() {
            vertical_thrust_n(self.free_thrust_n, ground_effect)
        } else {
            self.thrust_with_effects_n(*air, ground_effect)
        };
        thrust_n.at_least(0.0)
    }

    /// Drag and other forces on the airframe except thrust and weight, world frame, N.
    #[inline]
    pub fn drag_n(&self, air: &Air) -> Vector3<f64> {
        let drag_n = Vector3::from(drag_n(self.nominal.drag_n_s_per_m, air.velocity_m_s.as_ref()));
        if self.effects.air.is_empty() {
            return drag_n;
        }
        let [x, y, z] = self.drag_with_effects_n(*air, drag_n);
        Vector3::new(x, y, z)
    }

    // Apart and by value, so that a flight without effects keeps its state in registers: that halves a step.

    #[inline(never)]
    fn thrust_with_effects_n(&self, air: Air, mut ground_effect: f64) -> f64 {
        for effect in &self.effects.air {
            effect.ground_effect(&air, &mut ground_effect);
        }
        let mut thrust_n = vertical_thrust_n(self.free_thrust_n, ground_effect);
        for effect in &self.effects.air {
            effect.thrust(&air, &mut thrust_n);
        }
        thrust_n
    }

    #[inline(never)]
    fn drag_with_effects_n(&self, air: Air, mut force_n: Vector3<f64>) -> [f64; 3] {
        for effect in &self.effects.air {
            effect.force(&air, &mut force_n);
        }
        force_n.into()
    }
}

impl ForceLaw<f64> for Forces<'_> {
    #[inline]
    fn thrust_n(&self, at: &Instant<f64>) -> f64 {
        self.thrust_n(&at.air(self.free_thrust_n))
    }

    #[inline]
    fn drag_n(&self, at: &Instant<f64>) -> [f64; 3] {
        self.drag_n(&at.air(self.free_thrust_n)).into()
    }
}

impl Instant<f64> {
    #[inline]
    fn air(&self, free_thrust_n: f64) -> Air {
        let Self { height_m, tilt_cos, .. } = *self;
        Air { height_m, velocity_m_s: self.velocity_m_s.into(), tilt_cos, free_thrust_n }
    }
}
