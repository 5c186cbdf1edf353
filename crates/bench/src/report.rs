//! Flights as one page: what they reached, what was recorded, and what they were flown with.

mod flown;
mod loaded;
mod settings;
mod timing;
mod traces;

use bench_page::{
    Page, Section, Tone, Verdict,
    parts::{Column, badge, cell, table, warnings},
};
use maud::{Markup, html};

#[cfg(feature = "studies")]
pub use self::traces::less_between;
pub use self::{flown::Flown, loaded::Loaded};
use crate::words;

/// The page of flights, with further sections behind theirs.
pub fn page(flights: &[Flown], further: Vec<Section>) -> String {
    let title = match flights {
        [flight] => format!("Report: {}", flight.name()),
        flights => format!("Report of {}", words::count(flights.len() as u64, "flight")),
    };
    let sections = match flights {
        [flight] => flight.sections(),
        flights => [Section::new("Overview", overview(flights))]
            .into_iter()
            .chain(flights.iter().map(|flight| {
                Section::new(flight.name(), html! {}).verdict(flight.verdict()).parts(flight.sections())
            }))
            .collect(),
    };
    Page::new(title, verdict(flights)).sections(sections).sections(further).made_by(words::command()).html()
}

/// What all flights together come to.
fn verdict(flights: &[Flown]) -> Verdict {
    if let [flight] = flights {
        return flight.verdict();
    }
    let all: Vec<String> = flights.iter().flat_map(|flight| flight.warnings().to_vec()).collect();
    let of = |tone| flights.iter().filter(|flight| flight.tone() == tone).count();
    let judged = of(Tone::Good) + of(Tone::Bad);
    let (tone, headline) = match (of(Tone::Bad), of(Tone::Good)) {
        (0, 0) => {
            (Tone::Plain, format!("{}, without criteria", words::count(flights.len() as u64, "flight")))
        }
        (0, passed) if passed == flights.len() => {
            (Tone::Good, format!("All {passed} flights met their criteria"))
        }
        (0, passed) => {
            (Tone::Odd, format!("{passed} of {} flights met criteria, others have none", flights.len()))
        }
        (missed, _) => (Tone::Bad, format!("{missed} of {judged} flights missed criteria or were stopped")),
    };
    Verdict::new(tone, headline).with(warnings(&all))
}

fn overview(flights: &[Flown]) -> Markup {
    let rows = flights.iter().map(|flight| {
        let summary = &flight.summary;
        let metres = |x: Option<f64>| cell(x.map_or_else(|| "-".to_owned(), |x| format!("{x:.3}")));
        let seconds = |x: Option<f64>| cell(x.map_or_else(|| "-".to_owned(), |x| format!("{x:.1}")));
        let (tone, word) = flight.judged();
        vec![
            html! { b { (flight.name()) } },
            badge(tone, word),
            cell(flight.info.mode.clone()),
            cell(&flight.info.rig),
            cell(&flight.info.mission),
            cell(flight.info.seed.map_or_else(|| "-".to_owned(), |seed| seed.to_string())),
            cell(format!("{:.1}", flight.info.duration_s)),
            metres(summary.peak_m),
            metres(summary.rms_error_m),
            seconds(summary.settling_time_s),
            cell(summary.overruns),
            cell(flight.notable()),
        ]
    });
    let columns = [
        Column::Words("recording"),
        Column::Words(""),
        Column::Words("mode"),
        Column::Words("rig"),
        Column::Words("mission"),
        Column::Number("seed"),
        Column::Number("length, s"),
        Column::Number("peak, m"),
        Column::Number("RMS error, m"),
        Column::Number("settled after, s"),
        Column::Number("overruns"),
        Column::Number("warnings, errors"),
    ];
    table(&columns, rows)
}
