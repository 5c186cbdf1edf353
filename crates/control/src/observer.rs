//! Position, velocity and what the model misses, carried over the delay by the airframe's own model.

use std::collections::VecDeque;

use bench_device::{PositionSample, Sticks, Time, TrackStatus};
use bench_rig::{Airframe, GRAVITY_M_S2, Output, Rig};
use nalgebra::{Matrix3, Vector3};

use crate::{estimator::Estimate, ground_effect::GroundEffect};

/// An extended Kalman filter on each axis with the states position, velocity and disturbance, where
///
/// ```text
/// up:       z'' = gain (throttle - offset) (1 + ground effect(z))/m - g - drag v/m + disturbance + white noise
/// sideways: x'' = g tan(tilt) - drag v/m + disturbance + white noise, tilt by the on-board stabiliser's response
/// disturbance' = white noise
/// ```
///
/// Each sighting corrects the state at its exposure. From there the commands that were given since carry it to the
/// present, so that the delay costs no more than what disturbs the airframe meanwhile. On the ground the airframe stands.
#[derive(Debug)]
pub(crate) struct Observer {
    model: Model,
    at: Time,
    state: State,
    covariance: [Matrix3<f64>; 3],
    /// What the pins hold and from when on; the first of them holds at [`Observer::at`].
    given: VecDeque<(Time, Command)>,
    heading_rad: f64,
    newest: Option<Sighting>,
    refused: u32,
}

#[derive(Clone, Copy, Debug)]
struct Sighting {
    at: Time,
    altitude_m: f64,
}

/// What the sticks ask for.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Command {
    /// Out of the ground effect, over the mass, m/s^2.
    thrust_m_s2: f64,
    /// World frame, once the stabiliser has followed, m/s^2.
    sideways_m_s2: [f64; 2],
}

#[derive(Clone, Copy, Debug, Default)]
struct State {
    /// Position, velocity, disturbance: x, y, z.
    axes: [Vector3<f64>; 3],
    /// Sideways acceleration by tilt and its rate, as far as the stabiliser has followed: x, y.
    tilt: [[f64; 2]; 2],
}

#[derive(Debug)]
struct Model {
    airframe: Airframe,
    output: Output,
    ground_effect: GroundEffect,
    drag_per_s: f64,
    stabiliser_rad_s: f64,
    stabiliser_damping: f64,
    /// Of a sighting, m^2.
    sighting_m2: f64,
    /// Spectral density of the acceleration, m^2/s^3.
    white: f64,
    /// Rate of variance of the disturbance, m^2/s^5.
    drift: f64,
    /// Of the disturbance before anything was seen, m^2/s^4.
    disturbance_m2_s4: [f64; 3],
    /// Longest step of the integration, s.
    step_s: f64,
}

/// Longest step of the integration, s: short against the ground effect's oscillation.
const STEP_S: f64 = 0.005;
/// The same of the stabiliser's response, in parts of its fastest time constant.
const STABILISER_STEP: f64 = 0.25;
/// Commands kept: the longest latency at a thousand iterations a second.
const CAPACITY: usize = 2048;
/// A sighting further off than so many sigmas is taken for a wrong one...
const GATE_SIGMA: f64 = 5.0;
/// ... but not so many in a row: then it is the state that is wrong.
const REFUSED_MAX: u32 = 3;
/// Standing on the ground, the place and speed are known so well, m and m/s.
const STANDING: [f64; 2] = [0.002, 0.02];
/// Least disturbance to reckon with, one sigma, m/s^2: trims, updrafts, a worn battery.
const LEAST_DISTURBANCE_M_S2: f64 = 0.1;
/// Sideways: a centre or a centre of gravity that is a degree off.
const SIDEWAYS_DISTURBANCE_M_S2: f64 = 0.2;

impl Observer {
    pub(crate) fn new(rig: &Rig, begin: Time) -> Self {
        let model = Model::new(rig);
        let mut given = VecDeque::with_capacity(CAPACITY);
        given.push_back((begin, Command::default()));
        Self {
            covariance: model.disturbance_m2_s4.map(|b| standing(b, model.sighting_m2)),
            model,
            at: begin,
            state: State::default(),
            given,
            heading_rad: 0.0,
            newest: None,
            refused: 0,
        }
    }

    /// Takes a sample; those that are not valid or not newer than the last are passed over.
    pub(crate) fn observe(&mut self, sample: &PositionSample) {
        let newer = self.newest.is_none_or(|newest| sample.exposed_at > newest.at);
        let sound = sample.position_m.iter().all(|x| x.is_finite());
        if sample.status == TrackStatus::Lost || !sound || !newer {
            return;
        }
        if let Some(heading_rad) = sample.heading_rad.filter(|heading| heading.is_finite()) {
            self.heading_rad = heading_rad;
        }
        if self.newest.is_none() {
            // Where it stands before the flight, however long ago that began.
            for (axis, seen) in self.state.axes.iter_mut().zip(sample.position_m) {
                axis[0] = seen;
            }
            self.at = self.at.max(sample.exposed_at);
        }
        self.advance(sample.exposed_at);
        if self.correct(sample.position_m) {
            self.newest = Some(Sighting { at: sample.exposed_at, altitude_m: sample.position_m[2] });
        }
    }

    /// The last believed altitude as measured, m.
    pub(crate) fn measured_altitude_m(&self) -> Option<f64> {
        self.newest.map(|newest| newest.altitude_m)
    }

    /// The state at `now`; `None` before the first sample.
    pub(crate) fn estimate(&self, now: Time) -> Option<Estimate> {
        self.newest?;
        let mut state = self.state;
        self.each_command(now, |command, span_s| {
            let (steps, step_s) = self.model.steps(span_s);
            for _ in 0..steps {
                self.model.step(&mut state, command, step_s);
            }
        });
        Some(Estimate {
            position_m: state.axes.map(|axis| axis[0]),
            velocity_m_s: state.axes.map(|axis| axis[1]),
            heading_rad: self.heading_rad,
            disturbance_m_s2: Some(state.axes.map(|axis| axis[2])),
        })
    }

    /// What is written to the output from `now` on.
    pub(crate) fn command(&mut self, now: Time, sticks: Sticks) {
        if self.given.len() == CAPACITY {
            self.given.pop_front();
        }
        self.given.push_back((now, self.model.command(sticks, self.heading_rad)));
    }

    /// Brings state and covariance to `to` and forgets the commands before it.
    fn advance(&mut self, to: Time) {
        if to <= self.at {
            return;
        }
        let (mut state, mut covariance) = (self.state, self.covariance);
        self.each_command(to, |command, span_s| {
            let (steps, step_s) = self.model.steps(span_s);
            for _ in 0..steps {
                self.model.spread(&state, &mut covariance, command, step_s);
                if self.model.step(&mut state, command, step_s) {
                    for (axis, b) in covariance.iter_mut().zip(self.model.disturbance_m2_s4) {
                        // What the disturbance is, standing does not tell.
                        *axis = standing(axis[(2, 2)].min(b), self.model.sighting_m2);
                    }
                }
            }
        });
        (self.state, self.covariance) = (state, covariance);
        self.at = to;
        while self.given.get(1).is_some_and(|(since, _)| *since <= to) {
            self.given.pop_front();
        }
    }

    /// Every command that holds between the state's time and `to`, with how long it does.
    fn each_command(&self, to: Time, mut take: impl FnMut(&Command, f64)) {
        for (i, (since, command)) in self.given.iter().enumerate() {
            let from = (*since).max(self.at);
            let until = self.given.get(i + 1).map_or(to, |(next, _)| (*next).min(to));
            if until > from {
                take(command, until.since_s(from));
            }
        }
    }

    /// Takes in a sighting at the state's time; whether it was believed.
    fn correct(&mut self, seen_m: [f64; 3]) -> bool {
        let noise = self.model.sighting_m2;
        let wrong =
            self.state.axes.iter().zip(&self.covariance).zip(seen_m).any(|((axis, covariance), seen)| {
                (seen - axis[0]).powi(2) > GATE_SIGMA * GATE_SIGMA * (covariance[(0, 0)] + noise)
            });
        if wrong {
            self.refused += 1;
            if self.refused <= REFUSED_MAX {
                return false;
            }
        }
        for ((axis, covariance), seen) in self.state.axes.iter_mut().zip(&mut self.covariance).zip(seen_m) {
            let miss = seen - axis[0];
            if wrong {
                // It is somewhere else and moves as it will.
                covariance[(0, 0)] += miss * miss;
                covariance[(1, 1)] += 1.0;
            }
            let gain = covariance.column(0) / (covariance[(0, 0)] + noise);
            *axis += gain * miss;
            // Joseph's form keeps it symmetric and positive.
            let mut keep = Matrix3::identity();
            keep.column_mut(0).axpy(-1.0, &gain, 1.0);
            *covariance = keep * *covariance * keep.transpose() + gain * gain.transpose() * noise;
        }
        self.refused = 0;
        true
    }
}

impl Model {
    fn new(rig: &Rig) -> Self {
        let airframe = &rig.airframe;
        let thrust = &airframe.thrust;
        // How far the throttle that hovers may be off, as an acceleration.
        let range = airframe.weight_n() / thrust.gain_n_per_unit.value;
        let relative = thrust.hover_sigma.map_or_else(
            || {
                (thrust.gain_n_per_unit.sigma / thrust.gain_n_per_unit.value)
                    .hypot(thrust.offset.sigma / range)
                    .hypot(airframe.mass_kg.sigma / airframe.mass_kg.value)
            },
            |sigma| sigma / range,
        );
        let up = (GRAVITY_M_S2 * relative).max(LEAST_DISTURBANCE_M_S2);
        let tracker = &rig.tracker;
        let observer = &rig.control.observer;
        let stabiliser = &airframe.stabiliser;
        let fastest_rad_s = stabiliser.natural_frequency_rad_s * (2.0 * stabiliser.damping_ratio).max(1.0);
        Self {
            step_s: STEP_S.min(STABILISER_STEP / fastest_rad_s),
            ground_effect: GroundEffect::new(airframe),
            drag_per_s: airframe.drag_n_s_per_m.value / airframe.mass_kg.value,
            stabiliser_rad_s: stabiliser.natural_frequency_rad_s,
            stabiliser_damping: stabiliser.damping_ratio,
            // A tracker without noise is none.
            sighting_m2: (tracker.noise_m.powi(2) + tracker.resolution_m.powi(2) / 12.0).max(1e-8),
            white: observer.white_m_s2_per_root_hz.powi(2),
            drift: observer.drift_m_s2_per_root_s.powi(2),
            disturbance_m2_s4: [SIDEWAYS_DISTURBANCE_M_S2, SIDEWAYS_DISTURBANCE_M_S2, up].map(|b| b * b),
            output: rig.output,
            airframe: airframe.clone(),
        }
    }

    /// Equal steps over a span, none too long.
    fn steps(&self, span_s: f64) -> (u32, f64) {
        let count = (span_s / self.step_s - 1e-9).ceil().max(1.0);
        (count as u32, span_s / count)
    }

    fn command(&self, sticks: Sticks, heading_rad: f64) -> Command {
        let range = &self.airframe.sticks;
        let held = sticks.map(|value| self.output.on_the_pin(range, value));
        let tilt = |stick: f64| GRAVITY_M_S2 * (range.tilt_rad_per_unit * (stick - range.centre)).tan();
        let (forward, left) = (tilt(held.pitch), -tilt(held.roll));
        let (sin, cos) = heading_rad.sin_cos();
        Command {
            thrust_m_s2: self.airframe.thrust_n(held.throttle) / self.airframe.mass_kg.value,
            sideways_m_s2: [cos * forward - sin * left, sin * forward + cos * left],
        }
    }

    /// Vertical acceleration, m/s^2.
    fn upward(&self, command: &Command, [z, v, b]: [f64; 3]) -> f64 {
        command.thrust_m_s2 * self.ground_effect.multiplier(z.max(0.0)) - GRAVITY_M_S2 - self.drag_per_s * v
            + b
    }

    /// One step; whether the airframe stands on the ground after it.
    fn step(&self, state: &mut State, command: &Command, step_s: f64) -> bool {
        let [x, y, up] = &mut state.axes;
        // Midpoint rule.
        let half_s = 0.5 * step_s;
        let a = self.upward(command, (*up).into());
        let middle = [up[0] + half_s * up[1], up[1] + half_s * a, up[2]];
        up[0] += step_s * middle[1];
        up[1] += step_s * self.upward(command, middle);
        let stands = up[0] <= 0.0 && up[1] <= 0.0;
        if stands {
            (up[0], up[1]) = (0.0, 0.0);
        }
        for ((axis, tilt), wanted) in [x, y].into_iter().zip(&mut state.tilt).zip(command.sideways_m_s2) {
            if stands {
                (axis[1], *tilt) = (0.0, [0.0; 2]);
                continue;
            }
            let omega = self.stabiliser_rad_s;
            let jerk = omega * omega * (wanted - tilt[0]) - 2.0 * self.stabiliser_damping * omega * tilt[1];
            // Rate first, which keeps an oscillator's energy.
            tilt[1] += step_s * jerk;
            tilt[0] += step_s * tilt[1];
            let a = tilt[0] + axis[2] - self.drag_per_s * axis[1];
            axis[0] += step_s * (axis[1] + half_s * a);
            axis[1] += step_s * a;
        }
        stands
    }

    /// What a step does to the covariances.
    fn spread(&self, state: &State, covariance: &mut [Matrix3<f64>; 3], command: &Command, step_s: f64) {
        let stiffness = command.thrust_m_s2 * self.ground_effect.slope_per_m(state.axes[2][0]);
        for (axis, stiffness) in covariance.iter_mut().zip([0.0, 0.0, stiffness]) {
            let h = step_s;
            let transition =
                Matrix3::new(1.0, h, 0.5 * h * h, stiffness * h, 1.0 - self.drag_per_s * h, h, 0.0, 0.0, 1.0);
            *axis = transition * *axis * transition.transpose();
            axis[(1, 1)] += self.white * h;
            axis[(2, 2)] += self.drift * h;
        }
    }
}

fn standing(disturbance_m2_s4: f64, sighting_m2: f64) -> Matrix3<f64> {
    let [place, speed] = STANDING;
    Matrix3::from_diagonal(&Vector3::new((place * place).max(sighting_m2), speed * speed, disturbance_m2_s4))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn rig() -> Rig {
        let rigs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs");
        let mut rig = Rig::load(rigs.join("virtual.toml")).unwrap();
        rig.control.observer.white_m_s2_per_root_hz = 0.05;
        rig.control.observer.drift_m_s2_per_root_s = 0.1;
        rig
    }

    fn seen(t_s: f64, position_m: [f64; 3]) -> PositionSample {
        PositionSample {
            exposed_at: Time::from_seconds(t_s),
            arrived_at: Time::from_seconds(t_s + 0.3),
            position_m,
            status: TrackStatus::Found,
            ..Default::default()
        }
    }

    /// Sticks whose thrust out of the ground effect is this share of the weight.
    fn sticks(rig: &Rig, thrust_to_weight: f64) -> Sticks {
        let airframe = &rig.airframe;
        let throttle = airframe.throttle_for(thrust_to_weight * airframe.weight_n());
        Sticks { throttle, ..airframe.sticks.at_rest() }
    }

    /// Feeds an airframe at 0.5 m that accelerates by `up` under hover throttle for `until_s`, seen every 1/30 s.
    fn after_steady_acceleration(rig: &Rig, up: f64, until_s: f64) -> Observer {
        let mut observer = Observer::new(rig, Time::ZERO);
        observer.model.drag_per_s = 0.0;
        for k in 0..=(until_s * 30.0) as u32 {
            let t = f64::from(k) / 30.0;
            if k % 3 == 0 {
                observer.command(Time::from_seconds(t), sticks(rig, 1.0));
            }
            observer.observe(&seen(t, [0.0, 0.0, 0.5 + 0.5 * up * t * t]));
        }
        observer
    }

    #[test]
    fn a_steady_disturbance_is_found_and_carried_over_the_delay() {
        let mut rig = rig();
        rig.output.bits = 0;
        let observer = after_steady_acceleration(&rig, 0.2, 6.0);
        let now = observer.estimate(Time::from_seconds(6.3)).unwrap();
        let (z, v) = (0.5 + 0.1 * 6.3 * 6.3, 0.2 * 6.3);
        // The drift that it reckons with lets it lag by a little in the disturbance, the delay squared in the place.
        assert!((now.disturbance_m_s2.unwrap()[2] - 0.2).abs() < 0.01, "{now:?}");
        assert!((now.velocity_m_s[2] - v).abs() < 0.01 && (now.position_m[2] - z).abs() < 0.003, "{now:?}");
    }

    #[test]
    fn a_command_shows_before_any_sighting_could() {
        let mut rig = rig();
        rig.output.bits = 0;
        let mut observer = after_steady_acceleration(&rig, 0.0, 3.0);
        observer.command(Time::from_seconds(3.1), sticks(&rig, 1.1));
        let now = observer.estimate(Time::from_seconds(3.3)).unwrap();
        // 0.1 g for 0.2 s; to a per cent, as the midpoint rule has it exactly and the disturbance's noise is none.
        assert!((now.velocity_m_s[2] - 0.02 * GRAVITY_M_S2).abs() < 0.002, "{now:?}");
    }

    #[test]
    fn on_the_ground_it_stands_and_learns_nothing() {
        let rig = rig();
        let mut observer = Observer::new(&rig, Time::ZERO);
        for k in 0..90 {
            let wobble = if k % 2 == 0 { 0.004 } else { -0.004 };
            observer.observe(&seen(f64::from(k) / 30.0, [0.1, -0.1, wobble]));
        }
        let now = observer.estimate(Time::from_seconds(3.2)).unwrap();
        assert!(now.velocity_m_s.iter().all(|v| v.abs() < 0.01), "{now:?}");
        assert!(now.disturbance_m_s2.unwrap()[2].abs() < 0.02, "{now:?}");
        assert!((now.position_m[0] - 0.1).abs() < 0.001 && now.position_m[2].abs() < 0.003, "{now:?}");
    }

    #[test]
    fn a_wrong_sighting_is_refused_and_a_moved_airframe_is_followed() {
        let rig = rig();
        let mut observer = after_steady_acceleration(&rig, 0.0, 3.0);
        let before = observer.estimate(Time::from_seconds(3.4)).unwrap().position_m[2];
        observer.observe(&seen(3.04, [0.0, 0.0, 1.5]));
        assert_eq!(observer.estimate(Time::from_seconds(3.4)).unwrap().position_m[2], before);
        for k in 2..8 {
            observer.observe(&seen(3.0 + f64::from(k) * 0.034, [0.0, 0.0, 0.9]));
        }
        assert!((observer.estimate(Time::from_seconds(3.3)).unwrap().position_m[2] - 0.9).abs() < 0.1);
    }

    #[test]
    fn lost_stale_and_non_finite_samples_are_passed_over() {
        let rig = rig();
        let mut observer = Observer::new(&rig, Time::ZERO);
        assert_eq!(observer.estimate(Time::ZERO), None);
        observer.observe(&seen(1.0, [0.0, 0.0, 0.3]));
        let at = Time::from_seconds(1.5);
        let before = observer.estimate(at);
        observer.observe(&PositionSample { status: TrackStatus::Lost, ..seen(1.1, [0.0, 0.0, 9.0]) });
        observer.observe(&seen(1.0, [0.0, 0.0, 9.0]));
        observer.observe(&seen(1.2, [0.0, f64::NAN, 0.3]));
        assert_eq!(observer.estimate(at), before);
    }

    #[test]
    fn years_of_commands_without_a_sighting_are_no_trouble() {
        let rig = rig();
        let mut observer = Observer::new(&rig, Time::ZERO);
        observer.observe(&seen(0.0, [0.0; 3]));
        for k in 0..3 * CAPACITY {
            observer.command(Time::from_seconds(k as f64 * 0.1), sticks(&rig, 0.0));
        }
        assert_eq!(observer.given.len(), CAPACITY);
        assert!(observer.estimate(Time::from_seconds(600.0)).unwrap().position_m[2].is_finite());
    }
}
