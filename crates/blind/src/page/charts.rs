//! The page's charts as inline SVG. Colours are the style sheet's, so that they follow light and dark.

use std::fmt::Write as _;

use bench_page::escaped;

use crate::score::{Rate, Score};

const WIDTH: f64 = 460.0;
const HEIGHT: f64 = 280.0;
const LEFT: f64 = 44.0;
const BOTTOM: f64 = 34.0;
const TOP: f64 = 12.0;
const RIGHT: f64 = 20.0;

/// A chart whose axes both go from 0 to 1; what x means is up to its labels.
struct Frame {
    svg: String,
}

impl Frame {
    fn new(title: &str, x_name: &str, y_name: &str) -> Self {
        let mut svg =
            format!("<svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{}\">", escaped(title));
        for tick in 0..=4 {
            let share = f64::from(tick) / 4.0;
            let y = Self::y(share);
            let _ = write!(
                svg,
                "<line class=\"grid\" x1=\"{LEFT}\" x2=\"{:.1}\" y1=\"{y:.1}\" y2=\"{y:.1}\"/>\
                 <text class=\"tick\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{:.0} %</text>",
                WIDTH - RIGHT,
                LEFT - 6.0,
                y + 3.5,
                100.0 * share
            );
        }
        let _ = write!(
            svg,
            "<text class=\"axis\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>\
             <text class=\"axis\" x=\"{:.1}\" y=\"{:.1}\">{}</text>",
            0.5 * (LEFT + WIDTH - RIGHT),
            HEIGHT - 4.0,
            escaped(x_name),
            LEFT + 4.0,
            TOP + 9.0,
            escaped(y_name)
        );
        Self { svg }
    }

    fn x(share: f64) -> f64 {
        LEFT + share * (WIDTH - LEFT - RIGHT)
    }

    fn y(share: f64) -> f64 {
        HEIGHT - BOTTOM - share * (HEIGHT - BOTTOM - TOP)
    }

    fn x_label(&mut self, share: f64, text: &str) {
        let _ = write!(
            self.svg,
            "<text class=\"tick\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
            Self::x(share),
            HEIGHT - BOTTOM + 13.0,
            escaped(text)
        );
    }

    /// A point with its interval; the tip tells counts.
    fn point(&mut self, share: f64, rate: &Rate, class: &str) {
        let Some(value) = rate.value else { return };
        let x = Self::x(share);
        let _ = write!(
            self.svg,
            "<g class=\"{class}\"><title>{} of {}</title>\
             <line class=\"whisker\" x1=\"{x:.1}\" x2=\"{x:.1}\" y1=\"{:.1}\" y2=\"{:.1}\"/>\
             <circle cx=\"{x:.1}\" cy=\"{:.1}\" r=\"4.2\"/></g>",
            rate.count,
            rate.of,
            Self::y(rate.low),
            Self::y(rate.high),
            Self::y(value)
        );
    }

    fn line(&mut self, points: impl IntoIterator<Item = (f64, f64)>, class: &str) {
        let path: Vec<String> =
            points.into_iter().map(|(x, y)| format!("{:.1},{:.1}", Self::x(x), Self::y(y))).collect();
        let _ = write!(self.svg, "<polyline class=\"line {class}\" points=\"{}\"/>", path.join(" "));
    }

    fn finish(self) -> String {
        self.svg + "</svg>"
    }
}

/// Seen and named against detectability.
pub(super) fn detection(score: &Score) -> String {
    let bins = &score.detection;
    let mut frame = Frame::new("Detection against detectability", "detectability d' (0: invisible)", "");
    let place = |i: usize| (i as f64 + 0.5) / bins.len().max(1) as f64;
    for (i, bin) in bins.iter().enumerate() {
        let label = match bin.to {
            Some(to) => format!("{} to {to}", bin.from),
            None => format!("{} on", bin.from),
        };
        frame.x_label(place(i), &label);
    }
    for (class, shift, of) in [("seen", -0.012, 0), ("named", 0.012, 1)] {
        let rates = || bins.iter().map(|bin| if of == 0 { bin.seen } else { bin.named });
        let values = rates().enumerate();
        frame.line(values.map(|(i, rate)| (place(i) + shift, rate.value.unwrap_or(0.0))), class);
        for (i, rate) in rates().enumerate() {
            frame.point(place(i) + shift, &rate, class);
        }
    }
    frame.finish()
        + "<p class=\"keys\"><span class=\"seen\">seen: anything but none was said</span> \
                      <span class=\"named\">named rightly</span></p>"
}

/// Right answers against the probability told.
pub(super) fn reliability(score: &Score) -> String {
    let mut frame = Frame::new("Reliability", "probability told", "");
    for tick in 0..=4 {
        let share = f64::from(tick) / 4.0;
        frame.x_label(share, &format!("{:.0} %", 100.0 * share));
    }
    frame.line([(0.0, 0.0), (1.0, 1.0)], "ideal");
    for bin in &score.reliability {
        frame.point(bin.confidence.clamp(0.0, 1.0), &bin.right, "named");
    }
    frame.finish()
        + "<p class=\"keys\"><span class=\"named\">right, with its interval</span> \
                      <span class=\"ideal\">as told</span></p>"
}

/// Side of a cell of the confusion table, and room for names.
const CELL: f64 = 24.0;
const NAMES: f64 = 158.0;

/// Truth by answer; rows that nothing was true of are left out.
pub(super) fn confusion(score: &Score) -> String {
    let table = &score.confusion;
    let rows: Vec<usize> =
        (0..table.labels.len()).filter(|row| table.counts[*row].iter().any(|count| *count > 0)).collect();
    let width = NAMES + CELL * table.labels.len() as f64 + 2.0;
    let height = NAMES + CELL * rows.len() as f64 + 2.0;
    let mut svg = format!(
        "<div class=\"scroll\"><svg class=\"confusion\" style=\"min-width:{:.0}px\" \
         viewBox=\"0 0 {width:.0} {height:.0}\" role=\"img\" aria-label=\"Confusion table\">",
        0.8 * width
    );
    for (column, label) in table.labels.iter().enumerate() {
        let _ = write!(
            svg,
            "<text class=\"tick\" transform=\"translate({:.1} {:.1}) rotate(-90)\">{}</text>",
            NAMES + CELL * (column as f64 + 0.5) + 4.0,
            NAMES - 7.0,
            escaped(label)
        );
    }
    for (line, row) in rows.into_iter().enumerate() {
        let y = NAMES + CELL * line as f64;
        let _ = write!(
            svg,
            "<text class=\"tick\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
            NAMES - 7.0,
            y + 0.5 * CELL + 4.0,
            escaped(&table.labels[row])
        );
        let total: usize = table.counts[row].iter().sum();
        for (column, count) in table.counts[row].iter().enumerate() {
            let class = if row == column { "hit" } else { "miss" };
            let tip = format!("{}: {count} of {total} answered {}", table.labels[row], table.labels[column]);
            cell(&mut svg, [NAMES + CELL * column as f64, y], [*count, total], class, &tip);
        }
    }
    svg + "</svg></div>"
}

fn cell(svg: &mut String, [x, y]: [f64; 2], [count, total]: [usize; 2], class: &str, tip: &str) {
    let square = format!(
        "x=\"{:.1}\" y=\"{:.1}\" width=\"{side:.1}\" height=\"{side:.1}\" rx=\"3\"",
        x + 1.0,
        y + 1.0,
        side = CELL - 2.0
    );
    let _ = write!(svg, "<rect class=\"cell\" {square}/>");
    if count > 0 {
        let _ = write!(
            svg,
            "<g><title>{}</title><rect class=\"{class}\" style=\"fill-opacity:{:.2}\" {square}/>\
             <text class=\"count\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{count}</text></g>",
            escaped(tip),
            0.2 + 0.7 * count as f64 / total as f64,
            x + 0.5 * CELL,
            y + 0.5 * CELL + 4.0
        );
    }
}
