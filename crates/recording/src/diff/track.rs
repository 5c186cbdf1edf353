//! When the samples of two recordings were, and where each lies among the other's.

use std::ops::Range;

use super::law::{Interpolation, Law, difference};

/// When a sample was, on A's clock.
#[derive(Clone, Copy, Debug)]
pub(super) struct Instant {
    pub t_ns: i64,
    /// Samples of different pieces have nothing between them.
    pub piece: u32,
    /// Where it is drawn.
    pub stretch: u32,
}

/// The instants at which one recording has samples of a group.
pub(super) struct Track {
    /// In order of time. Those before `kept_from` are not needed any more.
    pub window: Vec<Instant>,
    pub kept_from: usize,
    /// The first one that has not been compared.
    pub judged: usize,
    pub gap_ns: i64,
    pub count: u64,
    pub compared: u64,
    /// Samples without a counterpart on the other clock, or out of order beyond repair.
    pub left_out: u64,
    pub last_ns: i64,
}

/// Where instants lie among the samples of the other recording: the first sample behind each. Instants are looked up in order of
/// time, so that each look-up goes on from the one before.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Cursors {
    pub instant: usize,
    /// At the beginning and at the end of the time tolerance around it.
    pub ends: [usize; 2],
    /// The first sample within the time tolerance.
    pub first: usize,
}

impl Cursors {
    pub fn shift(&mut self, by: usize) {
        for cursor in [&mut self.instant, &mut self.first].into_iter().chain(&mut self.ends) {
            *cursor = cursor.saturating_sub(by);
        }
    }
}

/// A place in a window at which there is a value.
#[derive(Clone, Copy, Debug)]
pub(super) enum Spot {
    /// That of a sample.
    At(usize),
    /// On the line from a sample to the next one, by a share of it.
    Between(usize, f64),
}

impl Spot {
    pub fn value(self, law: Law, values: &[f64]) -> f64 {
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
pub(super) struct Around {
    pub ends: [Option<Spot>; 2],
    pub between: Range<usize>,
}

impl Around {
    pub fn is_empty(&self) -> bool {
        self.ends.iter().all(Option::is_none) && self.between.is_empty()
    }
}

/// A sample and where the other recording's values that it is compared with are.
pub(super) struct Counterpart {
    pub side: usize,
    pub sample: usize,
    pub at: Instant,
    pub instant: Option<Spot>,
}

impl Counterpart {
    /// Whether another sample comes right after this one, and so does the sample that answers to it.
    pub fn is_followed_by(&self, other: &Self) -> bool {
        let places_follow = match (self.instant, other.instant) {
            (Some(Spot::At(place)), Some(Spot::At(next))) => place + 1 == next,
            _ => false,
        };
        places_follow && self.sample + 1 == other.sample && self.side == other.side
    }
}

/// Room is made at a window's front once so many samples of it are not needed any more.
const SPARE_MAX: usize = 1024;

impl Track {
    pub fn new(gap_ns: i64) -> Self {
        Self {
            window: Vec::new(),
            kept_from: 0,
            judged: 0,
            gap_ns,
            count: 0,
            compared: 0,
            left_out: 0,
            last_ns: i64::MIN,
        }
    }

    pub fn push(&mut self, instant: Instant) -> bool {
        if instant.t_ns < self.last_ns {
            self.left_out += 1;
            return false;
        }
        self.last_ns = instant.t_ns;
        self.count += 1;
        self.window.push(instant);
        true
    }

    /// Where the sample of a number, counted from the first of all, is in the window; `None` if it is not needed any more.
    pub fn place(&self, number: u64) -> Option<usize> {
        let gone = self.count - self.window.len() as u64;
        number.checked_sub(gone).map(|place| place as usize)
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
    pub fn at(
        &self,
        cursor: &mut usize,
        interpolation: Interpolation,
        t_ns: i64,
        piece: u32,
    ) -> Option<Spot> {
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
    pub fn around(
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
    pub fn release(&mut self, before_ns: i64) {
        while self.kept_from < self.judged && self.window[self.kept_from].t_ns < before_ns {
            self.kept_from += 1;
        }
    }

    /// Forgets what is not needed; by how many samples all of the others' places are less from now on.
    pub fn prune(&mut self) -> usize {
        if self.kept_from < SPARE_MAX {
            return 0;
        }
        self.window.drain(..self.kept_from);
        self.judged -= self.kept_from;
        std::mem::take(&mut self.kept_from)
    }
}
