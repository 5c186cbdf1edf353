//! Where the gap lies: by stage, by region, by frequency, and what needs no model.

use bench_diagnosis::{Diagnosis, Frequency, RegionTold};
use bench_page::{
    Mark, Panel, Plot, Section, Series, capitalised, digits,
    parts::{Bar, Rows, block, grid},
    range,
};
use bench_statistics::median_high;
use maud::{Markup, html};

use super::{FOUND, PULL, told, unit};

pub(super) fn section(diagnosis: &Diagnosis) -> Section {
    let body = html! {
        (stages(diagnosis))
        (direct(diagnosis))
        (regions(&diagnosis.place.regions))
        (frequencies(diagnosis))
    };
    Section::new("Where it lies", body)
        .told("Evidence is in nats: 3 are odds of 20 to 1, 5 of 150 to 1, 10 of 22,000 to 1.")
}

fn stages(diagnosis: &Diagnosis) -> Markup {
    let stages = &diagnosis.place.stages;
    let shown = range(stages.iter().flat_map(|s| [s.gain_nats.low, s.gain_nats.high]).chain([0.0]));
    let mut rows = Rows::new(shown);
    for stage in stages {
        let gain = &stage.gain_nats;
        let bar =
            Bar { value: gain.value, interval: Some([gain.low, gain.high]), from: Some(0.0), colour: FOUND };
        let name = html! { (capitalised(told::stage(stage.stage))) br; small.soft { (stage.replaced) } };
        let share = stage.share.map_or_else(String::new, |share| format!("{}, ", told::percent(share)));
        rows.row(name, Some(bar), &format!("{share}{} nats", told::figure(gain, 1.0, 0)));
    }
    block(
        "By stage",
        "What replacing a stage's modelled signal by what was recorded or fitted gains, shared out fairly (Shapley), \
         with intervals of 90 % over flights.",
        rows.finish("evidence gained, nats"),
    )
}

fn direct(diagnosis: &Diagnosis) -> Markup {
    let (words, content) = if diagnosis.direct.is_empty() {
        (
            "Readbacks, loop times and frames show nothing out of the ordinary, where they were recorded.",
            html! {},
        )
    } else {
        let list = html! { ul { @for finding in &diagnosis.direct { li { b { (finding.channel) } ": " (finding.text) } } } };
        ("What readbacks, loop times and frames show without any model of flight.", list)
    };
    block("Direct evidence", words, content)
}

fn regions(regions: &[RegionTold]) -> Markup {
    let maps = regions.iter().map(|region| {
        let title = format!("Over {}", region.axis);
        let plain = region.gain > told::PLAIN_NATS;
        let words = match () {
            () if region.at.len() < 2 => "Hardly varies in these flights.".to_owned(),
            () if plain => format!("Evidence {} nats.", told::fixed(region.gain, 1)),
            () => format!("Evidence {} nats: nothing beyond noise.", told::fixed(region.gain, 1)),
        };
        let plot = (region.at.len() >= 2).then(|| map(region));
        block(&title, &words, html! { @if let Some(plot) = plot { (plot) } })
    });
    let words = "Positive is upwards. Bands are 2 sigma: where a band leaves zero, something is missing. Where it stays level, what \
                 is missing does not depend on that quantity. Each has the scale that shows its band.";
    block("By region: acceleration that the re-fitted rig lacks", words, grid(maps))
}

/// The acceleration over one quantity, on the scale of its own band.
fn map(region: &RegionTold) -> Plot {
    let at = || region.at.iter().zip(&region.acceleration_m_s2).zip(&region.sigma_m_s2);
    let ends = |k: f64| at().map(move |((_, a), sigma)| a + k * sigma);
    let middle = || ends(0.0).map(f64::abs);
    // A place of which nothing is known has a band that would flatten all others.
    let largest = middle().fold(0.0, f64::max);
    let sigmas: Vec<f64> = region.sigma_m_s2.iter().copied().filter(|sigma| sigma.is_finite()).collect();
    let usual = median_high(sigmas).unwrap_or(0.0);
    let reach = largest.max(4.0 * usual);
    let shown = |end: f64| end.clamp(-1.5 * reach, 1.5 * reach);
    let y = range(ends(2.0).chain(ends(-2.0)).map(shown).chain([0.0]));
    let title = match region.unit {
        "1" => region.axis.to_owned(),
        of => format!("{}, {}", region.axis, unit(of)),
    };
    let band = at().map(|((x, a), sigma)| [*x, a - 2.0 * sigma, a + 2.0 * sigma]);
    let line = || at().map(|((x, a), _)| (*x, *a));
    let panel = Panel::new("acceleration, m/s\u{b2}")
        .with(Series::band("2 sigma", Mark::Band, PULL, band))
        .with(Series::new("", Mark::Line, PULL, line()))
        .with(Series::new("", Mark::Dots, PULL, line()))
        .level(0.0, "")
        .y(y);
    Plot::new(format!("Missing acceleration over {}", region.axis), title).panel(panel)
}

fn frequencies(diagnosis: &Diagnosis) -> Markup {
    let waves: Vec<&Frequency> = diagnosis.place.frequencies.iter().filter(|wave| wave.hz > 0.0).collect();
    if waves.is_empty() {
        return html! {};
    }
    // The best of many is worth less than it looks.
    let chance = (diagnosis.place.frequencies_tried.max(1) as f64).ln() + told::PLAIN_NATS;
    let best = waves.iter().max_by(|a, b| a.gain.total_cmp(&b.gain));
    let words = match best.filter(|best| best.gain > chance) {
        Some(best) => format!(
            "Something swings at {} Hz (evidence {} nats): every flight may have its own size and phase there.",
            digits(best.hz),
            told::fixed(best.gain, 1)
        ),
        None => "No frequency stands out: none passes what the best of so many reaches by chance.".to_owned(),
    };
    let line = || waves.iter().map(|wave| (wave.hz, wave.gain));
    let panel = Panel::new("evidence, nats")
        .with(Series::new("", Mark::Line, FOUND, line()))
        .with(Series::new("", Mark::Dots, FOUND, line()))
        .level(chance, "by chance")
        .y([0.0, range(waves.iter().map(|wave| wave.gain).chain([0.0, chance]))[1]]);
    let plot =
        Plot::new("Evidence by frequency", "frequency of the missing acceleration, Hz").panel(panel).log_x();
    block("By frequency", &words, plot)
}
