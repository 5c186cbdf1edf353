//! A plot as one SVG that stands alone, for a README or a document, where no script runs: axes, words and style are in it.

use std::fmt::Write as _;

use maud::{Markup, PreEscaped, html};

use crate::{Mark, Panel, Plot, Series, palette, plot::share, range, ticks};

const STYLE: &str = include_str!("svg.css");

/// The drawing and its margins, px.
const WIDTH: f64 = 640.0;
/// Height of the axes of a panel and of a low one, as on a page half as high.
const AXES_HEIGHT: f64 = 270.0;
const LOW_HEIGHT: f64 = 135.0;
/// From the x axis of a panel to the next one, with room for its legend.
const BETWEEN: f64 = 34.0;
const LEFT: f64 = 58.0;
const RIGHT: f64 = 14.0;
const TOP: f64 = 44.0;
const BOTTOM: f64 = 46.0;
/// Width of a letter of the legend, about.
const LETTER: f64 = 6.6;
/// Space of a legend's mark and before the next entry.
const KEY: f64 = 34.0;

impl Plot {
    /// The panels as an SVG file, below one another over one x axis.
    pub fn svg(&self) -> String {
        let all_x = || self.panels.iter().flat_map(|panel| &panel.series).flat_map(|series| &series.x);
        let x = self.x.unwrap_or_else(|| range(all_x().copied()));
        let mut top = TOP;
        let placed: Vec<(&Panel, [f64; 2])> = self
            .panels
            .iter()
            .map(|panel| {
                let base = top + if panel.low { LOW_HEIGHT } else { AXES_HEIGHT };
                let place = [top, base];
                top = base + BETWEEN;
                (panel, place)
            })
            .collect();
        let base = placed.last().map_or(TOP + AXES_HEIGHT, |(_, [_, base])| *base);
        let height = base + BOTTOM;
        let right = WIDTH - RIGHT;
        let at_x = |value: f64| LEFT + share(value, x) * (right - LEFT);
        html! {
            svg xmlns="http://www.w3.org/2000/svg" viewBox={ "0 0 " (WIDTH) " " (height) } role="img" aria-label=(self.title) {
                style { (PreEscaped(palette::css())) (PreEscaped(STYLE)) }
                rect.paper width=(WIDTH) height=(height) rx="6" {}
                text.title x=(LEFT) y="18" { (self.title) }
                @for (panel, place) in &placed { (axes(panel, *place, x)) }
                @for (value, text) in ticks(x, 9.0) {
                    text.middle x=(px(at_x(value))) y=(base + 18.0) { (text) }
                }
                text.middle x=(0.5 * (LEFT + right)) y=(height - 8.0) { (self.x_title) }
            }
        }
        .into_string()
    }
}

fn px(x: f64) -> String {
    format!("{x:.1}")
}

/// A panel between its top and its x axis, whose numbers stand below the last one alone.
fn axes(panel: &Panel, [top, base]: [f64; 2], x: [f64; 2]) -> Markup {
    let levels = panel.levels.iter().map(|(y, _)| *y);
    let y = panel.y.unwrap_or_else(|| range(panel.series.iter().flat_map(Series::values).chain(levels)));
    let right = WIDTH - RIGHT;
    let at_x = |value: f64| LEFT + share(value, x) * (right - LEFT);
    let at_y = |value: f64| top + (1.0 - share(value, y)) * (base - top);
    let count = if panel.low { 3.0 } else { 6.0 };
    html! {
        (legend(panel, top - 13.0))
        @for (value, text) in ticks(y, count) {
            path.grid d={ "M" (LEFT) " " (px(at_y(value))) "H" (right) } {}
            text.end x=(LEFT - 6.0) y=(px(at_y(value) + 4.0)) { (text) }
        }
        @for (value, _) in ticks(x, 9.0) {
            path.tick d={ "M" (px(at_x(value))) " " (base) "v5" } {}
        }
        svg x=(LEFT) y=(top) width=(right - LEFT) height=(base - top)
            viewBox={ (LEFT) " " (top) " " (right - LEFT) " " (base - top) } {
            @for (level, _) in &panel.levels {
                path.level d={ "M" (LEFT) " " (px(at_y(*level))) "H" (right) } {}
            }
            @for series in &panel.series { path.(class(series)) d=(path(series, at_x, at_y)) {} }
        }
        path.axis d={ "M" (LEFT) " " (top) "V" (base) "H" (right) } {}
        text.middle transform={ "translate(14 " (0.5 * (top + base)) ") rotate(-90)" } { (panel.y_title) }
    }
}

fn legend(panel: &Panel, middle: f64) -> Markup {
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
    fn panels_stand_below_one_another_each_with_its_own_axis() {
        let first =
            Panel::new("altitude, m").with(Series::new("flight", Mark::Line, 0, [(0.0, 0.0), (10.0, 0.4)]));
        let second = Panel::new("off, cm")
            .with(Series::new("", Mark::Line, 3, [(0.0, -2.0), (10.0, 3.0)]))
            .level(0.0, "")
            .low();
        let alone = Plot::new("climb", "time, s").panel(first.clone()).svg();
        let both = Plot::new("climb", "time, s").panel(first).panel(second).svg();
        assert!(alone.contains("viewBox=\"0 0 640 360\"") && !alone.contains("off, cm"), "{alone}");
        assert!(both.contains("viewBox=\"0 0 640 529\""), "{both}");
        for title in ["altitude, m", "off, cm", "time, s"] {
            assert_eq!(both.matches(title).count(), 1, "{title}: {both}");
        }
        // The axes of the first where they were, those of the second below, and the line at its zero: 2 of 5 cm up, and the
        // margin of its range.
        for axis in ["M58 44V314H626", "M58 348V483H626"] {
            assert!(both.contains(axis), "{axis}: {both}");
        }
        let level =
            both.split("class=\"level\" d=\"M58 ").nth(1).and_then(|rest| rest.split('H').next()).unwrap();
        let y: f64 = level.parse().unwrap();
        let [low, high] = range([-2.0, 3.0]);
        assert!((y - (348.0 + 135.0 * high / (high - low))).abs() < 0.06, "{y}");
        // Numbers of time stand once.
        assert_eq!(both.matches(">10</text>").count(), 1, "{both}");
    }

    #[test]
    fn a_line_breaks_at_gaps_and_draws_steps() {
        let series = Series::new("a", Mark::Steps, 0, [(0.0, 0.0), (1.0, 1.0), (2.0, f64::NAN), (5.0, 0.5)]);
        let d = path(&series, |x| x, |y| y);
        assert_eq!(d, "M0.0 0.0H1.0V1.0M5.0 0.5");
    }
}
