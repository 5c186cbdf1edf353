use std::time::{Duration, Instant};

/// Two crystals may differ by this much (50 ppm each), s/s.
const DRIFT: f64 = 100e-6;

/// What the board's clock reads now, estimated from exchanges: the board stamped its answer between sending and receiving, so
/// that the shortest round trip says it best.
#[derive(Clone, Copy, Debug)]
pub struct BoardClock {
    /// When the host's clock was read for the best exchange so far: half-way between sending and receiving.
    middle: Instant,
    /// The board's stamp of that exchange, us.
    device_us: u64,
    half_trip: Duration,
}

impl BoardClock {
    pub fn new(sent: Instant, received: Instant, device_us: u64) -> Self {
        let half_trip = received.saturating_duration_since(sent) / 2;
        Self { middle: sent + half_trip, device_us, half_trip }
    }

    /// Takes an exchange into account: it replaces the best one when it says more, that one having aged.
    pub fn update(&mut self, sent: Instant, received: Instant, device_us: u64) {
        let new = Self::new(sent, received, device_us);
        if new.half_trip <= self.error_at(received) {
            *self = new;
        }
    }

    /// How far the estimate may be off.
    pub fn error_at(&self, now: Instant) -> Duration {
        self.half_trip + now.saturating_duration_since(self.middle).mul_f64(DRIFT)
    }

    /// What the board's clock reads at `now`, us.
    pub fn device_us(&self, now: Instant) -> u64 {
        self.device_us + now.saturating_duration_since(self.middle).as_micros() as u64
    }

    /// The deadline of voltages sent at `now` that may arrive `within`, us of the board's clock.
    pub fn deadline_us(&self, now: Instant, within: Duration) -> u64 {
        self.device_us(now) + (within + self.error_at(now)).as_micros() as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shortest_trip_counts_until_it_has_aged() {
        let start = Instant::now();
        let at = |ms: f64| start + Duration::from_secs_f64(ms / 1000.0);
        let mut clock = BoardClock::new(at(0.0), at(10.0), 1_000_000);
        assert_eq!(clock.device_us(at(5.0)), 1_000_000);
        // A shorter trip says more; the board is found to be 3 ms ahead of the first guess.
        clock.update(at(20.0), at(21.0), 1_018_500);
        assert_eq!(clock.device_us(at(20.5)), 1_018_500);
        // A longer one says less,
        clock.update(at(30.0), at(60.0), 1_040_000);
        assert_eq!(clock.device_us(at(20.5)), 1_018_500);
        // until drift has made the short one older than that: 14.5 ms at 100 ppm take 145 s.
        clock.update(at(200_000.0), at(200_030.0), 201_000_000);
        assert_eq!(clock.device_us(at(200_015.0)), 201_000_000);
        assert_eq!(clock.deadline_us(at(200_015.0), Duration::from_millis(100)), 201_115_000);
    }
}
