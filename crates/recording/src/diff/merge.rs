//! Fields of one channel in two recordings that come in one order of time: each sample against the other recording.
//!
//! Memory is bounded by the time tolerance and the gaps that are bridged, not by the recordings' length: a group keeps
//! the samples of [`Group::reach_ns`] or so on either side.

use super::{
    compared::FieldMerge,
    law::{Interpolation, Law},
    names::Names,
    report::{Tolerance, Trace},
    series::Shift,
    tally::Tally,
    trace::TraceTimes,
    track::{Around, Counterpart, Cursors, Instant, Track},
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
pub(super) struct Taken {
    pub side: usize,
    pub row: usize,
    pub instant: Instant,
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
