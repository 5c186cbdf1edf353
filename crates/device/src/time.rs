use std::fmt;

use crate::DeviceError;

/// An instant, in whole nanoseconds since the recording's origin. Integer, so that a simulated run repeats exactly.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Time {
    nanos: u64,
}

impl Time {
    /// The origin.
    pub const ZERO: Self = Self { nanos: 0 };

    /// From nanoseconds since the origin.
    pub const fn from_nanos(nanos: u64) -> Self {
        Self { nanos }
    }

    /// From seconds since the origin, rounded to the nanosecond; negative and non-finite values give the origin.
    pub fn from_seconds(seconds: f64) -> Self {
        // `as` saturates and sends NaN to zero, which is the documented behaviour here.
        Self { nanos: (seconds * 1e9).round() as u64 }
    }

    /// Nanoseconds since the origin.
    pub const fn nanos(self) -> u64 {
        self.nanos
    }

    /// Seconds since the origin.
    pub fn seconds(self) -> f64 {
        self.nanos as f64 / 1e9
    }

    /// Seconds from `earlier` to `self`; negative when `earlier` is the later one.
    pub fn since_s(self, earlier: Self) -> f64 {
        if self >= earlier {
            (self.nanos - earlier.nanos) as f64 / 1e9
        } else {
            -((earlier.nanos - self.nanos) as f64 / 1e9)
        }
    }

    /// This instant moved by `seconds` (either sign), not before the origin.
    #[must_use]
    pub fn shifted(self, seconds: f64) -> Self {
        let moved = i128::from(self.nanos) + (seconds * 1e9).round() as i128;
        Self { nanos: u64::try_from(moved.max(0)).unwrap_or(u64::MAX) }
    }
}

impl fmt::Display for Time {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.3} s", self.seconds())
    }
}

/// The one place where the loop's time is read.
pub trait Clock {
    /// The present instant.
    fn now(&self) -> Time;

    /// Blocks until `deadline` (a simulated clock advances the world instead) and returns the instant at which the
    /// caller goes on: never before `deadline`, later when the machine or a simulated overrun held it up.
    fn wait_until(&mut self, deadline: Time) -> Result<Time, DeviceError>;
}

#[cfg(test)]
mod tests {
    use super::Time;

    #[test]
    fn shifting_is_exact_to_the_nanosecond_and_stops_at_the_origin() {
        let t = Time::from_seconds(0.3);
        assert_eq!(t.nanos(), 300_000_000);
        assert_eq!(t.shifted(-0.1).nanos(), 200_000_000);
        assert_eq!(t.shifted(-1.0), Time::ZERO);
        assert_eq!(Time::from_seconds(f64::NAN), Time::ZERO);
        assert_eq!(t.since_s(Time::from_seconds(0.5)), -0.2);
    }
}
