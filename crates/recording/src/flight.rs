use std::path::Path;

use bench_device::{PositionSample, Time};
use bench_rig::Phase;

use crate::{
    Battery, Channel, Command, ControlState, Event, Motion, ReadbackAt, Record, Recording, RecordingError,
    Rotor, Session, Tick, Truth,
};

/// A whole recording in memory: one series a channel, each sorted by [`Record::time`].
#[derive(Clone, Debug)]
pub struct Flight {
    /// What was known before the first message.
    pub session: Session,
    /// Positions, by arrival.
    pub positions: Vec<PositionSample>,
    /// Motion measured on board.
    pub motion: Vec<Motion>,
    /// The controller's inner values.
    pub states: Vec<ControlState>,
    /// What the controller asked for.
    pub commands: Vec<Command>,
    /// The outputs as measured.
    pub readbacks: Vec<ReadbackAt>,
    /// The simulated airframe as it was.
    pub truth: Vec<Truth>,
    /// The loop's iterations, by start.
    pub ticks: Vec<Tick>,
    /// What was worth telling.
    pub events: Vec<Event>,
    /// The battery.
    pub battery: Vec<Battery>,
    /// The rotors.
    pub rotor: Vec<Rotor>,
    /// Channels whose records did not stand in order of time, with how many came after a later one. They were sorted,
    /// none was left out.
    pub out_of_order: Vec<(Channel, u64)>,
}

/// A phase and when it lasted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PhaseInterval {
    /// What the controller was doing.
    pub phase: Phase,
    /// The first state of the phase.
    pub from: Time,
    /// The first state of the next phase, or the last state of the recording.
    pub to: Time,
}

impl Flight {
    /// Reads a closed recording.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, RecordingError> {
        Self::from_recording(&Recording::open(path)?)
    }

    /// Reads all of a recording.
    pub fn from_recording(recording: &Recording) -> Result<Self, RecordingError> {
        let mut flight = Self::new(recording.session().clone());
        for record in recording.records()? {
            flight.push(record?);
        }
        flight.sort();
        Ok(flight)
    }

    /// From records that are in memory already, in any order.
    pub fn from_records(session: Session, records: impl IntoIterator<Item = Record>) -> Self {
        let mut flight = Self::new(session);
        for record in records {
            flight.push(record);
        }
        flight.sort();
        flight
    }

    /// The command that held at an instant (zero-order hold); `None` before the first one.
    pub fn command_at(&self, time: Time) -> Option<&Command> {
        latest(&self.commands, |command| command.time, time)
    }

    /// The controller's phases one after another.
    pub fn phases(&self) -> Vec<PhaseInterval> {
        let mut phases: Vec<PhaseInterval> = Vec::new();
        for state in &self.states {
            if let Some(open) = phases.last_mut() {
                open.to = state.time;
            }
            if phases.last().is_none_or(|open| open.phase != state.phase) {
                phases.push(PhaseInterval { phase: state.phase, from: state.time, to: state.time });
            }
        }
        phases
    }

    /// The rig file's text.
    pub fn rig_toml(&self) -> Option<&str> {
        self.session.rig_toml.as_deref()
    }

    /// The mission file's text.
    pub fn mission_toml(&self) -> Option<&str> {
        self.session.mission_toml.as_deref()
    }

    fn new(session: Session) -> Self {
        Self {
            session,
            positions: Vec::new(),
            motion: Vec::new(),
            states: Vec::new(),
            commands: Vec::new(),
            readbacks: Vec::new(),
            truth: Vec::new(),
            ticks: Vec::new(),
            events: Vec::new(),
            battery: Vec::new(),
            rotor: Vec::new(),
            out_of_order: Vec::new(),
        }
    }

    fn push(&mut self, record: Record) {
        match record {
            Record::Position(position) => self.positions.push(position),
            Record::Motion(motion) => self.motion.push(motion),
            Record::ControlState(state) => self.states.push(state),
            Record::Command(command) => self.commands.push(command),
            Record::Readback(readback) => self.readbacks.push(readback),
            Record::Truth(truth) => self.truth.push(truth),
            Record::Tick(tick) => self.ticks.push(tick),
            Record::Event(event) => self.events.push(event),
            Record::Battery(battery) => self.battery.push(battery),
            Record::Rotor(rotor) => self.rotor.push(rotor),
        }
    }

    fn sort(&mut self) {
        let counts = [
            (Channel::Position, sort_by_time(&mut self.positions)),
            (Channel::Motion, sort_by_time(&mut self.motion)),
            (Channel::ControlState, sort_by_time(&mut self.states)),
            (Channel::Command, sort_by_time(&mut self.commands)),
            (Channel::Readback, sort_by_time(&mut self.readbacks)),
            (Channel::Truth, sort_by_time(&mut self.truth)),
            (Channel::Tick, sort_by_time(&mut self.ticks)),
            (Channel::Event, sort_by_time(&mut self.events)),
            (Channel::Battery, sort_by_time(&mut self.battery)),
            (Channel::Rotor, sort_by_time(&mut self.rotor)),
        ];
        self.out_of_order = counts.into_iter().filter(|(_, count)| *count > 0).collect();
    }
}

/// Sorts by time, keeping the order of equals; returns how many stood after a later one.
fn sort_by_time<T: Copy + Into<Record>>(series: &mut [T]) -> u64 {
    let mut latest = Time::ZERO;
    let mut late = 0;
    for item in series.iter() {
        let time = (*item).into().time();
        late += u64::from(time < latest);
        latest = latest.max(time);
    }
    if late > 0 {
        series.sort_by_key(|item| (*item).into().time());
    }
    late
}

/// The last item not after an instant.
pub(crate) fn latest<T>(series: &[T], time_of: impl Fn(&T) -> Time, time: Time) -> Option<&T> {
    let after = series.partition_point(|item| time_of(item) <= time);
    series[..after].last()
}

/// The first item from an instant on and before another.
pub(crate) fn within<T>(series: &[T], time_of: impl Fn(&T) -> Time, from: Time, to: Time) -> Option<&T> {
    let first = series.partition_point(|item| time_of(item) < from);
    series.get(first).filter(|item| time_of(item) < to)
}
