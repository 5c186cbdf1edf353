//! Offset and drift of one clock against another, from a signal that both have seen.

use super::series::{Series, interpolate, resample};

/// How the second clock goes against the first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ClockFit {
    /// Second clock less first one at `reference_s`, s.
    pub offset_s: f64,
    /// One sigma of the offset, s.
    pub offset_std_s: f64,
    /// How much faster the second clock runs; 0 where it cannot be told from 0.
    pub drift: f64,
    /// One sigma of the drift, whether or not it could be told from 0; `None` where it could not be fitted.
    pub drift_std: Option<f64>,
    /// The instant on the first clock that the offset belongs to, s.
    pub reference_s: f64,
    /// Correlation of the signals once aligned.
    pub correlation: f64,
}

/// Points of the coarse search over all offsets.
const COARSE_POINTS: f64 = 512.0;
/// Fewest points of either signal.
const POINTS_MIN: usize = 32;
/// Gauss-Newton converges in a few steps or not at all.
const STEPS_MAX: usize = 50;
/// A drift below so many sigmas is taken as none.
const DRIFT_SIGMAS: f64 = 3.0;

/// Fits `a(t) = level + gain b(t + offset + drift (t - reference))`, least squares. The start is the peak of the
/// cross-correlation over all offsets at which the signals share a third of the shorter one; Gauss-Newton with the
/// level and gain eliminated (variable projection, Kaufman's approximation) does the rest. The sigmas come from leaving
/// out a tenth of the time at a time (jackknife), so that neither correlated residuals nor a single step of the signal
/// pass for certainty. `None` where a signal is too short or does not move.
pub(super) fn fit_clock(a: &Series, b: &Series) -> Option<ClockFit> {
    let step_s = a.width_s().max(b.width_s());
    let (a, b) = (a.points(), b.points());
    if a.len().min(b.len()) < POINTS_MIN {
        return None;
    }
    let offset_s = coarse_offset(&a, &b)?;
    let reference_s = 0.5 * (a[0][0] + a[a.len() - 1][0]);
    let problem = Problem { a: &a, b: &b, reference_s, step_s };
    let steady = problem.solve([offset_s, 0.0], false)?;
    let drifting = problem.solve(steady.clock, true);
    let drift_std = drifting.as_ref().map(|solution| solution.std[1]);
    let chosen = drifting
        .filter(|solution| solution.clock[1].abs() > DRIFT_SIGMAS * solution.std[1])
        .unwrap_or(steady);
    Some(ClockFit {
        offset_s: chosen.clock[0],
        offset_std_s: chosen.std[0],
        drift: chosen.clock[1],
        drift_std,
        reference_s,
        correlation: chosen.correlation,
    })
}

/// The offset at which the signals correlate best, to within a step of the coarse grid.
fn coarse_offset(a: &[[f64; 2]], b: &[[f64; 2]]) -> Option<f64> {
    let span_s = |points: &[[f64; 2]]| points[points.len() - 1][0] - points[0][0];
    let step_s = span_s(a).max(span_s(b)) / COARSE_POINTS;
    if step_s <= 0.0 {
        return None;
    }
    let grid =
        |points: &[[f64; 2]]| resample(points, points[0][0], step_s, (span_s(points) / step_s) as usize + 1);
    let (x, y) = (grid(a), grid(b));
    let shared_min = (x.len().min(y.len()) / 3).max(8);
    let last = x.len() + y.len() - 2 * shared_min;
    let scored = (0..=last).filter_map(|shift| {
        // x[i + skip_x] belongs to y[i + skip_y].
        let unskipped = x.len() - shared_min;
        let (skip_x, skip_y) = (unskipped.saturating_sub(shift), shift.saturating_sub(unskipped));
        let shared = x.len().saturating_sub(skip_x).min(y.len().saturating_sub(skip_y));
        let r = correlation(&x[skip_x..skip_x + shared], &y[skip_y..skip_y + shared])?;
        // Short overlaps correlate by chance.
        Some((skip_y as f64 - skip_x as f64, r * (shared as f64 / x.len().min(y.len()) as f64).sqrt()))
    });
    let (shift, _) = scored.max_by(|(_, r), (_, s)| r.total_cmp(s))?;
    Some(b[0][0] - a[0][0] + shift * step_s)
}

/// Pearson's; `None` where one of the two does not move.
fn correlation(x: &[f64], y: &[f64]) -> Option<f64> {
    let n = x.len() as f64;
    let (mean_x, mean_y) = (x.iter().sum::<f64>() / n, y.iter().sum::<f64>() / n);
    let (mut xx, mut yy, mut xy) = (0.0, 0.0, 0.0);
    for (x, y) in x.iter().zip(y) {
        let (x, y) = (x - mean_x, y - mean_y);
        xx += x * x;
        yy += y * y;
        xy += x * y;
    }
    let scale = (xx * yy).sqrt();
    (scale > 1e-12 * n).then(|| xy / scale)
}

struct Problem<'a> {
    a: &'a [[f64; 2]],
    b: &'a [[f64; 2]],
    reference_s: f64,
    step_s: f64,
}

struct Solution {
    /// Offset [s] and drift.
    clock: [f64; 2],
    /// One sigma of each.
    std: [f64; 2],
    correlation: f64,
}

/// The residuals at a point and how they change.
struct Linearised {
    /// Mean square.
    cost: f64,
    /// Of all, and of each tenth of the time.
    all: Sums,
    tenths: [Sums; TENTHS],
    correlation: f64,
}

const TENTHS: usize = 10;

/// Sums for the normal equations.
#[derive(Clone, Copy, Default)]
struct Sums {
    gradient: [f64; 2],
    normal: [[f64; 2]; 2],
}

impl Sums {
    fn add(&mut self, slopes: [f64; 2], residual: f64) {
        for i in 0..2 {
            self.gradient[i] += slopes[i] * residual;
            for j in 0..2 {
                self.normal[i][j] += slopes[i] * slopes[j];
            }
        }
    }

    fn without(&self, part: &Self) -> Self {
        let mut rest = *self;
        for i in 0..2 {
            rest.gradient[i] -= part.gradient[i];
            for j in 0..2 {
                rest.normal[i][j] -= part.normal[i][j];
            }
        }
        rest
    }

    /// The step to where the gradient vanishes, of the offset alone unless the clock drifts.
    fn step(&self, drifts: bool) -> Option<[f64; 2]> {
        let [[p, q], [r, s]] = self.normal;
        let [g, h] = self.gradient;
        if !drifts {
            return (p > 0.0).then(|| [g / p, 0.0]);
        }
        let determinant = p * s - q * r;
        (determinant > 1e-12 * p * s).then(|| [(s * g - q * h) / determinant, (p * h - r * g) / determinant])
    }
}

impl Problem<'_> {
    fn solve(&self, start: [f64; 2], drifts: bool) -> Option<Solution> {
        let mut clock = start;
        let mut here = self.linearise(clock)?;
        for _ in 0..STEPS_MAX {
            let Some(step) = here.all.step(drifts) else { break };
            // Halve the step until it helps; the cost counts per point, since the overlap may change.
            let better = (0..12).find_map(|halvings| {
                let scale = 0.5_f64.powi(halvings);
                let next = [clock[0] + scale * step[0], clock[1] + scale * step[1]];
                let there = self.linearise(next)?;
                (there.cost < here.cost).then_some((next, there))
            });
            let Some((next, there)) = better else { break };
            let moved = (next[0] - clock[0]).abs();
            (clock, here) = (next, there);
            if moved < 1e-9 {
                break;
            }
        }
        Some(Solution { clock, std: jackknife(&here, drifts)?, correlation: here.correlation })
    }

    /// `None` when the signals no longer share enough or do not move.
    fn linearise(&self, [offset_s, drift]: [f64; 2]) -> Option<Linearised> {
        let (first, last) = (self.b[0][0], self.b[self.b.len() - 1][0]);
        let mut rows = Vec::with_capacity(self.a.len());
        for &[t, value] in self.a {
            let since = t - self.reference_s;
            let u = t + offset_s + drift * since;
            if u >= first + self.step_s && u <= last - self.step_s {
                let slope = (interpolate(self.b, u + self.step_s) - interpolate(self.b, u - self.step_s))
                    / (2.0 * self.step_s);
                rows.push([value, interpolate(self.b, u), slope, slope * since]);
            }
        }
        if rows.len() < POINTS_MIN {
            return None;
        }
        linear_algebra(rows)
    }
}

/// Takes level and gain out of values and slopes; each row holds a, b, and b's derivatives by offset and drift.
fn linear_algebra(mut rows: Vec<[f64; 4]>) -> Option<Linearised> {
    let n = rows.len() as f64;
    for column in 0..4 {
        let mean = rows.iter().map(|row| row[column]).sum::<f64>() / n;
        for row in &mut rows {
            row[column] -= mean;
        }
    }
    let product = |i: usize, j: usize| rows.iter().map(|row| row[i] * row[j]).sum::<f64>();
    let (aa, bb) = (product(0, 0), product(1, 1));
    if aa <= 1e-12 * n || bb <= 1e-12 * n {
        return None;
    }
    let gain = product(0, 1) / bb;
    let along_b = [product(1, 2) / bb, product(1, 3) / bb];
    let mut linearised = Linearised {
        cost: 0.0,
        all: Sums::default(),
        tenths: [Sums::default(); TENTHS],
        correlation: product(0, 1) / (aa * bb).sqrt(),
    };
    let count = rows.len();
    for (place, [a, b, by_offset, by_drift]) in rows.into_iter().enumerate() {
        let residual = a - gain * b;
        let slopes = [gain * (by_offset - along_b[0] * b), gain * (by_drift - along_b[1] * b)];
        linearised.cost += residual * residual / n;
        linearised.all.add(slopes, residual);
        linearised.tenths[place * TENTHS / count].add(slopes, residual);
    }
    Some(linearised)
}

/// One sigma of offset and drift: the spread of the solutions that leave out one tenth each, to first order.
fn jackknife(at: &Linearised, drifts: bool) -> Option<[f64; 2]> {
    let steps = at.tenths.iter().map(|tenth| at.all.without(tenth).step(drifts));
    let steps = steps.collect::<Option<Vec<_>>>()?;
    let n = TENTHS as f64;
    Some(std::array::from_fn(|i| {
        let mean = steps.iter().map(|step| step[i]).sum::<f64>() / n;
        ((n - 1.0) / n * steps.iter().map(|step| (step[i] - mean).powi(2)).sum::<f64>()).sqrt()
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn series(
        times: impl Iterator<Item = f64>,
        clock: impl Fn(f64) -> f64,
        f: impl Fn(f64) -> f64,
    ) -> Series {
        let mut series = Series::new();
        for t_s in times {
            series.push((clock(t_s) * 1e9) as i64, f(t_s));
        }
        series
    }

    fn flight(t: f64) -> f64 {
        if t < 3.0 { 0.0 } else { 0.4 + 0.2 * (0.7 * t).sin() + 0.1 * (1.9 * t).cos() }
    }

    #[test]
    fn offset_and_drift_of_the_same_samples_on_another_clock_are_recovered() {
        let times = || (0..3000).map(|i| f64::from(i) / 30.0);
        let a = series(times(), |t| t, flight);
        let b = series(times(), |t| 12.345 + t * (1.0 + 180e-6), |t| 1.2 * flight(t) - 0.1);
        let fit = fit_clock(&a, &b).expect("a fit");
        let offset_at_start = fit.offset_s - fit.drift * fit.reference_s;
        // Bins are 64 ms wide at 100 s; means within them move by less than a tenth of a sample (3 ms).
        assert!((offset_at_start - 12.345).abs() < 3e-3, "{fit:?}");
        assert!((fit.drift - 180e-6).abs() < 40e-6, "{fit:?}");
        assert!(fit.correlation > 0.99);
    }

    #[test]
    fn no_drift_is_claimed_where_there_is_none_and_nothing_from_flat_signals() {
        let a = series((0..900).map(|i| f64::from(i) / 30.0), |t| t, flight);
        let b = series((0..900).map(|i| f64::from(i) / 30.0 + 0.011), |t| t - 2.0, flight);
        let fit = fit_clock(&a, &b).expect("a fit");
        assert_eq!(fit.drift, 0.0, "{fit:?}");
        // The step at 3 s says no more than between which samples it was, 33 ms apart; the sigma knows.
        assert!((fit.offset_s + 2.0).abs() < 17e-3, "{fit:?}");
        assert!((fit.offset_s + 2.0).abs() < 3.0 * fit.offset_std_s, "{fit:?}");
        let flat = series((0..900).map(|i| f64::from(i) / 30.0), |t| t, |_| 1.0);
        assert_eq!(fit_clock(&flat, &flat), None);
    }
}
