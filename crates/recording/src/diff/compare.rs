//! The second pass: both recordings at once, in order of time, each sample against the other recording.
//!
//! Memory is bounded by the time tolerance and the gaps that are bridged, not by the recordings' length: a field keeps
//! the samples of [`FieldMerge::reach_ns`] or so on either side.

use std::{
    collections::{BTreeMap, btree_map},
    sync::{
        Arc,
        mpsc::{Receiver, SyncSender, sync_channel},
    },
    thread,
};

use super::{
    align::TimeMap,
    law::{Cell, Entry, Extractor, Interpolation, Law, catalogue, slots, wrapped},
    report::{Tolerance, Trace},
    scan::Scan,
    series::{Series, Shift, best_shift},
    trace::{Stretches, TraceBuilder},
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
    /// Where it is drawn.
    stretch: u32,
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
    /// In order of time. Those before `kept_from` are not needed any more.
    window: Vec<Sample>,
    kept_from: usize,
    /// The first one that has not been compared.
    judged: usize,
    gap_ns: i64,
    count: u64,
    compared: u64,
    /// Samples without a counterpart on the other clock, or out of order beyond repair.
    left_out: u64,
    digest: Digest,
    last_ns: i64,
}

/// Where instants lie among the samples of the other recording: the first sample behind each. Instants are looked up in order of
/// time, so that each look-up goes on from the one before.
#[derive(Clone, Copy, Debug, Default)]
struct Cursors {
    instant: usize,
    /// At the beginning and at the end of the time tolerance around it.
    ends: [usize; 2],
    /// The first sample within the time tolerance.
    first: usize,
}

impl Cursors {
    fn shift(&mut self, by: usize) {
        for cursor in [&mut self.instant, &mut self.first].into_iter().chain(&mut self.ends) {
            *cursor = cursor.saturating_sub(by);
        }
    }
}

/// Room is made at a window's front once so many samples of it are not needed any more.
const SPARE_MAX: usize = 1024;

impl Track {
    fn new(gap_ns: i64) -> Self {
        Self {
            window: Vec::new(),
            kept_from: 0,
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
        self.window.push(sample);
        true
    }

    /// Moves a cursor on to the first sample that is not `before`.
    fn seek(&self, cursor: &mut usize, before: impl Fn(i64) -> bool) -> usize {
        *cursor = (*cursor).max(self.kept_from);
        while self.window.get(*cursor).is_some_and(|sample| before(sample.t_ns)) {
            *cursor += 1;
        }
        *cursor
    }

    /// The value at an instant.
    fn at(&self, cursor: &mut usize, law: Law, t_ns: i64, piece: u32) -> Option<f64> {
        let after = self.seek(cursor, |other_ns| other_ns <= t_ns);
        let before = after.checked_sub(1).filter(|before| *before >= self.kept_from)?;
        let before = self.window.get(before).filter(|sample| sample.piece == piece)?;
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
    fn around(
        &self,
        cursors: &mut Cursors,
        law: Law,
        sample: Sample,
        within_ns: i64,
    ) -> impl Iterator<Item = f64> {
        let (from_ns, until_ns) =
            (sample.t_ns.saturating_sub(within_ns), sample.t_ns.saturating_add(within_ns));
        let [begin, end] = &mut cursors.ends;
        let ends = [self.at(begin, law, from_ns, sample.piece), self.at(end, law, until_ns, sample.piece)];
        let first = self.seek(&mut cursors.first, |other_ns| other_ns < from_ns);
        let between = self.window[first..].iter().take_while(move |other| other.t_ns <= until_ns);
        let between = between.map(|other| other.value);
        ends.into_iter().flatten().chain(between).map(move |value| difference(law, sample.value, value))
    }

    /// Forgets what was compared and lies before an instant; by how many samples all of the others' places are less from now on.
    fn prune(&mut self, before_ns: i64) -> usize {
        while self.kept_from < self.judged && self.window[self.kept_from].t_ns < before_ns {
            self.kept_from += 1;
        }
        if self.kept_from < SPARE_MAX {
            return 0;
        }
        self.window.drain(..self.kept_from);
        self.judged -= self.kept_from;
        std::mem::take(&mut self.kept_from)
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

fn match_sample(
    law: Law,
    sample: Sample,
    other: &Track,
    cursors: &mut Cursors,
    within_ns: i64,
) -> Option<Match> {
    let instant = other.at(&mut cursors.instant, law, sample.t_ns, sample.piece);
    let instant = instant.map(|value| difference(law, sample.value, value));
    if within_ns == 0 {
        return instant.map(|now| Match { now, off: now.abs() });
    }
    let (mut low, mut high, mut least) = (f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY);
    for x in other.around(cursors, law, sample, within_ns).chain(instant) {
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
    /// Where A's instants lie in B's track, and B's in A's.
    cursors: [Cursors; 2],
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
            cursors: [Cursors::default(); 2],
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
            trace.value(side, sample.stretch, sample.t_ns, sample.value);
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
        for (track, cursors) in self.tracks.iter_mut().zip(self.cursors.iter_mut().rev()) {
            cursors.shift(track.prune(needed_ns));
        }
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
        let Some(found) = match_sample(law, sample, other, &mut self.cursors[side], self.within_ns) else {
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
                trace.difference(sample.stretch, sample.t_ns, b_less_a);
            }
        }
        let allowed = tolerance.absolute.max(tolerance.relative * sample.value.abs().max(there.abs()));
        // Most samples are so clearly not the worst one that the division is not worth it.
        let is_clearly_less = found.off < 0.999 * self.tally.worst * allowed;
        if !law.exact && found.off > 0.0 && !is_clearly_less {
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
    /// By slot, the number that was learnt last: names come many times in a row.
    last: Vec<u64>,
}

impl Names {
    /// Takes note of a name; gives it if it is a new one.
    fn learn(&mut self, entries: &[Entry], slot: usize, number: f64, record: &Record) -> Option<&str> {
        let number = number.to_bits();
        self.last.resize(entries.len(), u64::MAX);
        if std::mem::replace(&mut self.last[slot], number) == number || self.names.len() >= NAMES_MAX {
            return None;
        }
        let Value::Text(text) = entries[slot].field.value(record) else { return None };
        match self.names.entry(number) {
            btree_map::Entry::Vacant(place) => Some(place.insert(text.to_owned())),
            btree_map::Entry::Occupied(_) => None,
        }
    }

    fn add(&mut self, names: Vec<(u64, String)>) {
        for (number, name) in names {
            if self.names.len() < NAMES_MAX {
                self.names.entry(number).or_insert(name);
            }
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
            compare_channels(a, b, (map, axis), &[channel], &mut merges, &mut names)?;
        }
    } else {
        compare_channels(a, b, (map, axis), &channels, &mut merges, &mut names)?;
    }
    Ok(merges.into_iter().map(|merge| merge.map(|merge| merge.finish(&names))).collect())
}

/// A channel's places in the catalogue.
fn slots_of(channel: Channel) -> std::ops::Range<usize> {
    let first = slots()[channel as usize];
    first..first + channel.fields().len()
}

/// Samples of both recordings in one order of time, by channel. What compares goes through it field by field, so that what is kept
/// of a field stays at hand.
struct Block {
    records: usize,
    /// By channel: where each record belongs.
    places: [Vec<Place>; Channel::ALL.len()],
    /// By slot of the catalogue: the number of each record of the channel; not a number where there is none.
    numbers: Vec<Vec<f64>>,
}

#[derive(Clone, Copy)]
struct Place {
    side: usize,
    /// Instant on A's clock, ns, and piece; `None` where the other recording has no such instant.
    at: Option<(i64, u32)>,
    /// The stretch of the traces that it lies in.
    stretch: u32,
}

impl Block {
    /// Records of a block.
    const RECORDS: usize = 1024;

    fn new(slots: usize) -> Self {
        Self { records: 0, places: Default::default(), numbers: vec![Vec::new(); slots] }
    }

    /// Hands the samples of some fields to what compares them.
    fn compare(&self, fields: &mut [Shared<'_, '_>]) {
        for Shared { channel, slot, merge } in fields {
            for (place, value) in self.places[*channel as usize].iter().zip(&self.numbers[*slot]) {
                match place.at {
                    _ if value.is_nan() => {}
                    Some((t_ns, piece)) => {
                        let stretch = place.stretch;
                        merge.push(place.side, Sample { t_ns, piece, stretch, value: *value });
                    }
                    None => merge.tracks[place.side].left_out += 1,
                }
            }
        }
    }
}

/// A field in the hands of the thread that compares it.
struct Shared<'m, 'a> {
    channel: Channel,
    slot: usize,
    merge: &'m mut FieldMerge<'a>,
}

/// Reads both recordings, each on a thread of its own, and compares the fields of some channels: here, or on two more threads
/// where there is much to compare. Blocks go from here to both, which wait for nothing else.
fn compare_channels(
    a: &Scan,
    b: &Scan,
    (map, axis): (&TimeMap, Option<Axis>),
    channels: &[Channel],
    merges: &mut [Option<FieldMerge<'_>>],
    names: &mut Names,
) -> Result<(), RecordingError> {
    let entries = catalogue();
    let plan = Plan {
        map,
        slots: slots(),
        wanted: merges.iter().map(Option::is_some).collect(),
        stretches: axis.map(Stretches::of),
    };
    let mut fields: Vec<Shared<'_, '_>> = merges
        .iter_mut()
        .zip(&entries)
        .enumerate()
        .filter(|(_, (_, entry))| channels.contains(&entry.channel))
        .filter_map(|(slot, (merge, entry))| {
            merge.as_mut().map(|merge| Shared { channel: entry.channel, slot, merge })
        })
        .collect();
    thread::scope(|scope| {
        let receivers = [a, b].map(|scan| {
            let (sender, receiver) = sync_channel(BATCHES);
            let entries = &entries;
            scope.spawn(move || read_ahead(scan, channels, entries, &sender));
            receiver
        });
        if a.records.max(b.records) < SHARED_OUT_FROM {
            let take = |block: Block| block.compare(&mut fields);
            return make_blocks(receivers, &plan, names, take);
        }
        let senders = halves(fields, a, b).map(|mut fields| {
            let (sender, receiver) = sync_channel::<Arc<Block>>(BLOCKS);
            scope.spawn(move || receiver.iter().for_each(|block| block.compare(&mut fields)));
            sender
        });
        make_blocks(receivers, &plan, names, |block| {
            let block = Arc::new(block);
            for sender in &senders {
                // It fails only where the other end has panicked, which the end of the scope tells.
                let _ = sender.send(Arc::clone(&block));
            }
        })
    })
}

/// The fields in two parts of about as many samples.
fn halves<'m, 'a>(mut fields: Vec<Shared<'m, 'a>>, a: &Scan, b: &Scan) -> [Vec<Shared<'m, 'a>>; 2] {
    let samples = |field: &Shared| a.fields[field.slot].count + b.fields[field.slot].count;
    fields.sort_by_key(|field| std::cmp::Reverse(samples(field)));
    let mut halves = [(0, Vec::new()), (0, Vec::new())];
    for field in fields {
        let smaller = usize::from(halves[1].0 < halves[0].0);
        halves[smaller].0 += samples(&field);
        halves[smaller].1.push(field);
    }
    halves.map(|(_, fields)| fields)
}

/// Records that a thread reads ahead before it waits: so many a batch, and so many batches.
const BATCH: usize = 256;
const BATCHES: usize = 4;
/// Blocks that wait for being compared.
const BLOCKS: usize = 2;

/// Records of one recording in order of time, as numbers.
#[derive(Default)]
struct Batch {
    /// Instant, ns, and channel of each.
    records: Vec<(i64, Channel)>,
    /// The numbers of all fields of one record after those of another; not a number where there is none.
    numbers: Vec<f64>,
    /// Names that no batch before had, with the numbers that stand for them.
    names: Vec<(u64, String)>,
    /// What ended the reading after these records.
    error: Option<RecordingError>,
}

/// Sends the records of a recording in order of time until nobody wants them any more.
fn read_ahead(scan: &Scan, channels: &[Channel], entries: &[Entry], sender: &SyncSender<Batch>) {
    let mut records = match scan.sorted(channels) {
        Ok(records) => records,
        Err(error) => {
            // Nobody is left to tell only if the other recording has failed already.
            let _ = sender.send(Batch { error: Some(error), ..Batch::default() });
            return;
        }
    };
    let mut extractor = Extractor::new();
    let mut names = Names::default();
    loop {
        let mut batch = Batch::default();
        for read in records.by_ref().take(BATCH) {
            let (t_ns, record) = match read {
                Ok(read) => read,
                Err(error) => {
                    batch.error = Some(error);
                    break;
                }
            };
            batch.records.push((t_ns, record.channel()));
            extractor.each(&record, |slot, cell| {
                let Cell::Number(number) = cell else { return batch.numbers.push(f64::NAN) };
                batch.numbers.push(number);
                if entries[slot].law.names
                    && let Some(name) = names.learn(entries, slot, number, &record)
                {
                    batch.names.push((number.to_bits(), name.to_owned()));
                }
            });
        }
        let ends = batch.records.is_empty() || batch.error.is_some();
        if sender.send(batch).is_err() || ends {
            return;
        }
    }
}

/// How blocks are made.
struct Plan<'a> {
    map: &'a TimeMap,
    /// Where each channel's fields begin in the catalogue.
    slots: [usize; Channel::ALL.len()],
    /// By slot, whether the field is compared.
    wanted: Vec<bool>,
    /// `None` where nothing is drawn.
    stretches: Option<Stretches>,
}

/// Makes blocks of two recordings, until both are at their end.
fn make_blocks(
    receivers: [Receiver<Batch>; 2],
    plan: &Plan,
    names: &mut Names,
    mut take: impl FnMut(Block),
) -> Result<(), RecordingError> {
    let [a, b] = receivers;
    let mut sources = [Ahead::new(a, 0, plan.map, names)?, Ahead::new(b, 1, plan.map, names)?];
    let mut block = Block::new(plan.wanted.len());
    while let Some(side) = earlier(&sources) {
        let Some(head) = sources[side].head.take() else { break };
        let stretch = plan.stretches.zip(head.place).map_or(0, |(stretches, (t_ns, _))| stretches.find(t_ns));
        block.places[head.channel as usize].push(Place { side, at: head.place, stretch });
        for (slot, number) in (plan.slots[head.channel as usize]..).zip(sources[side].numbers(head.channel)) {
            if plan.wanted[slot] {
                block.numbers[slot].push(*number);
            }
        }
        sources[side].advance(&head, names)?;
        block.records += 1;
        if block.records == Block::RECORDS {
            take(std::mem::replace(&mut block, Block::new(plan.wanted.len())));
        }
    }
    take(block);
    Ok(())
}

/// The side whose next record comes first; `None` at the end of both.
fn earlier(sources: &[Ahead<'_>; 2]) -> Option<usize> {
    match (&sources[0].head, &sources[1].head) {
        (Some(a), Some(b)) => Some(usize::from(b.due_ns < a.due_ns)),
        (Some(_), None) => Some(0),
        (None, Some(_)) => Some(1),
        (None, None) => None,
    }
}

/// A recording's records with their places on A's clock.
struct Ahead<'a> {
    receiver: Receiver<Batch>,
    batch: Batch,
    /// The record of the batch that comes next, and where its numbers begin.
    next: usize,
    numbers_from: usize,
    side: usize,
    map: &'a TimeMap,
    head: Option<Head>,
}

/// The record that comes next.
struct Head {
    /// Its place, or that of the record before if it has none, ns.
    due_ns: i64,
    place: Option<(i64, u32)>,
    channel: Channel,
}

impl<'a> Ahead<'a> {
    fn new(
        receiver: Receiver<Batch>,
        side: usize,
        map: &'a TimeMap,
        names: &mut Names,
    ) -> Result<Self, RecordingError> {
        let mut ahead =
            Self { receiver, batch: Batch::default(), next: 0, numbers_from: 0, side, map, head: None };
        ahead.fetch(i64::MIN, names)?;
        Ok(ahead)
    }

    /// The numbers of the next record, which is of this channel.
    fn numbers(&self, channel: Channel) -> &[f64] {
        &self.batch.numbers[self.numbers_from..][..channel.fields().len()]
    }

    /// Goes on to the record after `done`.
    fn advance(&mut self, done: &Head, names: &mut Names) -> Result<(), RecordingError> {
        self.next += 1;
        self.numbers_from += done.channel.fields().len();
        self.fetch(done.due_ns, names)
    }

    fn fetch(&mut self, before_ns: i64, names: &mut Names) -> Result<(), RecordingError> {
        while self.next == self.batch.records.len() {
            if let Some(error) = self.batch.error.take() {
                return Err(error);
            }
            // Nobody sends any more: this is the end.
            let Ok(batch) = self.receiver.recv() else { return Ok(()) };
            (self.batch, self.next, self.numbers_from) = (batch, 0, 0);
            names.add(std::mem::take(&mut self.batch.names));
        }
        let (t_ns, channel) = self.batch.records[self.next];
        let place = self.map.place(self.side, t_ns);
        self.head = Some(Head { due_ns: place.map_or(before_ns, |(t_ns, _)| t_ns), place, channel });
        Ok(())
    }
}
