//! Two recordings with their clocks brought together, and what a set of repeats differs by.

use super::{
    Align, DiffError, DiffOptions,
    align::{TimeMap, align, coverage},
    compare::compare,
    law::{Entry, Interpolation, catalogue},
    merge::{Axis, Outcome, Setup},
    report::{Alignment, Coverage, Reason, Tolerance, ToleranceOrigin},
    scan::Scan,
    tolerance::Floor,
};
use crate::{Field, Mode, RecordingError};

/// Held values may be so many sampling intervals apart between clocks that do not tick together: one, and half of it
/// for the jitter of a loop in real time.
const HELD_INTERVALS: f64 = 1.5;
/// But not more than this, s.
const HELD_MAX_S: f64 = 0.5;

/// Whether two simulations may tick together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Timing {
    /// Two simulations on one clock do.
    Lockstep,
    /// Each recording has a time of its own, as a flight in real time has.
    Real,
}

pub(super) struct Pair<'a> {
    pub a: &'a Scan,
    pub b: &'a Scan,
    pub entries: Vec<Entry>,
    pub alignment: Alignment,
    pub coverage: Coverage,
    map: TimeMap,
    timing: Timing,
}

impl<'a> Pair<'a> {
    pub fn new(a: &'a Scan, b: &'a Scan, wanted: Align, timing: Timing) -> Self {
        let (map, alignment) = align(wanted, a, b, timing);
        let coverage = coverage(&map, a, b);
        Self { a, b, entries: catalogue(), alignment, coverage, map, timing }
    }

    pub fn modes(&self) -> [Mode; 2] {
        [self.a, self.b].map(|scan| scan.source.session().mode)
    }

    /// The unit of a field, A's where they differ.
    pub fn unit(&self, entry: &Entry) -> &'static str {
        let unit = self.a.unit(entry.field).or(self.b.unit(entry.field));
        unit.unwrap_or(Field::ACTUATION)
    }

    /// Why a field is not compared, if there is a reason before looking at its samples.
    pub fn obstacle(&self, slot: usize) -> Option<Reason> {
        let field = self.entries[slot].field;
        let (a, b) = (self.a.unit(field), self.b.unit(field));
        let counts = [self.a, self.b].map(|scan| scan.fields[slot].count);
        match counts {
            [_, 0] => Some(Reason::OnlyInA),
            [0, _] => Some(Reason::OnlyInB),
            _ if a != b => Some(Reason::UnitDiffers { a: a.map(str::to_owned), b: b.map(str::to_owned) }),
            _ => None,
        }
    }

    /// The time tolerance of a field unless one is given, s.
    pub fn sampling_s(&self, slot: usize) -> f64 {
        let one_clock = self.timing == Timing::Lockstep
            && self.modes() == [Mode::Sim; 2]
            && self.alignment.used == Align::None;
        if one_clock || self.entries[slot].law.interpolation == Interpolation::Linear {
            return 0.0;
        }
        let usual_ns = [self.a, self.b].map(|scan| scan.fields[slot].intervals.usual_ns());
        (HELD_INTERVALS * usual_ns[0].max(usual_ns[1]) * 1e-9).min(HELD_MAX_S)
    }

    /// Compares all fields that can be; one outcome a slot of the catalogue. Lags, and traces of so many stretches, are
    /// found only if asked for.
    pub fn compare(
        &self,
        tolerance: impl Fn(usize) -> Tolerance,
        trace_stretches: Option<usize>,
    ) -> Result<Vec<Option<Outcome>>, RecordingError> {
        let setup = |slot: usize| {
            self.obstacle(slot).is_none().then(|| Setup {
                law: self.entries[slot].law,
                tolerance: tolerance(slot),
                gaps_ns: [self.a, self.b].map(|scan| scan.fields[slot].intervals.gap_ns()),
                lag: trace_stretches.is_some() && !self.entries[slot].law.bookkeeping,
            })
        };
        let setups: Vec<Option<Setup>> = (0..self.entries.len()).map(setup).collect();
        let (from_ns, until_ns) = self.map.span_ns(self.a, self.b);
        let axis = trace_stretches.filter(|stretches| *stretches > 0);
        let axis = axis.map(|stretches| Axis { from_ns, until_ns, stretches });
        compare(self.a, self.b, &self.map, &setups, axis)
    }
}

/// What repeats differ by, pair by pair, by slot of the catalogue; `None` for fields that no pair shares, or in whole
/// without repeats.
pub(super) fn floors(options: &DiffOptions) -> Result<Option<Vec<Option<Floor>>>, DiffError> {
    if options.floor.is_empty() {
        return Ok(None);
    }
    let scans = options.floor.iter().map(|path| Scan::read(path)).collect::<Result<Vec<_>, _>>()?;
    let mut floors: Vec<Option<Floor>> = vec![None; catalogue().len()];
    for (place, a) in scans.iter().enumerate() {
        for b in &scans[place + 1..] {
            let pair = Pair::new(a, b, options.align, Timing::Lockstep);
            let exact = |slot| Tolerance {
                time_s: pair.sampling_s(slot),
                ..Tolerance::exact(ToleranceOrigin::Floor)
            };
            for (floor, outcome) in floors.iter_mut().zip(pair.compare(exact, None)?) {
                if let Some(outcome) = outcome {
                    floor.get_or_insert_default().add(&outcome);
                }
            }
        }
    }
    Ok(Some(floors))
}
