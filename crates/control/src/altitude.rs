//! Altitude: desired speed proportional to altitude error, thrust proportional and integral on speed error.

use bench_rig::{Airframe, ControlState, FeedForward, GRAVITY_M_S2, Rig};

use crate::{estimator::Estimate, ground_effect::GroundEffect};

/// The paper's figure 14, with anti-windup. Where the estimate tells the disturbance, that takes the integral's place;
/// where the rig asks for it, the ground effect is taken off the thrust.
#[derive(Debug)]
pub(crate) struct AltitudeLaw {
    airframe: Airframe,
    position_gain_per_s: f64,
    speed_gain_n_s_per_m: f64,
    integral_gain_n_per_m: f64,
    integral_n: f64,
    ground_effect: Option<GroundEffect>,
    drag_n_s_per_m: f64,
}

impl AltitudeLaw {
    pub(crate) fn new(rig: &Rig) -> Self {
        let mass_kg = rig.airframe.mass_kg.value;
        Self {
            position_gain_per_s: rig.control.position_gain_per_s,
            speed_gain_n_s_per_m: mass_kg * rig.control.speed_gain_per_s,
            integral_gain_n_per_m: mass_kg * rig.control.integral_gain_per_s2 * rig.control_loop.period_s,
            integral_n: rig.airframe.weight_n(),
            ground_effect: (rig.control.feed_forward == FeedForward::GroundEffect)
                .then(|| GroundEffect::new(&rig.airframe)),
            drag_n_s_per_m: rig.airframe.drag_n_s_per_m.value,
            airframe: rig.airframe.clone(),
        }
    }

    /// Throttle for a nominal thrust-to-weight ratio, within the sticks' range.
    pub(crate) fn open_loop(&self, thrust_to_weight: f64) -> f64 {
        self.clamped(self.airframe.throttle_for(thrust_to_weight * self.airframe.weight_n()))
    }

    /// One iteration towards `setpoint_m`, which itself moves at `setpoint_speed_m_s`. Returns the throttle and fills in
    /// the state's altitude part. Without an estimate the thrust stays at the integral term.
    pub(crate) fn closed_loop(
        &mut self,
        setpoint_m: f64,
        setpoint_speed_m_s: f64,
        estimate: Option<&Estimate>,
        state: &mut ControlState,
    ) -> f64 {
        let mut thrust_n = self.integral_n;
        let mut ground_effect = 1.0;
        if let Some(estimate) = estimate {
            let altitude_m = estimate.position_m[2];
            let altitude_error_m = setpoint_m - altitude_m;
            state.vertical_speed_setpoint_m_s =
                self.position_gain_per_s * altitude_error_m + setpoint_speed_m_s;
            let speed_error = state.vertical_speed_setpoint_m_s - estimate.velocity_m_s[2];
            state.vertical_speed_error_m_s = speed_error;
            if let Some(ground) = &self.ground_effect {
                ground_effect = ground.towards(setpoint_m, altitude_m);
            }
            if let Some([_, _, up]) = estimate.disturbance_m_s2 {
                self.integral_n = self.airframe.mass_kg.value * (GRAVITY_M_S2 - up);
                // Without an integral to find it, the drag at the speed asked for is asked for with it.
                thrust_n = self.drag_n_s_per_m * state.vertical_speed_setpoint_m_s;
            } else {
                let step_n = self.integral_gain_n_per_m * speed_error;
                let wanted_n = self.speed_gain_n_s_per_m * speed_error + self.integral_n + step_n;
                let throttle = self.airframe.throttle_for(wanted_n / ground_effect);
                // Anti-windup: the integral stands still while it would push further into the stop.
                let over = throttle - self.clamped(throttle);
                if over * step_n <= 0.0 {
                    self.integral_n = (self.integral_n + step_n).clamp(0.0, 2.0 * self.airframe.weight_n());
                }
                thrust_n = 0.0;
            }
            thrust_n += self.speed_gain_n_s_per_m * speed_error + self.integral_n;
        }
        state.integral_n = self.integral_n;
        state.thrust_n = thrust_n;
        self.clamped(self.airframe.throttle_for(thrust_n / ground_effect))
    }

    /// The ground effect that the law reckons with, if it does.
    pub(crate) fn ground_effect(&self) -> Option<&GroundEffect> {
        self.ground_effect.as_ref()
    }

    fn clamped(&self, throttle: f64) -> f64 {
        throttle.clamp(self.airframe.sticks.min, self.airframe.sticks.max)
    }
}
