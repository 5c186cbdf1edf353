//! Compares two recordings, field by field: what is the same, what differs and by how much, what cannot be compared.
//!
//! [`diff`] reads each recording twice. The first pass counts, finds the phases and decimates the signals that clocks are
//! aligned by; then the clocks are brought together ([`Align`]), what each field may differ by is settled
//! ([`Tolerances`], or the differences among repeat recordings), and the second pass reads both at once in order of time
//! and takes each sample against the other recording. Memory does not grow with the recordings. How a field is compared
//! (on the line between samples, held, as an instant or a counter) is decided in one table.
//!
//! Both recordings are treated alike: A's samples are taken against B and B's against A, so that swapping the two swaps
//! signs and no more.

mod align;
mod clock;
mod compare;
mod derived;
mod error;
mod html;
mod judge;
mod keys;
mod law;
mod merge;
mod names;
mod pair;
mod plots;
mod report;
mod rows;
mod scan;
mod series;
mod sorter;
mod tally;
mod text;
mod tolerance;
mod trace;
mod track;
mod verdict;
mod wire;

use std::path::{Path, PathBuf};

pub use align::Align;
pub use derived::{Derived, Repeats};
pub use error::DiffError;
pub use html::{html_sections, html_verdict, render_html};
pub use keys::tolerance_keys;
pub use law::Interpolation;
pub use report::{
    Alignment, Coverage, DerivedFrom, DiffReport, Difference, Exclusion, FieldReport, Lag, PhaseSpan, Reason,
    RecordingSummary, Samples, Segment, Size, SizeOf, Tolerance, ToleranceOrigin, Trace, Verdict,
};
pub use text::render_text;
pub use tolerance::{ToleranceKey, Tolerances};

use pair::{Pair, Timing};
use scan::Scan;
use tolerance::{Limits, Measured};

/// How to compare.
#[derive(Clone, Debug, PartialEq)]
pub struct DiffOptions {
    /// How the clocks are brought together.
    pub align: Align,
    /// What fields may differ by, on top of the built-in tolerances and the floor.
    pub tolerances: Tolerances,
    /// Two or more recordings of the same thing, whose differences become the tolerances. Empty: built-in ones.
    pub floor: Vec<PathBuf>,
    /// What tolerances are derived from. `None`: nothing; the built-in ones hold, or the floor.
    pub derived: Option<Derived>,
    /// No tolerance at all: what is not the same is different. Stands alone.
    pub exact: bool,
    /// Whether time stamps, counters, durations and events count in the verdict. `None`: if both are simulations.
    pub bookkeeping: Option<bool>,
    /// The share of the longer flight that both must hold, 0 to 1, for the verdict to pass.
    pub coverage_min: f64,
    /// Into how many stretches of time a trace is decimated, 0 to 10 000; 0: no traces.
    pub trace_stretches: usize,
}

impl Default for DiffOptions {
    fn default() -> Self {
        Self {
            align: Align::Auto,
            tolerances: Tolerances::default(),
            floor: Vec::new(),
            derived: None,
            exact: false,
            bookkeeping: None,
            coverage_min: 0.8,
            trace_stretches: 240,
        }
    }
}

impl DiffOptions {
    fn check(&self) -> Result<(), DiffError> {
        let bad = |option, value: String, expected| Err(DiffError::BadOption { option, value, expected });
        if self.floor.len() == 1 {
            return bad("floor", "1 recording".to_owned(), "two or more recordings of the same thing");
        }
        if self.exact && (!self.floor.is_empty() || self.derived.is_some() || !self.tolerances.is_empty()) {
            return bad("exact", "true".to_owned(), "false where tolerances are given or derived");
        }
        if self.derived.is_some() && !self.floor.is_empty() {
            return bad("derived", "given".to_owned(), "absent beside a floor of repeats");
        }
        if !(0.0..=1.0).contains(&self.coverage_min) {
            return bad("coverage_min", self.coverage_min.to_string(), "from 0 to 1");
        }
        if self.trace_stretches > 10_000 {
            return bad("trace_stretches", self.trace_stretches.to_string(), "from 0 to 10000");
        }
        Ok(())
    }
}

/// Compares two recordings. Fails only if one cannot be read or the options make no sense; whatever the recordings hold
/// is told in the report.
pub fn diff(a: &Path, b: &Path, options: &DiffOptions) -> Result<DiffReport, DiffError> {
    options.check()?;
    let floors = pair::floors(options)?;
    let (a, b) = std::thread::scope(|scope| {
        let other = scope.spawn(|| Scan::read(b));
        let a = Scan::read(a);
        (a, other.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
    });
    let (a, b) = (a?, b?);
    let timing = if options.derived.is_some() { Timing::Real } else { Timing::Lockstep };
    let pair = Pair::new(&a, &b, options.align, timing);
    let limits: Vec<Limits> = pair
        .entries
        .iter()
        .enumerate()
        .map(|(slot, entry)| {
            if options.exact {
                return Limits { tolerance: Tolerance::exact(ToleranceOrigin::Exact), ignored: false };
            }
            let floor = floors.as_ref().and_then(|floors| floors[slot].as_ref());
            let measured = match (floor, &options.derived) {
                (Some(floor), _) => Measured::Floor(floor),
                (None, Some(derived)) => Measured::Derived(derived),
                (None, None) => Measured::Nothing,
            };
            options.tolerances.limits(entry, pair.unit(entry), pair.sampling_s(slot), measured)
        })
        .collect();
    let outcomes = pair.compare(|slot| limits[slot].tolerance, Some(options.trace_stretches))?;
    Ok(verdict::report(&pair, &limits, outcomes, options))
}
