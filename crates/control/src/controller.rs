use std::fmt;

use bench_device::{PositionSample, Sticks, Time};
use bench_rig::{ControlState, Mission, Phase, PhaseAction, PhasePlan, Predictor, Rig};

use crate::{
    altitude::AltitudeLaw,
    estimator::{Estimate, Estimator},
    lateral::LateralLaw,
    observer::Observer,
};

/// Flies a mission: sees positions, decides sticks.
#[derive(Debug)]
pub struct Controller {
    plans: Vec<PhasePlan>,
    /// Where the mission ends: the number of its plans, unless it was asked to land before.
    end: usize,
    current: usize,
    /// The plan to go on with at the next decision, where somebody asked to land.
    next: Option<usize>,
    phase_began: Time,
    slack_s: f64,
    at_rest: Sticks,
    aborted: bool,
    landing: Landing,
    predicted: Predicted,
    altitude: AltitudeLaw,
    lateral: LateralLaw,
    envelope_m: [f64; 2],
    /// Added to the altitudes of holds, m; `None` until somebody asks.
    shift_m: Option<f64>,
    /// The place held last: x and y, m, and heading, rad.
    held: [f64; 3],
    /// Whether the landing is one that was asked for.
    lands_early: bool,
    /// Where a landing descends: x and y, m, and heading, rad. A planned one does at the origin.
    lands_at: [f64; 3],
}

/// What a landing that was asked for comes to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Landed {
    /// It begins with the next decision.
    Begins,
    /// The mission lands already, or has landed.
    Already,
    /// The airframe stands: the mission is over.
    Stands,
}

/// A landing was asked for, and the mission has none from here on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NoLanding;

impl fmt::Display for NoLanding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the mission has no landing from here on")
    }
}

/// Why an altitude that was asked for is not flown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AltitudeRefused {
    /// It is outside of the rig's envelope.
    Outside {
        /// Lowest altitude that may be asked for, m.
        low_m: f64,
        /// Highest altitude that may be asked for, m.
        high_m: f64,
    },
    /// The mission holds no altitude from here on.
    NoHold,
}

impl fmt::Display for AltitudeRefused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Outside { low_m, high_m } => write!(f, "outside of the rig's {low_m:.2} to {high_m:.2} m"),
            Self::NoHold => write!(f, "the mission holds no altitude from here on"),
        }
    }
}

/// Who predicts, as the rig has it.
#[derive(Debug)]
enum Predicted {
    Linear(Estimator),
    Model(Box<Observer>),
}

impl Predicted {
    fn new(rig: &Rig, begin: Time) -> Self {
        let control = &rig.control;
        match control.predictor {
            Predictor::Linear => {
                Self::Linear(Estimator::new(control.extrapolation_s, control.velocity_window_s))
            }
            Predictor::Model => Self::Model(Box::new(Observer::new(rig, begin))),
        }
    }

    fn observe(&mut self, sample: &PositionSample) {
        match self {
            Self::Linear(estimator) => estimator.observe(sample),
            Self::Model(observer) => observer.observe(sample),
        }
    }

    fn measured_altitude_m(&self) -> Option<f64> {
        match self {
            Self::Linear(estimator) => estimator.measured_altitude_m(),
            Self::Model(observer) => observer.measured_altitude_m(),
        }
    }

    fn estimate(&self, now: Time) -> Option<Estimate> {
        match self {
            Self::Linear(estimator) => estimator.estimate(),
            Self::Model(observer) => observer.estimate(now),
        }
    }

    fn command(&mut self, now: Time, sticks: Sticks) {
        if let Self::Model(observer) = self {
            observer.command(now, sticks);
        }
    }
}

/// What one iteration decided.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decision {
    /// What to write to the output.
    pub sticks: Sticks,
    /// The values behind it.
    pub state: ControlState,
    /// The mission is over (or was aborted): the sticks are at rest and stay there.
    pub finished: bool,
}

/// Progress of a landing.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Landing {
    /// Not begun.
    Not,
    /// Descending from this set-point.
    Descending { from_m: f64 },
    /// Low enough: sinking through the ground effect under reduced thrust since then.
    Settling { since: Time },
    /// Down.
    Done,
}

/// A phase ends with the iteration that starts so much of a period before its time, so that it does not last an iteration more because its
/// first one started a little later than its last.
const SLACK: f64 = 0.1;

/// Thrust-to-weight while settling: with the paper's ground effect of 30 % this still touches down, at a third of the
/// speed of a free fall from 5 cm.
const SETTLING_THRUST_TO_WEIGHT: f64 = 0.75;
const SETTLING_S: f64 = 1.0;

/// Lower than this it stands, m: the tracker's noise about the ground.
const STANDS_M: f64 = 0.01;

impl Controller {
    /// A controller at the beginning of a mission whose clock starts at zero.
    pub fn new(rig: &Rig, mission: &Mission) -> Self {
        Self::beginning_at(rig, mission, Time::ZERO)
    }

    /// A controller whose mission begins at another instant of its clock.
    pub fn beginning_at(rig: &Rig, mission: &Mission, begin: Time) -> Self {
        Self {
            plans: mission.phases.clone(),
            end: mission.phases.len(),
            current: 0,
            next: None,
            phase_began: begin,
            slack_s: SLACK * rig.control_loop.period_s,
            at_rest: rig.airframe.sticks.at_rest(),
            aborted: false,
            landing: Landing::Not,
            predicted: Predicted::new(rig, begin),
            altitude: AltitudeLaw::new(rig),
            lateral: LateralLaw::new(rig),
            envelope_m: rig.altitude_envelope_m(),
            shift_m: None,
            held: [0.0; 3],
            lands_early: false,
            lands_at: [0.0; 3],
        }
    }

    /// Takes a position that has arrived.
    pub fn observe(&mut self, sample: &PositionSample) {
        self.predicted.observe(sample);
    }

    /// Throttle to rest from the next decision on, for good.
    pub fn abort(&mut self) {
        self.aborted = true;
    }

    /// From the next decision on, holds fly `altitude_m` where the mission has what it has at `now` (or at the beginning of its next hold),
    /// and are shifted by as much all along. What the mission foresees beyond is kept within the rig's envelope.
    pub fn fly_at(&mut self, altitude_m: f64, now: Time) -> Result<(), AltitudeRefused> {
        let [low_m, high_m] = self.envelope_m;
        if !(low_m..=high_m).contains(&altitude_m) {
            return Err(AltitudeRefused::Outside { low_m, high_m });
        }
        let from = self.next.unwrap_or(self.current);
        let plans = self.plans[..self.end].iter().enumerate();
        let mut ahead = plans.skip(from).filter(|_| !self.aborted);
        let planned_m = ahead
            .find_map(|(index, plan)| match &plan.action {
                PhaseAction::Hold { altitude_m, .. } if index == self.current => {
                    Some(altitude_m.at(now.since_s(self.phase_began)))
                }
                PhaseAction::Hold { altitude_m, .. } => Some(altitude_m.at(0.0)),
                _ => None,
            })
            .ok_or(AltitudeRefused::NoHold)?;
        self.shift_m = Some(altitude_m - planned_m);
        Ok(())
    }

    /// From the next decision on, flies the next landing of the mission, at the place that is held, and the mission ends with it. Where the
    /// airframe stands, before take-off or after a landing, the mission ends at once.
    pub fn land_now(&mut self) -> Result<Landed, NoLanding> {
        let lands = |plan: &PhasePlan| matches!(plan.action, PhaseAction::Land { .. });
        if self.aborted {
            return Err(NoLanding);
        }
        let plans = &self.plans[..self.end];
        let Some(plan) = plans.get(self.current) else { return Ok(Landed::Already) };
        if self.next.is_some() || lands(plan) {
            // A mission that would take off again does not.
            self.end = self.next.unwrap_or(self.current) + 1;
            return Ok(Landed::Already);
        }
        let mut since_landing = plans[..=self.current].iter().rev().take_while(|plan| !lands(plan));
        if since_landing.all(|plan| matches!(plan.action, PhaseAction::Idle)) {
            self.end = self.current;
            return Ok(Landed::Stands);
        }
        let ahead = plans[self.current..].iter().position(lands).ok_or(NoLanding)?;
        let next = self.current + ahead;
        (self.next, self.end) = (Some(next), next + 1);
        (self.lands_early, self.lands_at) = (true, self.held);
        Ok(Landed::Begins)
    }

    /// An altitude of the mission as the operator has it flown, m.
    fn shifted_m(&self, planned_m: f64) -> f64 {
        let [low_m, high_m] = self.envelope_m;
        self.shift_m.map_or(planned_m, |shift_m| (planned_m + shift_m).clamp(low_m, high_m))
    }

    /// One iteration at `now`, once a loop period.
    pub fn decide(&mut self, now: Time) -> Decision {
        let decision = self.decision(now);
        self.predicted.command(now, decision.sticks);
        decision
    }

    fn decision(&mut self, now: Time) -> Decision {
        self.move_on(now);
        let mut state = ControlState { time: now, ..ControlState::default() };
        let estimate = self.predicted.estimate(now);
        if let Some(estimate) = &estimate {
            state.estimate_m = estimate.position_m;
            state.estimate_m_s = estimate.velocity_m_s;
        }
        let Some(plan) = self.plans[..self.end].get(self.current).filter(|_| !self.aborted) else {
            state.phase = if self.aborted { Phase::Abort } else { Phase::Idle };
            return Decision { sticks: self.at_rest(), state, finished: true };
        };
        state.phase = plan.action.phase();
        let elapsed_s = now.since_s(self.phase_began);
        let level = self.lateral.centred();
        let (throttle, [pitch, roll, yaw]) = match &plan.action {
            PhaseAction::Idle => (self.at_rest.throttle, level),
            PhaseAction::Launch { thrust_to_weight } => {
                (self.altitude.open_loop(thrust_to_weight.at(elapsed_s)), level)
            }
            PhaseAction::Open { thrust_to_weight, chirp } => {
                let extra = chirp.map_or(0.0, |chirp| chirp.at(elapsed_s, plan.duration_s));
                (self.altitude.open_loop(thrust_to_weight.at(elapsed_s) + extra), level)
            }
            PhaseAction::Hold { altitude_m, x_m, y_m, heading_rad, chirp } => {
                let extra_m = chirp.map_or(0.0, |chirp| chirp.at(elapsed_s, plan.duration_s));
                let altitude_m = self.shifted_m(altitude_m.at(elapsed_s) + extra_m);
                state.setpoint_m = [x_m.at(elapsed_s), y_m.at(elapsed_s), altitude_m];
                state.setpoint_heading_rad = heading_rad.at(elapsed_s);
                let [x_m, y_m, _] = state.setpoint_m;
                self.held = [x_m, y_m, state.setpoint_heading_rad];
                let throttle =
                    self.altitude.closed_loop(state.setpoint_m[2], 0.0, estimate.as_ref(), &mut state);
                (throttle, self.hold_place(&mut state, estimate.as_ref()))
            }
            &PhaseAction::Land { descent_m_s, cut_below_m } => {
                let [x_m, y_m, heading_rad] = self.lands_at;
                state.setpoint_m = [x_m, y_m, 0.0];
                state.setpoint_heading_rad = heading_rad;
                let throttle = self.land(now, descent_m_s, cut_below_m, estimate.as_ref(), &mut state);
                let lateral = if matches!(self.landing, Landing::Descending { .. }) {
                    self.hold_place(&mut state, estimate.as_ref())
                } else {
                    level
                };
                (throttle, lateral)
            }
        };
        Decision { sticks: Sticks { throttle, pitch, roll, yaw }, state, finished: false }
    }

    /// Goes to the next phase when this one is over.
    fn move_on(&mut self, now: Time) {
        if let Some(next) = self.next.take() {
            (self.current, self.phase_began, self.landing) = (next, now, Landing::Not);
        }
        while let Some(plan) = self.plans[..self.end].get(self.current) {
            let over = now.since_s(self.phase_began) >= self.longest_s(plan) - self.slack_s
                || self.landing == Landing::Done;
            if !over {
                return;
            }
            self.landing = Landing::Not;
            self.current += 1;
            // At the instant of the iteration, not of the plan: a late loop still gives each phase its time.
            self.phase_began = now;
        }
    }

    /// How long a phase may last, s. A landing from where the mission did not foresee it may take its way down beyond its time: the
    /// throttle would go to rest in the air.
    fn longest_s(&self, plan: &PhasePlan) -> f64 {
        let foreseen = self.shift_m.is_none() && !self.lands_early;
        match (&plan.action, self.landing) {
            (PhaseAction::Land { descent_m_s, .. }, Landing::Descending { from_m }) if !foreseen => {
                plan.duration_s + from_m.max(0.0) / descent_m_s
            }
            (PhaseAction::Land { .. }, Landing::Settling { .. }) if !foreseen => f64::INFINITY,
            _ => plan.duration_s,
        }
    }

    /// The sticks that stop the rotors.
    pub fn at_rest(&self) -> Sticks {
        self.at_rest
    }

    fn hold_place(&mut self, state: &mut ControlState, estimate: Option<&Estimate>) -> [f64; 3] {
        let [x, y, _] = state.setpoint_m;
        match estimate {
            Some(estimate) => self.lateral.closed_loop([x, y], state.setpoint_heading_rad, estimate),
            None => self.lateral.centred(),
        }
    }

    /// Throttle of a landing at `now`.
    fn land(
        &mut self,
        now: Time,
        descent_m_s: f64,
        cut_below_m: f64,
        estimate: Option<&Estimate>,
        state: &mut ControlState,
    ) -> f64 {
        let measured_m = self.predicted.measured_altitude_m();
        if self.landing == Landing::Not {
            let from_m = estimate.map_or(0.0, |estimate| estimate.position_m[2]);
            self.landing = Landing::Descending { from_m };
        }
        if let Landing::Descending { from_m } = self.landing {
            let lower_than =
                |m: f64| estimate.is_some_and(|e| e.position_m[2] < m) || measured_m.is_some_and(|z| z < m);
            let elapsed_s = now.since_s(self.phase_began);
            match self.altitude.ground_effect().map(|ground| ground.descent(from_m, descent_m_s, elapsed_s)) {
                // Through the ground effect in closed loop, until it must stand.
                Some(descent) if descent.ended && lower_than(STANDS_M) => self.landing = Landing::Done,
                Some(descent) => {
                    let (setpoint_m, speed_m_s) = (descent.setpoint_m, descent.speed_m_s);
                    state.setpoint_m[2] = setpoint_m;
                    return self.altitude.closed_loop(setpoint_m, speed_m_s, estimate, state);
                }
                None if lower_than(cut_below_m) => self.landing = Landing::Settling { since: now },
                None => {
                    let setpoint_m = from_m - descent_m_s * elapsed_s;
                    state.setpoint_m[2] = setpoint_m;
                    return self.altitude.closed_loop(setpoint_m, -descent_m_s, estimate, state);
                }
            }
        }
        match self.landing {
            Landing::Settling { since } if now.since_s(since) < SETTLING_S => {
                self.altitude.open_loop(SETTLING_THRUST_TO_WEIGHT)
            }
            _ => {
                self.landing = Landing::Done;
                self.at_rest.throttle
            }
        }
    }
}
