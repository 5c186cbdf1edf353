//! Fields of one channel in two recordings that come in one order of time: each sample against the other recording.
//!
//! Memory is bounded by the time tolerance and the gaps that are bridged, not by the recordings' length: a group keeps
//! the samples of [`Group::reach_ns`] or so on either side.

use std::ops::Range;

use super::{
    judge::{Counterparts, FieldMerge, Taken},
    law::{Interpolation, Law},
    names::Names,
    report::{Tolerance, Trace},
    rows::is_usable,
    series::{Bins, Shift},
    tally::Tally,
    trace::{DIFFERENCE, TraceTimes},
    track::{Counterpart, Cursors, Instant, Track},
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

/// Where a record's sample belongs.
#[derive(Clone, Copy)]
pub(super) struct Place {
    /// Instant on A's clock, ns; that of a record before where the other recording has no such instant.
    pub t_ns: i64,
    /// `None` where the other recording has no such instant.
    pub piece: Option<u32>,
    /// The stretch of the traces that it lies in.
    pub stretch: u32,
}

/// Records of one channel and recording, in order of time.
pub(super) struct Block {
    pub places: Vec<Place>,
    /// Column by column; not a number where there is none.
    numbers: Vec<f64>,
    width: usize,
}

impl Block {
    /// Most records of a block.
    pub const ROWS: usize = 512;
    /// From one column to the next: cache lines of all columns are to lie in sets of their own.
    const STRIDE: usize = Self::ROWS + 8;

    pub fn new(channel: Channel) -> Self {
        Self { places: Vec::new(), numbers: Vec::new(), width: channel.fields().len() }
    }

    pub fn push(&mut self, place: Place, numbers: &[f64]) {
        self.numbers.resize(self.width * Self::STRIDE, 0.0);
        let row = self.places.len();
        for (column, number) in self.numbers.chunks_exact_mut(Self::STRIDE).zip(numbers) {
            column[row] = if is_usable(*number) { *number } else { f64::NAN };
        }
        self.places.push(place);
    }

    fn column(&self, column: usize) -> &[f64] {
        if self.places.is_empty() { &[] } else { &self.numbers[column * Self::STRIDE..][..self.places.len()] }
    }
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
    /// By side, the bins of the decimated series.
    bins: [Bins; 2],
    times: Option<TraceTimes>,
    counterparts: Counterparts,
    /// The number of samples that were held against those of the same number in the other recording, while all were the same.
    seen_same: u64,
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
            bins: [Bins::new(), Bins::new()],
            counterparts: Counterparts::default(),
            seen_same: 0,
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

    /// How far from a sample the other recording's samples matter, ns.
    fn reach_ns(&self) -> i64 {
        self.within_ns + self.tracks[0].gap_ns.max(self.tracks[1].gap_ns)
    }

    /// Takes the channel's next records: these rows of each side's block, which come in this order of sides.
    pub fn take(&mut self, blocks: [&Block; 2], rows: &[Range<usize>; 2], order: &[usize]) {
        // Fields of a group have samples in the same rows.
        let columns = blocks.map(|block| block.column(self.fields[0].column));
        let mut next = [rows[0].start, rows[1].start];
        let mut taken = [Taken::default(), Taken::default()];
        for &side in order {
            let row = next[side];
            next[side] += 1;
            let Place { t_ns, piece, stretch } = blocks[side].places[row];
            if columns[side][row].is_nan() {
                continue;
            }
            let Some(piece) = piece else {
                self.tracks[side].left_out += 1;
                continue;
            };
            if !self.tracks[side].push(Instant { t_ns, piece, stretch }) {
                continue;
            }
            taken[side].push(row, stretch);
            self.bins[side].push(t_ns);
            if let Some(times) = &mut self.times {
                times.add(side, stretch, t_ns);
            }
            // Both recordings come in one order of time, so all that is older than this has come.
            self.unsettled += 1;
            if self.unsettled == SETTLED_AT_ONCE {
                self.unsettled = 0;
                self.settle(t_ns.saturating_sub(self.reach_ns()));
            }
        }
        for side in 0..2 {
            for field in &mut self.fields {
                field.add(side, &taken[side], blocks[side].column(field.column), &self.bins[side]);
            }
            self.bins[side].settle();
        }
        self.see_same();
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

    /// Goes on looking whether each sample of a recording has an equal one in the other at an equal time.
    fn see_same(&mut self) {
        let [a, b] = &self.tracks;
        let until = a.count.min(b.count);
        if self.seen_same == until || !self.fields.iter().any(|field| field.same) {
            return;
        }
        let samples = (until - self.seen_same) as usize;
        let window = |track: &Track| track.place(self.seen_same).map(|from| from..from + samples);
        let times = |track: &Track, range: &Range<usize>| -> Vec<i64> {
            track.window[range.clone()].iter().map(|instant| instant.t_ns).collect()
        };
        // Samples that are gone before the other recording's came were at another time.
        let windows = window(a).zip(window(b)).filter(|(in_a, in_b)| times(a, in_a) == times(b, in_b));
        for field in &mut self.fields {
            field.same &= windows.as_ref().is_some_and(|(in_a, in_b)| field.is_same(in_a, in_b));
        }
        self.seen_same = until;
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
            self.counterparts.push(Counterpart { side, sample, at, instant }, around);
            if let Some(times) = &mut self.times {
                self.counterparts.runs.push(at.stretch);
                times.add(DIFFERENCE, at.stretch, at.t_ns);
            }
        }
    }

    /// Compares the samples whose counterparts were found.
    fn compare(&mut self) {
        for field in &mut self.fields {
            field.compare(&self.counterparts);
        }
        self.counterparts.clear();
    }

    /// What came out, by slot of the catalogue.
    pub fn finish(mut self, names: [&Names; 2]) -> impl Iterator<Item = (usize, Outcome)> {
        self.settle(i64::MAX);
        self.compare();
        let Self { tracks: [a, b], bins, times, fields, .. } = self;
        let same = a.count == b.count && a.left_out + b.left_out == 0;
        let compared = [a.compared, b.compared];
        fields
            .into_iter()
            .map(move |field| (field.slot, field.finish(compared, same, &bins, times.as_ref(), names)))
    }
}
