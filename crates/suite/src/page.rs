//! The report as a verdict and sections of a page.

use bench_page::{
    Section, Tone, Verdict,
    parts::{Column, Tile, badge, cell, facts, folded, list, passed, table, tiles},
};
use maud::{Markup, html};

use crate::{Check, Comparison, Outcome, Report, Run, Tested, markdown::requirements, words::figures};

/// What the suite comes to.
pub fn verdict(report: &Report) -> Verdict {
    let counts = report.counts;
    let figures = [
        (counts.passed, "passed"),
        (counts.failed, "failed"),
        (counts.errors, "errors"),
        (counts.flaky, "flaky"),
        (counts.not_run, "not run"),
    ];
    let figures = figures.into_iter().filter(|(count, _)| *count > 0).map(|(count, of)| Tile {
        value: count.to_string(),
        of: of.to_owned(),
        beside: String::new(),
    });
    let mut particulars = vec![
        ("suite", report.suite.clone()),
        ("bench", report.bench_version.clone()),
        ("began", report.times.began_utc()),
        ("took", format!("{:.1} s", report.times.took_s)),
    ];
    particulars.extend(report.meta.iter().map(|(key, value)| (key.as_str(), value.clone())));
    let below = html! {
        p.lead { (report.description) }
        (facts(particulars))
        (tiles(figures))
    };
    Verdict::new(tone(report.outcome), report.headline()).with(below)
}

/// What an outcome means.
pub const fn tone(outcome: Outcome) -> Tone {
    match outcome {
        Outcome::Passed => Tone::Good,
        Outcome::Failed | Outcome::Error => Tone::Bad,
        Outcome::Flaky => Tone::Odd,
        Outcome::NotRun => Tone::Plain,
    }
}

/// The tests in a table, what did not pass in full, diagnoses and requirements.
pub fn sections(report: &Report) -> Vec<Section> {
    let others: Vec<&Tested> = report.tests.iter().filter(|test| test.outcome != Outcome::Passed).collect();
    let mut sections = Vec::new();
    if !others.is_empty() {
        let parts = others.iter().map(|test| {
            let share = test.share();
            let apart = if share.is_empty() { "" } else { ": " };
            let words = format!("{}{apart}{share}", test.outcome.name());
            Section::new(test.id.clone(), detail(test))
                .verdict(Verdict::new(tone(test.outcome), bench_page::capitalised(&words)))
        });
        sections.push(Section::new("What did not pass", html! {}).parts(parts));
    }
    if !report.diagnoses.is_empty() {
        let body = html! {
            @for diagnosed in &report.diagnoses {
                div.block {
                    h4 { (diagnosed.of()) }
                    p { (diagnosed.words) }
                }
            }
        };
        let words = "Where two modes, or the flights with and without effects, differ beyond tolerance, the flights of the second are \
                     diagnosed against the rig.";
        sections.push(Section::new("Diagnosis of what differs", body).told(words));
    }
    sections.push(Section::new("All tests", all(report)));
    let requirements = requirements(report);
    if !requirements.is_empty() {
        let rows = requirements.iter().map(|(requirement, (outcome, tests))| {
            vec![cell(*requirement), badge(tone(*outcome), outcome.name()), cell(tests.join(", "))]
        });
        let columns = [Column::Words("requirement"), Column::Words(""), Column::Words("tests")];
        sections.push(
            Section::new("Requirements", table(&columns, rows))
                .told("A requirement is met where all tests that name it passed."),
        );
    }
    sections
}

fn all(report: &Report) -> Markup {
    let rows = report.tests.iter().map(|test| {
        let figure = |name: &str, scale: f64| {
            let values: Vec<f64> =
                test.runs.iter().filter_map(|run| run.figures.get(name)).copied().collect();
            let worst = values.into_iter().reduce(f64::max);
            cell(worst.map_or_else(|| "-".to_owned(), |value| bench_page::digits(value * scale)))
        };
        vec![
            html! { b { (test.id) } },
            badge(tone(test.outcome), test.outcome.name()),
            cell(&test.rig),
            cell(&test.mission),
            cell(&test.mode),
            cell(test.effects.join(", ")),
            cell(test.runs.len()),
            figure("peak", 1.0),
            figure("rms_error", 1.0),
            figure("settling_time", 1.0),
            figure("overruns", 1.0),
        ]
    });
    let columns = [
        Column::Words("test"),
        Column::Words(""),
        Column::Words("rig"),
        Column::Words("mission"),
        Column::Words("mode"),
        Column::Words("effects"),
        Column::Number("flights"),
        Column::Number("peak, m"),
        Column::Number("RMS error, m"),
        Column::Number("settled after, s"),
        Column::Number("overruns"),
    ];
    table(&columns, rows)
}

fn detail(test: &Tested) -> Markup {
    html! {
        @if !test.description.is_empty() { p { (test.description) } }
        (list(&test.faults()))
        @for run in &test.runs {
            (folded(
                format!("Flight {}, seed {}", run.repeat + 1, run.seed),
                run.outcome.name(),
                run.outcome != Outcome::Passed,
                flight(run),
            ))
        }
        @if !test.spread.is_empty() { (checks(&test.spread)) }
    }
}

fn flight(run: &Run) -> Markup {
    html! {
        @if let Some(reason) = &run.reason { p { (reason) } }
        (checks(&run.checks))
        @for comparison in &run.comparisons { (compared(comparison)) }
        p.soft { (figures(run)) }
        @if let Some(recording) = &run.recording {
            p.soft { "Recording " code { (recording.file) } ", SHA-256 " code { (recording.sha256) } }
        }
    }
}

fn checks(checks: &[Check]) -> Markup {
    let rows = checks.iter().map(|check| {
        vec![
            html! { code { (check.about) } },
            cell(check.value.map_or_else(|| "not reached".to_owned(), bench_page::digits)),
            cell(format!("{} {}", check.relation, check.limit)),
            cell(&check.unit),
            passed(check.passed),
        ]
    });
    let columns = [
        Column::Words("limit on"),
        Column::Number("reached"),
        Column::Number("limit"),
        Column::Words("unit"),
        Column::Words(""),
    ];
    html! { @if !checks.is_empty() { (table(&columns, rows)) } }
}

fn compared(comparison: &Comparison) -> Markup {
    let number = |x: Option<f64>| cell(x.map_or_else(|| "-".to_owned(), bench_page::digits));
    let rows = comparison.differences.iter().map(|difference| {
        vec![
            html! { code { (difference.field) } },
            number(difference.times_tolerance),
            number(difference.largest),
            number(difference.mean),
            cell(&difference.unit),
        ]
    });
    let columns = [
        Column::Words("field"),
        Column::Number("tolerances"),
        Column::Number("largest difference"),
        Column::Number("mean difference"),
        Column::Words("unit"),
    ];
    html! {
        p { (passed(comparison.passed)) " " (comparison.kind.name()) " with " code { (comparison.with) } ": " (comparison.summary) }
        @if !comparison.differences.is_empty() { (table(&columns, rows)) }
    }
}
