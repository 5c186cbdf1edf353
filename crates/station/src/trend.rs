//! A figure over weeks.

use bench_statistics::Sorted;
use statrs::distribution::{ContinuousCDF as _, StudentsT};

use crate::{Filter, Log, StationError};

const DAY_S: f64 = 86_400.0;
const WEEK_S: f64 = 7.0 * DAY_S;

/// A figure over the weeks of a log.
#[derive(Clone, Debug, PartialEq)]
pub struct Trend {
    /// Each week with runs, the earliest first.
    pub weeks: Vec<Week>,
    /// How it drifts; `None` with fewer than three runs or all within a day.
    pub drift: Option<Drift>,
}

/// The runs of a week.
#[derive(Clone, Debug, PartialEq)]
pub struct Week {
    /// Year and week of ISO 8601, in UTC: `2026-W48`.
    pub week: String,
    /// How many runs.
    pub runs: usize,
    /// Least value.
    pub min: f64,
    /// Median.
    pub median: f64,
    /// Greatest value.
    pub max: f64,
}

/// The straight line through all runs, by least squares.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drift {
    /// Change a week.
    pub per_week: f64,
    /// Interval that holds it with 95 %, from Student's distribution.
    pub interval: [f64; 2],
}

impl Drift {
    /// Whether the interval leaves out zero.
    pub fn is_sure(&self) -> bool {
        self.interval[0] > 0.0 || self.interval[1] < 0.0
    }

    /// Through points of time in seconds and value, in order of time. What changes within a day is told by no slope a week.
    fn of(points: &[(f64, f64)]) -> Option<Self> {
        let n = points.len() as f64;
        let span_s = points.last()?.0 - points.first()?.0;
        if points.len() < 3 || span_s < DAY_S {
            return None;
        }
        let time = points.iter().map(|(time, _)| time / WEEK_S).sum::<f64>() / n;
        let value = points.iter().map(|(_, value)| value).sum::<f64>() / n;
        let (mut spread, mut joint) = (0.0, 0.0);
        for (t, x) in points {
            spread += (t / WEEK_S - time).powi(2);
            joint += (t / WEEK_S - time) * (x - value);
        }
        let per_week = joint / spread;
        let left: f64 =
            points.iter().map(|(t, x)| (x - value - per_week * (t / WEEK_S - time)).powi(2)).sum();
        let sigma = (left / (n - 2.0) / spread).sqrt();
        let quantile = StudentsT::new(0.0, 1.0, n - 2.0).ok()?.inverse_cdf(0.975);
        Some(Self { per_week, interval: [per_week - quantile * sigma, per_week + quantile * sigma] })
    }
}

impl Log {
    /// A figure of the runs that are wanted, week by week.
    pub fn trend(&self, figure: &str, filter: &Filter) -> Result<Trend, StationError> {
        let series = self.series(figure, filter)?;
        let mut weeks = Vec::new();
        for group in series.chunk_by(|a, b| a.0 == b.0) {
            let values = Sorted::of(group.iter().map(|(_, _, value)| *value));
            let (Some(min), Some(median), Some(max)) =
                (values.nearest_rank(0.0), values.interpolated(0.5), values.nearest_rank(1.0))
            else {
                continue;
            };
            weeks.push(Week { week: group[0].0.clone(), runs: group.len(), min, median, max });
        }
        let points: Vec<_> = series.iter().map(|(_, time, value)| (*time, *value)).collect();
        Ok(Trend { weeks, drift: Drift::of(&points) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_found_with_an_interval_that_noise_widens() {
        let line: Vec<_> = (0..10).map(|i| (f64::from(i) * WEEK_S, 2.0 + 0.5 * f64::from(i))).collect();
        let drift = Drift::of(&line).unwrap();
        assert!((drift.per_week - 0.5).abs() < 1e-12 && drift.is_sure(), "{drift:?}");
        // Residuals of +1 and -1 by turns: Student's quantile for eight degrees of freedom is 2.306.
        let noisy: Vec<_> =
            line.iter().enumerate().map(|(i, (t, _))| (*t, if i % 2 == 0 { 1.0 } else { -1.0 })).collect();
        let drift = Drift::of(&noisy).unwrap();
        let half = (drift.interval[1] - drift.interval[0]) / 2.0;
        let spread: f64 = (0..10).map(|i| (f64::from(i) - 4.5_f64).powi(2)).sum();
        let left: f64 = 10.0 - drift.per_week.powi(2) * spread;
        assert!((half - 2.306 * (left / 8.0 / spread).sqrt()).abs() < 1e-4, "{drift:?}");
        assert!(!drift.is_sure());
        assert!(Drift::of(&line[..2]).is_none() && Drift::of(&[]).is_none());
        assert!(Drift::of(&[(0.0, 1.0), (10.0, 2.0), (DAY_S - 1.0, 3.0)]).is_none(), "all of one day");
    }
}
