//! The report as one page that needs nothing else.

use std::fmt::Write as _;

use bench_page::{digits, document, escaped};

use super::{
    DiffReport, FieldReport, RecordingSummary, Verdict,
    chart::{charts, phase_row, time_axis},
    text::{self, quantity},
};

const STYLE: &str = include_str!("html.css");

/// The report as a self-contained HTML page, light or dark as the reader's system is.
pub fn render_html(report: &DiffReport) -> String {
    let mut out = String::new();
    let title = format!("{} against {}", file_name(&report.a), file_name(&report.b));
    head(&mut out, report);
    phases(&mut out, report);
    let counts = |field: &&FieldReport| field.counts();
    let of = |verdict| report.fields.iter().filter(counts).filter(move |field| field.verdict == verdict);
    section(&mut out, report, "Different", of(Verdict::Different), true);
    absent(&mut out, "Missing or not comparable", of(Verdict::Missing).chain(of(Verdict::NotComparable)));
    section(&mut out, report, "Within tolerance", of(Verdict::WithinTolerance), false);
    section(&mut out, report, "Same", of(Verdict::Same), false);
    let aside = || report.fields.iter().filter(|field| !field.counts());
    section(&mut out, report, "Not counted", aside().filter(|field| field.reason.is_none()), false);
    absent(&mut out, "Not counted, in one recording only", aside().filter(|field| field.reason.is_some()));
    let _ = write!(out, "<footer>{}, times on the clock of A</footer>", DiffReport::SCHEMA);
    document(&title, STYLE, &out)
}

fn head(out: &mut String, report: &DiffReport) {
    let (_, rest) = report.summary.split_once(": ").unwrap_or(("", &report.summary));
    let _ = write!(
        out,
        "<section class=\"card verdict {}\"><h1>{}</h1><p class=\"lead\">{}</p><ul class=\"counts\">",
        class(report.verdict),
        capitalised(report.verdict.name()),
        escaped(&capitalised(rest))
    );
    for verdict in [
        Verdict::Different,
        Verdict::Missing,
        Verdict::NotComparable,
        Verdict::WithinTolerance,
        Verdict::Same,
    ] {
        let count = text::counted(report, verdict);
        if count > 0 {
            let _ = write!(out, "<li class=\"{}\"><b>{count}</b> {}</li>", class(verdict), verdict.name());
        }
    }
    out.push_str("</ul></section><div class=\"pair\">");
    for (name, key, recording) in [("A", "a", &report.a), ("B", "b", &report.b)] {
        let _ = write!(
            out,
            "<section class=\"card\"><h3><span class=\"key {key}\"></span>{name} <span class=\"channel\">{}</span></h3>\
             <p class=\"soft\">{}</p></section>",
            escaped(file_name(recording)),
            escaped(&text::recording(recording))
        );
    }
    out.push_str("</div>");
}

fn phases(out: &mut String, report: &DiffReport) {
    out.push_str("<h2>Alignment</h2><section class=\"card\">");
    let _ = write!(out, "<p>{}</p>", escaped(&capitalised(&text::alignment(report))));
    let _ = write!(out, "<p>{}</p>", escaped(&capitalised(&text::coverage(report))));
    if let Some(origin) = text::tolerances(report) {
        let _ = write!(out, "<p class=\"soft\">{}</p>", escaped(&capitalised(&origin)));
    }
    for note in &report.notes {
        let _ = write!(out, "<p class=\"soft\">{}</p>", escaped(&capitalised(note)));
    }
    if !report.a.phases.is_empty() || !report.b.phases.is_empty() {
        let shift_s = -report.alignment.offset_s;
        let t = [
            report.a.first_s.min(report.b.first_s + shift_s),
            report.a.last_s.max(report.b.last_s + shift_s),
        ];
        out.push_str("<div class=\"phases\">");
        phase_row(out, "A", &report.a.phases, 0.0, t);
        phase_row(out, "B", &report.b.phases, shift_s, t);
        time_axis(out, t);
        out.push_str("</div>");
    }
    out.push_str("</section>");
}

/// Fields with their charts; closed ones open on a click.
fn section<'a>(
    out: &mut String,
    report: &DiffReport,
    title: &str,
    fields: impl Iterator<Item = &'a FieldReport>,
    open: bool,
) {
    let mut fields = fields.peekable();
    if fields.peek().is_some() {
        let _ = write!(out, "<h2>{title}</h2>");
    }
    for field in fields {
        let _ = write!(
            out,
            "<details class=\"card\"{}><summary>{}<span class=\"soft\">{}</span></summary><div>{}{}</div></details>",
            if open { " open" } else { "" },
            heading(field),
            escaped(&headline(field)),
            facts(field),
            charts(field, &report.a.phases)
        );
    }
}

fn absent<'a>(out: &mut String, title: &str, fields: impl Iterator<Item = &'a FieldReport>) {
    let mut fields = fields.peekable();
    if fields.peek().is_none() {
        return;
    }
    let _ = write!(
        out,
        "<h2>{title}</h2><section class=\"card scroll\"><table><tr><th>Field</th><th>Why</th><th>In A</th><th>In B</th></tr>"
    );
    for field in fields {
        let why = field.reason.as_ref().map_or_else(String::new, ToString::to_string);
        let _ = write!(
            out,
            "<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
            heading(field),
            escaped(&why),
            field.samples.a,
            field.samples.b
        );
    }
    out.push_str("</table></section>");
}

fn heading(field: &FieldReport) -> String {
    format!("<h3><span class=\"channel\">{}/</span>{}</h3>", escaped(&field.channel), escaped(&field.field))
}

/// The difference in a few words.
fn headline(field: &FieldReport) -> String {
    if field.verdict == Verdict::Same {
        return "same".to_owned();
    }
    let Some(difference) = &field.difference else { return field.verdict.name().to_owned() };
    match (difference.largest, difference.times_tolerance) {
        (Some(largest), Some(times)) => {
            format!("{}, {} \u{d7} tolerance", quantity(largest, &field.unit), digits(times))
        }
        (Some(largest), None) => quantity(largest, &field.unit),
        (None, _) => format!("{} samples beyond tolerance", difference.beyond),
    }
}

fn facts(field: &FieldReport) -> String {
    let mut facts: Vec<(&str, String)> = Vec::new();
    let unit = field.unit.as_str();
    if let Some(difference) = field.difference.as_ref().filter(|_| field.verdict != Verdict::Same) {
        if let (Some(largest), Some(at_s)) = (difference.largest, difference.largest_at_s) {
            facts.push(("largest", format!("{} at {at_s:.2} s", quantity(largest, unit))));
        }
        if let (Some(rms), Some(mean)) = (difference.rms, difference.mean) {
            facts.push(("rms", quantity(rms, unit)));
            facts.push(("mean", quantity(mean, unit)));
        }
        if let Some(first_s) = difference.first_s {
            let all = field.samples.a_compared + field.samples.b_compared;
            match difference.beyond {
                0 => facts.push(("first beyond the rms allowed", format!("{first_s:.2} s"))),
                beyond => {
                    facts.push(("first beyond", format!("{first_s:.2} s")));
                    facts.push(("beyond", format!("{beyond} of {all} samples")));
                }
            }
        }
        if let Some([a, b]) = &difference.first_names {
            facts.push(("there", format!("{a} in A, {b} in B")));
        }
    }
    if let Some(limit) = &field.tolerance {
        facts.push(("tolerance", format!("{} ({})", text::tolerance(limit, unit), text::origin(limit))));
    }
    if let Some(lag) = &field.lag {
        let word = if lag.lag_s >= 0.0 { "later" } else { "earlier" };
        facts.push((
            "lag",
            format!("B {:.3} s {word}, explains {:.0} %", lag.lag_s.abs(), 100.0 * lag.explained),
        ));
    }
    let samples = &field.samples;
    if samples.a_compared < samples.a || samples.b_compared < samples.b {
        let both = format!(
            "{} of {} in A, {} of {} in B",
            samples.a_compared, samples.a, samples.b_compared, samples.b
        );
        facts.push(("compared", both));
    }
    if let Some(why) = field.excluded {
        facts.push(("not counted", why.name().to_owned()));
    }
    let mut out = String::from("<dl class=\"facts\">");
    for (name, value) in facts {
        let _ = write!(out, "<div><dt>{name}</dt><dd>{}</dd></div>", escaped(&value));
    }
    out.push_str("</dl>");
    out
}

const fn class(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Same => "same",
        Verdict::WithinTolerance => "within-tolerance",
        Verdict::Different => "different",
        Verdict::Missing => "missing",
        Verdict::NotComparable => "not-comparable",
    }
}

fn file_name(recording: &RecordingSummary) -> &str {
    recording.path.rsplit(['/', '\\']).next().unwrap_or(&recording.path)
}

fn capitalised(words: &str) -> String {
    let mut characters = words.chars();
    characters.next().map_or_else(String::new, |first| first.to_uppercase().chain(characters).collect())
}
