//! Pages of the model's development: thrust, ground effect, verification, the paper's figures.

mod figures;

use std::fmt::Write as _;

use bench_identification::{
    GroundIdentification, Refused, ThrustIdentification, Verification, VerifyVerdict,
};
use bench_page::{document, escaped};
use bench_rig::{GRAVITY_M_S2, Rig};

pub use figures::{ground_figure, thrust_figure, trajectory_figure};

use crate::words::{self, short, with_sigma};

const STYLE: &str = include_str!("model_page/page.css");

/// Grams of thrust.
fn grams(newtons: f64) -> f64 {
    newtons * 1000.0 / GRAVITY_M_S2
}

/// A page with the command that made it.
pub fn page(title: &str, body: &str) -> String {
    let foot = format!(
        "<footer>bench {} &middot; {}</footer>",
        env!("CARGO_PKG_VERSION"),
        escaped(&words::command())
    );
    document(title, STYLE, &format!("{body}{foot}"))
}

/// A table: names of the columns, then rows; cells are HTML.
pub fn table(columns: &[&str], rows: &[Vec<String>]) -> String {
    let mut out = String::from("<div class=\"scroll\"><table><thead><tr>");
    // Writing to a String cannot fail, here and below.
    for column in columns {
        let _ = write!(out, "<th>{}</th>", escaped(column));
    }
    out.push_str("</tr></thead><tbody>");
    for row in rows {
        out.push_str("<tr>");
        for cell in row {
            let _ = write!(out, "<td>{cell}</td>");
        }
        out.push_str("</tr>");
    }
    out + "</tbody></table></div>"
}

/// A figure in a card, with words below it.
pub fn card(svg: &str, words: &str) -> String {
    format!(
        "<section class=\"card\"><div class=\"drawing\">{svg}</div><p class=\"soft\">{words}</p></section>"
    )
}

fn part(title: &str, content: &str) -> String {
    format!("<section class=\"card\"><h2>{}</h2>{content}</section>", escaped(title))
}

fn list(title: &str, lines: &[String]) -> String {
    if lines.is_empty() {
        return String::new();
    }
    let items: Vec<String> = lines.iter().map(|line| format!("<li>{}</li>", escaped(line))).collect();
    format!("<section class=\"card warn\"><h2>{}</h2><ul>{}</ul></section>", escaped(title), items.concat())
}

fn refused(all: &[Refused]) -> String {
    if all.is_empty() {
        return String::new();
    }
    let rows: Vec<Vec<String>> = all
        .iter()
        .map(|one| {
            vec![
                one.line.to_string(),
                one.throttle.map_or_else(|| "-".to_owned(), short),
                one.thrust_n.map_or_else(|| "-".to_owned(), |thrust| format!("{:.2}", grams(thrust))),
                escaped(&one.why),
            ]
        })
        .collect();
    format!(
        "<details class=\"card\"><summary>{} not fitted to, and why</summary>{}</details>",
        words::count(all.len() as u64, "reading"),
        table(&["line", "throttle", "thrust, g", "why"], &rows)
    )
}

fn interval([low, high]: [f64; 2]) -> String {
    format!("{} to {}", short(low), short(high))
}

/// The page of `bench identify thrust`.
pub fn thrust(found: &ThrustIdentification, rig: &Rig) -> String {
    let unit = found.throttle_unit;
    let units = [format!("N/{unit}"), unit.to_owned(), unit.to_owned()];
    let numbers: Vec<Vec<String>> = found
        .numbers
        .iter()
        .zip(units)
        .map(|(number, unit)| {
            vec![
                format!("{}, {unit}", number.name),
                with_sigma(number.before),
                format!("<b>{}</b>", with_sigma(number.after)),
                interval(number.interval_95),
                number.between_levels.map_or_else(|| "-".to_owned(), short),
            ]
        })
        .collect();
    let levels: Vec<Vec<String>> = found
        .levels
        .iter()
        .map(|level| {
            let edge = |edge: Option<[f64; 2]>| edge.map_or_else(|| "-".to_owned(), interval);
            vec![
                escaped(if level.name.is_empty() { "all" } else { &level.name }),
                with_sigma(level.gain_n_per_unit),
                with_sigma(level.offset),
                with_sigma(level.hover),
                format!("{:+.1} ± {:.1} %", 100.0 * level.thrust_change.0, 100.0 * level.thrust_change.1),
                edge(level.dead_zone),
                edge(level.saturation.map(|(edge, _)| edge)),
                level.readings.to_string(),
            ]
        })
        .collect();
    let line = &found.linearity;
    let linear = format!(
        "<p>{}: curvature {} (p {}){}. A parabola would leave the line by {:.2} % of the weight at most.</p>",
        if line.linear { "Linear" } else { "<b>Not linear</b>" },
        with_sigma(line.curvature),
        words::probability(line.curvature_p),
        line.lack_of_fit_p.map_or_else(String::new, |p| format!(
            "; lack of fit against repeats p {}",
            words::probability(p)
        )),
        100.0 * line.departure_of_weight
    );
    let differ = found.levels_differ.map_or_else(String::new, |differ| {
        format!(
            "<p>Battery levels are {:.1} % of the weight apart at hover; p {} if they had one line.</p>",
            100.0 * differ.of_weight,
            words::probability(differ.p)
        )
    });
    let body = format!(
        "<h1>Thrust over throttle</h1><p class=\"lead\">Airframe {}; {}; a reading is good to {:.2} g (one sigma).</p>{}{}{}{}{}{}",
        escaped(&rig.airframe.name),
        words::count(found.points.len() as u64, "reading"),
        grams(found.reading_sigma_n),
        card(
            &thrust_figure(found, rig).svg(),
            "Dots are readings with the weight taken off; crosses are refused; lines are the levels' fits."
        ),
        list("Warnings", &found.warnings),
        part(
            "Numbers",
            &table(
                &["number", "before", "after", "95 % of the mean over levels", "between levels"],
                &numbers
            )
        ),
        part(
            "Battery levels",
            &format!(
                "{}{differ}",
                table(
                    &[
                        "level",
                        &format!("gain, N/{unit}"),
                        &format!("offset, {unit}"),
                        &format!("hovers at, {unit}"),
                        "thrust at hover, of the weight",
                        "thrust begins",
                        "saturates",
                        "readings"
                    ],
                    &levels
                )
            )
        ),
        part("Linearity", &linear),
        refused(&found.refused)
    );
    page("Thrust over throttle", &body)
}

/// The page of `bench identify ground-effect`.
pub fn ground(found: &GroundIdentification, rig: &Rig) -> String {
    let numbers: Vec<Vec<String>> = found
        .numbers
        .iter()
        .map(|number| {
            vec![
                number.name.to_owned(),
                with_sigma(number.before),
                format!("<b>{}</b>", with_sigma(number.after)),
                interval(number.interval_95),
            ]
        })
        .collect();
    let laws: Vec<Vec<String>> = found
        .laws
        .iter()
        .map(|law| {
            vec![
                law.law.name().to_owned(),
                format!("{:.1} %", 100.0 * law.probability),
                format!("{:+.1}", law.nats),
                with_sigma(law.multiplier),
                with_sigma((1000.0 * law.length_m.0, 1000.0 * law.length_m.1)),
                format!("{:.3}", grams(law.rms_n)),
            ]
        })
        .collect();
    let throttles: Vec<Vec<String>> = found
        .throttles
        .iter()
        .map(|told| {
            vec![
                short(told.throttle),
                escaped(&told.level),
                with_sigma((grams(told.free_thrust_n.0), grams(told.free_thrust_n.1))),
                format!("{:.1}", grams(told.rig_thrust_n)),
                with_sigma(told.multiplier),
                told.readings.to_string(),
            ]
        })
        .collect();
    let one = found.throttles_differ_p.map_or_else(String::new, |p| {
        format!(
            "<p>Probability of such differences of the multiplier if it is one: {}.</p>",
            words::probability(p)
        )
    });
    let body = format!(
        "<h1>Thrust over altitude</h1><p class=\"lead\">Airframe {}; {} fitted to; a reading is good to {:.2} g (one sigma).</p>{}{}{}{}{}{}",
        escaped(&rig.airframe.name),
        words::count(found.points.iter().filter(|point| point.used).count() as u64, "reading"),
        grams(found.reading_sigma_n),
        card(
            &ground_figure(found).svg(),
            "Dots are readings with the weight taken off; crosses are refused. Lines: linear law; dashed: the law that the readings prefer, where it is another."
        ),
        list("Warnings", &found.warnings),
        part("Numbers of the linear law", &table(&["number", "before", "after", "95 %"], &numbers)),
        part(
            "Laws by their evidence",
            &table(
                &["law", "probability", "nats over linear", "at the ground", "length, mm", "leaves, g RMS"],
                &laws
            )
        ),
        part(
            "Throttles",
            &format!(
                "{}{one}",
                table(
                    &[
                        "throttle",
                        "battery",
                        "far from the ground, g",
                        "by the rig, g",
                        "multiplier",
                        "readings"
                    ],
                    &throttles
                )
            )
        ),
        refused(&found.refused)
    );
    page("Thrust over altitude", &body)
}

/// The page of `bench verify`.
pub fn verification(found: &Verification, rig: &Rig) -> String {
    let checks: Vec<Vec<String>> = found
        .checks
        .iter()
        .map(|check| {
            vec![
                escaped(check.name),
                short(check.value),
                format!("{} {}", if check.at_least { "at least" } else { "at most" }, short(check.limit)),
                escaped(check.flight.as_deref().unwrap_or("all")),
                mark(check.passed),
            ]
        })
        .collect();
    let rows: Vec<Vec<String>> = found
        .flights
        .iter()
        .map(|flight| {
            let cm = |x: Option<f64>| x.map_or_else(|| "-".to_owned(), |x| format!("{:.1}", 100.0 * x));
            let [seen, predicted, low, high] = flight.peak_m;
            vec![
                escaped(&flight.name),
                cm(flight.k_step_m[0]),
                cm(flight.k_step_m[1]),
                cm(flight.k_step_m[2]),
                format!("{:.1}", 100.0 * flight.trajectory_rms_m),
                format!("{:.0} %", 100.0 * flight.inside),
                format!(
                    "{:.1} / {:.1} ({:.1} to {:.1})",
                    100.0 * seen,
                    100.0 * predicted,
                    100.0 * low,
                    100.0 * high
                ),
                format!("{:.2}", flight.consistency.mean_nis),
                words::probability(flight.consistency.whiteness_p),
            ]
        })
        .collect();
    let drawn: String = found
        .flights
        .iter()
        .map(|flight| card(&trajectory_figure(flight).svg(), "The line is the rig's model from the recorded throttle alone, in calm air; the bands hold 50 and 95 % of trajectories within the rig's tolerances in ordinary air, as far as they are within the figure."))
        .collect();
    let (verdict, class) = match found.verdict {
        VerifyVerdict::Passed => ("The model predicts these flights", "pass"),
        VerifyVerdict::Failed => ("The model misses these flights", "fail"),
        VerifyVerdict::NotInformative => ("Not informative: nearly any flight would have passed", "odd"),
    };
    let widened: Vec<Vec<String>> = found
        .widened_by
        .iter()
        .map(|share| vec![escaped(share.name), format!("{:.0} %", 100.0 * share.share)])
        .collect();
    let body = format!(
        "<section class=\"card verdict {}\"><h1>{verdict}</h1><p class=\"lead\">Rig {}, airframe {}; {}; nothing was fitted.</p></section>{}{}{}{}{}{drawn}",
        class,
        escaped(&rig.name),
        escaped(&rig.airframe.name),
        words::count(found.flights.len() as u64, "flight"),
        part("Checks", &table(&["check", "reached", "limit", "worst flight", ""], &checks)),
        part("What the band's variance comes from", &table(&["tolerance of", "share"], &widened)),
        list("What would narrow the band", &found.narrowed_by),
        list("Warnings", &found.warnings),
        part(
            "Flights",
            &table(
                &[
                    "flight",
                    "0.5 s ahead, cm",
                    "1 s, cm",
                    "2 s, cm",
                    "trajectory, cm",
                    "in 95 % band",
                    "peak seen / predicted (95 %), cm",
                    "error over expected",
                    "whiteness p"
                ],
                &rows
            )
        ),
    );
    page(verdict, &body)
}

/// Passed or not, as HTML.
pub fn mark(passed: bool) -> String {
    let (class, word) = if passed { ("pass", "pass") } else { ("fail", "fail") };
    format!("<b class=\"{class}\">{word}</b>")
}
