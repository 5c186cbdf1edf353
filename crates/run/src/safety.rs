//! When to stop a flight that would go on.

use std::fmt;

use bench_device::{PositionSample, Readback, Time, TrackStatus};
use bench_rig::{Phase, Safety};

/// Why a flight was stopped.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StopReason {
    /// Above the ceiling.
    Ceiling {
        /// Measured altitude, m.
        altitude_m: f64,
        /// The rig's limit, m.
        limit_m: f64,
    },
    /// Too far out.
    Radius {
        /// Measured horizontal distance from the origin, m.
        distance_m: f64,
        /// The rig's limit, m.
        limit_m: f64,
    },
    /// No position for too long while in the air.
    TrackerLost {
        /// How long, s.
        silent_s: f64,
        /// The rig's limit, s.
        limit_s: f64,
    },
    /// In the air for too long.
    FlightTime {
        /// The rig's limit, s.
        limit_s: f64,
    },
    /// Too many overruns in a row.
    Overruns {
        /// How many.
        streak: u32,
    },
    /// The outputs have not read what they were set to for too long.
    Mismatch {
        /// How long, s.
        lasted_s: f64,
    },
    /// A person or the system asked for it.
    Asked,
    /// STOP was pressed on the live page.
    Pressed,
}

impl fmt::Display for StopReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Ceiling { altitude_m, limit_m } => {
                write!(f, "at {altitude_m:.2} m, above the ceiling of {limit_m} m")
            }
            Self::Radius { distance_m, limit_m } => {
                write!(f, "{distance_m:.2} m from the origin, outside the radius of {limit_m} m")
            }
            Self::TrackerLost { silent_s, limit_s } => {
                write!(f, "no position for {silent_s:.2} s, more than {limit_s} s")
            }
            Self::FlightTime { limit_s } => write!(f, "in flight for more than {limit_s} s"),
            Self::Overruns { streak } => write!(f, "{streak} overruns in a row"),
            Self::Mismatch { lasted_s } => {
                write!(
                    f,
                    "the outputs have not read what they were set to for {lasted_s:.1} s; check the wires to the inputs"
                )
            }
            Self::Asked => write!(f, "asked to stop"),
            Self::Pressed => write!(f, "STOP was pressed on the live page"),
        }
    }
}

/// Watches a flight iteration by iteration.
#[derive(Debug)]
pub(crate) struct Guard {
    limits: Safety,
    airborne_since: Option<Time>,
    last_seen: Option<Time>,
    last_position_m: [f64; 3],
    streak: u32,
    mismatch_since: Option<Time>,
    mismatch_s: f64,
}

/// How long outputs may read something else than they were set to, s: a lag that the controller copes with shows for a few iterations after
/// each step, a broken wire for good.
const MISMATCH_MAX_S: f64 = 1.0;

impl Guard {
    pub(crate) fn new(limits: Safety) -> Self {
        Self {
            limits,
            airborne_since: None,
            last_seen: None,
            last_position_m: [0.0; 3],
            streak: 0,
            mismatch_since: None,
            mismatch_s: 0.0,
        }
    }

    pub(crate) fn observe(&mut self, sample: &PositionSample) {
        if sample.status != TrackStatus::Lost {
            self.last_seen = Some(sample.arrived_at);
            self.last_position_m = sample.position_m;
        }
    }

    pub(crate) fn observe_readback(&mut self, now: Time, readback: &Readback) {
        if readback.faults.mismatch {
            self.mismatch_s = now.since_s(*self.mismatch_since.get_or_insert(now));
        } else {
            (self.mismatch_since, self.mismatch_s) = (None, 0.0);
        }
    }

    /// A reason to stop now, if there is one.
    pub(crate) fn check(&mut self, now: Time, phase: Phase, overrun: bool) -> Option<StopReason> {
        let limits = &self.limits;
        self.streak = if overrun { self.streak + 1 } else { 0 };
        if self.streak >= limits.overrun_streak {
            return Some(StopReason::Overruns { streak: self.streak });
        }
        if matches!(phase, Phase::Idle | Phase::Abort) {
            self.airborne_since = None;
            return None;
        }
        if self.mismatch_s > MISMATCH_MAX_S {
            return Some(StopReason::Mismatch { lasted_s: self.mismatch_s });
        }
        let since = *self.airborne_since.get_or_insert(now);
        if now.since_s(since) > limits.flight_time_max_s {
            return Some(StopReason::FlightTime { limit_s: limits.flight_time_max_s });
        }
        let silent_s = now.since_s(self.last_seen.unwrap_or(since).max(since));
        if silent_s > limits.tracker_timeout_s {
            return Some(StopReason::TrackerLost { silent_s, limit_s: limits.tracker_timeout_s });
        }
        let [x, y, altitude_m] = self.last_position_m;
        if altitude_m > limits.ceiling_m {
            return Some(StopReason::Ceiling { altitude_m, limit_m: limits.ceiling_m });
        }
        let distance_m = x.hypot(y);
        if distance_m > limits.radius_m {
            return Some(StopReason::Radius { distance_m, limit_m: limits.radius_m });
        }
        None
    }
}
