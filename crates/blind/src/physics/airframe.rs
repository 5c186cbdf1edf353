//! Mass, drag and what motion does to thrust.

use super::law::{Law, Memory, Now, Push};

/// The airframe is heavier (or lighter) than its file says.
#[derive(Debug)]
pub(crate) struct Payload {
    pub fraction: f64,
}

impl Law for Payload {
    fn act(&self, _: &Now, _: &Memory, push: &mut Push) -> Memory {
        push.mass_kg *= 1.0 + self.fraction;
        [0.0; 3]
    }
}

/// Drag as a power of speed through the air, beside the linear one.
#[derive(Debug)]
pub(crate) struct PowerDrag {
    /// Drag at 1 m/s, N.
    pub at_1_m_s_n: f64,
    pub exponent: f64,
}

impl Law for PowerDrag {
    fn act(&self, now: &Now, _: &Memory, push: &mut Push) -> Memory {
        let speed = now.v_m_s - push.air_m_s;
        push.force_n -= self.at_1_m_s_n * speed.signum() * speed.abs().powf(self.exponent);
        [0.0; 3]
    }
}

/// Thrust is lost about one descent speed: the rotors fly in their own ring vortex, and leave it below.
#[derive(Debug)]
pub(crate) struct RingVortex {
    pub depth: f64,
    pub centre_m_s: f64,
    pub width_m_s: f64,
}

impl Law for RingVortex {
    fn act(&self, now: &Now, _: &Memory, push: &mut Push) -> Memory {
        let descent = (push.air_m_s - now.v_m_s).max(0.0);
        let bell = |x: f64| (-((x - self.centre_m_s) / self.width_m_s).powi(2)).exp();
        // None in hover.
        push.factor *= 1.0 - self.depth * (bell(descent) - bell(0.0)).max(0.0);
        [0.0; 3]
    }
}

/// Thrust is lost beyond a descent speed, as a ramp that levels off.
#[derive(Debug)]
pub(crate) struct WakeRamp {
    pub depth: f64,
    pub onset_m_s: f64,
    pub full_m_s: f64,
}

impl Law for WakeRamp {
    fn act(&self, now: &Now, _: &Memory, push: &mut Push) -> Memory {
        let descent = push.air_m_s - now.v_m_s;
        let ramp = ((descent - self.onset_m_s) / (self.full_m_s - self.onset_m_s)).clamp(0.0, 1.0);
        push.factor *= 1.0 - self.depth * ramp;
        [0.0; 3]
    }
}

/// Thrust falls in climb as inflow grows, with the inflow's own lag, and levels off.
#[derive(Debug)]
pub(crate) struct LaggedInflow {
    pub slope_s_per_m: f64,
    pub level_m_s: f64,
    pub lag_s: f64,
}

impl Law for LaggedInflow {
    fn act(&self, now: &Now, [inflow, ..]: &Memory, push: &mut Push) -> Memory {
        let speed = now.v_m_s - push.air_m_s;
        let steady = self.level_m_s * (speed / self.level_m_s).tanh();
        push.force_n -= self.slope_s_per_m * now.weight_n * inflow;
        [(steady - inflow) / self.lag_s, 0.0, 0.0]
    }
}

/// Thrust at a fixed rotor speed by momentum theory: the climb takes part of what the rotor gives the air.
///
/// Source: Leishman, Principles of Helicopter Aerodynamics, 2nd ed., 2006, section 2.13: induced speed in climb.
#[derive(Debug)]
pub(crate) struct MomentumInflow {
    /// Loss per climb speed at small speeds, as a fraction of thrust.
    pub slope_s_per_m: f64,
    /// Induced speed in hover, m/s.
    pub hover_m_s: f64,
}

impl Law for MomentumInflow {
    fn act(&self, now: &Now, _: &Memory, push: &mut Push) -> Memory {
        let climb = 0.5 * (now.v_m_s - push.air_m_s) / self.hover_m_s;
        // Inflow over its value in hover, less one; its slope at rest is one half.
        let inflow = climb + climb.hypot(1.0) - 1.0;
        push.factor *= (1.0 - 2.0 * self.hover_m_s * self.slope_s_per_m * inflow).max(0.0);
        [0.0; 3]
    }
}
