//! The traces of a field, one below the other on one time line.

use std::fmt::Write as _;

use bench_page::{Frame, HEIGHT, Point, WIDTH, range, share, ticks, x_axis};

use super::{FieldReport, Interpolation, PhaseSpan, Trace};

/// Phases shorter than this share of the time line have no room for their names.
const NAMED_SHARE_MIN: f64 = 0.08;

/// The charts of a field: both series, and their difference where there is one.
pub(super) fn charts(field: &FieldReport, phases: &[PhaseSpan]) -> String {
    let Some(trace) = &field.trace else { return String::new() };
    let t = [trace.from_s, trace.until_s];
    let mut out = String::from("<figure class=\"chart\">");
    let values = Frame { x: t, y: extent([&trace.a, &trace.b], &[]) };
    let steps = field.interpolation == Interpolation::Hold;
    open(&mut out, "plot", &values, phases);
    mark(&mut out, &values, field);
    values.line(&mut out, &within(&trace.a, values.y), "a", steps);
    values.line(&mut out, &within(&trace.b, values.y), "b", steps);
    values.close(&mut out, if field.unit.is_empty() { "" } else { &field.unit });
    if !trace.difference.is_empty() {
        difference(&mut out, field, trace, phases);
    }
    time_axis(&mut out, t);
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
    let frame = Frame { x: [trace.from_s, trace.until_s], y: extent([&trace.difference, &[]], &shown) };
    open(out, "plot low", &frame, phases);
    if band.is_some() {
        let (top, bottom) = (frame.y(limits[1]).max(0.0), frame.y(limits[0]).min(HEIGHT));
        let _ = write!(
            out,
            "<rect class=\"band\" x=\"0\" y=\"{top:.2}\" width=\"{WIDTH}\" height=\"{:.2}\"/>",
            bottom - top
        );
    }
    frame.level(out, 0.0, "zero");
    mark(out, &frame, field);
    frame.line(out, &within(&trace.difference, frame.y), "d", false);
    frame.close(out, "B \u{2212} A");
}

/// This share of the stretches may lie outside of what is shown at either end, where they are spikes.
const SPIKES_SHARE: f64 = 0.015;
/// What is more than so many times as far apart as the rest is a spike.
const SPIKE_TIMES: f64 = 3.0;

/// The range of the points and of the values that must be seen. A spike, such as that of touching down, does not rule it.
fn extent(lines: [&[Point]; 2], seen: &[f64]) -> [f64; 2] {
    let points = || lines.into_iter().flatten().flatten();
    let usual = {
        let mut lows: Vec<f64> = points().map(|[_, low, _]| *low).collect();
        let mut highs: Vec<f64> = points().map(|[_, _, high]| *high).collect();
        lows.sort_by(f64::total_cmp);
        highs.sort_by(f64::total_cmp);
        let spikes = (lows.len() as f64 * SPIKES_SHARE).ceil() as usize;
        let low = lows.get(spikes).copied();
        low.zip(highs.len().checked_sub(spikes + 1).and_then(|place| highs.get(place).copied()))
    };
    let values = points().flat_map(|[_, low, high]| [*low, *high]);
    if let Some((low, high)) = usual.filter(|(low, high)| high > low) {
        let (least, most) = values.clone().fold((low, high), |(l, h), x| (l.min(x), h.max(x)));
        if most - least > SPIKE_TIMES * (high - low) {
            return range([low, high].into_iter().chain(seen.iter().copied()));
        }
    }
    range(values.chain(seen.iter().copied()))
}

/// The points, those outside of a range at its edge.
fn within(line: &[Point], [low, high]: [f64; 2]) -> Vec<Point> {
    let cut = |[t, least, greatest]: [f64; 3]| [t, least.clamp(low, high), greatest.clamp(low, high)];
    line.iter().map(|point| point.map(cut)).collect()
}

fn open(out: &mut String, class: &str, frame: &Frame, phases: &[PhaseSpan]) {
    frame.open(out, class);
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
    frame.grid(out);
}

/// Where the tolerance is first passed.
fn mark(out: &mut String, frame: &Frame, field: &FieldReport) {
    if let Some(first_s) = field.difference.as_ref().and_then(|difference| difference.first_s) {
        let _ = write!(out, "<path class=\"mark\" d=\"M{:.1} 0V{HEIGHT}\"/>", frame.x(first_s));
    }
}

/// The time axis below the last plot.
pub(super) fn time_axis(out: &mut String, t: [f64; 2]) {
    x_axis(out, t, &ticks(t, 6.0), "time, s");
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spike_does_not_rule_the_picture_but_a_step_does() {
        let line = |value: fn(usize) -> f64| -> Vec<Point> {
            (0..240).map(|i| Some([i as f64, value(i), value(i)])).collect()
        };
        let spiked = line(|i| if i == 200 { 50.0 } else { (i as f64 * 0.1).sin() });
        let [low, high] = extent([&spiked, &[]], &[]);
        assert!(high < 2.0 && low > -2.0, "{low} to {high}");
        assert!(within(&spiked, [low, high]).iter().flatten().all(|[_, _, most]| *most <= high));
        let stepped = line(|i| if i > 220 { 50.0 } else { (i as f64 * 0.1).sin() });
        assert!(extent([&stepped, &[]], &[])[1] >= 50.0);
    }
}
