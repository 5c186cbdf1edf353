//! The first pass: what each field has, the phases, and the signals that clocks can be aligned by.

use std::{ops::ControlFlow, path::Path};

use bench_rig::{Phase, Rig};

use super::{
    law::{catalogue, find, name_number},
    names::Names,
    rows::{Cell, Row, RowReader, Steps, is_usable},
    series::Series,
    sorter::Sorter,
};
use crate::{Channel, Field, Mode, Record, Recording, RecordingError, Session};

/// Phases beyond so many are not kept: no mission has them.
const PHASES_MAX: usize = 1000;
/// The longest disorder of a file that is put right on reading, ns.
const DISORDER_MAX_NS: i64 = 2_000_000_000;

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

    /// Gives the rows of some channels' records in the order of the file, until `take` wants no more.
    pub fn rows(
        &self,
        channels: &[Channel],
        reader: &mut RowReader,
        mut take: impl FnMut(&mut Row) -> ControlFlow<()>,
    ) -> Result<(), RecordingError> {
        match self {
            Self::File(recording) => {
                let (mut messages, decoder) = (recording.messages_of(channels)?, recording.decoder());
                while let Some(message) = messages.next()? {
                    if take(reader.message(message, &decoder)?).is_break() {
                        break;
                    }
                }
            }
            Self::Memory(_, records) => {
                for record in records.iter().filter(|record| channels.contains(&record.channel())) {
                    if take(reader.record(record)).is_break() {
                        break;
                    }
                }
            }
        }
        Ok(())
    }
}

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
    pub names: Names,
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
            names: Names::default(),
            source: Source::memory(Session::new(Mode::Sim), Vec::new()),
        };
        let places = Places::new();
        let (mut reader, mut steps, mut census) = (RowReader::new(), Steps::new(), Census::default());
        source.rows(&Channel::ALL, &mut reader, |row| {
            steps.set(row);
            census.take(row);
            scan.take(row, &places);
            ControlFlow::Continue(())
        })?;
        (scan.fields, scan.whole) = census.finish();
        scan.names = reader.names;
        scan.source = source;
        Ok(scan)
    }

    fn take(&mut self, row: &Row, places: &Places) {
        let t_ns = row.t_ns();
        self.records += 1;
        self.first_ns = self.first_ns.min(t_ns);
        self.last_ns = self.last_ns.max(t_ns);
        self.disorder_ns = self.disorder_ns.max(self.last_ns - t_ns);
        for ((channel, column), series) in places.signals.into_iter().zip(&mut self.signals) {
            if channel == row.channel && row.numbers[column].is_finite() {
                series.push(t_ns, row.numbers[column]);
            }
        }
        if row.channel == Channel::ControlState {
            let phase = places.phase(row);
            if self.phases.last().is_none_or(|(before, _)| *before != phase) && self.phases.len() < PHASES_MAX
            {
                self.phases.push((phase, t_ns));
            }
            let is_closed = places.closed_loop.into_iter().any(|column| row.numbers[column] != 0.0);
            self.see_settling(phase, is_closed, t_ns);
        }
    }

    /// Once it takes the airframe for down, the controller leaves the closed loop, which alone has an integral and a speed to
    /// hold: the instant of a landing that every recording with phases has, to an iteration.
    fn see_settling(&mut self, phase: Phase, is_closed: bool, t_ns: i64) {
        if phase != Phase::Land {
            self.descending = false;
        } else if is_closed {
            self.descending = true;
        } else if self.descending {
            self.descending = false;
            self.settling_ns.push(t_ns);
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

    /// Gives the rows of some channels again, in order of time.
    pub fn sorted(
        &self,
        channels: &[Channel],
        mut take: impl FnMut(&mut Row) -> ControlFlow<()>,
    ) -> Result<(), RecordingError> {
        let mut reader = RowReader::new();
        let behind_ns = self.disorder_ns.min(DISORDER_MAX_NS);
        if behind_ns == 0 {
            return self.source.rows(channels, &mut reader, take);
        }
        let mut sorter = Sorter::new(behind_ns);
        self.source.rows(channels, &mut reader, |row| {
            sorter.push(*row);
            while let Some(mut row) = sorter.pop_settled() {
                take(&mut row)?;
            }
            ControlFlow::Continue(())
        })?;
        // What is left is not wanted either where nothing is.
        let _ = sorter.into_rest().try_for_each(|mut row| take(&mut row));
        Ok(())
    }
}

/// Where in rows the first pass finds what it looks at.
struct Places {
    /// By signal.
    signals: [(Channel, usize); Signal::ALL.len()],
    phase: usize,
    phases: [(u64, Phase); Phase::ALL.len()],
    /// Numbers of the controller that are zero but in closed loop.
    closed_loop: [usize; 2],
}

impl Places {
    fn new() -> Self {
        let entries = catalogue();
        let signal = |signal: Signal| {
            let (slot, column) = find(&entries, signal.path());
            (entries[slot].channel, column)
        };
        let state = |name: &str| find(&entries, &format!("{}/{name}", Channel::ControlState.topic())).1;
        Self {
            signals: Signal::ALL.map(signal),
            phase: state("phase"),
            phases: Phase::ALL.map(|phase| (name_number(phase.name()).to_bits(), phase)),
            closed_loop: [state("integral_n"), state("vertical_speed_setpoint_m_s")],
        }
    }

    fn phase(&self, row: &Row) -> Phase {
        let number = row.numbers[self.phase].to_bits();
        let found = self.phases.iter().find(|(of, _)| *of == number);
        found.expect("every state has a phase").1
    }
}

/// Counts samples. Most fields have one in each record of their channel, and so as many at the same intervals: these are counted once
/// for all, and a field for itself only from the first record on in which it has none.
#[derive(Default)]
struct Census {
    channels: [Tallied; Channel::ALL.len()],
}

/// What is counted of a channel.
#[derive(Default)]
struct Tallied {
    /// Its records, each taken for a sample.
    all: Seen,
    /// The columns that have not a sample in each.
    parted: Vec<(usize, Seen)>,
    /// Their bits.
    parted_bits: u32,
}

impl Census {
    fn take(&mut self, row: &Row) {
        let Tallied { all, parted, parted_bits } = &mut self.channels[row.channel as usize];
        let t_ns = row.t_ns();
        let before_ns = all.last_ns;
        let interval = Interval::between(before_ns, t_ns);
        let lacking = row.numbers.iter().enumerate();
        let lacking = lacking.fold(0, |bits, (column, x)| bits | u32::from(!is_usable(*x)) << column);
        let mut fresh = lacking & !*parted_bits;
        *parted_bits |= fresh;
        while fresh != 0 {
            parted.push((fresh.trailing_zeros() as usize, all.clone()));
            fresh &= fresh - 1;
        }
        for (column, seen) in parted {
            seen.take(t_ns, Cell::of(row.numbers[*column]), before_ns, interval);
        }
        all.take(t_ns, Cell::Number, before_ns, interval);
    }

    /// What each field has, by slot, and whether every record has it.
    fn finish(self) -> (Vec<Seen>, Vec<bool>) {
        let of_channel = |(channel, tallied): (Channel, Tallied)| {
            let Tallied { all, parted, .. } = tallied;
            let mut fields: Vec<(Seen, bool)> = vec![(all, true); channel.fields().len()];
            for (column, seen) in parted {
                fields[column] = (seen, false);
            }
            fields
        };
        Channel::ALL.into_iter().zip(self.channels).flat_map(of_channel).unzip()
    }
}

impl Seen {
    /// `interval` is the one since the channel's record before, which was at `before_ns`.
    fn take(&mut self, t_ns: i64, cell: Cell, before_ns: i64, interval: Interval) {
        match cell {
            Cell::Missing => {}
            Cell::Unusable => self.unusable += 1,
            Cell::Number => {
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

#[cfg(test)]
mod tests {
    use super::*;

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
