//! Which effects, with which parameters, and what the rig's own numbers would have to be.

use std::fmt::Write as _;

use bench_diagnosis::{Candidate, Diagnosis, Number};
use bench_page::{Bar, Rows, digits, escaped, range};
use bench_rig::Actuation;

use super::{card, heading, told, unit};

/// Most candidates that are drawn, and the least probability beyond the first few.
const MOST: usize = 8;
const FIRST: usize = 3;
const LEAST: f64 = 0.001;

pub(super) fn section(out: &mut String, diagnosis: &Diagnosis, sticks: Actuation) {
    heading(
        out,
        "Which effect",
        "Every effect of the library and pairs of them compete with no gap at all and with a cause that the library lacks.",
    );
    let shown: Vec<&Candidate> = diagnosis
        .candidates
        .iter()
        .enumerate()
        .filter(|(i, candidate)| *i < FIRST || candidate.probability >= LEAST)
        .map(|(_, candidate)| candidate)
        .take(MOST)
        .collect();
    let mut rows = Rows::new([0.0, 100.0]);
    for (i, candidate) in shown.iter().enumerate() {
        let bar = Bar {
            value: 100.0 * candidate.probability,
            interval: None,
            from: Some(0.0),
            class: if i == 0 { "m2" } else { "m0" },
        };
        rows.row(
            &escaped(&candidate.name.replace('+', " + ")),
            Some(bar),
            &told::percent(candidate.probability),
        );
    }
    out.push_str("<div class=\"wide\">");
    card(out, "Candidates", "", &rows.finish("probability, %"));
    numbers(out, &diagnosis.numbers, sticks);
    out.push_str("</div>");
    parameters(out, &shown);
}

fn parameters(out: &mut String, candidates: &[&Candidate]) {
    if candidates.iter().all(|candidate| candidate.parameters.is_empty()) {
        return;
    }
    let mut content = String::from(
        "<div class=\"scroll\"><table><thead><tr><th>candidate</th><th>parameter</th><th></th><th class=\"number\">value</th>\
         <th>90 % interval</th><th>unit</th><th class=\"number\">evidence, nats</th></tr></thead><tbody>",
    );
    for candidate in candidates {
        for (i, p) in candidate.parameters.iter().filter(|p| told::tells(p)).enumerate() {
            let meaning = told::parameter(p.effect, p.name).map_or("", |parameter| parameter.meaning);
            let (name, evidence) = if i == 0 {
                (candidate.name.replace('+', " + "), told::fixed(candidate.evidence_gain, 1))
            } else {
                Default::default()
            };
            let _ = write!(
                content,
                "<tr><td>{}</td><td>{}</td><td class=\"soft\">{}</td><td class=\"number\">{}</td><td class=\"span\">{} to {}</td><td>{}</td>\
                 <td class=\"number\">{evidence}</td></tr>",
                escaped(&name),
                escaped(p.name),
                escaped(meaning),
                digits(p.value),
                digits(p.low),
                digits(p.high),
                escaped(&unit(p.unit)),
            );
        }
    }
    content.push_str("</tbody></table></div>");
    card(
        out,
        "Parameters",
        "As fitted with each candidate; unit 1 is a ratio. Forms of a law that may as well be its plainest are left out. Evidence is what the candidate gains over no effect at all.",
        &content,
    );
}

fn numbers(out: &mut String, numbers: &[Number], sticks: Actuation) {
    let ends = range(numbers.iter().map(|number| number.sigmas).chain([-2.0, 2.0]));
    let mut rows = Rows::new(ends);
    for number in numbers {
        let (name, of) = told::number(number.name, sticks);
        let class = if told::is_far(number) { "far" } else { "m2" };
        let bar = Bar { value: number.sigmas, interval: None, from: Some(0.0), class };
        let name = format!(
            "{} <small class=\"soft\">{} \u{2192} {}</small>",
            escaped(&name),
            digits(number.nominal),
            escaped(&told::with_unit(digits(number.fitted), &unit(&of)))
        );
        rows.row(&name, Some(bar), &told::signed(number.sigmas, 1));
    }
    card(
        out,
        "The rig's numbers, were there no effect",
        "How far each must move to explain the flights by itself. Beyond 3 tolerances, either the rig is wrong or the \
         number stands in for something missing.",
        &rows.finish("tolerances (one sigma) from the rig's value"),
    );
}
