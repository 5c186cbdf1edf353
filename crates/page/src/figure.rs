//! A figure that stands alone: one SVG with axes, words and style, as a file or within a page. Unlike a [`Frame`](crate::Frame)
//! it keeps its proportions. What is not finite is left out.

use std::fmt::Write as _;

use crate::{escaped, plot::share, range, ticks};

const STYLE: &str = include_str!("figure.css");

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

/// How a series is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
    /// A line through the points.
    Line,
    /// The same, dashed.
    Dashed,
    /// A line that holds each value until the next.
    Steps,
    /// A dot each.
    Dots,
    /// A cross each.
    Crosses,
    /// The area between least and greatest value.
    Band,
    /// A wide band behind all others, faint.
    Zone,
}

struct Series {
    name: String,
    mark: Mark,
    colour: usize,
    /// Where, least and greatest value there.
    points: Vec<[f64; 3]>,
}

/// A figure with one pair of axes.
pub struct Figure {
    title: String,
    x_title: String,
    y_title: String,
    series: Vec<Series>,
    x: Option<[f64; 2]>,
    y: Option<[f64; 2]>,
}

/// Colours a figure has.
pub const COLOURS: usize = 6;

impl Figure {
    /// Without anything in it.
    pub fn new(title: &str, x_title: &str, y_title: &str) -> Self {
        let owned = str::to_owned;
        Self {
            title: owned(title),
            x_title: owned(x_title),
            y_title: owned(y_title),
            series: Vec::new(),
            x: None,
            y: None,
        }
    }

    /// Under another title.
    #[must_use]
    pub fn titled(mut self, title: &str) -> Self {
        title.clone_into(&mut self.title);
        self
    }

    /// Ends of the axes, where they are not to follow the data.
    #[must_use]
    pub fn axes(mut self, x: Option<[f64; 2]>, y: Option<[f64; 2]>) -> Self {
        (self.x, self.y) = (x, y);
        self
    }

    /// Adds points. An empty name is not in the legend; colours are counted from zero and begin again.
    pub fn add(
        &mut self,
        name: &str,
        mark: Mark,
        colour: usize,
        points: impl IntoIterator<Item = (f64, f64)>,
    ) {
        self.add_between(name, mark, colour, points.into_iter().map(|(x, y)| [x, y, y]));
    }

    /// Adds points with a least and a greatest value each.
    pub fn add_between(
        &mut self,
        name: &str,
        mark: Mark,
        colour: usize,
        points: impl IntoIterator<Item = [f64; 3]>,
    ) {
        let points = points.into_iter().filter(|point| point.iter().all(|x| x.is_finite())).collect();
        self.series.push(Series { name: name.to_owned(), mark, colour: colour % COLOURS, points });
    }

    /// The drawing: a file as it stands, or a part of a page.
    pub fn svg(&self) -> String {
        let points = || self.series.iter().flat_map(|series| &series.points);
        let x = self.x.unwrap_or_else(|| range(points().map(|p| p[0])));
        let y = self.y.unwrap_or_else(|| range(points().flat_map(|p| [p[1], p[2]])));
        let at_x = |value: f64| LEFT + share(value, x) * (WIDTH - LEFT - RIGHT);
        let at_y = |value: f64| TOP + (1.0 - share(value, y)) * (HEIGHT - TOP - BOTTOM);
        let mut out = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"figure\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{}\"><style>{STYLE}</style><rect class=\"paper\" width=\"{WIDTH}\" height=\"{HEIGHT}\" rx=\"8\"/>",
            escaped(&self.title)
        );
        // Writing to a String cannot fail, here and below.
        let _ = write!(out, "<text class=\"title\" x=\"{LEFT}\" y=\"18\">{}</text>", escaped(&self.title));
        self.legend(&mut out);
        for (value, text) in ticks(y, 6.0) {
            let at = at_y(value);
            let _ = write!(
                out,
                "<path class=\"grid\" d=\"M{LEFT} {at:.1}H{}\"/><text class=\"end\" x=\"{}\" y=\"{:.1}\">{text}</text>",
                WIDTH - RIGHT,
                LEFT - 6.0,
                at + 4.0
            );
        }
        let base = HEIGHT - BOTTOM;
        for (value, text) in ticks(x, 9.0) {
            let at = at_x(value);
            let _ = write!(
                out,
                "<path class=\"tick\" d=\"M{at:.1} {base}v5\"/><text class=\"middle\" x=\"{at:.1}\" y=\"{}\">{text}</text>",
                base + 18.0
            );
        }
        let inside = format!(
            "<svg x=\"{LEFT}\" y=\"{TOP}\" width=\"{}\" height=\"{}\" viewBox=\"{LEFT} {TOP} {} {}\">",
            WIDTH - LEFT - RIGHT,
            base - TOP,
            WIDTH - LEFT - RIGHT,
            base - TOP
        );
        out.push_str(&inside);
        for series in &self.series {
            series.draw(&mut out, at_x, at_y);
        }
        let _ = write!(
            out,
            "</svg><path class=\"axis\" d=\"M{LEFT} {TOP}V{base}H{}\"/><text class=\"middle\" x=\"{}\" y=\"{}\">{}</text><text class=\"middle\" transform=\"translate(14 {}) rotate(-90)\">{}</text></svg>",
            WIDTH - RIGHT,
            0.5 * (LEFT + WIDTH - RIGHT),
            HEIGHT - 8.0,
            escaped(&self.x_title),
            0.5 * (TOP + base),
            escaped(&self.y_title)
        );
        out
    }

    fn legend(&self, out: &mut String) {
        let mut x = LEFT;
        for series in self.series.iter().filter(|series| !series.name.is_empty()) {
            let middle = 31.0;
            let mark = match series.mark {
                Mark::Dots => format!("M{} {middle}h0.01", x + 9.0),
                Mark::Crosses => cross(x + 9.0, middle),
                Mark::Band | Mark::Zone => format!("M{x} {}h18v8h-18Z", middle - 4.0),
                Mark::Line | Mark::Dashed | Mark::Steps => format!("M{x} {middle}h18"),
            };
            let _ = write!(
                out,
                "<path class=\"{}\" d=\"{mark}\"/><text x=\"{}\" y=\"{}\">{}</text>",
                series.class(),
                x + 22.0,
                middle + 4.0,
                escaped(&series.name)
            );
            x += KEY + LETTER * series.name.chars().count() as f64;
        }
    }
}

fn cross(x: f64, y: f64) -> String {
    format!("M{:.1} {:.1}l6 6m0 -6l-6 6", x - 3.0, y - 3.0)
}

impl Series {
    fn class(&self) -> String {
        let mark = match self.mark {
            Mark::Line | Mark::Steps => "line",
            Mark::Dashed => "line dashed",
            Mark::Dots => "dots",
            Mark::Crosses => "crosses",
            Mark::Band => "band",
            Mark::Zone => "zone",
        };
        format!("{mark} c{}", self.colour)
    }

    fn draw(&self, out: &mut String, at_x: impl Fn(f64) -> f64, at_y: impl Fn(f64) -> f64) {
        let mut d = String::new();
        for (i, [x, low, high]) in self.points.iter().copied().enumerate() {
            let (px, py) = (at_x(x), at_y(high));
            let _ = match self.mark {
                Mark::Dots => write!(d, "M{px:.1} {py:.1}h0.01"),
                Mark::Crosses => {
                    d.push_str(&cross(px, py));
                    Ok(())
                }
                _ if i == 0 => write!(d, "M{px:.1} {py:.1}"),
                Mark::Steps => write!(d, "H{px:.1}V{py:.1}"),
                _ => write!(d, "L{px:.1} {py:.1}"),
            };
            debug_assert!(low <= high);
        }
        if matches!(self.mark, Mark::Band | Mark::Zone) {
            for [x, low, _] in self.points.iter().rev() {
                let _ = write!(d, "L{:.1} {:.1}", at_x(*x), at_y(*low));
            }
            d.push('Z');
        }
        if !self.points.is_empty() {
            let _ = write!(out, "<path class=\"{}\" d=\"{d}\"/>", self.class());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_figure_stands_alone_and_draws_only_what_is_finite() {
        let mut figure = Figure::new("<thrust>", "throttle, V", "thrust, N");
        figure.add("readings", Mark::Dots, 0, [(0.0, 1.0), (1.0, f64::NAN), (2.0, 3.0)]);
        figure.add_between("band", Mark::Band, 7, [[0.0, 0.5, 1.5], [2.0, 2.5, 3.5]]);
        figure.add("none", Mark::Line, 2, []);
        let svg = figure.svg();
        assert!(svg.starts_with("<svg xmlns=") && svg.ends_with("</svg>"), "{svg}");
        assert!(svg.contains("&lt;thrust&gt;") && !svg.contains("NaN"), "{svg}");
        // Two dots in one path, the mark of the legend, and colours that begin again.
        assert_eq!(svg.matches("h0.01").count(), 3);
        assert!(svg.contains("band c1"));
    }
}
