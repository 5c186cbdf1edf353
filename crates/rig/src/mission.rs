use std::path::Path;

use crate::{
    Phase, RigError,
    keys::{self, Form},
    rig::read_text,
    visit::{self, Range, Reader, Visitor, Writer},
};

/// What to fly, and what makes the flight a success.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mission {
    /// Its name.
    pub name: String,
    /// What it is for, in a sentence.
    pub description: String,
    /// What is done one after another.
    pub phases: Vec<PhasePlan>,
    /// What a flight must achieve.
    pub criteria: Criteria,
}

/// One phase and how long it lasts.
#[derive(Clone, Debug, PartialEq)]
pub struct PhasePlan {
    /// What is done.
    pub action: PhaseAction,
    /// How long at most, s.
    pub duration_s: f64,
}

/// What a phase does.
#[derive(Clone, Debug, PartialEq)]
pub enum PhaseAction {
    /// Outputs at rest.
    Idle,
    /// Open-loop throttle, then a hand-over to the closed loop.
    Launch {
        /// Nominal thrust out of the ground effect over nominal weight, over time since the phase began.
        thrust_to_weight: Profile,
    },
    /// Open-loop throttle.
    Open {
        /// Nominal thrust out of the ground effect over nominal weight, over time since the phase began.
        thrust_to_weight: Profile,
        /// Added to the thrust-to-weight ratio.
        chirp: Option<Chirp>,
    },
    /// Closed loop.
    Hold {
        /// Altitude over time since the phase began, m.
        altitude_m: Profile,
        /// x over time since the phase began, m.
        x_m: Profile,
        /// y over time since the phase began, m.
        y_m: Profile,
        /// Heading over time since the phase began, rad.
        heading_rad: Profile,
        /// Added to the altitude, m.
        chirp: Option<Chirp>,
    },
    /// Closed loop down at a steady rate; throttle to rest once low. The duration is the longest it may take.
    Land {
        /// Rate of descent, m/s.
        descent_m_s: f64,
        /// Altitude below which the throttle goes to rest, m.
        cut_below_m: f64,
    },
}

impl PhaseAction {
    /// The phase as recorded.
    pub fn phase(&self) -> Phase {
        match self {
            Self::Idle => Phase::Idle,
            Self::Launch { .. } => Phase::Launch,
            Self::Open { .. } => Phase::Open,
            Self::Hold { .. } => Phase::Hold,
            Self::Land { .. } => Phase::Land,
        }
    }
}

/// A value over time: straight lines between points, the first and last value held. Two points of one time are a step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Profile {
    points: Vec<[f64; 2]>,
}

impl Profile {
    /// The same value always.
    pub fn constant(value: f64) -> Self {
        Self { points: vec![[0.0, value]] }
    }

    /// From points of time in seconds and value; `None` if there is none, or if times fall or are not finite.
    pub fn from_points(points: Vec<[f64; 2]>) -> Option<Self> {
        let sound = !points.is_empty()
            && points.is_sorted_by(|a, b| a[0] <= b[0])
            && points.iter().flatten().all(|x| x.is_finite());
        sound.then_some(Self { points })
    }

    /// The value `t_s` seconds after the phase began. At a step, the value after it.
    pub fn at(&self, t_s: f64) -> f64 {
        let after = self.points.partition_point(|point| point[0] <= t_s);
        match (after.checked_sub(1).map(|i| self.points[i]), self.points.get(after).copied()) {
            (Some([t0, x0]), Some([t1, x1])) => x0 + (x1 - x0) * (t_s - t0) / (t1 - t0),
            (Some([_, x]), None) | (None, Some([_, x])) => x,
            (None, None) => 0.0,
        }
    }

    /// The points of time in seconds and value.
    pub fn points(&self) -> &[[f64; 2]] {
        &self.points
    }
}

/// A sine whose frequency sweeps linearly over the phase.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Chirp {
    /// Amplitude, in the unit of what it is added to.
    pub amplitude: f64,
    /// Frequency at the phase's beginning, Hz.
    pub from_hz: f64,
    /// Frequency at the phase's end, Hz.
    pub to_hz: f64,
}

impl Chirp {
    /// The value `t_s` seconds into a phase of `duration_s`.
    pub fn at(&self, t_s: f64, duration_s: f64) -> f64 {
        let sweep_hz_per_s = (self.to_hz - self.from_hz) / duration_s;
        let cycles = (self.from_hz + 0.5 * sweep_hz_per_s * t_s) * t_s;
        self.amplitude * (std::f64::consts::TAU * cycles).sin()
    }
}

/// What a flight must achieve; what is absent is not asked for.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Criteria {
    /// Highest altitude at least, m.
    pub peak_min_m: Option<f64>,
    /// Highest altitude at most, m.
    pub peak_max_m: Option<f64>,
    /// Half-width of the band in which a set-point counts as reached, m.
    pub settle_band_m: Option<f64>,
    /// Longest time from a hold's beginning until the band is never left again, s.
    pub settling_time_max_s: Option<f64>,
    /// How far the altitude may exceed the hold's set-point after it, m.
    pub overshoot_max_m: Option<f64>,
    /// RMS altitude error over the last hold once settled, m.
    pub rms_error_max_m: Option<f64>,
    /// RMS horizontal error over the last hold once settled, m.
    pub lateral_rms_error_max_m: Option<f64>,
    /// Iterations that may overrun.
    pub overruns_max: Option<f64>,
    /// Lowest altitude between the first two peaks at least, m: a rebound that does not touch the ground.
    pub rebound_min_m: Option<f64>,
}

impl Mission {
    /// Reads a mission file.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, RigError> {
        let path = path.as_ref();
        Self::read(path, &read_text("mission", path)?)
    }

    /// Reads a mission from text; `file` serves messages.
    pub fn read(file: &Path, text: &str) -> Result<Self, RigError> {
        let root = visit::parse(file, text)?;
        let mut mission = Self::default();
        let mut problems = Vec::new();
        Reader::read(file, "", &root, &mut problems, |reader| mission.visit(reader));
        if problems.is_empty() { Ok(mission) } else { Err(RigError::Invalid(problems)) }
    }

    /// The mission as a file. [`Mission::read`] gives the same mission back.
    pub fn to_toml(&self) -> String {
        let mut writer = Writer::default();
        self.clone().visit(&mut writer);
        writer.out
    }

    /// Every key of a mission file.
    pub fn keys() -> Vec<Form> {
        keys::collect(|collector| Self::default().visit(collector))
    }

    fn visit(&mut self, v: &mut impl Visitor) {
        v.text("name", "Name of the mission; a file's name without number and ending.", &mut self.name);
        v.text("description", "What the mission is for, in a sentence.", &mut self.description);
        v.maybe_table("criteria", "What a flight must achieve; what is absent is not asked for.", |v| {
            self.criteria.visit(v);
        });
        v.tables(
            "phase",
            1,
            "What is done one after another.",
            &mut self.phases,
            || PhasePlan { action: PhaseAction::Idle, duration_s: 0.0 },
            PhasePlan::visit,
        );
    }

    /// How long the mission lasts at most, s.
    pub fn duration_s(&self) -> f64 {
        self.phases.iter().map(|plan| plan.duration_s).sum()
    }
}

const ALTITUDE: Range = Range::closed(0.0, 100.0);
const LATERAL: Range = Range::closed(-100.0, 100.0);
const THRUST_TO_WEIGHT: Range = Range::closed(0.0, 5.0);

impl PhasePlan {
    fn visit(&mut self, v: &mut impl Visitor) {
        const KINDS: [(&str, Phase); 5] = [
            ("idle", Phase::Idle),
            ("launch", Phase::Launch),
            ("open", Phase::Open),
            ("hold", Phase::Hold),
            ("land", Phase::Land),
        ];
        let mut kind = self.action.phase();
        v.choice("kind", "What the phase does.", &KINDS, &mut kind);
        if kind != self.action.phase() {
            self.action = PhaseAction::blank(kind);
        }
        v.number(
            "duration_s",
            "How long the phase lasts at most.",
            Range::above(0.0, 3600.0),
            &mut self.duration_s,
        );
        self.action.visit(v);
    }
}

impl PhaseAction {
    /// An action of the kind wanted, to be filled; phases that no mission can ask for are idle.
    fn blank(kind: Phase) -> Self {
        let nothing = Profile::default;
        match kind {
            Phase::Idle | Phase::Abort => Self::Idle,
            Phase::Launch => Self::Launch { thrust_to_weight: nothing() },
            Phase::Open => Self::Open { thrust_to_weight: nothing(), chirp: None },
            Phase::Hold => Self::Hold {
                altitude_m: nothing(),
                x_m: nothing(),
                y_m: nothing(),
                heading_rad: nothing(),
                chirp: None,
            },
            Phase::Land => Self::Land { descent_m_s: 0.0, cut_below_m: 0.0 },
        }
    }

    fn visit(&mut self, v: &mut impl Visitor) {
        match self {
            Self::Idle => {}
            Self::Launch { thrust_to_weight } => {
                v.points(
                    "thrust_to_weight",
                    "Nominal thrust out of the ground effect over nominal weight, over time since \
                     the phase began.",
                    THRUST_TO_WEIGHT,
                    &mut thrust_to_weight.points,
                    None,
                );
            }
            Self::Open { thrust_to_weight, chirp } => {
                v.points(
                    "thrust_to_weight",
                    "Nominal thrust out of the ground effect over nominal weight, over time since \
                     the phase began.",
                    THRUST_TO_WEIGHT,
                    &mut thrust_to_weight.points,
                    None,
                );
                visit_chirp(v, "chirp_amplitude", "the thrust-to-weight ratio", chirp);
            }
            Self::Hold { altitude_m, x_m, y_m, heading_rad, chirp } => {
                v.points(
                    "altitude_m",
                    "Altitude to hold, over time since the phase began.",
                    ALTITUDE,
                    &mut altitude_m.points,
                    None,
                );
                v.points(
                    "x_m",
                    "x to hold, over time since the phase began.",
                    LATERAL,
                    &mut x_m.points,
                    Some(0.0),
                );
                v.points(
                    "y_m",
                    "y to hold, over time since the phase began.",
                    LATERAL,
                    &mut y_m.points,
                    Some(0.0),
                );
                v.points(
                    "heading_rad",
                    "Heading to hold, over time since the phase began.",
                    Range::closed(-3.2, 3.2),
                    &mut heading_rad.points,
                    Some(0.0),
                );
                visit_chirp(v, "chirp_amplitude_m", "the altitude", chirp);
            }
            Self::Land { descent_m_s, cut_below_m } => {
                v.number("descent_m_s", "Rate of descent.", Range::above(0.0, 5.0), descent_m_s);
                v.number(
                    "cut_below_m",
                    "Altitude below which the throttle goes to rest.",
                    Range::closed(0.0, 1.0),
                    cut_below_m,
                );
            }
        }
    }
}

fn visit_chirp(v: &mut impl Visitor, amplitude_key: &str, added_to: &str, chirp: &mut Option<Chirp>) {
    let mut amplitude = chirp.map(|chirp| chirp.amplitude);
    let meaning = format!("Amplitude of a sine of sweeping frequency, added to {added_to}.");
    v.maybe(amplitude_key, &meaning, Range::above(0.0, 10.0), &mut amplitude);
    let mut swept = chirp.unwrap_or_default();
    v.along(amplitude_key, amplitude.is_some(), |v| {
        let hertz = Range::closed(0.0, 100.0);
        v.number(
            "chirp_from_hz",
            "Frequency of the sine at the phase's beginning.",
            hertz,
            &mut swept.from_hz,
        );
        v.number("chirp_to_hz", "Frequency of the sine at the phase's end.", hertz, &mut swept.to_hz);
    });
    *chirp = amplitude.map(|amplitude| Chirp { amplitude, ..swept });
}

impl Criteria {
    fn visit(&mut self, v: &mut impl Visitor) {
        let metres = Range::closed(0.0, 100.0);
        v.maybe("peak_min_m", "Highest altitude at least.", metres, &mut self.peak_min_m);
        v.maybe("peak_max_m", "Highest altitude at most.", metres, &mut self.peak_max_m);
        v.maybe(
            "settle_band_m",
            "Half-width of the band in which a set-point counts as reached.",
            Range::above(0.0, 100.0),
            &mut self.settle_band_m,
        );
        v.maybe(
            "settling_time_max_s",
            "Longest time from a hold's beginning until the band is never left again.",
            Range::closed(0.0, 3600.0),
            &mut self.settling_time_max_s,
        );
        v.maybe(
            "overshoot_max_m",
            "How far the altitude may exceed the hold's set-point after it.",
            metres,
            &mut self.overshoot_max_m,
        );
        v.maybe(
            "rms_error_max_m",
            "RMS altitude error over the last hold once settled, at most.",
            metres,
            &mut self.rms_error_max_m,
        );
        v.maybe(
            "lateral_rms_error_max_m",
            "RMS horizontal error over the last hold once settled, at most.",
            metres,
            &mut self.lateral_rms_error_max_m,
        );
        v.maybe(
            "overruns_max",
            "Iterations of the loop that may overrun.",
            Range::closed(0.0, 1e9),
            &mut self.overruns_max,
        );
        v.maybe(
            "rebound_min_m",
            "Lowest altitude between the first two peaks at least: a rebound that does not \
             touch the ground.",
            metres,
            &mut self.rebound_min_m,
        );
    }
}
