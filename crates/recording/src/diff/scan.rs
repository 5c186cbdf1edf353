//! The first pass: what each field has, the phases, and the signals that clocks can be aligned by.

use std::{collections::BinaryHeap, path::Path};

use bench_device::{Time, TrackStatus};
use bench_rig::{Phase, Rig};

use super::{
    law::{Cell, Entry, Extractor, catalogue},
    series::Series,
};
use crate::{Channel, Field, Mode, Record, Recording, RecordingError, Session};

/// Phases beyond so many are not kept: no mission has them.
const PHASES_MAX: usize = 1000;
/// The longest disorder of a file that is put right on reading, ns.
const DISORDER_MAX_NS: i64 = 2_000_000_000;

/// Nanoseconds since the origin, signed; instants that do not fit (292 years on) are cut.
pub(super) fn nanos(time: Time) -> i64 {
    i64::try_from(time.nanos()).unwrap_or(i64::MAX)
}

/// The samples of one field.
#[derive(Clone, Debug, Default)]
pub(super) struct Seen {
    pub count: u64,
    pub unusable: u64,
    last_ns: i64,
    pub intervals: Intervals,
}

/// How long it takes from one sample to the next: a histogram with bins a quarter of an octave wide.
#[derive(Clone, Debug)]
pub(super) struct Intervals {
    /// Count and sum, ns.
    bins: [(u32, f64); Self::BINS],
    count: u64,
}

impl Default for Intervals {
    fn default() -> Self {
        Self { bins: [(0, 0.0); Self::BINS], count: 0 }
    }
}

impl Intervals {
    /// From 1 us to a quarter of an hour.
    const BINS: usize = 120;
    const SHORTEST_NS: f64 = 1e3;

    fn push(&mut self, interval: Interval) {
        if interval.ns > 0.0 {
            let (count, sum) = &mut self.bins[interval.bin];
            *count += 1;
            *sum += interval.ns;
            self.count += 1;
        }
    }

    /// The mean of the bin in which the quantile lies, ns: within a fifth of it. 0 without intervals.
    fn quantile_ns(&self, share: f64) -> f64 {
        let wanted = self.count as f64 * share;
        let mut seen = 0.0;
        for (count, sum) in self.bins {
            seen += f64::from(count);
            if count > 0 && seen >= wanted {
                return sum / f64::from(count);
            }
        }
        0.0
    }

    /// The usual time between samples, ns.
    pub fn usual_ns(&self) -> f64 {
        self.quantile_ns(0.5)
    }

    /// Samples further apart than this have a gap between them that nothing may be made of, ns: five times the usual
    /// interval, or half as much again as the 99 % longest where samples come irregularly, up to 10 s.
    pub fn gap_ns(&self) -> i64 {
        const LONGEST_NS: f64 = 1e10;
        (5.0 * self.quantile_ns(0.5)).max(1.5 * self.quantile_ns(0.99)).min(LONGEST_NS) as i64
    }
}

/// The time between two samples, and the bin that it belongs to.
#[derive(Clone, Copy, Debug)]
struct Interval {
    ns: f64,
    bin: usize,
}

impl Interval {
    fn between(from_ns: i64, until_ns: i64) -> Self {
        let ns = until_ns.saturating_sub(from_ns) as f64;
        Self { ns, bin: quarter_octaves(ns / Intervals::SHORTEST_NS).min(Intervals::BINS - 1) }
    }
}

/// The quarter octaves that lie between 1 and a number, 0 below 1: the exponent of it, and where its mantissa lies. A logarithm a
/// sample would cost as much as reading it.
fn quarter_octaves(x: f64) -> usize {
    const EDGES: [f64; 3] = [1.189_207_115_002_721, std::f64::consts::SQRT_2, 1.681_792_830_507_429];
    const MANTISSA: u64 = (1 << 52) - 1;
    if x < 1.0 {
        return 0;
    }
    let mantissa = f64::from_bits(x.to_bits() & MANTISSA | 1.0_f64.to_bits());
    let octaves = (x.to_bits() >> 52) as usize - 1023;
    4 * octaves + EDGES.iter().filter(|edge| mantissa >= **edge).count()
}

/// A signal that shows on both clocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Signal {
    Throttle,
    TrackedAltitude,
    TrueAltitude,
}

impl Signal {
    pub const ALL: [Self; 3] = [Self::Throttle, Self::TrackedAltitude, Self::TrueAltitude];

    pub const fn path(self) -> &'static str {
        match self {
            Self::Throttle => "/control/command/sticks.throttle",
            Self::TrackedAltitude => "/tracker/position/position_m.z",
            Self::TrueAltitude => "/plant/truth/position_m.z",
        }
    }

    fn value(self, record: &Record) -> Option<f64> {
        let value = match (self, record) {
            (Self::Throttle, Record::Command(command)) => command.sticks.throttle,
            (Self::TrackedAltitude, Record::Position(position)) if position.status != TrackStatus::Lost => {
                position.position_m[2]
            }
            (Self::TrueAltitude, Record::Truth(truth)) => truth.position_m[2],
            _ => return None,
        };
        value.is_finite().then_some(value)
    }
}

/// Where records come from, as often as wanted.
pub(super) enum Source {
    File(Box<Recording>),
    Memory(Session, Vec<Record>),
}

impl Source {
    pub fn memory(session: Session, records: Vec<Record>) -> Self {
        Self::Memory(session, records)
    }

    pub fn session(&self) -> &Session {
        match self {
            Self::File(recording) => recording.session(),
            Self::Memory(session, _) => session,
        }
    }

    /// The file's name; empty where there is none.
    pub fn name(&self) -> String {
        match self {
            Self::File(recording) => recording.path().display().to_string(),
            Self::Memory(..) => String::new(),
        }
    }

    fn records(&self, channels: &[Channel]) -> Result<Box<Records<'_>>, RecordingError> {
        Ok(match self {
            Self::File(recording) => Box::new(recording.records_of(channels)?),
            Self::Memory(_, records) => {
                let channels = channels.to_vec();
                let wanted = move |record: &&Record| channels.contains(&record.channel());
                Box::new(records.iter().filter(wanted).copied().map(Ok))
            }
        })
    }
}

/// Records as they are read.
type Records<'a> = dyn Iterator<Item = Result<Record, RecordingError>> + 'a;

/// A stretch of a flight whose start is known in every recording of the mission.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Leg {
    pub phase: Phase,
    /// The controller takes the airframe for down in it.
    pub down: bool,
    pub from_ns: i64,
}

impl Leg {
    pub const fn name(self) -> &'static str {
        if self.down { "down" } else { self.phase.name() }
    }

    pub fn is_like(self, other: Self) -> bool {
        (self.phase, self.down) == (other.phase, other.down)
    }
}

/// What a pass over a recording found.
pub(super) struct Scan {
    pub source: Source,
    /// By slot of the catalogue.
    pub fields: Vec<Seen>,
    /// By slot, whether every record of the channel has a number in the field.
    whole: Vec<bool>,
    /// Each phase with its first instant, ns.
    pub phases: Vec<(Phase, i64)>,
    /// When the controller took the airframe for down in each landing, ns.
    pub settling_ns: Vec<i64>,
    /// Whether a landing goes on in closed loop.
    descending: bool,
    pub signals: [Series; Signal::ALL.len()],
    pub records: u64,
    pub first_ns: i64,
    pub last_ns: i64,
    /// How far the file's order falls behind the records' times, ns.
    disorder_ns: i64,
    /// The unit of the sticks; `None` where no rig is attached that says so.
    pub actuation: Option<&'static str>,
}

impl Scan {
    pub fn read(path: &Path) -> Result<Self, RecordingError> {
        Self::of(Source::File(Box::new(Recording::open(path)?)))
    }

    pub fn of(source: Source) -> Result<Self, RecordingError> {
        let rig = source.session().rig_toml.as_ref().map(|text| Rig::read(Path::new("rig.toml"), text));
        let mut scan = Self {
            fields: Vec::new(),
            whole: Vec::new(),
            phases: Vec::new(),
            settling_ns: Vec::new(),
            descending: false,
            signals: [Series::new(), Series::new(), Series::new()],
            records: 0,
            first_ns: i64::MAX,
            last_ns: i64::MIN,
            disorder_ns: 0,
            actuation: rig.and_then(Result::ok).map(|rig| rig.airframe.actuation.unit()),
            source: Source::memory(Session::new(Mode::Sim), Vec::new()),
        };
        let mut census = Census::new();
        for record in source.records(&Channel::ALL)? {
            let record = record?;
            census.take(&record);
            scan.take(&record);
        }
        (scan.fields, scan.whole) = census.finish();
        scan.source = source;
        Ok(scan)
    }

    fn take(&mut self, record: &Record) {
        let t_ns = nanos(record.time());
        self.records += 1;
        self.first_ns = self.first_ns.min(t_ns);
        self.last_ns = self.last_ns.max(t_ns);
        self.disorder_ns = self.disorder_ns.max(self.last_ns - t_ns);
        for (signal, series) in Signal::ALL.into_iter().zip(&mut self.signals) {
            if let Some(value) = signal.value(record) {
                series.push(t_ns, value);
            }
        }
        if let Record::ControlState(state) = record
            && self.phases.last().is_none_or(|(phase, _)| *phase != state.phase)
            && self.phases.len() < PHASES_MAX
        {
            self.phases.push((state.phase, t_ns));
        }
        self.see_settling(record);
    }

    /// Once it takes the airframe for down, the controller leaves the closed loop, which alone has an integral and a speed to
    /// hold: the instant of a landing that every recording with phases has, to an iteration.
    fn see_settling(&mut self, record: &Record) {
        let Record::ControlState(state) = record else { return };
        if state.phase != Phase::Land {
            self.descending = false;
        } else if state.integral_n != 0.0 || state.vertical_speed_setpoint_m_s != 0.0 {
            self.descending = true;
        } else if self.descending {
            self.descending = false;
            self.settling_ns.push(nanos(state.time));
        }
    }

    /// The phases with their first instants, ns; a landing is two, before and after the airframe is down.
    pub fn legs(&self, landings: bool) -> Vec<Leg> {
        let mut legs: Vec<Leg> = self
            .phases
            .iter()
            .map(|(phase, from_ns)| Leg { phase: *phase, down: false, from_ns: *from_ns })
            .collect();
        if landings {
            let down = |from_ns: &i64| Leg { phase: Phase::Land, down: true, from_ns: *from_ns };
            legs.extend(self.settling_ns.iter().map(down));
            legs.sort_by_key(|leg| (leg.from_ns, leg.down));
        }
        legs
    }

    /// The first instant outside of the idle phase that follows an idle one, and its place among the phases.
    pub fn departure(&self) -> Option<usize> {
        let idle = self.phases.iter().position(|(phase, _)| *phase == Phase::Idle)?;
        (idle + 1 < self.phases.len()).then_some(idle + 1)
    }

    /// From leaving the idle phase to the end of the last other one; all of the recording where that is not known. ns.
    pub fn active_ns(&self) -> (i64, i64) {
        let Some(departure) = self.departure() else { return (self.first_ns, self.last_ns) };
        let until = match self.phases.last() {
            Some((Phase::Idle, idle_again)) => *idle_again,
            _ => self.last_ns,
        };
        (self.phases[departure].1, until)
    }

    /// The unit of a field in this recording.
    pub fn unit(&self, field: &Field) -> Option<&'static str> {
        if field.unit == Field::ACTUATION { self.actuation } else { Some(field.unit) }
    }

    /// Whether every record of the channel has a number in a field.
    pub fn is_whole(&self, slot: usize) -> bool {
        self.whole[slot]
    }

    /// Whether the file is so far out of order that channels must be read one at a time.
    pub fn is_unsorted(&self) -> bool {
        self.disorder_ns > DISORDER_MAX_NS
    }

    /// Reads the records of some channels again, in order of time.
    pub fn sorted(
        &self,
        channels: &[Channel],
    ) -> Result<Sorted<impl Iterator<Item = Result<Record, RecordingError>> + '_>, RecordingError> {
        Ok(Sorted::new(self.source.records(channels)?, self.disorder_ns.min(DISORDER_MAX_NS)))
    }
}

/// Counts samples. Most fields have one in each record of their channel, and so as many at the same intervals: these are counted once
/// for all, and a field for itself only from the first record on in which it has none.
struct Census {
    extractor: Extractor,
    /// By channel: its records, each taken for a sample.
    channels: [Seen; Channel::ALL.len()],
    /// By slot of the catalogue; `None` as long as the field is as its channel.
    fields: Vec<Option<Box<Seen>>>,
}

impl Census {
    fn new() -> Self {
        Self {
            extractor: Extractor::new(),
            channels: Default::default(),
            fields: catalogue().iter().map(|_| None).collect(),
        }
    }

    fn take(&mut self, record: &Record) {
        let Self { extractor, channels, fields } = self;
        let channel = &mut channels[record.channel() as usize];
        let t_ns = nanos(record.time());
        let before_ns = channel.last_ns;
        let interval = Interval::between(before_ns, t_ns);
        extractor.each(record, |slot, cell| match &mut fields[slot] {
            None if matches!(cell, Cell::Number(_)) => {}
            field => {
                field.get_or_insert_with(|| Box::new(channel.clone())).take(t_ns, cell, before_ns, interval);
            }
        });
        channel.take(t_ns, Cell::Number(0.0), before_ns, interval);
    }

    /// What each field has, by slot, and whether every record has it.
    fn finish(self) -> (Vec<Seen>, Vec<bool>) {
        let Self { channels, fields, .. } = self;
        let whole = fields.iter().map(Option::is_none).collect();
        let seen = |(entry, field): (Entry, Option<Box<Seen>>)| {
            field.map_or_else(|| channels[entry.channel as usize].clone(), |seen| *seen)
        };
        (catalogue().into_iter().zip(fields).map(seen).collect(), whole)
    }
}

impl Seen {
    /// `interval` is the one since the channel's record before, which was at `before_ns`.
    fn take(&mut self, t_ns: i64, cell: Cell, before_ns: i64, interval: Interval) {
        match cell {
            Cell::Missing => {}
            Cell::Unusable => self.unusable += 1,
            Cell::Number(_) => {
                if self.count > 0 {
                    let own = || Interval::between(self.last_ns, t_ns);
                    self.intervals.push(if self.last_ns == before_ns { interval } else { own() });
                }
                self.count += 1;
                self.last_ns = t_ns;
            }
        }
    }
}

/// Records in order of time, of an iterator whose order falls behind by a known time at most. Holds the records of that
/// time.
pub(super) struct Sorted<I> {
    records: I,
    behind_ns: i64,
    newest_ns: i64,
    heap: BinaryHeap<Waiting>,
    read: u64,
    done: bool,
}

struct Waiting {
    t_ns: i64,
    place: u64,
    record: Record,
}

impl PartialEq for Waiting {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Waiting {}

impl PartialOrd for Waiting {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Waiting {
    /// The heap gives its greatest: the earliest, and the one read first among equals.
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        (other.t_ns, other.place).cmp(&(self.t_ns, self.place))
    }
}

impl<I: Iterator<Item = Result<Record, RecordingError>>> Sorted<I> {
    fn new(records: I, behind_ns: i64) -> Self {
        Self { records, behind_ns, newest_ns: i64::MIN, heap: BinaryHeap::new(), read: 0, done: false }
    }

    fn fill(&mut self) -> Result<(), RecordingError> {
        let settled = |heap: &BinaryHeap<Waiting>, newest_ns: i64, behind_ns: i64| {
            heap.peek().is_some_and(|waiting| waiting.t_ns < newest_ns.saturating_sub(behind_ns))
        };
        while !self.done && !settled(&self.heap, self.newest_ns, self.behind_ns) {
            let Some(record) = self.records.next().transpose()? else {
                self.done = true;
                break;
            };
            let t_ns = nanos(record.time());
            self.newest_ns = self.newest_ns.max(t_ns);
            self.heap.push(Waiting { t_ns, place: self.read, record });
            self.read += 1;
        }
        Ok(())
    }
}

impl<I: Iterator<Item = Result<Record, RecordingError>>> Iterator for Sorted<I> {
    type Item = Result<(i64, Record), RecordingError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.behind_ns == 0 {
            return self.records.next().map(|read| read.map(|record| (nanos(record.time()), record)));
        }
        if let Err(error) = self.fill() {
            return Some(Err(error));
        }
        self.heap.pop().map(|waiting| Ok((waiting.t_ns, waiting.record)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Battery, Tick};

    #[test]
    fn records_are_put_in_order_and_ties_keep_the_order_of_the_file() {
        let battery = |t_s, voltage_v| {
            Ok(Record::from(Battery { time: Time::from_seconds(t_s), voltage_v, current_a: None }))
        };
        let tick = |t_s| Ok(Record::from(Tick { started: Time::from_seconds(t_s), ..Tick::default() }));
        let file = vec![battery(0.1, 1.0), tick(0.0), battery(0.2, 2.0), tick(0.1), battery(0.1, 3.0)];
        let sorted: Vec<_> =
            Sorted::new(file.into_iter(), 100_000_000).map(|read| read.expect("a record")).collect();
        let times: Vec<i64> = sorted.iter().map(|(t_ns, _)| t_ns / 1_000_000).collect();
        assert_eq!(times, [0, 100, 100, 100, 200]);
        assert_eq!(sorted[1].1.channel(), Channel::Battery);
        assert_eq!(sorted[2].1.channel(), Channel::Tick);
    }

    #[test]
    fn quarter_octaves_are_those_of_the_logarithm() {
        for i in 0..4000 {
            let x = 1.003_f64.powi(i - 300);
            let expected = (x.log2() * 4.0).floor().max(0.0) as usize;
            assert_eq!(quarter_octaves(x), expected, "{x}");
        }
    }

    #[test]
    fn a_gap_is_told_from_the_usual_interval() {
        let mut intervals = Intervals::default();
        for _ in 0..500 {
            intervals.push(Interval::between(0, 33_333_333));
        }
        intervals.push(Interval::between(0, 2_000_000_000));
        assert!((intervals.usual_ns() - 33_333_333.0).abs() < 1.0, "{}", intervals.usual_ns());
        assert!(intervals.gap_ns() < 300_000_000, "{}", intervals.gap_ns());
    }
}
