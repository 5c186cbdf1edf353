//! The gap before and after.

use bench_diagnosis::{Diagnosis, Figure, Verdict};
use bench_page::{
    Section, capitalised,
    parts::{Bar, Rows, block, grid},
    range,
};
use maud::{Markup, html};

use super::{LEVELS, told};

/// A level of the gap: colour, name, predictions, misfit above the floor.
type Level<'a> = (usize, String, &'a [Option<Figure>; 3], Figure);

fn levels(diagnosis: &Diagnosis) -> Vec<Level<'_>> {
    let gap = &diagnosis.gap;
    let k = &gap.k_step_m;
    let above = |misfit: &Figure| told::figure_above_floor(misfit, &gap.floor);
    let mut levels = vec![
        (LEVELS[0], "the rig as it is".to_owned(), &k.nominal, above(&gap.nominal)),
        (LEVELS[1], "numbers re-fitted".to_owned(), &k.parameters_only, above(&gap.parameters_only)),
    ];
    if let Some(best) = told::best_effects(diagnosis) {
        let name = if diagnosis.verdict == Verdict::Effect { "with" } else { "with the nearest," };
        levels.push((LEVELS[2], format!("{name} {best}"), &k.with_effect, above(&gap.with_effect)));
    }
    levels
}

pub(super) fn section(diagnosis: &Diagnosis) -> Section {
    let held_out = if diagnosis.gap.held_out {
        "Each flight is predicted by a fit to the others."
    } else {
        "There are too few flights to leave one out: each is predicted by a fit that has seen it."
    };
    let levels = levels(diagnosis);
    let horizons = ["0.5 s", "1 s", "2 s"].into_iter().enumerate();
    let body = html! {
        (grid(horizons.map(|(h, ahead)| horizon(&levels, h, ahead))))
        (misfit(diagnosis, &levels))
    };
    Section::new("How far the gap shrinks", body)
        .told(format!("{held_out} Whiskers are intervals of 90 % over flights."))
}

fn horizon(levels: &[Level<'_>], h: usize, ahead: &str) -> Markup {
    let figures: Vec<(usize, &str, Figure)> = levels
        .iter()
        .filter_map(|(colour, name, errors, _)| Some((*colour, name.as_str(), errors[h]?)))
        .collect();
    let title = format!("Predictions {ahead} ahead");
    if figures.is_empty() {
        return block(&title, "The flights are too short.", "");
    }
    let [_, high] = range(figures.iter().map(|(_, _, figure)| 100.0 * figure.high).chain([0.0]));
    let mut rows = Rows::new([0.0, high]);
    for (colour, name, figure) in figures {
        let bar = Bar {
            value: 100.0 * figure.value,
            interval: Some([100.0 * figure.low, 100.0 * figure.high]),
            from: Some(0.0),
            colour,
        };
        rows.row(name, Some(bar), &format!("{} cm", told::figure(&figure, 100.0, 2)));
    }
    block(&title, "", rows.finish("RMS error of altitude, cm"))
}

fn misfit(diagnosis: &Diagnosis, levels: &[Level<'_>]) -> Markup {
    let [_, high] = range(levels.iter().map(|(_, _, _, misfit)| misfit.high).chain([0.0]));
    let mut rows = Rows::new([0.0, high]);
    for (colour, name, _, misfit) in levels {
        let bar = Bar {
            value: misfit.value,
            interval: Some([misfit.low, misfit.high]),
            from: Some(0.0),
            colour: *colour,
        };
        rows.row(name, Some(bar), &told::figure(misfit, 1.0, 3));
    }
    let mut words =
        "How much less likely the model finds what was seen than a right model would against the same noise."
            .to_owned();
    if let Some(closure) = told::closure(diagnosis) {
        words = format!("{words} {}.", capitalised(&closure));
    }
    let axis = "misfit above noise: log-likelihood of a measurement that is lost, nats";
    block("Misfit of every measurement", &words, rows.finish(axis))
}
