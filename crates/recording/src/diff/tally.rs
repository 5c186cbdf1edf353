//! What the samples of one field add up to.

use super::{report::Tolerance, trace::extremes_of};

/// Sums over the samples compared. Differences are B less A.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Tally {
    /// Samples with a difference; those of events without a counterpart have none.
    pub count: u64,
    pub sum: f64,
    pub squares: f64,
    pub largest: f64,
    pub largest_ns: i64,
    /// What remains after the time tolerance: largest, and sum of squares.
    pub largest_off: f64,
    off_squares: f64,
    pub beyond: u64,
    pub first_ns: Option<i64>,
    /// Values at the first sample beyond, A's and B's.
    pub first: [Option<f64>; 2],
    pub first_over_rms_ns: Option<i64>,
    /// Largest difference (after the time tolerance) over its tolerance; infinite where the tolerance is 0.
    pub worst: f64,
}

impl Tally {
    pub fn rms(&self) -> f64 {
        (self.squares / self.count.max(1) as f64).sqrt()
    }

    /// Root of the mean square of what remains after the time tolerance.
    pub fn rms_off(&self) -> f64 {
        (self.off_squares / self.count.max(1) as f64).sqrt()
    }

    pub fn mean(&self) -> f64 {
        self.sum / self.count.max(1) as f64
    }

    pub fn add(&mut self, t_ns: i64, b_less_a: f64, off: f64, rms_limit: Option<f64>) {
        let size = b_less_a.abs();
        self.count += 1;
        self.sum += b_less_a;
        self.squares += size * size;
        self.off_squares += off * off;
        self.largest_off = self.largest_off.max(off);
        if size > self.largest {
            (self.largest, self.largest_ns) = (size, t_ns);
        }
        if rms_limit.is_some_and(|limit| off > limit) {
            self.over_rms(t_ns);
        }
    }

    /// Adds samples of A (0) or B (1) that are numbers and are compared at their own instants, with what the other recording has
    /// more than these `values`; makes of that the differences B less A. In each loop a sample does not wait for the one before it,
    /// but in the sums, whose order is kept.
    pub fn add_all(
        &mut self,
        side: usize,
        values: &[f64],
        more: &mut [f64],
        time: impl Fn(usize) -> i64,
        tolerance: &Tolerance,
    ) {
        let allowed = |value: f64, more: f64| {
            let (here, there) = (value.abs(), (value + more).abs());
            let relative = tolerance.relative * if there > here { there } else { here };
            if relative > tolerance.absolute { relative } else { tolerance.absolute }
        };
        let samples = || values.iter().copied().zip(more.iter().copied());
        // Most samples are so clearly not the worst one that the division is not worth it.
        let worst = 0.999 * self.worst;
        let (mut beyond, mut worse) = (0_u64, false);
        for (value, more) in samples() {
            let (allowed, off) = (allowed(value, more), more.abs());
            beyond += u64::from(off > allowed);
            let is_clearly_less = off < worst * allowed;
            worse |= off > 0.0 && !is_clearly_less;
        }
        if worse {
            let ratios = samples().filter(|(_, more)| *more != 0.0);
            let ratios = ratios.map(|(value, more)| more.abs() / allowed(value, more));
            self.worst = ratios.fold(self.worst, f64::max);
        }
        self.beyond += beyond;
        if beyond > 0 && self.first_ns.is_none_or(|first| time(0) < first) {
            let first = samples().position(|(value, more)| more.abs() > allowed(value, more));
            if let Some(first) = first.filter(|first| self.first_ns.is_none_or(|ns| time(*first) < ns)) {
                self.set_first(time(first), side, values[first], Some(values[first] + more[first]));
            }
        }
        if side == 1 {
            for difference in more.iter_mut() {
                *difference = -*difference;
            }
        }
        let sum = |of: fn(f64) -> f64, from: f64| more.iter().fold(from, |sum, x| sum + of(*x));
        self.count += more.len() as u64;
        self.sum = sum(|x| x, self.sum);
        self.squares = sum(|x| x * x, self.squares);
        self.off_squares = self.squares;
        let first_over = |limit: f64| more.iter().position(|x| x.abs() > limit);
        let [least, greatest] = extremes_of([0.0, 0.0], more);
        let largest = greatest.max(-least);
        if largest > self.largest {
            let place = more.iter().position(|x| x.abs() == largest).unwrap_or_default();
            (self.largest, self.largest_ns) = (largest, time(place));
            self.largest_off = largest;
        }
        if let Some(place) = tolerance.rms.filter(|limit| largest > *limit).and_then(first_over) {
            self.over_rms(time(place));
        }
    }

    pub fn beyond(&mut self, t_ns: i64, side: usize, value: f64, there: Option<f64>) {
        self.beyond += 1;
        if self.first_ns.is_none_or(|first| t_ns < first) {
            self.set_first(t_ns, side, value, there);
        }
    }

    fn set_first(&mut self, t_ns: i64, side: usize, value: f64, there: Option<f64>) {
        self.first_ns = Some(t_ns);
        self.first = if side == 0 { [Some(value), there] } else { [there, Some(value)] };
    }

    /// Samples of A and B are compared in turns, each in order.
    fn over_rms(&mut self, t_ns: i64) {
        self.first_over_rms_ns = Some(self.first_over_rms_ns.map_or(t_ns, |first| first.min(t_ns)));
    }
}
