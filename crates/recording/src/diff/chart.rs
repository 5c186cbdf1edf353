//! Traces as SVG. The drawing is stretched to the page; all words stand beside it as HTML, so that they keep their size
//! on a phone.

use std::fmt::Write as _;

use super::{FieldReport, Interpolation, PhaseSpan, Trace, text::digits};

/// Width of the drawing's own coordinates; its height is [`HEIGHT`].
const WIDTH: f64 = 1000.0;
const HEIGHT: f64 = 100.0;

/// Phases shorter than this share of the time line have no room for their names.
const NAMED_SHARE_MIN: f64 = 0.08;

type Point = Option<[f64; 3]>;

/// From data to the drawing's coordinates.
struct Frame {
    t: [f64; 2],
    y: [f64; 2],
}

impl Frame {
    fn x(&self, t: f64) -> f64 {
        share(t, self.t) * WIDTH
    }

    fn y(&self, value: f64) -> f64 {
        (1.0 - share(value, self.y)) * HEIGHT
    }
}

/// How far along a range, 0 to 1 within it.
fn share(x: f64, [from, to]: [f64; 2]) -> f64 {
    if to > from { (x - from) / (to - from) } else { 0.5 }
}

/// The charts of a field: both series, and their difference where there is one.
pub(super) fn charts(field: &FieldReport, phases: &[PhaseSpan]) -> String {
    let Some(trace) = &field.trace else { return String::new() };
    let t = [trace.from_s, trace.until_s];
    let mut out = String::from("<figure class=\"chart\">");
    let values = Frame { t, y: range([&trace.a, &trace.b], &[]) };
    let steps = field.interpolation == Interpolation::Hold;
    open(&mut out, "plot", &values, phases);
    mark(&mut out, &values, field);
    line(&mut out, &values, &trace.a, "a", steps);
    line(&mut out, &values, &trace.b, "b", steps);
    close(&mut out, &values, if field.unit.is_empty() { "" } else { &field.unit });
    if !trace.difference.is_empty() {
        difference(&mut out, field, trace, phases);
    }
    x_axis(&mut out, t);
    out.push_str("</figure>");
    out
}

fn difference(out: &mut String, field: &FieldReport, trace: &Trace, phases: &[PhaseSpan]) {
    // A tolerance that is a share of the value is no band.
    let band = field.tolerance.filter(|limit| limit.relative == 0.0 && limit.absolute > 0.0);
    let limits = band.map_or([0.0; 2], |limit| [-limit.absolute, limit.absolute]);
    let largest = field.difference.as_ref().and_then(|difference| difference.largest).unwrap_or(0.0);
    // A band far wider than the difference would flatten it.
    let shown = if limits[1] <= 5.0 * largest { limits } else { [0.0; 2] };
    let frame = Frame { t: [trace.from_s, trace.until_s], y: range([&trace.difference, &[]], &shown) };
    open(out, "plot low", &frame, phases);
    if band.is_some() {
        let (top, bottom) = (frame.y(limits[1]).max(0.0), frame.y(limits[0]).min(HEIGHT));
        let _ = write!(
            out,
            "<rect class=\"band\" x=\"0\" y=\"{top:.2}\" width=\"{WIDTH}\" height=\"{:.2}\"/>",
            bottom - top
        );
    }
    let zero = frame.y(0.0);
    let _ = write!(out, "<path class=\"zero\" d=\"M0 {zero:.2}H{WIDTH}\"/>");
    mark(out, &frame, field);
    line(out, &frame, &trace.difference, "d", false);
    close(out, &frame, "B \u{2212} A");
}

/// Least and greatest of the points and the values that must be seen, with some room.
fn range(lines: [&[Point]; 2], seen: &[f64]) -> [f64; 2] {
    let values = lines.into_iter().flatten().flatten().flat_map(|[_, low, high]| [*low, *high]);
    let [low, high] = values
        .chain(seen.iter().copied())
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| [low.min(value), high.max(value)]);
    if low > high {
        return [0.0, 1.0];
    }
    let room = if high > low { 0.06 * (high - low) } else { (0.1 * high.abs()).max(1e-9) };
    [low - room, high + room]
}

fn open(out: &mut String, class: &str, frame: &Frame, phases: &[PhaseSpan]) {
    let _ = write!(
        out,
        "<div class=\"{class}\"><svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" preserveAspectRatio=\"none\" aria-hidden=\"true\">"
    );
    for phase in phases.iter().skip(1).step_by(2) {
        let (from, until) = (frame.x(phase.from_s).max(0.0), frame.x(phase.until_s).min(WIDTH));
        if until > from {
            let _ = write!(
                out,
                "<rect class=\"shade\" x=\"{from:.1}\" y=\"0\" width=\"{:.1}\" height=\"{HEIGHT}\"/>",
                until - from
            );
        }
    }
    for tick in ticks(frame.y, 3.0) {
        let _ = write!(out, "<path class=\"grid\" d=\"M0 {:.2}H{WIDTH}\"/>", frame.y(tick));
    }
}

fn close(out: &mut String, frame: &Frame, name: &str) {
    out.push_str("</svg>");
    for tick in ticks(frame.y, 3.0) {
        let _ = write!(out, "<span class=\"y\" style=\"top:{:.1}%\">{}</span>", frame.y(tick), digits(tick));
    }
    let _ = write!(out, "<span class=\"name\">{name}</span></div>");
}

/// Where the tolerance is first passed.
fn mark(out: &mut String, frame: &Frame, field: &FieldReport) {
    if let Some(first_s) = field.difference.as_ref().and_then(|difference| difference.first_s) {
        let _ = write!(out, "<path class=\"mark\" d=\"M{:.1} 0V{HEIGHT}\"/>", frame.x(first_s));
    }
}

/// One path a stretch without gaps: along the greatest values, and back along the least where they differ.
fn line(out: &mut String, frame: &Frame, points: &[Point], class: &str, steps: bool) {
    for run in points.split(Option::is_none) {
        let run: Vec<[f64; 3]> = run.iter().flatten().copied().collect();
        let thin = run.iter().all(|[_, low, high]| low == high);
        let Some((first, rest)) = run.split_first() else { continue };
        let steps = steps && thin;
        let mut d = format!("M{:.1} {:.2}", frame.x(first[0]), frame.y(first[2]));
        for [t, _, high] in rest {
            let _ = if steps {
                write!(d, "H{:.1}V{:.2}", frame.x(*t), frame.y(*high))
            } else {
                write!(d, "L{:.1} {:.2}", frame.x(*t), frame.y(*high))
            };
        }
        if !thin {
            for [t, low, _] in run.iter().rev() {
                let _ = write!(d, "L{:.1} {:.2}", frame.x(*t), frame.y(*low));
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

/// The time axis: numbers below the last plot.
pub(super) fn x_axis(out: &mut String, t: [f64; 2]) {
    out.push_str("<div class=\"xaxis\">");
    for tick in ticks(t, 6.0) {
        let place = 100.0 * share(tick, t);
        // The unit stands at the right end.
        if place < 94.0 {
            let _ = write!(out, "<span style=\"left:{place:.1}%\">{}</span>", digits(tick));
        }
    }
    out.push_str("<span class=\"unit\">s</span></div>");
}

/// A recording's phases as a row of a time line, moved by `shift_s`.
pub(super) fn phase_row(out: &mut String, name: &str, phases: &[PhaseSpan], shift_s: f64, t: [f64; 2]) {
    let _ = write!(out, "<div class=\"row {}\"><span class=\"y\">{name}</span>", name.to_lowercase());
    for phase in phases {
        let from = share(phase.from_s + shift_s, t).clamp(0.0, 1.0);
        let until = share(phase.until_s + shift_s, t).clamp(0.0, 1.0);
        if until > from {
            // A name that would be cut shows when pointed at.
            let shown = if until - from < NAMED_SHARE_MIN { "" } else { &phase.phase };
            let _ = write!(
                out,
                "<i style=\"left:{:.2}%;width:{:.2}%\" title=\"{} {:.2} s to {:.2} s\">{shown}</i>",
                100.0 * from,
                100.0 * (until - from),
                phase.phase,
                phase.from_s,
                phase.until_s,
            );
        }
    }
    out.push_str("</div>");
}

/// Round numbers within a range, about `wanted` of them.
fn ticks([from, to]: [f64; 2], wanted: f64) -> Vec<f64> {
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
        Vec::new()
    } else {
        (first..=last).map(|i| i as f64 * step).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        assert_eq!(ticks([0.0, 0.61], 3.0), [0.0, 0.5]);
        assert_eq!(ticks([-1.2, 1.2], 3.0), [-1.0, 0.0, 1.0]);
        assert!(ticks([1.0, 1.0], 3.0).is_empty());
        assert!(ticks([f64::MIN, f64::MAX], 3.0).len() <= 21);
    }

    #[test]
    fn a_line_breaks_at_gaps_and_draws_steps() {
        let frame = Frame { t: [0.0, 10.0], y: [0.0, 1.0] };
        let points = [Some([0.0, 0.0, 0.0]), Some([1.0, 1.0, 1.0]), None, Some([5.0, 0.5, 0.5])];
        let mut out = String::new();
        line(&mut out, &frame, &points, "a", true);
        assert_eq!(out.matches("<path").count(), 2);
        assert!(out.contains("H100.0V0.00"), "{out}");
    }
}
