//! What was tuned, as a page.

use std::fmt::Write as _;

use bench_page::{Frame, digits, document, escaped, range, ticks, x_axis};

use crate::{
    margins::{Margins, Response},
    tune::{Trial, Tuned, Tuning},
    verdict::Standing,
};

const STYLE: &str = include_str!("page.css");

/// Sets of gains are shown up to so many times what the best needs and misses.
const FAR: f64 = 3.0;

type Curve<'a> = &'a dyn Fn(&Response) -> Vec<[f64; 2]>;

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
    let mut out = String::new();
    // Writing to a String cannot fail, here and below.
    let _ = write!(
        out,
        "<section class=\"card\"><h1>Gains of {}</h1><p><strong>{}</strong></p><p class=\"soft\">Tuned on {} airframes drawn from the rig's tolerances, \
         holding {} m; checked on {} fresh ones.</p></section>",
        escaped(made.rig),
        escaped(&tuning.verdict()),
        tuning.effort.models,
        digits(tuning.altitude_m),
        tuning.effort.checked
    );
    for tuned in &tuning.loops {
        section(&mut out, tuned);
    }
    let _ = write!(out, "<footer>{}</footer>", escaped(made.command));
    document(&format!("Gains of {}", made.rig), STYLE, &out)
}

fn section(out: &mut String, tuned: &Tuned) {
    let _ = write!(out, "<h2>The {} loop</h2>", tuned.of.name());
    tiles(out, tuned);
    gains(out, tuned);
    trade_off(out, tuned);
    response(out, tuned);
    growth(out, tuned);
}

fn tiles(out: &mut String, tuned: &Tuned) {
    let percent = |x: f64| format!("{:.1}", 100.0 * x);
    let checked = &tuned.checked;
    let delay = tuned.after.margins.and_then(|m| m.delay_s).map_or("-".to_owned(), |s| format!("{s:.2} s"));
    let tiles = [
        (
            format!("{} %", percent(checked.value())),
            format!("of {} fresh airframes hold {} cm RMS", checked.of, digits(100.0 * tuned.limits.rms_m)),
            format!(
                "95 %: {} to {} %; before: {} %",
                percent(checked.low),
                percent(checked.high),
                percent(tuned.checked_before.value())
            ),
        ),
        (
            format!("{} cm", digits(100.0 * tuned.checked_rms_p95_m[1])),
            "RMS, 95th percentile of them".to_owned(),
            format!("before: {} cm", digits(100.0 * tuned.checked_rms_p95_m[0])),
        ),
        (
            delay,
            "more delay until it is lost".to_owned(),
            "of small motions, by the loop's response".to_owned(),
        ),
    ];
    out.push_str("<div class=\"tiles\">");
    for (value, of, besides) in tiles {
        let _ = write!(
            out,
            "<div class=\"tile\"><b>{}</b><span>{}</span><small>{}</small></div>",
            escaped(&value),
            escaped(&of),
            escaped(&besides)
        );
    }
    out.push_str("</div>");
}

fn gains(out: &mut String, tuned: &Tuned) {
    out.push_str("<section class=\"card scroll\"><table><tr><th></th><th class=\"number\">before</th><th class=\"number\">after</th><th class=\"number\">limit</th></tr>");
    let mut row = |name: &str, before: &str, after: &str, limit: &str| {
        let _ = write!(
            out,
            "<tr><td>{}</td><td class=\"number\">{}</td><td class=\"number\">{}</td><td class=\"number\">{}</td></tr>",
            escaped(name),
            escaped(before),
            escaped(after),
            escaped(limit)
        );
    };
    for ((key, before), after) in tuned.keys.iter().zip(&tuned.before.gains).zip(&tuned.after.gains) {
        row(key, &digits(*before), &digits(*after), "");
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
        let limit = match (judged.standing, judged.between) {
            (Standing::Held, _) | (Standing::AtLimit, None) => limit,
            (Standing::AtLimit, Some([low, high])) => {
                format!("{limit} (at it: {} to {})", digits(low), digits(high))
            }
            (Standing::Broken, _) => format!("{limit} (broken)"),
        };
        row(judged.name, &before, &after, &limit);
    }
    let crossover = |margins: Option<&Margins>| {
        margins.and_then(|margins| margins.crossover_hz).map_or_else(|| "-".to_owned(), digits)
    };
    let [before, after] = [&tuned.before, &tuned.after].map(|trial| crossover(trial.margins.as_ref()));
    row("crossover, Hz", &before, &after, "");
    out.push_str("</table><p class=\"soft\">Figures of flights are 95th percentiles of the fresh airframes, margins those of the nominal loop.</p></section>");
}

fn trade_off(out: &mut String, tuned: &Tuned) {
    let at = |trial: &Trial| (100.0 * trial.p95.activity, 100.0 * trial.p95.rms_m);
    // What is far off would press the rest into a corner.
    let near = |x: f64, best: f64| x.is_finite() && x <= FAR * best;
    let (best, was) = (&tuned.after.p95, &tuned.before.p95);
    let shown = |trial: &&Trial| {
        near(trial.p95.rms_m, best.rms_m) && near(trial.p95.activity, best.activity) || trial.p95 == *was
    };
    let tried: Vec<&Trial> = tuned.tried.iter().filter(shown).collect();
    let all = || tried.iter().map(|trial| at(trial)).chain([at(&tuned.after)]);
    let frame = Frame { x: range(all().map(|(x, _)| x)), y: range(all().map(|(_, y)| y)) };
    out.push_str("<section class=\"card\"><h3>What quiet costs</h3><p class=\"soft\">Sets of gains on all models: what they ask of the rotors against how well they hold, 95th percentiles.</p><div class=\"keys\"><span class=\"open\">limit broken</span><span class=\"kept\">limits held</span><span class=\"was\">before</span><span class=\"now\">after</span></div><div class=\"chart\">");
    frame.open(out, "plot");
    frame.grid(out);
    let of = |admissible: bool| {
        tried.iter().filter(move |trial| trial.admissible == admissible).map(|trial| at(trial))
    };
    frame.dots(out, of(false), "open");
    frame.dots(out, of(true), "kept");
    frame.dots(out, [at(&tuned.before)], "was");
    frame.dots(out, [at(&tuned.after)], "now");
    frame.close(out, "RMS in hold, cm");
    x_axis(out, frame.x, &ticks(frame.x, 5.0), "activity, % of weight or gravity");
    out.push_str("</div></section>");
}

fn response(out: &mut String, tuned: &Tuned) {
    let Some(after) = &tuned.response_after else { return };
    let both = [(tuned.response_before.as_ref(), "was"), (Some(after), "now")];
    let ends = [after.frequency_hz.first(), after.frequency_hz.last()].map(|hz| hz.map_or(0.0, |hz| hz.ln()));
    let decibels = |response: &Response| -> Vec<[f64; 2]> {
        let sizes = response.gain.iter().map(|[re, im]| 20.0 * re.hypot(*im).log10());
        response.frequency_hz.iter().zip(sizes).map(|(hz, size)| [hz.ln(), size]).collect()
    };
    // Degrees below zero, without jumps.
    let degrees = |response: &Response| -> Vec<[f64; 2]> {
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
        let phases: Vec<f64> = phases.collect();
        response.frequency_hz.iter().zip(phases).map(|(hz, phase)| [hz.ln(), phase]).collect()
    };
    out.push_str("<section class=\"card\"><h3>The loop's response</h3><p class=\"soft\">At the plant's input, by injection into the sampled loop: delay, hold, frames and predictor are in it. Where the size is 0 dB, the phase must be above -180\u{b0}.</p><div class=\"keys\"><span class=\"was\">before</span><span class=\"now\">after</span></div><div class=\"chart\">");
    let hz = [0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0];
    let numbers: Vec<_> = hz
        .into_iter()
        .map(|hz: f64| (hz.ln(), digits(hz)))
        .filter(|(at, _)| (ends[0]..=ends[1]).contains(at))
        .collect();
    let curves: [(Curve<'_>, &str, [f64; 2], f64); 2] =
        [(&decibels, "size, dB", [-30.0, 30.0], 0.0), (&degrees, "phase, degrees", [-540.0, -60.0], -180.0)];
    for (curve, name, y, level) in curves {
        let frame = Frame { x: ends, y };
        frame.open(out, "plot");
        frame.grid(out);
        frame.level(out, level, "zero");
        for (of, class) in both {
            let Some(of) = of else { continue };
            let line: Vec<_> = curve(of).into_iter().map(|[x, y]| Some([x, y, y])).collect();
            frame.line(out, &line, class, false);
        }
        frame.close(out, name);
    }
    x_axis(out, ends, &numbers, "frequency, Hz");
    out.push_str("</div></section>");
}

fn growth(out: &mut String, tuned: &Tuned) {
    let x = range(tuned.grown.iter().map(|grown| grown.extra_s));
    let frame = Frame { x, y: [0.0, 105.0] };
    out.push_str("<section class=\"card\"><h3>When sightings come later than the rig says</h3><p class=\"soft\">Share of the models that still hold within the limit, launch included, with its interval of 95 %.</p><div class=\"chart\">");
    frame.open(out, "plot");
    frame.grid(out);
    let band: Vec<_> = tuned
        .grown
        .iter()
        .map(|grown| Some([grown.extra_s, 100.0 * grown.within.low, 100.0 * grown.within.high]))
        .collect();
    let line: Vec<_> = tuned
        .grown
        .iter()
        .map(|grown| Some([grown.extra_s, 100.0 * grown.within.value(), 100.0 * grown.within.value()]))
        .collect();
    frame.line(out, &band, "band", false);
    frame.line(out, &line, "now", false);
    frame.close(out, "models, %");
    x_axis(out, x, &ticks(x, 5.0), "latency beyond the rig's, s");
    out.push_str("</div></section>");
}
