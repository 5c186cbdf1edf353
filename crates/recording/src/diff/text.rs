//! The report as words.

use std::fmt::Write as _;

use bench_page::digits;

use super::{
    Align, DiffReport, Difference, FieldReport, RecordingSummary, SizeOf, Tolerance, ToleranceOrigin, Verdict,
};

/// A number with its unit; ratios have none that is written.
pub(super) fn quantity(x: f64, unit: &str) -> String {
    if unit.is_empty() || unit == "1" { digits(x) } else { format!("{} {unit}", digits(x)) }
}

/// `1 field`, `2 fields`.
fn fields(count: usize) -> String {
    format!("{count} field{}", if count == 1 { "" } else { "s" })
}

/// How many fields of the verdict there are, of those that count.
pub(super) fn counted(report: &DiffReport, verdict: Verdict) -> usize {
    report.fields.iter().filter(|field| field.counts() && field.verdict == verdict).count()
}

/// The report's verdict in one line.
pub(super) fn summary(report: &DiffReport) -> String {
    let [same, within, different, missing, not_comparable] = [
        Verdict::Same,
        Verdict::WithinTolerance,
        Verdict::Different,
        Verdict::Missing,
        Verdict::NotComparable,
    ]
    .map(|verdict| counted(report, verdict));
    let compared = same + within + different;
    let mut parts = Vec::new();
    if different > 0 {
        let worst = report.fields.iter().find(|field| field.counts() && field.verdict == Verdict::Different);
        let worst = worst.map_or_else(String::new, |field| format!(", worst {}", what_differs(field)));
        parts.push(format!("{different} of {} beyond tolerance{worst}", fields(compared)));
    }
    if missing > 0 {
        parts.push(format!("{} in one recording only", fields(missing)));
    }
    if !report.coverage.enough {
        parts.push(format!(
            "the flights share only {} of {} s",
            digits(report.coverage.shared_s),
            digits(report.coverage.a_s.max(report.coverage.b_s))
        ));
    }
    match report.verdict {
        Verdict::Same => format!("same: {} equal at equal times", fields(same)),
        Verdict::WithinTolerance => {
            let rest = match not_comparable {
                0 => String::new(),
                count => format!("; {} not comparable", fields(count)),
            };
            let others = match same {
                0 => String::new(),
                count => format!(", {} the same", fields(count)),
            };
            format!("within tolerance: {}{others}{rest}", fields(within))
        }
        Verdict::Different | Verdict::Missing => {
            // Without a difference, what is compared is told last, so that nobody takes the failure for one.
            if different == 0 && compared > 0 {
                parts.push(format!("{} compared, none beyond tolerance", fields(compared)));
            }
            format!("differ: {}", parts.join("; "))
        }
        Verdict::NotComparable => {
            let why = report.fields.iter().find_map(|field| field.reason.as_ref());
            let why = why.map_or_else(String::new, |reason| format!(" ({reason})"));
            format!("not comparable: nothing could be compared{why}")
        }
    }
}

/// The field and its difference in a few words.
fn what_differs(field: &FieldReport) -> String {
    let mut text = field.path();
    if let Some(sizes) = sizes(field) {
        let _ = write!(text, ": {sizes}");
    }
    let Some(difference) = &field.difference else { return text };
    if let (None, Some(first_s)) = (difference.largest_at_s, difference.first_s) {
        let _ = write!(text, " at {first_s:.2} s");
    }
    if let Some([a, b]) = &difference.first_names {
        let _ = write!(text, " ({a} in A, {b} in B)");
    }
    text
}

/// Which of largest difference, RMS and mean is beyond its tolerance and by how much, the worst first, such as `mean 0.0217 m (1.36 x
/// its tolerance), largest 0.06 m at 9.00 s`. The largest difference always comes along; `None` for names and for what was not
/// compared.
pub(super) fn sizes(field: &FieldReport) -> Option<String> {
    let difference = field.difference.as_ref()?;
    let largest = difference.largest?;
    let at = difference.largest_at_s.map_or_else(String::new, |at_s| format!(" at {at_s:.2} s"));
    let mut parts = Vec::new();
    for size in difference.sizes.iter().filter(|size| size.is_beyond()) {
        let times = match size.times_tolerance {
            Some(times) => format!(" ({} x its tolerance)", digits(times)),
            None => String::new(),
        };
        let value = quantity(size.value, &field.unit);
        parts.push(match size.of {
            SizeOf::Largest if value != quantity(largest, &field.unit) => {
                format!(
                    "largest {}{at}, {value} after the time tolerance{times}",
                    quantity(largest, &field.unit)
                )
            }
            SizeOf::Largest => format!("largest {value}{times}{at}"),
            SizeOf::Rms | SizeOf::Mean => format!("{} {value}{times}", size.of.name()),
        });
    }
    if !difference.sizes.iter().any(|size| size.of == SizeOf::Largest && size.is_beyond()) {
        parts.push(format!("largest {}{at}", quantity(largest, &field.unit)));
    }
    Some(parts.join(", "))
}

/// How many times its tolerance a difference is, and which of its sizes that is of.
fn times_tolerance(difference: &Difference) -> String {
    let Some(times) = difference.times_tolerance else { return String::new() };
    match difference.sizes.first() {
        Some(size) if times > 0.0 => format!("{} {}", size.of.name(), digits(times)),
        _ => digits(times),
    }
}

/// A tolerance in a few characters.
pub(super) fn tolerance(tolerance: &Tolerance, unit: &str) -> String {
    let mut parts = Vec::new();
    if tolerance.absolute > 0.0 {
        parts.push(quantity(tolerance.absolute, unit));
    }
    if tolerance.relative > 0.0 {
        parts.push(format!("{} %", digits(100.0 * tolerance.relative)));
    }
    if let Some(share) = tolerance.share.filter(|share| *share > 0.0) {
        parts.push(format!("{} % of samples", digits(100.0 * share)));
    }
    let mut text = if parts.is_empty() { "0".to_owned() } else { parts.join(" or ") };
    if let Some(rms) = tolerance.rms {
        let _ = write!(text, ", rms {}", quantity(rms, unit));
    }
    if let Some(mean) = tolerance.mean {
        let _ = write!(text, ", mean {}", quantity(mean, unit));
    }
    if tolerance.time_s > 0.0 {
        let _ = write!(text, " in {} s", digits(tolerance.time_s));
    }
    text
}

/// How the clocks were brought together, in a sentence.
pub(super) fn alignment(report: &DiffReport) -> String {
    let found = &report.alignment;
    let offset = |s: f64| match s {
        0.0 => "the clocks agree".to_owned(),
        s => format!("B's clock is {:.3} s {}", s.abs(), if s > 0.0 { "ahead" } else { "behind" }),
    };
    match found.used {
        Align::Clock => {
            let sigma =
                |std: Option<f64>| std.map_or_else(String::new, |std| format!(" \u{b1} {}", digits(std)));
            format!(
                "by clock ({}): {}{}, drift {}{} ppm, {} correlates to {:.3}",
                found.reason,
                offset(found.offset_s),
                sigma(found.offset_std_s),
                digits(found.drift_ppm.unwrap_or(0.0)),
                sigma(found.drift_std_ppm),
                found.signal.as_deref().unwrap_or("the signal"),
                found.correlation.unwrap_or(0.0)
            )
        }
        Align::Phase => {
            let phase = |segment: &super::Segment| {
                let difference_s = segment.b_duration_s - segment.a_duration_s;
                if difference_s.abs() < 5e-4 {
                    segment.phase.clone()
                } else {
                    format!("{} ({:+.3} s in B)", segment.phase, difference_s)
                }
            };
            let phases: Vec<String> = found.segments.iter().map(phase).collect();
            format!("by phase ({}): {}; {}", found.reason, offset(found.offset_s), phases.join(", "))
        }
        Align::None | Align::Auto => format!("not aligned ({})", found.reason),
    }
}

/// What tolerances come from, in a line; `None` where they are built in.
pub(super) fn tolerances(report: &DiffReport) -> Option<String> {
    if !report.floor.is_empty() {
        return Some(format!("tolerances from the differences among {} repeats", report.floor.len()));
    }
    let derived = report.derived.as_ref()?;
    let simulations = match derived.simulations {
        0 => String::new(),
        count => format!(" and {count} simulations of it in mission {}", derived.mission),
    };
    Some(format!(
        "tolerances derived from rig {} (tracker, loop, output){simulations}; --exact compares without, --abs, --rel, --time and \
         --tolerances give others",
        derived.rig
    ))
}

/// Where a field's tolerance comes from.
pub(super) const fn origin(tolerance: &Tolerance) -> &'static str {
    match tolerance.origin {
        ToleranceOrigin::Default => "built in",
        ToleranceOrigin::Exact => "exact",
        ToleranceOrigin::Rig => "rig",
        ToleranceOrigin::Repeats => "repeats",
        ToleranceOrigin::Floor => "floor",
        ToleranceOrigin::Given => "given",
    }
}

/// What a recording is, in a line.
pub(super) fn recording(summary: &RecordingSummary) -> String {
    let mut parts = vec![summary.mode.clone()];
    for (what, name) in [("rig", &summary.rig), ("mission", &summary.mission)] {
        if !name.is_empty() {
            parts.push(format!("{what} {name}"));
        }
    }
    if let Some(seed) = summary.seed {
        parts.push(format!("seed {seed}"));
    }
    parts.push(format!("{:.1} s", summary.last_s - summary.first_s));
    parts.push(format!("{} records", summary.records));
    parts.join(", ")
}

/// How much of the flights is shared, in a sentence.
pub(super) fn coverage(report: &DiffReport) -> String {
    let coverage = &report.coverage;
    format!(
        "shared {:.1} s of {:.1} s in A and {:.1} s in B ({:.0} %)",
        coverage.shared_s,
        coverage.a_s,
        coverage.b_s,
        100.0 * coverage.share
    )
}

/// The report for a terminal: the verdict first, then how it came about, then the fields that matter; every field if
/// `all`.
pub fn render_text(report: &DiffReport, all: bool) -> String {
    let mut text = format!("{}\n\n", report.summary);
    for (name, summary) in [("A", &report.a), ("B", &report.b)] {
        let _ = writeln!(text, "{name}  {}: {}", summary.path, recording(summary));
    }
    let _ = writeln!(text, "{}; {}", alignment(report), coverage(report));
    if let Some(origin) = tolerances(report) {
        let _ = writeln!(text, "{origin}");
    }
    for note in &report.notes {
        let _ = writeln!(text, "note: {note}");
    }
    let matters = |field: &&FieldReport| all || (field.counts() && !field.verdict.passes());
    let rows: Vec<[String; COLUMNS]> = report.fields.iter().filter(matters).map(row).collect();
    if !rows.is_empty() {
        text.push('\n');
        table(&mut text, &rows);
    }
    let hidden = report.fields.len() - rows.len();
    if hidden > 0 {
        let _ = writeln!(text, "\n{} not shown; --all lists every field", fields(hidden));
    }
    text
}

const COLUMNS: usize = 10;

const HEADINGS: [&str; COLUMNS] =
    ["field", "verdict", "largest", "at [s]", "rms", "mean", "tolerance", "from", "x tol.", "lag [s]"];

fn row(field: &FieldReport) -> [String; COLUMNS] {
    let difference = field.difference.as_ref();
    let with_unit = |x: Option<f64>| x.map_or_else(String::new, |x| quantity(x, &field.unit));
    let verdict = match (&field.reason, field.excluded) {
        (Some(reason), _) if field.verdict == Verdict::Missing => reason.to_string(),
        (Some(reason), _) => format!("not comparable: {reason}"),
        (None, Some(why)) => format!("({}: {})", field.verdict.name(), why.name()),
        (None, None) => field.verdict.name().to_owned(),
    };
    [
        field.path(),
        verdict,
        match difference.and_then(|difference| difference.first_names.as_ref()) {
            Some([a, b]) => format!("{a} / {b}"),
            None => with_unit(difference.and_then(|difference| difference.largest)),
        },
        difference
            .and_then(|difference| difference.largest_at_s.or(difference.first_s))
            .map_or_else(String::new, |at_s| format!("{at_s:.2}")),
        with_unit(difference.and_then(|difference| difference.rms)),
        with_unit(difference.and_then(|difference| difference.mean)),
        field.tolerance.as_ref().map_or_else(String::new, |limit| tolerance(limit, &field.unit)),
        field.tolerance.as_ref().map_or_else(String::new, |limit| origin(limit).to_owned()),
        difference.map_or_else(String::new, times_tolerance),
        field.lag.map_or_else(String::new, |lag| format!("{:+.3}", lag.lag_s)),
    ]
}

/// Columns as wide as they need to be; names to the left, numbers to the right.
fn table(text: &mut String, rows: &[[String; COLUMNS]]) {
    let headings = HEADINGS.map(str::to_owned);
    let lines = || std::iter::once(&headings).chain(rows);
    let widths: [usize; COLUMNS] =
        std::array::from_fn(|column| lines().map(|line| line[column].chars().count()).max().unwrap_or(0));
    for line in lines() {
        let mut out = String::new();
        for (column, (cell, width)) in line.iter().zip(widths).enumerate() {
            let gap = if column == 0 { "" } else { "  " };
            let _ = match column {
                0 | 1 | 6 | 7 => write!(out, "{gap}{cell:<width$}"),
                _ => write!(out, "{gap}{cell:>width$}"),
            };
        }
        let _ = writeln!(text, "{}", out.trim_end());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        assert_eq!(digits(0.0341), "0.0341");
        assert_eq!(digits(0.5), "0.5");
        assert_eq!(digits(-12.345), "-12.3");
        assert_eq!(digits(1000.0), "1000");
        assert_eq!(digits(1.0e-7), "1.00e-7");
        assert_eq!(quantity(2.0, "1"), "2");
        assert_eq!(quantity(2.0, "m/s"), "2 m/s");
    }
}
