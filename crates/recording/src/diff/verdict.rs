//! From what was found to the report.

use super::{
    DiffOptions, DiffReport, Verdict,
    derived::Derived,
    law::{Interpolation, Law},
    merge::Outcome,
    pair::Pair,
    report::{
        Difference, Exclusion, FieldReport, Lag, PhaseSpan, Reason, RecordingSummary, Samples, Size, SizeOf,
        Tolerance,
    },
    scan::Scan,
    series::Shift,
    tally::Tally,
    text,
    tolerance::Limits,
};
use crate::Mode;

/// A lag is told if it explains at least this share of the mean squared difference.
const EXPLAINED_MIN: f64 = 0.5;

/// With so many repeats, a field whose repeats scatter normally is called different by chance once in fifty times
/// (docs/diff.md).
const REPEATS_WANTED: usize = 8;

pub(super) fn report(
    pair: &Pair<'_>,
    limits: &[Limits],
    outcomes: Vec<Option<Outcome>>,
    options: &DiffOptions,
) -> DiffReport {
    let present = |slot: &usize| pair.a.fields[*slot].count + pair.b.fields[*slot].count > 0;
    let mut outcomes = outcomes;
    let mut fields: Vec<FieldReport> = (0..limits.len())
        .filter(present)
        .map(|slot| field(pair, slot, &limits[slot], outcomes[slot].take(), options))
        .collect();
    // The sort is stable: equals stay in the order of the field table.
    fields.sort_by(|a, b| weight(b).total_cmp(&weight(a)));
    let mut coverage = pair.coverage;
    coverage.enough = coverage.share >= options.coverage_min;
    let mut report = DiffReport {
        schema: DiffReport::SCHEMA.to_owned(),
        verdict: verdict(&fields, coverage.enough),
        summary: String::new(),
        a: summary(pair.a),
        b: summary(pair.b),
        alignment: pair.alignment.clone(),
        coverage,
        floor: options.floor.iter().map(|path| path.display().to_string()).collect(),
        derived: options.derived.as_ref().map(Derived::told),
        notes: Vec::new(),
        fields,
    };
    report.notes = notes(&report, pair);
    report.summary = text::summary(&report);
    report
}

/// The whole's verdict from the parts'.
fn verdict(fields: &[FieldReport], covered: bool) -> Verdict {
    let counted = || fields.iter().filter(|field| field.counts());
    let any = |verdict| counted().any(|field| field.verdict == verdict);
    if any(Verdict::Different) || any(Verdict::Missing) {
        Verdict::Different
    } else if !any(Verdict::Same) && !any(Verdict::WithinTolerance) {
        Verdict::NotComparable
    } else if !covered {
        Verdict::Different
    } else if any(Verdict::WithinTolerance) || any(Verdict::NotComparable) {
        Verdict::WithinTolerance
    } else {
        Verdict::Same
    }
}

/// What matters most weighs most: by verdict, then by how many times its tolerance a field differs. A field that is equal
/// or not counts a sample in a hundred as one time.
fn weight(field: &FieldReport) -> f64 {
    let compared = (field.samples.a_compared + field.samples.b_compared).max(1) as f64;
    let times = field.difference.as_ref().map_or(0.0, |difference| match difference.times_tolerance {
        Some(times) => times,
        None if difference.largest.is_some() => f64::MAX,
        None => 100.0 * difference.beyond as f64 / compared,
    });
    let class = match field.verdict {
        Verdict::Different => 4.0,
        Verdict::Missing => 3.0,
        Verdict::NotComparable => 2.0,
        Verdict::WithinTolerance => 1.0,
        Verdict::Same => 0.0,
    };
    // times / (1 + times) stays below the step to the next class, whatever the difference.
    let within_class = 0.9 / (1.0 + 1.0 / times.max(f64::MIN_POSITIVE));
    class + within_class + if field.counts() { 10.0 } else { 0.0 }
}

fn field(
    pair: &Pair<'_>,
    slot: usize,
    limits: &Limits,
    outcome: Option<Outcome>,
    options: &DiffOptions,
) -> FieldReport {
    let entry = &pair.entries[slot];
    let (a, b) = (&pair.a.fields[slot], &pair.b.fields[slot]);
    let compared = outcome.as_ref().map_or([0; 2], |outcome| outcome.compared);
    let samples = Samples {
        a: a.count,
        b: b.count,
        a_compared: compared[0],
        b_compared: compared[1],
        a_unusable: a.unusable,
        b_unusable: b.unusable,
    };
    let reason = pair.obstacle(slot).or_else(|| {
        outcome.as_ref().filter(|outcome| !outcome.same && outcome.compared == [0; 2])?;
        let short = entry.law.interpolation == Interpolation::Linear && a.count.min(b.count) < 2;
        Some(if short { Reason::TooFewSamples } else { Reason::NoOverlap })
    });
    let outcome = outcome.filter(|_| reason.is_none());
    let verdict = match (&reason, &outcome) {
        (Some(Reason::OnlyInA | Reason::OnlyInB), _) => Verdict::Missing,
        (_, None) => Verdict::NotComparable,
        (_, Some(outcome)) => judge(outcome, &limits.tolerance, samples),
    };
    FieldReport {
        channel: entry.channel.topic().to_owned(),
        field: entry.field.name.to_owned(),
        unit: pair.unit(entry).to_owned(),
        verdict,
        excluded: exclusion(pair, slot, limits, verdict, options),
        reason,
        interpolation: entry.law.interpolation,
        samples,
        tolerance: outcome.is_some().then_some(limits.tolerance),
        difference: outcome.as_ref().map(|outcome| difference(outcome, &limits.tolerance, entry.law)),
        lag: outcome.as_ref().and_then(|outcome| outcome.shift).and_then(lag),
        trace: outcome.and_then(|outcome| outcome.trace),
    }
}

fn judge(outcome: &Outcome, tolerance: &Tolerance, samples: Samples) -> Verdict {
    if outcome.same && samples.a_unusable == samples.b_unusable {
        return Verdict::Same;
    }
    let compared = outcome.compared[0] + outcome.compared[1];
    let allowed = tolerance.share.unwrap_or(0.0) * compared as f64;
    let noisy = tolerance.rms.is_some_and(|limit| outcome.tally.rms_off() > limit);
    let biased = tolerance.mean.is_some_and(|limit| outcome.tally.mean().abs() > limit);
    if noisy || biased || outcome.tally.beyond as f64 > allowed {
        Verdict::Different
    } else {
        Verdict::WithinTolerance
    }
}

fn exclusion(
    pair: &Pair<'_>,
    slot: usize,
    limits: &Limits,
    verdict: Verdict,
    options: &DiffOptions,
) -> Option<Exclusion> {
    let modes = pair.modes();
    let bookkeeping_counts =
        options.bookkeeping.unwrap_or(modes == [Mode::Sim; 2] && options.derived.is_none());
    if limits.ignored {
        Some(Exclusion::Ignored)
    } else if pair.entries[slot].law.bookkeeping && !bookkeeping_counts {
        Some(Exclusion::Bookkeeping)
    } else if verdict == Verdict::Missing && modes[0] != modes[1] {
        Some(Exclusion::ModesDiffer)
    } else {
        None
    }
}

fn difference(outcome: &Outcome, tolerance: &Tolerance, law: Law) -> Difference {
    let tally = &outcome.tally;
    let seconds = |ns: i64| ns as f64 / 1e9;
    // Of events only whether there is a counterpart is known.
    let measured = !law.names && law.interpolation != Interpolation::None && tally.count > 0;
    let by_rms = tolerance.rms.map_or(0.0, |limit| ratio(tally.rms_off(), limit));
    let by_mean = tolerance.mean.map_or(0.0, |limit| ratio(tally.mean().abs(), limit));
    let worst = tally.worst.max(by_rms).max(by_mean);
    let beyond_rms = by_rms > 1.0;
    Difference {
        largest: measured.then_some(tally.largest),
        largest_at_s: (measured && tally.largest > 0.0).then(|| seconds(tally.largest_ns)),
        rms: measured.then(|| tally.rms()),
        mean: measured.then(|| tally.mean()),
        beyond: tally.beyond,
        first_s: tally.first_ns.or(tally.first_over_rms_ns.filter(|_| beyond_rms)).map(seconds),
        first_names: outcome.names.clone(),
        times_tolerance: (measured && worst.is_finite()).then_some(worst),
        sizes: if measured { sizes(tally, tolerance, [tally.worst, by_rms, by_mean]) } else { Vec::new() },
    }
}

/// The sizes that have a tolerance, from the one furthest beyond on. `times` are those of largest, RMS and mean.
fn sizes(tally: &Tally, tolerance: &Tolerance, times: [f64; 3]) -> Vec<Size> {
    let values = [
        Some((SizeOf::Largest, tally.largest_off)),
        tolerance.rms.map(|_| (SizeOf::Rms, tally.rms_off())),
        tolerance.mean.map(|_| (SizeOf::Mean, tally.mean())),
    ];
    let mut sizes: Vec<_> =
        values.into_iter().zip(times).filter_map(|(size, times)| Some((size?, times))).collect();
    sizes.sort_by(|(_, a), (_, b)| b.total_cmp(a));
    let size = |((of, value), times): ((SizeOf, f64), f64)| Size {
        of,
        value,
        times_tolerance: times.is_finite().then_some(times),
    };
    sizes.into_iter().map(size).collect()
}

fn ratio(value: f64, limit: f64) -> f64 {
    if value > 0.0 { value / limit } else { 0.0 }
}

fn lag(Shift { lag_s, explained, step_s }: Shift) -> Option<Lag> {
    (explained >= EXPLAINED_MIN).then_some(Lag { lag_s, explained, step_s })
}

fn summary(scan: &Scan) -> RecordingSummary {
    let seconds = |ns: i64| ns as f64 / 1e9;
    let session = scan.source.session();
    let phases = scan.phases.iter().enumerate().map(|(place, (phase, from_ns))| PhaseSpan {
        phase: phase.name().to_owned(),
        from_s: seconds(*from_ns),
        until_s: seconds(scan.phases.get(place + 1).map_or(scan.last_ns, |next| next.1)),
    });
    RecordingSummary {
        path: scan.source.name(),
        mode: session.mode.name().to_owned(),
        rig: session.rig_name.clone(),
        mission: session.mission_name.clone(),
        seed: session.seed,
        records: scan.records,
        first_s: if scan.records > 0 { seconds(scan.first_ns) } else { 0.0 },
        last_s: if scan.records > 0 { seconds(scan.last_ns) } else { 0.0 },
        actuation: scan.actuation.map(str::to_owned),
        phases: phases.collect(),
    }
}

/// What a reader should know about how it was compared.
fn notes(report: &DiffReport, pair: &Pair<'_>) -> Vec<String> {
    let mut notes = Vec::new();
    let excluded = |why| report.fields.iter().filter(|field| field.excluded == Some(why)).count();
    if excluded(Exclusion::Bookkeeping) > 0 {
        notes.push(format!(
            "{} fields of bookkeeping (time stamps, counters, durations, events) do not count: {}",
            excluded(Exclusion::Bookkeeping),
            if report.derived.is_some() {
                "no two flights agree on them"
            } else {
                "not both are simulations"
            }
        ));
    }
    if excluded(Exclusion::ModesDiffer) > 0 {
        notes.push(format!(
            "{} fields that only one holds do not count: the modes differ ({} and {})",
            excluded(Exclusion::ModesDiffer),
            report.a.mode,
            report.b.mode
        ));
    }
    if excluded(Exclusion::Ignored) > 0 {
        notes.push(format!("{} fields are ignored as asked for", excluded(Exclusion::Ignored)));
    }
    if (2..REPEATS_WANTED).contains(&report.floor.len()) {
        notes.push(format!(
            "{} repeats say little of how far a repeat may be off: fields may be called different by chance; take {REPEATS_WANTED} or more",
            report.floor.len()
        ));
    }
    for (name, scan) in [("A", pair.a), ("B", pair.b)] {
        let unusable: u64 = scan.fields.iter().map(|seen| seen.unusable).sum();
        if unusable > 0 {
            notes.push(format!("{unusable} values of {name} are not finite, or absurd, and were left out"));
        }
        if scan.is_unsorted() {
            notes.push(format!("{name} is not in order of time and was read once a channel"));
        }
    }
    notes
}
