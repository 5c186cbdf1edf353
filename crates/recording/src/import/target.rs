//! Everything that a column can become: one list, which the map's reader, the conversion and the report share.

use std::f64::consts::{PI, TAU};

use bench_device::{Faults, PositionSample, Readback, Sticks, Time, TrackStatus};
use bench_rig::{Actuation, GRAVITY_M_S2};

use crate::{Battery, Channel, Command, ControlState, Motion, ReadbackAt, Record, Rotor};

/// What kind of quantity it is; decides which units a map may name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Dimension {
    Length,
    Speed,
    Acceleration,
    Angle,
    Voltage,
    Current,
    RotorSpeed,
    /// In the map's actuation.
    Stick,
}

impl Dimension {
    /// The units that a map may name, each with its factor to the recording's unit, which comes first.
    pub const fn units(self, actuation: Actuation) -> &'static [(&'static str, f64)] {
        match self {
            Self::Length => &[("m", 1.0), ("cm", 0.01), ("mm", 0.001)],
            Self::Speed => &[("m/s", 1.0), ("cm/s", 0.01), ("mm/s", 0.001)],
            Self::Acceleration => &[("m/s^2", 1.0), ("g", GRAVITY_M_S2)],
            Self::Angle => &[("rad", 1.0), ("deg", PI / 180.0)],
            Self::Voltage => &[("V", 1.0), ("mV", 0.001)],
            Self::Current => &[("A", 1.0), ("mA", 0.001)],
            Self::RotorSpeed => &[("rad/s", 1.0), ("rpm", TAU / 60.0)],
            Self::Stick => match actuation {
                Actuation::Volt => &[("V", 1.0), ("mV", 0.001)],
                Actuation::Fraction => &[("1", 1.0), ("%", 0.01)],
                Actuation::Count => &[("count", 1.0)],
            },
        }
    }

    /// The recording's unit.
    pub const fn unit(self, actuation: Actuation) -> &'static str {
        self.units(actuation)[0].0
    }
}

/// One number of one channel.
#[derive(Debug)]
pub(super) struct Target {
    /// The key in the channel's table of the map.
    pub key: &'static str,
    pub dimension: Dimension,
    /// Whether the channel makes no sense without it.
    pub required: bool,
    /// Puts the number into a record of the channel; others stay as they are.
    pub set: fn(&mut Record, f64),
}

/// A channel that can be imported, under the name of its table in the map.
#[derive(Debug)]
pub(super) struct Table {
    pub name: &'static str,
    pub channel: Channel,
    /// A record of the channel at a time, with nothing in it but sticks at rest.
    pub blank: fn(Time, Sticks) -> Record,
    pub targets: &'static [Target],
}

impl Target {
    /// Whether it has the other sign where y and z point the other way.
    pub fn is_turned(&self) -> bool {
        matches!(
            self.key,
            "y" | "z"
                | "heading"
                | "velocity_y"
                | "velocity_z"
                | "vertical_acceleration"
                | "pitch"
                | "yaw"
                | "setpoint_y"
                | "setpoint_z"
                | "setpoint_heading"
        )
    }
}

impl Table {
    /// Whether its quantities are along axes or about them.
    pub fn has_frame(&self) -> bool {
        matches!(self.channel, Channel::Position | Channel::Motion | Channel::ControlState)
    }
}

macro_rules! targets {
    ($variant:ident($record:ident): $($key:literal $dimension:ident $need:ident $place:expr;)+) => {
        &[$(Target {
            key: $key,
            dimension: Dimension::$dimension,
            required: targets!(@ $need),
            set: |record, number| {
                if let Record::$variant($record) = record {
                    $place = number.into();
                }
            },
        }),+]
    };
    (@ required) => { true };
    (@ optional) => { false };
}

/// All tables, in the order in which the records of a row are written: that of the loop.
pub(super) const TABLES: &[Table] = &[
    Table {
        name: "position",
        channel: Channel::Position,
        blank: |time, _| {
            PositionSample {
                exposed_at: time,
                arrived_at: time,
                status: TrackStatus::Found,
                ..PositionSample::default()
            }
            .into()
        },
        targets: targets! { Position(p):
            "x" Length optional p.position_m[0];
            "y" Length optional p.position_m[1];
            "z" Length required p.position_m[2];
            "heading" Angle optional p.heading_rad;
        },
    },
    Table {
        name: "motion",
        channel: Channel::Motion,
        blank: |time, _| Motion { time, ..Motion::default() }.into(),
        targets: targets! { Motion(m):
            "velocity_x" Speed optional m.velocity_m_s[0];
            "velocity_y" Speed optional m.velocity_m_s[1];
            "velocity_z" Speed optional m.velocity_m_s[2];
            "vertical_acceleration" Acceleration optional m.vertical_acceleration_m_s2;
            "roll" Angle optional m.attitude_rad[0];
            "pitch" Angle optional m.attitude_rad[1];
            "yaw" Angle optional m.attitude_rad[2];
        },
    },
    Table {
        name: "control",
        channel: Channel::ControlState,
        blank: |time, _| ControlState { time, ..ControlState::default() }.into(),
        targets: targets! { ControlState(s):
            "setpoint_x" Length optional s.setpoint_m[0];
            "setpoint_y" Length optional s.setpoint_m[1];
            "setpoint_z" Length optional s.setpoint_m[2];
            "setpoint_heading" Angle optional s.setpoint_heading_rad;
        },
    },
    Table {
        name: "command",
        channel: Channel::Command,
        blank: |time, sticks| Command { time, sticks }.into(),
        targets: targets! { Command(c):
            "throttle" Stick required c.sticks.throttle;
            "pitch" Stick optional c.sticks.pitch;
            "roll" Stick optional c.sticks.roll;
            "yaw" Stick optional c.sticks.yaw;
        },
    },
    Table {
        name: "readback",
        channel: Channel::Readback,
        blank: |time, sticks| {
            let readback = Readback { device_time: time, sticks, faults: Faults::default() };
            ReadbackAt { time, readback }.into()
        },
        targets: targets! { Readback(r):
            "throttle" Stick required r.readback.sticks.throttle;
            "pitch" Stick optional r.readback.sticks.pitch;
            "roll" Stick optional r.readback.sticks.roll;
            "yaw" Stick optional r.readback.sticks.yaw;
        },
    },
    Table {
        name: "battery",
        channel: Channel::Battery,
        blank: |time, _| Battery { time, ..Battery::default() }.into(),
        targets: targets! { Battery(b):
            "voltage" Voltage required b.voltage_v;
            "current" Current optional b.current_a;
        },
    },
    Table {
        name: "rotor",
        channel: Channel::Rotor,
        blank: |time, _| Rotor { time, ..Rotor::default() }.into(),
        targets: targets! { Rotor(r):
            "speed_1" RotorSpeed optional r.speed_rad_s[0];
            "speed_2" RotorSpeed optional r.speed_rad_s[1];
            "speed_3" RotorSpeed optional r.speed_rad_s[2];
            "speed_4" RotorSpeed optional r.speed_rad_s[3];
        },
    },
];
