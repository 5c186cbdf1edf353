//! The gap before and after.

use std::fmt::Write as _;

use bench_diagnosis::{Diagnosis, Figure, Verdict};
use bench_page::{Bar, Rows, escaped, range};

use super::{capitalised, card, heading, told};

/// A level of the gap: colour, name, predictions, misfit.
type Level<'a> = (&'static str, String, Option<&'a [Option<Figure>; 3]>, Figure);

fn levels(diagnosis: &Diagnosis) -> Vec<Level<'_>> {
    let gap = &diagnosis.gap;
    let k = &gap.k_step_m;
    let mut levels = vec![
        ("m0", "the rig as it is".to_owned(), Some(&k.nominal), gap.nominal),
        ("m1", "numbers re-fitted".to_owned(), Some(&k.parameters_only), gap.parameters_only),
    ];
    if let Some(best) = told::best_effects(diagnosis) {
        let name = if diagnosis.verdict == Verdict::Effect { "with" } else { "with the nearest," };
        levels.push(("m2", format!("{name} {best}"), Some(&k.with_effect), gap.with_effect));
    }
    levels.push(("m3", "noise floor".to_owned(), None, gap.floor));
    levels
}

pub(super) fn section(out: &mut String, diagnosis: &Diagnosis) {
    let gap = &diagnosis.gap;
    let held_out = if gap.held_out {
        "Each flight is predicted by a fit to the others."
    } else {
        "There are too few flights to leave one out: each is predicted by a fit that has seen it."
    };
    let how = format!("{held_out} Whiskers are intervals of 90 % over flights.");
    heading(out, "How far the gap shrinks", &how);
    let levels = levels(diagnosis);
    for (h, ahead) in ["0.5 s", "1 s", "2 s"].into_iter().enumerate() {
        if h == 0 {
            out.push_str("<div class=\"small\">");
        }
        horizon(out, &levels, h, ahead);
    }
    out.push_str("</div>");
    misfit(out, diagnosis, &levels);
}

fn horizon(out: &mut String, levels: &[Level<'_>], h: usize, ahead: &str) {
    let figures: Vec<(&str, &str, Figure)> = levels
        .iter()
        .filter_map(|(class, name, errors, _)| Some((*class, name.as_str(), errors.as_ref()?[h]?)))
        .collect();
    let title = format!("Predictions {ahead} ahead");
    if figures.is_empty() {
        card(out, &title, "the flights are too short", "");
        return;
    }
    let [_, high] = range(figures.iter().map(|(_, _, figure)| 100.0 * figure.high).chain([0.0]));
    let mut rows = Rows::new([0.0, high]);
    for (class, name, figure) in figures {
        let bar = Bar {
            value: 100.0 * figure.value,
            interval: Some([100.0 * figure.low, 100.0 * figure.high]),
            from: Some(0.0),
            class,
        };
        rows.row(&escaped(name), Some(bar), &format!("{} cm", told::figure(&figure, 100.0, 2)));
    }
    card(out, &title, "", &rows.finish("RMS error of altitude, cm"));
}

fn misfit(out: &mut String, diagnosis: &Diagnosis, levels: &[Level<'_>]) {
    let shown = range(levels.iter().flat_map(|(_, _, _, misfit)| [misfit.low, misfit.high]));
    let mut rows = Rows::new(shown);
    for (class, name, _, misfit) in levels {
        let bar = Bar { value: misfit.value, interval: Some([misfit.low, misfit.high]), from: None, class };
        rows.row(&escaped(name), Some(bar), &told::figure(misfit, 1.0, 3));
    }
    let mut words =
        "How unlikely the model finds what was seen: less is better, and the floor is what a right model \
                     would reach against this noise."
            .to_owned();
    if let Some(closure) = told::closure(diagnosis) {
        let _ = write!(words, " {}.", capitalised(&closure));
    }
    let axis = "misfit: negative log-likelihood of a sighting, nats";
    card(out, "Misfit of every sighting", &words, &rows.finish(axis));
}
