//! A flight as the filter sees it: what the pins held, and what the tracker saw when.

use bench_device::{PositionSample, Time, TrackStatus};
use bench_recording::Flight;
use bench_rig::Rig;
use bench_statistics::{MEDIAN_OF_NORMAL, median_high};
use thiserror::Error;

use crate::{
    frame_clock::FrameClock,
    pins::{Pin, inputs, pins, unanswered},
};

/// The sticks' throttle from an instant on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Input {
    /// From when, s.
    pub time_s: f64,
    /// Throttle on the pin, in units of the actuation.
    pub throttle: f64,
}

/// One altitude as seen by the tracker.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measurement {
    /// Exposure by the frames' clock where they keep one, else as the tracker believes, s.
    pub exposed_s: f64,
    /// Exposure as the tracker believes, s.
    pub believed_s: f64,
    /// Altitude, m.
    pub z_m: f64,
    /// Whether it is held against a prediction: not so for a while after the airframe came back to the ground, whose
    /// contact no law here describes.
    pub counts: bool,
    /// Whether the airframe is taken to be where it is seen, without any law: [`Track::above`].
    pub carried: bool,
}

/// The part of a flight that can be predicted: from the first throttle that may lift off to the last.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Track {
    /// What it is called in results.
    pub name: String,
    /// Zero-order hold, times rising.
    pub inputs: Vec<Input>,
    /// Times rising.
    pub measurements: Vec<Measurement>,
    /// When the throttle first exceeds where thrust begins, s.
    pub begin_s: f64,
    /// Time between the log's rows, s, where they come faster than the rig's frames: of those, measurements are only so far apart as frames.
    pub dense_s: Option<f64>,
    /// Whether the airframe was first seen in the air: the log begins there, or its altitude does.
    pub begins_aloft: bool,
    /// When it last does, s.
    pub end_s: f64,
    /// One sigma of the exposures' times, s.
    pub timing_s: f64,
    /// Natural logarithm of how much stronger this flight's noise is than the others'.
    pub ln_noise: f64,
    /// Throttle as asked for and as read back, an iteration each; empty without readback.
    pub pins: Vec<Pin>,
    /// Commands to a real output that it did not answer.
    pub unanswered: usize,
    /// By how much iterations started late, s.
    pub lateness_s: Vec<f64>,
    /// The same of each of `inputs`, against the usual; zero where it is not known.
    pub late_s: Vec<f64>,
    /// Cosine of the tilt from each instant, s, on; empty where attitude was not measured.
    pub tilt: Vec<(f64, f64)>,
    /// Voltage of the battery from each instant, s, on, V; empty where it was not measured.
    pub voltage: Vec<(f64, f64)>,
    /// Mean square speed of the rotors from each instant, s, on, rad^2/s^2; empty where it was not measured.
    pub rotor: Vec<(f64, f64)>,
    /// What was felt on board in flight, at most once a frame, times rising.
    pub felt: Vec<Felt>,
    /// How many frames came, as far as frames have a clock.
    pub frames_told: usize,
    /// Lengths of gaps between them, frames.
    pub bursts: Vec<usize>,
    /// How much later than a regular clock frames arrived, s.
    pub waits_s: Vec<f64>,
}

/// Vertical motion as it was measured on board.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Felt {
    /// When, s.
    pub time_s: f64,
    /// Speed, m/s.
    pub velocity_m_s: Option<f64>,
    /// Acceleration, zero at rest, m/s^2.
    pub acceleration_m_s2: Option<f64>,
}

/// Why a flight cannot be diagnosed.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum TrackError {
    /// Nothing was commanded.
    #[error("{flight}: no throttle command was recorded; the diagnosis predicts altitude from throttle")]
    NoCommands {
        /// The flight.
        flight: String,
    },
    /// Nothing was seen.
    #[error("{flight}: no position was recorded; the diagnosis compares predicted with seen altitude")]
    NoPositions {
        /// The flight.
        flight: String,
    },
    /// The throttle never lifts.
    #[error(
        "{flight}: the throttle never exceeds {offset:.3} {unit}, where the rig's thrust begins: it never flew, or the rig is of another airframe"
    )]
    NeverFlew {
        /// The flight.
        flight: String,
        /// The rig's thrust offset.
        offset: f64,
        /// The rig's unit of throttle.
        unit: &'static str,
    },
    /// Too little to say anything.
    #[error(
        "{flight}: only {measurements} positions in flight, while the rotors turned; at least {least} are needed"
    )]
    TooShort {
        /// The flight.
        flight: String,
        /// How many there are.
        measurements: usize,
        /// How many are needed.
        least: usize,
    },
}

/// Fewest measurements of a flight that is worth a filter.
const LEAST_MEASUREMENTS: usize = 20;
/// Measurements so long before the first throttle still count, s: the airframe stands, which tells the tracker's bias.
const BEFORE_S: f64 = 0.5;
/// Above this altitude it has flown, m.
const FLOWN_M: f64 = 0.03;
/// So many measurements tell a speed.
const FIRST_SEEN: usize = 2;
/// Below this one it has come back, m.
const LANDED_M: f64 = 0.009;
/// Nothing counts for this long after it came back, s.
const AFTER_CONTACT_S: f64 = 0.6;

impl Track {
    /// The predictable part of a recorded flight.
    pub fn from_flight(name: &str, flight: &Flight, rig: &Rig) -> Result<Self, TrackError> {
        let flight_name = || name.to_owned();
        let pins = pins(flight, rig);
        let inputs = inputs(flight, rig, &pins);
        let unanswered = unanswered(flight, rig, &pins);
        if inputs.is_empty() {
            return Err(TrackError::NoCommands { flight: flight_name() });
        }
        let dense = denser_than_frames(flight, rig);
        let held = dense.is_none() && holds_newest_frame(flight);
        // What is thought of the latency now, beyond what was thought when exposures were reckoned from arrivals.
        let believed_s = latency_when_recorded_s(flight).unwrap_or(rig.tracker.latency_s.value);
        let later_s = rig.tracker.latency_s.value - believed_s;
        let clock = if held || dense.is_some() { None } else { FrameClock::of(flight, rig, believed_s) };
        let mut measurements: Vec<_> = flight
            .positions
            .iter()
            .enumerate()
            .filter(|(i, position)| {
                usable(position) && !clock.as_ref().is_some_and(|clock| clock.doubtful[*i])
            })
            .map(|(i, position)| Measurement {
                exposed_s: clock.as_ref().map_or(position.exposed_at.seconds(), |clock| clock.exposed_s[i])
                    - later_s,
                believed_s: position.exposed_at.seconds() - later_s,
                z_m: position.position_m[2],
                counts: true,
                carried: false,
            })
            .collect();
        if dense.is_some() {
            let tears = tears(&measurements);
            for (from_s, to_s) in tears {
                let first = measurements.partition_point(|s| s.exposed_s < from_s);
                let last = measurements.partition_point(|s| s.exposed_s <= to_s);
                measurements[first..last].iter_mut().for_each(|s| s.carried = true);
            }
            thin(&mut measurements, rig.tracker.frame_period_s, |s| s.exposed_s);
        }
        if measurements.is_empty() {
            return Err(TrackError::NoPositions { flight: flight_name() });
        }
        let offset = rig.airframe.thrust.offset.value;
        let turning = |input: &Input| input.throttle > offset;
        let (Some(first), Some(last)) = (inputs.iter().position(turning), inputs.iter().rposition(turning))
        else {
            let unit = rig.airframe.actuation.unit();
            return Err(TrackError::NeverFlew { flight: flight_name(), offset, unit });
        };
        let end_s = inputs.get(last + 1).map_or_else(|| end_of(flight), |next| next.time_s);
        // A row of a log holds what was newest when it was written.
        let waited_s = if held { rig.tracker.frame_period_s } else { dense.unwrap_or(0.0) };
        let timing_s = waited_s / 12_f64.sqrt(); // unit
        let (waits_s, bursts, frames_told) =
            clock.map_or_else(Default::default, |clock| (clock.waits_s, clock.bursts, clock.told));
        // Chosen once, by the tracker's own times, so that every hypothesis is held against the same measurements.
        let begin_s = inputs[first].time_s;
        measurements.retain(|s| (begin_s - BEFORE_S..=end_s).contains(&s.exposed_s));
        let begins_aloft = begins_aloft(&mut measurements, begin_s);
        mask_contacts(&mut measurements, begin_s);
        Self {
            name: flight_name(),
            begin_s,
            begins_aloft,
            dense_s: dense,
            end_s,
            inputs,
            measurements,
            timing_s,
            ln_noise: 0.0,
            pins,
            unanswered,
            late_s: late_inputs_s(flight),
            lateness_s: lateness_s(flight),
            tilt: tilt(flight),
            voltage: voltage(flight),
            rotor: rotor(flight),
            felt: felt(flight, begin_s, end_s, rig.tracker.frame_period_s),
            frames_told,
            bursts,
            waits_s,
        }
        .check()
    }
}

/// A stretch above an altitude counts if it lasts so long, s.
const LEAST_STRETCH_S: f64 = 1.0;

impl Track {
    /// The same flight, predicted only where it is above an altitude with the rotors turning. Below, the airframe is
    /// taken to be where it is seen, and its effects' states move on with the throttle. For flights whose take-off and
    /// landing no law here describes: by hand, on soft ground, one after another, or by measurements that wander on the
    /// ground.
    pub fn above(mut self, above_m: f64, rig: &Rig) -> Result<Self, TrackError> {
        let offset = rig.airframe.thrust.offset.value;
        let mut inputs = self.inputs.iter().peekable();
        let mut turning = false;
        for measurement in &mut self.measurements {
            while let Some(input) = inputs.next_if(|input| input.time_s <= measurement.exposed_s) {
                turning = input.throttle > offset;
            }
            measurement.carried |= !turning || measurement.z_m < above_m;
        }
        for stretch in self.measurements.chunk_by_mut(|a, b| a.carried == b.carried) {
            let lasted_s = stretch[stretch.len() - 1].exposed_s - stretch[0].exposed_s;
            for measurement in stretch {
                measurement.carried |= lasted_s < LEAST_STRETCH_S;
                measurement.counts = !measurement.carried;
            }
        }
        self.check()
    }

    /// How many measurements are held against predictions.
    pub fn counted(&self) -> usize {
        self.measurements.iter().filter(|measurement| measurement.counts).count()
    }

    /// The highest altitude that was seen twice in a row, m: one measurement may be of anything.
    pub fn highest_m(&self) -> f64 {
        let twice = self.measurements.windows(2).map(|pair| pair[0].z_m.min(pair[1].z_m));
        twice.fold(f64::NEG_INFINITY, f64::max)
    }

    /// Changes each input that a pin was read for.
    pub fn at_pins(&mut self, change: impl Fn(&mut Input, &Pin)) {
        let mut pins = self.pins.iter().peekable();
        for input in &mut self.inputs {
            while pins.next_if(|pin| pin.time_s < input.time_s).is_some() {}
            if let Some(pin) = pins.next_if(|pin| pin.time_s == input.time_s) {
                change(input, pin);
            }
        }
    }

    /// Pins that held what they were told when they were told it, whatever was read of them.
    pub fn as_commanded(&mut self) {
        self.at_pins(|input, pin| {
            input.throttle = pin.commanded;
            input.time_s -= pin.delay_s;
        });
    }

    /// Thrust may begin earlier than it did before the inputs were changed.
    pub fn begin_with_thrust(&mut self, rig: &Rig) {
        let offset = rig.airframe.thrust.offset.value;
        if let Some(first) = self.inputs.iter().find(|input| input.throttle > offset) {
            self.begin_s = self.begin_s.min(first.time_s);
        }
    }

    fn check(self) -> Result<Self, TrackError> {
        let seen = self.counted();
        if seen < LEAST_MEASUREMENTS {
            return Err(TrackError::TooShort {
                flight: self.name,
                measurements: seen,
                least: LEAST_MEASUREMENTS,
            });
        }
        Ok(self)
    }
}

pub(crate) fn usable(position: &PositionSample) -> bool {
    position.status != TrackStatus::Lost && position.position_m[2].is_finite()
}

/// How late iterations started; against the usual interval where no schedule was kept.
fn lateness_s(flight: &Flight) -> Vec<f64> {
    flight.ticks.iter().skip(1).map(|tick| tick.started.since_s(tick.scheduled)).collect()
}

/// What stood at an instant in a series that rises in time; `None` before its first.
pub fn held(series: &[(f64, f64)], time_s: f64) -> Option<f64> {
    let after = series.partition_point(|(from_s, _)| *from_s <= time_s);
    after.checked_sub(1).map(|i| series[i].1)
}

fn tilt(flight: &Flight) -> Vec<(f64, f64)> {
    let measured = flight.motion.iter().filter_map(|motion| {
        let [roll, pitch, _] = motion.attitude_rad;
        let cosine = roll?.cos() * pitch?.cos();
        cosine.is_finite().then(|| (motion.time.seconds(), cosine))
    });
    measured.collect()
}

fn voltage(flight: &Flight) -> Vec<(f64, f64)> {
    let measured = flight.battery.iter().filter(|battery| battery.voltage_v.is_finite());
    measured.map(|battery| (battery.time.seconds(), battery.voltage_v)).collect()
}

fn rotor(flight: &Flight) -> Vec<(f64, f64)> {
    let measured = flight.rotor.iter().filter_map(|rotor| {
        let speeds: Vec<f64> =
            rotor.speed_rad_s.iter().flatten().copied().filter(|w| w.is_finite()).collect();
        let square = speeds.iter().map(|w| w * w).sum::<f64>() / speeds.len().max(1) as f64;
        (!speeds.is_empty()).then(|| (rotor.time.seconds(), square))
    });
    measured.collect()
}

/// Leaves one of what rises in time a period.
fn thin<T>(all: &mut Vec<T>, period_s: f64, time_s: impl Fn(&T) -> f64) {
    let mut next_s = f64::MIN;
    all.retain(|one| {
        let due = time_s(one) >= next_s;
        if due {
            next_s = time_s(one) + DUE * period_s;
        }
        due
    });
}

/// So many readings at rest tell what an accelerometer shows there.
const LEAST_AT_REST: usize = 10;

fn felt(flight: &Flight, begin_s: f64, end_s: f64, period_s: f64) -> Vec<Felt> {
    let mut all: Vec<Felt> = flight
        .motion
        .iter()
        .map(|motion| Felt {
            time_s: motion.time.seconds(),
            velocity_m_s: motion.velocity_m_s[2].filter(|x| x.is_finite()),
            acceleration_m_s2: motion.vertical_acceleration_m_s2.filter(|x| x.is_finite()),
        })
        .filter(|felt| felt.time_s <= end_s && (felt.velocity_m_s, felt.acceleration_m_s2) != (None, None))
        .collect();
    let flying = all.partition_point(|felt| felt.time_s < begin_s);
    let at_rest: Vec<f64> = all.drain(..flying).filter_map(|felt| felt.acceleration_m_s2).collect();
    let zero = if at_rest.len() < LEAST_AT_REST { 0.0 } else { median_high(at_rest).unwrap_or(0.0) };
    thin(&mut all, period_s, |felt| felt.time_s);
    for felt in &mut all {
        felt.acceleration_m_s2 = felt.acceleration_m_s2.map(|x| x - zero);
    }
    all
}

/// How late each command's iteration started, against the median.
fn late_inputs_s(flight: &Flight) -> Vec<f64> {
    let usual_s = median_high(lateness_s(flight)).unwrap_or(0.0);
    flight
        .commands
        .iter()
        .filter(|command| command.sticks.throttle.is_finite())
        .map(|command| {
            let after = flight.ticks.partition_point(|tick| tick.started <= command.time);
            let tick = after.checked_sub(1).map(|i| &flight.ticks[i]);
            tick.map_or(0.0, |tick| (tick.started.since_s(tick.scheduled) - usual_s).max(0.0))
        })
        .collect()
}

/// Whether positions come with the commands, at the same instants: then the log holds the newest frame at hand, which
/// had waited for anything up to a frame period.
fn holds_newest_frame(flight: &Flight) -> bool {
    let with_a_command = |position: &&PositionSample| {
        flight.commands.binary_search_by_key(&position.arrived_at, |command| command.time).is_ok()
    };
    let together = flight.positions.iter().filter(with_a_command).count();
    2 * together > flight.positions.len()
}

/// A log whose rows are closer than this share of the tracker's frame period holds more rows than frames.
const DENSE: f64 = 0.6;
/// The next frame is taken after this share of the period: rows need not fall on its multiples.
const DUE: f64 = 0.95;

/// Rows over which their rate is measured: frames that wait for one another come several at once.
const RATE_ROWS: usize = 20;

/// Time between two rows of a log that holds more rows than the rig's tracker gives independent positions: repeated,
/// interpolated, or estimates that follow one another.
fn denser_than_frames(flight: &Flight, rig: &Rig) -> Option<f64> {
    let rows = RATE_ROWS.min(flight.positions.len().saturating_sub(1));
    let spans = flight.positions.iter().zip(flight.positions.get(rows..)?);
    median_high(spans.map(|(first, last)| last.exposed_at.since_s(first.exposed_at) / rows as f64).collect())
        .filter(|median| *median < DENSE * rig.tracker.frame_period_s)
}

/// Time over which a dense log's speeds are compared, s.
const TEAR_S: f64 = 0.05;
/// Measurements do not count for so long before and after a tear, s.
const AROUND_TEAR_S: (f64, f64) = (0.05, 0.15);
/// A tear is so many deviations of what is usual in the flight, and no less than this acceleration, m/s^2.
const TEAR_SIGMAS: f64 = 8.0;
const LEAST_TEAR_M_S2: f64 = 3.0;

/// When a dense log's altitude jumps as no airframe does: an estimator on board whose range sensor meets an edge, or that
/// loses its fix. The airframe does not move, its origin does: after it the flight is followed anew.
fn tears(measurements: &[Measurement]) -> Vec<(f64, f64)> {
    let at = |time_s: f64| {
        let after = measurements.partition_point(|s| s.exposed_s < time_s - 1e-6);
        measurements.get(after).filter(|s| s.exposed_s < time_s + 0.5 * TEAR_S)
    };
    let kinks: Vec<(f64, f64)> = measurements
        .iter()
        .filter_map(|middle| {
            let (before, after) = (at(middle.exposed_s - TEAR_S)?, at(middle.exposed_s + TEAR_S)?);
            let slope = |a: &Measurement, b: &Measurement| (b.z_m - a.z_m) / (b.exposed_s - a.exposed_s);
            (before.exposed_s < middle.exposed_s && middle.exposed_s < after.exposed_s)
                .then(|| (middle.exposed_s, (slope(middle, after) - slope(before, middle)) / TEAR_S))
        })
        .collect();
    let mut sizes: Vec<f64> = kinks.iter().map(|(_, kink)| kink.abs()).filter(|kink| *kink > 0.0).collect();
    sizes.sort_by(f64::total_cmp);
    let usual = sizes.get(sizes.len() / 2).map_or(0.0, |median| median / MEDIAN_OF_NORMAL);
    let least = LEAST_TEAR_M_S2.max(TEAR_SIGMAS * usual);
    let (before_s, after_s) = AROUND_TEAR_S;
    let torn = kinks.iter().filter(|(_, kink)| kink.abs() > least);
    torn.map(|(time_s, _)| (time_s - before_s, time_s + after_s)).collect()
}

/// By which latency a recording's exposures were reckoned from arrivals, where it says so.
fn latency_when_recorded_s(flight: &Flight) -> Option<f64> {
    if let Some(text) = flight.session.extra.get("import.latency_s") {
        return text.parse().ok().filter(|x: &f64| x.is_finite());
    }
    // A log that tells when each position was exposed has its own latency, whatever rig is attached.
    if flight.session.extra.contains_key("import.exposed_at") {
        let ages = flight.positions.iter().map(|position| position.arrived_at.since_s(position.exposed_at));
        return median_high(ages.collect());
    }
    let rig = Rig::read(std::path::Path::new("recording"), flight.rig_toml()?).ok()?;
    Some(rig.tracker.latency_s.value)
}

/// Whether nothing was seen at rest. The filter then takes the airframe to be where it was first seen, and as fast as the first two
/// measurements that some throttle is known for tell.
fn begins_aloft(measurements: &mut Vec<Measurement>, begin_s: f64) -> bool {
    if measurements.len() < FIRST_SEEN || measurements[..FIRST_SEEN].iter().any(|first| first.z_m <= FLOWN_M)
    {
        return false;
    }
    measurements.retain(|measurement| measurement.exposed_s >= begin_s);
    measurements.iter_mut().take(FIRST_SEEN).for_each(|first| first.carried = true);
    true
}

/// Leaves out what follows a return to the ground.
fn mask_contacts(measurements: &mut [Measurement], begin_s: f64) {
    let mut flown = false;
    let mut until_s = f64::MIN;
    for measurement in measurements {
        flown |= measurement.z_m > FLOWN_M;
        if flown && measurement.z_m < LANDED_M && measurement.exposed_s > begin_s {
            until_s = measurement.exposed_s + AFTER_CONTACT_S;
        }
        measurement.counts = !measurement.carried && measurement.exposed_s > until_s;
    }
}

fn end_of(flight: &Flight) -> f64 {
    let last_position = flight.positions.last().map_or(Time::ZERO, |position| position.arrived_at);
    let last_command = flight.commands.last().map_or(Time::ZERO, |command| command.time);
    last_position.max(last_command).seconds()
}

#[cfg(test)]
mod tests {
    use bench_recording::{Mode, Session};

    use super::*;

    #[test]
    fn exposures_that_a_log_tells_have_the_logs_latency() {
        let seen = |k: u32| PositionSample {
            exposed_at: Time::from_seconds(f64::from(k) * 0.02),
            arrived_at: Time::from_seconds(f64::from(k) * 0.02 + 0.03),
            status: TrackStatus::Found,
            ..PositionSample::default()
        };
        let mut session = Session::new(Mode::Import);
        let records = || (0..5).map(|k| seen(k).into());
        let believed =
            |session: &Session| latency_when_recorded_s(&Flight::from_records(session.clone(), records()));
        assert_eq!(believed(&session), None);
        session.extra.insert("import.exposed_at".to_owned(), "told".to_owned());
        assert!((believed(&session).unwrap() - 0.03).abs() < 1e-9);
    }
}
