//! Decimated series of bounded size, for alignment and lags.

/// Most bins of a series.
const BINS: usize = 2048;
/// Width of a bin at first, ns; doubled whenever the bins are full.
const FINEST_NS: i64 = 1_000_000;

#[derive(Clone, Copy, Debug, Default)]
struct Bin {
    count: u32,
    /// Sum of times since the bin's start, ns.
    time: f64,
}

/// What samples do to bins.
#[derive(Clone, Copy, Debug)]
enum Step {
    /// Every two bins become one.
    Coarsen,
    /// So many samples more fall into a bin.
    Add { bin: usize, samples: usize },
}

/// Counts samples in at most [`BINS`] bins of equal width, whatever their number: once for all series that have their samples at
/// the same times.
#[derive(Clone, Debug)]
pub(super) struct Bins {
    start_ns: i64,
    width_ns: i64,
    all: Vec<Bin>,
    /// The bin of the sample before, and where it begins after the start, ns: most samples fall into it as well.
    current: (usize, u64),
    /// Since [`Bins::settle`].
    steps: Vec<Step>,
}

impl Bins {
    pub fn new() -> Self {
        Self { start_ns: 0, width_ns: FINEST_NS, all: Vec::new(), current: (0, 0), steps: Vec::new() }
    }

    /// Counts a sample; whether it belongs to the series: those before the first one do not.
    pub fn push(&mut self, t_ns: i64) -> bool {
        if self.all.is_empty() {
            self.start_ns = t_ns;
        }
        let Ok(since) = u64::try_from(t_ns.saturating_sub(self.start_ns)) else { return false };
        if since < self.current.1 || since - self.current.1 >= self.width_ns as u64 || self.all.is_empty() {
            self.seek(since);
        }
        let (index, from) = self.current;
        let bin = &mut self.all[index];
        bin.count += 1;
        bin.time += (since - from) as f64;
        match self.steps.last_mut() {
            Some(Step::Add { bin, samples }) if *bin == index => *samples += 1,
            _ => self.steps.push(Step::Add { bin: index, samples: 1 }),
        }
        true
    }

    /// Every series has what was pushed.
    pub fn settle(&mut self) {
        self.steps.clear();
    }

    /// Makes room for an instant and finds its bin.
    fn seek(&mut self, since: u64) {
        while since / self.width_ns as u64 >= BINS as u64 {
            self.coarsen();
        }
        let index = (since / self.width_ns as u64) as usize;
        if self.all.len() <= index {
            self.all.resize(index + 1, Bin::default());
        }
        self.current = (index, index as u64 * self.width_ns as u64);
    }

    fn coarsen(&mut self) {
        let width = self.width_ns as f64;
        join_pairs(&mut self.all, |bin, later| Bin {
            count: bin.count + later.count,
            time: bin.time + later.time + width * f64::from(later.count),
        });
        self.width_ns *= 2;
        self.steps.push(Step::Coarsen);
    }

    /// Width of a bin, s.
    fn width_s(&self) -> f64 {
        self.width_ns as f64 * 1e-9
    }

    /// Mean time [s] and mean value of the bins that hold samples, in order of time.
    fn points(&self, sums: &Sums) -> Vec<[f64; 2]> {
        let point = |((index, bin), sum): ((usize, &Bin), &f64)| {
            let count = f64::from(bin.count);
            let start_ns = self.start_ns as f64 + index as f64 * self.width_ns as f64;
            (bin.count > 0).then(|| [(start_ns + bin.time / count) * 1e-9, sum / count])
        };
        self.all.iter().enumerate().zip(&sums.0).filter_map(point).collect()
    }
}

/// Makes one of every two; the last one may be alone.
fn join_pairs<T: Copy + Default>(items: &mut Vec<T>, join: impl Fn(T, T) -> T) {
    let joined = items.len().div_ceil(2);
    for i in 0..joined {
        items[i] = join(items[2 * i], items.get(2 * i + 1).copied().unwrap_or_default());
    }
    items.truncate(joined);
}

/// The sums of a series' values in [`Bins`].
#[derive(Clone, Debug, Default)]
pub(super) struct Sums(Vec<f64>);

impl Sums {
    /// Adds the values of the samples that were pushed since the bins were settled.
    pub fn add(&mut self, bins: &Bins, mut values: &[f64]) {
        for step in &bins.steps {
            match *step {
                Step::Coarsen => join_pairs(&mut self.0, |sum, later| sum + later),
                Step::Add { bin, samples } => {
                    if self.0.len() <= bin {
                        self.0.resize(bin + 1, 0.0);
                    }
                    let (these, rest) = values.split_at(samples);
                    self.0[bin] = these.iter().fold(self.0[bin], |sum, value| sum + value);
                    values = rest;
                }
            }
        }
    }
}

/// Mean time and value in bins.
#[derive(Clone, Debug)]
pub(super) struct Series {
    bins: Bins,
    sums: Sums,
}

impl Series {
    pub fn new() -> Self {
        Self { bins: Bins::new(), sums: Sums::default() }
    }

    /// Adds a sample; samples before the first one are left out.
    pub fn push(&mut self, t_ns: i64, value: f64) {
        if self.bins.push(t_ns) {
            self.sums.add(&self.bins, &[value]);
            self.bins.settle();
        }
    }

    /// Width of a bin, s.
    pub fn width_s(&self) -> f64 {
        self.bins.width_s()
    }

    /// Mean time [s] and mean value of the bins that hold samples, in order of time.
    pub fn points(&self) -> Vec<[f64; 2]> {
        self.bins.points(&self.sums)
    }
}

/// The value at a time on the line between the points around it; that of the first or last one outside of them.
pub(super) fn interpolate(points: &[[f64; 2]], t_s: f64) -> f64 {
    let after = points.partition_point(|point| point[0] <= t_s);
    match (after.checked_sub(1).map(|before| points[before]), points.get(after)) {
        (Some([t0, v0]), Some([t1, v1])) => v0 + (v1 - v0) * (t_s - t0) / (t1 - t0),
        (Some([_, v]), None) | (None, Some(&[_, v])) => v,
        (None, None) => 0.0,
    }
}

/// `count` values at equal steps.
pub(super) fn resample(points: &[[f64; 2]], from_s: f64, step_s: f64, count: usize) -> Vec<f64> {
    (0..count).map(|i| interpolate(points, from_s + step_s * i as f64)).collect()
}

/// The lag between two series that best explains their difference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Shift {
    /// How much later the second one is, s.
    pub lag_s: f64,
    /// Share of the mean squared difference that goes away when the lag is taken out.
    pub explained: f64,
    /// The step at which the lag was searched, s.
    pub step_s: f64,
}

/// Longest lag looked for, s.
const LAG_MAX_S: f64 = 2.0;
/// Fewest values of which a lag means anything.
const LAG_POINTS_MIN: usize = 32;

/// Shifts `b` against `a` over up to 2 s and a fifth of what they share, and takes the shift with the least mean squared
/// difference: the peak of their cross-correlation, with the power of both parts accounted for. `None` where there is
/// too little to go by, the difference is none, or the best shift lies at the end of the search.
pub(super) fn best_shift(bins: &[Bins; 2], sums: [&Sums; 2]) -> Option<Shift> {
    let step_s = bins[0].width_s().max(bins[1].width_s());
    let [a, b] = [0, 1].map(|side| bins[side].points(sums[side]));
    let from_s = a.first()?[0].max(b.first()?[0]);
    let until_s = a.last()?[0].min(b.last()?[0]);
    let count = ((until_s - from_s) / step_s) as usize;
    if count < LAG_POINTS_MIN || a.len().min(b.len()) < LAG_POINTS_MIN {
        return None;
    }
    let (a, b) = (resample(&a, from_s, step_s, count), resample(&b, from_s, step_s, count));
    let reach = (count / 5).min((LAG_MAX_S / step_s) as usize);
    let middle = &a[reach..count - reach];
    let costs: Vec<f64> = (0..=2 * reach)
        .map(|shift| middle.iter().zip(&b[shift..]).map(|(a, b)| (b - a).powi(2)).sum::<f64>())
        .collect();
    let (best, &least) = costs.iter().enumerate().min_by(|(_, a), (_, b)| a.total_cmp(b))?;
    let unshifted = costs[reach];
    if unshifted <= 0.0 || best == 0 || best == 2 * reach {
        return None;
    }
    let lag_s = (best as f64 - reach as f64 + vertex([costs[best - 1], least, costs[best + 1]])) * step_s;
    Some(Shift { lag_s, explained: 1.0 - least / unshifted, step_s })
}

/// Where the parabola through three values at -1, 0 and 1 is lowest, given that the middle one is the least.
fn vertex([left, middle, right]: [f64; 3]) -> f64 {
    let bend = left - 2.0 * middle + right;
    if bend > 0.0 { 0.5 * (left - right) / bend } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shift(a: &Series, b: &Series) -> Option<Shift> {
        best_shift(&[a.bins.clone(), b.bins.clone()], [&a.sums, &b.sums])
    }

    fn series(until_s: f64, step_s: f64, f: impl Fn(f64) -> f64) -> Series {
        let mut series = Series::new();
        for i in 0..(until_s / step_s) as i64 {
            let t_s = i as f64 * step_s;
            series.push((t_s * 1e9) as i64, f(t_s));
        }
        series
    }

    #[test]
    fn size_is_bounded_and_means_stay_true() {
        let series = series(1000.0, 0.001, |t| 2.0 * t);
        assert!(series.bins.all.len() <= BINS);
        for [t, v] in series.points() {
            assert!((v - 2.0 * t).abs() < 1e-6, "{t} {v}");
        }
    }

    #[test]
    fn a_lag_is_found_to_a_fraction_of_a_sample() {
        let wave = |t: f64| (0.9 * t).sin() + 0.4 * (2.3 * t).cos();
        let shift = shift(&series(30.0, 0.1, wave), &series(30.0, 0.1, |t| wave(t - 0.234))).expect("a lag");
        // Linear interpolation between samples 0.1 s apart; a tenth of a sample is generous.
        assert!((shift.lag_s - 0.234).abs() < 0.01, "{shift:?}");
        assert!(shift.explained > 0.98, "{shift:?}");
    }

    #[test]
    fn constants_have_no_lag() {
        assert_eq!(shift(&series(30.0, 0.1, |_| 1.0), &series(30.0, 0.1, |_| 1.0)), None);
        assert!(shift(&Series::new(), &Series::new()).is_none());
    }
}
