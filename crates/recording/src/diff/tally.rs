//! What the samples of one field add up to.

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
}

impl Tally {
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
            // Samples of A and B are compared in turns, each in order.
            self.first_over_rms_ns = Some(self.first_over_rms_ns.map_or(t_ns, |first| first.min(t_ns)));
        }
    }

    pub fn beyond(&mut self, t_ns: i64, side: usize, value: f64, there: Option<f64>) {
        self.beyond += 1;
        if self.first_ns.is_none_or(|first| t_ns < first) {
            self.first_ns = Some(t_ns);
            self.first = if side == 0 { [Some(value), there] } else { [there, Some(value)] };
        }
    }
}
