use std::{
    fs, io,
    path::{Path, PathBuf},
};

use crate::{
    Airframe, Calibration, Location, Problem, RigError, StickRange, Uncertain,
    keys::{self, Form, Key, Kind},
    visit::{self, Node, Range, Reader, Value, Visitor, Writer, float, quoted},
};

/// The nominal model of a bench and how it is run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rig {
    /// Its name.
    pub name: String,
    /// Which bench it is.
    pub bench: Bench,
    /// What flies.
    pub airframe: Airframe,
    /// How the airframe is simulated.
    pub plant: Plant,
    /// The control loop's timing.
    pub control_loop: Loop,
    /// The voltage output.
    pub output: Output,
    /// The position source.
    pub tracker: Tracker,
    /// Gains of the controller.
    pub control: Control,
    /// When to stop.
    pub safety: Safety,
    /// How the camera sees, where frames are looked at.
    pub calibration: Option<Calibration>,
    /// What disturbs a nominal flight.
    pub disturbance: Disturbance,
    /// What hypotheses gain on nominal flights: the model's own error.
    pub held_out: Vec<HeldOut>,
    /// Effects added to the nominal model, in the order of the file.
    pub effects: Vec<EffectEntry>,
}

/// Which of the loop's ends are real.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Bench {
    /// None.
    #[default]
    Virtual,
    /// The output, wired to its own input.
    Loopback,
    /// All: output, airframe, tracker.
    Transmitter,
}

/// Which equations the virtual airframe obeys.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Model {
    /// The paper's vertical model alone.
    Vertical,
    /// A rigid body with six degrees of freedom under the on-board stabiliser.
    #[default]
    SixDegree,
}

/// How the airframe is simulated.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Plant {
    /// Which equations.
    pub model: Model,
    /// Integration step, s.
    pub step_s: f64,
    /// Time between two records of the true state, s.
    pub truth_period_s: f64,
}

/// The control loop's timing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Loop {
    /// Time between two iterations, s.
    pub period_s: f64,
}

/// The voltage output and its readback.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Output {
    /// Resolution over the airframe's stick range; 0: continuous, or in steps of its own.
    pub bits: u32,
    /// Steps of its own, in units of the actuation, whose places only the readback tells: a converter whose range is not
    /// the sticks', behind wires with gain and offset.
    pub own_step: Option<f64>,
    /// One sigma of the readback, as a fraction of the stick range.
    pub readback_noise_fraction: f64,
}

impl Output {
    /// What a pin holds when `value` is asked of it: within the sticks' range, rounded to the output's resolution.
    pub fn on_the_pin(&self, sticks: &StickRange, value: f64) -> f64 {
        let clamped = value.clamp(sticks.min, sticks.max);
        let step = self.step(sticks);
        if step == 0.0 {
            return clamped;
        }
        (sticks.min + ((clamped - sticks.min) / step).round() * step).min(sticks.max)
    }

    /// The same, as far as the command alone tells it: not rounded where the steps lie in places of their own.
    pub fn expected_on_the_pin(&self, sticks: &StickRange, value: f64) -> f64 {
        match self.own_step {
            Some(_) => value.clamp(sticks.min, sticks.max),
            None => self.on_the_pin(sticks, value),
        }
    }

    /// One step, in units of the actuation; 0: continuous.
    pub fn step(&self, sticks: &StickRange) -> f64 {
        match self.own_step {
            Some(step) => step,
            None if self.bits == 0 => 0.0,
            None => (sticks.max - sticks.min) / f64::from((1_u32 << self.bits) - 1),
        }
    }
}

/// The position source.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tracker {
    /// Exposure to arrival, s.
    pub latency_s: Uncertain,
    /// Time between two frames, s.
    pub frame_period_s: f64,
    /// Positions come in steps of this, m; 0: continuous.
    pub resolution_m: f64,
    /// White noise before rounding, one sigma, m.
    pub noise_m: f64,
    /// White noise of the heading, one sigma, rad; absent: the tracker gives no heading.
    pub heading_noise_rad: Option<f64>,
    /// Probability that a frame is lost.
    pub dropout_probability: f64,
}

/// How position and velocity are predicted over the delay.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Predictor {
    /// The paper's: straight on by the velocity last seen.
    #[default]
    Linear,
    /// An observer that carries the airframe's model over the delay, with the commands that were given.
    Model,
}

/// What the altitude law takes for granted of thrust before any error is seen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FeedForward {
    /// The paper's: the weight.
    #[default]
    Weight,
    /// The weight, less what the ground effect adds at that altitude; landings stay in closed loop down to the ground.
    GroundEffect,
}

/// Laws and gains of the controller; those of the altitude law are per unit of nominal mass.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Control {
    /// How position and velocity are predicted.
    pub predictor: Predictor,
    /// What the altitude law takes for granted.
    pub feed_forward: FeedForward,
    /// What the model predictor trusts its model with; unused by the linear one.
    pub observer: Observer,
    /// Wanted vertical speed per metre of altitude error, 1/s (figure 14: gain1).
    pub position_gain_per_s: f64,
    /// Proportional thrust per mass and speed error, 1/s (figure 14: gain2).
    pub speed_gain_per_s: f64,
    /// Integral thrust per mass, speed error and time, 1/s^2 (figure 14: gain3 over period). With the model predictor, the
    /// disturbance that it finds takes the integral's place, sideways too.
    pub integral_gain_per_s2: f64,
    /// How far position and velocity are extrapolated, s: latency, hold and half of the velocity window. Linear predictor
    /// only.
    pub extrapolation_s: f64,
    /// Time over which velocity is taken as the slope of the positions, s. Linear predictor only.
    pub velocity_window_s: f64,
    /// Wanted horizontal speed per metre of error, 1/s.
    pub lateral_position_gain_per_s: f64,
    /// Horizontal acceleration per horizontal speed error, 1/s.
    pub lateral_speed_gain_per_s: f64,
    /// Horizontal acceleration per horizontal speed error and time, 1/s^2: trims the sticks' centre.
    pub lateral_integral_gain_per_s2: f64,
    /// Largest tilt asked for, rad.
    pub tilt_max_rad: f64,
    /// Yaw rate per radian of heading error, 1/s.
    pub heading_gain_per_s: f64,
}

/// Accelerations besides the model, as the model predictor takes them: the larger, the more it follows what is seen.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Observer {
    /// White acceleration, m/s^2 per root Hz.
    pub white_m_s2_per_root_hz: f64,
    /// Random walk of the acceleration that it holds the airframe to be off its model by, m/s^2 per root s.
    pub drift_m_s2_per_root_s: f64,
}

/// What disturbs a nominal flight, as far as it was measured (`bench identify flight`). The diagnosis holds flights
/// against it; where a number is absent it takes that of a small quadcopter in calm air.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Disturbance {
    /// One sigma of the turbulence's vertical acceleration, m/s^2.
    pub turbulence_m_s2: Option<f64>,
    /// One sigma of the natural logarithm by which the turbulence differs from day to day.
    pub turbulence_spread_ln: Option<f64>,
    /// For how long it remembers, s.
    pub turbulence_time_s: Option<f64>,
    /// One sigma of the acceleration that a flight keeps and the next has not, m/s^2: batteries, trims, sensors warm
    /// or cold.
    pub trim_m_s2: Option<f64>,
    /// Random walk of that acceleration within a flight, m/s^2 per root s.
    pub trim_walk_m_s2_per_root_s: Option<f64>,
    /// White acceleration, m/s^2 per root Hz: what is faster than turbulence.
    pub white_m_s2_per_root_hz: Option<f64>,
    /// One sigma of the exposures' times, s: sightings are the worse the faster the airframe.
    pub timing_s: Option<f64>,
    /// Share of sightings that show a wrong place.
    pub outlier_probability: Option<f64>,
    /// One sigma of wrong places about the right one, m; needed with `outlier_probability`.
    pub outlier_m: Option<f64>,
    /// One sigma of the natural logarithm by which noise of tracker and air differs from flight to flight; absent: it
    /// does not.
    pub noise_spread_ln: Option<f64>,
    /// One sigma of the vertical speed that a recording's motion channel holds, m/s; absent: it is not used.
    pub velocity_noise_m_s: Option<f64>,
    /// The same of the vertical acceleration, m/s^2.
    pub acceleration_noise_m_s2: Option<f64>,
}

/// What a hypothesis gained on nominal flights that were held against the model of the other ones (`bench identify flight`): what the
/// model gets wrong alike in flights that were fine. The diagnosis counts only what is beyond.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HeldOut {
    /// An effect, two of them as `a+b`, or `unknown`.
    pub hypothesis: String,
    /// Gain of log-evidence a measurement, nats.
    pub nats_per_measurement: f64,
}

impl HeldOut {
    fn visit(&mut self, v: &mut impl Visitor) {
        v.text("hypothesis", "An effect, two of them as `a+b`, or `unknown`.", &mut self.hypothesis);
        v.number(
            "nats_per_measurement",
            "Gain of log-evidence a measurement over no effect, in natural logarithms.",
            Range::closed(0.0, 1e6),
            &mut self.nats_per_measurement,
        );
    }
}

/// When to stop a flight.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Safety {
    /// Highest altitude, m.
    pub ceiling_m: f64,
    /// Largest horizontal distance from the origin, m.
    pub radius_m: f64,
    /// Longest time without a position, s.
    pub tracker_timeout_s: f64,
    /// Longest flight, s.
    pub flight_time_max_s: f64,
    /// Overruns in a row that stop the flight.
    pub overrun_streak: u32,
}

/// One `[[effect]]` of a rig file or one `--effect`. Names and ranges are known to whoever holds the laws, not here; the
/// place is kept so that they can point at it.
#[derive(Clone, Debug, PartialEq)]
pub struct EffectEntry {
    /// The effect's name.
    pub name: String,
    /// Parameters by key, with their lines.
    pub parameters: Vec<(String, f64, usize)>,
    /// Where it stands.
    pub at: Location,
}

/// Reads the text of a file that a rig names.
pub type ReadText<'a> = dyn Fn(&Path) -> io::Result<String> + 'a;
const AIRFRAME: &str = "What flies: a table, or the name of an airframe file, seen from the rig's folder.";
const CALIBRATION: &str =
    "How the camera sees: a table, or the name of a calibration file, seen from the rig's folder.";
const EFFECT: &str = "Effects added to the nominal model; `bench effects` tells their laws.";

impl Rig {
    /// Reads a rig file and the airframe file that it names.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, RigError> {
        let path = path.as_ref();
        Self::read(path, &read_text("rig", path)?)
    }

    /// Reads a rig from text; `file` serves messages and finds the airframe file beside it.
    pub fn read(file: &Path, text: &str) -> Result<Self, RigError> {
        Self::read_with(file, text, &|path: &Path| fs::read_to_string(path))
    }

    /// The same, with the files that the rig names read by `read_text`: they need not lie on a disk.
    pub fn read_with(file: &Path, text: &str, read_text: &ReadText<'_>) -> Result<Self, RigError> {
        let root = visit::parse(file, text)?;
        let airframe_file = named_file(file, &root, "airframe", read_text)?;
        let calibration_file = named_file(file, &root, "calibration", read_text)?;
        let mut rig = Self::default();
        let mut problems = Vec::new();
        Reader::read(file, "", &root, &mut problems, |reader| {
            rig.visit(reader);
            rig.effects = effects(reader);
            match &airframe_file {
                // Read below, from the file that it names.
                Some(_) => _ = reader.get("airframe"),
                None => reader.table("airframe", |reader| rig.airframe.visit(reader)),
            }
            if reader.has("calibration") {
                let calibration = rig.calibration.insert(Calibration::default());
                match &calibration_file {
                    Some(_) => _ = reader.get("calibration"),
                    None => reader.table("calibration", |reader| calibration.visit(reader)),
                }
            }
            if reader.is_sound() {
                for (key, detail) in rig.contradictions() {
                    reader.contradiction(key, detail);
                }
            }
        });
        if let Some((path, node)) = &airframe_file {
            Reader::read(path, "", node, &mut problems, |reader| rig.airframe.visit(reader));
        }
        if let (Some((path, node)), Some(calibration)) = (&calibration_file, &mut rig.calibration) {
            Reader::read(path, "", node, &mut problems, |reader| calibration.visit(reader));
        }
        if problems.is_empty()
            && let Some(detail) = rig.latency_contradiction()
        {
            let file = calibration_file.as_ref().map_or(file, |(path, _)| path).to_owned();
            let at = Location { file, line: 1 };
            problems.push(Problem::Contradiction { at, key: "latency_s".to_owned(), detail });
        }
        if problems.is_empty() {
            let at = match &airframe_file {
                Some((path, _)) => Location { file: path.clone(), line: 1 },
                None => Location { file: file.to_owned(), line: 1 },
            };
            problems.extend(
                rig.airframe.contradictions().into_iter().map(|(key, detail)| Problem::Contradiction {
                    at: at.clone(),
                    key: key.to_owned(),
                    detail,
                }),
            );
        }
        if problems.is_empty() { Ok(rig) } else { Err(RigError::Invalid(problems)) }
    }

    /// The rig as one self-contained file, airframe included. [`Rig::read`] gives the same rig back.
    pub fn to_toml(&self) -> String {
        let mut writer = Writer::default();
        let mut rig = self.clone();
        rig.visit(&mut writer);
        writer.table("airframe", AIRFRAME, |writer| rig.airframe.visit(writer));
        if let Some(calibration) = &mut rig.calibration {
            writer.table("calibration", CALIBRATION, |writer| calibration.visit(writer));
        }
        for effect in &self.effects {
            writer.element("effect");
            writer.line("name", quoted(&effect.name));
            for (key, value, _) in &effect.parameters {
                writer.line(key, float(*value));
            }
        }
        writer.out
    }

    /// Every key of a rig file. The parameters of an `[[effect]]` are known to whoever holds the laws.
    pub fn keys() -> Vec<Form> {
        let mut forms = keys::collect(|collector| Self::default().visit(collector));
        let file_or = |table| Kind::AnyOf(vec![Kind::File, Kind::Table(table)]);
        for form in &mut forms {
            let after = form.keys.iter().position(|key| key.name == "plant").unwrap_or(form.keys.len());
            form.keys.insert(after, Key::required("airframe", AIRFRAME, file_or(Airframe::keys())));
            form.keys.push(Key::optional("calibration", CALIBRATION, file_or(Calibration::keys())));
            form.keys.push(Key::optional("effect", EFFECT, Kind::Effects));
        }
        forms
    }

    fn visit(&mut self, v: &mut impl Visitor) {
        const MODELS: [(&str, Model); 2] = [("vertical", Model::Vertical), ("six-degree", Model::SixDegree)];
        const BENCHES: [(&str, Bench); 3] =
            [("virtual", Bench::Virtual), ("loopback", Bench::Loopback), ("transmitter", Bench::Transmitter)];
        v.text("name", "Name of the rig, as recordings and pages give it.", &mut self.name);
        v.choice_or(
            "bench",
            "Which of the loop's ends are real: none; the output, wired to its own input; \
             output, airframe and tracker.",
            &BENCHES,
            &mut self.bench,
        );
        v.table("plant", "How the airframe is simulated.", |v| {
            v.choice(
                "model",
                "Equations of the airframe: the paper's vertical model alone, or a rigid body \
                 under its stabiliser.",
                &MODELS,
                &mut self.plant.model,
            );
            v.number(
                "step_s",
                "Integration step, not longer than loop.period_s.",
                Range::closed(1e-5, 0.02),
                &mut self.plant.step_s,
            );
            v.number(
                "truth_period_s",
                "Time between two records of the true state, not shorter than step_s.",
                Range::closed(1e-4, 10.0),
                &mut self.plant.truth_period_s,
            );
        });
        v.table("loop", "The control loop's timing.", |v| {
            v.number(
                "period_s",
                "Time between two iterations.",
                Range::closed(0.001, 1.0),
                &mut self.control_loop.period_s,
            );
        });
        v.table("output", "The voltage output and its readback.", |v| {
            v.integer(
                "bits",
                "Resolution over the airframe's stick range; 0: continuous, or in steps of its own.",
                0,
                24,
                &mut self.output.bits,
            );
            v.maybe(
                "own_step",
                "Steps of its own, in units of the actuation, whose places only the readback \
                 tells; bits is 0 then.",
                Range::closed(1e-6, 1e3),
                &mut self.output.own_step,
            );
            v.number(
                "readback_noise_fraction",
                "One sigma of the readback, as a fraction of the stick range.",
                Range::closed(0.0, 0.1),
                &mut self.output.readback_noise_fraction,
            );
        });
        v.table("tracker", "The position source.", |v| self.tracker.visit(v));
        v.table(
            "control",
            "Laws and gains of the controller; those of the altitude law are per unit of \
             nominal mass.",
            |v| self.control.visit(v),
        );
        v.table("safety", "When to stop a flight.", |v| self.safety.visit(v));
        v.maybe_table(
            "disturbance",
            "What disturbs a nominal flight, as far as it was measured (`bench identify \
             flight`).",
            |v| self.disturbance.visit(v),
        );
        v.tables(
            "held_out",
            0,
            "What a hypothesis gained on nominal flights that were held against the model of the \
             other ones (`bench identify flight`); the diagnosis counts only what is beyond.",
            &mut self.held_out,
            HeldOut::default,
            HeldOut::visit,
        );
    }

    fn latency_contradiction(&self) -> Option<String> {
        let (measured, stated) = (self.calibration.as_ref()?.latency_s?, self.tracker.latency_s.value);
        ((measured - stated).abs() > 1e-6).then(|| {
            format!("the calibration measured {measured} s, but the rig's [tracker] has {stated} s; write the measured one there")
        })
    }

    fn contradictions(&self) -> Vec<(&'static str, String)> {
        let mut found = Vec::new();
        if self.plant.step_s > self.control_loop.period_s {
            found.push(("plant", "step_s is longer than the loop's period_s".to_owned()));
        }
        if self.output.own_step.is_some() && self.output.bits > 0 {
            found.push(("output", "own_step and bits are both given; with own_step, bits is 0".to_owned()));
        }
        if self.plant.truth_period_s < self.plant.step_s {
            found.push(("plant", "truth_period_s is shorter than step_s".to_owned()));
        }
        found
    }
}

impl Tracker {
    fn visit(&mut self, v: &mut impl Visitor) {
        v.uncertain("latency_s", "Exposure to arrival.", Range::closed(0.0, 1.0), &mut self.latency_s);
        v.number(
            "frame_period_s",
            "Time between two frames.",
            Range::closed(0.001, 1.0),
            &mut self.frame_period_s,
        );
        v.number(
            "resolution_m",
            "Positions come in steps of this; 0: continuous.",
            Range::closed(0.0, 0.1),
            &mut self.resolution_m,
        );
        v.number(
            "noise_m",
            "White noise before rounding, one sigma.",
            Range::closed(0.0, 0.1),
            &mut self.noise_m,
        );
        v.maybe(
            "heading_noise_rad",
            "White noise of the heading, one sigma; absent: the tracker gives no heading.",
            Range::closed(0.0, 1.0),
            &mut self.heading_noise_rad,
        );
        v.number(
            "dropout_probability",
            "Probability that a frame is lost.",
            Range::closed(0.0, 1.0),
            &mut self.dropout_probability,
        );
    }
}

impl Control {
    fn visit(&mut self, v: &mut impl Visitor) {
        const PREDICTORS: [(&str, Predictor); 2] =
            [("linear", Predictor::Linear), ("model", Predictor::Model)];
        const FEED_FORWARDS: [(&str, FeedForward); 2] =
            [("weight", FeedForward::Weight), ("ground-effect", FeedForward::GroundEffect)];
        let gain = Range::closed(0.0, 1000.0);
        v.choice_beside(
            "predictor",
            "How position and velocity are predicted over the delay: straight on, or by the \
             airframe's model.",
            &PREDICTORS,
            &mut self.predictor,
        );
        v.choice_beside(
            "feed_forward",
            "What the altitude law takes for granted of thrust: the weight, or the weight \
             less the ground effect.",
            &FEED_FORWARDS,
            &mut self.feed_forward,
        );
        self.observer.visit(v, self.predictor);
        v.number(
            "position_gain_per_s",
            "Wanted vertical speed per metre of altitude error.",
            gain,
            &mut self.position_gain_per_s,
        );
        v.number(
            "speed_gain_per_s",
            "Proportional thrust per mass and speed error.",
            gain,
            &mut self.speed_gain_per_s,
        );
        v.number(
            "integral_gain_per_s2",
            "Integral thrust per mass, speed error and time; the model predictor's \
             disturbance takes its place.",
            gain,
            &mut self.integral_gain_per_s2,
        );
        v.number(
            "extrapolation_s",
            "How far position and velocity are extrapolated: latency, hold and half of the \
             velocity window; linear predictor only.",
            Range::closed(0.0, 2.0),
            &mut self.extrapolation_s,
        );
        v.number(
            "velocity_window_s",
            "Time over which velocity is taken as the slope of the positions; linear \
             predictor only.",
            Range::above(0.0, 1.0),
            &mut self.velocity_window_s,
        );
        v.number(
            "lateral_position_gain_per_s",
            "Wanted horizontal speed per metre of error.",
            gain,
            &mut self.lateral_position_gain_per_s,
        );
        v.number(
            "lateral_speed_gain_per_s",
            "Horizontal acceleration per horizontal speed error.",
            gain,
            &mut self.lateral_speed_gain_per_s,
        );
        v.number(
            "lateral_integral_gain_per_s2",
            "Horizontal acceleration per horizontal speed error and time: trims the sticks' \
             centre.",
            gain,
            &mut self.lateral_integral_gain_per_s2,
        );
        v.number("tilt_max_rad", "Largest tilt asked for.", Range::closed(0.0, 1.0), &mut self.tilt_max_rad);
        v.number(
            "heading_gain_per_s",
            "Yaw rate per radian of heading error.",
            gain,
            &mut self.heading_gain_per_s,
        );
    }
}

impl Safety {
    fn visit(&mut self, v: &mut impl Visitor) {
        v.number("ceiling_m", "Highest altitude.", Range::above(0.0, 1000.0), &mut self.ceiling_m);
        v.number(
            "radius_m",
            "Largest horizontal distance from the origin.",
            Range::above(0.0, 1000.0),
            &mut self.radius_m,
        );
        v.number(
            "tracker_timeout_s",
            "Longest time without a position.",
            Range::above(0.0, 60.0),
            &mut self.tracker_timeout_s,
        );
        v.number(
            "flight_time_max_s",
            "Longest flight.",
            Range::above(0.0, 3600.0),
            &mut self.flight_time_max_s,
        );
        v.integer(
            "overrun_streak",
            "Overruns in a row that stop the flight.",
            1,
            10_000,
            &mut self.overrun_streak,
        );
    }
}

impl Disturbance {
    fn visit(&mut self, v: &mut impl Visitor) {
        let acceleration = Range::above(0.0, 100.0);
        v.maybe(
            "turbulence_m_s2",
            "One sigma of the turbulence's vertical acceleration.",
            acceleration,
            &mut self.turbulence_m_s2,
        );
        v.maybe(
            "turbulence_spread_ln",
            "One sigma of the natural logarithm by which the turbulence differs from day to day; \
             absent: 0.25 where the turbulence is given.",
            Range::above(0.0, 3.0),
            &mut self.turbulence_spread_ln,
        );
        v.maybe(
            "turbulence_time_s",
            "For how long the turbulence remembers.",
            Range::closed(0.01, 100.0),
            &mut self.turbulence_time_s,
        );
        v.maybe(
            "trim_m_s2",
            "One sigma of the acceleration that a flight keeps and the next has not.",
            acceleration,
            &mut self.trim_m_s2,
        );
        let walk = &mut self.trim_walk_m_s2_per_root_s;
        v.maybe(
            "trim_walk_m_s2_per_root_s",
            "Random walk of that acceleration within a flight.",
            acceleration,
            walk,
        );
        v.maybe(
            "white_m_s2_per_root_hz",
            "White acceleration: what is faster than turbulence.",
            acceleration,
            &mut self.white_m_s2_per_root_hz,
        );
        v.maybe(
            "timing_s",
            "One sigma of the exposures' times.",
            Range::closed(0.0, 1.0),
            &mut self.timing_s,
        );
        v.maybe(
            "outlier_probability",
            "Share of sightings that show a wrong place.",
            Range::closed(0.0, 0.5),
            &mut self.outlier_probability,
        );
        v.maybe(
            "outlier_m",
            "One sigma of wrong places about the right one; needed with outlier_probability.",
            Range::above(0.0, 10.0),
            &mut self.outlier_m,
        );
        v.maybe(
            "noise_spread_ln",
            "One sigma of the natural logarithm by which noise of tracker and air differs \
             from flight to flight.",
            Range::above(0.0, 3.0),
            &mut self.noise_spread_ln,
        );
        v.maybe(
            "velocity_noise_m_s",
            "One sigma of the vertical speed that a recording's motion channel holds; \
             absent: it is not used.",
            Range::above(0.0, 100.0),
            &mut self.velocity_noise_m_s,
        );
        v.maybe(
            "acceleration_noise_m_s2",
            "One sigma of the vertical acceleration that a recording's motion channel holds; \
             absent: it is not used.",
            acceleration,
            &mut self.acceleration_noise_m_s2,
        );
    }
}

impl Observer {
    /// The model predictor needs its numbers; beside the linear one they may stand for another day.
    fn visit(&mut self, v: &mut impl Visitor, predictor: Predictor) {
        let range = Range::above(0.0, 100.0);
        let white = "White acceleration besides the model, as the model predictor takes it.";
        let drift = "Random walk of the acceleration that the airframe may be off its model by.";
        for (key, meaning, value) in [
            ("observer_white_m_s2_per_root_hz", white, &mut self.white_m_s2_per_root_hz),
            ("observer_drift_m_s2_per_root_s", drift, &mut self.drift_m_s2_per_root_s),
        ] {
            if predictor == Predictor::Model {
                v.number(key, meaning, range, value);
            } else {
                let mut maybe = (*value > 0.0).then_some(*value);
                v.maybe(key, meaning, range, &mut maybe);
                *value = maybe.unwrap_or(0.0);
            }
        }
    }
}

/// The file named by `key = "..."`, parsed; `None` when it is a table of the rig itself, or absent.
fn named_file(
    rig_file: &Path,
    root: &Node,
    key: &str,
    read_text: &ReadText<'_>,
) -> Result<Option<(PathBuf, Node)>, RigError> {
    let Value::Table(entries) = &root.value else { return Ok(None) };
    let Some((_, node)) = entries.iter().find(|(name, _)| name == key) else { return Ok(None) };
    let Value::Text(name) = &node.value else { return Ok(None) };
    let path = rig_file.parent().unwrap_or(Path::new("")).join(name);
    let text = read_text(&path).map_err(|source| {
        RigError::Invalid(vec![Problem::Contradiction {
            at: Location { file: rig_file.to_owned(), line: node.line },
            key: key.to_owned(),
            detail: format!(
                "cannot read {}: {source}; the path is taken from the rig file's folder",
                path.display()
            ),
        }])
    })?;
    let node = visit::parse(&path, &text)?;
    Ok(Some((path, node)))
}

fn effects(reader: &mut Reader<'_, '_>) -> Vec<EffectEntry> {
    let Some(list) = reader.get("effect") else { return Vec::new() };
    let Value::List(items) = &list.value else {
        reader.wrong_type("effect", list, "tables, each written as [[effect]]");
        return Vec::new();
    };
    items.iter().filter_map(|item| effect(reader, item)).collect()
}

fn effect(reader: &mut Reader<'_, '_>, item: &Node) -> Option<EffectEntry> {
    let Value::Table(entries) = &item.value else {
        reader.wrong_type("effect", item, "tables, each written as [[effect]]");
        return None;
    };
    let mut name = None;
    let mut parameters = Vec::new();
    for (key, node) in entries {
        match (key.as_str(), &node.value) {
            ("name", Value::Text(text)) => name = Some(text.clone()),
            ("name", _) => reader.wrong_type("effect.name", node, "a text"),
            (_, Value::Number(_)) => {
                let any = Range::closed(f64::MIN, f64::MAX);
                if let Some(x) = reader.number_in(&format!("effect.{key}"), node, any) {
                    parameters.push((key.clone(), x, node.line));
                }
            }
            _ => reader.wrong_type(&format!("effect.{key}"), node, "a number"),
        }
    }
    if name.is_none() {
        reader.contradiction("effect", "an [[effect]] needs a `name`; `bench effects` lists them".to_owned());
    }
    Some(EffectEntry { name: name?, parameters, at: reader.at(item.line) })
}

pub(crate) fn read_text(what: &'static str, path: &Path) -> Result<String, RigError> {
    fs::read_to_string(path).map_err(|source| RigError::Read { what, path: path.to_owned(), source })
}
