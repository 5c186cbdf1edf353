//! Where the gap lies: by stage, by region, by frequency, and what needs no model.

use std::fmt::Write as _;

use bench_diagnosis::{Diagnosis, Frequency, RegionTold};
use bench_page::{Bar, Frame, Rows, digits, escaped, range, ticks, x_axis};

use super::{capitalised, card, heading, told, unit};

pub(super) fn section(out: &mut String, diagnosis: &Diagnosis) {
    heading(
        out,
        "Where it lies",
        "Evidence is in nats: 3 are odds of 20 to 1, 5 of 150 to 1, 10 of 22,000 to 1.",
    );
    stages(out, diagnosis);
    direct(out, diagnosis);
    regions(out, &diagnosis.place.regions);
    frequencies(out, diagnosis);
}

fn stages(out: &mut String, diagnosis: &Diagnosis) {
    let stages = &diagnosis.place.stages;
    let shown = range(stages.iter().flat_map(|s| [s.gain_nats.low, s.gain_nats.high]).chain([0.0]));
    let mut rows = Rows::new(shown);
    for stage in stages {
        let gain = &stage.gain_nats;
        let bar =
            Bar { value: gain.value, interval: Some([gain.low, gain.high]), from: Some(0.0), class: "m2" };
        let name = format!(
            "{}<br><small class=\"soft\">{}</small>",
            escaped(&capitalised(told::stage(stage.stage))),
            escaped(stage.replaced)
        );
        let share = stage.share.map_or_else(String::new, |share| format!("{}, ", told::percent(share)));
        rows.row(&name, Some(bar), &format!("{share}{} nats", told::figure(gain, 1.0, 0)));
    }
    card(
        out,
        "By stage",
        "What replacing a stage's modelled signal by what was recorded or fitted gains, shared out fairly (Shapley), \
         with intervals of 90 % over flights.",
        &rows.finish("evidence gained, nats"),
    );
}

fn direct(out: &mut String, diagnosis: &Diagnosis) {
    let mut content = String::from("<ul>");
    for finding in &diagnosis.direct {
        let _ = write!(content, "<li><b>{}</b>: {}</li>", escaped(finding.channel), escaped(&finding.text));
    }
    content.push_str("</ul>");
    let (words, content) = if diagnosis.direct.is_empty() {
        ("Readbacks, loop times and frames show nothing out of the ordinary, where they were recorded.", "")
    } else {
        ("What readbacks, loop times and frames show without any model of flight.", content.as_str())
    };
    card(out, "Direct evidence", words, content);
}

fn regions(out: &mut String, regions: &[RegionTold]) {
    let largest = regions
        .iter()
        .filter(|region| region.gain > 0.0)
        .flat_map(|region| &region.acceleration_m_s2)
        .fold(0.0, |most: f64, a| most.max(a.abs()));
    // A band that knows nothing would flatten the ones that do.
    let reach = range(
        regions
            .iter()
            .flat_map(|region| region.acceleration_m_s2.iter().zip(&region.sigma_m_s2))
            .map(|(a, sigma)| a.abs() + (2.0 * sigma).min(largest)),
    )[1];
    let y = [-reach, reach];
    out.push_str("<h3>By region: acceleration that the re-fitted rig lacks</h3><p class=\"soft\">Positive is upwards. Bands \
                  are 2 sigma: where a band leaves zero, something is missing. Where it stays level, what \
                  is missing does not depend on that quantity. All have the same scale.</p><div class=\"small\">");
    for region in regions {
        let title = format!("Over {}", region.axis);
        let plain = region.gain > told::PLAIN_NATS;
        let words = match () {
            () if region.at.len() < 2 => "hardly varies in these flights".to_owned(),
            () if plain => format!("evidence {} nats", told::fixed(region.gain, 1)),
            () => {
                format!("evidence {} nats: nothing beyond noise", told::fixed(region.gain, 1))
            }
        };
        let content = if region.at.len() < 2 { String::new() } else { map(region, y, plain) };
        card(out, &title, &words, &content);
    }
    out.push_str("</div>");
}

fn map(region: &RegionTold, y: [f64; 2], plain: bool) -> String {
    let x = range(region.at.iter().copied());
    let frame = Frame { x, y };
    let at = || region.at.iter().zip(&region.acceleration_m_s2).zip(&region.sigma_m_s2);
    let band: Vec<_> = at().map(|((x, a), sigma)| Some([*x, a - 2.0 * sigma, a + 2.0 * sigma])).collect();
    let line: Vec<_> = at().map(|((x, a), _)| Some([*x, *a, *a])).collect();
    let mut out = format!("<div class=\"chart{}\">", if plain { "" } else { " faint" });
    frame.open(&mut out, "plot");
    frame.grid(&mut out);
    frame.line(&mut out, &band, "band", false);
    frame.level(&mut out, 0.0, "zero");
    frame.line(&mut out, &line, "pull", false);
    frame.dots(&mut out, at().map(|((x, a), _)| (*x, *a)), "pull");
    frame.close(&mut out, "acceleration, m/s\u{b2}");
    let title = match region.unit {
        "1" => region.axis.to_owned(),
        of => format!("{}, {}", region.axis, unit(of)),
    };
    x_axis(&mut out, x, &ticks(x, 4.0), &title);
    out + "</div>"
}

fn frequencies(out: &mut String, diagnosis: &Diagnosis) {
    let waves: Vec<&Frequency> = diagnosis.place.frequencies.iter().filter(|wave| wave.hz > 0.0).collect();
    let [Some(first), Some(last)] = [waves.first(), waves.last()] else { return };
    // The best of many is worth less than it looks.
    let chance = (diagnosis.place.frequencies_tried.max(1) as f64).ln() + told::PLAIN_NATS;
    let frame = Frame {
        x: [first.hz.ln(), last.hz.ln()],
        y: [0.0, range(waves.iter().map(|wave| wave.gain).chain([0.0, chance]))[1]],
    };
    let best = waves.iter().max_by(|a, b| a.gain.total_cmp(&b.gain));
    let words = match best.filter(|best| best.gain > chance) {
        Some(best) => format!(
            "Something swings at {} Hz (evidence {} nats): every flight may have its own size and phase there.",
            digits(best.hz),
            told::fixed(best.gain, 1)
        ),
        None => "No frequency stands out: none passes what the best of so many reaches by chance.".to_owned(),
    };
    let mut content = String::from("<div class=\"chart\">");
    frame.open(&mut content, "plot");
    frame.grid(&mut content);
    let line: Vec<_> = waves.iter().map(|wave| Some([wave.hz.ln(), wave.gain, wave.gain])).collect();
    frame.level(&mut content, chance, "chance");
    frame.line(&mut content, &line, "gain", false);
    frame.dots(&mut content, waves.iter().map(|wave| (wave.hz.ln(), wave.gain)), "gain");
    frame.close(&mut content, "evidence, nats (dashed: chance)");
    let numbers: Vec<_> = [0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0]
        .into_iter()
        .filter(|hz: &f64| (first.hz..=last.hz).contains(hz))
        .map(|hz| (hz.ln(), digits(hz)))
        .collect();
    x_axis(&mut content, frame.x, &numbers, "frequency of the missing acceleration, Hz");
    content.push_str("</div>");
    card(out, "By frequency", &words, &content);
}
