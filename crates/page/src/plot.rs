//! Plots as inline SVG. The drawing is stretched to the page; all words stand beside it as HTML, so that they keep their
//! size on a phone. What is not finite is left out.

use std::fmt::Write as _;

use crate::{digits, escaped};

/// Width of a drawing's own coordinates.
pub const WIDTH: f64 = 1000.0;
/// Its height.
pub const HEIGHT: f64 = 100.0;

/// About so many numbers on a y axis.
const Y_TICKS: f64 = 4.0;

/// A point of a line: where, least and greatest value there. `None` is a gap.
pub type Point = Option<[f64; 3]>;
/// A number on an axis: where, and what stands there.
pub type Tick = (f64, String);

/// From data to the drawing's coordinates.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    /// Left and right end.
    pub x: [f64; 2],
    /// Lower and upper end.
    pub y: [f64; 2],
}

/// How far along a range, 0 to 1 within it.
pub fn share(x: f64, [from, to]: [f64; 2]) -> f64 {
    if to > from { (x - from) / (to - from) } else { 0.5 }
}

/// Least and greatest of the finite values, with some room; 0 to 1 if there are none.
pub fn range(values: impl IntoIterator<Item = f64>) -> [f64; 2] {
    let [low, high] = values
        .into_iter()
        .filter(|value| value.is_finite())
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| [low.min(value), high.max(value)]);
    if low > high {
        return [0.0, 1.0];
    }
    let room = if high > low { 0.06 * (high - low) } else { (0.1 * high.abs()).max(1e-9) };
    [low - room, high + room]
}

/// Round numbers within a range, about `wanted` of them.
pub fn ticks([from, to]: [f64; 2], wanted: f64) -> Vec<Tick> {
    let rough = (to - from) / wanted;
    if rough <= 0.0 || !rough.is_finite() {
        return Vec::new();
    }
    let magnitude = 10_f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|factor| factor * magnitude).find(|step| *step >= rough);
    let Some(step) = step.filter(|step| *step > 0.0) else { return Vec::new() };
    let (first, last) = ((from / step).ceil() as i64, (to / step).floor() as i64);
    // A range far from zero and narrow has more ticks than a real number tells apart.
    if last.saturating_sub(first) > 20 {
        return Vec::new();
    }
    (first..=last).map(|i| (i as f64 * step, digits(i as f64 * step))).collect()
}

/// The axis below a plot: its numbers and its title.
pub fn x_axis(out: &mut String, range: [f64; 2], ticks: &[Tick], title: &str) {
    out.push_str("<div class=\"xaxis\">");
    for (at, text) in ticks {
        let _ =
            write!(out, "<span style=\"left:{:.1}%\">{}</span>", 100.0 * share(*at, range), escaped(text));
    }
    let _ = write!(out, "<b>{}</b></div>", escaped(title));
}

impl Frame {
    /// Where a value stands from the left.
    pub fn x(&self, x: f64) -> f64 {
        share(x, self.x) * WIDTH
    }

    /// Where a value stands from the top.
    pub fn y(&self, y: f64) -> f64 {
        (1.0 - share(y, self.y)) * HEIGHT
    }

    /// Begins the drawing.
    pub fn open(&self, out: &mut String, class: &str) {
        let _ = write!(
            out,
            "<div class=\"{class}\"><svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" preserveAspectRatio=\"none\" aria-hidden=\"true\">"
        );
    }

    /// Lines across at the numbers of the y axis.
    pub fn grid(&self, out: &mut String) {
        for (tick, _) in ticks(self.y, Y_TICKS) {
            self.level(out, tick, "grid");
        }
    }

    /// A line across.
    pub fn level(&self, out: &mut String, y: f64, class: &str) {
        let _ = write!(out, "<path class=\"{class}\" d=\"M0 {:.2}H{WIDTH}\"/>", self.y(y));
    }

    /// One path a stretch without gaps: along the greatest values, and back along the least where they differ.
    pub fn line(&self, out: &mut String, points: &[Point], class: &str, steps: bool) {
        let gap = |point: &Point| point.is_none_or(|point| point.iter().any(|x| !x.is_finite()));
        for run in points.split(gap) {
            let run: Vec<[f64; 3]> = run.iter().flatten().copied().collect();
            let thin = run.iter().all(|[_, low, high]| low == high);
            let Some((first, rest)) = run.split_first() else { continue };
            let steps = steps && thin;
            let mut d = format!("M{:.1} {:.2}", self.x(first[0]), self.y(first[2]));
            for [x, _, high] in rest {
                let _ = if steps {
                    write!(d, "H{:.1}V{:.2}", self.x(*x), self.y(*high))
                } else {
                    write!(d, "L{:.1} {:.2}", self.x(*x), self.y(*high))
                };
            }
            if !thin {
                for [x, low, _] in run.iter().rev() {
                    let _ = write!(d, "L{:.1} {:.2}", self.x(*x), self.y(*low));
                }
                d.push('Z');
            } else if rest.is_empty() {
                // A lone point shows by its round ends.
                d.push_str("h0.01");
            }
            let open = if thin { " steps" } else { "" };
            let _ = write!(out, "<path class=\"line {class}{open}\" d=\"{d}\"/>");
        }
    }

    /// A dot each: round ends of strokes without length, which stretching leaves round.
    pub fn dots(&self, out: &mut String, points: impl IntoIterator<Item = (f64, f64)>, class: &str) {
        let d = points.into_iter().filter(|(x, y)| x.is_finite() && y.is_finite()).fold(
            String::new(),
            |mut d, (x, y)| {
                let _ = write!(d, "M{:.1} {:.2}h0.01", self.x(x), self.y(y));
                d
            },
        );
        if !d.is_empty() {
            let _ = write!(out, "<path class=\"dots {class}\" d=\"{d}\"/>");
        }
    }

    /// Ends the drawing: numbers of the y axis and what it shows.
    pub fn close(&self, out: &mut String, name: &str) {
        out.push_str("</svg>");
        for (tick, text) in ticks(self.y, Y_TICKS) {
            let _ = write!(out, "<span class=\"y\" style=\"top:{:.1}%\">{text}</span>", self.y(tick));
        }
        let _ = write!(out, "<span class=\"name\">{}</span></div>", escaped(name));
    }
}

/// What a row of [`Rows`] shows.
#[derive(Clone, Copy, Debug)]
pub struct Bar<'a> {
    /// The value.
    pub value: f64,
    /// Its interval, if it has one.
    pub interval: Option<[f64; 2]>,
    /// Drawn as a bar from here to the value; as a dot otherwise.
    pub from: Option<f64>,
    /// Colour.
    pub class: &'a str,
}

/// Named values below each other over one axis.
pub struct Rows {
    html: String,
    range: [f64; 2],
    ticks: Vec<Tick>,
}

impl Rows {
    /// Rows over a range.
    pub fn new(range: [f64; 2]) -> Self {
        Self { html: "<div class=\"rows\"><div>".to_owned(), range, ticks: ticks(range, 5.0) }
    }

    /// Adds a row: its name as HTML, what is drawn, and what is told beside it.
    pub fn row(&mut self, name: &str, bar: Option<Bar<'_>>, told: &str) {
        let left = |x: f64| 100.0 * share(x, self.range).clamp(0.0, 1.0);
        let _ = write!(
            self.html,
            "<span class=\"of\">{name}</span><span class=\"told\">{}</span><span class=\"track\">",
            escaped(told)
        );
        for (tick, _) in &self.ticks {
            let _ = write!(self.html, "<i class=\"tick\" style=\"left:{:.2}%\"></i>", left(*tick));
        }
        if let Some(bar) = bar.filter(|bar| bar.value.is_finite()) {
            let at = left(bar.value);
            let class = bar.class;
            if let Some(from) = bar.from.map(left) {
                let (start, width) = (from.min(at), (at - from).abs());
                let _ = write!(
                    self.html,
                    "<i class=\"bar {class}\" style=\"left:{start:.2}%;width:{width:.2}%\"></i>"
                );
            }
            if let Some([low, high]) = bar.interval.filter(|ends| ends.iter().all(|end| end.is_finite())) {
                let (low, high) = (left(low), left(high));
                let _ = write!(
                    self.html,
                    "<i class=\"whisker {class}\" style=\"left:{low:.2}%;width:{:.2}%\"></i>",
                    high - low
                );
            }
            if bar.from.is_none() {
                let _ = write!(self.html, "<i class=\"dot {class}\" style=\"left:{at:.2}%\"></i>");
            }
        }
        self.html.push_str("</span>");
    }

    /// The rows with their axis.
    pub fn finish(mut self, title: &str) -> String {
        self.html.push_str("<span class=\"foot\">");
        x_axis(&mut self.html, self.range, &self.ticks, title);
        self.html + "</span></div></div>"
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        let at = |range| ticks(range, 3.0).into_iter().map(|(at, _)| at).collect::<Vec<_>>();
        assert_eq!(at([0.0, 0.61]), [0.0, 0.5]);
        assert_eq!(at([-1.2, 1.2]), [-1.0, 0.0, 1.0]);
        assert!(at([1.0, 1.0]).is_empty());
        assert!(at([f64::MIN, f64::MAX]).len() <= 21);
    }

    #[test]
    fn a_line_breaks_at_gaps_and_draws_steps() {
        let frame = Frame { x: [0.0, 10.0], y: [0.0, 1.0] };
        let points = [Some([0.0, 0.0, 0.0]), Some([1.0, 1.0, 1.0]), None, Some([5.0, 0.5, 0.5])];
        let mut out = String::new();
        frame.line(&mut out, &points, "a", true);
        assert_eq!(out.matches("<path").count(), 2);
        assert!(out.contains("H100.0V0.00"), "{out}");
    }

    #[test]
    fn what_is_not_finite_is_not_drawn() {
        let frame = Frame { x: [0.0, 1.0], y: range([f64::NAN, f64::INFINITY]) };
        let mut out = String::new();
        frame.line(&mut out, &[Some([0.0; 3]), Some([0.5, f64::NAN, 1.0]), Some([1.0; 3])], "a", false);
        frame.dots(&mut out, [(0.0, f64::NAN), (0.5, 0.5)], "a");
        let mut rows = Rows::new([0.0, 1.0]);
        let bar = Bar { value: f64::NAN, interval: Some([0.0, f64::INFINITY]), from: None, class: "a" };
        rows.row("none", Some(bar), "-");
        rows.row("half", Some(Bar { value: 0.5, ..bar }), "0.5");
        out += &rows.finish("x");
        assert!(!out.contains("NaN") && !out.contains("inf"), "{out}");
        assert_eq!(out.matches("class=\"dot a\"").count(), 1);
    }
}
