//! What was tuned, as a page.

use bench_page::{
    Mark, Page, Panel, Plot, Section, Series, Tone, Verdict, digits,
    parts::{Column, Tile, badge, block, cell, table, tiles},
};
use maud::{Markup, html};

use crate::{
    margins::{Margins, Response},
    tune::{Trial, Tuned, Tuning},
    verdict::Standing,
};

/// Sets of gains are shown up to so many times what the best needs and misses.
const FAR: f64 = 3.0;
/// Colours of what was before, what is now, and of other sets of gains that hold the limits.
const WAS: usize = 1;
const NOW: usize = 0;
const KEPT: usize = 2;
const BROKEN: usize = 5;

/// What a page tells besides the tuning.
#[derive(Clone, Debug)]
pub struct Made<'a> {
    /// The rig's name.
    pub rig: &'a str,
    /// The command, in words.
    pub command: &'a str,
}

/// The page.
pub fn page(tuning: &Tuning, made: &Made<'_>) -> String {
    let below = html! {
        p.lead { "Gains of " (made.rig) ", tuned on " (tuning.effort.models) " airframes drawn from its tolerances, holding " (digits(tuning.altitude_m)) " m; checked on " (tuning.effort.checked) " fresh ones." }
    };
    Page::new(
        format!("Gains of {}", made.rig),
        Verdict::new(Tone::of(tuning.passed()), tuning.verdict()).with(below),
    )
    .sections(tuning.loops.iter().map(section))
    .made_by(made.command)
    .html()
}

fn section(tuned: &Tuned) -> Section {
    let body = html! {
        (figures(tuned))
        (gains(tuned))
        (growth(tuned))
        (trade_off(tuned))
        @if let Some(after) = &tuned.response_after { (response(tuned, after)) }
    };
    Section::new(format!("The {} loop", tuned.of.name()), body)
}

fn figures(tuned: &Tuned) -> Markup {
    let percent = |x: f64| format!("{:.1}", 100.0 * x);
    let checked = &tuned.checked;
    let delay = tuned.after.margins.and_then(|m| m.delay_s).map_or("-".to_owned(), |s| format!("{s:.2} s"));
    tiles([
        Tile {
            value: format!("{} %", percent(checked.value())),
            of: format!(
                "of {} fresh airframes hold {} cm RMS",
                checked.of,
                digits(100.0 * tuned.limits.rms_m)
            ),
            beside: format!(
                "95 %: {} to {} %; before: {} %",
                percent(checked.low),
                percent(checked.high),
                percent(tuned.checked_before.value())
            ),
        },
        Tile {
            value: format!("{} cm", digits(100.0 * tuned.checked_rms_p95_m[1])),
            of: "RMS, 95th percentile of them".to_owned(),
            beside: format!("before: {} cm", digits(100.0 * tuned.checked_rms_p95_m[0])),
        },
        Tile {
            value: delay,
            of: "more delay until it is lost".to_owned(),
            beside: "of small motions, by the loop's response".to_owned(),
        },
    ])
}

fn gains(tuned: &Tuned) -> Markup {
    let mut rows: Vec<Vec<Markup>> = Vec::new();
    for ((key, before), after) in tuned.keys.iter().zip(&tuned.before.gains).zip(&tuned.after.gains) {
        rows.push(vec![
            html! { code { (key) } },
            cell(digits(*before)),
            cell(digits(*after)),
            cell(""),
            cell(""),
        ]);
    }
    let unstable = |margins: Option<&Margins>| if margins.is_none() { "not stable" } else { "none reached" };
    for judged in &tuned.judged {
        let [after, limit] = judged.apart();
        // A figure of flights is lost where too many did not get through.
        let none = |margins: Option<&Margins>| {
            if judged.between.is_some() { "lost".to_owned() } else { unstable(margins).to_owned() }
        };
        let before = judged.before.map_or_else(|| none(tuned.before.margins.as_ref()), digits);
        let after = judged.after.map_or_else(|| none(tuned.after.margins.as_ref()), |_| after);
        let standing = match (judged.standing, judged.between) {
            (Standing::Held, _) | (Standing::AtLimit, None) => badge(Tone::Good, "held"),
            (Standing::AtLimit, Some([low, high])) => {
                badge(Tone::Odd, &format!("at the limit: {} to {}", digits(low), digits(high)))
            }
            (Standing::Broken, _) => badge(Tone::Bad, "broken"),
        };
        rows.push(vec![cell(judged.name), cell(before), cell(after), cell(limit), standing]);
    }
    let crossover = |margins: Option<&Margins>| {
        margins.and_then(|margins| margins.crossover_hz).map_or_else(|| "-".to_owned(), digits)
    };
    let [before, after] = [&tuned.before, &tuned.after].map(|trial| crossover(trial.margins.as_ref()));
    rows.push(vec![cell("crossover, Hz"), cell(before), cell(after), cell(""), cell("")]);
    let columns = [
        Column::Words(""),
        Column::Number("before"),
        Column::Number("after"),
        Column::Number("limit"),
        Column::Words(""),
    ];
    block(
        "Gains and limits",
        "Figures of flights are 95th percentiles of the fresh airframes, margins those of the nominal loop.",
        table(&columns, rows),
    )
}

fn trade_off(tuned: &Tuned) -> Markup {
    let at = |trial: &Trial| (100.0 * trial.p95.activity, 100.0 * trial.p95.rms_m);
    // What is far off would press the rest into a corner.
    let near = |x: f64, best: f64| x.is_finite() && x <= FAR * best;
    let (best, was) = (&tuned.after.p95, &tuned.before.p95);
    let shown = |trial: &&Trial| {
        near(trial.p95.rms_m, best.rms_m) && near(trial.p95.activity, best.activity) || trial.p95 == *was
    };
    let of = |admissible: bool| {
        let trials = tuned.tried.iter().filter(shown).filter(move |trial| trial.admissible == admissible);
        let mut points: Vec<(f64, f64)> = trials.map(at).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points
    };
    let panel = Panel::new("RMS in hold, cm")
        .with(Series::new("limit broken", Mark::Dots, BROKEN, of(false)))
        .with(Series::new("limits held", Mark::Dots, KEPT, of(true)))
        .with(Series::new("before", Mark::Crosses, WAS, [at(&tuned.before)]))
        .with(Series::new("after", Mark::Crosses, NOW, [at(&tuned.after)]));
    block(
        "What quiet costs",
        "Sets of gains on all models: what they ask of the rotors against how well they hold, 95th percentiles.",
        Plot::new("RMS over activity", "activity, % of weight or gravity").panel(panel),
    )
}

/// The size of a response over frequency, dB.
fn decibels(response: &Response) -> Vec<(f64, f64)> {
    let sizes = response.gain.iter().map(|[re, im]| 20.0 * re.hypot(*im).log10());
    response.frequency_hz.iter().copied().zip(sizes).collect()
}

/// Its phase in degrees below zero, without jumps.
fn degrees(response: &Response) -> Vec<(f64, f64)> {
    let mut turned = 0.0;
    let mut last: Option<f64> = None;
    let phases = response.gain.iter().map(|[re, im]| {
        let phase = im.atan2(*re).to_degrees();
        if let Some(last) = last {
            turned -= ((phase - last) / 360.0).round() * 360.0;
        } else if phase > 0.0 {
            turned = -360.0;
        }
        last = Some(phase);
        phase + turned
    });
    response.frequency_hz.iter().copied().zip(phases).collect()
}

fn response(tuned: &Tuned, after: &Response) -> Markup {
    let panel = |title: &str, curve: fn(&Response) -> Vec<(f64, f64)>| {
        let before = tuned.response_before.as_ref().map(curve).unwrap_or_default();
        Panel::new(title).with(Series::new("before", Mark::Line, WAS, before)).with(Series::new(
            "after",
            Mark::Line,
            NOW,
            curve(after),
        ))
    };
    let plot = Plot::new("The loop's response", "frequency, Hz")
        .panel(panel("size, dB", decibels).level(0.0, "0 dB").y([-30.0, 30.0]))
        .panel(panel("phase, degrees", degrees).level(-180.0, "\u{2212}180\u{b0}").y([-540.0, -60.0]))
        .log_x();
    block(
        "The loop's response",
        "At the plant's input, by injection into the sampled loop: delay, hold, frames and predictor are in it. Where the size is 0 dB, the phase must be above \u{2212}180\u{b0}.",
        plot,
    )
}

fn growth(tuned: &Tuned) -> Markup {
    let grown = || tuned.grown.iter();
    let band = grown().map(|grown| [grown.extra_s, 100.0 * grown.within.low, 100.0 * grown.within.high]);
    let line = || grown().map(|grown| (grown.extra_s, 100.0 * grown.within.value()));
    let panel = Panel::new("models that hold, %")
        .with(Series::band("95 %", Mark::Band, NOW, band))
        .with(Series::new("", Mark::Line, NOW, line()))
        .with(Series::new("", Mark::Dots, NOW, line()))
        .y_fixed([0.0, 105.0]);
    block(
        "When sightings come later than the rig says",
        "Share of the models that still hold within the limit, launch included, with its interval of 95 %.",
        Plot::new("Models that hold over more latency", "latency beyond the rig's, s").panel(panel),
    )
}
