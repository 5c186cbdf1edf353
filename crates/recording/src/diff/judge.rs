//! One field of both recordings: its samples against those that answer to them.

use std::ops::Range;

use super::{
    law::{Interpolation, Law, difference, wrapped},
    merge::{Axis, Outcome, Setup},
    names::Names,
    series::{Bins, Sums, best_shift},
    tally::Tally,
    trace::{DIFFERENCE, Runs, TraceBuilder, TraceTimes},
    track::{Around, Counterpart, Spot},
};

/// Rows of a block that count.
#[derive(Default)]
pub(super) struct Taken {
    rows: Vec<Range<usize>>,
    runs: Runs,
}

impl Taken {
    pub fn push(&mut self, row: usize, stretch: u32) {
        match self.rows.last_mut() {
            Some(rows) if rows.end == row => rows.end += 1,
            _ => self.rows.push(row..row + 1),
        }
        self.runs.push(stretch);
    }
}

/// Samples with what answers to them, for all fields of a group.
#[derive(Default)]
pub(super) struct Counterparts {
    pub all: Vec<Counterpart>,
    /// One a counterpart; none without a time tolerance.
    pub arounds: Vec<Around>,
    /// Where the samples are drawn.
    pub runs: Runs,
    sequences: Vec<Sequence>,
}

/// Counterparts in a row of samples of one recording.
struct Sequence {
    side: usize,
    range: Range<usize>,
    /// The samples follow one another, and so do the samples that answer to them.
    is_straight: bool,
}

/// Straight sequences of fewer samples are not worth their own.
const STRAIGHT_MIN: usize = 8;

impl Counterparts {
    pub fn push(&mut self, counterpart: Counterpart, around: Option<Around>) {
        let follows = self.all.last().is_some_and(|before| before.is_followed_by(&counterpart));
        match self.sequences.last_mut() {
            Some(sequence) if sequence.side == counterpart.side => {
                if !sequence.is_straight || follows || sequence.range.len() < STRAIGHT_MIN {
                    sequence.is_straight &= follows;
                    sequence.range.end += 1;
                } else {
                    self.begin(counterpart.side);
                }
            }
            _ => self.begin(counterpart.side),
        }
        self.all.push(counterpart);
        self.arounds.extend(around);
    }

    fn begin(&mut self, side: usize) {
        let next = self.all.len();
        self.sequences.push(Sequence { side, range: next..next + 1, is_straight: true });
    }

    pub fn clear(&mut self) {
        self.all.clear();
        self.arounds.clear();
        self.runs.clear();
        self.sequences.clear();
    }
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

/// One field of both recordings.
pub(super) struct FieldMerge {
    pub column: usize,
    pub slot: usize,
    setup: Setup,
    /// By side, beside the instants of the group's tracks.
    pub values: [Vec<f64>; 2],
    /// Whether all samples that both recordings have so far are the same, one after the other.
    pub same: bool,
    tally: Tally,
    series: Option<[Sums; 2]>,
    trace: Option<TraceBuilder>,
    /// Of the samples that were compared last, B less A.
    differences: Vec<f64>,
    /// Samples that do not follow one another.
    gathered: Vec<f64>,
}

impl FieldMerge {
    pub fn new(column: usize, slot: usize, setup: Setup, axis: Option<Axis>) -> Self {
        let draws = !setup.law.names && setup.law.interpolation != Interpolation::None;
        Self {
            column,
            slot,
            values: [Vec::new(), Vec::new()],
            same: true,
            tally: Tally::default(),
            series: (setup.lag && !setup.law.exact && !setup.law.wraps).then(Default::default),
            trace: axis.filter(|_| draws).map(TraceBuilder::new),
            differences: Vec::new(),
            gathered: Vec::new(),
            setup,
        }
    }

    /// Adds samples of A (0) or B (1) from the rows of their column.
    pub fn add(&mut self, side: usize, taken: &Taken, column: &[f64], bins: &Bins) {
        let values = &mut self.values[side];
        let from = values.len();
        for rows in &taken.rows {
            values.extend_from_slice(&column[rows.clone()]);
        }
        let added = &values[from..];
        if let Some(series) = &mut self.series {
            series[side].add(bins, added);
        }
        if let Some(trace) = &mut self.trace {
            trace.add(side, &taken.runs, added);
        }
    }

    /// Whether samples of A and B are the same, to the bit.
    pub fn is_same(&self, in_a: &Range<usize>, in_b: &Range<usize>) -> bool {
        let bits =
            |side: usize, range: &Range<usize>| self.values[side][range.clone()].iter().map(|x| x.to_bits());
        bits(0, in_a).eq(bits(1, in_b))
    }

    pub fn compare(&mut self, counterparts: &Counterparts) {
        self.differences.clear();
        let law = self.setup.law;
        let one_by_one =
            law.exact || law.interpolation == Interpolation::None || !counterparts.arounds.is_empty();
        if one_by_one {
            let mut tally = self.tally;
            for (place, counterpart) in counterparts.all.iter().enumerate() {
                let found = self.judge(&mut tally, counterpart, counterparts.arounds.get(place));
                self.differences.extend(found);
            }
            self.tally = tally;
        } else {
            counterparts.sequences.iter().for_each(|sequence| self.compare_all(&counterparts.all, sequence));
        }
        if let Some(trace) = &mut self.trace {
            trace.add(DIFFERENCE, &counterparts.runs, &self.differences);
        }
    }

    /// Compares samples that are numbers and have something at the same instant.
    fn compare_all(&mut self, counterparts: &[Counterpart], sequence: &Sequence) {
        let Setup { law, tolerance, .. } = self.setup;
        let counterparts = &counterparts[sequence.range.clone()];
        let (own, others) = (&self.values[sequence.side], &self.values[1 - sequence.side]);
        let from = self.differences.len();
        let values = match counterparts[0] {
            Counterpart { sample, instant: Some(Spot::At(place)), .. } if sequence.is_straight => {
                let values = &own[sample..sample + counterparts.len()];
                let others = &others[place..place + counterparts.len()];
                self.differences.extend(others.iter().zip(values).map(|(there, here)| there - here));
                values
            }
            _ => {
                self.gathered.clear();
                for counterpart in counterparts {
                    let spot = counterpart.instant.expect("there is a value at each sample's instant");
                    let value = own[counterpart.sample];
                    self.gathered.push(value);
                    self.differences.push(spot.value(law, others) - value);
                }
                &self.gathered
            }
        };
        let differences = &mut self.differences[from..];
        if law.wraps {
            for difference in differences.iter_mut() {
                *difference = wrapped(*difference);
            }
        }
        let time = |place: usize| counterparts[place].at.t_ns;
        self.tally.add_all(sequence.side, values, differences, time, &tolerance);
    }

    /// The difference of a sample, B less A, unless there is none.
    fn judge(&self, tally: &mut Tally, counterpart: &Counterpart, around: Option<&Around>) -> Option<f64> {
        let Setup { law, tolerance, .. } = self.setup;
        let &Counterpart { side, sample, at, instant } = counterpart;
        let value = self.values[side][sample];
        let Some(found) = match_sample(law, value, &self.values[1 - side], instant, around) else {
            tally.beyond(at.t_ns, side, value, None);
            return None;
        };
        let there = value + found.now;
        let b_less_a = if side == 0 { found.now } else { -found.now };
        if !law.names {
            tally.add(at.t_ns, b_less_a, found.off, tolerance.rms);
        }
        let allowed = tolerance.absolute.max(tolerance.relative * value.abs().max(there.abs()));
        // Most samples are so clearly not the worst one that the division is not worth it.
        let is_clearly_less = found.off < 0.999 * tally.worst * allowed;
        if !law.exact && found.off > 0.0 && !is_clearly_less {
            tally.worst = tally.worst.max(found.off / allowed);
        }
        if found.off > allowed {
            tally.beyond(at.t_ns, side, value, Some(there));
        }
        Some(b_less_a)
    }

    /// `compared`, `same_instants`, `bins` and `times` are those of the group.
    pub fn finish(
        self,
        compared: [u64; 2],
        same_instants: bool,
        bins: &[Bins; 2],
        times: Option<&TraceTimes>,
        names: [&Names; 2],
    ) -> Outcome {
        let same = same_instants && self.same;
        let differs = self.tally.largest > 0.0;
        let shift = self.series.as_ref().filter(|_| differs).and_then(|[a, b]| best_shift(bins, [a, b]));
        let name = |number: Option<f64>| match number {
            None => "nothing",
            Some(number) => names.into_iter().find_map(|names| names.get(number)).unwrap_or("another text"),
        };
        let first = self.tally.first_ns.filter(|_| self.setup.law.names);
        Outcome {
            compared,
            same,
            names: first.map(|_| self.tally.first.map(|number| name(number).to_owned())),
            tally: self.tally,
            shift,
            trace: self.trace.zip(times).map(|(trace, times)| trace.finish(times, same)),
        }
    }
}
