use std::path::Path;

use crate::{
    Phase, RigError,
    rig::read_text,
    visit::{self, Node, Range, Reader, Value, Visitor, Writer},
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
        let mut items: &[Node] = &[];
        Reader::read(file, "", &root, &mut problems, |reader| {
            reader.text("name", &mut mission.name);
            reader.text("description", &mut mission.description);
            if reader.has("criteria") {
                reader.table("criteria", |reader| mission.criteria.visit(reader));
            }
            if let Some(node) = reader.require("phase", "at least one [[phase]]") {
                match &node.value {
                    Value::List(list) if !list.is_empty() => items = list,
                    _ => reader.wrong_type("phase", node, "tables, each written as [[phase]]"),
                }
            }
        });
        for item in items {
            Reader::read(file, "phase", item, &mut problems, |reader| {
                let mut plan = PhasePlan { action: PhaseAction::Idle, duration_s: 0.0 };
                plan.visit(reader);
                mission.phases.push(plan);
            });
        }
        if problems.is_empty() { Ok(mission) } else { Err(RigError::Invalid(problems)) }
    }

    /// The mission as a file. [`Mission::read`] gives the same mission back.
    pub fn to_toml(&self) -> String {
        let mut writer = Writer::default();
        let mut mission = self.clone();
        writer.text("name", &mut mission.name);
        writer.text("description", &mut mission.description);
        if mission.criteria != Criteria::default() {
            writer.table("criteria", |writer| mission.criteria.visit(writer));
        }
        for plan in &mut mission.phases {
            writer.element("phase");
            plan.visit(&mut writer);
        }
        writer.out
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
        v.choice("kind", &KINDS, &mut kind);
        if kind != self.action.phase() {
            self.action = PhaseAction::blank(kind);
        }
        v.number("duration_s", Range::above(0.0, 3600.0), &mut self.duration_s);
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
                v.points("thrust_to_weight", THRUST_TO_WEIGHT, &mut thrust_to_weight.points, None);
            }
            Self::Open { thrust_to_weight, chirp } => {
                v.points("thrust_to_weight", THRUST_TO_WEIGHT, &mut thrust_to_weight.points, None);
                visit_chirp(v, "chirp_amplitude", chirp);
            }
            Self::Hold { altitude_m, x_m, y_m, heading_rad, chirp } => {
                v.points("altitude_m", ALTITUDE, &mut altitude_m.points, None);
                v.points("x_m", LATERAL, &mut x_m.points, Some(0.0));
                v.points("y_m", LATERAL, &mut y_m.points, Some(0.0));
                v.points("heading_rad", Range::closed(-3.2, 3.2), &mut heading_rad.points, Some(0.0));
                visit_chirp(v, "chirp_amplitude_m", chirp);
            }
            Self::Land { descent_m_s, cut_below_m } => {
                v.number("descent_m_s", Range::above(0.0, 5.0), descent_m_s);
                v.number("cut_below_m", Range::closed(0.0, 1.0), cut_below_m);
            }
        }
    }
}

fn visit_chirp(v: &mut impl Visitor, amplitude_key: &str, chirp: &mut Option<Chirp>) {
    let mut amplitude = chirp.map(|chirp| chirp.amplitude);
    v.maybe(amplitude_key, Range::above(0.0, 10.0), &mut amplitude);
    if let Some(amplitude) = amplitude {
        let mut swept = chirp.unwrap_or_default();
        swept.amplitude = amplitude;
        v.number("chirp_from_hz", Range::closed(0.0, 100.0), &mut swept.from_hz);
        v.number("chirp_to_hz", Range::closed(0.0, 100.0), &mut swept.to_hz);
        *chirp = Some(swept);
    }
}

impl Criteria {
    fn visit(&mut self, v: &mut impl Visitor) {
        let metres = Range::closed(0.0, 100.0);
        v.maybe("peak_min_m", metres, &mut self.peak_min_m);
        v.maybe("peak_max_m", metres, &mut self.peak_max_m);
        v.maybe("settle_band_m", Range::above(0.0, 100.0), &mut self.settle_band_m);
        v.maybe("settling_time_max_s", Range::closed(0.0, 3600.0), &mut self.settling_time_max_s);
        v.maybe("overshoot_max_m", metres, &mut self.overshoot_max_m);
        v.maybe("rms_error_max_m", metres, &mut self.rms_error_max_m);
        v.maybe("lateral_rms_error_max_m", metres, &mut self.lateral_rms_error_max_m);
        v.maybe("overruns_max", Range::closed(0.0, 1e9), &mut self.overruns_max);
        v.maybe("rebound_min_m", metres, &mut self.rebound_min_m);
    }
}
