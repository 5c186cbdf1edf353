use arrayvec::ArrayVec;
use bench_device::{PositionSample, Time, TrackStatus};

use crate::{
    Battery, Channel, Command, ControlState, Event, Level, Motion, ReadbackAt, Record, Rotor, Tick, Truth,
};

/// One quantity of a channel. Whoever compares, prints or exports records goes by these.
#[derive(Clone, Copy, Debug)]
pub struct Field {
    /// Its name, with the unit where there is one: `position_m.x`, `time_s`.
    pub name: &'static str,
    /// The unit: SI symbols, `1` for ratios, empty for what has none, [`Field::ACTUATION`] for sticks.
    pub unit: &'static str,
    /// The kind of its values.
    pub kind: Kind,
    get: fn(&Record) -> Value<'_>,
}

/// The kind of a field's values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A real number.
    Float,
    /// A count.
    Integer,
    /// A name or a message.
    Text,
    /// Yes or no.
    Bool,
    /// An instant, in seconds since the recording's origin where it is printed.
    Time,
}

/// One value of a field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Value<'a> {
    /// It was not measured.
    Missing,
    /// Of [`Kind::Float`].
    Float(f64),
    /// Of [`Kind::Integer`].
    Integer(u64),
    /// Of [`Kind::Text`].
    Text(&'a str),
    /// Of [`Kind::Bool`].
    Bool(bool),
    /// Of [`Kind::Time`].
    Time(Time),
}

impl Value<'_> {
    /// Its kind; `None` if it is missing.
    pub const fn kind(self) -> Option<Kind> {
        match self {
            Self::Missing => None,
            Self::Float(_) => Some(Kind::Float),
            Self::Integer(_) => Some(Kind::Integer),
            Self::Text(_) => Some(Kind::Text),
            Self::Bool(_) => Some(Kind::Bool),
            Self::Time(_) => Some(Kind::Time),
        }
    }
}

impl From<f64> for Value<'_> {
    fn from(value: f64) -> Self {
        Self::Float(value)
    }
}

impl From<u64> for Value<'_> {
    fn from(value: u64) -> Self {
        Self::Integer(value)
    }
}

impl<'a> From<&'a str> for Value<'a> {
    fn from(value: &'a str) -> Self {
        Self::Text(value)
    }
}

impl From<bool> for Value<'_> {
    fn from(value: bool) -> Self {
        Self::Bool(value)
    }
}

impl From<Time> for Value<'_> {
    fn from(value: Time) -> Self {
        Self::Time(value)
    }
}

impl<'a, T: Into<Value<'a>>> From<Option<T>> for Value<'a> {
    fn from(value: Option<T>) -> Self {
        value.map_or(Self::Missing, Into::into)
    }
}

impl Field {
    /// The unit of sticks: that of the rig's actuation (`bench_rig::Actuation`).
    pub const ACTUATION: &'static str = "actuation";

    /// Its value in a record; [`Value::Missing`] in a record of another channel.
    pub fn value(self, record: &Record) -> Value<'_> {
        (self.get)(record)
    }
}

impl Channel {
    /// Every quantity of the channel. The first field is the record's time ([`Record::time`]).
    pub const fn fields(self) -> &'static [Field] {
        match self {
            Self::Position => POSITION,
            Self::Motion => MOTION,
            Self::ControlState => CONTROL_STATE,
            Self::Command => COMMAND,
            Self::Readback => READBACK,
            Self::Truth => TRUTH,
            Self::Tick => TICK,
            Self::Event => EVENT,
            Self::Battery => BATTERY,
            Self::Rotor => ROTOR,
        }
    }
}

impl Record {
    /// The values of [`Channel::fields`], in their order.
    pub fn values(&self) -> Values<'_> {
        match self {
            Self::Position(position) => position_values(position),
            Self::Motion(motion) => motion_values(motion),
            Self::ControlState(state) => control_state_values(state),
            Self::Command(command) => command_values(command),
            Self::Readback(readback) => readback_values(readback),
            Self::Truth(truth) => truth_values(truth),
            Self::Tick(tick) => tick_values(tick),
            Self::Event(event) => event_values(event),
            Self::Battery(battery) => battery_values(battery),
            Self::Rotor(rotor) => rotor_values(rotor),
        }
    }
}

/// The values of a record, in the order of its channel's fields.
pub type Values<'a> = ArrayVec<Value<'a>, FIELDS_MAX>;

/// No channel has more fields.
pub const FIELDS_MAX: usize = 17;

/// The name of a status as exported.
fn status_name(status: TrackStatus) -> &'static str {
    match status {
        TrackStatus::Found => "found",
        TrackStatus::Lost => "lost",
        TrackStatus::Ambiguous => "ambiguous",
    }
}

impl Level {
    /// The name as printed and exported.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Info => "info",
            Self::Warning => "warning",
            Self::Error => "error",
        }
    }
}

/// The fields of a channel, and a function that gives all of their values: a look at the record's kind for each one would cost
/// more than the value.
macro_rules! fields {
    (
        $table:ident, $values:ident: $variant:ident($type:ty):
        $($name:literal $unit:tt $kind:ident |$payload:ident| $get:expr;)+
    ) => {
        const $table: &[Field] = &[$(Field {
            name: $name,
            unit: fields!(@unit $unit),
            kind: Kind::$kind,
            get: |record| match record {
                Record::$variant($payload) => Value::from($get),
                _ => Value::Missing,
            },
        }),+];

        fn $values(record: &$type) -> Values<'_> {
            let mut values = Values::new();
            $(values.push({
                let $payload = record;
                Value::from($get)
            });)+
            values
        }
    };
    (@unit actuation) => { Field::ACTUATION };
    (@unit $unit:literal) => { $unit };
}

fields! { POSITION, position_values: Position(PositionSample):
    "arrived_at_s" "s" Time |p| p.arrived_at;
    "exposed_at_s" "s" Time |p| p.exposed_at;
    "position_m.x" "m" Float |p| p.position_m[0];
    "position_m.y" "m" Float |p| p.position_m[1];
    "position_m.z" "m" Float |p| p.position_m[2];
    "heading_rad" "rad" Float |p| p.heading_rad;
    "pixel.x" "px" Float |p| p.pixel[0];
    "pixel.y" "px" Float |p| p.pixel[1];
    "size_px" "px" Float |p| p.size_px;
    "status" "" Text |p| status_name(p.status);
}

fields! { MOTION, motion_values: Motion(Motion):
    "time_s" "s" Time |m| m.time;
    "velocity_m_s.x" "m/s" Float |m| m.velocity_m_s[0];
    "velocity_m_s.y" "m/s" Float |m| m.velocity_m_s[1];
    "velocity_m_s.z" "m/s" Float |m| m.velocity_m_s[2];
    "vertical_acceleration_m_s2" "m/s^2" Float |m| m.vertical_acceleration_m_s2;
    "attitude_rad.roll" "rad" Float |m| m.attitude_rad[0];
    "attitude_rad.pitch" "rad" Float |m| m.attitude_rad[1];
    "attitude_rad.yaw" "rad" Float |m| m.attitude_rad[2];
}

fields! { CONTROL_STATE, control_state_values: ControlState(ControlState):
    "time_s" "s" Time |s| s.time;
    "phase" "" Text |s| s.phase.name();
    "setpoint_m.x" "m" Float |s| s.setpoint_m[0];
    "setpoint_m.y" "m" Float |s| s.setpoint_m[1];
    "setpoint_m.z" "m" Float |s| s.setpoint_m[2];
    "setpoint_heading_rad" "rad" Float |s| s.setpoint_heading_rad;
    "estimate_m.x" "m" Float |s| s.estimate_m[0];
    "estimate_m.y" "m" Float |s| s.estimate_m[1];
    "estimate_m.z" "m" Float |s| s.estimate_m[2];
    "estimate_m_s.x" "m/s" Float |s| s.estimate_m_s[0];
    "estimate_m_s.y" "m/s" Float |s| s.estimate_m_s[1];
    "estimate_m_s.z" "m/s" Float |s| s.estimate_m_s[2];
    "vertical_speed_setpoint_m_s" "m/s" Float |s| s.vertical_speed_setpoint_m_s;
    "vertical_speed_error_m_s" "m/s" Float |s| s.vertical_speed_error_m_s;
    "integral_n" "N" Float |s| s.integral_n;
    "thrust_n" "N" Float |s| s.thrust_n;
}

fields! { COMMAND, command_values: Command(Command):
    "time_s" "s" Time |c| c.time;
    "sticks.throttle" actuation Float |c| c.sticks.throttle;
    "sticks.pitch" actuation Float |c| c.sticks.pitch;
    "sticks.roll" actuation Float |c| c.sticks.roll;
    "sticks.yaw" actuation Float |c| c.sticks.yaw;
}

fields! { READBACK, readback_values: Readback(ReadbackAt):
    "time_s" "s" Time |r| r.time;
    "device_time_s" "s" Time |r| r.readback.device_time;
    "sticks.throttle" actuation Float |r| r.readback.sticks.throttle;
    "sticks.pitch" actuation Float |r| r.readback.sticks.pitch;
    "sticks.roll" actuation Float |r| r.readback.sticks.roll;
    "sticks.yaw" actuation Float |r| r.readback.sticks.yaw;
    "faults.watchdog" "" Bool |r| r.readback.faults.watchdog;
    "faults.clamped" "" Bool |r| r.readback.faults.clamped;
    "faults.mismatch" "" Bool |r| r.readback.faults.mismatch;
    "faults.brown_out" "" Bool |r| r.readback.faults.brown_out;
}

fields! { TRUTH, truth_values: Truth(Truth):
    "time_s" "s" Time |t| t.time;
    "position_m.x" "m" Float |t| t.position_m[0];
    "position_m.y" "m" Float |t| t.position_m[1];
    "position_m.z" "m" Float |t| t.position_m[2];
    "velocity_m_s.x" "m/s" Float |t| t.velocity_m_s[0];
    "velocity_m_s.y" "m/s" Float |t| t.velocity_m_s[1];
    "velocity_m_s.z" "m/s" Float |t| t.velocity_m_s[2];
    "attitude.w" "1" Float |t| t.attitude[0];
    "attitude.x" "1" Float |t| t.attitude[1];
    "attitude.y" "1" Float |t| t.attitude[2];
    "attitude.z" "1" Float |t| t.attitude[3];
    "body_rate_rad_s.x" "rad/s" Float |t| t.body_rate_rad_s[0];
    "body_rate_rad_s.y" "rad/s" Float |t| t.body_rate_rad_s[1];
    "body_rate_rad_s.z" "rad/s" Float |t| t.body_rate_rad_s[2];
    "thrust_n" "N" Float |t| t.thrust_n;
    "rotor_speed_ratio" "1" Float |t| t.rotor_speed_ratio;
    "charge_hover_min" "min" Float |t| t.charge_hover_min;
}

fields! { TICK, tick_values: Tick(Tick):
    "started_s" "s" Time |t| t.started;
    "index" "" Integer |t| t.index;
    "scheduled_s" "s" Time |t| t.scheduled;
    "sense_s" "s" Float |t| t.sense_s;
    "control_s" "s" Float |t| t.control_s;
    "actuate_s" "s" Float |t| t.actuate_s;
    "overrun" "" Bool |t| t.overrun;
}

fields! { EVENT, event_values: Event(Event):
    "time_s" "s" Time |e| e.time;
    "level" "" Text |e| e.level.name();
    "text" "" Text |e| e.text.as_str();
}

fields! { BATTERY, battery_values: Battery(Battery):
    "time_s" "s" Time |b| b.time;
    "voltage_v" "V" Float |b| b.voltage_v;
    "current_a" "A" Float |b| b.current_a;
}

fields! { ROTOR, rotor_values: Rotor(Rotor):
    "time_s" "s" Time |r| r.time;
    "speed_1_rad_s" "rad/s" Float |r| r.speed_rad_s[0];
    "speed_2_rad_s" "rad/s" Float |r| r.speed_rad_s[1];
    "speed_3_rad_s" "rad/s" Float |r| r.speed_rad_s[2];
    "speed_4_rad_s" "rad/s" Float |r| r.speed_rad_s[3];
}
