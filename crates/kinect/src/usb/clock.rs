//! When an image arrived, without what the host added: from the device's time stamps and the times at which images were complete.

use bench_device::Time;

use crate::frame::TickClock;

/// Length of a bin of which the least delayed image counts, s.
const BIN_S: f64 = 1.0;
/// As many bins are remembered.
const BINS: usize = 32;
/// From as many on, the clocks' drift is told apart from jitter; until then it adds 1.6 ms at most.
const ENOUGH: usize = 16;
/// Crystals are within 100 ppm of one another; twice that is allowed.
const MOST_DRIFT: f64 = 200e-6;
/// What is off by more is no jitter: the device was reset, or stood still for longer than its time stamps tell, s.
const JUMP_S: f64 = 1.0;

/// Tells the host's time of an image from its time stamp.
///
/// An image is never earlier than the device, the bus and the host's least delay let it be, and often later. Per second of device time the
/// least delayed one is kept; the line under those, with a slope for the drift between the clocks, is where an image without further delay
/// arrives. The time told is never later than the real one.
#[derive(Clone, Debug)]
pub struct HostClock {
    ticks: TickClock,
    bins: [Bin; BINS],
    /// How many bins there are, and the one being filled.
    filled: usize,
    current: usize,
    drift: f64,
    /// The line's height where device time is zero, s.
    offset_s: f64,
}

/// The least delayed image of a stretch.
#[derive(Clone, Copy, Debug, Default)]
struct Bin {
    number: i64,
    device_s: f64,
    /// Host time less device time.
    late_s: f64,
}

impl Default for HostClock {
    fn default() -> Self {
        Self {
            ticks: TickClock::default(),
            bins: [Bin::default(); BINS],
            filled: 0,
            current: 0,
            drift: 0.0,
            offset_s: 0.0,
        }
    }
}

impl HostClock {
    /// Takes note of an image that was complete at a time; returns when it would have been without what delayed it.
    pub fn arrived(&mut self, ticks: u32, at: Time) -> Time {
        let device_s = self.ticks.seconds(ticks);
        let late_s = at.seconds() - device_s;
        if self.filled > 0 && (late_s - self.line_s(device_s)).abs() > JUMP_S {
            *self = Self::default();
            return self.arrived(ticks, at);
        }
        let number = (device_s / BIN_S).floor() as i64;
        let bin = Bin { number, device_s, late_s };
        if self.filled == 0 {
            (self.filled, self.bins[0]) = (1, bin);
            self.fit();
        } else if number > self.bins[self.current].number {
            self.current = (self.current + 1) % BINS;
            self.filled = (self.filled + 1).min(BINS);
            self.bins[self.current] = bin;
            self.fit();
        } else if late_s < self.bins[self.current].late_s {
            self.bins[self.current] = bin;
            self.fit();
        }
        at.min(Time::from_seconds(device_s + self.line_s(device_s)))
    }

    /// How much faster the host's clock runs than the device's, parts in one; zero until there is enough to tell.
    pub fn drift(&self) -> f64 {
        self.drift
    }

    fn line_s(&self, device_s: f64) -> f64 {
        self.offset_s + self.drift * device_s
    }

    fn fit(&mut self) {
        let bins = &self.bins[..self.filled];
        let n = bins.len() as f64;
        let mean = |value: fn(&Bin) -> f64| bins.iter().map(value).sum::<f64>() / n;
        let (mean_device, mean_late) = (mean(|bin| bin.device_s), mean(|bin| bin.late_s));
        let (mut covariance, mut variance) = (0.0, 0.0);
        for bin in bins {
            covariance += (bin.device_s - mean_device) * (bin.late_s - mean_late);
            variance += (bin.device_s - mean_device).powi(2);
        }
        self.drift = if self.filled < ENOUGH || variance <= 0.0 {
            0.0
        } else {
            (covariance / variance).clamp(-MOST_DRIFT, MOST_DRIFT)
        };
        let drift = self.drift;
        self.offset_s =
            bins.iter().map(|bin| bin.late_s - drift * bin.device_s).fold(f64::INFINITY, f64::min);
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::frame::TICKS_PER_S;

    /// Frames at 30 Hz from `from`, the host's clock fast by `drift`; each `delay(i)` later than it could be. Errors of the time told, s.
    fn errors(
        clock: &mut HostClock,
        frames: std::ops::Range<u64>,
        drift: f64,
        mut delay: impl FnMut(u64) -> f64,
    ) -> Vec<f64> {
        frames
            .map(|i| {
                let device_s = i as f64 / 30.0;
                let ticks =
                    (u64::from(u32::MAX) - 1_000_000 + (device_s * TICKS_PER_S).round() as u64) as u32;
                let least_s = 5.0 + device_s * (1.0 + drift);
                let at = Time::from_seconds(least_s + delay(i));
                let told = clock.arrived(ticks, at);
                assert!(told <= at);
                told.seconds() - least_s
            })
            .collect()
    }

    #[test]
    fn jitter_is_taken_off_across_wraps_and_drift_is_found() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut clock = HostClock::default();
        // Three minutes: the device's clock wraps three times. Delays are exponential, 2 ms in the mean.
        let told = errors(&mut clock, 0..5400, 80e-6, |_| -0.002 * (1.0 - rng.random::<f64>()).ln());
        // The least of 30 such delays is 0.07 ms in the mean; the line lies under 32 of them. A second's drift adds 0.08 ms.
        let worst = told[600..].iter().fold(0.0_f64, |worst, error| worst.max(error.abs()));
        assert!(worst < 3e-4, "{worst}");
        assert!((clock.drift() - 80e-6).abs() < 10e-6, "{}", clock.drift());
    }

    #[test]
    fn a_stall_is_jitter_and_a_longer_one_a_new_beginning() {
        let mut clock = HostClock::default();
        let stalled = errors(&mut clock, 0..300, 0.0, |i| if (100..110).contains(&i) { 0.3 } else { 0.0 });
        assert!(stalled.iter().all(|error| error.abs() < 1e-6));
        // The device is reset: its clock begins anew.
        let at = Time::from_seconds(100.0);
        assert_eq!(clock.arrived(7, at), at);
        let later = Time::from_seconds(100.5);
        assert!((clock.arrived(7 + 6_000_000, later).seconds() - 100.1).abs() < 1e-6);
    }
}
