//! The page's charts.

use bench_page::{Mark, Panel, Plot, Series};
use maud::{Markup, html};

use crate::score::{Rate, Score};

/// Colours of what is seen and of what is named.
const SEEN: usize = 1;
const NAMED: usize = 0;
const ASIDE: usize = 5;

/// A rate with its interval, %: where, lower end, upper end.
fn interval(x: f64, rate: &Rate) -> [f64; 3] {
    [x, 100.0 * rate.low, 100.0 * rate.high]
}

fn percent(rate: &Rate) -> f64 {
    100.0 * rate.value.unwrap_or(f64::NAN)
}

/// Seen and named against detectability; a bin stands at its middle, the last a little beyond its beginning.
pub(super) fn detection(score: &Score) -> Plot {
    let bins = &score.detection;
    let place = |i: usize| {
        let bin = &bins[i];
        bin.to.map_or(1.25 * bin.from, |to| 0.5 * (bin.from + to))
    };
    let of = |rate: fn(usize, &Score) -> Rate| (0..bins.len()).map(move |i| (place(i), rate(i, score)));
    let seen = |i: usize, score: &Score| score.detection[i].seen;
    let named = |i: usize, score: &Score| score.detection[i].named;
    let mut panel = Panel::new("share of cases, %");
    for (name, colour, rate) in
        [("seen", SEEN, seen as fn(usize, &Score) -> Rate), ("named rightly", NAMED, named)]
    {
        panel = panel
            .with(Series::band("", Mark::Zone, colour, of(rate).map(|(x, rate)| interval(x, &rate))))
            .with(Series::new("", Mark::Dots, colour, of(rate).map(|(x, rate)| (x, percent(&rate)))))
            .with(Series::new(name, Mark::Line, colour, of(rate).map(|(x, rate)| (x, percent(&rate)))));
    }
    Plot::new("Detection against detectability", "detectability d' (0: invisible)")
        .panel(panel.y_fixed([0.0, 105.0]))
}

/// Right answers against the probability told.
pub(super) fn reliability(score: &Score) -> Plot {
    let bins = || score.reliability.iter().map(|bin| (100.0 * bin.confidence.clamp(0.0, 1.0), &bin.right));
    let panel = Panel::new("right, %")
        .with(Series::new("as told", Mark::Dashed, ASIDE, [(0.0, 0.0), (100.0, 100.0)]))
        .with(Series::band("interval of 95 %", Mark::Zone, NAMED, bins().map(|(x, rate)| interval(x, rate))))
        .with(Series::new("right", Mark::Dots, NAMED, bins().map(|(x, rate)| (x, percent(rate)))))
        .y_fixed([0.0, 105.0]);
    Plot::new("Reliability", "probability told, %").panel(panel).x([0.0, 100.0])
}

/// Truth by answer; rows that nothing was true of are left out.
pub(super) fn confusion(score: &Score) -> Markup {
    let table = &score.confusion;
    let rows = (0..table.labels.len()).filter(|row| table.counts[*row].iter().any(|count| *count > 0));
    html! {
        div.scroll { table.matrix {
            thead { tr { th {} @for label in &table.labels { th { span { (label) } } } } }
            tbody {
                @for row in rows {
                    @let total: usize = table.counts[row].iter().sum();
                    tr {
                        th { (table.labels[row]) }
                        @for (column, count) in table.counts[row].iter().enumerate() {
                            @let tip = format!("{}: {count} of {total} answered {}", table.labels[row], table.labels[column]);
                            @let part = format!("--part:{:.0}%", 15.0 + 40.0 * *count as f64 / total as f64);
                            @if *count == 0 { td {} }
                            @else { td.hit[row == column].miss[row != column] title=(tip) style=(part) { (count) } }
                        }
                    }
                }
            }
        } }
    }
}
