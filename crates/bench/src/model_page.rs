//! Pages of the model's development: thrust, ground effect, verification, and the figures of all of them.

mod figures;

use bench_identification::{
    GroundIdentification, Refused, ThrustIdentification, Verification, VerifyVerdict,
};
use bench_page::{
    Page, Section, Tone, Verdict,
    parts::{Column, Tile, badge, block, cell, folded, list, passed, table, tiles, warnings},
};
use bench_rig::{GRAVITY_M_S2, Rig};
use maud::{Markup, html};

pub use figures::{ground_figure, thrust_figure, trajectory_figure};

use crate::words::{self, short, with_sigma};

/// Grams of thrust.
fn grams(newtons: f64) -> f64 {
    newtons * 1000.0 / GRAVITY_M_S2
}

fn refused(all: &[Refused]) -> Option<Section> {
    let rows = all.iter().map(|one| {
        vec![
            cell(one.line),
            cell(one.throttle.map_or_else(|| "-".to_owned(), short)),
            cell(one.thrust_n.map_or_else(|| "-".to_owned(), |thrust| format!("{:.2}", grams(thrust)))),
            cell(&one.why),
        ]
    });
    let columns = [
        Column::Number("line"),
        Column::Number("throttle"),
        Column::Number("thrust, g"),
        Column::Words("why"),
    ];
    let title = format!("{} not fitted to, and why", words::count(all.len() as u64, "reading"));
    let content = || folded(title, "", false, table(&columns, rows));
    (!all.is_empty()).then(|| Section::new("Refused readings", content()))
}

fn interval([low, high]: [f64; 2]) -> String {
    format!("{} to {}", short(low), short(high))
}

/// The page of `bench identify thrust`.
pub fn thrust(found: &ThrustIdentification, rig: &Rig) -> String {
    let line = &found.linearity;
    let tone = if line.linear { Tone::Good } else { Tone::Odd };
    let headline =
        if line.linear { "Thrust is linear in throttle" } else { "Thrust is not linear in throttle" };
    let below = html! {
        p.lead {
            "Curvature " (with_sigma(line.curvature)) " (p " (words::probability(line.curvature_p)) ")"
            @if let Some(p) = line.lack_of_fit_p { "; lack of fit against repeats p " (words::probability(p)) }
            ". A parabola would leave the line by " (format!("{:.2}", 100.0 * line.departure_of_weight)) " % of the weight at most."
        }
        (read_of(rig, found.points.len(), "reading", found.reading_sigma_n))
        (warnings(&found.warnings))
    };
    let figure = block(
        "",
        "Dots are readings with the weight taken off; crosses are refused; lines are the levels' fits.",
        thrust_figure(found, rig, "Thrust over throttle"),
    );
    let sections = [
        Some(Section::new("Thrust over throttle", figure)),
        Some(Section::new("Numbers", thrust_numbers(found))),
        Some(Section::new("Battery levels", levels(found))),
        refused(&found.refused),
    ];
    Page::new("Thrust over throttle", Verdict::new(tone, headline).with(below))
        .sections(sections.into_iter().flatten())
        .made_by(words::command())
        .html()
}

fn read_of(rig: &Rig, readings: usize, what: &str, sigma_n: f64) -> Markup {
    html! {
        p.soft {
            "Airframe " (rig.airframe.name) "; " (words::count(readings as u64, what))
            "; a reading is good to " (format!("{:.2}", grams(sigma_n))) " g (one sigma)."
        }
    }
}

fn thrust_numbers(found: &ThrustIdentification) -> Markup {
    let unit = found.throttle_unit;
    let units = [format!("N/{unit}"), unit.to_owned(), unit.to_owned()];
    let rows = found.numbers.iter().zip(units).map(|(number, unit)| {
        vec![
            html! { (number.name) ", " (unit) },
            cell(with_sigma(number.before)),
            html! { b { (with_sigma(number.after)) } },
            cell(interval(number.interval_95)),
            cell(number.between_levels.map_or_else(|| "-".to_owned(), short)),
        ]
    });
    let columns = [
        Column::Words("number"),
        Column::Number("before"),
        Column::Number("after"),
        Column::Number("95 % of the mean over levels"),
        Column::Number("between levels"),
    ];
    table(&columns, rows)
}

fn levels(found: &ThrustIdentification) -> Markup {
    let unit = found.throttle_unit;
    let edge = |edge: Option<[f64; 2]>| cell(edge.map_or_else(|| "-".to_owned(), interval));
    let rows = found.levels.iter().map(|level| {
        vec![
            cell(if level.name.is_empty() { "all" } else { &level.name }),
            cell(with_sigma(level.gain_n_per_unit)),
            cell(with_sigma(level.offset)),
            cell(with_sigma(level.hover)),
            cell(format!("{:+.1} ± {:.1} %", 100.0 * level.thrust_change.0, 100.0 * level.thrust_change.1)),
            edge(level.dead_zone),
            edge(level.saturation.map(|(edge, _)| edge)),
            cell(level.readings),
        ]
    });
    let [gain, offset, hover] =
        [format!("gain, N/{unit}"), format!("offset, {unit}"), format!("hovers at, {unit}")];
    let columns = [
        Column::Words("level"),
        Column::Number(&gain),
        Column::Number(&offset),
        Column::Number(&hover),
        Column::Number("thrust at hover, of the weight"),
        Column::Number("thrust begins"),
        Column::Number("saturates"),
        Column::Number("readings"),
    ];
    html! {
        (table(&columns, rows))
        @if let Some(differ) = found.levels_differ {
            p {
                "Battery levels are " (format!("{:.1}", 100.0 * differ.of_weight)) " % of the weight apart at hover; p "
                (words::probability(differ.p)) " if they had one line."
            }
        }
    }
}

/// The page of `bench identify ground-effect`.
pub fn ground(found: &GroundIdentification, rig: &Rig) -> String {
    let used = found.points.iter().filter(|point| point.used).count();
    let best = found.laws.first();
    let headline = match best {
        Some(best) => format!("The {} law explains the ground effect best", best.law.name()),
        None => "Thrust over altitude".to_owned(),
    };
    let below = html! {
        @if let Some(best) = best {
            p.lead { "Probability " (format!("{:.1}", 100.0 * best.probability)) " %, " (format!("{:+.1}", best.nats)) " nats over the linear law, whose numbers are below." }
        }
        (read_of(rig, used, "reading", found.reading_sigma_n))
        (warnings(&found.warnings))
    };
    let figure = block(
        "",
        "Dots are readings with the weight taken off; crosses are refused. Lines: linear law; dashed: the law that the readings prefer, where it is another.",
        ground_figure(found, "Thrust over altitude"),
    );
    let sections = [
        Some(Section::new("Thrust over altitude", figure)),
        Some(Section::new("Numbers of the linear law", ground_numbers(found))),
        Some(Section::new("Laws by their evidence", laws(found))),
        Some(Section::new("Throttles", throttles(found))),
        refused(&found.refused),
    ];
    Page::new("Thrust over altitude", Verdict::new(Tone::Plain, headline).with(below))
        .sections(sections.into_iter().flatten())
        .made_by(words::command())
        .html()
}

fn ground_numbers(found: &GroundIdentification) -> Markup {
    let rows = found.numbers.iter().map(|number| {
        vec![
            cell(number.name),
            cell(with_sigma(number.before)),
            html! { b { (with_sigma(number.after)) } },
            cell(interval(number.interval_95)),
        ]
    });
    let columns =
        [Column::Words("number"), Column::Number("before"), Column::Number("after"), Column::Number("95 %")];
    table(&columns, rows)
}

fn laws(found: &GroundIdentification) -> Markup {
    let rows = found.laws.iter().map(|law| {
        vec![
            cell(law.law.name()),
            cell(format!("{:.1} %", 100.0 * law.probability)),
            cell(format!("{:+.1}", law.nats)),
            cell(with_sigma(law.multiplier)),
            cell(with_sigma((1000.0 * law.length_m.0, 1000.0 * law.length_m.1))),
            cell(format!("{:.3}", grams(law.rms_n))),
        ]
    });
    let columns = [
        Column::Words("law"),
        Column::Number("probability"),
        Column::Number("nats over linear"),
        Column::Number("at the ground"),
        Column::Number("length, mm"),
        Column::Number("leaves, g RMS"),
    ];
    table(&columns, rows)
}

fn throttles(found: &GroundIdentification) -> Markup {
    let rows = found.throttles.iter().map(|told| {
        vec![
            cell(short(told.throttle)),
            cell(&told.level),
            cell(with_sigma((grams(told.free_thrust_n.0), grams(told.free_thrust_n.1)))),
            cell(format!("{:.1}", grams(told.rig_thrust_n))),
            cell(with_sigma(told.multiplier)),
            cell(told.readings),
        ]
    });
    let columns = [
        Column::Number("throttle"),
        Column::Words("battery"),
        Column::Number("far from the ground, g"),
        Column::Number("by the rig, g"),
        Column::Number("multiplier"),
        Column::Number("readings"),
    ];
    html! {
        (table(&columns, rows))
        @if let Some(p) = found.throttles_differ_p {
            p { "Probability of such differences of the multiplier if it is one: " (words::probability(p)) "." }
        }
    }
}

/// The page of `bench verify`.
pub fn verification(found: &Verification, rig: &Rig) -> String {
    let verdict = verification_verdict(found, rig);
    Page::new(verdict.words.clone(), verdict)
        .sections(verification_sections(found))
        .made_by(words::command())
        .html()
}

/// What a verification comes to, for the top of a page.
pub fn verification_verdict(found: &Verification, rig: &Rig) -> Verdict {
    let (words, tone) = match found.verdict {
        VerifyVerdict::Passed => ("The model predicts these flights", Tone::Good),
        VerifyVerdict::Failed => ("The model misses these flights", Tone::Bad),
        VerifyVerdict::NotInformative => ("Not informative: nearly any flight would have passed", Tone::Odd),
    };
    let figures = found.checks.iter().map(|check| Tile {
        value: short(check.value),
        of: check.name.to_owned(),
        beside: limit_of(check.at_least, check.limit),
    });
    let flights = words::count(found.flights.len() as u64, "flight");
    let below = html! {
        p.lead { "Rig " (rig.name) ", airframe " (rig.airframe.name) "; " (flights) "; nothing was fitted." }
        (tiles(figures))
        (warnings(&found.warnings))
        @if !found.narrowed_by.is_empty() {
            (block("What would narrow the band", "", list(&found.narrowed_by)))
        }
    };
    Verdict::new(tone, words).with(below)
}

fn limit_of(at_least: bool, limit: f64) -> String {
    format!("{} {}", if at_least { "at least" } else { "at most" }, short(limit))
}

/// The parts of the page of a verification.
pub fn verification_sections(found: &Verification) -> Vec<Section> {
    let checks = found.checks.iter().map(|check| {
        let mark = match (check.passed, found.verdict) {
            (true, _) => passed(true),
            (false, VerifyVerdict::NotInformative) => badge(Tone::Odd, "too wide"),
            (false, _) => passed(false),
        };
        vec![
            cell(check.name),
            cell(short(check.value)),
            cell(limit_of(check.at_least, check.limit)),
            cell(check.flight.as_deref().unwrap_or("all")),
            mark,
        ]
    });
    let columns = [
        Column::Words("check"),
        Column::Number("reached"),
        Column::Number("limit"),
        Column::Words("worst flight"),
        Column::Words(""),
    ];
    let drawn = html! {
        @for flight in &found.flights { (block(&flight.name, "", trajectory_figure(flight, &flight.name, None))) }
    };
    let words = "The line is the rig's model from the recorded throttle alone, in calm air; the bands hold 50 and 95 % of trajectories within the rig's tolerances in ordinary air, as far as they are within the figure.";
    let widened = found.widened_by.iter();
    let widened = widened.map(|share| vec![cell(share.name), cell(format!("{:.0} %", 100.0 * share.share))]);
    vec![
        Section::new("Checks", table(&columns, checks)),
        Section::new("Trajectories", drawn).told(words),
        Section::new("Flights", flights_table(found)),
        Section::new(
            "What the band's variance comes from",
            table(&[Column::Words("tolerance of"), Column::Number("share")], widened),
        ),
    ]
}

fn flights_table(found: &Verification) -> Markup {
    let rows = found.flights.iter().map(|flight| {
        let cm = |x: Option<f64>| cell(x.map_or_else(|| "-".to_owned(), |x| format!("{:.1}", 100.0 * x)));
        let [seen, predicted, low, high] = flight.peak_m.map(|m| format!("{:.1}", 100.0 * m));
        vec![
            cell(&flight.name),
            cm(flight.k_step_m[0]),
            cm(flight.k_step_m[1]),
            cm(flight.k_step_m[2]),
            cell(format!("{:.1}", 100.0 * flight.trajectory_rms_m)),
            cell(format!("{:.0} %", 100.0 * flight.inside)),
            cell(format!("{seen} / {predicted} ({low} to {high})")),
            cell(format!("{:.2}", flight.consistency.mean_nis)),
            cell(words::probability(flight.consistency.whiteness_p)),
        ]
    });
    let columns = [
        Column::Words("flight"),
        Column::Number("0.5 s ahead, cm"),
        Column::Number("1 s, cm"),
        Column::Number("2 s, cm"),
        Column::Number("trajectory, cm"),
        Column::Number("in 95 % band"),
        Column::Number("peak seen / predicted (95 %), cm"),
        Column::Number("error over expected"),
        Column::Number("whiteness p"),
    ];
    table(&columns, rows)
}
