//! Flight by flight: how well it is predicted, what was seen, and what pulls at it.

use std::{collections::HashSet, fmt::Write as _, path::Path};

use bench_diagnosis::{Consistency, Diagnosis, FlightGap, Trace};
use bench_page::{Frame, Point, digits, escaped, range, ticks, x_axis};

use super::{heading, told};

/// Most flights that are drawn: a page of more would be too large to open.
const DRAWN: usize = 24;
/// More flights than this are a table that opens on a click.
const ROWS: usize = 30;

pub(super) fn section(out: &mut String, diagnosis: &Diagnosis) {
    heading(out, "Flight by flight", "");
    let names: Vec<&str> = diagnosis.flights.iter().map(|flight| flight.name.as_str()).collect();
    let short = short_names(&names);
    consistency(out, &diagnosis.gap.flights, &short);
    traces(out, diagnosis, &short);
}

/// File names where they tell flights apart, else names in full.
fn short_names(names: &[&str]) -> impl Fn(&str) -> String + use<> {
    let file =
        |name: &str| Path::new(name).file_name().map_or(name.into(), |f| f.to_string_lossy().into_owned());
    let apart = names.iter().map(|name| file(name)).collect::<HashSet<_>>().len() == names.len();
    move |name| if apart { file(name) } else { name.to_owned() }
}

fn consistency(out: &mut String, flights: &[FlightGap], short: &impl Fn(&str) -> String) {
    let mut table = String::from(
        "<div class=\"scroll\"><table><thead><tr><th rowspan=\"2\">flight</th><th rowspan=\"2\" class=\"number\">sightings</th>\
         <th class=\"of\" colspan=\"2\">misfit, nats</th><th class=\"of\" colspan=\"2\">error over expected</th>\
         <th class=\"of\" colspan=\"2\">whiteness p</th><th class=\"of\" colspan=\"2\">correlation with thrust</th></tr><tr>",
    );
    for _ in 0..4 {
        table.push_str("<th class=\"number\">rig</th><th class=\"number\">best</th>");
    }
    table.push_str("</tr></thead><tbody>");
    for flight in flights {
        let _ = write!(
            table,
            "<tr><td class=\"span\" title=\"{}\">{}</td><td class=\"number\">{}</td>",
            escaped(&flight.name),
            escaped(&short(&flight.name)),
            flight.sightings
        );
        let [before, after]: [&Consistency; 2] = [&flight.nominal, &flight.with_effect];
        // Limits of one in a thousand, as many numbers are looked at.
        let n = flight.sightings.max(1) as f64;
        let nis_off = 3.3 * (2.0 / n).sqrt();
        let correlation_off = 3.3 / n.sqrt();
        let columns: [(f64, bool); 8] = [
            (flight.nll[0], false),
            (flight.nll[2], false),
            (before.mean_nis, before.mean_nis - 1.0 > nis_off),
            (after.mean_nis, after.mean_nis - 1.0 > nis_off),
            (before.whiteness_p, before.whiteness_p < 1e-3),
            (after.whiteness_p, after.whiteness_p < 1e-3),
            (before.thrust_correlation, before.thrust_correlation.abs() > correlation_off),
            (after.thrust_correlation, after.thrust_correlation.abs() > correlation_off),
        ];
        for (value, off) in columns {
            let text = told::fixed(value, 2);
            let _ = write!(table, "<td class=\"number{}\">{text}</td>", if off { " off" } else { "" });
        }
        table.push_str("</tr>");
    }
    table.push_str("</tbody></table></div>");
    let words = "How the rig as it is and the best hypothesis predict each flight. For a right model the mean squared error \
                 over the expected one is 1, errors are white (p is the chance that white ones look so correlated; Ljung and \
                 Box) and do not follow the thrust. Red would come by chance once in a thousand.";
    let _ = if flights.len() > ROWS {
        write!(
            out,
            "<details class=\"card\"><summary>Consistency of {} flights</summary><p class=\"soft\">{words}</p>{table}</details>",
            flights.len()
        )
    } else {
        write!(
            out,
            "<section class=\"card\"><h3>Consistency</h3><p class=\"soft\">{words}</p>{table}</section>"
        )
    };
}

fn traces(out: &mut String, diagnosis: &Diagnosis, short: &impl Fn(&str) -> String) {
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
    let _ = write!(
        out,
        "<h3>What was seen, and what pulls at it</h3><p class=\"soft\">The disturbance is the acceleration that the re-fitted \
         rig does not explain, smoothed over the whole flight, with 2 sigma. Scales are the same in all flights.{which}</p>\
         <p class=\"keys\"><span class=\"seen\">altitude seen</span><span class=\"smoothed\">smoothed</span>\
         <span class=\"thrust\">thrust commanded</span><span class=\"pull\">disturbance</span></p><div class=\"small\">"
    );
    let all = |of: fn(&Trace) -> &[f64]| drawn.iter().flat_map(move |trace| of(trace)).copied();
    let altitude = range(all(|t| &t.seen_m).chain(all(|t| &t.smoothed_m)));
    let thrust = range(all(|t| &t.thrust_to_weight));
    let sigmas = || all(|t| &t.disturbance_m_s2).zip(all(|t| &t.sigma_m_s2));
    let pull = range(sigmas().flat_map(|(a, sigma)| [a - 2.0 * sigma, a + 2.0 * sigma]).chain([0.0]));
    for trace in &drawn {
        let _ = write!(
            out,
            "<section class=\"card\"><h3 title=\"{}\">{}</h3>",
            escaped(&trace.name),
            escaped(&short(&trace.name))
        );
        flight(out, trace, altitude, thrust, pull);
        out.push_str("</section>");
    }
    out.push_str("</div>");
}

fn flight(out: &mut String, trace: &Trace, altitude: [f64; 2], thrust: [f64; 2], pull: [f64; 2]) {
    let t = &trace.time_s;
    let x = [t[0], t[t.len() - 1]];
    let line = |values: &[f64]| -> Vec<Point> {
        t.iter().zip(values).map(|(t, value)| Some([*t, *value, *value])).collect()
    };
    out.push_str("<div class=\"chart\">");

    let frame = Frame { x, y: altitude };
    frame.open(out, "plot");
    frame.grid(out);
    frame.dots(out, t.iter().copied().zip(trace.seen_m.iter().copied()), "seen");
    frame.line(out, &line(&trace.smoothed_m), "smoothed", false);
    frame.close(out, "altitude, m");

    let frame = Frame { x, y: thrust };
    frame.open(out, "plot low");
    frame.grid(out);
    frame.line(out, &line(&trace.thrust_to_weight), "thrust", true);
    frame.close(out, "thrust over weight, 1");

    let frame = Frame { x, y: pull };
    frame.open(out, "plot low");
    frame.grid(out);
    let band: Vec<Point> = t
        .iter()
        .zip(trace.disturbance_m_s2.iter().zip(&trace.sigma_m_s2))
        .map(|(t, (a, sigma))| Some([*t, a - 2.0 * sigma, a + 2.0 * sigma]))
        .collect();
    frame.line(out, &band, "band", false);
    frame.level(out, 0.0, "zero");
    frame.line(out, &line(&trace.disturbance_m_s2), "pull", false);
    frame.close(out, "disturbance, m/s\u{b2}");
    x_axis(out, x, &ticks(x, 5.0), &format!("time from take-off, s (to {})", digits(x[1])));
    out.push_str("</div>");
}
