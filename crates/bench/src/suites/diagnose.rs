//! Recordings held against one another, and the diagnosis of what differs.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use anyhow::Context;
use bench_recording::diff::{Derived, DiffOptions, Verdict, diff};
use bench_rig::Rig;
use bench_suite::{Comparison, Diagnosed, Difference, Kind, Mode, Report, Test};

use super::{Flying, Plan, Planned};
use crate::{
    commands::diagnose::diagnosed,
    diagnosis::{self, report::Conclusion, told},
    files,
    recorded::NominalRig,
    repeats, words,
};

/// How many fields that differ are told.
const TOLD: usize = 12;

/// What tells how the marker was seen, not how the airframe flew. Simulated positions have no pixels and always a heading; one marker in
/// frames has no heading, so that a yaw is not held.
const OF_EYES: [&str; 6] = [
    "/tracker/position/pixel.*",
    "/tracker/position/size_px",
    "/tracker/position/status",
    "/tracker/position/heading_rad",
    "/plant/truth/attitude.w",
    "/plant/truth/attitude.z",
];

/// What is known of a virtual airframe alone: nobody measures it on a real one.
const OF_VIRTUAL_AIRFRAME: &str = "/plant/*";

/// Whether positions come from frames, rather than from the simulation itself.
const fn sees_frames(mode: Mode) -> bool {
    matches!(mode, Mode::Frames | Mode::Transmitter)
}

/// Fields that two modes cannot have in common.
fn unlike(modes: [Mode; 2]) -> Vec<&'static str> {
    let differ = |what: fn(Mode) -> bool| what(modes[0]) != what(modes[1]);
    let mut fields = Vec::new();
    if differ(sees_frames) {
        fields.extend(OF_EYES);
    }
    if differ(|mode| mode == Mode::Transmitter) {
        fields.push(OF_VIRTUAL_AIRFRAME);
    }
    fields
}

/// A recording against another of the same rig and mission, but for some fields. Who asks says what kind of comparison it is, and with
/// what.
pub fn comparison(
    plan: &Plan,
    planned: &Planned,
    other: &Path,
    recording: &Path,
    derived: Derived,
    left_out: &[&str],
) -> anyhow::Result<Comparison> {
    let mut tolerances = plan.tolerances.get(&planned.test.case).cloned().unwrap_or_default();
    for field in left_out {
        tolerances.ignore(field)?;
    }
    let options =
        DiffOptions { tolerances, derived: Some(derived), trace_stretches: 0, ..DiffOptions::default() };
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
    let mut differing: BTreeMap<(usize, Side, String), Vec<usize>> = BTreeMap::new();
    for (index, planned) in plan.tests.iter().enumerate() {
        let case = &plan.suite.cases[planned.test.case];
        if !case.compare.back_to_back || !is_second(plan, planned) {
            continue;
        }
        let Some(first) = plan.tests.iter().position(|other| are_partners(plan, other, planned)) else {
            remarks.push(format!(
                "{} was not compared: its partner is not among the tests that were chosen",
                planned.test.id
            ));
            continue;
        };
        let left_out = unlike([plan.tests[first].test.mode, planned.test.mode]);
        let mut differs = false;
        for place in 0..report.tests[index].runs.len() {
            let run = &report.tests[index].runs[place];
            let partner = report.tests[first].runs.iter().find(|other| other.repeat == run.repeat);
            let recordings = (partner.and_then(|run| run.recording.as_ref()), run.recording.as_ref());
            let with = plan.tests[first].test.id.clone();
            let made = match recordings {
                (Some(a), Some(b)) => {
                    let derived = repeats::of(planned.nominal.clone(), &planned.mission);
                    comparison(plan, planned, &flying.recording(a), &flying.recording(b), derived, &left_out)
                        .map_err(|error| words::causes(&error))
                }
                _ => Err("one of the two flights has no recording".to_owned()),
            };
            let made = made.unwrap_or_else(|why| Comparison {
                kind: Kind::BackToBack,
                with: String::new(),
                passed: false,
                summary: why,
                differences: Vec::new(),
            });
            differs |= !made.passed && !made.differences.is_empty();
            let run = &mut report.tests[index].runs[place];
            run.comparisons.push(Comparison { with, ..made });
            run.settle();
        }
        if differs {
            // A simulation is what was wanted; of two flights on hardware either may be the one that is off.
            let suspects = [(Side::First, first), (Side::Second, index)];
            let is_suspect = |side| side == Side::Second || plan.tests[first].test.mode.is_hardware();
            for (side, suspect) in suspects.into_iter().filter(|(side, _)| is_suspect(*side)) {
                let Test { case, rig, effects, .. } = &plan.tests[suspect].test;
                let flown = differing.entry((*case, side, rig.clone() + &effects.join("+"))).or_default();
                if !flown.contains(&suspect) {
                    flown.push(suspect);
                }
            }
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
        // The rig is that of the first, which the others share.
        let Some(planned) = tests.first().map(|index| &plan.tests[*index]) else { continue };
        let is_known = planned.test.mode != Mode::Transmitter;
        report.diagnoses.push(of_flights(ids, &recordings, &planned.nominal, is_known));
    }
    remarks
}

/// A side of a pair.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Side {
    First,
    Second,
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
    let case = &plan.suite.cases[b.case];
    let by_mode = case.modes.len() == 2;
    a.case == b.case
        && (a.rig == b.rig || case.pairs_rigs_with_modes())
        && a.mission == b.mission
        && a.seed == b.seed
        && (a.effects == b.effects) == by_mode
        && (a.mode == b.mode) != by_mode
}

/// Asks the diagnosis about flights, with the rig that they carry.
fn of_flights(tests: Vec<String>, recordings: &[PathBuf], rig: &Rig, is_known: bool) -> Diagnosed {
    match asked(recordings, rig, is_known) {
        Ok(report) => {
            let verdict = match report.verdict {
                Conclusion::Effect => report.effects.join(" + "),
                Conclusion::None => "none".to_owned(),
                Conclusion::Unknown => "unknown".to_owned(),
                Conclusion::Inconclusive => "inconclusive".to_owned(),
            };
            let candidates = &report.diagnosis.candidates;
            let leading =
                candidates.iter().take(LEADING).map(|found| (found.name.clone(), found.probability));
            let alternatives: Vec<String> =
                report.diagnosis.alternatives.iter().map(|alternative| alternative.name.clone()).collect();
            // What is part of the answer is no other one.
            let others = candidates
                .iter()
                .filter(|found| found.name != report.leading && !alternatives.contains(&found.name))
                .take(LEADING - 1)
                .map(|found| format!("{} {}", found.name, told::percent(found.probability)));
            let others: Vec<String> = others.collect();
            let others =
                if others.is_empty() { String::new() } else { format!("; then {}", others.join(", ")) };
            Diagnosed {
                tests,
                verdict: Some(verdict),
                alternatives,
                probability: Some(report.confidence),
                leading: leading.collect(),
                words: report.headline() + &others,
            }
        }
        Err(error) => Diagnosed {
            tests,
            verdict: None,
            alternatives: Vec::new(),
            probability: None,
            leading: Vec::new(),
            words: format!("These flights cannot be diagnosed: {}", words::causes(&error)),
        },
    }
}

/// How many of the most probable are told.
const LEADING: usize = 3;
/// Where both flights have the same virtual airframe, its numbers are those of the rig, and a difference is none of theirs. A
/// tolerance is left all the same: without one the fits have no scale.
const KNOWN: f64 = 0.05;

fn asked(recordings: &[PathBuf], rig: &Rig, is_known: bool) -> anyhow::Result<diagnosis::report::Report> {
    if !is_known {
        return Ok(diagnosed(recordings, &NominalRig { rig: None })?.0);
    }
    let mut table: toml::Value = toml::from_str(&rig.to_toml())?;
    scale_tolerances(&mut table, KNOWN);
    let folder = tempfile::tempdir().context("cannot make a folder for the rig of a diagnosis")?;
    let path = folder.path().join(format!("{}.toml", rig.name));
    files::write(&path, &toml::to_string(&table)?)?;
    Ok(diagnosed(recordings, &NominalRig { rig: Some(path) })?.0)
}

/// Scales every `sigma` that stands beside a `value`.
fn scale_tolerances(value: &mut toml::Value, factor: f64) {
    match value {
        toml::Value::Table(table) => {
            if table.contains_key("value")
                && let Some(toml::Value::Float(sigma)) = table.get_mut("sigma")
            {
                *sigma *= factor;
            }
            table.iter_mut().for_each(|(_, inner)| scale_tolerances(inner, factor));
        }
        toml::Value::Array(items) => items.iter_mut().for_each(|inner| scale_tolerances(inner, factor)),
        _ => {}
    }
}
