//! The report as one page that needs nothing else, and as sections of another page.

use bench_page::{
    Page, Section, Verdict as PageVerdict, capitalised, digits,
    parts::{Column, badge, block, cell, facts, folded, list, table},
};
use maud::{Markup, html};

use super::{
    DiffReport, FieldReport, RecordingSummary, Verdict,
    plots::{self, timeline, tone, traces},
    text::{self, quantity},
};

/// The report as a self-contained HTML page, light or dark as the reader's system is, with the command that makes it again.
pub fn render_html(report: &DiffReport, command: &str) -> String {
    Page::new(format!("{} against {}", file_name(&report.a), file_name(&report.b)), html_verdict(report))
        .sections(html_sections(report))
        .made_by(command)
        .foot(DiffReport::SCHEMA)
        .html()
}

/// What the report comes to, for the top of a page.
pub fn html_verdict(report: &DiffReport) -> PageVerdict {
    let (_, rest) = report.summary.split_once(": ").unwrap_or(("", &report.summary));
    let counts = [
        Verdict::Different,
        Verdict::Missing,
        Verdict::NotComparable,
        Verdict::WithinTolerance,
        Verdict::Same,
    ];
    let counts = counts.map(|verdict| (text::counted(report, verdict), verdict));
    let recordings = [("A", plots::A, &report.a), ("B", plots::B, &report.b)];
    let below = html! {
        p.lead { (capitalised(rest)) }
        p.soft { @for (count, verdict) in counts { @if count > 0 { (badge(tone(verdict), &format!("{count} {}", verdict.name()))) " \u{2002} " } } }
        @for (name, colour, recording) in recordings {
            p { span.swatch.{ "c" (colour) } {} b { (name) } " " (file_name(recording)) " " span.soft { (text::recording(recording)) } }
        }
        (list(&report.notes.iter().map(|note| capitalised(note)).collect::<Vec<_>>()))
    };
    PageVerdict::new(tone(report.verdict), capitalised(report.verdict.name())).with(below)
}

/// The parts of the page: what differs first, how it was compared last.
pub fn html_sections(report: &DiffReport) -> Vec<Section> {
    let counts = |field: &&FieldReport| field.counts();
    let of = |verdict| report.fields.iter().filter(counts).filter(move |field| field.verdict == verdict);
    let aside = || report.fields.iter().filter(|field| !field.counts());
    let sections = [
        open(report, "Different", of(Verdict::Different)),
        absent("Missing or not comparable", of(Verdict::Missing).chain(of(Verdict::NotComparable))),
        closed(report, "Within tolerance", of(Verdict::WithinTolerance)),
        closed(report, "Same", of(Verdict::Same)),
        closed(report, "Not counted", aside().filter(|field| field.reason.is_none())),
        absent("Not counted, in one recording only", aside().filter(|field| field.reason.is_some())),
    ];
    sections.into_iter().flatten().chain([alignment(report)]).collect()
}

fn alignment(report: &DiffReport) -> Section {
    let shift_s = -report.alignment.offset_s;
    let (a, b) = (&report.a, &report.b);
    let t = [a.first_s.min(b.first_s + shift_s), a.last_s.max(b.last_s + shift_s)];
    let body = html! {
        p { (capitalised(&text::alignment(report))) "." }
        p { (capitalised(&text::coverage(report))) "." }
        @if let Some(origin) = text::tolerances(report) { p.soft { (capitalised(&origin)) "." } }
        @if !a.phases.is_empty() || !b.phases.is_empty() {
            (timeline([("A", &a.phases, 0.0), ("B", &b.phases, shift_s)], t))
        }
    };
    Section::new("How they were compared", body)
}

/// So many fields that differ stand in sight, the worst; more of them open on a click.
const IN_SIGHT: usize = 12;

/// Fields that differ, the worst with their traces in sight.
fn open<'a>(
    report: &DiffReport,
    title: &str,
    fields: impl Iterator<Item = &'a FieldReport>,
) -> Option<Section> {
    let fields: Vec<&FieldReport> = fields.collect();
    let (in_sight, others) = fields.split_at(fields.len().min(IN_SIGHT));
    let body = html! {
        @for field in in_sight {
            (block(&format!("{}: {}", field.path(), headline(field)), "", detail(report, field, true)))
        }
        @if !others.is_empty() {
            div.block { @for field in others { (closed_field(report, field)) } }
        }
    };
    let words = "The difference first, with what is tolerated shaded where that is one number; below it the recordings. Times are on the clock of A.";
    (!fields.is_empty()).then(|| Section::new(title, body).told(words))
}

/// Facts and traces. Where a field is not in sight, the difference to A tells what B is.
fn detail(report: &DiffReport, field: &FieldReport, with_b: bool) -> Markup {
    html! { (facts(told(field))) (traces(field, &report.a.phases, with_b)) }
}

fn closed_field(report: &DiffReport, field: &FieldReport) -> Markup {
    folded(field.path(), &headline(field), false, detail(report, field, false))
}

/// Fields that open on a click.
fn closed<'a>(
    report: &DiffReport,
    title: &str,
    fields: impl Iterator<Item = &'a FieldReport>,
) -> Option<Section> {
    let folds: Vec<Markup> = fields.map(|field| closed_field(report, field)).collect();
    (!folds.is_empty()).then(|| Section::new(title, html! { @for fold in folds { (fold) } }))
}

fn absent<'a>(title: &str, fields: impl Iterator<Item = &'a FieldReport>) -> Option<Section> {
    let rows: Vec<Vec<Markup>> = fields
        .map(|field| {
            let why = field.reason.as_ref().map_or_else(String::new, ToString::to_string);
            vec![cell(field.path()), cell(why), cell(field.samples.a), cell(field.samples.b)]
        })
        .collect();
    let columns =
        [Column::Words("field"), Column::Words("why"), Column::Number("in A"), Column::Number("in B")];
    (!rows.is_empty()).then(|| Section::new(title, table(&columns, rows)))
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

fn told(field: &FieldReport) -> Vec<(&'static str, String)> {
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
    facts
}

fn file_name(recording: &RecordingSummary) -> &str {
    recording.path.rsplit(['/', '\\']).next().unwrap_or(&recording.path)
}
