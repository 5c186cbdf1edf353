//! Between [`Record`]s and protobuf.

use arrayvec::ArrayString;
use bench_device::{Faults, PositionSample, Readback, Sticks, Time, TrackStatus};
use bench_rig::Phase;
use prost::Message;
use prost_types::Timestamp;

use crate::{
    Battery, Channel, Command, ControlState, Event, EventText, Level, Motion, ReadbackAt, Record, Rotor,
    Tick, Truth,
    fields::{FieldReader, Fields},
    proto::{bench as pb, foxglove},
};

/// Name under which events are logged.
const LOG_NAME: &str = "bench";

/// Appends the record as protobuf, with numbers of single precision if wanted. Events alone have the log time in them, which counts from
/// the epoch.
pub(crate) fn encode(record: &Record, epoch_ns: u64, single: bool, out: &mut Vec<u8>) {
    let mut fields = Fields { out, single };
    match record {
        Record::Position(position) => encode_position(position, &mut fields),
        Record::Motion(motion) => encode_motion(motion, &mut fields),
        Record::ControlState(state) => encode_control_state(state, &mut fields),
        Record::Command(command) => encode_command(command, &mut fields),
        Record::Readback(readback) => encode_readback(readback, &mut fields),
        Record::Truth(truth) => encode_truth(truth, &mut fields),
        Record::Tick(tick) => encode_tick(tick, &mut fields),
        Record::Event(event) => encode_event(event, epoch_ns, &mut fields),
        Record::Battery(battery) => encode_battery(battery, &mut fields),
        Record::Rotor(rotor) => encode_rotor(rotor, &mut fields),
    }
}

/// Reads what [`encode`] wrote, or another writer by the same schema; the error says what is wrong with the bytes.
pub(crate) fn decode(channel: Channel, epoch_ns: u64, data: &[u8]) -> Result<Record, String> {
    let mut record = match decode_own_layout(channel, data) {
        Some(record) => record,
        None => decode_any_layout(channel, data)?,
    };
    if let Record::Event(event) = &mut record {
        let since_ns = event.time.nanos().checked_sub(epoch_ns);
        event.time = since_ns.map(Time::from_nanos).ok_or("timestamp before the recording's origin")?;
    }
    Ok(record)
}

/// The log time of an instant of the recording.
pub(crate) fn since_epoch(time: Time, epoch_ns: u64) -> Time {
    Time::from_nanos(time.nanos().saturating_add(epoch_ns))
}

/// Reads a message whose fields lie as [`encode`] puts them; `None` for any other one.
fn decode_own_layout(channel: Channel, data: &[u8]) -> Option<Record> {
    let mut fields = FieldReader(data);
    let record = match channel {
        Channel::Position => read_position(&mut fields)?.into(),
        Channel::Motion => read_motion(&mut fields)?.into(),
        Channel::ControlState => read_control_state(&mut fields)?.into(),
        Channel::Command => Command { time: fields.time(1)?, sticks: fields.sticks(2)? }.into(),
        Channel::Readback => read_readback(&mut fields)?.into(),
        Channel::Truth => read_truth(&mut fields)?.into(),
        Channel::Tick => read_tick(&mut fields)?.into(),
        // Events are few, and their texts want the checks of the general decoder.
        Channel::Event => return None,
        Channel::Battery => {
            let time = fields.time(1)?;
            Battery { time, voltage_v: fields.double(2)?, current_a: fields.measured(3)? }.into()
        }
        Channel::Rotor => read_rotor(&mut fields)?.into(),
    };
    fields.end()?;
    Some(record)
}

fn decode_any_layout(channel: Channel, data: &[u8]) -> Result<Record, String> {
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

fn time(timestamp: Option<Timestamp>) -> Result<Time, String> {
    let Timestamp { seconds, nanos } = timestamp.unwrap_or_default();
    u64::try_from(i128::from(seconds) * 1_000_000_000 + i128::from(nanos))
        .map(Time::from_nanos)
        .map_err(|_| format!("timestamp {seconds} s {nanos} ns is out of range"))
}

// Protobuf leaves out a message whose fields are all zero in some writers; absent reads as zero, as for any field.
fn vector(v: Option<pb::Vector3>) -> [f64; 3] {
    v.map_or([0.0; 3], |v| [v.x, v.y, v.z])
}

fn sticks(sticks: Option<pb::Sticks>) -> Sticks {
    let pb::Sticks { throttle, pitch, roll, yaw } = sticks.unwrap_or_default();
    Sticks { throttle, pitch, roll, yaw }
}

fn encode_position(position: &PositionSample, fields: &mut Fields) {
    let status = match position.status {
        TrackStatus::Found => pb::TrackStatus::Found,
        TrackStatus::Lost => pb::TrackStatus::Lost,
        TrackStatus::Ambiguous => pb::TrackStatus::Ambiguous,
    };
    fields.integer(1, position.exposed_at.nanos());
    fields.integer(2, position.arrived_at.nanos());
    fields.doubles(3, position.position_m);
    fields.measured(4, position.heading_rad);
    fields.doubles(5, position.pixel);
    fields.double(6, position.size_px);
    fields.enumeration(7, status.into());
}

fn read_position(fields: &mut FieldReader) -> Option<PositionSample> {
    Some(PositionSample {
        exposed_at: fields.time(1)?,
        arrived_at: fields.time(2)?,
        position_m: fields.doubles(3)?,
        heading_rad: fields.measured(4)?,
        pixel: fields.doubles(5)?,
        size_px: fields.double(6)?,
        status: status(fields.enumeration(7)?)?,
    })
}

/// `None` for what is no status.
fn status(status: pb::TrackStatus) -> Option<TrackStatus> {
    match status {
        pb::TrackStatus::Found => Some(TrackStatus::Found),
        pb::TrackStatus::Lost => Some(TrackStatus::Lost),
        pb::TrackStatus::Ambiguous => Some(TrackStatus::Ambiguous),
        pb::TrackStatus::Unspecified => None,
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
            status: status(position.status()).ok_or_else(|| format!("status {}", position.status))?,
        })
    }
}

fn encode_motion(motion: &Motion, fields: &mut Fields) {
    fields.integer(1, motion.time.nanos());
    fields.all_measured(2, motion.velocity_m_s);
    fields.measured(3, motion.vertical_acceleration_m_s2);
    fields.all_measured(4, motion.attitude_rad);
}

fn read_motion(fields: &mut FieldReader) -> Option<Motion> {
    Some(Motion {
        time: fields.time(1)?,
        velocity_m_s: fields.all_measured(2)?,
        vertical_acceleration_m_s2: fields.measured(3)?,
        attitude_rad: fields.all_measured(4)?,
    })
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

fn encode_control_state(state: &ControlState, fields: &mut Fields) {
    let phase = match state.phase {
        Phase::Idle => pb::Phase::Idle,
        Phase::Launch => pb::Phase::Launch,
        Phase::Open => pb::Phase::Open,
        Phase::Hold => pb::Phase::Hold,
        Phase::Land => pb::Phase::Land,
        Phase::Abort => pb::Phase::Abort,
    };
    fields.integer(1, state.time.nanos());
    fields.enumeration(2, phase.into());
    fields.doubles(3, state.setpoint_m);
    fields.double(4, state.setpoint_heading_rad);
    fields.doubles(5, state.estimate_m);
    fields.doubles(6, state.estimate_m_s);
    fields.double(7, state.vertical_speed_setpoint_m_s);
    fields.double(8, state.vertical_speed_error_m_s);
    fields.double(9, state.integral_n);
    fields.double(10, state.thrust_n);
}

fn read_control_state(fields: &mut FieldReader) -> Option<ControlState> {
    Some(ControlState {
        time: fields.time(1)?,
        phase: phase(fields.enumeration(2)?)?,
        setpoint_m: fields.doubles(3)?,
        setpoint_heading_rad: fields.double(4)?,
        estimate_m: fields.doubles(5)?,
        estimate_m_s: fields.doubles(6)?,
        vertical_speed_setpoint_m_s: fields.double(7)?,
        vertical_speed_error_m_s: fields.double(8)?,
        integral_n: fields.double(9)?,
        thrust_n: fields.double(10)?,
    })
}

/// `None` for what is no phase.
fn phase(phase: pb::Phase) -> Option<Phase> {
    match phase {
        pb::Phase::Idle => Some(Phase::Idle),
        pb::Phase::Launch => Some(Phase::Launch),
        pb::Phase::Open => Some(Phase::Open),
        pb::Phase::Hold => Some(Phase::Hold),
        pb::Phase::Land => Some(Phase::Land),
        pb::Phase::Abort => Some(Phase::Abort),
        pb::Phase::Unspecified => None,
    }
}

impl TryFrom<pb::ControlState> for ControlState {
    type Error = String;

    fn try_from(state: pb::ControlState) -> Result<Self, String> {
        Ok(Self {
            time: Time::from_nanos(state.time_ns),
            phase: phase(state.phase()).ok_or_else(|| format!("phase {}", state.phase))?,
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

fn encode_command(command: &Command, fields: &mut Fields) {
    fields.integer(1, command.time.nanos());
    fields.sticks(2, command.sticks);
}

impl From<pb::Command> for Command {
    fn from(command: pb::Command) -> Self {
        Self { time: Time::from_nanos(command.time_ns), sticks: sticks(command.sticks) }
    }
}

fn encode_readback(&ReadbackAt { time, readback }: &ReadbackAt, fields: &mut Fields) {
    let Faults { watchdog, clamped, mismatch, brown_out } = readback.faults;
    fields.integer(1, time.nanos());
    fields.integer(2, readback.device_time.nanos());
    fields.sticks(3, readback.sticks);
    fields.message(4, |faults| {
        faults.integer(1, watchdog.into());
        faults.integer(2, clamped.into());
        faults.integer(3, mismatch.into());
        faults.integer(4, brown_out.into());
    });
}

fn read_readback(fields: &mut FieldReader) -> Option<ReadbackAt> {
    let time = fields.time(1)?;
    let (device_time, sticks) = (fields.time(2)?, fields.sticks(3)?);
    let mut message = fields.message(4)?;
    let faults = Faults {
        watchdog: message.flag(1)?,
        clamped: message.flag(2)?,
        mismatch: message.flag(3)?,
        brown_out: message.flag(4)?,
    };
    message.end()?;
    Some(ReadbackAt { time, readback: Readback { device_time, sticks, faults } })
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

fn encode_truth(truth: &Truth, fields: &mut Fields) {
    fields.integer(1, truth.time.nanos());
    fields.doubles(2, truth.position_m);
    fields.doubles(3, truth.velocity_m_s);
    fields.doubles(4, truth.attitude);
    fields.doubles(5, truth.body_rate_rad_s);
    fields.double(6, truth.thrust_n);
    fields.double(7, truth.rotor_speed_ratio);
    fields.double(8, truth.charge_hover_min);
}

fn read_truth(fields: &mut FieldReader) -> Option<Truth> {
    Some(Truth {
        time: fields.time(1)?,
        position_m: fields.doubles(2)?,
        velocity_m_s: fields.doubles(3)?,
        attitude: fields.doubles(4)?,
        body_rate_rad_s: fields.doubles(5)?,
        thrust_n: fields.double(6)?,
        rotor_speed_ratio: fields.double(7)?,
        charge_hover_min: fields.double(8)?,
    })
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

fn encode_tick(tick: &Tick, fields: &mut Fields) {
    fields.integer(1, tick.index);
    fields.integer(2, tick.scheduled.nanos());
    fields.integer(3, tick.started.nanos());
    fields.double(4, tick.started.since_s(tick.scheduled));
    fields.double(5, tick.sense_s);
    fields.double(6, tick.control_s);
    fields.double(7, tick.actuate_s);
    fields.integer(8, tick.overrun.into());
}

fn read_tick(fields: &mut FieldReader) -> Option<Tick> {
    let (index, scheduled, started) = (fields.integer(1)?, fields.time(2)?, fields.time(3)?);
    // The lateness is made of the two before it.
    fields.double(4)?;
    Some(Tick {
        index,
        scheduled,
        started,
        sense_s: fields.double(5)?,
        control_s: fields.double(6)?,
        actuate_s: fields.double(7)?,
        overrun: fields.flag(8)?,
    })
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

fn encode_event(event: &Event, epoch_ns: u64, fields: &mut Fields) {
    let level = match event.level {
        Level::Info => foxglove::log::Level::Info,
        Level::Warning => foxglove::log::Level::Warning,
        Level::Error => foxglove::log::Level::Error,
    };
    fields.timestamp(1, since_epoch(event.time, epoch_ns));
    fields.enumeration(2, level.into());
    fields.text(3, &event.text);
    fields.text(4, LOG_NAME);
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

fn encode_battery(battery: &Battery, fields: &mut Fields) {
    fields.integer(1, battery.time.nanos());
    fields.double(2, battery.voltage_v);
    fields.measured(3, battery.current_a);
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

fn encode_rotor(rotor: &Rotor, fields: &mut Fields) {
    fields.integer(1, rotor.time.nanos());
    for (number, speed_rad_s) in (2..).zip(rotor.speed_rad_s) {
        fields.measured(number, speed_rad_s);
    }
}

fn read_rotor(fields: &mut FieldReader) -> Option<Rotor> {
    let mut rotor = Rotor { time: fields.time(1)?, ..Rotor::default() };
    for (number, speed_rad_s) in (2..).zip(&mut rotor.speed_rad_s) {
        *speed_rad_s = fields.measured(number)?;
    }
    Some(rotor)
}

impl From<pb::Rotor> for Rotor {
    fn from(rotor: pb::Rotor) -> Self {
        Self {
            time: Time::from_nanos(rotor.time_ns),
            speed_rad_s: [rotor.speed_1_rad_s, rotor.speed_2_rad_s, rotor.speed_3_rad_s, rotor.speed_4_rad_s],
        }
    }
}

#[cfg(test)]
mod tests {
    use std::fmt::Debug;

    use bench_device::{Faults, PositionSample, Readback, Sticks, Time, TrackStatus};
    use bench_rig::{ControlState, Phase};
    use proptest::prelude::*;
    use prost::Message;

    use super::{decode, encode};
    use crate::{
        Battery, Channel, Command, Event, EventText, Level, Motion, ReadbackAt, Record, Rotor, Tick, Truth,
        proto::{bench as pb, foxglove},
    };

    /// What prost makes of the bytes, and of the message that it reads in them.
    fn reencoded<M: Message + Default>(bytes: &[u8]) -> Vec<u8> {
        M::decode(bytes).unwrap().encode_to_vec()
    }

    fn by_prost(channel: Channel, bytes: &[u8]) -> Vec<u8> {
        match channel {
            Channel::Position => reencoded::<pb::Position>(bytes),
            Channel::Motion => reencoded::<pb::Motion>(bytes),
            Channel::ControlState => reencoded::<pb::ControlState>(bytes),
            Channel::Command => reencoded::<pb::Command>(bytes),
            Channel::Readback => reencoded::<pb::Readback>(bytes),
            Channel::Truth => reencoded::<pb::Truth>(bytes),
            Channel::Tick => reencoded::<pb::Tick>(bytes),
            Channel::Event => reencoded::<foxglove::Log>(bytes),
            Channel::Battery => reencoded::<pb::Battery>(bytes),
            Channel::Rotor => reencoded::<pb::Rotor>(bytes),
        }
    }

    /// Records of every kind, made of the numbers given in turn.
    fn records(numbers: &[f64], integers: &[u64], flags: &[bool], text: &str) -> Vec<Record> {
        let (mut n, mut i, mut f) = (numbers.iter().cycle(), integers.iter().cycle(), flags.iter().cycle());
        let mut x = || *n.next().unwrap();
        let mut count = || *i.next().unwrap();
        let mut flag = || *f.next().unwrap();
        let level = [Level::Info, Level::Warning, Level::Error][count() as usize % 3];
        let phases = [Phase::Idle, Phase::Launch, Phase::Open, Phase::Hold, Phase::Land, Phase::Abort];
        let phase = phases[count() as usize % 6];
        let statuses = [TrackStatus::Found, TrackStatus::Lost, TrackStatus::Ambiguous];
        let status = statuses[count() as usize % 3];
        let sticks = Sticks { throttle: x(), pitch: x(), roll: x(), yaw: x() };
        let [time, other] = [count(), count()].map(Time::from_nanos);
        let mut maybe = || flag().then(&mut x);
        let position = PositionSample {
            exposed_at: other,
            arrived_at: time,
            position_m: [numbers[0]; 3],
            heading_rad: maybe(),
            pixel: [numbers[1], 0.0],
            size_px: numbers[2],
            status,
        };
        let motion = Motion {
            time,
            velocity_m_s: [maybe(), maybe(), maybe()],
            vertical_acceleration_m_s2: maybe(),
            attitude_rad: [maybe(), maybe(), maybe()],
        };
        let battery = Battery { time, voltage_v: numbers[0], current_a: maybe() };
        let rotor = Rotor { time, speed_rad_s: [maybe(), maybe(), maybe(), maybe()] };
        let state = ControlState {
            time,
            phase,
            setpoint_m: [x(), x(), x()],
            setpoint_heading_rad: x(),
            estimate_m: [x(), x(), x()],
            estimate_m_s: [x(), x(), x()],
            vertical_speed_setpoint_m_s: x(),
            vertical_speed_error_m_s: x(),
            integral_n: x(),
            thrust_n: x(),
        };
        let truth = Truth {
            time,
            position_m: [x(), x(), x()],
            velocity_m_s: [x(), x(), x()],
            attitude: [x(), x(), x(), x()],
            body_rate_rad_s: [x(), x(), x()],
            thrust_n: x(),
            rotor_speed_ratio: x(),
            charge_hover_min: x(),
        };
        let faults = Faults { watchdog: flag(), clamped: flag(), mismatch: flag(), brown_out: flag() };
        let tick = Tick {
            index: count(),
            scheduled: other,
            started: time,
            sense_s: x(),
            control_s: x(),
            actuate_s: x(),
            overrun: flag(),
        };
        let text = super::event_text(text);
        vec![
            position.into(),
            motion.into(),
            state.into(),
            Command { time, sticks }.into(),
            ReadbackAt { time, readback: Readback { device_time: other, sticks, faults } }.into(),
            truth.into(),
            tick.into(),
            Event { time, level, text }.into(),
            battery.into(),
            rotor.into(),
        ]
    }

    fn integers() -> impl Strategy<Value = Vec<u64>> {
        // Varints of every length.
        prop::collection::vec((any::<u64>(), 0..64_u32).prop_map(|(value, shift)| value >> shift), 8)
    }

    fn numbers() -> impl Strategy<Value = Vec<f64>> {
        use prop::num::f64::{INFINITE, NORMAL, SUBNORMAL, ZERO};
        prop::collection::vec(NORMAL | ZERO | SUBNORMAL | INFINITE, 7)
    }

    fn same(a: &impl Debug, b: &impl Debug) -> bool {
        format!("{a:?}") == format!("{b:?}")
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn messages_are_those_of_a_general_encoder(
            numbers in numbers(),
            integers in integers(),
            flags in prop::collection::vec(any::<bool>(), 5),
            text in ".{0,40}",
        ) {
            for record in records(&numbers, &integers, &flags, &text) {
                let channel = record.channel();
                let mut bytes = Vec::new();
                encode(&record, 0, false, &mut bytes);
                prop_assert_eq!(&by_prost(channel, &bytes), &bytes, "{:?}", record);
                prop_assert_eq!(decode(channel, 0, &bytes), Ok(record));
                prop_assert_eq!(super::decode_any_layout(channel, &bytes), Ok(record));
                let own = super::decode_own_layout(channel, &bytes);
                prop_assert!(own.is_none_or(|own| own == record), "{:?}", own);
            }
        }
    }

    #[test]
    fn usual_messages_need_no_general_decoder() {
        for record in records(&[1.5, 0.0, -2.0], &[7, 0, 1 << 60], &[true, false, true], "text") {
            let channel = record.channel();
            let mut bytes = Vec::new();
            encode(&record, 0, false, &mut bytes);
            let expected = (channel != Channel::Event).then_some(record);
            assert_eq!(super::decode_own_layout(channel, &bytes), expected);
        }
    }

    /// Another writer may put fields in another order or add some, and a damaged message is an error.
    #[test]
    fn other_layouts_are_read_by_the_general_decoder() {
        let battery = Battery { time: Time::from_nanos(300), voltage_v: 3.7, current_a: Some(0.5) };
        let mut bytes = Vec::new();
        encode(&battery.into(), 0, false, &mut bytes);
        let (time, rest) = bytes.split_at(3);
        let unknown = [10 << 3, 1];
        for other in [[rest, time].concat(), [&bytes[..], &unknown].concat(), [&unknown, &bytes[..]].concat()]
        {
            assert_eq!(super::decode_own_layout(Channel::Battery, &other), None);
            assert_eq!(decode(Channel::Battery, 0, &other), Ok(battery.into()));
        }
        assert!(decode(Channel::Battery, 0, &bytes[..bytes.len() - 1]).is_err());
        // A status and a phase that are none.
        for channel in [Channel::Position, Channel::ControlState] {
            assert!(decode(channel, 0, &[]).is_err(), "{channel:?}");
        }
    }

    #[test]
    fn what_is_not_a_number_stays_so_and_the_longest_event_fits() {
        let text = EventText::from(&"ü".repeat(59)).unwrap();
        let time = Time::from_nanos(u64::MAX);
        for record in [
            Record::from(Battery { time, voltage_v: f64::NAN, current_a: Some(f64::NAN) }),
            Event { time, level: Level::Error, text }.into(),
        ] {
            let mut bytes = Vec::new();
            encode(&record, 0, false, &mut bytes);
            assert!(same(&decode(record.channel(), 0, &bytes).unwrap(), &record));
        }
    }
}
