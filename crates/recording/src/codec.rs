//! Between [`Record`]s and protobuf.

use arrayvec::ArrayString;
use bench_device::{Faults, PositionSample, Readback, Sticks, Time, TrackStatus};
use bench_rig::Phase;
use prost::Message;
use prost_types::Timestamp;

use crate::{
    Battery, Channel, Command, ControlState, Event, EventText, Level, Motion, ReadbackAt, Record, Rotor,
    Tick, Truth,
    proto::{bench as pb, foxglove},
};

/// Name under which events are logged.
const LOG_NAME: &str = "bench";

/// Appends the record as protobuf.
pub(crate) fn encode(record: &Record, out: &mut Vec<u8>) {
    match record {
        Record::Position(position) => pb::Position::from(position).encode_raw(out),
        Record::Motion(motion) => pb::Motion::from(motion).encode_raw(out),
        Record::ControlState(state) => pb::ControlState::from(state).encode_raw(out),
        Record::Command(command) => pb::Command::from(command).encode_raw(out),
        Record::Readback(readback) => pb::Readback::from(readback).encode_raw(out),
        Record::Truth(truth) => pb::Truth::from(truth).encode_raw(out),
        Record::Tick(tick) => pb::Tick::from(tick).encode_raw(out),
        Record::Event(event) => foxglove::Log::from(event).encode_raw(out),
        Record::Battery(battery) => pb::Battery::from(battery).encode_raw(out),
        Record::Rotor(rotor) => pb::Rotor::from(rotor).encode_raw(out),
    }
}

/// Reads what [`encode`] wrote; the error says what is wrong with the bytes.
pub(crate) fn decode(channel: Channel, data: &[u8]) -> Result<Record, String> {
    Ok(match channel {
        Channel::Position => PositionSample::try_from(parse::<pb::Position>(data)?)?.into(),
        Channel::Motion => Motion::from(parse::<pb::Motion>(data)?).into(),
        Channel::ControlState => ControlState::try_from(parse::<pb::ControlState>(data)?)?.into(),
        Channel::Command => Command::from(parse::<pb::Command>(data)?).into(),
        Channel::Readback => ReadbackAt::from(parse::<pb::Readback>(data)?).into(),
        Channel::Truth => Truth::from(parse::<pb::Truth>(data)?).into(),
        Channel::Tick => Tick::from(parse::<pb::Tick>(data)?).into(),
        Channel::Event => Event::try_from(parse::<foxglove::Log>(data)?)?.into(),
        Channel::Battery => Battery::from(parse::<pb::Battery>(data)?).into(),
        Channel::Rotor => Rotor::from(parse::<pb::Rotor>(data)?).into(),
    })
}

fn parse<M: Message + Default>(data: &[u8]) -> Result<M, String> {
    M::decode(data).map_err(|error| error.to_string())
}

/// The pose that is written beside each truth; kept between messages so that its frame's name is made once.
pub(crate) struct PoseEncoder {
    pose: foxglove::PoseInFrame,
}

impl PoseEncoder {
    pub fn new() -> Self {
        Self { pose: foxglove::PoseInFrame { frame_id: "world".to_owned(), timestamp: None, pose: None } }
    }

    /// Appends the truth's pose as protobuf.
    pub fn encode(&mut self, truth: &Truth, out: &mut Vec<u8>) {
        let [x, y, z] = truth.position_m;
        let [qw, qx, qy, qz] = truth.attitude;
        self.pose.timestamp = Some(timestamp(truth.time));
        self.pose.pose = Some(foxglove::Pose {
            position: Some(foxglove::Vector3 { x, y, z }),
            orientation: Some(foxglove::Quaternion { x: qx, y: qy, z: qz, w: qw }),
        });
        self.pose.encode_raw(out);
    }
}

fn timestamp(time: Time) -> Timestamp {
    const NANOS: u64 = 1_000_000_000;
    // Nanoseconds in 64 bits are 584 years, so the seconds fit; the rest is below 1e9.
    Timestamp { seconds: (time.nanos() / NANOS).cast_signed(), nanos: (time.nanos() % NANOS) as i32 }
}

fn time(timestamp: Option<Timestamp>) -> Result<Time, String> {
    let Timestamp { seconds, nanos } = timestamp.unwrap_or_default();
    u64::try_from(i128::from(seconds) * 1_000_000_000 + i128::from(nanos))
        .map(Time::from_nanos)
        .map_err(|_| format!("timestamp {seconds} s {nanos} ns is out of range"))
}

impl From<[f64; 3]> for pb::Vector3 {
    fn from([x, y, z]: [f64; 3]) -> Self {
        Self { x, y, z }
    }
}

// Protobuf leaves out a message whose fields are all zero in some writers; absent reads as zero, as for any field.
fn vector(v: Option<pb::Vector3>) -> [f64; 3] {
    v.map_or([0.0; 3], |v| [v.x, v.y, v.z])
}

impl From<Sticks> for pb::Sticks {
    fn from(sticks: Sticks) -> Self {
        let Sticks { throttle, pitch, roll, yaw } = sticks;
        Self { throttle, pitch, roll, yaw }
    }
}

fn sticks(sticks: Option<pb::Sticks>) -> Sticks {
    let pb::Sticks { throttle, pitch, roll, yaw } = sticks.unwrap_or_default();
    Sticks { throttle, pitch, roll, yaw }
}

impl From<&PositionSample> for pb::Position {
    fn from(position: &PositionSample) -> Self {
        let status = match position.status {
            TrackStatus::Found => pb::TrackStatus::Found,
            TrackStatus::Lost => pb::TrackStatus::Lost,
            TrackStatus::Ambiguous => pb::TrackStatus::Ambiguous,
        };
        Self {
            exposed_at_ns: position.exposed_at.nanos(),
            arrived_at_ns: position.arrived_at.nanos(),
            position_m: Some(position.position_m.into()),
            heading_rad: position.heading_rad,
            pixel: Some(pb::Vector2 { x: position.pixel[0], y: position.pixel[1] }),
            size_px: position.size_px,
            status: status.into(),
        }
    }
}

impl TryFrom<pb::Position> for PositionSample {
    type Error = String;

    fn try_from(position: pb::Position) -> Result<Self, String> {
        Ok(Self {
            exposed_at: Time::from_nanos(position.exposed_at_ns),
            arrived_at: Time::from_nanos(position.arrived_at_ns),
            position_m: vector(position.position_m),
            heading_rad: position.heading_rad,
            pixel: position.pixel.map_or([0.0; 2], |pixel| [pixel.x, pixel.y]),
            size_px: position.size_px,
            status: match position.status() {
                pb::TrackStatus::Found => TrackStatus::Found,
                pb::TrackStatus::Lost => TrackStatus::Lost,
                pb::TrackStatus::Ambiguous => TrackStatus::Ambiguous,
                pb::TrackStatus::Unspecified => return Err(format!("status {}", position.status)),
            },
        })
    }
}

impl From<&Motion> for pb::Motion {
    fn from(motion: &Motion) -> Self {
        let [x, y, z] = motion.velocity_m_s;
        let [roll, pitch, yaw] = motion.attitude_rad;
        Self {
            time_ns: motion.time.nanos(),
            velocity_m_s: Some(pb::MaybeVector3 { x, y, z }),
            vertical_acceleration_m_s2: motion.vertical_acceleration_m_s2,
            attitude_rad: Some(pb::MaybeAttitude { roll, pitch, yaw }),
        }
    }
}

impl From<pb::Motion> for Motion {
    fn from(motion: pb::Motion) -> Self {
        Self {
            time: Time::from_nanos(motion.time_ns),
            velocity_m_s: motion.velocity_m_s.map_or([None; 3], |v| [v.x, v.y, v.z]),
            vertical_acceleration_m_s2: motion.vertical_acceleration_m_s2,
            attitude_rad: motion.attitude_rad.map_or([None; 3], |a| [a.roll, a.pitch, a.yaw]),
        }
    }
}

impl From<&ControlState> for pb::ControlState {
    fn from(state: &ControlState) -> Self {
        let phase = match state.phase {
            Phase::Idle => pb::Phase::Idle,
            Phase::Launch => pb::Phase::Launch,
            Phase::Open => pb::Phase::Open,
            Phase::Hold => pb::Phase::Hold,
            Phase::Land => pb::Phase::Land,
            Phase::Abort => pb::Phase::Abort,
        };
        Self {
            time_ns: state.time.nanos(),
            phase: phase.into(),
            setpoint_m: Some(state.setpoint_m.into()),
            setpoint_heading_rad: state.setpoint_heading_rad,
            estimate_m: Some(state.estimate_m.into()),
            estimate_m_s: Some(state.estimate_m_s.into()),
            vertical_speed_setpoint_m_s: state.vertical_speed_setpoint_m_s,
            vertical_speed_error_m_s: state.vertical_speed_error_m_s,
            integral_n: state.integral_n,
            thrust_n: state.thrust_n,
        }
    }
}

impl TryFrom<pb::ControlState> for ControlState {
    type Error = String;

    fn try_from(state: pb::ControlState) -> Result<Self, String> {
        Ok(Self {
            time: Time::from_nanos(state.time_ns),
            phase: match state.phase() {
                pb::Phase::Idle => Phase::Idle,
                pb::Phase::Launch => Phase::Launch,
                pb::Phase::Open => Phase::Open,
                pb::Phase::Hold => Phase::Hold,
                pb::Phase::Land => Phase::Land,
                pb::Phase::Abort => Phase::Abort,
                pb::Phase::Unspecified => return Err(format!("phase {}", state.phase)),
            },
            setpoint_m: vector(state.setpoint_m),
            setpoint_heading_rad: state.setpoint_heading_rad,
            estimate_m: vector(state.estimate_m),
            estimate_m_s: vector(state.estimate_m_s),
            vertical_speed_setpoint_m_s: state.vertical_speed_setpoint_m_s,
            vertical_speed_error_m_s: state.vertical_speed_error_m_s,
            integral_n: state.integral_n,
            thrust_n: state.thrust_n,
        })
    }
}

impl From<&Command> for pb::Command {
    fn from(command: &Command) -> Self {
        Self { time_ns: command.time.nanos(), sticks: Some(command.sticks.into()) }
    }
}

impl From<pb::Command> for Command {
    fn from(command: pb::Command) -> Self {
        Self { time: Time::from_nanos(command.time_ns), sticks: sticks(command.sticks) }
    }
}

impl From<&ReadbackAt> for pb::Readback {
    fn from(&ReadbackAt { time, readback }: &ReadbackAt) -> Self {
        let Faults { watchdog, clamped, mismatch, brown_out } = readback.faults;
        Self {
            time_ns: time.nanos(),
            device_time_ns: readback.device_time.nanos(),
            sticks: Some(readback.sticks.into()),
            faults: Some(pb::Faults { watchdog, clamped, mismatch, brown_out }),
        }
    }
}

impl From<pb::Readback> for ReadbackAt {
    fn from(readback: pb::Readback) -> Self {
        let pb::Faults { watchdog, clamped, mismatch, brown_out } = readback.faults.unwrap_or_default();
        Self {
            time: Time::from_nanos(readback.time_ns),
            readback: Readback {
                device_time: Time::from_nanos(readback.device_time_ns),
                sticks: sticks(readback.sticks),
                faults: Faults { watchdog, clamped, mismatch, brown_out },
            },
        }
    }
}

impl From<&Truth> for pb::Truth {
    fn from(truth: &Truth) -> Self {
        let [w, x, y, z] = truth.attitude;
        Self {
            time_ns: truth.time.nanos(),
            position_m: Some(truth.position_m.into()),
            velocity_m_s: Some(truth.velocity_m_s.into()),
            attitude: Some(pb::Quaternion { w, x, y, z }),
            body_rate_rad_s: Some(truth.body_rate_rad_s.into()),
            thrust_n: truth.thrust_n,
            rotor_speed_ratio: truth.rotor_speed_ratio,
            charge_hover_min: truth.charge_hover_min,
        }
    }
}

impl From<pb::Truth> for Truth {
    fn from(truth: pb::Truth) -> Self {
        Self {
            time: Time::from_nanos(truth.time_ns),
            position_m: vector(truth.position_m),
            velocity_m_s: vector(truth.velocity_m_s),
            attitude: truth.attitude.map_or([0.0; 4], |q| [q.w, q.x, q.y, q.z]),
            body_rate_rad_s: vector(truth.body_rate_rad_s),
            thrust_n: truth.thrust_n,
            rotor_speed_ratio: truth.rotor_speed_ratio,
            charge_hover_min: truth.charge_hover_min,
        }
    }
}

impl From<&Tick> for pb::Tick {
    fn from(tick: &Tick) -> Self {
        Self {
            index: tick.index,
            scheduled_ns: tick.scheduled.nanos(),
            started_ns: tick.started.nanos(),
            lateness_s: tick.started.since_s(tick.scheduled),
            sense_s: tick.sense_s,
            control_s: tick.control_s,
            actuate_s: tick.actuate_s,
            overrun: tick.overrun,
        }
    }
}

impl From<pb::Tick> for Tick {
    fn from(tick: pb::Tick) -> Self {
        Self {
            index: tick.index,
            scheduled: Time::from_nanos(tick.scheduled_ns),
            started: Time::from_nanos(tick.started_ns),
            sense_s: tick.sense_s,
            control_s: tick.control_s,
            actuate_s: tick.actuate_s,
            overrun: tick.overrun,
        }
    }
}

impl From<&Event> for foxglove::Log {
    fn from(event: &Event) -> Self {
        let level = match event.level {
            Level::Info => foxglove::log::Level::Info,
            Level::Warning => foxglove::log::Level::Warning,
            Level::Error => foxglove::log::Level::Error,
        };
        Self {
            timestamp: Some(timestamp(event.time)),
            level: level.into(),
            message: event.text.to_string(),
            name: LOG_NAME.to_owned(),
            file: String::new(),
            line: 0,
        }
    }
}

impl TryFrom<foxglove::Log> for Event {
    type Error = String;

    fn try_from(log: foxglove::Log) -> Result<Self, String> {
        Ok(Self {
            time: time(log.timestamp)?,
            level: match log.level() {
                foxglove::log::Level::Unknown | foxglove::log::Level::Debug | foxglove::log::Level::Info => {
                    Level::Info
                }
                foxglove::log::Level::Warning => Level::Warning,
                foxglove::log::Level::Error | foxglove::log::Level::Fatal => Level::Error,
            },
            text: event_text(&log.message),
        })
    }
}

/// As much of the text as an event holds, cut between characters.
fn event_text(text: &str) -> EventText {
    let mut held = ArrayString::new();
    for c in text.chars() {
        if held.try_push(c).is_err() {
            break;
        }
    }
    held
}

impl From<&Battery> for pb::Battery {
    fn from(battery: &Battery) -> Self {
        Self { time_ns: battery.time.nanos(), voltage_v: battery.voltage_v, current_a: battery.current_a }
    }
}

impl From<pb::Battery> for Battery {
    fn from(battery: pb::Battery) -> Self {
        Self {
            time: Time::from_nanos(battery.time_ns),
            voltage_v: battery.voltage_v,
            current_a: battery.current_a,
        }
    }
}

impl From<&Rotor> for pb::Rotor {
    fn from(rotor: &Rotor) -> Self {
        let [speed_1_rad_s, speed_2_rad_s, speed_3_rad_s, speed_4_rad_s] = rotor.speed_rad_s;
        Self { time_ns: rotor.time.nanos(), speed_1_rad_s, speed_2_rad_s, speed_3_rad_s, speed_4_rad_s }
    }
}

impl From<pb::Rotor> for Rotor {
    fn from(rotor: pb::Rotor) -> Self {
        Self {
            time: Time::from_nanos(rotor.time_ns),
            speed_rad_s: [rotor.speed_1_rad_s, rotor.speed_2_rad_s, rotor.speed_3_rad_s, rotor.speed_4_rad_s],
        }
    }
}
