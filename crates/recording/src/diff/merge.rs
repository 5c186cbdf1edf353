//! Fields of one channel in two recordings that come in one order of time: each sample against the other recording.
//!
//! Memory is bounded by the time tolerance and the gaps that are bridged, not by the recordings' length: a group keeps
//! the samples of [`Group::reach_ns`] or so on either side.

use std::ops::Range;

use super::{
    law::{Interpolation, Law, wrapped},
    names::Names,
    report::{Tolerance, Trace},
    series::{Series, Shift, best_shift},
    trace::{TraceBuilder, TraceTimes},
};
use crate::Channel;

/// So many samples come before some are compared: a look at the windows costs as much as a sample.
const SETTLED_AT_ONCE: usize = 32;

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
/// When a sample was, on A's clock.
#[derive(Clone, Copy, Debug)]
struct Instant {
    t_ns: i64,
    /// Samples of different pieces have nothing between them.
    piece: u32,
    /// Where it is drawn.
    stretch: u32,
}

/// The instants at which one recording has samples of a group.
struct Track {
    /// In order of time. Those before `kept_from` are not needed any more.
    window: Vec<Instant>,
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

/// A place in a window at which there is a value.
#[derive(Clone, Copy, Debug)]
enum Spot {
    /// That of a sample.
    At(usize),
    /// On the line from a sample to the next one, by a share of it.
    Between(usize, f64),
}

impl Spot {
    fn value(self, law: Law, values: &[f64]) -> f64 {
        match self {
            Self::At(sample) => values[sample],
            Self::Between(before, share) => {
                let (before, next) = (values[before], values[before + 1]);
                before + difference(law, before, next) * share
            }
        }
    }
}

/// What lies within the time tolerance of a sample: where the tolerance begins and ends, and the other recording's samples between.
struct Around {
    ends: [Option<Spot>; 2],
    between: Range<usize>,
}

impl Around {
    fn is_empty(&self) -> bool {
        self.ends.iter().all(Option::is_none) && self.between.is_empty()
    }
}

/// A sample and where the other recording's values that it is compared with are.
struct Counterpart {
    side: usize,
    sample: usize,
    at: Instant,
    instant: Option<Spot>,
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

    fn push(&mut self, instant: Instant) -> bool {
        if instant.t_ns < self.last_ns {
            self.left_out += 1;
            return false;
        }
        self.last_ns = instant.t_ns;
        self.count += 1;
        self.digest.add(instant.t_ns.cast_unsigned());
        self.window.push(instant);
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

    /// Where the value at an instant is.
    fn at(&self, cursor: &mut usize, interpolation: Interpolation, t_ns: i64, piece: u32) -> Option<Spot> {
        let after = self.seek(cursor, |other_ns| other_ns <= t_ns);
        let place = after.checked_sub(1).filter(|before| *before >= self.kept_from)?;
        let before = self.window.get(place).filter(|sample| sample.piece == piece)?;
        let since_ns = t_ns.saturating_sub(before.t_ns);
        if since_ns == 0 {
            return Some(Spot::At(place));
        }
        match interpolation {
            Interpolation::None => None,
            Interpolation::Hold => (since_ns <= self.gap_ns).then_some(Spot::At(place)),
            Interpolation::Linear => {
                let next = self.window.get(after).filter(|sample| sample.piece == piece)?;
                let interval_ns = next.t_ns.saturating_sub(before.t_ns);
                (interval_ns <= self.gap_ns)
                    .then(|| Spot::Between(place, since_ns as f64 / interval_ns as f64))
            }
        }
    }

    /// Where the values within a time of a sample are: at the ends of that time, where there is a value, and all samples between
    /// them, those beyond a seam as well. What follows from a new phase, such as thrust, follows a little later in real time than in
    /// a simulation.
    fn around(
        &self,
        cursors: &mut Cursors,
        interpolation: Interpolation,
        sample: Instant,
        within_ns: i64,
    ) -> Around {
        let (from_ns, until_ns) =
            (sample.t_ns.saturating_sub(within_ns), sample.t_ns.saturating_add(within_ns));
        let [begin, end] = &mut cursors.ends;
        let ends = [
            self.at(begin, interpolation, from_ns, sample.piece),
            self.at(end, interpolation, until_ns, sample.piece),
        ];
        let first = self.seek(&mut cursors.first, |other_ns| other_ns < from_ns);
        let between = self.window[first..].iter().take_while(|other| other.t_ns <= until_ns).count();
        Around { ends, between: first..first + between }
    }

    /// Marks what was compared and lies before an instant as not needed.
    fn release(&mut self, before_ns: i64) {
        while self.kept_from < self.judged && self.window[self.kept_from].t_ns < before_ns {
            self.kept_from += 1;
        }
    }

    /// Forgets what is not needed; by how many samples all of the others' places are less from now on.
    fn prune(&mut self) -> usize {
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

/// `None` where the other recording has nothing.
fn match_sample(
    law: Law,
    value: f64,
    others: &[f64],
    instant: Option<Spot>,
    around: Option<&Around>,
) -> Option<Match> {
    let off = |spot: Spot| difference(law, value, spot.value(law, others));
    let instant = instant.map(off);
    let Some(around) = around else {
        return instant.map(|now| Match { now, off: now.abs() });
    };
    let ends = around.ends.into_iter().flatten().map(off);
    let between = others[around.between.clone()].iter().map(|other| difference(law, value, *other));
    let (mut low, mut high, mut least) = (f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY);
    for x in ends.chain(between).chain(instant) {
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

/// Where a record's sample belongs.
#[derive(Clone, Copy)]
pub(super) struct Place {
    pub side: usize,
    /// Instant on A's clock, ns, and piece; `None` where the other recording has no such instant.
    pub at: Option<(i64, u32)>,
    /// The stretch of the traces that it lies in.
    pub stretch: u32,
}

/// Records of one channel, of both recordings in one order of time.
#[derive(Default)]
pub(super) struct Rows {
    pub places: Vec<Place>,
    /// All fields of a record, one record after another; not a number where there is none.
    pub numbers: Vec<f64>,
}

/// A row that counts.
struct Taken {
    side: usize,
    row: usize,
    instant: Instant,
}

/// Fields of a channel that have their samples at the same instants and are looked up in the same way: where an instant lies in
/// the other recording is found once for all of them.
pub(super) struct Group<'a> {
    pub channel: Channel,
    interpolation: Interpolation,
    within_ns: i64,
    /// Where pieces of the alignment are cut short.
    cuts_ns: &'a [Option<[i64; 2]>],
    /// Instants of which both recordings have samples of anything; events outside are not looked for.
    shared_ns: (i64, i64),
    tracks: [Track; 2],
    /// Where A's instants lie in B's track, and B's in A's.
    cursors: [Cursors; 2],
    /// Samples since some were last compared.
    unsettled: usize,
    taken: Vec<Taken>,
    counterparts: Vec<Counterpart>,
    /// One a counterpart; none without a time tolerance.
    arounds: Vec<Around>,
    times: Option<TraceTimes>,
    fields: Vec<FieldMerge>,
}

/// The time tolerance, ns.
fn within_ns(setup: &Setup) -> i64 {
    (setup.tolerance.time_s * 1e9).round() as i64
}

impl<'a> Group<'a> {
    /// A group of one field, which is at `column` among its channel's fields and at `slot` in the catalogue.
    pub fn new(
        (channel, column, slot): (Channel, usize, usize),
        setup: Setup,
        shared_ns: (i64, i64),
        cuts_ns: &'a [Option<[i64; 2]>],
        axis: Option<Axis>,
    ) -> Self {
        Self {
            channel,
            interpolation: setup.law.interpolation,
            within_ns: within_ns(&setup),
            cuts_ns,
            shared_ns,
            tracks: setup.gaps_ns.map(Track::new),
            cursors: [Cursors::default(); 2],
            unsettled: 0,
            taken: Vec::new(),
            counterparts: Vec::new(),
            arounds: Vec::new(),
            times: axis.map(|axis| TraceTimes::new(axis, setup.gaps_ns[0].max(setup.gaps_ns[1]))),
            fields: vec![FieldMerge::new(column, slot, setup, axis)],
        }
    }

    /// Takes up another field of the channel that has its samples at the same instants; whether it can.
    pub fn adopt(&mut self, column: usize, slot: usize, setup: Setup, axis: Option<Axis>) -> bool {
        let is_alike = self.interpolation == setup.law.interpolation
            && self.within_ns == within_ns(&setup)
            && self.tracks.iter().map(|track| track.gap_ns).eq(setup.gaps_ns);
        if is_alike {
            self.fields.push(FieldMerge::new(column, slot, setup, axis));
        }
        is_alike
    }

    pub fn slots(&self) -> impl Iterator<Item = usize> {
        self.fields.iter().map(|field| field.slot)
    }

    /// How far from a sample the other recording's samples matter, ns.
    fn reach_ns(&self) -> i64 {
        self.within_ns + self.tracks[0].gap_ns.max(self.tracks[1].gap_ns)
    }

    /// Takes the channel's next records.
    pub fn take(&mut self, rows: &Rows) {
        let width = self.channel.fields().len();
        for (row, (place, numbers)) in rows.places.iter().zip(rows.numbers.chunks_exact(width)).enumerate() {
            if self.fields.iter().any(|field| numbers[field.column].is_nan()) {
                continue;
            }
            let Some((t_ns, piece)) = place.at else {
                self.tracks[place.side].left_out += 1;
                continue;
            };
            let instant = Instant { t_ns, piece, stretch: place.stretch };
            if !self.tracks[place.side].push(instant) {
                continue;
            }
            self.taken.push(Taken { side: place.side, row, instant });
            if let Some(times) = &mut self.times {
                times.value(place.side, place.stretch, t_ns);
            }
            // Both recordings come in one order of time, so all that is older than this has come.
            self.unsettled += 1;
            if self.unsettled == SETTLED_AT_ONCE {
                self.unsettled = 0;
                self.settle(t_ns.saturating_sub(self.reach_ns()));
            }
        }
        for field in &mut self.fields {
            let column = field.column;
            field.add(&self.taken, |row| rows.numbers[row * width + column]);
        }
        self.taken.clear();
        self.compare();
        for side in 0..2 {
            let spare = self.tracks[side].prune();
            if spare > 0 {
                self.cursors[1 - side].shift(spare);
                for field in &mut self.fields {
                    field.values[side].drain(..spare);
                }
            }
        }
    }

    /// Finds the counterparts of all samples before an instant.
    fn settle(&mut self, before_ns: i64) {
        for side in 0..2 {
            while let Some(&instant) = self.tracks[side].window.get(self.tracks[side].judged)
                && instant.t_ns < before_ns
            {
                self.find(side, self.tracks[side].judged, instant);
                self.tracks[side].judged += 1;
            }
        }
        let needed_ns = before_ns.saturating_sub(self.reach_ns());
        self.tracks.iter_mut().for_each(|track| track.release(needed_ns));
    }

    /// What answers to a sample may come earlier or later, by the time tolerance, and so lie in what is not compared.
    fn is_by_a_cut(&self, instant: Instant) -> bool {
        let cut = |piece: Option<usize>| piece.and_then(|piece| self.cuts_ns.get(piece).copied().flatten());
        let piece = instant.piece as usize;
        cut(Some(piece)).is_some_and(|[until_ns, _]| instant.t_ns > until_ns - self.within_ns)
            || cut(piece.checked_sub(1)).is_some_and(|[_, from_ns]| instant.t_ns < from_ns + self.within_ns)
    }

    /// Takes note of what a sample is compared with.
    fn find(&mut self, side: usize, sample: usize, at: Instant) {
        if self.is_by_a_cut(at) {
            return;
        }
        let (other, cursors) = (&self.tracks[1 - side], &mut self.cursors[side]);
        let instant = other.at(&mut cursors.instant, self.interpolation, at.t_ns, at.piece);
        let around =
            (self.within_ns != 0).then(|| other.around(cursors, self.interpolation, at, self.within_ns));
        let found = instant.is_some() || around.as_ref().is_some_and(|around| !around.is_empty());
        let expected = self.interpolation == Interpolation::None
            && (self.shared_ns.0..=self.shared_ns.1).contains(&at.t_ns);
        if found || expected {
            self.tracks[side].compared += 1;
            self.counterparts.push(Counterpart { side, sample, at, instant });
            self.arounds.extend(around);
            if let Some(times) = &mut self.times {
                times.difference(at.stretch, at.t_ns);
            }
        }
    }

    /// Compares the samples whose counterparts were found.
    fn compare(&mut self) {
        for field in &mut self.fields {
            for (place, counterpart) in self.counterparts.iter().enumerate() {
                field.judge(counterpart, self.arounds.get(place));
            }
        }
        self.arounds.clear();
        self.counterparts.clear();
    }

    /// What came out, by slot of the catalogue.
    pub fn finish(mut self, names: &Names) -> impl Iterator<Item = (usize, Outcome)> {
        self.settle(i64::MAX);
        self.compare();
        let (times, [a, b]) = (self.times, self.tracks);
        let same = a.count == b.count && a.left_out + b.left_out == 0 && a.digest == b.digest;
        let compared = [a.compared, b.compared];
        self.fields
            .into_iter()
            .map(move |field| (field.slot, field.finish(compared, same, times.as_ref(), names)))
    }
}

/// One field of both recordings.
struct FieldMerge {
    column: usize,
    slot: usize,
    setup: Setup,
    /// By side, beside the instants of the group's tracks.
    values: [Vec<f64>; 2],
    digests: [Digest; 2],
    tally: Tally,
    series: Option<[Series; 2]>,
    trace: Option<TraceBuilder>,
}

impl FieldMerge {
    fn new(column: usize, slot: usize, setup: Setup, axis: Option<Axis>) -> Self {
        let draws = !setup.law.names && setup.law.interpolation != Interpolation::None;
        Self {
            column,
            slot,
            values: [Vec::new(), Vec::new()],
            digests: [Digest::default(); 2],
            tally: Tally::default(),
            series: (setup.lag && !setup.law.exact && !setup.law.wraps)
                .then(|| [Series::new(), Series::new()]),
            trace: axis.filter(|_| draws).map(TraceBuilder::new),
            setup,
        }
    }

    fn add(&mut self, taken: &[Taken], number: impl Fn(usize) -> f64) {
        for &Taken { side, row, instant } in taken {
            let value = number(row);
            self.values[side].push(value);
            self.digests[side].add(value.to_bits());
            if let Some(series) = &mut self.series {
                series[side].push(instant.t_ns, value);
            }
            if let Some(trace) = &mut self.trace {
                trace.value(side, instant.stretch, value);
            }
        }
    }

    fn judge(&mut self, counterpart: &Counterpart, around: Option<&Around>) {
        let Setup { law, tolerance, .. } = self.setup;
        let &Counterpart { side, sample, at, instant } = counterpart;
        let value = self.values[side][sample];
        let Some(found) = match_sample(law, value, &self.values[1 - side], instant, around) else {
            self.tally.beyond(at.t_ns, side, value, None);
            return;
        };
        let there = value + found.now;
        if !law.names {
            let b_less_a = if side == 0 { found.now } else { -found.now };
            self.tally.add(at.t_ns, b_less_a, found.off, tolerance.rms);
            if let Some(trace) = &mut self.trace {
                trace.difference(at.stretch, b_less_a);
            }
        }
        let allowed = tolerance.absolute.max(tolerance.relative * value.abs().max(there.abs()));
        // Most samples are so clearly not the worst one that the division is not worth it.
        let is_clearly_less = found.off < 0.999 * self.tally.worst * allowed;
        if !law.exact && found.off > 0.0 && !is_clearly_less {
            self.tally.worst = self.tally.worst.max(found.off / allowed);
        }
        if found.off > allowed {
            self.tally.beyond(at.t_ns, side, value, Some(there));
        }
    }

    /// `compared`, `same_instants` and `times` are those of the group.
    fn finish(
        self,
        compared: [u64; 2],
        same_instants: bool,
        times: Option<&TraceTimes>,
        names: &Names,
    ) -> Outcome {
        let same = same_instants && self.digests[0] == self.digests[1];
        let differs = self.tally.largest > 0.0;
        let shift = self.series.as_ref().filter(|_| differs).and_then(|[a, b]| best_shift(a, b));
        let first = self.tally.first_ns.filter(|_| self.setup.law.names);
        Outcome {
            compared,
            same,
            names: first.map(|_| self.tally.first.map(|name| names.get(name))),
            tally: self.tally,
            shift,
            trace: self.trace.zip(times).map(|(trace, times)| trace.finish(times, same)),
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
