//! Recordings held against one another, and the diagnosis of what differs.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use bench_recording::diff::{Derived, DiffOptions, Verdict, diff};
use bench_suite::{Comparison, Diagnosed, Difference, Kind, Report};

use super::{Flying, Plan, Planned};
use crate::{
    commands::diagnose::diagnosed,
    diagnosis::report::Conclusion,
    recorded::NominalRig,
    repeats, words,
};

/// How many fields that differ are told.
const TOLD: usize = 12;

/// A recording against another of the same rig and mission. Who asks says what kind of comparison it is, and with what.
pub fn comparison(
    plan: &Plan,
    planned: &Planned,
    other: &Path,
    recording: &Path,
    derived: Derived,
) -> anyhow::Result<Comparison> {
    let options = DiffOptions {
        tolerances: plan.tolerances.get(&planned.test.case).cloned().unwrap_or_default(),
        derived: Some(derived),
        trace_stretches: 0,
        ..DiffOptions::default()
    };
    let report = diff(other, recording, &options)?;
    let differs = report.fields.iter().filter(|field| field.counts() && !field.verdict.passes());
    let differences = differs.take(TOLD).map(|field| Difference {
        field: field.path(),
        unit: field.unit.clone(),
        times_tolerance: field.difference.as_ref().and_then(|difference| difference.times_tolerance),
        largest: field.difference.as_ref().and_then(|difference| difference.largest),
        mean: field.difference.as_ref().and_then(|difference| difference.mean),
    });
    Ok(Comparison {
        kind: Kind::BackToBack,
        with: String::new(),
        passed: matches!(report.verdict(), Verdict::Same | Verdict::WithinTolerance),
        differences: differences.collect(),
        summary: report.summary,
    })
}

/// Holds each test of a back-to-back case against its partner, and asks the diagnosis about those that differ.
pub fn compare_back_to_back(plan: &Plan, flying: &Flying<'_>, report: &mut Report) -> Vec<String> {
    let mut remarks = Vec::new();
    let mut differing: BTreeMap<(usize, String), Vec<usize>> = BTreeMap::new();
    for (index, planned) in plan.tests.iter().enumerate() {
        let case = &plan.suite.cases[planned.test.case];
        if !case.compare.back_to_back || !is_second(plan, planned) {
            continue;
        }
        let Some(first) = plan.tests.iter().position(|other| are_partners(plan, other, planned)) else {
            remarks.push(format!("{} was not compared: its partner is not among the tests that were chosen", planned.test.id));
            continue;
        };
        let mut differs = false;
        for place in 0..report.tests[index].runs.len() {
            let run = &report.tests[index].runs[place];
            let partner = report.tests[first].runs.iter().find(|other| other.repeat == run.repeat);
            let recordings = (partner.and_then(|run| run.recording.as_ref()), run.recording.as_ref());
            let with = plan.tests[first].test.id.clone();
            let made = match recordings {
                (Some(a), Some(b)) => {
                    let derived = repeats::of(planned.nominal.clone(), &planned.mission);
                    comparison(plan, planned, &flying.recording(a), &flying.recording(b), derived)
                        .map_err(|error| words::causes(&error))
                }
                _ => Err("one of the two flights has no recording".to_owned()),
            };
            let made = made.map(|made| Comparison { with: with.clone(), ..made }).unwrap_or_else(|why| Comparison {
                kind: Kind::BackToBack,
                with,
                passed: false,
                summary: why,
                differences: Vec::new(),
            });
            differs |= !made.passed && !made.differences.is_empty();
            let run = &mut report.tests[index].runs[place];
            run.comparisons.push(made);
            run.settle();
        }
        if differs {
            let key = (planned.test.case, planned.test.rig.clone() + &planned.test.effects.join("+"));
            differing.entry(key).or_default().push(index);
        }
        report.tests[index].settle(&plan.suite, case.repeats);
    }
    for tests in differing.into_values() {
        let recordings: Vec<PathBuf> = tests
            .iter()
            .flat_map(|index| &report.tests[*index].runs)
            .filter_map(|run| run.recording.as_ref())
            .map(|attached| flying.recording(attached))
            .collect();
        let ids = tests.iter().map(|index| report.tests[*index].id.clone()).collect();
        report.diagnoses.push(of_flights(ids, &recordings));
    }
    remarks
}

/// Whether a test is the second of its pair: in the second mode, or with the second effects.
fn is_second(plan: &Plan, planned: &Planned) -> bool {
    let case = &plan.suite.cases[planned.test.case];
    match case.modes.as_slice() {
        [_, second] => planned.test.mode == *second,
        _ => case.effects.get(1) == Some(&planned.test.effects),
    }
}

/// Whether a test is the first of the pair whose second is given.
fn are_partners(plan: &Plan, first: &Planned, second: &Planned) -> bool {
    let (a, b) = (&first.test, &second.test);
    let by_mode = plan.suite.cases[b.case].modes.len() == 2;
    a.case == b.case
        && a.rig == b.rig
        && a.mission == b.mission
        && a.seed == b.seed
        && (a.effects == b.effects) == by_mode
        && (a.mode == b.mode) != by_mode
}

/// Asks the diagnosis about flights, with the rig that they carry.
fn of_flights(tests: Vec<String>, recordings: &[PathBuf]) -> Diagnosed {
    match diagnosed(recordings, &NominalRig { rig: None }) {
        Ok((report, _)) => {
            let verdict = match report.verdict {
                Conclusion::Effect => report.effects.join(" + "),
                Conclusion::None => "none".to_owned(),
                Conclusion::Unknown => "unknown".to_owned(),
                Conclusion::Inconclusive => "inconclusive".to_owned(),
            };
            Diagnosed { tests, verdict: Some(verdict), probability: Some(report.confidence), words: report.headline() }
        }
        Err(error) => Diagnosed {
            tests,
            verdict: None,
            probability: None,
            words: format!("These flights cannot be diagnosed: {}", words::causes(&error)),
        },
    }
}
