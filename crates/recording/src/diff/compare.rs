//! The second pass: both recordings at once, in order of time, each sample against the other recording.
//!
//! Memory is bounded by the time tolerance and the gaps that are bridged, not by the recordings' length: a field keeps
//! the samples of [`FieldMerge::reach_ns`] or so on either side.

use std::{
    collections::{BTreeMap, VecDeque},
    sync::mpsc::{Receiver, SyncSender, sync_channel},
    thread,
};

use super::{
    align::TimeMap,
    law::{Cell, Entry, Extractor, Interpolation, Law, catalogue, name_number, slots, wrapped},
    report::{Tolerance, Trace},
    scan::Scan,
    series::{Series, Shift, best_shift},
    trace::TraceBuilder,
};
use crate::{Channel, Record, RecordingError, Value};

/// Most names that are kept for messages.
const NAMES_MAX: usize = 1000;

/// So many samples come before some are compared: a look at the windows costs as much as a sample.
const SETTLED_AT_ONCE: usize = 32;
/// Recordings of more records than this are compared by two threads, half of the fields each.
const SHARED_OUT_FROM: u64 = 20_000;

/// How one field is compared in this run.
#[derive(Clone, Copy, Debug)]
pub(super) struct Setup {
    pub law: Law,
    pub tolerance: Tolerance,
    /// Samples further apart than this have nothing between them, ns; of A and of B.
    pub gaps_ns: [i64; 2],
    /// Whether a lag is looked for.
    pub lag: bool,
}

/// What is drawn: the time axis on A's clock, ns, and into how many stretches it is cut.
#[derive(Clone, Copy, Debug)]
pub(super) struct Axis {
    pub from_ns: i64,
    pub until_ns: i64,
    pub stretches: usize,
}

/// What came out for one field.
#[derive(Debug, Default)]
pub(super) struct Outcome {
    /// Samples that were compared, of A and of B.
    pub compared: [u64; 2],
    /// Every sample has an equal one at an equal time.
    pub same: bool,
    pub tally: Tally,
    /// Names at the first sample beyond the tolerance, A's and B's.
    pub names: Option<[String; 2]>,
    pub shift: Option<Shift>,
    pub trace: Option<Trace>,
}

/// Sums over the samples compared. Differences are B less A.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Tally {
    /// Samples with a difference; those of events without a counterpart have none.
    pub count: u64,
    pub sum: f64,
    pub squares: f64,
    pub largest: f64,
    pub largest_ns: i64,
    /// What remains after the time tolerance: largest, and sum of squares.
    pub largest_off: f64,
    off_squares: f64,
    pub beyond: u64,
    pub first_ns: Option<i64>,
    /// Values at the first sample beyond, A's and B's.
    first: [Option<f64>; 2],
    pub first_over_rms_ns: Option<i64>,
    /// Largest difference (after the time tolerance) over its tolerance; infinite where the tolerance is 0.
    pub worst: f64,
}

impl Tally {
    pub fn rms(&self) -> f64 {
        (self.squares / self.count.max(1) as f64).sqrt()
    }

    /// Root of the mean square of what remains after the time tolerance.
    pub fn rms_off(&self) -> f64 {
        (self.off_squares / self.count.max(1) as f64).sqrt()
    }

    pub fn mean(&self) -> f64 {
        self.sum / self.count.max(1) as f64
    }
}

#[derive(Clone, Copy, Debug)]
struct Sample {
    t_ns: i64,
    /// Samples of different pieces have nothing between them.
    piece: u32,
    value: f64,
}

/// 128 bits that are equal for equal series, and for others by a chance that is nothing. Two multiplicative hashes with odd
/// factors (Knuth, The Art of Computer Programming, vol. 3, 6.4), as a sample must cost little.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Digest(u64, u64);

impl Digest {
    fn add(&mut self, bits: u64) {
        self.0 = (self.0.rotate_left(29) ^ bits).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        self.1 = (self.1.rotate_left(23) ^ bits).wrapping_mul(0xd6e8_feb8_6659_fd93);
    }
}

/// One recording's samples of a field.
struct Track {
    window: VecDeque<Sample>,
    /// How many at the window's front have been compared.
    judged: usize,
    gap_ns: i64,
    count: u64,
    compared: u64,
    /// Samples without a counterpart on the other clock, or out of order beyond repair.
    left_out: u64,
    digest: Digest,
    last_ns: i64,
}

impl Track {
    fn new(gap_ns: i64) -> Self {
        Self {
            window: VecDeque::new(),
            judged: 0,
            gap_ns,
            count: 0,
            compared: 0,
            left_out: 0,
            digest: Digest::default(),
            last_ns: i64::MIN,
        }
    }

    fn push(&mut self, sample: Sample) -> bool {
        if sample.t_ns < self.last_ns {
            self.left_out += 1;
            return false;
        }
        self.last_ns = sample.t_ns;
        self.count += 1;
        self.digest.add(sample.t_ns.cast_unsigned());
        self.digest.add(sample.value.to_bits());
        self.window.push_back(sample);
        true
    }

    /// The value at an instant.
    fn at(&self, law: Law, t_ns: i64, piece: u32) -> Option<f64> {
        let after = self.window.partition_point(|sample| sample.t_ns <= t_ns);
        let before = self.window.get(after.checked_sub(1)?).filter(|sample| sample.piece == piece)?;
        let since_ns = t_ns.saturating_sub(before.t_ns);
        if since_ns == 0 {
            return Some(before.value);
        }
        match law.interpolation {
            Interpolation::None => None,
            Interpolation::Hold => (since_ns <= self.gap_ns).then_some(before.value),
            Interpolation::Linear => {
                let next = self.window.get(after).filter(|sample| sample.piece == piece)?;
                let interval_ns = next.t_ns.saturating_sub(before.t_ns);
                let rise = difference(law, before.value, next.value);
                (interval_ns <= self.gap_ns)
                    .then(|| before.value + rise * (since_ns as f64 / interval_ns as f64))
            }
        }
    }

    /// The differences to a sample's value within a time of it: at the ends of that time, where there is a value, and of all
    /// samples between them, those beyond a seam as well. What follows from a new phase, such as thrust, follows a little later in
    /// real time than in a simulation.
    fn around(&self, law: Law, sample: Sample, within_ns: i64) -> impl Iterator<Item = f64> {
        let (from_ns, until_ns) =
            (sample.t_ns.saturating_sub(within_ns), sample.t_ns.saturating_add(within_ns));
        let ends = [from_ns, until_ns].map(|t_ns| self.at(law, t_ns, sample.piece));
        let first = self.window.partition_point(|other| other.t_ns < from_ns);
        let between = self.window.range(first..).take_while(move |other| other.t_ns <= until_ns);
        let between = between.map(|other| other.value);
        ends.into_iter().flatten().chain(between).map(move |value| difference(law, sample.value, value))
    }

    fn prune(&mut self, before_ns: i64) {
        while self.judged > 0 && self.window.front().is_some_and(|sample| sample.t_ns < before_ns) {
            self.window.pop_front();
            self.judged -= 1;
        }
    }
}

/// `to` less `from`.
fn difference(law: Law, from: f64, to: f64) -> f64 {
    if law.wraps { wrapped(to - from) } else { to - from }
}

/// What the other recording has for a sample.
struct Match {
    /// Its difference at the same instant, or the least one within the time tolerance.
    now: f64,
    /// How far it stays off within the time tolerance, 0 or more.
    off: f64,
}

fn match_sample(law: Law, sample: Sample, other: &Track, within_ns: i64) -> Option<Match> {
    let instant = other.at(law, sample.t_ns, sample.piece).map(|value| difference(law, sample.value, value));
    if within_ns == 0 {
        return instant.map(|now| Match { now, off: now.abs() });
    }
    let (mut low, mut high, mut least) = (f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY);
    for x in other.around(law, sample, within_ns).chain(instant) {
        low = low.min(x);
        high = high.max(x);
        if x.abs() < least.abs() {
            least = x;
        }
    }
    if !least.is_finite() {
        return None;
    }
    // A line between two values passes all that lie between them, unless they are angles half a turn apart.
    let passed = law.interpolation == Interpolation::Linear
        && low <= 0.0
        && high >= 0.0
        && !(law.wraps && high - low > std::f64::consts::PI);
    Some(Match { now: instant.unwrap_or(least), off: if passed { 0.0 } else { least.abs() } })
}

/// One field of both recordings.
struct FieldMerge<'a> {
    setup: Setup,
    within_ns: i64,
    /// Where pieces of the alignment are cut short.
    cuts_ns: &'a [Option<[i64; 2]>],
    tracks: [Track; 2],
    /// Samples since some were last compared.
    unsettled: usize,
    /// Instants of which both recordings have samples of anything; events outside are not looked for.
    shared_ns: (i64, i64),
    tally: Tally,
    series: Option<[Series; 2]>,
    trace: Option<TraceBuilder>,
}

impl<'a> FieldMerge<'a> {
    fn new(setup: Setup, shared_ns: (i64, i64), cuts_ns: &'a [Option<[i64; 2]>], axis: Option<Axis>) -> Self {
        let gap_ns = setup.gaps_ns[0].max(setup.gaps_ns[1]);
        let draws = !setup.law.names && setup.law.interpolation != Interpolation::None;
        Self {
            within_ns: (setup.tolerance.time_s * 1e9).round() as i64,
            tracks: setup.gaps_ns.map(Track::new),
            unsettled: 0,
            cuts_ns,
            shared_ns,
            tally: Tally::default(),
            series: (setup.lag && !setup.law.exact && !setup.law.wraps)
                .then(|| [Series::new(), Series::new()]),
            trace: axis.filter(|_| draws).map(|axis| TraceBuilder::new(axis, gap_ns)),
            setup,
        }
    }

    /// How far from a sample the other recording's samples matter, ns.
    fn reach_ns(&self) -> i64 {
        self.within_ns + self.setup.gaps_ns[0].max(self.setup.gaps_ns[1])
    }

    fn push(&mut self, side: usize, sample: Sample) {
        if !self.tracks[side].push(sample) {
            return;
        }
        if let Some(series) = &mut self.series {
            series[side].push(sample.t_ns, sample.value);
        }
        if let Some(trace) = &mut self.trace {
            trace.value(side, sample.t_ns, sample.value);
        }
        // Both recordings come in one order of time, so all that is older than this has come.
        self.unsettled += 1;
        if self.unsettled == SETTLED_AT_ONCE {
            self.unsettled = 0;
            self.settle(sample.t_ns.saturating_sub(self.reach_ns()));
        }
    }

    /// Compares all samples before an instant.
    fn settle(&mut self, before_ns: i64) {
        for side in 0..2 {
            while let Some(&sample) = self.tracks[side].window.get(self.tracks[side].judged)
                && sample.t_ns < before_ns
            {
                self.tracks[side].judged += 1;
                self.judge(side, sample);
            }
        }
        let needed_ns = before_ns.saturating_sub(self.reach_ns());
        self.tracks.iter_mut().for_each(|track| track.prune(needed_ns));
    }

    /// What answers to a sample may come earlier or later, by the time tolerance, and so lie in what is not compared.
    fn is_by_a_cut(&self, sample: Sample) -> bool {
        let cut = |piece: Option<usize>| piece.and_then(|piece| self.cuts_ns.get(piece).copied().flatten());
        let piece = sample.piece as usize;
        cut(Some(piece)).is_some_and(|[until_ns, _]| sample.t_ns > until_ns - self.within_ns)
            || cut(piece.checked_sub(1)).is_some_and(|[_, from_ns]| sample.t_ns < from_ns + self.within_ns)
    }

    fn judge(&mut self, side: usize, sample: Sample) {
        let Setup { law, tolerance, .. } = self.setup;
        if self.is_by_a_cut(sample) {
            return;
        }
        let other = &self.tracks[1 - side];
        let Some(found) = match_sample(law, sample, other, self.within_ns) else {
            let expected = law.interpolation == Interpolation::None
                && (self.shared_ns.0..=self.shared_ns.1).contains(&sample.t_ns);
            if expected {
                self.tracks[side].compared += 1;
                self.tally.beyond(sample.t_ns, side, sample.value, None);
            }
            return;
        };
        self.tracks[side].compared += 1;
        let there = sample.value + found.now;
        if !law.names {
            let b_less_a = if side == 0 { found.now } else { -found.now };
            self.tally.add(sample.t_ns, b_less_a, found.off, tolerance.rms);
            if let Some(trace) = &mut self.trace {
                trace.difference(sample.t_ns, b_less_a);
            }
        }
        let allowed = tolerance.absolute.max(tolerance.relative * sample.value.abs().max(there.abs()));
        if !law.exact && found.off > 0.0 {
            self.tally.worst = self.tally.worst.max(found.off / allowed);
        }
        if found.off > allowed {
            self.tally.beyond(sample.t_ns, side, sample.value, Some(there));
        }
    }

    fn finish(mut self, names: &Names) -> Outcome {
        self.settle(i64::MAX);
        let [a, b] = &self.tracks;
        let same = a.count == b.count && a.left_out + b.left_out == 0 && a.digest == b.digest;
        let differs = self.tally.largest > 0.0;
        let shift = self.series.as_ref().filter(|_| differs).and_then(|[a, b]| best_shift(a, b));
        let first = self.tally.first_ns.filter(|_| self.setup.law.names);
        Outcome {
            compared: [a.compared, b.compared],
            same,
            names: first.map(|_| self.tally.first.map(|name| names.get(name))),
            tally: self.tally,
            shift,
            trace: self.trace.map(|trace| trace.finish(same)),
        }
    }
}

impl Tally {
    fn add(&mut self, t_ns: i64, b_less_a: f64, off: f64, rms_limit: Option<f64>) {
        let size = b_less_a.abs();
        self.count += 1;
        self.sum += b_less_a;
        self.squares += size * size;
        self.off_squares += off * off;
        self.largest_off = self.largest_off.max(off);
        if size > self.largest {
            (self.largest, self.largest_ns) = (size, t_ns);
        }
        if rms_limit.is_some_and(|limit| off > limit) {
            // Samples of A and B are compared in turns, each in order.
            self.first_over_rms_ns = Some(self.first_over_rms_ns.map_or(t_ns, |first| first.min(t_ns)));
        }
    }

    fn beyond(&mut self, t_ns: i64, side: usize, value: f64, there: Option<f64>) {
        self.beyond += 1;
        if self.first_ns.is_none_or(|first| t_ns < first) {
            self.first_ns = Some(t_ns);
            self.first = if side == 0 { [Some(value), there] } else { [there, Some(value)] };
        }
    }
}

/// Names by the numbers that stand for them.
#[derive(Default)]
struct Names {
    names: BTreeMap<u64, String>,
}

impl Names {
    fn learn(&mut self, entries: &[Entry], slot: usize, record: &Record) {
        if let Value::Text(text) = entries[slot].field.value(record)
            && self.names.len() < NAMES_MAX
        {
            self.names.entry(name_number(text).to_bits()).or_insert_with(|| text.to_owned());
        }
    }

    fn get(&self, name: Option<f64>) -> String {
        let Some(name) = name else { return "nothing".to_owned() };
        self.names.get(&name.to_bits()).cloned().unwrap_or_else(|| "another text".to_owned())
    }
}

/// Compares the fields that have a setup; one outcome a slot.
pub(super) fn compare(
    a: &Scan,
    b: &Scan,
    map: &TimeMap,
    setups: &[Option<Setup>],
    axis: Option<Axis>,
) -> Result<Vec<Option<Outcome>>, RecordingError> {
    let b_ends = [b.first_ns, b.last_ns].map(|t_ns| map.place(1, t_ns).map(|(t_ns, _)| t_ns));
    let shared_ns = (
        b_ends[0].map_or(a.first_ns, |t| t.max(a.first_ns)),
        b_ends[1].map_or(a.last_ns, |t| t.min(a.last_ns)),
    );
    let cuts_ns = map.cuts_ns();
    let merge = |setup: &Option<Setup>| setup.map(|setup| FieldMerge::new(setup, shared_ns, &cuts_ns, axis));
    let mut merges: Vec<Option<FieldMerge<'_>>> = setups.iter().map(merge).collect();
    let mut names = Names::default();
    let channels: Vec<Channel> = Channel::ALL
        .into_iter()
        .filter(|channel| merges[slots_of(*channel)].iter().any(Option::is_some))
        .collect();
    // A file that is out of order is read once a channel: each for itself is in order, or nothing is.
    if a.is_unsorted() || b.is_unsorted() {
        for channel in channels {
            read_both(a, b, map, &[channel], &mut merges, &mut names)?;
        }
    } else if a.records.max(b.records) < SHARED_OUT_FROM {
        read_both(a, b, map, &channels, &mut merges, &mut names)?;
    } else {
        let [here, there] = halves(&channels, a, b);
        let mut others = Vec::new();
        others.resize_with(merges.len(), || None);
        for slot in there.iter().flat_map(|channel| slots_of(*channel)) {
            others[slot] = merges[slot].take();
        }
        let mut other_names = Names::default();
        let [first, second] = thread::scope(|scope| {
            let other = scope.spawn(|| read_both(a, b, map, &there, &mut others, &mut other_names));
            let first = read_both(a, b, map, &here, &mut merges, &mut names);
            [first, other.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))]
        });
        first.and(second)?;
        names.names.extend(other_names.names);
        for (merge, other) in merges.iter_mut().zip(others) {
            if other.is_some() {
                *merge = other;
            }
        }
    }
    Ok(merges.into_iter().map(|merge| merge.map(|merge| merge.finish(&names))).collect())
}

/// A channel's places in the catalogue.
fn slots_of(channel: Channel) -> std::ops::Range<usize> {
    let first = slots()[channel as usize];
    first..first + channel.fields().len()
}

/// The channels in two parts of about as many samples.
fn halves(channels: &[Channel], a: &Scan, b: &Scan) -> [Vec<Channel>; 2] {
    let samples = |channel: &Channel| -> u64 {
        slots_of(*channel).map(|slot| a.fields[slot].count + b.fields[slot].count).sum()
    };
    let mut channels: Vec<(u64, Channel)> =
        channels.iter().map(|channel| (samples(channel), *channel)).collect();
    channels.sort_by_key(|(samples, _)| std::cmp::Reverse(*samples));
    let mut halves = [(0, Vec::new()), (0, Vec::new())];
    for (samples, channel) in channels {
        let smaller = usize::from(halves[1].0 < halves[0].0);
        halves[smaller].0 += samples;
        halves[smaller].1.push(channel);
    }
    halves.map(|(_, channels)| channels)
}

/// Records that a thread reads ahead before it waits: so many a batch, and so many batches.
const BATCH: usize = 256;
const BATCHES: usize = 4;

type Batch = Vec<Result<(i64, Record), RecordingError>>;

/// Each recording is read by a thread of its own; this one compares.
fn read_both(
    a: &Scan,
    b: &Scan,
    map: &TimeMap,
    channels: &[Channel],
    merges: &mut [Option<FieldMerge<'_>>],
    names: &mut Names,
) -> Result<(), RecordingError> {
    thread::scope(|scope| {
        let ends = [a, b].map(|scan| {
            let (sender, receiver) = sync_channel(BATCHES);
            scope.spawn(move || read_ahead(scan, channels, &sender));
            Ahead { receiver, batch: Vec::new().into_iter() }
        });
        merge_both(ends, map, merges, names)
    })
}

/// Sends the records of a recording in order of time until nobody wants them any more.
fn read_ahead(scan: &Scan, channels: &[Channel], sender: &SyncSender<Batch>) {
    let mut records = match scan.sorted(channels) {
        Ok(records) => records,
        Err(error) => {
            // Nobody is left to tell only if the other recording has failed already.
            let _ = sender.send(vec![Err(error)]);
            return;
        }
    };
    loop {
        let batch: Batch = records.by_ref().take(BATCH).collect();
        if batch.is_empty() || sender.send(batch).is_err() {
            return;
        }
    }
}

/// The other end of it.
struct Ahead {
    receiver: Receiver<Batch>,
    batch: std::vec::IntoIter<Result<(i64, Record), RecordingError>>,
}

impl Iterator for Ahead {
    type Item = Result<(i64, Record), RecordingError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(record) = self.batch.next() {
                return Some(record);
            }
            self.batch = self.receiver.recv().ok()?.into_iter();
        }
    }
}

fn merge_both(
    [a, b]: [Ahead; 2],
    map: &TimeMap,
    merges: &mut [Option<FieldMerge<'_>>],
    names: &mut Names,
) -> Result<(), RecordingError> {
    let entries = catalogue();
    let mut extractors = [Extractor::new(), Extractor::new()];
    let mut sources = [Placed::new(a, 0, map)?, Placed::new(b, 1, map)?];
    while let Some(side) = earlier(&sources) {
        let Some(Head { place, record, .. }) = sources[side].take()? else { break };
        extractors[side].each(&record, |slot, cell| {
            let (Some(merge), Cell::Number(value)) = (&mut merges[slot], cell) else { return };
            if merge.setup.law.names {
                names.learn(&entries, slot, &record);
            }
            match place {
                Some((t_ns, piece)) => merge.push(side, Sample { t_ns, piece, value }),
                None => merge.tracks[side].left_out += 1,
            }
        });
    }
    Ok(())
}

/// The side whose next record comes first; `None` at the end of both.
fn earlier<I>(sources: &[Placed<'_, I>; 2]) -> Option<usize> {
    match (&sources[0].head, &sources[1].head) {
        (Some(a), Some(b)) => Some(usize::from(b.due_ns < a.due_ns)),
        (Some(_), None) => Some(0),
        (None, Some(_)) => Some(1),
        (None, None) => None,
    }
}

/// A recording's records with their places on A's clock.
struct Placed<'a, I> {
    records: I,
    side: usize,
    map: &'a TimeMap,
    head: Option<Head>,
}

struct Head {
    /// Its place, or that of the record before if it has none, ns.
    due_ns: i64,
    place: Option<(i64, u32)>,
    record: Record,
}

impl<'a, I: Iterator<Item = Result<(i64, Record), RecordingError>>> Placed<'a, I> {
    fn new(records: I, side: usize, map: &'a TimeMap) -> Result<Self, RecordingError> {
        let mut placed = Self { records, side, map, head: None };
        placed.advance(i64::MIN)?;
        Ok(placed)
    }

    fn advance(&mut self, before_ns: i64) -> Result<(), RecordingError> {
        self.head = self.records.next().transpose()?.map(|(t_ns, record)| {
            let place = self.map.place(self.side, t_ns);
            Head { due_ns: place.map_or(before_ns, |(t_ns, _)| t_ns), place, record }
        });
        Ok(())
    }

    fn take(&mut self) -> Result<Option<Head>, RecordingError> {
        let Some(head) = self.head.take() else { return Ok(None) };
        self.advance(head.due_ns)?;
        Ok(Some(head))
    }
}
