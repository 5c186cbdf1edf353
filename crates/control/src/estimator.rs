//! Position and velocity now, from positions of some time ago.

use bench_device::{PositionSample, Time, TrackStatus};

/// What the laws need to know, predicted over the delay.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Estimate {
    /// m
    pub position_m: [f64; 3],
    /// m/s
    pub velocity_m_s: [f64; 3],
    /// rad; as last seen, zero while the tracker has given none.
    pub heading_rad: f64,
    /// By what the airframe's acceleration is off its model, m/s^2; `None` where nobody looks for it.
    pub disturbance_m_s2: Option<[f64; 3]>,
}

/// Linear extrapolation of position by velocity and of velocity by acceleration (paper, section 3.6). Velocity is the
/// least-squares slope of the positions in a window, acceleration the difference of two neighbouring windows' slopes.
#[derive(Debug)]
pub(crate) struct Estimator {
    extrapolation_s: f64,
    window_s: f64,
    /// Newest last; never more than [`CAPACITY`].
    samples: Vec<(Time, [f64; 3])>,
    heading_rad: f64,
}

/// Two windows of 1 s, the longest, at 100 Hz; faster trackers get shorter windows.
const CAPACITY: usize = 200;
/// Samples closer than this are not two frames of any tracker but two that waited for one another; a slope between them would
/// be noise over nothing.
const MIN_SPACING_S: f64 = 0.001;

impl Estimator {
    pub(crate) fn new(extrapolation_s: f64, window_s: f64) -> Self {
        Self { extrapolation_s, window_s, samples: Vec::with_capacity(CAPACITY), heading_rad: 0.0 }
    }

    /// Takes a sample; those that are not valid, or not newer than the last by a millisecond, are passed
    /// over.
    pub(crate) fn observe(&mut self, sample: &PositionSample) {
        let usable = sample.status != TrackStatus::Lost
            && sample.position_m.iter().all(|x| x.is_finite())
            && self.samples.last().is_none_or(|(last, _)| sample.exposed_at.since_s(*last) >= MIN_SPACING_S);
        if !usable {
            return;
        }
        if self.samples.len() == CAPACITY {
            self.samples.remove(0);
        }
        self.samples.push((sample.exposed_at, sample.position_m));
        if let Some(heading_rad) = sample.heading_rad.filter(|heading| heading.is_finite()) {
            self.heading_rad = heading_rad;
        }
    }

    /// The last valid altitude as measured, m.
    pub(crate) fn measured_altitude_m(&self) -> Option<f64> {
        self.samples.last().map(|(_, position)| position[2])
    }

    /// `None` before the first sample.
    pub(crate) fn estimate(&self) -> Option<Estimate> {
        let (newest, position) = *self.samples.last()?;
        // Half a millisecond of slack: time stamps are rounded, windows are not.
        let recent = self.between(newest, -0.0005, self.window_s + 0.0005);
        let before = self.between(newest, self.window_s - 0.0005, 2.0 * self.window_s + 0.0005);
        let mut estimate = Estimate {
            position_m: position,
            velocity_m_s: [0.0; 3],
            heading_rad: self.heading_rad,
            disturbance_m_s2: None,
        };
        for axis in 0..3 {
            let Some(velocity) = slope(recent, axis) else { continue };
            let acceleration = slope(before, axis).map_or(0.0, |earlier| {
                (velocity - earlier) / (mean_age_s(before, newest) - mean_age_s(recent, newest))
            });
            estimate.velocity_m_s[axis] = velocity + acceleration * self.extrapolation_s;
            estimate.position_m[axis] += velocity * self.extrapolation_s;
        }
        Some(estimate)
    }

    /// The samples from `youngest_s` to `oldest_s` before `newest`.
    fn between(&self, newest: Time, youngest_s: f64, oldest_s: f64) -> &[(Time, [f64; 3])] {
        let first = self.samples.partition_point(|(time, _)| newest.since_s(*time) > oldest_s);
        let last = self.samples.partition_point(|(time, _)| newest.since_s(*time) >= youngest_s);
        &self.samples[first..last.max(first)]
    }
}

fn mean_age_s(samples: &[(Time, [f64; 3])], newest: Time) -> f64 {
    samples.iter().map(|(time, _)| newest.since_s(*time)).sum::<f64>() / samples.len() as f64
}

/// Least-squares slope over time; `None` with fewer than two samples.
fn slope(samples: &[(Time, [f64; 3])], axis: usize) -> Option<f64> {
    let (first, _) = samples.first().filter(|_| samples.len() >= 2)?;
    let count = samples.len() as f64;
    let (mut sum_t, mut sum_x, mut sum_tt, mut sum_tx) = (0.0, 0.0, 0.0, 0.0);
    for (time, position) in samples {
        let (t, x) = (time.since_s(*first), position[axis]);
        sum_t += t;
        sum_x += x;
        sum_tt += t * t;
        sum_tx += t * x;
    }
    Some((count * sum_tx - sum_t * sum_x) / (count * sum_tt - sum_t * sum_t))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_frames_told_for_one_instant_give_no_velocity() {
        // Both waited and arrived together; their rows' times differ by microseconds.
        let mut estimator = Estimator::new(0.4, 0.2);
        estimator.observe(&sample(1.0, 0.400));
        estimator.observe(&sample(1.000_01, 0.402));
        assert_eq!(estimator.estimate().unwrap().velocity_m_s, [0.0; 3]);
    }

    fn sample(t_s: f64, z_m: f64) -> PositionSample {
        PositionSample {
            exposed_at: Time::from_seconds(t_s),
            arrived_at: Time::from_seconds(t_s + 0.3),
            position_m: [0.0, 0.0, z_m],
            status: TrackStatus::Found,
            ..Default::default()
        }
    }

    #[test]
    fn steady_speed_is_extrapolated_exactly() {
        let mut estimator = Estimator::new(0.4, 0.2);
        for k in 0..30 {
            let t = f64::from(k) / 30.0;
            estimator.observe(&sample(t, 0.1 + 0.5 * t));
        }
        let estimate = estimator.estimate().unwrap();
        assert!((estimate.position_m[2] - (0.1 + 0.5 * (29.0 / 30.0 + 0.4))).abs() < 1e-6);
        assert!((estimate.velocity_m_s[2] - 0.5).abs() < 1e-6);
    }

    #[test]
    fn steady_acceleration_gives_speed_but_for_half_a_window() {
        // The slope over a window is the speed at its middle; the extrapolation does not know (it is a gain of the rig).
        let (a, extrapolation, window) = (0.8, 0.4, 0.2);
        let mut estimator = Estimator::new(extrapolation, window);
        for k in 0..=30 {
            let t = f64::from(k) / 30.0;
            estimator.observe(&sample(t, 0.5 * a * t * t));
        }
        let expected = a * (1.0 - window / 2.0) + a * extrapolation;
        assert!((estimator.estimate().unwrap().velocity_m_s[2] - expected).abs() < 1e-6);
    }

    #[test]
    fn lost_stale_and_non_finite_samples_are_passed_over() {
        let mut estimator = Estimator::new(0.4, 0.2);
        assert_eq!(estimator.estimate(), None);
        estimator.observe(&sample(1.0, 0.3));
        let before = estimator.estimate();
        estimator.observe(&PositionSample { status: TrackStatus::Lost, ..sample(1.1, 9.0) });
        estimator.observe(&sample(1.0, 9.0));
        estimator.observe(&sample(1.2, f64::NAN));
        assert_eq!(estimator.estimate(), before);
    }
}
