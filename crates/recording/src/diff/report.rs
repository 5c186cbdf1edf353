use serde::{Deserialize, Serialize};

use super::{Align, Interpolation};

/// What [`super::diff`] found; as JSON it is `bench.diff/1` (docs/diff.md). All times are on A's clock, s, unless a field
/// says otherwise; no number is ever infinite or NaN.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DiffReport {
    /// [`DiffReport::SCHEMA`].
    pub schema: String,
    /// What it comes to.
    pub verdict: Verdict,
    /// The same in one line of words.
    pub summary: String,
    /// The first recording.
    pub a: RecordingSummary,
    /// The second recording.
    pub b: RecordingSummary,
    /// How the clocks were brought together.
    pub alignment: Alignment,
    /// How much of the flights both recordings hold.
    pub coverage: Coverage,
    /// The repeat recordings that tolerances were derived from.
    pub floor: Vec<String>,
    /// The rig that tolerances were derived from, where they were.
    pub derived: Option<DerivedFrom>,
    /// What a reader should know about how it was compared.
    pub notes: Vec<String>,
    /// Every field that either recording has, those that matter most first.
    pub fields: Vec<FieldReport>,
}

impl DiffReport {
    /// Name and version of the JSON form.
    pub const SCHEMA: &'static str = "bench.diff/1";

    /// What it comes to: [`Verdict::Same`] and [`Verdict::WithinTolerance`] pass; [`Verdict::Different`] and
    /// [`Verdict::NotComparable`] (nothing could be compared) do not.
    pub fn verdict(&self) -> Verdict {
        self.verdict
    }
}

/// What a comparison comes to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// Every sample has an equal one at an equal time, to the bit, once aligned.
    Same,
    /// No difference beyond the tolerance.
    WithinTolerance,
    /// Differences beyond the tolerance.
    Different,
    /// Only one of the recordings has it.
    Missing,
    /// Nothing can be said; [`FieldReport::reason`] says why.
    NotComparable,
}

impl Verdict {
    /// Whether a check passes.
    pub const fn passes(self) -> bool {
        matches!(self, Self::Same | Self::WithinTolerance)
    }

    /// As printed.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Same => "same",
            Self::WithinTolerance => "within tolerance",
            Self::Different => "different",
            Self::Missing => "missing",
            Self::NotComparable => "not comparable",
        }
    }
}

/// What tolerances were derived from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DerivedFrom {
    /// The rig's name.
    pub rig: String,
    /// The mission's name.
    pub mission: String,
    /// How many simulations of both; 0: the rig's numbers alone.
    pub simulations: usize,
    /// Chance that two more of them are called different, all fields together.
    pub family_error: f64,
}

/// One of the two recordings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RecordingSummary {
    /// The file as it was named.
    pub path: String,
    /// `sim`, `hil` or `import`.
    pub mode: String,
    /// The rig's name; empty where not known.
    pub rig: String,
    /// The mission's name; empty where not known.
    pub mission: String,
    /// Seed of a simulation's noise.
    pub seed: Option<u64>,
    /// Records read.
    pub records: u64,
    /// Its first record, by its own clock, s.
    pub first_s: f64,
    /// Its last record, by its own clock, s.
    pub last_s: f64,
    /// The unit of its sticks, where its rig says so.
    pub actuation: Option<String>,
    /// Its phases, by its own clock.
    pub phases: Vec<PhaseSpan>,
}

/// A phase of one recording.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PhaseSpan {
    /// Its name.
    pub phase: String,
    /// From when, s.
    pub from_s: f64,
    /// Until when, s.
    pub until_s: f64,
}

/// How the clocks were brought together.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Alignment {
    /// What was asked for.
    pub wanted: Align,
    /// What was done; never [`Align::Auto`].
    pub used: Align,
    /// Why it was done so.
    pub reason: String,
    /// B's clock less A's at the start of A (by clock) or when the idle phase is left (by phase), s.
    pub offset_s: f64,
    /// One sigma of the offset, s; by clock only.
    pub offset_std_s: Option<f64>,
    /// How much faster B's clock runs, millionths; 0 where it cannot be told from 0. By clock only.
    pub drift_ppm: Option<f64>,
    /// One sigma of the drift, millionths.
    pub drift_std_ppm: Option<f64>,
    /// Correlation of the signal once aligned, 0 to 1.
    pub correlation: Option<f64>,
    /// The field that served to align by clock.
    pub signal: Option<String>,
    /// The phases that were brought together, idle left out; by phase only.
    pub segments: Vec<Segment>,
}

/// A phase that both recordings go through.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Segment {
    /// Its name in A.
    pub phase: String,
    /// When it starts in A, by A's clock, s.
    pub a_from_s: f64,
    /// When it starts in B, by B's clock, s.
    pub b_from_s: f64,
    /// How long it lasts in A, s.
    pub a_duration_s: f64,
    /// How long it lasts in B, s. What one has more than the other is not compared.
    pub b_duration_s: f64,
}

/// How much of the flights (from leaving the idle phase to the end; the whole recordings without phases) is shared.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Coverage {
    /// Length of A's flight, s.
    pub a_s: f64,
    /// Length of B's flight, s.
    pub b_s: f64,
    /// What both hold once aligned, s.
    pub shared_s: f64,
    /// The same as a share of the longer flight, 0 to 1.
    pub share: f64,
    /// Whether that share is as large as asked for.
    pub enough: bool,
}

/// One field of one channel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FieldReport {
    /// Topic.
    pub channel: String,
    /// Name.
    pub field: String,
    /// Unit, A's where they differ; empty where there is none.
    pub unit: String,
    /// What the comparison comes to.
    pub verdict: Verdict,
    /// Why the field does not count in the report's verdict; `None`: it counts.
    pub excluded: Option<Exclusion>,
    /// Why it is missing or not comparable.
    pub reason: Option<Reason>,
    /// What was taken for values between samples.
    pub interpolation: Interpolation,
    /// How many samples there were.
    pub samples: Samples,
    /// What it may differ by; `None` where it was not compared.
    pub tolerance: Option<Tolerance>,
    /// What it differs by; `None` where it was not compared.
    pub difference: Option<Difference>,
    /// The time shift that best explains the difference, where one explains at least half of it.
    pub lag: Option<Lag>,
    /// Both series, decimated; `None` for names and for fields that were not compared.
    pub trace: Option<Trace>,
}

impl FieldReport {
    /// Topic and name: `/tracker/position/position_m.z`.
    pub fn path(&self) -> String {
        format!("{}/{}", self.channel, self.field)
    }

    /// Whether it decides the report's verdict.
    pub fn counts(&self) -> bool {
        self.excluded.is_none()
    }
}

/// Why a field does not count in the report's verdict.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Exclusion {
    /// A rule says to ignore it.
    Ignored,
    /// It tells how the recording was made, and the two were not both simulated.
    Bookkeeping,
    /// Recordings of two modes need not hold the same fields.
    ModesDiffer,
}

impl Exclusion {
    /// As printed.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ignored => "ignored",
            Self::Bookkeeping => "bookkeeping",
            Self::ModesDiffer => "modes differ",
        }
    }
}

/// Why a field has no comparison.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Reason {
    /// Only A has samples of it.
    OnlyInA,
    /// Only B has samples of it.
    OnlyInB,
    /// The rigs command in different units; `None` where no rig says which.
    UnitDiffers {
        /// A's.
        a: Option<String>,
        /// B's.
        b: Option<String>,
    },
    /// No sample of one has a value of the other at its time, once aligned.
    NoOverlap,
    /// A line needs two samples.
    TooFewSamples,
}

impl std::fmt::Display for Reason {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let unit = |unit: &Option<String>| unit.clone().unwrap_or_else(|| "unknown".to_owned());
        match self {
            Self::OnlyInA => f.write_str("only in A"),
            Self::OnlyInB => f.write_str("only in B"),
            Self::UnitDiffers { a, b } => write!(f, "unit differs: {} in A, {} in B", unit(a), unit(b)),
            Self::NoOverlap => f.write_str("no overlap in time"),
            Self::TooFewSamples => f.write_str("too few samples"),
        }
    }
}

/// Samples of one field. Not compared are those before the other recording's start or after its end, in its gaps, and
/// those of the longer of two phases.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Samples {
    /// In A.
    pub a: u64,
    /// In B.
    pub b: u64,
    /// Of A that were compared with B.
    pub a_compared: u64,
    /// Of B that were compared with A.
    pub b_compared: u64,
    /// Of A that are no finite number, or beyond 1e100; they are left out.
    pub a_unusable: u64,
    /// Of B.
    pub b_unusable: u64,
}

/// What a field may differ by. A sample is beyond it if no value of the other recording within `time_s` lies within the
/// larger of `absolute` and `relative` times the larger magnitude.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tolerance {
    /// In the field's unit.
    pub absolute: f64,
    /// A share of the larger of the two magnitudes.
    pub relative: f64,
    /// s
    pub time_s: f64,
    /// Largest RMS of what remains of the difference after `time_s`, from repeats.
    pub rms: Option<f64>,
    /// Largest size of the mean difference, from simulated repeats.
    pub mean: Option<f64>,
    /// Largest share of samples beyond it, from repeats; for names and flags.
    pub share: Option<f64>,
    /// Where it comes from.
    pub origin: ToleranceOrigin,
}

impl Tolerance {
    /// No tolerance at all.
    pub(super) const fn exact(origin: ToleranceOrigin) -> Self {
        Self { absolute: 0.0, relative: 0.0, time_s: 0.0, rms: None, mean: None, share: None, origin }
    }
}

/// Where a tolerance comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ToleranceOrigin {
    /// Built in, by unit.
    Default,
    /// No tolerance was wanted.
    Exact,
    /// What the rig attached to the recordings resolves.
    Rig,
    /// The differences among simulations of the rig and mission attached to the recordings.
    Repeats,
    /// The differences among repeat recordings.
    Floor,
    /// A file or a flag.
    Given,
}

/// What a field differs by: B less A at the samples of both, unless it says otherwise. For names only the counts are
/// known.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Difference {
    /// Largest absolute difference at one instant.
    pub largest: Option<f64>,
    /// When that is.
    pub largest_at_s: Option<f64>,
    /// Root of the mean squared difference.
    pub rms: Option<f64>,
    /// Mean difference, with its sign.
    pub mean: Option<f64>,
    /// Samples beyond the tolerance.
    pub beyond: u64,
    /// The first of them; where only the RMS is beyond its tolerance, the first sample beyond that.
    pub first_s: Option<f64>,
    /// Names at the first sample beyond the tolerance, A's and B's.
    pub first_names: Option<[String; 2]>,
    /// The worst sample's difference over its tolerance (or the RMS or the mean over its own, if that is more); `None` where the
    /// tolerance is 0. `sizes` tells which of them it is.
    pub times_tolerance: Option<f64>,
    /// Each size of the difference that has a tolerance, the one furthest beyond it first. None for names.
    #[serde(default)]
    pub sizes: Vec<Size>,
}

/// One size of a difference against the tolerance of that size.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Size {
    /// Which.
    pub of: SizeOf,
    /// What remains of it after the time tolerance, in the field's unit; of the mean the whole, with its sign.
    pub value: f64,
    /// How many times its tolerance it is; `None` where that is 0 and it is not.
    pub times_tolerance: Option<f64>,
}

impl Size {
    /// Whether it is more than it may be.
    pub fn is_beyond(&self) -> bool {
        self.times_tolerance.is_none_or(|times| times > 1.0)
    }
}

/// What a difference is measured by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SizeOf {
    /// The largest one of any sample.
    Largest,
    /// The root of its mean square.
    Rms,
    /// Its mean.
    Mean,
}

impl SizeOf {
    /// As printed.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Largest => "largest",
            Self::Rms => "rms",
            Self::Mean => "mean",
        }
    }
}

/// A time shift between two series.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Lag {
    /// How much later B is, s.
    pub lag_s: f64,
    /// Share of the mean squared difference that it explains, 0.5 to 1.
    pub explained: f64,
    /// The step at which it was searched; it is interpolated between steps, s.
    pub step_s: f64,
}

/// Series for drawing: lists of `[time, least, greatest]` of equal stretches of time, with `null` where there is a gap.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Trace {
    /// Start of the time axis, s; equal for all fields.
    pub from_s: f64,
    /// End of the time axis, s.
    pub until_s: f64,
    /// A.
    pub a: Vec<Option<[f64; 3]>>,
    /// B; empty if it is the same as A.
    pub b: Vec<Option<[f64; 3]>>,
    /// B less A; empty if B is the same as A.
    pub difference: Vec<Option<[f64; 3]>>,
}
