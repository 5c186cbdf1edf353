//! One field of both recordings: its samples against those that answer to them.

use super::{
    law::{Interpolation, Law, difference},
    merge::{Axis, Outcome, Setup, Taken},
    names::Names,
    series::{Series, best_shift},
    tally::Tally,
    trace::{TraceBuilder, TraceTimes},
    track::{Around, Counterpart, Digest, Spot},
};

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
    digests: [Digest; 2],
    tally: Tally,
    series: Option<[Series; 2]>,
    trace: Option<TraceBuilder>,
}

impl FieldMerge {
    pub fn new(column: usize, slot: usize, setup: Setup, axis: Option<Axis>) -> Self {
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

    pub fn add(&mut self, taken: &[Taken], number: impl Fn(usize) -> f64) {
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

    pub fn judge(&mut self, counterpart: &Counterpart, around: Option<&Around>) {
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
    pub fn finish(
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
