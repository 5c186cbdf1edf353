//! Flight by flight: how well it is predicted, what was seen, and what pulls at it.

use std::collections::HashSet;

use bench_diagnosis::{Diagnosis, FlightGap, Trace};
use bench_inference::Consistency;
use bench_page::{
    Mark, Panel, Plot, Section, Series,
    parts::{block, folded},
    range,
};
use maud::{Markup, html};

use super::{FOUND, PULL, told};
use crate::words;

/// Most flights that are drawn: a page of more would be too large to open.
const DRAWN: usize = 24;
/// More flights than this are a table that opens on a click.
const ROWS: usize = 30;
/// Colours of what was seen and of the thrust.
const SEEN: usize = 4;
const THRUST: usize = 2;

pub(super) fn section(diagnosis: &Diagnosis) -> Section {
    let names: Vec<&str> = diagnosis.flights.iter().map(|flight| flight.name.as_str()).collect();
    let short = short_names(&names);
    let body = html! {
        (traces(diagnosis, &short))
        (consistency(&diagnosis.gap.flights, &short))
    };
    Section::new("Flight by flight", body)
}

/// File names where they tell flights apart, else names in full.
fn short_names(names: &[&str]) -> impl Fn(&str) -> String + use<> {
    let apart = names.iter().map(words::file_name).collect::<HashSet<_>>().len() == names.len();
    move |name| if apart { words::file_name(name) } else { name.to_owned() }
}

fn consistency(flights: &[FlightGap], short: &impl Fn(&str) -> String) -> Markup {
    let row = |flight: &FlightGap| {
        let [before, after]: [&Consistency; 2] = [&flight.nominal, &flight.with_effect];
        // Limits of one in a thousand, as many numbers are looked at.
        let n = flight.measurements.max(1) as f64;
        let nis_off = 3.3 * (2.0 / n).sqrt();
        let correlation_off = 3.3 / n.sqrt();
        let columns: [(f64, bool); 8] = [
            (told::above_floor(flight.nll[0], flight.nll[3]), false),
            (told::above_floor(flight.nll[2], flight.nll[3]), false),
            (before.mean_nis, before.mean_nis - 1.0 > nis_off),
            (after.mean_nis, after.mean_nis - 1.0 > nis_off),
            (before.whiteness_p, before.whiteness_p < 1e-3),
            (after.whiteness_p, after.whiteness_p < 1e-3),
            (before.thrust_correlation, before.thrust_correlation.abs() > correlation_off),
            (after.thrust_correlation, after.thrust_correlation.abs() > correlation_off),
        ];
        html! {
            tr {
                td.nowrap title=(flight.name) { (short(&flight.name)) }
                td.number { (flight.measurements) }
                @for (value, off) in columns { td.number.off[off] { (told::fixed(value, 2)) @if off { " !" } } }
            }
        }
    };
    let table = html! {
        div.scroll { table {
            thead {
                tr {
                    th rowspan="2" { "flight" } th.number rowspan="2" { "measurements" }
                    @for title in ["misfit above noise, nats", "error over expected", "whiteness p", "correlation with thrust"] {
                        th.number colspan="2" { (title) }
                    }
                }
                tr { @for _ in 0..4 { th.number { "rig" } th.number { "best" } } }
            }
            tbody { @for flight in flights { (row(flight)) } }
        } }
    };
    let words = "How the rig as it is and the best hypothesis predict each flight. For a right model the mean squared error \
                 over the expected one is 1, errors are white (p is the chance that white ones look so correlated; Ljung and \
                 Box) and do not follow the thrust. What is marked ! would come by chance once in a thousand.";
    if flights.len() > ROWS {
        let content = html! { p.soft { (words) } (table) };
        folded(format!("Consistency of {} flights", flights.len()), "", false, content)
    } else {
        block("Consistency", words, table)
    }
}

fn traces(diagnosis: &Diagnosis, short: &impl Fn(&str) -> String) -> Markup {
    let mut drawn: Vec<&Trace> = diagnosis.traces.iter().filter(|trace| !trace.time_s.is_empty()).collect();
    let total = drawn.len();
    if total > DRAWN {
        let worst = |trace: &&Trace| {
            let gap = diagnosis.gap.flights.iter().find(|flight| flight.name == trace.name);
            gap.map_or(f64::NEG_INFINITY, |flight| flight.nll[0] - flight.nll[3])
        };
        drawn.sort_by(|a, b| worst(b).total_cmp(&worst(a)));
        drawn.truncate(DRAWN);
    }
    let which = if total > DRAWN {
        format!(" Of {total} flights these are the {DRAWN} that the rig predicts worst; --json has all.")
    } else {
        String::new()
    };
    let words = format!(
        "The disturbance is the acceleration that the re-fitted rig does not explain, smoothed over the whole flight, with \
         2 sigma. Altitude and disturbance have the same scales in all flights as the page opens.{which}"
    );
    let all = |of: fn(&Trace) -> &[f64]| drawn.iter().flat_map(move |trace| of(trace)).copied();
    let altitude = range(all(|t| &t.seen_m).chain(all(|t| &t.smoothed_m)));
    let thrust = range(all(|t| &t.thrust_to_weight));
    let sigmas = || all(|t| &t.disturbance_m_s2).zip(all(|t| &t.sigma_m_s2));
    let pull = range(sigmas().flat_map(|(a, sigma)| [a - 2.0 * sigma, a + 2.0 * sigma]).chain([0.0]));
    let plots =
        drawn.iter().map(|trace| block(&short(&trace.name), "", flight(trace, [altitude, thrust, pull])));
    block(
        "What was seen, and what pulls at it",
        &words,
        html! { div.grid.wide { @for plot in plots { (plot) } } },
    )
}

fn flight(trace: &Trace, [altitude, thrust, pull]: [[f64; 2]; 3]) -> Plot {
    let line = |values: &[f64]| trace.time_s.iter().copied().zip(values.iter().copied()).collect::<Vec<_>>();
    let band = trace
        .time_s
        .iter()
        .zip(trace.disturbance_m_s2.iter().zip(&trace.sigma_m_s2))
        .map(|(t, (a, sigma))| [*t, a - 2.0 * sigma, a + 2.0 * sigma]);
    Plot::new(format!("Traces of {}", trace.name), "time from take-off, s")
        .panel(
            Panel::new("altitude, m")
                .with(Series::new("seen", Mark::Dots, SEEN, line(&trace.seen_m)))
                .with(Series::new("smoothed", Mark::Line, FOUND, line(&trace.smoothed_m)))
                .y(altitude),
        )
        .panel(
            Panel::new("disturbance, m/s\u{b2}")
                .with(Series::band("2 sigma", Mark::Band, PULL, band))
                .with(Series::new("", Mark::Line, PULL, line(&trace.disturbance_m_s2)))
                .level(0.0, "")
                .y(pull),
        )
        .panel(
            Panel::new("thrust over weight")
                .with(Series::new("", Mark::Steps, THRUST, line(&trace.thrust_to_weight)))
                .y(thrust)
                .low(),
        )
}
