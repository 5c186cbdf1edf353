//! Flights that are looked at and forgotten.

use bench_device::{Sticks, Time};
use bench_recording::Record;
use bench_rig::{Mission, Model, Phase, PhaseAction, PhasePlan, Profile, Rig};
use bench_run::{Ending, SimulationError, Sink, simulate_on};

/// What a flight was, as far as gains are judged by it.
#[derive(Clone, Debug, Default)]
pub struct Traced {
    /// Time, position and vertical speed as they really were.
    pub truth: Vec<(Time, [f64; 3], f64)>,
    /// What the controller asked for, and in which phase.
    pub commands: Vec<(Time, Phase, Sticks)>,
    /// Whether the mission was flown to its end.
    pub complete: bool,
    phase: Phase,
}

impl Sink for Traced {
    fn take(&mut self, record: Record) {
        match record {
            Record::Truth(truth) => {
                self.truth.push((truth.time, truth.position_m, truth.velocity_m_s[2]));
            }
            Record::ControlState(state) => self.phase = state.phase,
            Record::Command(command) => self.commands.push((command.time, self.phase, command.sticks)),
            _ => {}
        }
    }
}

impl Traced {
    /// When a phase began: its first iteration.
    pub fn began(&self, phase: Phase) -> Option<Time> {
        self.commands.iter().find(|(_, of, _)| *of == phase).map(|(time, ..)| *time)
    }

    /// The truth from one time since `from` to another, s.
    pub fn truth_between(
        &self,
        from: Time,
        [begin_s, end_s]: [f64; 2],
    ) -> impl Iterator<Item = &(Time, [f64; 3], f64)> {
        self.truth.iter().filter(move |(time, ..)| (begin_s..end_s).contains(&time.since_s(from)))
    }
}

/// Flies a mission on a plant while the controller goes by `rig`, and keeps what gains are judged by.
pub fn fly_traced(plant: &Rig, rig: &Rig, mission: &Mission, seed: u64) -> Result<Traced, SimulationError> {
    let mut traced = Traced::default();
    let flown = simulate_on(plant, rig, mission, seed, &mut traced, |_| true)?;
    traced.complete = flown.ending == Ending::Complete;
    Ok(traced)
}

/// What gains are judged by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Task {
    /// Altitude that is held, m.
    pub altitude_m: f64,
    /// By how much the set-point steps after that: upwards, or sideways where the lateral law is judged, m.
    pub step_m: f64,
    /// Half-width of the band in which a step counts as done, m.
    pub band_m: f64,
}

/// Time to get there from the launch, s.
pub(crate) const CAPTURE_S: f64 = 8.0;
/// Time over which it must stay there, s.
pub(crate) const STEADY_S: f64 = 10.0;
/// Time for the step, s.
pub(crate) const STEP_S: f64 = 10.0;

/// The axis of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Axis {
    X,
    Z,
}

impl Task {
    /// The paper's: 0.4 m, then a step.
    pub const PAPER: Self = Self { altitude_m: 0.4, step_m: 0.3, band_m: 0.05 };

    /// Launch, capture, hold, step.
    pub(crate) fn mission(&self, axis: Axis) -> Mission {
        let at = CAPTURE_S + STEADY_S;
        let step = |from: f64| stepped(at, from, from + self.step_m);
        let nothing = || Profile::constant(0.0);
        let (altitude_m, x_m) = match axis {
            Axis::Z => (step(self.altitude_m), nothing()),
            Axis::X => (Profile::constant(self.altitude_m), step(0.0)),
        };
        let hold = PhaseAction::Hold { altitude_m, x_m, y_m: nothing(), heading_rad: nothing(), chirp: None };
        Mission {
            name: "tune".to_owned(),
            description: "Launch, hold, step.".to_owned(),
            phases: lifted(hold, at + STEP_S),
            ..Mission::default()
        }
    }
}

/// The usual take-off, then `action`.
pub(crate) fn lifted(action: PhaseAction, duration_s: f64) -> Vec<PhasePlan> {
    const THRUST_TO_WEIGHT: f64 = 1.08;
    vec![
        PhasePlan { action: PhaseAction::Idle, duration_s: 0.5 },
        PhasePlan {
            action: PhaseAction::Launch { thrust_to_weight: Profile::constant(THRUST_TO_WEIGHT) },
            duration_s: 0.7,
        },
        PhasePlan { action, duration_s },
    ]
}

fn stepped(at_s: f64, from: f64, to: f64) -> Profile {
    // Times rise and are finite.
    Profile::from_points(vec![[0.0, from], [at_s, from], [at_s, to]]).unwrap_or_default()
}

/// A plant as quick to simulate as its laws allow: the vertical model where nothing is asked of the others.
pub(crate) fn quick(mut plant: Rig, model: Model) -> Rig {
    const STEP_S: f64 = 0.004;
    const TRUTH_S: f64 = 0.02;
    plant.plant.model = model;
    plant.plant.step_s = plant.plant.step_s.max(STEP_S).min(plant.control_loop.period_s);
    plant.plant.truth_period_s = TRUTH_S.max(plant.plant.step_s);
    plant
}
