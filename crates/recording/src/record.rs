use arrayvec::ArrayString;
use bench_device::{PositionSample, Readback, Sticks, Time};
pub use bench_rig::ControlState;

/// One message of a recording as the loop hands it over: plain `Copy` data, so that handing it over never allocates.
/// The writer's thread turns it into protobuf. The doc of each variant names its channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Record {
    /// `/tracker/position`
    Position(PositionSample),
    /// `/airframe/motion`
    Motion(Motion),
    /// `/control/state`
    ControlState(ControlState),
    /// `/control/command`
    Command(Command),
    /// `/dac/readback`
    Readback(ReadbackAt),
    /// `/plant/truth`
    Truth(Truth),
    /// `/loop/tick`
    Tick(Tick),
    /// `/bench/event`
    Event(Event),
    /// `/battery`
    Battery(Battery),
    /// `/rotor`
    Rotor(Rotor),
}

/// Motion measured on board or by a motion-capture system; absent values were not measured.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion {
    /// When it was measured.
    pub time: Time,
    /// World frame, m/s: x, y, z.
    pub velocity_m_s: [Option<f64>; 3],
    /// Acceleration along the world's z without gravity (zero at rest), m/s^2.
    pub vertical_acceleration_m_s2: Option<f64>,
    /// Roll, pitch, yaw in radians.
    pub attitude_rad: [Option<f64>; 3],
}

/// What the controller asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Command {
    /// When it was handed to the output.
    pub time: Time,
    /// The sticks asked for.
    pub sticks: Sticks,
}

/// A readback and when it reached the loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReadbackAt {
    /// When it reached the loop.
    pub time: Time,
    /// What the board measured.
    pub readback: Readback,
}

/// The simulated airframe as it really was.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Truth {
    /// When.
    pub time: Time,
    /// World frame, m.
    pub position_m: [f64; 3],
    /// World frame, m/s.
    pub velocity_m_s: [f64; 3],
    /// Body to world, w x y z.
    pub attitude: [f64; 4],
    /// Body frame, rad/s.
    pub body_rate_rad_s: [f64; 3],
    /// Thrust of all rotors together, ground effect included, N.
    pub thrust_n: f64,
    /// Rotor speed over rotor speed at hover.
    pub rotor_speed_ratio: f64,
    /// Charge drawn since take-off, in minutes of hover.
    pub charge_hover_min: f64,
}

/// The timing of one iteration of the loop.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tick {
    /// Counts from zero.
    pub index: u64,
    /// When the iteration was due.
    pub scheduled: Time,
    /// When it started.
    pub started: Time,
    /// Time spent reading the tracker, s.
    pub sense_s: f64,
    /// Time spent in the controller, s.
    pub control_s: f64,
    /// Time spent writing and reading back the outputs, s.
    pub actuate_s: f64,
    /// The iteration started so late, or took so long, that the next one was touched.
    pub overrun: bool,
}

/// Text of an event: bounded, so that it can be made on the loop's path.
pub type EventText = ArrayString<118>;

/// Something worth telling a person.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Event {
    /// When.
    pub time: Time,
    /// How bad it is.
    pub level: Level,
    /// What happened.
    pub text: EventText,
}

/// How bad an event is; the order is that of severity.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Level {
    /// In the course of things.
    Info,
    /// Worth a look.
    Warning,
    /// Something failed.
    Error,
}

/// The battery as measured.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Battery {
    /// When.
    pub time: Time,
    /// Terminal voltage, V.
    pub voltage_v: f64,
    /// Current drawn, A, where measured.
    pub current_a: Option<f64>,
}

/// The rotors as measured (or the motors' commands, where an import says so).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Rotor {
    /// When.
    pub time: Time,
    /// Angular speed of each rotor, rad/s; absent rotors are `None`.
    pub speed_rad_s: [Option<f64>; 4],
}
