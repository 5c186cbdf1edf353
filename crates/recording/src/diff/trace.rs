//! Series for drawing: least and greatest values of equal stretches of time.

use super::{merge::Axis, report::Trace};

/// How many samples a stretch holds, and when.
#[derive(Clone, Copy, Debug, Default)]
struct Stretch {
    count: u32,
    /// Sum of the samples' times since the axis began, s.
    time_s: f64,
}

/// Finds the stretch of an instant: once for all fields of a record.
#[derive(Clone, Copy)]
pub(super) struct Stretches {
    from_ns: i64,
    /// Stretches a nanosecond.
    per_ns: f64,
    last: u32,
}

impl Stretches {
    pub fn of(axis: Axis) -> Self {
        let length_ns = (axis.until_ns.saturating_sub(axis.from_ns) as f64).max(1.0);
        let last = axis.stretches.saturating_sub(1) as u32;
        Self { from_ns: axis.from_ns, per_ns: axis.stretches as f64 / length_ns, last }
    }

    /// The stretch that an instant lies in; the first or last one for those outside.
    pub fn find(&self, t_ns: i64) -> u32 {
        let since_ns = t_ns.saturating_sub(self.from_ns) as f64;
        ((since_ns * self.per_ns) as u32).min(self.last)
    }
}

/// The lines of a trace: A, B and their difference.
const LINES: usize = 3;
pub(super) const DIFFERENCE: usize = 2;

/// Samples in a row that lie in one stretch: which, and how many.
#[derive(Default)]
pub(super) struct Runs(Vec<(u32, usize)>);

impl Runs {
    pub fn push(&mut self, stretch: u32) {
        match self.0.last_mut() {
            Some((last, samples)) if *last == stretch => *samples += 1,
            _ => self.0.push((stretch, 1)),
        }
    }

    pub fn clear(&mut self) {
        self.0.clear();
    }
}

/// Least and greatest of values, which are numbers, and of those before. Four at a time, as each waits for the one before it.
pub(super) fn extremes_of([least, greatest]: [f64; 2], values: &[f64]) -> [f64; 2] {
    let less = |a: f64, b: f64| if b < a { b } else { a };
    let more = |a: f64, b: f64| if b > a { b } else { a };
    let (fours, rest) = values.as_chunks::<4>();
    let (mut lows, mut highs) = ([least; 4], [greatest; 4]);
    for four in fours {
        for i in 0..4 {
            lows[i] = less(lows[i], four[i]);
            highs[i] = more(highs[i], four[i]);
        }
    }
    let all = |ends: [f64; 4], which: fn(f64, f64) -> f64| rest.iter().copied().chain(ends).reduce(which);
    [all(lows, less).unwrap_or(least), all(highs, more).unwrap_or(greatest)]
}

/// When there are samples to draw: the same for all fields that have theirs at the same instants.
pub(super) struct TraceTimes {
    axis: Axis,
    gap_s: f64,
    lines: [Vec<Stretch>; LINES],
}

impl TraceTimes {
    /// Lines are broken where samples are further apart than `gap_ns`.
    pub fn new(axis: Axis, gap_ns: i64) -> Self {
        let lines = std::array::from_fn(|_| vec![Stretch::default(); axis.stretches]);
        Self { axis, gap_s: gap_ns as f64 * 1e-9, lines }
    }

    /// Counts a sample of A (0) or B (1), or a difference ([`DIFFERENCE`]), that lies in a stretch.
    pub fn add(&mut self, line: usize, stretch: u32, t_ns: i64) {
        if let Some(stretch) = self.lines[line].get_mut(stretch as usize) {
            stretch.count += 1;
            stretch.time_s += t_ns.saturating_sub(self.axis.from_ns) as f64 * 1e-9;
        }
    }
}

/// Collects one field's trace, whose samples [`TraceTimes`] counts.
pub(super) struct TraceBuilder {
    /// Least and greatest value by stretch.
    lines: [Vec<[f64; 2]>; LINES],
}

impl TraceBuilder {
    pub fn new(axis: Axis) -> Self {
        Self { lines: std::array::from_fn(|_| vec![[f64::INFINITY, f64::NEG_INFINITY]; axis.stretches]) }
    }

    /// Adds the samples of A (0) or B (1), or differences ([`DIFFERENCE`]), that lie in one stretch after another.
    pub fn add(&mut self, line: usize, runs: &Runs, mut values: &[f64]) {
        for &(stretch, samples) in &runs.0 {
            let (these, rest) = values.split_at(samples);
            values = rest;
            if let Some(extremes) = self.lines[line].get_mut(stretch as usize) {
                *extremes = extremes_of(*extremes, these);
            }
        }
    }

    /// The trace; of equal series only the first is kept.
    pub fn finish(&self, times: &TraceTimes, same: bool) -> Trace {
        let axis = times.axis;
        let (from_s, until_s) = (axis.from_ns as f64 * 1e-9, axis.until_ns as f64 * 1e-9);
        let stretch_s = (until_s - from_s) / axis.stretches.max(1) as f64;
        let break_s = times.gap_s + 2.0 * stretch_s;
        let line = |line: usize| points(&times.lines[line], &self.lines[line], from_s, break_s);
        let (b, difference) = if same { (Vec::new(), Vec::new()) } else { (line(1), line(DIFFERENCE)) };
        Trace { from_s: rounded(from_s), until_s: rounded(until_s), a: line(0), b, difference }
    }
}

fn points(times: &[Stretch], values: &[[f64; 2]], from_s: f64, break_s: f64) -> Vec<Option<[f64; 3]>> {
    let mut points: Vec<Option<[f64; 3]>> = Vec::new();
    for (stretch, [least, greatest]) in times.iter().zip(values).filter(|(stretch, _)| stretch.count > 0) {
        let t_s = from_s + stretch.time_s / f64::from(stretch.count);
        if let Some(Some([before_s, ..])) = points.last()
            && t_s - before_s > break_s
        {
            points.push(None);
        }
        points.push(Some([t_s, *least, *greatest].map(rounded)));
    }
    points
}

/// To six significant digits: more is not seen.
fn rounded(x: f64) -> f64 {
    if x == 0.0 {
        return 0.0;
    }
    let scale = 10_f64.powi(5 - x.abs().log10().floor() as i32);
    let rounded = (x * scale).round() / scale;
    // Scales of the least and greatest numbers are not finite.
    if rounded.is_finite() { rounded } else { x }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_trace_keeps_extremes_and_breaks_at_gaps() {
        let axis = Axis { from_ns: 0, until_ns: 10_000_000_000, stretches: 100 };
        let stretches = Stretches::of(axis);
        let (mut times, mut trace) = (TraceTimes::new(axis, 200_000_000), TraceBuilder::new(axis));
        let (mut runs, mut values) = (Runs::default(), Vec::new());
        for i in (0..1000).filter(|i| !(400..600).contains(i)) {
            let stretch = stretches.find(i * 10_000_000);
            times.add(0, stretch, i * 10_000_000);
            runs.push(stretch);
            values.push(if i == 333 { 7.0 } else { 0.0 });
        }
        trace.add(0, &runs, &values);
        let trace = trace.finish(&times, true);
        let greatest = trace.a.iter().flatten().fold(0.0, |most: f64, [_, _, greatest]| most.max(*greatest));
        assert_eq!(greatest, 7.0);
        assert_eq!(trace.a.iter().filter(|point| point.is_none()).count(), 1);
        assert!(trace.b.is_empty());
    }

    #[test]
    fn rounding_keeps_six_digits_of_any_size() {
        assert_eq!(rounded(1.234_567_89e-7), 1.234_57e-7);
        assert_eq!(rounded(-123_456_789.0), -123_457_000.0);
        assert!(rounded(1e-310).is_finite());
        assert_eq!(rounded(0.0), 0.0);
    }
}
