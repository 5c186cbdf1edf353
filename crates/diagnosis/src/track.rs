//! A flight as the filter sees it: what the pins held, and what the tracker saw when.

use bench_device::{PositionSample, Time, TrackStatus};
use bench_recording::Flight;
use bench_rig::Rig;
use thiserror::Error;

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
pub struct Sighting {
    /// Exposure as the tracker believes, s.
    pub exposed_s: f64,
    /// Altitude, m.
    pub z_m: f64,
    /// Whether it is held against a prediction: not so for a while after the airframe came back to the ground, whose
    /// contact no law here describes.
    pub counts: bool,
}

/// The part of a flight that can be predicted: from the first throttle that may lift off to the last.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Track {
    /// What it is called in results.
    pub name: String,
    /// Zero-order hold, times rising.
    pub inputs: Vec<Input>,
    /// Times rising.
    pub sightings: Vec<Sighting>,
    /// When the throttle first exceeds where thrust begins, s.
    pub begin_s: f64,
    /// When it last does, s.
    pub end_s: f64,
    /// One sigma of the exposures' times, s.
    pub timing_s: f64,
    /// From this exposure on, s, the filter predicts and does not learn; infinite to learn from all.
    pub blind_from_s: f64,
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
        "{flight}: the throttle never exceeds {offset} {unit}, where the rig's thrust begins: it never flew, or the rig is of another airframe"
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
    #[error("{flight}: only {sightings} positions while the rotors turned; at least {least} are needed")]
    TooShort {
        /// The flight.
        flight: String,
        /// How many there are.
        sightings: usize,
        /// How many are needed.
        least: usize,
    },
}

/// Fewest sightings of a flight that is worth a filter.
const LEAST_SIGHTINGS: usize = 20;
/// Sightings so long before the first throttle still count, s: the airframe stands, which tells the tracker's bias.
const BEFORE_S: f64 = 0.5;
/// Above this altitude it has flown, m.
const FLOWN_M: f64 = 0.03;
/// Below this one it has come back, m.
const LANDED_M: f64 = 0.009;
/// Nothing counts for this long after it came back, s.
const AFTER_CONTACT_S: f64 = 0.6;

impl Track {
    /// The predictable part of a recorded flight.
    pub fn from_flight(name: &str, flight: &Flight, rig: &Rig) -> Result<Self, TrackError> {
        let flight_name = || name.to_owned();
        let inputs: Vec<_> = flight
            .commands
            .iter()
            .filter(|command| command.sticks.throttle.is_finite())
            .map(|command| Input {
                time_s: command.time.seconds(),
                throttle: rig.output.on_the_pin(&rig.airframe.sticks, command.sticks.throttle),
            })
            .collect();
        if inputs.is_empty() {
            return Err(TrackError::NoCommands { flight: flight_name() });
        }
        let mut sightings: Vec<_> = flight
            .positions
            .iter()
            .filter(|position| position.status != TrackStatus::Lost && position.position_m[2].is_finite())
            .map(|position| Sighting {
                exposed_s: position.exposed_at.seconds(),
                z_m: position.position_m[2],
                counts: true,
            })
            .collect();
        if sightings.is_empty() {
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
        let timing_s =
            if holds_newest_frame(flight) { rig.tracker.frame_period_s / 12_f64.sqrt() } else { 0.0 };
        // Chosen once, by the tracker's own times, so that every hypothesis is held against the same sightings.
        let begin_s = inputs[first].time_s;
        sightings.retain(|s| (begin_s - BEFORE_S..=end_s).contains(&s.exposed_s));
        mask_contacts(&mut sightings, begin_s);
        let track = Self {
            name: flight_name(),
            begin_s,
            end_s,
            inputs,
            sightings,
            timing_s,
            blind_from_s: f64::INFINITY,
        };
        let seen = track.sightings.iter().filter(|s| s.counts).count();
        if seen < LEAST_SIGHTINGS {
            return Err(TrackError::TooShort {
                flight: flight_name(),
                sightings: seen,
                least: LEAST_SIGHTINGS,
            });
        }
        Ok(track)
    }
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

/// Leaves out what follows a return to the ground.
fn mask_contacts(sightings: &mut [Sighting], begin_s: f64) {
    let mut flown = false;
    let mut until_s = f64::MIN;
    for sighting in sightings {
        flown |= sighting.z_m > FLOWN_M;
        if flown && sighting.z_m < LANDED_M && sighting.exposed_s > begin_s {
            until_s = sighting.exposed_s + AFTER_CONTACT_S;
        }
        sighting.counts = sighting.exposed_s > until_s;
    }
}

fn end_of(flight: &Flight) -> f64 {
    let last_position = flight.positions.last().map_or(Time::ZERO, |position| position.arrived_at);
    let last_command = flight.commands.last().map_or(Time::ZERO, |command| command.time);
    last_position.max(last_command).seconds()
}
