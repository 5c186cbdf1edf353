//! A score as one page that needs nothing else.

mod charts;
pub(crate) mod words;

use bench_page::{
    Page, Section, Tone, Verdict,
    parts::{Column, Tile, badge, block, cell, folded, table, tiles, warnings},
};
use maud::{Markup, html};

use self::{
    charts::{confusion, detection, reliability},
    words::{figure, percent, rate},
};
use crate::{
    cases::Family,
    score::{ByLabel, Score},
};

/// The score as a self-contained HTML page, light or dark as the reader's system is, with the command that makes it again.
pub fn page(score: &Score, command: &str) -> String {
    let headline = format!("{} of {} sealed cases named rightly", score.top_1.all.count, score.top_1.all.of);
    let below = html! {
        p.lead { "The answers of " (score.tool) " on rig " (score.rig) ", scored by the key after answers and recordings were found as they were hashed." }
        (figures(score))
        (warnings(&not_answered(score)))
    };
    let charts = html! {
        div.grid.wide {
            (block("Detection", "Share of cases by how well they can be seen, with intervals of 95 %. Seen: anything but none was said.", detection(score)))
            (block("Reliability", "Where an answer says 80 %, is it right in 80 %? Ten bins of equal mass.", reliability(score)))
        }
    };
    let confusion = Section::new("What was said of what was true", confusion(score))
        .told("Columns are what was said, rows what was true. Pairs are one label.");
    Page::new(format!("Blind check of {}", score.tool), Verdict::new(Tone::Plain, headline).with(below))
        .sections([
            Section::new("Detection and reliability", charts),
            confusion,
            Section::new("By cause", by_label(score)),
            Section::new("All figures", all_figures(score)),
            Section::new("Case by case", cases(score)),
        ])
        .made_by(command)
        .foot(score.schema)
        .foot(format!("seal {}", score.seal))
        .foot(format!("answers {}", score.answers_sha256))
        .foot(format!("seed {}", score.seed))
        .html()
}

fn not_answered(score: &Score) -> Vec<String> {
    [(&score.missing, "without an answer"), (&score.failed, "on which the tool failed")]
        .into_iter()
        .filter(|(cases, _)| !cases.is_empty())
        .map(|(cases, what)| format!("{} {what}, wrong in every score: {}", cases.len(), cases.join(", ")))
        .collect()
}

fn figures(score: &Score) -> Markup {
    let top = &score.top_1;
    let (ece, ece_interval) = figure(&score.ece, 3);
    let figures = [
        ("named rightly", percent(top.all.value), rate(&top.all)),
        ("of single effects", percent(top.single.value), rate(&top.single)),
        ("of unknown ones", percent(top.outside.value), rate(&top.outside)),
        ("false alarms", percent(score.false_alarms.value), rate(&score.false_alarms)),
        ("calibration error", ece, ece_interval),
    ];
    tiles(figures.map(|(of, value, beside)| Tile { value, of: of.to_owned(), beside }))
}

fn all_figures(score: &Score) -> Markup {
    let rows = words::lines(score).into_iter().map(|(name, value, interval)| {
        let below = name.starts_with(' ');
        vec![
            html! { @if below { "\u{2003}" } (name.trim_start()) },
            cell(value),
            html! { span.soft { (interval) } },
        ]
    });
    table(&[Column::Words(""), Column::Number(""), Column::Words("")], rows)
}

fn by_label(score: &Score) -> Markup {
    let rows = Family::ALL
        .iter()
        .flat_map(|family| score.by_label.iter().filter(move |row| row.family == *family))
        .map(cause);
    let columns = [
        Column::Words("cause"),
        Column::Number("median d\u{2032}"),
        Column::Number("seen"),
        Column::Number("named"),
        Column::Words(""),
    ];
    table(&columns, rows)
}

fn cause(row: &ByLabel) -> Vec<Markup> {
    let share = format!("width:{:.0}%", 100.0 * row.named.value.unwrap_or(0.0));
    vec![
        html! { (row.name) @if row.family == Family::Outside { " " span.soft { "outside" } } },
        cell(format!("{:.1}", row.detectability)),
        cell(format!("{} of {}", row.seen.count, row.seen.of)),
        cell(format!("{} of {}", row.named.count, row.named.of)),
        html! { span.shares { i.share style=(share) {} } },
    ]
}

fn cases(score: &Score) -> Markup {
    let rows = score.case.iter().map(|case| {
        vec![
            cell(&case.case),
            cell(&case.truth),
            html! { span.soft { (case.forms.join(", ")) } },
            cell(format!("{:.1}", case.detectability)),
            badge(Tone::of(case.right), &case.told),
            cell(format!("{:.2}", case.probability)),
        ]
    });
    let columns = [
        Column::Words("case"),
        Column::Words("truth"),
        Column::Words("form"),
        Column::Number("d\u{2032}"),
        Column::Words("told"),
        Column::Number("p(truth)"),
    ];
    folded("Every case", "", false, table(&columns, rows))
}
