use bench_device::{PositionSample, Time};

use crate::{
    Battery, Command, ControlState, Event, Motion, ReadbackAt, Record, Rotor, Tick, Truth,
    proto::descriptor_set,
};

/// One series of a recording; every [`Record`] belongs to one. What is written for viewers ([`crate::ViewerChannel`]) is none of
/// them: it is never read back.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Channel {
    /// `/tracker/position`
    Position,
    /// `/airframe/motion`
    Motion,
    /// `/control/state`
    ControlState,
    /// `/control/command`
    Command,
    /// `/dac/readback`
    Readback,
    /// `/plant/truth`
    Truth,
    /// `/loop/tick`
    Tick,
    /// `/bench/event`
    Event,
    /// `/battery`
    Battery,
    /// `/rotor`
    Rotor,
}

/// Name and descriptor set of a protobuf message.
#[derive(Clone, Copy)]
pub(crate) struct Schema {
    pub name: &'static str,
    pub descriptor_set: &'static [u8],
}

macro_rules! schema {
    ($name:literal, $stem:literal) => {
        Schema { name: $name, descriptor_set: descriptor_set!($stem) }
    };
}

impl Channel {
    /// All channels, in the order of their declaration.
    pub const ALL: [Self; 10] = [
        Self::Position,
        Self::Motion,
        Self::ControlState,
        Self::Command,
        Self::Readback,
        Self::Truth,
        Self::Tick,
        Self::Event,
        Self::Battery,
        Self::Rotor,
    ];

    /// The MCAP topic.
    pub const fn topic(self) -> &'static str {
        match self {
            Self::Position => "/tracker/position",
            Self::Motion => "/airframe/motion",
            Self::ControlState => "/control/state",
            Self::Command => "/control/command",
            Self::Readback => "/dac/readback",
            Self::Truth => "/plant/truth",
            Self::Tick => "/loop/tick",
            Self::Event => "/bench/event",
            Self::Battery => "/battery",
            Self::Rotor => "/rotor",
        }
    }

    /// The channel of a topic; `None` for topics that hold no [`Record`].
    pub fn from_topic(topic: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|channel| channel.topic() == topic)
    }

    pub(crate) const fn schema(self) -> Schema {
        match self {
            Self::Position => schema!("bench.v1.Position", "position"),
            Self::Motion => schema!("bench.v1.Motion", "motion"),
            Self::ControlState => schema!("bench.v1.ControlState", "control_state"),
            Self::Command => schema!("bench.v1.Command", "command"),
            Self::Readback => schema!("bench.v1.Readback", "readback"),
            Self::Truth => schema!("bench.v1.Truth", "truth"),
            Self::Tick => schema!("bench.v1.Tick", "tick"),
            Self::Event => schema!("foxglove.Log", "Log"),
            Self::Battery => schema!("bench.v1.Battery", "battery"),
            Self::Rotor => schema!("bench.v1.Rotor", "rotor"),
        }
    }
}

impl Record {
    /// The channel that it belongs to.
    pub const fn channel(&self) -> Channel {
        match self {
            Self::Position(_) => Channel::Position,
            Self::Motion(_) => Channel::Motion,
            Self::ControlState(_) => Channel::ControlState,
            Self::Command(_) => Channel::Command,
            Self::Readback(_) => Channel::Readback,
            Self::Truth(_) => Channel::Truth,
            Self::Tick(_) => Channel::Tick,
            Self::Event(_) => Channel::Event,
            Self::Battery(_) => Channel::Battery,
            Self::Rotor(_) => Channel::Rotor,
        }
    }

    /// When it reached the loop: its own time; of a position the arrival, of a tick the start.
    pub const fn time(&self) -> Time {
        match self {
            Self::Position(position) => position.arrived_at,
            Self::Motion(motion) => motion.time,
            Self::ControlState(state) => state.time,
            Self::Command(command) => command.time,
            Self::Readback(readback) => readback.time,
            Self::Truth(truth) => truth.time,
            Self::Tick(tick) => tick.started,
            Self::Event(event) => event.time,
            Self::Battery(battery) => battery.time,
            Self::Rotor(rotor) => rotor.time,
        }
    }
}

macro_rules! into_record {
    ($($payload:ty => $variant:ident),+ $(,)?) => {
        $(impl From<$payload> for Record {
            fn from(payload: $payload) -> Self {
                Self::$variant(payload)
            }
        })+
    };
}

into_record! {
    PositionSample => Position,
    Motion => Motion,
    ControlState => ControlState,
    Command => Command,
    ReadbackAt => Readback,
    Truth => Truth,
    Tick => Tick,
    Event => Event,
    Battery => Battery,
    Rotor => Rotor,
}
