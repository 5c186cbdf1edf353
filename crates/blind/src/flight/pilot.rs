//! The paper's controller, written again: position and speed extrapolated over the delay, desired speed from altitude
//! error, thrust from speed error by a proportional and an integral term that starts at the weight (section 3.7).

use std::collections::VecDeque;

use bench_device::{Sticks, Time};
use bench_rig::{ControlState, Mission, Phase, PhaseAction, Rig};
use nalgebra::{Matrix3, Vector3};

/// Flies a mission.
pub(crate) struct Pilot<'a> {
    rig: &'a Rig,
    mission: &'a Mission,
    /// Believed exposure [s] and altitude [m], newest last.
    seen: VecDeque<[f64; 2]>,
    integral_n: f64,
    aborted: bool,
    /// Throttle was cut at the end of a landing.
    cut: bool,
    /// Last set-point of a hold, m.
    held_m: f64,
}

/// Altitude and vertical speed as they should be by now.
struct Guess {
    z_m: f64,
    v_m_s: f64,
}

impl<'a> Pilot<'a> {
    pub(crate) fn new(rig: &'a Rig, mission: &'a Mission) -> Self {
        let integral_n = rig.airframe.weight_n();
        Self { rig, mission, seen: VecDeque::new(), integral_n, aborted: false, cut: false, held_m: 0.0 }
    }

    /// Takes a position, oldest first.
    pub(crate) fn observe(&mut self, exposed_s: f64, z_m: f64) {
        self.seen.push_back([exposed_s, z_m]);
        let window_s = 2.0 * self.rig.control.velocity_window_s;
        while self.seen.front().is_some_and(|[t, _]| exposed_s - t > window_s + 1e-3) {
            self.seen.pop_front();
        }
        // Above the ceiling the flight is given up, as the bench does.
        self.aborted |= z_m > self.rig.safety.ceiling_m;
    }

    /// One iteration: state and sticks.
    pub(crate) fn decide(&mut self, started: Time) -> (ControlState, Sticks) {
        let mut state = ControlState { time: started, ..Default::default() };
        let guess = self.guess();
        if let Some(guess) = &guess {
            state.estimate_m[2] = guess.z_m;
            state.estimate_m_s[2] = guess.v_m_s;
        }
        let throttle = self.throttle(started.seconds(), guess.as_ref(), &mut state);
        state.integral_n = self.integral_n;
        let sticks = self.rig.airframe.sticks;
        let centre = sticks.centre;
        (state, Sticks { throttle, pitch: centre, roll: centre, yaw: centre })
    }

    fn throttle(&mut self, t_s: f64, guess: Option<&Guess>, state: &mut ControlState) -> f64 {
        let sticks = self.rig.airframe.sticks;
        let weight_n = self.rig.airframe.weight_n();
        let (action, since_s, duration_s) = self.action(t_s);
        state.phase = if self.aborted { Phase::Abort } else { action.phase() };
        if self.aborted {
            return sticks.min;
        }
        match action {
            PhaseAction::Idle => sticks.min,
            PhaseAction::Launch { thrust_to_weight } => {
                state.thrust_n = thrust_to_weight.at(since_s) * weight_n;
                self.clamped(state.thrust_n)
            }
            PhaseAction::Open { thrust_to_weight, chirp } => {
                let sweep = chirp.map_or(0.0, |chirp| chirp.at(since_s, duration_s));
                state.thrust_n = (thrust_to_weight.at(since_s) + sweep) * weight_n;
                self.clamped(state.thrust_n)
            }
            PhaseAction::Hold { altitude_m, chirp, .. } => {
                let sweep = chirp.map_or(0.0, |chirp| chirp.at(since_s, duration_s));
                self.held_m = altitude_m.at(since_s) + sweep;
                self.closed_loop(self.held_m, 0.0, guess, state)
            }
            PhaseAction::Land { descent_m_s, cut_below_m } => {
                self.cut |= self.seen.back().is_some_and(|[_, z_m]| z_m < cut_below_m);
                if self.cut {
                    return sticks.min;
                }
                let wanted_m = (self.held_m - descent_m_s * since_s).max(0.0);
                self.closed_loop(wanted_m, -descent_m_s, guess, state)
            }
        }
    }

    /// What the mission asks for at an instant: the action, how long it has lasted, and how long it lasts in all.
    fn action(&self, t_s: f64) -> (&'a PhaseAction, f64, f64) {
        const REST: &PhaseAction = &PhaseAction::Idle;
        let mut begin_s = 0.0;
        for plan in &self.mission.phases {
            if t_s < begin_s + plan.duration_s {
                return (&plan.action, t_s - begin_s, plan.duration_s);
            }
            begin_s += plan.duration_s;
        }
        // Lateness of the last iteration may carry it past the end.
        let last = self.mission.phases.last();
        last.map_or((REST, 0.0, 1.0), |plan| (&plan.action, plan.duration_s, plan.duration_s))
    }

    /// Figure 14.
    fn closed_loop(
        &mut self,
        wanted_m: f64,
        ahead_m_s: f64,
        guess: Option<&Guess>,
        state: &mut ControlState,
    ) -> f64 {
        let control = &self.rig.control;
        let mass_kg = self.rig.airframe.mass_kg.value;
        state.setpoint_m[2] = wanted_m;
        let mut thrust_n = self.integral_n;
        if let Some(guess) = guess {
            let wanted_m_s = (wanted_m - guess.z_m) * control.position_gain_per_s + ahead_m_s;
            let error_m_s = wanted_m_s - guess.v_m_s;
            state.vertical_speed_setpoint_m_s = wanted_m_s;
            state.vertical_speed_error_m_s = error_m_s;
            let weight_n = self.rig.airframe.weight_n();
            let gain = mass_kg * control.integral_gain_per_s2 * self.rig.control_loop.period_s;
            self.integral_n = (self.integral_n + gain * error_m_s).clamp(0.5 * weight_n, 1.6 * weight_n);
            thrust_n = self.integral_n + mass_kg * control.speed_gain_per_s * error_m_s;
        }
        state.thrust_n = thrust_n;
        self.clamped(thrust_n)
    }

    fn clamped(&self, thrust_n: f64) -> f64 {
        let sticks = self.rig.airframe.sticks;
        self.rig.airframe.throttle_for(thrust_n).clamp(sticks.min, sticks.max)
    }

    /// A parabola through the window gives position, speed and acceleration at its end; both are taken on in straight
    /// lines over the delay. The rig's delay holds half of a velocity window, which a parabola does not lag by.
    fn guess(&self) -> Option<Guess> {
        let control = &self.rig.control;
        let &[newest_s, newest_m] = self.seen.back()?;
        let delay_s = (control.extrapolation_s - 0.5 * control.velocity_window_s).max(0.0);
        let mut normal = Matrix3::zeros();
        let mut right = Vector3::zeros();
        for [t_s, z_m] in &self.seen {
            let x = t_s - newest_s;
            let row = Vector3::new(1.0, x, 0.5 * x * x);
            normal += row * row.transpose();
            right += row * *z_m;
        }
        let fit = (self.seen.len() >= 6).then(|| normal.cholesky()).flatten().map(|c| c.solve(&right));
        let Some(fit) = fit.filter(|fit| fit.iter().all(|x| x.is_finite())) else {
            return Some(Guess { z_m: newest_m, v_m_s: 0.0 });
        };
        Some(Guess { z_m: fit[0] + fit[1] * delay_s, v_m_s: fit[1] + fit[2] * delay_s })
    }
}
