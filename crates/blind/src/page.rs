//! A score as one page that needs nothing else.

mod charts;
pub(crate) mod words;

use std::fmt::Write as _;

use bench_page::{document, escaped};

use self::{
    charts::{confusion, detection, reliability},
    words::{figure, percent, rate},
};
use crate::{
    cases::Family,
    score::{ByLabel, Score},
};

const STYLE: &str = include_str!("page/page.css");

/// The score as a self-contained HTML page, light or dark as the reader's system is.
pub fn page(score: &Score) -> String {
    let mut out = String::new();
    let title = format!("Blind check of {}", score.tool);
    // Writing to a String cannot fail, here and below.
    let _ = write!(out, "<h1>{}</h1><p class=\"lead\">{}</p>", escaped(&title), escaped(&lead(score)));
    not_answered(&mut out, score);
    tiles(&mut out, score);
    out.push_str("<div class=\"two\">");
    card(
        &mut out,
        "Detection",
        "Share of cases by how well they can be seen, with intervals of 95 %.",
        &detection(score),
    );
    card(
        &mut out,
        "Reliability",
        "Where an answer says 80 %, is it right in 80 %? Ten bins of equal mass.",
        &reliability(score),
    );
    out.push_str("</div>");
    card(
        &mut out,
        "Confusion",
        "What was said (columns) of what was true (rows). Pairs are one label.",
        &confusion(score),
    );
    figures(&mut out, score);
    by_label(&mut out, score);
    cases(&mut out, score);
    let _ = write!(
        out,
        "<footer>{} &middot; seal {} &middot; answers {} &middot; seed {}</footer>",
        score.schema, score.seal, score.answers_sha256, score.seed
    );
    document(&title, STYLE, &out)
}

fn lead(score: &Score) -> String {
    format!(
        "{} sealed cases of rig {}, scored by the key after answers and recordings were found as they were hashed.",
        score.cases, score.rig
    )
}

fn not_answered(out: &mut String, score: &Score) {
    for (cases, what) in [(&score.missing, "without an answer"), (&score.failed, "on which the tool failed")]
    {
        if !cases.is_empty() {
            let _ = write!(
                out,
                "<p class=\"card warn\"><b>{} {what}</b>, wrong in every score: {}</p>",
                cases.len(),
                escaped(&cases.join(", "))
            );
        }
    }
}

fn tiles(out: &mut String, score: &Score) {
    let top = &score.top_1;
    out.push_str("<div class=\"tiles\">");
    for (name, value, soft) in [
        ("named rightly", percent(top.all.value), rate(&top.all)),
        ("of single effects", percent(top.single.value), rate(&top.single)),
        ("of unknown ones", percent(top.outside.value), rate(&top.outside)),
        ("false alarms", percent(score.false_alarms.value), rate(&score.false_alarms)),
        ("calibration error", figure(&score.ece, 3).0, figure(&score.ece, 3).1),
    ] {
        let _ =
            write!(out, "<div class=\"tile\"><b>{value}</b><span>{name}</span><small>{soft}</small></div>");
    }
    out.push_str("</div>");
}

fn card(out: &mut String, title: &str, words: &str, content: &str) {
    let _ = write!(
        out,
        "<section class=\"card\"><h2>{title}</h2><p class=\"soft\">{words}</p>{content}</section>"
    );
}

fn figures(out: &mut String, score: &Score) {
    out.push_str("<section class=\"card\"><h2>All figures</h2><div class=\"scroll\"><table><tbody>");
    for (name, value, interval) in words::lines(score) {
        let _ = write!(
            out,
            "<tr><td>{}</td><td class=\"number\">{value}</td><td class=\"soft\">{interval}</td></tr>",
            escaped(name)
        );
    }
    out.push_str("</tbody></table></div></section>");
}

fn by_label(out: &mut String, score: &Score) {
    out.push_str(
        "<section class=\"card\"><h2>By cause</h2><div class=\"scroll\"><table><thead><tr><th>cause</th>\
         <th class=\"number\">median d&prime;</th><th class=\"number\">seen</th><th class=\"number\">named</th><th></th></tr></thead><tbody>",
    );
    for family in Family::ALL {
        for row in score.by_label.iter().filter(|row| row.family == family) {
            cause(out, row);
        }
    }
    out.push_str("</tbody></table></div></section>");
}

fn cause(out: &mut String, row: &ByLabel) {
    let outside = if row.family == Family::Outside { " <span class=\"soft\">outside</span>" } else { "" };
    let share = 100.0 * row.named.value.unwrap_or(0.0);
    let _ = write!(
        out,
        "<tr><td>{}{outside}</td><td class=\"number\">{:.1}</td><td class=\"number\">{} of {}</td>\
         <td class=\"number\">{} of {}</td><td class=\"wide\"><i class=\"bar\" style=\"width:{share:.0}%\"></i></td></tr>",
        escaped(&row.name),
        row.detectability,
        row.seen.count,
        row.seen.of,
        row.named.count,
        row.named.of,
    );
}

fn cases(out: &mut String, score: &Score) {
    out.push_str(
        "<details class=\"card\"><summary>Case by case</summary><div class=\"scroll\"><table><thead><tr><th>case</th>\
         <th>truth</th><th>form</th><th class=\"number\">d&prime;</th><th>told</th><th class=\"number\">p(truth)</th></tr></thead><tbody>",
    );
    for case in &score.case {
        let _ = write!(
            out,
            "<tr class=\"{}\"><td>{}</td><td>{}</td><td class=\"soft\">{}</td><td class=\"number\">{:.1}</td>\
             <td class=\"told\">{}</td><td class=\"number\">{:.2}</td></tr>",
            if case.right { "right" } else { "wrong" },
            escaped(&case.case),
            escaped(&case.truth),
            escaped(&case.forms.join(", ")),
            case.detectability,
            escaped(&case.told),
            case.probability,
        );
    }
    out.push_str("</tbody></table></div></details>");
}
