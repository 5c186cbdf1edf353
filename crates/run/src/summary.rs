//! What a flight achieved, from what the tracker saw and the controller wanted.

use bench_device::{PositionSample, Time, TrackStatus};
use bench_recording::{Flight, Mode};
use bench_rig::{Criteria, Mission, Phase, Rig};
use bench_statistics::{Sorted, root_mean_square};

/// The figures of one flight. Positions are those of the tracker, at their times of exposure; a figure that the flight
/// does not define is `None`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Summary {
    /// From the first tick to the last, s.
    pub duration_s: f64,
    /// Highest altitude, m.
    pub peak_m: Option<f64>,
    /// Highest altitude less highest set-point, m; zero when the set-point was not exceeded.
    pub overshoot_m: Option<f64>,
    /// In the last hold: from the last change of the set-point until altitude and horizontal position stay in the
    /// mission's band, s.
    pub settling_time_s: Option<f64>,
    /// RMS altitude error over the last hold once settled (or from the last change of the set-point), m.
    pub rms_error_m: Option<f64>,
    /// RMS horizontal error over the same time, m.
    pub lateral_rms_error_m: Option<f64>,
    /// Lowest altitude between the first fall by 3 cm and the next rise by 1.5 cm, m.
    pub rebound_m: Option<f64>,
    /// Iterations.
    pub ticks: u64,
    /// Iterations that overran.
    pub overruns: u64,
    /// Latest start of an iteration, s after its schedule.
    pub lateness_max_s: f64,
    /// Positions received.
    pub positions: u64,
    /// Iterations whose outputs were not read back in time.
    pub unanswered: u64,
    /// How well time was kept.
    pub timing: Timing,
}

impl Summary {
    /// The figures of a recorded flight; `settle_band_m` is the mission's, m. They are those that were computed as it flew.
    pub fn of_flight(flight: &Flight, settle_band_m: Option<f64>) -> Self {
        let positions = flight.positions.iter().filter(|position| position.status != TrackStatus::Lost);
        let mut ticks = flight.ticks.iter().peekable();
        let mut readbacks = flight.readbacks.iter().peekable();
        // Logs that were imported need not hold what the outputs measured.
        let is_read_back = flight.session.mode != Mode::Import || !flight.readbacks.is_empty();
        let mut entries = Vec::with_capacity(flight.states.len());
        for (index, state) in flight.states.iter().enumerate() {
            while ticks.next_if(|tick| tick.started < state.time).is_some() {}
            let tick = ticks.next_if(|tick| tick.started == state.time);
            let until = flight.states.get(index + 1).map(|next| next.time);
            let mut answered = !is_read_back;
            while readbacks.next_if(|readback| until.is_none_or(|until| readback.time < until)).is_some() {
                answered = true;
            }
            entries.push(LogEntry {
                time: state.time,
                phase: state.phase,
                setpoint_m: state.setpoint_m,
                lateness_s: tick.map_or(0.0, |tick| tick.started.since_s(tick.scheduled)),
                actuate_s: tick.map_or(0.0, |tick| tick.actuate_s),
                answered,
                overrun: tick.is_some_and(|tick| tick.overrun),
            });
        }
        let positions = positions.map(|position| (position.exposed_at, position.position_m)).collect();
        let summary = FlightLog { settle_band_m, positions, entries }.summarise();
        // A log that was imported has states without a loop of ours.
        Self { ticks: flight.ticks.len() as u64, ..summary }
    }
}

/// How well a loop kept its time; all zero in lockstep.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Timing {
    /// Start of an iteration after its schedule, s.
    pub lateness_s: Percentiles,
    /// From handing the outputs over to having them read back, s.
    pub round_trip_s: Percentiles,
}

/// A distribution in three numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Percentiles {
    /// Half are below.
    pub p50: f64,
    /// 99 of 100 are below.
    pub p99: f64,
    /// None is above.
    pub max: f64,
}

impl Percentiles {
    /// Of any number of values, in any order; zero of none. Nearest rank.
    pub fn of(values: Vec<f64>) -> Self {
        let values = Sorted::of(values);
        let rank = |share: f64| values.nearest_rank(share).unwrap_or(0.0);
        Self { p50: rank(0.5), p99: rank(0.99), max: rank(1.0) }
    }
}

/// One criterion of a mission, held against a flight.
#[derive(Clone, Debug, PartialEq)]
pub struct Check {
    /// The criterion's key in the mission file.
    pub key: &'static str,
    /// What the flight achieved; `None` when the flight does not define it, which fails.
    pub value: Option<f64>,
    /// The mission's limit.
    pub limit: f64,
    /// Whether the value must not be below the limit, rather than not above.
    pub at_least: bool,
    /// Whether it was met.
    pub passed: bool,
}

/// Every criterion that a mission states, in the order of the file's documentation.
pub fn check(criteria: &Criteria, summary: &Summary) -> Vec<Check> {
    let overruns = Some(summary.overruns as f64);
    [
        ("peak_min_m", summary.peak_m, criteria.peak_min_m, true),
        ("peak_max_m", summary.peak_m, criteria.peak_max_m, false),
        ("settling_time_max_s", summary.settling_time_s, criteria.settling_time_max_s, false),
        ("overshoot_max_m", summary.overshoot_m, criteria.overshoot_max_m, false),
        ("rms_error_max_m", summary.rms_error_m, criteria.rms_error_max_m, false),
        ("lateral_rms_error_max_m", summary.lateral_rms_error_m, criteria.lateral_rms_error_max_m, false),
        ("overruns_max", overruns, criteria.overruns_max, false),
        ("rebound_min_m", summary.rebound_m, criteria.rebound_min_m, true),
    ]
    .into_iter()
    .filter_map(|(key, value, limit, at_least)| {
        let limit = limit?;
        let passed = value.is_some_and(|value| if at_least { value >= limit } else { value <= limit });
        Some(Check { key, value, limit, at_least, passed })
    })
    .collect()
}

/// What the summary is made of, kept without allocation while the mission lasts as planned.
#[derive(Debug)]
pub(crate) struct FlightLog {
    settle_band_m: Option<f64>,
    positions: Vec<(Time, [f64; 3])>,
    entries: Vec<LogEntry>,
}

/// One iteration, as far as the summary needs it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LogEntry {
    pub time: Time,
    pub phase: Phase,
    pub setpoint_m: [f64; 3],
    pub lateness_s: f64,
    pub actuate_s: f64,
    pub answered: bool,
    pub overrun: bool,
}

impl FlightLog {
    pub(crate) fn with_capacity(rig: &Rig, mission: &Mission) -> Self {
        let duration_s = mission.duration_s() + 10.0;
        let slots = |period_s: f64| (duration_s / period_s).ceil() as usize;
        Self {
            settle_band_m: mission.criteria.settle_band_m,
            positions: Vec::with_capacity(slots(rig.tracker.frame_period_s)),
            entries: Vec::with_capacity(slots(rig.control_loop.period_s)),
        }
    }

    pub(crate) fn observe(&mut self, sample: &PositionSample) {
        if sample.status != TrackStatus::Lost {
            self.positions.push((sample.exposed_at, sample.position_m));
        }
    }

    pub(crate) fn decided(&mut self, entry: LogEntry) {
        self.entries.push(entry);
    }

    pub(crate) fn summarise(&self) -> Summary {
        let mut summary = Summary {
            ticks: self.entries.len() as u64,
            overruns: self.entries.iter().filter(|entry| entry.overrun).count() as u64,
            lateness_max_s: self.entries.iter().map(|entry| entry.lateness_s).fold(0.0, f64::max),
            positions: self.positions.len() as u64,
            unanswered: self.entries.iter().filter(|entry| !entry.answered).count() as u64,
            timing: Timing {
                lateness_s: Percentiles::of(self.entries.iter().map(|entry| entry.lateness_s).collect()),
                // What was given up says how long the wait was, not the trip.
                round_trip_s: Percentiles::of(
                    self.entries.iter().filter(|entry| entry.answered).map(|entry| entry.actuate_s).collect(),
                ),
            },
            ..Summary::default()
        };
        if let (Some(first), Some(last)) = (self.entries.first(), self.entries.last()) {
            summary.duration_s = last.time.since_s(first.time);
        }
        summary.peak_m = self.positions.iter().map(|(_, position)| position[2]).reduce(f64::max);
        let highest_setpoint_m =
            self.entries.iter().filter(|e| e.phase == Phase::Hold).map(|e| e.setpoint_m[2]).reduce(f64::max);
        summary.overshoot_m =
            highest_setpoint_m.and_then(|setpoint_m| Some((summary.peak_m? - setpoint_m).max(0.0)));
        summary.rebound_m = self.rebound_m();
        self.judge_last_hold(&mut summary);
        summary
    }

    /// Settling and errors over the last unbroken stretch of hold.
    fn judge_last_hold(&self, summary: &mut Summary) {
        let Some(end) = self.entries.iter().rposition(|entry| entry.phase == Phase::Hold) else { return };
        let begin =
            self.entries[..end].iter().rposition(|entry| entry.phase != Phase::Hold).map_or(0, |i| i + 1);
        let hold = &self.entries[begin..=end];
        let changed = hold
            .windows(2)
            .rposition(|pair| pair[0].setpoint_m != pair[1].setpoint_m)
            .map_or(hold[0].time, |i| hold[i + 1].time);
        let ended = self.entries[end].time;
        // A set-point that moves to the very end has no settled part; then all of the hold counts.
        let from = if ended.since_s(changed) >= 1.0 { changed } else { hold[0].time };
        let errors: Vec<_> = self
            .positions
            .iter()
            .filter(|(time, _)| (from..=ended).contains(time))
            .map(|(time, position)| {
                let entry = hold[hold.partition_point(|entry| entry.time <= *time).saturating_sub(1)];
                (*time, [0, 1, 2].map(|axis| position[axis] - entry.setpoint_m[axis]))
            })
            .collect();
        let mut settled = errors.as_slice();
        if let Some(band_m) = self.settle_band_m {
            let outside = errors
                .iter()
                .rposition(|(_, error)| error[2].abs() > band_m || error[0].hypot(error[1]) > band_m);
            settled = &errors[outside.map_or(0, |i| i + 1)..];
            summary.settling_time_s = settled.first().map(|(time, _)| time.since_s(from));
        }
        summary.rms_error_m = root_mean_square(settled.iter().map(|(_, error)| error[2]));
        summary.lateral_rms_error_m =
            root_mean_square(settled.iter().map(|(_, error)| error[0].hypot(error[1])));
    }

    fn rebound_m(&self) -> Option<f64> {
        // Above what a tracker with 5 mm steps and 2 mm noise makes of standing still.
        const FALL_M: f64 = 0.03;
        const RISE_M: f64 = 0.015;
        let (mut peak, mut low) = (f64::MIN, None::<f64>);
        for z in self.positions.iter().map(|(_, position)| position[2]) {
            peak = peak.max(z);
            match low {
                None if peak - z >= FALL_M => low = Some(z),
                None => {}
                Some(lowest) if z - lowest >= RISE_M => return low,
                Some(lowest) => low = Some(lowest.min(z)),
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::Percentiles;

    #[test]
    fn percentiles_are_values_of_the_distribution() {
        let values = (1..=200).rev().map(f64::from).collect();
        assert_eq!(Percentiles::of(values), Percentiles { p50: 100.0, p99: 198.0, max: 200.0 });
        assert_eq!(Percentiles::of(vec![7.0]), Percentiles { p50: 7.0, p99: 7.0, max: 7.0 });
        assert_eq!(Percentiles::of(Vec::new()), Percentiles::default());
    }
}
