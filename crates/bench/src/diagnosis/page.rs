//! A diagnosis as one page that needs nothing else, and as sections of another page.

mod flights;
mod how_far;
mod place;
mod which;

use bench_diagnosis::Verdict;
use bench_page::{
    Page, Section, Verdict as PageVerdict,
    parts::{self, Tile},
};
use bench_rig::Rig;
use maud::{Markup, html};

use super::{
    report::{Conclusion, Report},
    told,
};
use crate::{nominal, words};

/// Colours of the levels of the gap: the rig as it is, re-fitted, with the effect.
const LEVELS: [usize; 3] = [5, 4, 0];
/// The colour of what leads and of what is found.
const FOUND: usize = 0;
/// The colour of the acceleration that is not explained.
const PULL: usize = 3;

/// The page.
pub fn page(report: &Report, rig: &Rig) -> String {
    Page::new(format!("Diagnosis: {}", report.sentence()), verdict(report, rig))
        .sections(sections(report, rig))
        .made_by(words::command())
        .foot(report.diagnosis.schema)
        .foot(format!("rig {}", rig.name))
        .html()
}

/// What the diagnosis comes to: the sentence, the figures, what to do next.
pub fn verdict(report: &Report, rig: &Rig) -> PageVerdict {
    let diagnosis = &report.diagnosis;
    let alike = told::alike(diagnosis);
    let below = html! {
        @for effect in report.effects.iter().filter_map(|name| told::spec(name)) {
            p.lead { b { (effect.name) } " (" (effect.stage.name()) "): " (effect.summary) }
        }
        @if diagnosis.set.len() > 1 {
            p { "With 90 % or more, the truth is one of: " (diagnosis.set.join(", ")) "." }
        }
        @if !alike.is_empty() { p { "These flights cannot tell it from: " (alike.join(", ")) "." } }
        (tiles(report))
        @if let Some(model) = &report.model {
            @let lines = nominal::in_words(&model.laws, &model.control);
            (parts::block("The model", &words::count(model.flights.len() as u64, "nominal flight"), parts::list(&lines)))
        }
        (parts::warnings(&diagnosis.warnings))
        @if !diagnosis.next.is_empty() { (parts::block("What to do next", "", parts::list(&diagnosis.next))) }
        (made_of(report, rig))
    };
    PageVerdict::new(report.tone(), report.headline().replace(" %", "\u{a0}%")).with(below)
}

fn made_of(report: &Report, rig: &Rig) -> Markup {
    let diagnosis = &report.diagnosis;
    let measurements: usize = diagnosis.flights.iter().map(|flight| flight.measurements).sum();
    let cases = match diagnosis.calibration.cases {
        0 => String::new(),
        cases => format!(", {}", words::count(cases as u64, "case")),
    };
    html! {
        p.soft {
            "Rig " (rig.name) ", airframe " (rig.airframe.name) "; "
            (words::count(diagnosis.flights.len() as u64, "flight")) " with "
            (words::count(measurements as u64, "measurement")) "; calibration of probabilities: "
            (diagnosis.calibration.source) (cases) " (" (report.calibration_choice.why) "; the same elsewhere by "
            (report.calibration_choice.again) ")."
        }
    }
}

/// The parts of the page below the verdict.
pub fn sections(report: &Report, rig: &Rig) -> Vec<Section> {
    let diagnosis = &report.diagnosis;
    vec![
        how_far::section(diagnosis),
        place::section(diagnosis),
        which::section(diagnosis, rig.airframe.actuation),
        flights::section(diagnosis),
    ]
}

fn tiles(report: &Report) -> Markup {
    let diagnosis = &report.diagnosis;
    let gap = &diagnosis.gap;
    let sure = if report.verdict == Conclusion::Inconclusive {
        format!("for {}, which leads", told::answer(diagnosis))
    } else {
        "sure of the verdict".to_owned()
    };
    let mut tiles =
        vec![Tile { value: told::percent(diagnosis.confidence), of: sure, beside: String::new() }];
    if let Some(closure) = gap.closure.filter(|_| diagnosis.verdict == Verdict::Effect) {
        let [value, low, high] =
            [closure.value, closure.low, closure.high].map(|share| told::fixed(100.0 * share, 0));
        tiles.push(Tile {
            value: format!("{value} %"),
            of: "of the gap closed".to_owned(),
            beside: format!("{low} to {high} %, beyond re-fitting"),
        });
    }
    let (after, how) = if diagnosis.verdict == Verdict::Effect {
        (gap.k_step_m.with_effect[1], "with the effect")
    } else {
        (gap.k_step_m.parameters_only[1], "with numbers re-fitted")
    };
    if let (Some(before), Some(after)) = (gap.k_step_m.nominal[1], after) {
        tiles.push(Tile {
            value: format!("{} cm", told::fixed(100.0 * after.value, 1)),
            of: "error of predictions 1 s ahead".to_owned(),
            beside: format!("{how}; {} cm with the rig as it is", told::fixed(100.0 * before.value, 1)),
        });
    }
    // Without a gap, stages share out what lies within tolerance.
    let stages = if diagnosis.verdict == Verdict::None { &[] } else { diagnosis.place.stages.as_slice() };
    if let Some((stage, share)) = stages.first().and_then(|s| Some((s, s.share?))) {
        tiles.push(Tile {
            value: told::percent(share),
            of: format!("of the gap in {}", told::stage(stage.stage)),
            beside: format!("{} nats", told::figure(&stage.gain_nats, 1.0, 0)),
        });
    }
    parts::tiles(tiles)
}

/// Units as they are printed.
fn unit(unit: &str) -> String {
    unit.replace("^2", "\u{b2}")
}
