//! Tolerances derived from the rig attached to the recordings: what it resolves, and how far simulated repeats scatter.

use bench_rig::Rig;
use serde::{Deserialize, Serialize};
use statrs::distribution::{ChiSquared, ContinuousCDF};

use super::{
    DiffError,
    law::{Entry, Interpolation, catalogue},
    merge::Outcome,
    pair::{Pair, Timing},
    report::{DerivedFrom, Tolerance, ToleranceOrigin},
    scan::{Scan, Source},
    tolerance::default_tolerance,
};
use crate::{Channel, Field, Record, Session};

/// Chance that two recordings of the rig and mission are called different, all fields together.
const FAMILY_ERROR: f64 = 0.01;
/// How sure that is, whichever repeats were flown.
const CONFIDENCE: f64 = 0.9;
/// Fewest repeats of which pairs can be held against the others.
const REPEATS_MIN: usize = 4;
/// Two numbers of one normal distribution differ by more than so many of its sigmas once in 370 times.
const NOISE_SIGMAS: f64 = 3.0 * std::f64::consts::SQRT_2;

/// What tolerances are derived from.
#[derive(Clone, Debug, PartialEq)]
pub struct Derived {
    /// The nominal rig of both recordings.
    pub rig: Rig,
    /// The mission's name.
    pub mission: String,
    /// How far simulations of both scatter; `None`: the rig's numbers stand alone.
    pub repeats: Option<Repeats>,
}

/// How far repeats of one flight scatter, field by field, and what two more of them may differ by.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Repeats {
    simulations: usize,
    /// Differences up to so many times the spread are taken as those of a repeat.
    factor: f64,
    /// By path of the field.
    spreads: Vec<(String, Spread)>,
}

/// Root mean squares, over the pairs of repeats, of what a field differs by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Spread {
    /// The largest difference.
    largest: f64,
    /// The RMS difference.
    rms: f64,
    /// The mean difference.
    mean: f64,
    /// The share of samples that disagree, of names, flags and events.
    share: f64,
}

/// What a field of one pair of repeats differs by.
#[derive(Clone, Copy, Debug)]
struct Apart {
    sizes: [f64; Spread::SIZES],
    /// The least share there can be: one sample.
    one_sample: f64,
}

impl Spread {
    const SIZES: usize = 4;

    fn of(squares: [f64; Self::SIZES], pairs: usize) -> Self {
        let [largest, rms, mean, share] = squares.map(|sum| (sum / pairs.max(1) as f64).sqrt());
        Self { largest, rms, mean, share }
    }
}

impl Apart {
    fn of(entry: &Entry, outcome: &Outcome) -> Self {
        let one_sample = 1.0 / (outcome.compared[0] + outcome.compared[1]).max(1) as f64;
        let tally = &outcome.tally;
        let sizes = if by_share(entry) {
            [0.0, 0.0, 0.0, tally.beyond as f64 * one_sample]
        } else {
            [tally.largest_off, tally.rms_off(), tally.mean().abs(), 0.0]
        };
        Self { sizes, one_sample }
    }
}

/// Whether a field's samples are equal or not, with nothing in between.
fn by_share(entry: &Entry) -> bool {
    entry.law.exact || entry.law.interpolation == Interpolation::None
}

impl Repeats {
    /// What simulations of one rig and mission differ by. They are compared as two recordings are that go by the phases of a
    /// mission, with the rig's time tolerances and no others.
    ///
    /// A pair's difference in a field, as largest, RMS and mean, is measured in spreads of the field among the pairs without
    /// either of the two. The largest such ratio over all fields is one number a pair; the factor is the upper predictive
    /// bound of that number, so that the chance of a false alarm is stated for all fields
    /// together, however they depend on each other.
    pub fn of(rig: &Rig, flights: Vec<(Session, Vec<Record>)>) -> Result<Self, DiffError> {
        let count = flights.len();
        if count < REPEATS_MIN {
            return Err(DiffError::BadOption {
                option: "repeats",
                value: count.to_string(),
                expected: "4 or more simulations",
            });
        }
        let scans = flights
            .into_iter()
            .map(|(session, records)| Scan::of(Source::memory(session, records)))
            .collect::<Result<Vec<_>, _>>()?;
        let entries = catalogue();
        let mut pairs: Vec<([usize; 2], Vec<Option<Apart>>)> = Vec::new();
        for a in 0..count {
            for b in a + 1..count {
                let pair = Pair::new(&scans[a], &scans[b], super::Align::Phase, Timing::Real);
                let exact = |slot: usize| Tolerance {
                    time_s: time_s(rig, pair.sampling_s(slot)),
                    ..Tolerance::exact(ToleranceOrigin::Repeats)
                };
                let outcomes = pair.compare(exact, None)?;
                let apart = entries.iter().zip(&outcomes);
                let apart =
                    apart.map(|(entry, outcome)| outcome.as_ref().map(|outcome| Apart::of(entry, outcome)));
                pairs.push(([a, b], apart.collect()));
            }
        }
        let unit = |entry: &Entry| match entry.field.unit {
            Field::ACTUATION => rig.airframe.actuation.unit(),
            unit => unit,
        };
        let resolved: Vec<f64> = entries
            .iter()
            .map(|entry| {
                resolution(entry, rig).unwrap_or(default_tolerance(entry, unit(entry), 0.0).absolute)
            })
            .collect();
        let spread = |slot: usize, left_out: &[usize]| {
            let mut squares = [0.0; Spread::SIZES];
            let mut counted = 0;
            for (members, apart) in &pairs {
                if let Some(apart) = apart[slot].filter(|_| !members.iter().any(|m| left_out.contains(m))) {
                    counted += 1;
                    for (sum, size) in squares.iter_mut().zip(apart.sizes) {
                        *sum += size * size;
                    }
                }
            }
            Spread::of(squares, counted)
        };
        let worst_ratio = |(members, apart): &([usize; 2], Vec<Option<Apart>>)| {
            let counted = apart.iter().enumerate().filter(|(slot, _)| !entries[*slot].law.bookkeeping);
            let ratios = counted.filter_map(|(slot, apart)| {
                let others = spread(slot, members);
                apart.map(|apart| ratio(apart, &others, resolved[slot]))
            });
            ratios.fold(1.0, f64::max)
        };
        let worst: Vec<f64> = pairs.iter().map(worst_ratio).collect();
        Ok(Self {
            simulations: count,
            factor: predictive_bound(&worst, count),
            spreads: entries
                .iter()
                .enumerate()
                .filter(|(slot, _)| pairs.iter().any(|(_, apart)| apart[*slot].is_some()))
                .map(|(slot, entry)| (entry.path.clone(), spread(slot, &[])))
                .collect(),
        })
    }

    fn spread(&self, entry: &Entry) -> Option<&Spread> {
        self.spreads.iter().find(|(path, _)| *path == entry.path).map(|(_, spread)| spread)
    }
}

/// How many spreads of the others a pair is apart, where that is more than the rig resolves.
fn ratio(apart: Apart, others: &Spread, resolved: f64) -> f64 {
    let [largest, rms, mean, share] = apart.sizes;
    let over = |size: f64, spread: f64, least: f64| if size > least { size / spread.max(least) } else { 0.0 };
    over(largest, others.largest, resolved)
        .max(over(rms, others.rms, resolved * RMS_SHARE))
        .max(over(mean, others.mean, resolved * MEAN_SHARE))
        .max(over(share, others.share, apart.one_sample))
}

/// The bound that one more ratio stays below but for [`FAMILY_ERROR`] of cases. The largest of many ratios follows the law of
/// extreme values, and so does the logarithm of it: Gumbel's, by its moments. Spreads of `count` repeats may be small by chance;
/// so the bound is that of a tolerance interval: it holds with [`CONFIDENCE`], by the chi-square law of a variance.
fn predictive_bound(ratios: &[f64], count: usize) -> f64 {
    const EULER: f64 = 0.577_215_664_901_532_9;
    let logs: Vec<f64> = ratios.iter().map(|ratio| ratio.ln()).collect();
    let mean = logs.iter().sum::<f64>() / logs.len() as f64;
    let variance = logs.iter().map(|log| (log - mean).powi(2)).sum::<f64>() / (logs.len() - 1) as f64;
    let gumbel = 6.0_f64.sqrt() / std::f64::consts::PI * (-(-(1.0 - FAMILY_ERROR).ln()).ln() - EULER);
    let degrees = count as f64 - 1.0;
    let small = ChiSquared::new(degrees).map_or(1.0, |law| degrees / law.inverse_cdf(1.0 - CONFIDENCE));
    (mean + gumbel * variance.sqrt()).exp() * small.sqrt()
}

/// RMS and mean that go with a difference that the rig does not resolve: that of two roundings to one step, a sigma of it.
const RMS_SHARE: f64 = 0.408_248_290_463_863;
const MEAN_SHARE: f64 = RMS_SHARE;

/// What the rig cannot tell apart in a field: one step, and the noise of two samples. What the controller makes of positions
/// carries their noise through its extrapolation by the speed of its window. `None` where the rig says nothing of the field.
fn resolution(entry: &Entry, rig: &Rig) -> Option<f64> {
    if entry.law.exact || entry.law.bookkeeping {
        return None;
    }
    let position_m = rig.tracker.resolution_m + NOISE_SIGMAS * rig.tracker.noise_m;
    let window_s = rig.control.velocity_window_s.max(rig.tracker.frame_period_s);
    let ahead = rig.control.extrapolation_s / window_s;
    let extrapolated = if entry.channel == Channel::ControlState { (1.0 + ahead).hypot(ahead) } else { 1.0 };
    let sticks = &rig.airframe.sticks;
    let stick = rig.output.step(sticks)
        + NOISE_SIGMAS * rig.output.readback_noise_fraction * (sticks.max - sticks.min);
    match entry.field.unit {
        "m" => Some(position_m * extrapolated),
        "m/s" => Some(position_m * std::f64::consts::SQRT_2 / window_s),
        "rad" => rig.tracker.heading_noise_rad.map(|noise_rad| NOISE_SIGMAS * noise_rad),
        "N" => Some(rig.airframe.thrust.gain_n_per_unit.value * stick),
        Field::ACTUATION => Some(stick),
        _ => None,
    }
}

/// When anything happens is known to an iteration of the loop.
fn time_s(rig: &Rig, sampling_s: f64) -> f64 {
    sampling_s.max(rig.control_loop.period_s)
}

impl Derived {
    /// What holds for a field on top of the built-in tolerance.
    pub(super) fn apply(&self, entry: &Entry, sampling_s: f64, tolerance: &mut Tolerance) {
        tolerance.time_s = time_s(&self.rig, sampling_s);
        if let Some(resolved) = resolution(entry, &self.rig) {
            *tolerance = Tolerance {
                absolute: resolved,
                time_s: tolerance.time_s,
                ..Tolerance::exact(ToleranceOrigin::Rig)
            };
        }
        let Some((factor, spread)) =
            self.repeats.as_ref().and_then(|repeats| Some((repeats.factor, repeats.spread(entry)?)))
        else {
            return;
        };
        let (resolved, resolved_by, time_s) = (tolerance.absolute, tolerance.origin, tolerance.time_s);
        *tolerance = Tolerance { time_s, ..Tolerance::exact(ToleranceOrigin::Repeats) };
        if by_share(entry) {
            tolerance.share = Some((factor * spread.share).min(1.0));
            return;
        }
        if resolved > factor * spread.largest {
            tolerance.origin = resolved_by;
        }
        tolerance.absolute = resolved.max(factor * spread.largest);
        tolerance.rms = Some((RMS_SHARE * resolved).max(factor * spread.rms));
        tolerance.mean = Some((MEAN_SHARE * resolved).max(factor * spread.mean));
    }

    pub(super) fn told(&self) -> DerivedFrom {
        DerivedFrom {
            rig: self.rig.name.clone(),
            mission: self.mission.clone(),
            simulations: self.repeats.as_ref().map_or(0, |repeats| repeats.simulations),
            family_error: FAMILY_ERROR,
        }
    }
}
