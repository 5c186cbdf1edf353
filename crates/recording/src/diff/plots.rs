//! The traces of a field: what differs first, and below it what it differs about, on one time line.

use bench_page::{Mark, Panel, Plot, Series, Span, Tone, capitalised, share, ticks};
use maud::{Markup, html};

use super::{FieldReport, Interpolation, PhaseSpan, Trace};

/// Plots of one comparison zoom and read off together.
const GROUP: &str = "diff";
/// Phases shorter than this share of the time line have no room for their names.
const NAMED_SHARE_MIN: f64 = 0.08;
/// Colours of A, of B, and of what they differ by.
pub(super) const A: usize = 0;
pub(super) const B: usize = 1;
const DIFFERENCE: usize = 3;
/// A tolerance wider than so many times the largest difference would flatten it, and is not shown whole.
const BAND_TIMES: f64 = 5.0;

/// The traces of a field with A's phases: their difference with its tolerance, and the values of A, and of B where wanted; of
/// equal ones, the values alone.
pub(super) fn traces(field: &FieldReport, phases: &[PhaseSpan], with_b: bool) -> Plot {
    let plot = Plot::new(capitalised(&field.path()), "time, s").group(GROUP);
    let Some(trace) = &field.trace else { return plot };
    let plot = plot.x([trace.from_s, trace.until_s]).spans(phases.iter().map(span));
    let plot = match field.difference.as_ref().and_then(|difference| difference.first_s) {
        Some(first_s) => plot.mark(first_s, "first beyond"),
        None => plot,
    };
    let mark = if field.interpolation == Interpolation::Hold { Mark::Steps } else { Mark::Line };
    let of = |name: &str, mark: Mark, colour, line: &[Option<[f64; 3]>]| {
        Series::new(name, mark, colour, points(line, trace))
    };
    let mut values = Panel::new(titled("value", &field.unit)).with(of("A", mark, A, &trace.a));
    if with_b {
        values = values.with(of("B", mark, B, &trace.b));
    }
    let values = values.y_without_spikes(&[]);
    if trace.difference.is_empty() {
        return plot.panel(values);
    }
    // A tolerance that is a share of the value is no band.
    let band = field.tolerance.filter(|limit| limit.relative == 0.0 && limit.absolute > 0.0);
    let largest = field.difference.as_ref().and_then(|difference| difference.largest).unwrap_or(0.0);
    let mut difference = Panel::new(titled("B \u{2212} A", &field.unit))
        .with(of("", Mark::Line, DIFFERENCE, &trace.difference))
        .level(0.0, "");
    let mut seen = vec![0.0];
    if let Some(limit) = band {
        let ends = [-limit.absolute, limit.absolute];
        difference = difference.tolerance(ends);
        if limit.absolute <= BAND_TIMES * largest {
            seen.extend(ends);
        }
    }
    plot.panel(difference.y_without_spikes(&seen)).panel(values.low())
}

fn titled(what: &str, unit: &str) -> String {
    if unit.is_empty() || unit == "1" { what.to_owned() } else { format!("{what}, {unit}") }
}

fn span(phase: &PhaseSpan) -> Span {
    Span { from: phase.from_s, to: phase.until_s, name: phase.phase.clone() }
}

/// The least and the greatest of each stretch as points of a line, the nearer to the value before first.
fn points(line: &[Option<[f64; 3]>], trace: &Trace) -> Vec<(f64, f64)> {
    let quarter_s = 0.25 * (trace.until_s - trace.from_s) / line.len().max(1) as f64;
    let mut out = Vec::with_capacity(2 * line.len());
    let mut last = f64::NAN;
    let mut latest_s = f64::NEG_INFINITY;
    for (place, stretch) in line.iter().enumerate() {
        let Some([t_s, least, greatest]) = *stretch else {
            let at_s = trace.from_s + 4.0 * quarter_s * (place as f64 + 0.5);
            out.push((at_s.max(latest_s), f64::NAN));
            continue;
        };
        if least == greatest {
            out.push((t_s, least));
        } else {
            let falls = (greatest - last).abs() < (least - last).abs();
            let [first, second] = if falls { [greatest, least] } else { [least, greatest] };
            out.push(((t_s - quarter_s).max(latest_s), first));
            out.push((t_s + quarter_s, second));
        }
        (latest_s, last) = out.last().copied().unwrap_or((t_s, least));
    }
    out
}

/// The phases of both recordings, one lane each, on A's clock.
pub(super) fn timeline(lanes: [(&str, &[PhaseSpan], f64); 2], t: [f64; 2]) -> Markup {
    html! {
        div.timeline {
            @for (colour, (name, phases, shift_s)) in lanes.into_iter().enumerate() {
                div.lane.{ "c" (colour) } {
                    b { (name) }
                    @for phase in phases {
                        @let from = share(phase.from_s + shift_s, t).clamp(0.0, 1.0);
                        @let until = share(phase.until_s + shift_s, t).clamp(0.0, 1.0);
                        @if until > from {
                            i title={ (phase.phase) " " (format!("{:.2} s to {:.2} s", phase.from_s, phase.until_s)) }
                                style=(format!("left:{:.2}%;width:{:.2}%", 100.0 * from, 100.0 * (until - from))) {
                                // A name that would be cut shows when pointed at.
                                @if until - from >= NAMED_SHARE_MIN { (phase.phase) }
                            }
                        }
                    }
                }
            }
            span.xaxis {
                @for (at, text) in ticks(t, 6.0) {
                    span style={ "left:" (format!("{:.1}", 100.0 * share(at, t))) "%" } { (text) }
                }
                b { "time on the clock of A, s" }
            }
        }
    }
}

/// What a verdict means to who reads it.
pub(super) const fn tone(verdict: super::Verdict) -> Tone {
    match verdict {
        super::Verdict::Same | super::Verdict::WithinTolerance => Tone::Good,
        super::Verdict::Different | super::Verdict::Missing => Tone::Bad,
        super::Verdict::NotComparable => Tone::Odd,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stretches_become_points_in_order_with_their_gaps() {
        let trace = Trace { from_s: 0.0, until_s: 4.0, ..Trace::default() };
        let line = [Some([0.5, 1.0, 1.0]), Some([1.5, 2.0, 5.0]), None, Some([3.5, 0.0, 4.0])];
        let points = points(&line, &trace);
        let values: Vec<f64> = points.iter().map(|(_, value)| *value).collect();
        assert_eq!(values[..3], [1.0, 2.0, 5.0]);
        assert!(values[3].is_nan());
        assert_eq!(values[4..], [4.0, 0.0], "from 5 down, the greatest comes first");
        assert!(points.windows(2).all(|pair| pair[0].0 <= pair[1].0), "{points:?}");
    }
}
