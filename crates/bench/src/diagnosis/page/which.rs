//! Which effects, with which parameters, and what the rig's own numbers would have to be.

use bench_diagnosis::{Candidate, Diagnosis, Number};
use bench_page::{
    Section, digits,
    parts::{Bar, Column, Rows, block, cell, table},
    range,
};
use bench_rig::Actuation;
use maud::{Markup, html};

use super::{FOUND, told, unit};

/// Most candidates that are drawn, and the least probability beyond the first few.
const MOST: usize = 8;
const FIRST: usize = 3;
const LEAST: f64 = 0.001;
/// Colours of candidates that do not lead, and of numbers that are far off.
const OTHER: usize = 5;
const FAR: usize = 1;

pub(super) fn section(diagnosis: &Diagnosis, sticks: Actuation) -> Section {
    let shown: Vec<&Candidate> = diagnosis
        .candidates
        .iter()
        .enumerate()
        .filter(|(i, candidate)| *i < FIRST || candidate.probability >= LEAST)
        .map(|(_, candidate)| candidate)
        .take(MOST)
        .collect();
    let mut rows = Rows::new([0.0, 100.0]);
    for candidate in &shown {
        let bar = Bar {
            value: 100.0 * candidate.probability,
            interval: None,
            from: Some(0.0),
            colour: if candidate.name == diagnosis.leading { FOUND } else { OTHER },
        };
        rows.row(named(candidate), Some(bar), &told::percent(candidate.probability));
    }
    let mut parts = Rows::new([0.0, 100.0]);
    let taking_part = told::takes_part(&diagnosis.candidates, LEAST);
    for (effect, probability) in taking_part.iter().take(FIRST) {
        let colour = if diagnosis.effects.contains(effect) { FOUND } else { OTHER };
        let bar = Bar { value: 100.0 * probability, interval: None, from: Some(0.0), colour };
        parts.row((*effect).to_owned(), Some(bar), &told::percent(*probability));
    }
    let body = html! {
        div.grid.wide {
            (block("Candidates", "", rows.finish("probability, %")))
            @if !taking_part.is_empty() {
                (block("Alone or beside another", "", parts.finish("probability, %")))
            }
            (numbers(&diagnosis.numbers, sticks))
        }
        (parameters(&shown))
    };
    Section::new("Which effect", body).told(
        "Every effect of the library and pairs of them compete with no gap at all and with a cause that the library lacks.",
    )
}

fn named(candidate: &Candidate) -> String {
    candidate.name.replace('+', " + ")
}

fn parameters(candidates: &[&Candidate]) -> Markup {
    if candidates.iter().all(|candidate| candidate.parameters.is_empty()) {
        return html! {};
    }
    let columns = [
        Column::Words("candidate"),
        Column::Words("parameter"),
        Column::Words(""),
        Column::Number("value"),
        Column::Words("90 % interval"),
        Column::Words("unit"),
        Column::Number("evidence, nats"),
    ];
    let rows = candidates.iter().flat_map(|candidate| {
        candidate.parameters.iter().filter(|p| told::tells(p)).enumerate().map(|(i, p)| {
            let (name, evidence) = if i == 0 {
                (named(candidate), told::fixed(candidate.evidence_gain, 1))
            } else {
                Default::default()
            };
            let meaning = told::parameter(p.effect, p.name).map_or("", |parameter| parameter.meaning);
            vec![
                cell(name),
                cell(p.name),
                html! { span.soft { (meaning) } },
                cell(digits(p.value)),
                html! { span.nowrap { (digits(p.low)) " to " (digits(p.high)) } },
                cell(unit(p.unit)),
                cell(evidence),
            ]
        })
    });
    block(
        "Parameters",
        "As fitted with each candidate; unit 1 is a ratio. Forms of a law that may as well be its plainest are left out. Evidence is what the candidate gains over no effect at all.",
        table(&columns, rows),
    )
}

fn numbers(numbers: &[Number], sticks: Actuation) -> Markup {
    let ends = range(numbers.iter().map(|number| number.sigmas).chain([-2.0, 2.0]));
    let mut rows = Rows::new(ends);
    for number in numbers {
        let (name, of) = told::number(number.name, sticks);
        let colour = if told::is_far(number) { FAR } else { FOUND };
        let bar = Bar { value: number.sigmas, interval: None, from: Some(0.0), colour };
        let name = html! {
            (name) " " small.soft {
                (digits(number.nominal)) " \u{2192} " (told::with_unit(digits(number.fitted), &unit(&of)))
            }
        };
        rows.row(name, Some(bar), &told::signed(number.sigmas, 1));
    }
    block(
        "The rig's numbers, were there no effect",
        "How far each must move to explain the flights by itself. Beyond 3 tolerances, either the rig is wrong or the \
         number stands in for something missing.",
        rows.finish("tolerances (one sigma) from the rig's value"),
    )
}
