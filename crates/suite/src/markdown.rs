//! The report as Markdown, for the summary of a CI run or a merge request.

use std::{collections::BTreeMap, fmt::Write as _};

use crate::{Outcome, Report, Tested};

/// The report as Markdown. What did not pass stands in the open, what passed is folded.
pub fn markdown(report: &Report) -> String {
    let mut out = String::new();
    // Writing to a String cannot fail.
    let _ = writeln!(out, "## {} {}: {}\n", sign(report.outcome), cell(&report.suite), report.headline());
    let _ = writeln!(out, "{}\n", cell(&report.description));
    if !report.meta.is_empty() {
        let told: Vec<String> =
            report.meta.iter().map(|(key, value)| format!("{} {}", cell(key), cell(value))).collect();
        let _ = writeln!(out, "{}\n", told.join(", "));
    }
    let (passed, others): (Vec<&Tested>, Vec<&Tested>) =
        report.tests.iter().partition(|test| test.outcome == Outcome::Passed);
    if !others.is_empty() {
        out += "| result | test | why |\n|---|---|---|\n";
        for test in others {
            let faults: Vec<String> = test.faults().iter().map(|fault| cell(fault)).collect();
            let share = match test.outcome {
                Outcome::Flaky => format!(" ({})", test.share()),
                _ => String::new(),
            };
            let _ = writeln!(
                out,
                "| {} {}{share} | {} | {} |",
                sign(test.outcome),
                test.outcome.name(),
                cell(&test.id),
                faults.join("<br>")
            );
        }
        out.push('\n');
    }
    for diagnosed in &report.diagnoses {
        let _ = writeln!(out, "**Diagnosis** of {}: {}\n", cell(&diagnosed.of()), cell(&diagnosed.words));
    }
    if !passed.is_empty() {
        let _ = writeln!(out, "<details><summary>{} passed</summary>\n", passed.len());
        out += "| test | rig | mission | mode | flights |\n|---|---|---|---|---|\n";
        for test in passed {
            let _ = writeln!(
                out,
                "| {} | {} | {} | {} | {} |",
                cell(&test.id),
                cell(&test.rig),
                cell(&test.mission),
                test.mode,
                test.runs.len()
            );
        }
        out += "\n</details>\n\n";
    }
    let requirements = requirements(report);
    if !requirements.is_empty() {
        out += "| requirement | result | tests |\n|---|---|---|\n";
        for (requirement, (outcome, tests)) in requirements {
            let _ = writeln!(
                out,
                "| {} | {} {} | {} |",
                cell(requirement),
                sign(outcome),
                outcome.name(),
                cell(&tests.join(", "))
            );
        }
    }
    out
}

/// Each requirement with what its tests come to and their ids: passed where all are, else the worst of them.
pub(crate) fn requirements(report: &Report) -> BTreeMap<&str, (Outcome, Vec<&str>)> {
    let badness = |outcome: Outcome| match outcome {
        Outcome::Passed => 0,
        Outcome::NotRun => 1,
        Outcome::Flaky => 2,
        Outcome::Failed => 3,
        Outcome::Error => 4,
    };
    let mut all: BTreeMap<&str, (Outcome, Vec<&str>)> = BTreeMap::new();
    for test in &report.tests {
        for requirement in &test.requirements {
            let (worst, tests) = all.entry(requirement).or_insert((Outcome::Passed, Vec::new()));
            tests.push(&test.id);
            if badness(test.outcome) > badness(*worst) {
                *worst = test.outcome;
            }
        }
    }
    all
}

const fn sign(outcome: Outcome) -> &'static str {
    match outcome {
        Outcome::Passed => "\u{2705}",
        Outcome::Failed | Outcome::Error => "\u{274c}",
        Outcome::Flaky => "\u{26a0}\u{fe0f}",
        Outcome::NotRun => "\u{23ed}\u{fe0f}",
    }
}

/// A text that stays one cell of a table and no markup.
fn cell(text: &str) -> String {
    let mut out = String::new();
    for c in text.chars() {
        match c {
            '\n' | '\r' => out.push(' '),
            '|' | '<' | '>' | '*' | '_' | '`' | '[' | ']' | '\\' => {
                out.push('\\');
                out.push(c);
            }
            c if c.is_control() => {}
            c => out.push(c),
        }
    }
    out
}
