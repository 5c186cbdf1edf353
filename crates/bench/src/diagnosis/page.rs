//! A diagnosis as one page that needs nothing else.

mod flights;
mod how_far;
mod place;
mod which;

use std::fmt::Write as _;

use bench_diagnosis::{Diagnosis, Verdict};
use bench_page::{document, escaped};
use bench_rig::Rig;

use super::{
    report::{Conclusion, Report},
    told,
};
use crate::words;

const STYLE: &str = include_str!("page.css");

/// What a page tells besides the diagnosis.
pub struct Made<'a> {
    /// The rig that was held against the flights.
    pub rig: &'a Rig,
    /// The command, word by word.
    pub command: Vec<String>,
}

/// The page.
pub fn page(report: &Report, made: &Made<'_>) -> String {
    let mut out = String::new();
    let diagnosis = &report.diagnosis;
    head(&mut out, report, made);
    tiles(&mut out, report);
    list(&mut out, "What to do next", "card", &diagnosis.next);
    list(&mut out, "Warnings", "card warn", &diagnosis.warnings);
    how_far::section(&mut out, diagnosis);
    place::section(&mut out, diagnosis);
    which::section(&mut out, diagnosis, made.rig.airframe.actuation);
    flights::section(&mut out, diagnosis);
    again(&mut out, diagnosis, made);
    document(&format!("Diagnosis: {}", report.sentence()), STYLE, &out)
}

fn head(out: &mut String, report: &Report, made: &Made<'_>) {
    let diagnosis = &report.diagnosis;
    let class = match report.verdict {
        Conclusion::Effect => "effect",
        Conclusion::None => "none",
        Conclusion::Unknown => "unknown",
        Conclusion::Inconclusive => "inconclusive",
    };
    // Writing to a String cannot fail, here and below.
    let _ = write!(
        out,
        "<section class=\"card verdict {class}\"><h1>{}</h1>",
        escaped(&report.headline()).replace(" %", "&nbsp;%")
    );
    for effect in report.effects.iter().filter_map(|name| told::spec(name)) {
        let _ = write!(
            out,
            "<p class=\"lead\"><b>{}</b> ({}): {}</p>",
            effect.name,
            effect.stage.name(),
            escaped(effect.summary)
        );
    }
    if diagnosis.set.len() > 1 {
        let _ = write!(
            out,
            "<p>With 90 % or more, the truth is one of: {}.</p>",
            escaped(&diagnosis.set.join(", "))
        );
    }
    let alike = told::alike(diagnosis);
    if !alike.is_empty() {
        let _ = write!(out, "<p>These flights cannot tell it from: {}.</p>", escaped(&alike.join(", ")));
    }
    let sightings: usize = diagnosis.flights.iter().map(|flight| flight.sightings).sum();
    let _ = write!(
        out,
        "<p class=\"soft\">Rig {}, airframe {}; {} with {}; calibration of probabilities: {}{} ({}; the same elsewhere by {}).</p></section>",
        escaped(&made.rig.name),
        escaped(&made.rig.airframe.name),
        words::count(diagnosis.flights.len() as u64, "flight"),
        words::count(sightings as u64, "sighting"),
        escaped(&diagnosis.calibration.source),
        match diagnosis.calibration.cases {
            0 => String::new(),
            cases => format!(", {}", words::count(cases as u64, "case")),
        },
        escaped(&report.calibration_choice.why),
        escaped(&report.calibration_choice.again)
    );
}

fn tiles(out: &mut String, report: &Report) {
    let diagnosis = &report.diagnosis;
    let gap = &diagnosis.gap;
    let sure = if report.verdict == Conclusion::Inconclusive {
        format!("for {}, which leads", report.leading)
    } else {
        "sure of the verdict".to_owned()
    };
    let mut tiles = vec![(escaped(&sure), told::percent(diagnosis.confidence), String::new())];
    if let Some(closure) = gap.closure.filter(|_| diagnosis.verdict == Verdict::Effect) {
        tiles.push((
            "of the gap closed".to_owned(),
            format!("{} %", told::fixed(100.0 * closure.value, 0)),
            format!(
                "{} to {} %, beyond re-fitting",
                told::fixed(100.0 * closure.low, 0),
                told::fixed(100.0 * closure.high, 0)
            ),
        ));
    }
    let (after, how) = if diagnosis.verdict == Verdict::Effect {
        (gap.k_step_m.with_effect[1], "with the effect")
    } else {
        (gap.k_step_m.parameters_only[1], "with numbers re-fitted")
    };
    if let (Some(before), Some(after)) = (gap.k_step_m.nominal[1], after) {
        tiles.push((
            "error of predictions 1 s ahead".to_owned(),
            format!("{} cm", told::fixed(100.0 * after.value, 1)),
            format!("{how}; {} cm with the rig as it is", told::fixed(100.0 * before.value, 1)),
        ));
    }
    // Without a gap, stages share out what lies within tolerance.
    let stages = if diagnosis.verdict == Verdict::None { &[] } else { diagnosis.place.stages.as_slice() };
    if let Some((stage, share)) = stages.first().and_then(|s| Some((s, s.share?))) {
        let gain = told::figure(&stage.gain_nats, 1.0, 0);
        tiles.push((
            format!("of the gap in {}", told::stage(stage.stage)),
            told::percent(share),
            format!("{gain} nats"),
        ));
    }
    out.push_str("<div class=\"tiles\">");
    for (name, value, soft) in tiles {
        let _ = write!(
            out,
            "<div class=\"tile\"><b>{value}</b><span>{name}</span><small>{}</small></div>",
            escaped(&soft)
        );
    }
    out.push_str("</div>");
}

fn list(out: &mut String, title: &str, class: &str, lines: &[String]) {
    if lines.is_empty() {
        return;
    }
    let _ = write!(out, "<section class=\"{class}\"><h3>{title}</h3><ul>");
    for line in lines {
        let _ = write!(out, "<li>{}</li>", code(line));
    }
    out.push_str("</ul></section>");
}

/// Text whose back-quoted parts are code.
fn code(text: &str) -> String {
    escaped(text).split('`').enumerate().fold(String::new(), |out, (i, part)| {
        if i % 2 == 1 { format!("{out}<code>{part}</code>") } else { out + part }
    })
}

/// The heading of a part, and how to read it.
fn heading(out: &mut String, title: &str, words: &str) {
    let _ = write!(out, "<h2>{title}</h2><p class=\"soft\">{words}</p>");
}

fn card(out: &mut String, title: &str, words: &str, content: &str) {
    let _ = write!(
        out,
        "<section class=\"card\"><h3>{}</h3><p class=\"soft\">{}</p>{content}</section>",
        escaped(title),
        escaped(words)
    );
}

/// Units as they are printed.
fn unit(unit: &str) -> String {
    unit.replace("^2", "\u{b2}")
}

fn capitalised(words: &str) -> String {
    let mut characters = words.chars();
    characters.next().map_or_else(String::new, |first| first.to_uppercase().chain(characters).collect())
}

fn again(out: &mut String, diagnosis: &Diagnosis, made: &Made<'_>) {
    let command: Vec<String> = made.command.iter().map(|word| words::quoted(word)).collect();
    let _ = write!(
        out,
        "<h2>Make it again</h2><section class=\"card\"><pre>{}</pre></section>\
         <footer>bench {} &middot; {} &middot; rig {}</footer>",
        escaped(&command.join(" ")),
        env!("CARGO_PKG_VERSION"),
        diagnosis.schema,
        escaped(&made.rig.name)
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn back_quotes_become_code_and_markup_stays_text() {
        assert_eq!(code("run `a <b>` & so"), "run <code>a &lt;b&gt;</code> &amp; so");
    }
}
