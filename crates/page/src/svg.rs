//! A plot as one SVG that stands alone, for a README or a document, where no script runs: axes, words and style are in it.

use std::fmt::Write as _;

use maud::{Markup, PreEscaped, html};

use crate::{Mark, Panel, Plot, Series, palette, plot::share, range, ticks};

const STYLE: &str = include_str!("svg.css");

/// The drawing and its margins, px.
const WIDTH: f64 = 640.0;
const HEIGHT: f64 = 360.0;
const LEFT: f64 = 58.0;
const RIGHT: f64 = 14.0;
const TOP: f64 = 44.0;
const BOTTOM: f64 = 46.0;
/// Width of a letter of the legend, about.
const LETTER: f64 = 6.6;
/// Space of a legend's mark and before the next entry.
const KEY: f64 = 34.0;

impl Plot {
    /// The first panel as an SVG file.
    pub fn svg(&self) -> String {
        let empty = Panel::new("");
        let panel = self.panels.first().unwrap_or(&empty);
        let x =
            self.x.unwrap_or_else(|| range(panel.series.iter().flat_map(|series| series.x.iter().copied())));
        let y = panel.y.unwrap_or_else(|| range(panel.series.iter().flat_map(Series::values)));
        let at_x = |value: f64| LEFT + share(value, x) * (WIDTH - LEFT - RIGHT);
        let at_y = |value: f64| TOP + (1.0 - share(value, y)) * (HEIGHT - TOP - BOTTOM);
        let (right, base) = (WIDTH - RIGHT, HEIGHT - BOTTOM);
        let px = |x: f64| format!("{x:.1}");
        html! {
            svg xmlns="http://www.w3.org/2000/svg" viewBox={ "0 0 " (WIDTH) " " (HEIGHT) } role="img" aria-label=(self.title) {
                style { (PreEscaped(palette::css())) (PreEscaped(STYLE)) }
                rect.paper width=(WIDTH) height=(HEIGHT) rx="6" {}
                text.title x=(LEFT) y="18" { (self.title) }
                (legend(panel))
                @for (value, text) in ticks(y, 6.0) {
                    path.grid d={ "M" (LEFT) " " (px(at_y(value))) "H" (right) } {}
                    text.end x=(LEFT - 6.0) y=(px(at_y(value) + 4.0)) { (text) }
                }
                @for (value, text) in ticks(x, 9.0) {
                    path.tick d={ "M" (px(at_x(value))) " " (base) "v5" } {}
                    text.middle x=(px(at_x(value))) y=(base + 18.0) { (text) }
                }
                svg x=(LEFT) y=(TOP) width=(right - LEFT) height=(base - TOP)
                    viewBox={ (LEFT) " " (TOP) " " (right - LEFT) " " (base - TOP) } {
                    @for series in &panel.series { path.(class(series)) d=(path(series, at_x, at_y)) {} }
                }
                path.axis d={ "M" (LEFT) " " (TOP) "V" (base) "H" (right) } {}
                text.middle x=(0.5 * (LEFT + right)) y=(HEIGHT - 8.0) { (self.x_title) }
                text.middle transform={ "translate(14 " (0.5 * (TOP + base)) ") rotate(-90)" } { (panel.y_title) }
            }
        }
        .into_string()
    }
}

fn legend(panel: &Panel) -> Markup {
    let middle = 31.0;
    let mut x = LEFT;
    let named = panel.series.iter().filter(|series| !series.name.is_empty());
    let entries: Vec<(f64, String, &Series)> = named
        .map(|series| {
            let at = x;
            x += KEY + LETTER * series.name.chars().count() as f64;
            let mark = match series.mark {
                Mark::Dots => format!("M{} {middle}h0.01", at + 9.0),
                Mark::Crosses => cross(at + 9.0, middle),
                Mark::Band | Mark::Zone => format!("M{at} {}h18v8h-18Z", middle - 4.0),
                Mark::Line | Mark::Dashed | Mark::Steps => format!("M{at} {middle}h18"),
            };
            (at, mark, series)
        })
        .collect();
    html! {
        @for (at, mark, series) in entries {
            path.(class(series)) d=(mark) {}
            text x=(at + 22.0) y=(middle + 4.0) { (series.name) }
        }
    }
}

fn cross(x: f64, y: f64) -> String {
    format!("M{:.1} {:.1}l6 6m0 -6l-6 6", x - 3.0, y - 3.0)
}

fn class(series: &Series) -> String {
    let mark = match series.mark {
        Mark::Line | Mark::Steps => "line",
        Mark::Dashed => "line dashed",
        Mark::Dots => "dots",
        Mark::Crosses => "crosses",
        Mark::Band => "band",
        Mark::Zone => "zone",
    };
    format!("{mark} c{}", series.colour % palette::SERIES)
}

/// The outline of a series; a line breaks at its gaps.
fn path(series: &Series, at_x: impl Fn(f64) -> f64, at_y: impl Fn(f64) -> f64) -> String {
    let mut d = String::new();
    let mut is_begun = false;
    for (x, y) in series.x.iter().zip(&series.high) {
        let (px, py) = (at_x(*x), at_y(*y));
        if !py.is_finite() {
            is_begun = false;
            continue;
        }
        // Writing to a String cannot fail, here and below.
        let _ = match series.mark {
            Mark::Dots => write!(d, "M{px:.1} {py:.1}h0.01"),
            Mark::Crosses => {
                d.push_str(&cross(px, py));
                Ok(())
            }
            _ if !is_begun => write!(d, "M{px:.1} {py:.1}"),
            Mark::Steps => write!(d, "H{px:.1}V{py:.1}"),
            _ => write!(d, "L{px:.1} {py:.1}"),
        };
        is_begun = true;
    }
    if matches!(series.mark, Mark::Band | Mark::Zone) && !d.is_empty() {
        for (x, low) in series.x.iter().zip(&series.low).rev().filter(|(_, low)| low.is_finite()) {
            let _ = write!(d, "L{:.1} {:.1}", at_x(*x), at_y(*low));
        }
        d.push('Z');
    }
    d
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_figure_stands_alone_and_draws_only_what_is_finite() {
        let panel = Panel::new("thrust, N")
            .with(Series::new("readings", Mark::Dots, 0, [(0.0, 1.0), (1.0, f64::NAN), (2.0, 3.0)]))
            .with(Series::band("band", Mark::Band, 7, [[0.0, 0.5, 1.5], [2.0, 2.5, 3.5]]))
            .with(Series::new("none", Mark::Line, 2, []));
        let svg = Plot::new("<thrust>", "throttle, V").panel(panel).svg();
        assert!(svg.starts_with("<svg xmlns=") && svg.ends_with("</svg>"), "{svg}");
        assert!(svg.contains("&lt;thrust&gt;") && !svg.contains("NaN"), "{svg}");
        // Two dots in one path, the mark of the legend, and colours that begin again.
        assert_eq!(svg.matches("h0.01").count(), 3);
        assert!(svg.contains("band c1"));
    }

    #[test]
    fn a_line_breaks_at_gaps_and_draws_steps() {
        let series = Series::new("a", Mark::Steps, 0, [(0.0, 0.0), (1.0, 1.0), (2.0, f64::NAN), (5.0, 0.5)]);
        let d = path(&series, |x| x, |y| y);
        assert_eq!(d, "M0.0 0.0H1.0V1.0M5.0 0.5");
    }
}
