//! Horizontal position and heading through pitch, roll and yaw.

use bench_rig::{GRAVITY_M_S2, Rig, StickRange};

use crate::estimator::Estimate;

/// The altitude law's shape sideways: wanted speed from position error, acceleration from speed error, tilt from
/// acceleration; and a yaw rate proportional to the heading error. Where the estimate tells the disturbance, that takes the
/// integral's place.
#[derive(Debug)]
pub(crate) struct LateralLaw {
    sticks: StickRange,
    position_gain_per_s: f64,
    speed_gain_per_s: f64,
    integral_gain_per_s: f64,
    tilt_max_rad: f64,
    heading_gain_per_s: f64,
    drag_per_s: f64,
    /// World frame, m/s^2; trims what the sticks' centre does not.
    integral_m_s2: [f64; 2],
}

/// Pitch, roll and yaw.
pub(crate) type LateralSticks = [f64; 3];

impl LateralLaw {
    pub(crate) fn new(rig: &Rig) -> Self {
        Self {
            sticks: rig.airframe.sticks,
            position_gain_per_s: rig.control.lateral_position_gain_per_s,
            speed_gain_per_s: rig.control.lateral_speed_gain_per_s,
            integral_gain_per_s: rig.control.lateral_integral_gain_per_s2 * rig.control_loop.period_s,
            tilt_max_rad: rig.control.tilt_max_rad,
            heading_gain_per_s: rig.control.heading_gain_per_s,
            drag_per_s: rig.airframe.drag_n_s_per_m.value / rig.airframe.mass_kg.value,
            integral_m_s2: [0.0; 2],
        }
    }

    /// Level, no turning.
    pub(crate) fn centred(&self) -> LateralSticks {
        [self.sticks.centre; 3]
    }

    /// One iteration towards a horizontal position [m] and heading [rad].
    pub(crate) fn closed_loop(
        &mut self,
        setpoint_m: [f64; 2],
        heading_setpoint_rad: f64,
        estimate: &Estimate,
    ) -> LateralSticks {
        let limit = GRAVITY_M_S2 * self.tilt_max_rad.tan();
        let mut acceleration = [0.0; 2];
        for axis in 0..2 {
            let wanted_speed = self.position_gain_per_s * (setpoint_m[axis] - estimate.position_m[axis]);
            let speed_error = wanted_speed - estimate.velocity_m_s[axis];
            if let Some(disturbance) = estimate.disturbance_m_s2 {
                let wanted = self.speed_gain_per_s * speed_error + self.drag_per_s * wanted_speed;
                acceleration[axis] = (wanted - disturbance[axis]).clamp(-limit, limit);
                continue;
            }
            let step = self.integral_gain_per_s * speed_error;
            let wanted = self.speed_gain_per_s * speed_error + self.integral_m_s2[axis] + step;
            acceleration[axis] = wanted.clamp(-limit, limit);
            // Anti-windup, as for altitude.
            if (wanted - acceleration[axis]) * step <= 0.0 {
                self.integral_m_s2[axis] += step;
            }
        }
        let (sin, cos) = estimate.heading_rad.sin_cos();
        let forward = cos * acceleration[0] + sin * acceleration[1];
        let left = cos * acceleration[1] - sin * acceleration[0];
        let heading_error = wrapped_rad(heading_setpoint_rad - estimate.heading_rad);
        [
            self.stick((forward / GRAVITY_M_S2).atan() / self.sticks.tilt_rad_per_unit),
            self.stick(-(left / GRAVITY_M_S2).atan() / self.sticks.tilt_rad_per_unit),
            self.stick(self.heading_gain_per_s * heading_error / self.sticks.yaw_rate_rad_s_per_unit),
        ]
    }

    /// A stick away from its centre; an airframe without this axis (zero per unit) keeps it centred.
    fn stick(&self, from_centre: f64) -> f64 {
        if from_centre.is_finite() {
            (self.sticks.centre + from_centre).clamp(self.sticks.min, self.sticks.max)
        } else {
            self.sticks.centre
        }
    }
}

/// The same angle in (-pi, pi].
fn wrapped_rad(angle_rad: f64) -> f64 {
    let turns = angle_rad / std::f64::consts::TAU;
    (turns - turns.round()) * std::f64::consts::TAU
}
