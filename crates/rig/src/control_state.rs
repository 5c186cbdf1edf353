use bench_device::Time;

use crate::Phase;

/// The controller's inner values after one iteration.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ControlState {
    /// When the iteration started.
    pub time: Time,
    /// What the controller is doing.
    pub phase: Phase,
    /// Wanted position, m.
    pub setpoint_m: [f64; 3],
    /// Wanted heading, rad.
    pub setpoint_heading_rad: f64,
    /// Position as predicted over the delay, m.
    pub estimate_m: [f64; 3],
    /// Velocity as predicted over the delay, m/s.
    pub estimate_m_s: [f64; 3],
    /// Wanted vertical speed, m/s.
    pub vertical_speed_setpoint_m_s: f64,
    /// Wanted less estimated vertical speed, m/s.
    pub vertical_speed_error_m_s: f64,
    /// Integral term of the altitude law, N.
    pub integral_n: f64,
    /// Wanted thrust, N.
    pub thrust_n: f64,
}
