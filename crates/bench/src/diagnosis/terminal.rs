//! A diagnosis on a terminal: what it is, where it lies, how far it shrinks, what to do.

use std::fmt::Write as _;

use bench_diagnosis::{Candidate, Diagnosis, Figure, ParameterValue, RegionTold, Verdict};
use bench_page::{Tone, digits};
use bench_rig::Actuation;

use super::{
    report::{Conclusion, Report},
    told,
};
use crate::{nominal, words};

/// Most lines of a kind, so that all stays on one screen.
const MOST: usize = 3;
/// The same of the rig's numbers.
const MOST_NUMBERS: usize = 2;
/// A candidate less probable than this is not told.
const LEAST_PROBABLE: f64 = 0.01;

/// The diagnosis as lines.
pub fn in_words(report: &Report, sticks: Actuation) -> String {
    let mut out = String::new();
    let diagnosis = &report.diagnosis;
    what(&mut out, report);
    model(&mut out, report);
    place(&mut out, diagnosis, sticks);
    how_far(&mut out, diagnosis);
    if !diagnosis.next.is_empty() {
        out += "\nNext\n";
    }
    for step in &diagnosis.next {
        let _ = writeln!(out, "  {step}");
    }
    for warning in diagnosis.warnings.iter().take(MOST) {
        let _ = writeln!(out, "{}: {warning}", words::toned(Tone::Odd, "warning"));
    }
    if let Some(more) = diagnosis.warnings.len().checked_sub(MOST).filter(|more| *more > 0) {
        let _ = writeln!(out, "and {}: --json has them", words::count(more as u64, "more warning"));
    }
    out
}

fn what(out: &mut String, report: &Report) {
    let diagnosis = &report.diagnosis;
    let measurements: usize = diagnosis.flights.iter().map(|flight| flight.measurements).sum();
    let _ = writeln!(
        out,
        "{}\n{}, {}; calibration of probabilities: {} ({})",
        words::toned(report.tone(), &report.headline()),
        words::count(diagnosis.flights.len() as u64, "flight"),
        words::count(measurements as u64, "measurement"),
        diagnosis.calibration.source,
        report.calibration_choice.why
    );
    if report.verdict == Conclusion::Inconclusive {
        let part = told::leader_takes_part(diagnosis)
            .filter(|part| *part >= report.confidence + LEAST_PROBABLE)
            .map(|part| format!("; that it takes part, alone or beside another: {}", told::percent(part)));
        let _ = writeln!(
            out,
            "what leads, not sure enough to be told: {} ({}{})",
            told::answer(diagnosis),
            told::percent(report.confidence),
            part.unwrap_or_default()
        );
    }
    for effect in diagnosis.effects.iter().filter_map(|name| told::spec(name)) {
        let _ = writeln!(out, "  {}: {}", effect.name, effect.summary);
        let leads = diagnosis.candidates.iter().filter(|candidate| candidate.name == diagnosis.leading);
        let fitted = leads.flat_map(|candidate| &candidate.parameters);
        for p in fitted.filter(|p| p.effect == effect.name && told::tells(p)) {
            let _ = writeln!(out, "    {}", parameter(p));
        }
    }
    let others: Vec<String> = diagnosis
        .candidates
        .iter()
        .filter(|candidate| candidate.name != diagnosis.leading && candidate.probability >= LEAST_PROBABLE)
        .take(MOST)
        .map(|candidate| format!("{} ({})", candidate.name, told::percent(candidate.probability)))
        .collect();
    if !others.is_empty() {
        let _ = writeln!(out, "  also possible: {}", others.join(", "));
    }
    let parts: Vec<String> = told::takes_part(&diagnosis.candidates, LEAST_PROBABLE)
        .into_iter()
        .take(MOST)
        .map(|(effect, probability)| format!("{effect} {}", told::percent(probability)))
        .collect();
    if !parts.is_empty() {
        let _ = writeln!(out, "  alone or beside another: {}", parts.join(", "));
    }
    if let [named] = diagnosis.effects.as_slice() {
        let beside = |c: &&Candidate| {
            c.effects.len() == 2 && c.effects.contains(named) && c.probability < LEAST_PROBABLE
        };
        let hidden: f64 = diagnosis.candidates.iter().filter(beside).map(|c| c.probability).sum();
        if hidden >= LEAST_PROBABLE {
            let _ = writeln!(
                out,
                "  a second effect beside it, too small to say which: {}",
                told::percent(hidden)
            );
        }
    }
}

/// What the nominal flights made.
fn model(out: &mut String, report: &Report) {
    let Some(model) = &report.model else { return };
    let _ = writeln!(out, "\nModel: from {}", words::count(model.flights.len() as u64, "nominal flight"));
    for line in nominal::in_words(&model.laws, &model.control) {
        let _ = writeln!(out, "  {line}");
    }
}

fn parameter(p: &ParameterValue) -> String {
    format!("{} = {}", p.name, told::with_unit(told::interval(p.value, p.low, p.high), p.unit))
}

fn place(out: &mut String, diagnosis: &Diagnosis, sticks: Actuation) {
    let place = &diagnosis.place;
    let mut lines = Vec::new();
    let stages: Vec<String> = place
        .stages
        .iter()
        .filter_map(|stage| {
            let share = stage.share.filter(|share| *share >= LEAST_PROBABLE)?;
            Some(format!("{} {}", told::percent(share), told::stage(stage.stage)))
        })
        .take(MOST)
        .collect();
    if diagnosis.verdict != Verdict::None && !stages.is_empty() {
        lines.push(format!("by stage: {}", stages.join(", ")));
    }
    let region = place.regions.iter().find(|region| region.gain > told::PLAIN_NATS);
    lines.extend(region.and_then(strongest));
    lines.extend(diagnosis.direct.iter().take(MOST).map(|finding| finding.text.clone()));
    let mut far: Vec<_> = diagnosis.numbers.iter().filter(|number| told::is_far(number)).collect();
    far.sort_by(|a, b| b.sigmas.abs().total_cmp(&a.sigmas.abs()));
    for number in far.into_iter().take(MOST_NUMBERS) {
        let (name, unit) = told::number(number.name, sticks);
        lines.push(format!(
            "fitted without effects, {name} would be {} instead of {}: {} tolerances",
            told::with_unit(digits(number.fitted), &unit),
            digits(number.nominal),
            told::signed(number.sigmas, 1)
        ));
    }
    if lines.is_empty() {
        return;
    }
    out.push_str("\nWhere\n");
    for line in lines {
        let _ = writeln!(out, "  {line}");
    }
}

/// The acceleration that stands out most, with its band.
fn strongest(region: &RegionTold) -> Option<String> {
    let k = told::strongest(region)?;
    let at = told::with_unit(digits(region.at[k]), region.unit);
    Some(format!(
        "strongest over {}: {} m/s^2 (+-{}, 2 sigma) at {at}",
        region.axis,
        told::signed(region.acceleration_m_s2[k], 2),
        told::fixed(2.0 * region.sigma_m_s2[k], 2),
    ))
}

fn how_far(out: &mut String, diagnosis: &Diagnosis) {
    let gap = &diagnosis.gap;
    let best = told::best_effects(diagnosis);
    let _ = writeln!(
        out,
        "\nHow far: error of predictions in cm, intervals of 90 % over flights{}\n  {:<18} {:<17} {:<17} {:<17} misfit above noise, nats",
        if gap.held_out { ", each left out of the fit" } else { "" },
        "ahead by",
        "0.5 s",
        "1 s",
        "2 s"
    );
    let k = &gap.k_step_m;
    let mut rows = vec![
        ("the rig as it is", k.nominal, gap.nominal),
        ("numbers re-fitted", k.parameters_only, gap.parameters_only),
    ];
    if best.is_some() {
        let name = if diagnosis.verdict == Verdict::Effect { "with the effect" } else { "nearest effect" };
        rows.push((name, k.with_effect, gap.with_effect));
    }
    for (name, errors, misfit) in rows {
        let _ = write!(out, "  {name:<18}");
        for error in errors {
            let _ = write!(out, " {:<17}", error.as_ref().map_or_else(|| "-".to_owned(), centimetres));
        }
        let above = told::figure_above_floor(&misfit, &gap.floor);
        let _ = writeln!(out, " {}", told::figure(&above, 1.0, 2));
    }
    if let Some(closure) = told::closure(diagnosis) {
        let _ = writeln!(out, "  {closure}");
    }
}

fn centimetres(error: &Figure) -> String {
    let places = match 100.0 * error.high {
        high if high < 10.0 => 2,
        high if high < 100.0 => 1,
        _ => 0,
    };
    told::figure(error, 100.0, places).replace(" to ", "-")
}
