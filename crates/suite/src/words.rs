//! The report in words, without colour.

use std::fmt::Write as _;

use crate::{Check, Measure, Run, Tested};

/// All that is known of a test, a line each: what it flew, its figures, limits, comparisons and recordings.
pub fn detail(test: &Tested) -> String {
    let mut out = String::new();
    // Writing to a String cannot fail.
    let _ = writeln!(out, "rig {}, mission {}, mode {}", test.rig, test.mission, test.mode);
    for effect in &test.effects {
        let _ = writeln!(out, "with {effect}");
    }
    for requirement in &test.requirements {
        let _ = writeln!(out, "requirement {requirement}");
    }
    for run in &test.runs {
        if test.runs.len() > 1 {
            let _ = writeln!(out, "repeat {}, seed {}: {}", run.repeat + 1, run.seed, run.outcome.name());
        }
        let _ = writeln!(out, "{}", figures(run));
        for check in &run.checks {
            let _ = writeln!(out, "{} {}", word(check), check.in_words());
        }
        for comparison in &run.comparisons {
            let word = if comparison.passed { "passed" } else { "FAILED" };
            let _ = writeln!(out, "{word} {}", comparison.in_words());
        }
        if let Some(reason) = &run.reason {
            let _ = writeln!(out, "{reason}");
        }
        if let Some(recording) = &run.recording {
            let _ = writeln!(out, "recording {}, SHA-256 {}", recording.file, recording.sha256);
        }
    }
    for check in &test.spread {
        let _ = writeln!(out, "{} {}", word(check), check.in_words());
    }
    out
}

fn word(check: &Check) -> &'static str {
    if check.passed { "passed" } else { "FAILED" }
}

/// The figures of a flight in one line.
pub(crate) fn figures(run: &Run) -> String {
    // What is limited stands among the limits.
    let own = run.figures.iter().filter(|(name, _)| !name.contains(' '));
    let told = own.map(|(name, value)| {
        let unit = Measure::named(name).map_or("", |measure| measure.unit);
        let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
        format!("{name} {}{unit}", bench_page::digits(*value))
    });
    told.collect::<Vec<_>>().join(", ")
}
