//! Rows to records.

use bench_device::{Sticks, Time};
use bench_rig::Phase;

use super::{
    log::{Fault, Row},
    map::{ChannelMap, ImportMap, Make, PhaseSource, Quantity, Source},
    report::SkipReason,
};
use crate::{Channel, Record, Tick};

/// What a row says of one channel; equal if the messages would be.
#[derive(Clone, Debug, Default, PartialEq)]
struct Sample {
    /// In the order of the map's quantities; `None` where the log does not have one.
    numbers: Vec<Option<f64>>,
    phase: Option<Phase>,
    /// When a position was exposed, on the log's clock, ns, where the log tells.
    exposed_ns: Option<i128>,
}

/// One channel and what was last kept of it.
struct ChannelState<'m> {
    map: &'m ChannelMap,
    last: Option<Sample>,
    /// The stretch of `every_s` that has its message.
    stretch: Option<u64>,
    ranges: Vec<Option<[f64; 2]>>,
}

/// Turns the rows of one log into records, remembering what repetition, decimation and ticks need.
pub(super) struct Converter<'m> {
    map: &'m ImportMap,
    channels: Vec<ChannelState<'m>>,
    latency: Time,
    tick_period_s: Option<f64>,
    rest: Sticks,
    ticks: u64,
    previous_start: Option<Time>,
    pub positions_before_origin: u64,
}

impl<'m> Converter<'m> {
    pub fn new(map: &'m ImportMap, latency_s: f64, tick_period_s: Option<f64>, rest: Sticks) -> Self {
        let channels = map
            .channels
            .iter()
            .map(|map| ChannelState {
                map,
                last: None,
                stretch: None,
                ranges: vec![None; map.quantities.len()],
            })
            .collect();
        Self {
            map,
            channels,
            latency: Time::from_seconds(latency_s),
            tick_period_s,
            rest,
            ticks: 0,
            previous_start: None,
            positions_before_origin: 0,
        }
    }

    /// Whether the map's filters keep the row.
    pub fn keeps(&self, row: Row<'_>) -> Result<bool, Fault> {
        for filter in &self.map.filters {
            let number = row.number(filter.column, None)?;
            if !(filter.at_least..filter.below).contains(&number) {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Reads all of a row before anything of it is used: one sample a channel, `None` where the row has none.
    pub fn read(&self, row: Row<'_>) -> Result<Samples, Fault> {
        let mut absent = None;
        let mut samples = Vec::with_capacity(self.channels.len());
        for channel in &self.channels {
            if !self.is_told(channel.map, row) {
                samples.push(None);
                continue;
            }
            match self.sample(channel.map, row) {
                Ok(sample) => samples.push(Some(sample)),
                Err(fault)
                    if fault.is_lack() && (channel.map.may_be_absent || self.map.is_optional(&fault)) =>
                {
                    absent = Some(fault);
                    samples.push(None);
                }
                Err(fault) => return Err(fault),
            }
        }
        match absent {
            // A row that says nothing at all. Samples of a log of topics are often held back for others.
            Some(fault)
                if samples.iter().all(Option::is_none)
                    && (self.map.log.is_none() || fault.reason == SkipReason::Nan) =>
            {
                Err(fault)
            }
            _ => Ok(Samples(samples)),
        }
    }

    /// Whether a row brings what makes a message of a channel: its first column, or any of the state's.
    fn is_told(&self, map: &ChannelMap, row: Row<'_>) -> bool {
        let mut columns = map.quantities.iter().flat_map(|quantity| quantity.source.columns());
        match map.table.channel {
            Channel::ControlState => {
                let phase = self.map.phase.column();
                let mut all = columns.copied().chain(phase).peekable();
                all.peek().is_none() || all.any(|column| row.brings(column))
            }
            _ => columns.next().is_none_or(|column| row.brings(*column)),
        }
    }

    fn sample(&self, map: &ChannelMap, row: Row<'_>) -> Result<Sample, Fault> {
        let phase = match map.table.channel {
            Channel::ControlState => Some(self.map.phase.read(row)?),
            _ => None,
        };
        let mut lacked = None;
        let mut numbers = Vec::with_capacity(map.quantities.len());
        for quantity in &map.quantities {
            match quantity.read(row) {
                Ok(number) => numbers.push(Some(number)),
                // A battery without a current has a voltage nevertheless.
                Err(fault)
                    if fault.is_lack()
                        && !quantity.target.required
                        && (self.map.log.is_some() || self.map.is_optional(&fault)) =>
                {
                    lacked = Some(fault);
                    numbers.push(None);
                }
                Err(fault) => return Err(fault),
            }
        }
        if let Some(fault) = lacked.filter(|_| phase.is_none() && numbers.iter().all(Option::is_none)) {
            return Err(fault);
        }
        let exposed = self.map.exposed.as_ref().filter(|_| map.table.channel == Channel::Position);
        let exposed_ns = match exposed {
            None => None,
            Some(exposed) => {
                let nanos = row.nanos(exposed.column, exposed.unit)?;
                if nanos > self.map.time_ns(row)? {
                    // Nobody sees what is still to come.
                    return Err(SkipReason::OutOfRange.in_column(exposed.column));
                }
                Some(nanos)
            }
        };
        Ok(Sample { numbers, phase, exposed_ns })
    }

    /// Appends the records of a row at `time`; the log's clock shows `origin_ns` at time zero.
    pub fn convert(&mut self, time: Time, origin_ns: i128, Samples(samples): Samples, out: &mut Vec<Record>) {
        for (channel, sample) in self.channels.iter_mut().zip(samples) {
            let Some(sample) = sample else { continue };
            let exposed = match sample.exposed_ns {
                Some(nanos) => u64::try_from(nanos - origin_ns).ok().map(Time::from_nanos),
                None => (time >= self.latency).then(|| time.shifted(-self.latency.seconds())),
            };
            match exposed {
                None if channel.map.table.channel == Channel::Position => self.positions_before_origin += 1,
                _ if channel.keep(time, &sample) => {
                    out.push(channel.record(time, exposed.unwrap_or(time), self.rest, &sample));
                    channel.last = Some(sample);
                }
                _ => {}
            }
        }
    }

    /// The tick of a row that starts at `time`. It was due one period after the row before; after a gap that is not the
    /// loop's own doing, see [`Converter::forget_start`], when it started.
    pub fn tick(&mut self, time: Time) -> Option<Record> {
        let period_s = self.tick_period_s?;
        let scheduled = self.previous_start.map_or(time, |previous| previous.shifted(period_s));
        let tick = Tick {
            index: self.ticks,
            scheduled,
            started: time,
            overrun: time.since_s(scheduled) > period_s,
            ..Tick::default()
        };
        self.started(time);
        Some(tick.into())
    }

    /// An iteration started at `time`, whether or not its row can be used.
    pub fn started(&mut self, time: Time) {
        self.ticks += 1;
        self.previous_start = Some(time);
    }

    /// The row before is not known: it was filtered out, or its time was bad.
    pub fn forget_start(&mut self) {
        self.previous_start = None;
    }

    /// The smallest and largest value recorded of each quantity, with its table and itself.
    pub fn ranges(&self) -> impl Iterator<Item = (&'static str, &Quantity, [f64; 2])> {
        self.channels.iter().flat_map(|channel| {
            let quantities = channel.map.quantities.iter().zip(&channel.ranges);
            quantities.filter_map(|(quantity, range)| Some((channel.map.table.name, quantity, (*range)?)))
        })
    }
}

/// One sample a channel of the map.
pub(super) struct Samples(Vec<Option<Sample>>);

impl ChannelState<'_> {
    /// Whether the map wants this sample as a message.
    fn keep(&mut self, time: Time, sample: &Sample) -> bool {
        if self.map.changes_only && self.last.as_ref() == Some(sample) {
            return false;
        }
        // The newest frame at hand is that of the row before.
        if sample.exposed_ns.is_some()
            && self.last.as_ref().map(|last| last.exposed_ns) == Some(sample.exposed_ns)
        {
            return false;
        }
        if let Some(every_s) = self.map.every_s {
            let stretch = Some(time.nanos() / Time::from_seconds(every_s).nanos());
            if self.stretch == stretch {
                return false;
            }
            self.stretch = stretch;
        }
        true
    }

    fn record(&mut self, time: Time, exposed_at: Time, rest: Sticks, sample: &Sample) -> Record {
        let mut record = (self.map.table.blank)(time, rest);
        match &mut record {
            Record::Position(position) => position.exposed_at = exposed_at,
            Record::ControlState(state) => state.phase = sample.phase.unwrap_or(state.phase),
            _ => {}
        }
        for ((quantity, range), &number) in
            self.map.quantities.iter().zip(&mut self.ranges).zip(&sample.numbers)
        {
            let Some(number) = number else { continue };
            (quantity.target.set)(&mut record, number);
            let [low, high] = range.get_or_insert([number; 2]);
            *low = low.min(number);
            *high = high.max(number);
        }
        record
    }
}

impl Quantity {
    fn read(&self, row: Row<'_>) -> Result<f64, Fault> {
        match &self.source {
            Source::Constant(number) => Ok(*number),
            Source::Columns { columns, make, valid, factor, shift } => {
                let numbers = columns.iter().map(|&column| row.number(column, *valid));
                let numbers = numbers.collect::<Result<Vec<_>, _>>()?;
                let mean = |of: fn(&f64) -> f64| numbers.iter().map(of).sum::<f64>() / numbers.len() as f64;
                let made = match (make, numbers.as_slice()) {
                    // It is no direction.
                    (Make::Angle(_), [0.0, 0.0, 0.0, 0.0]) => {
                        return Err(SkipReason::OutOfRange.in_column(columns[0]));
                    }
                    (Make::Angle(angle), &[w, x, y, z]) => angle.of([w, x, y, z]),
                    (Make::MeanOfSquares, _) => mean(|x| x * x),
                    _ => mean(|x| *x),
                };
                let number = made * factor + shift;
                if number.is_finite() { Ok(number) } else { Err(SkipReason::Infinite.in_column(columns[0])) }
            }
        }
    }
}

impl PhaseSource {
    fn read(&self, row: Row<'_>) -> Result<Phase, Fault> {
        match self {
            Self::Constant(phase) => Ok(*phase),
            Self::Names(column, names) => {
                let text = row.text(*column)?;
                let reason = if text.is_empty() { SkipReason::Empty } else { SkipReason::UnknownPhase };
                let named = names.iter().find(|(name, _)| *name == text);
                named.map(|(_, phase)| *phase).ok_or_else(|| reason.in_column(*column))
            }
            Self::Thresholds(column, thresholds) => {
                let number = row.number(*column, None)?;
                let reached = thresholds.iter().rev().find(|(from, _)| *from <= number);
                reached.map(|(_, phase)| *phase).ok_or_else(|| SkipReason::OutOfRange.in_column(*column))
            }
        }
    }
}

impl ImportMap {
    /// Whether a fault is in a column that a table may lack.
    fn is_optional(&self, fault: &Fault) -> bool {
        fault.column.is_some_and(|column| self.columns[column.0].optional)
    }

    /// The log's time at a row, ns.
    pub(super) fn time_ns(&self, row: Row<'_>) -> Result<i128, Fault> {
        match (row.stamp_ns(), &self.time) {
            (Some(nanos), _) => Ok(nanos),
            (None, Some(time)) => row.nanos(time.column, time.unit),
            (None, None) => Err(Fault { reason: SkipReason::Empty, column: None }),
        }
    }
}
