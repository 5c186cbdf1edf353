//! What an output's pins held of what they were told, iteration by iteration.

use bench_device::{Sticks, Time};
use bench_plant::effects::Effects;
use bench_recording::Flight;
use bench_rig::{Bench, Rig};
use bench_statistics::{FAR_SIGMAS, MEDIAN_OF_NORMAL, median_high};

use crate::{law::known, track::Input};

/// One iteration's throttle, in units of the actuation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pin {
    /// When it moved, s.
    pub time_s: f64,
    /// How long after the command that was, as far as a real output tells, s.
    pub delay_s: f64,
    /// As the controller asked.
    pub asked: f64,
    /// As the rig's output rounds it.
    pub commanded: f64,
    /// As read back.
    pub readback: f64,
}

/// Fewest neighbours under the same command that show the readback's noise.
const LEAST_NEIGHBOURS: usize = 10; // numerical

/// One sigma of the readback's noise: from what differs from the command where that is all noise, else from neighbours
/// under the same command, else the rig's figure.
pub fn readback_sigma(pins: &[Pin], rig: &Rig) -> f64 {
    let range = rig.airframe.sticks.max - rig.airframe.sticks.min;
    let least = 1e-5 * range; // numerical
    let neighbours: Vec<f64> = pins
        .windows(2)
        .filter(|pair| pair[0].commanded == pair[1].commanded)
        .map(|pair| (pair[1].readback - pair[0].readback).abs() / std::f64::consts::SQRT_2)
        .collect();
    let told = (rig.output.readback_noise_fraction * range).max(1e-4 * range); // numerical
    let enough = neighbours.len() >= LEAST_NEIGHBOURS;
    let still = if enough { median_high(neighbours).map_or(told, |m| m / MEDIAN_OF_NORMAL) } else { told };
    let off = pins.iter().map(|pin| (pin.readback - pin.commanded).abs()).collect();
    let all = median_high(off).map_or(told, |m| m / MEDIAN_OF_NORMAL);
    // Most readbacks are as commanded: they are more than the neighbours, so the better estimate.
    (if all < 1.5 * still { all } else { still }).max(least)
}

/// Where what follows through play of such a width is that was at `held` before.
pub fn dragged(held: f64, told: f64, width: f64) -> f64 {
    held.clamp(told - 0.5 * width, told + 0.5 * width)
}

/// What the rig's own actuator effects make of commands on their way to the pins.
struct Drive(Effects);

impl Drive {
    fn new(rig: &Rig) -> Self {
        let mut effects = Effects::default();
        for (effect, values) in known(rig).iter() {
            effects.add(*effect, values, &rig.airframe, 0);
        }
        Self(effects)
    }

    fn throttle(&mut self, sticks: &Sticks) -> f64 {
        let mut sticks = *sticks;
        for effect in &mut self.0.actuator {
            effect.drive(&mut sticks);
        }
        sticks.throttle
    }
}

/// Commands with the readback that follows each.
pub(crate) fn pins(flight: &Flight, rig: &Rig) -> Vec<Pin> {
    let mut drive = Drive::new(rig);
    let mut readbacks = flight.readbacks.iter().peekable();
    let mut pins = Vec::with_capacity(flight.commands.len());
    for (i, command) in flight.commands.iter().enumerate() {
        let until = flight.commands.get(i + 1).map_or(Time::from_nanos(u64::MAX), |next| next.time);
        while readbacks.next_if(|readback| readback.time < command.time).is_some() {}
        let Some(found) = readbacks.next_if(|readback| readback.time < until) else { continue };
        let (asked, readback) = (drive.throttle(&command.sticks), found.readback.sticks.throttle);
        if asked.is_finite() && readback.is_finite() {
            // A command between two steps may have gone either way: recordings round it.
            let near = |value: f64| rig.output.expected_on_the_pin(&rig.airframe.sticks, value);
            let slack = TIE * (rig.airframe.sticks.max - rig.airframe.sticks.min);
            let commanded = [near(asked), near(asked - slack), near(asked + slack)]
                .into_iter()
                .min_by(|a, b| (a - readback).abs().total_cmp(&(b - readback).abs()))
                .unwrap_or(asked);
            let round_trip_s = found.time.since_s(command.time);
            let delay_s = match rig.bench {
                Bench::Virtual => 0.0,
                // The virtual airframe flies from what was read back, once it was.
                Bench::Loopback => round_trip_s,
                Bench::Transmitter => 0.5 * round_trip_s,
            };
            pins.push(Pin { time_s: command.time.seconds() + delay_s, delay_s, asked, commanded, readback });
        }
    }
    pins
}

/// Commands so close to the middle between two steps of the output may be rounded either way, as a fraction of the range.
const TIE: f64 = 5e-5; // numerical

/// What the pins held: the rounded command, or the readback where it plainly says otherwise.
pub(crate) fn inputs(flight: &Flight, rig: &Rig, pins: &[Pin]) -> Vec<Input> {
    let sigma = readback_sigma(pins, rig);
    let read_back = !pins.is_empty();
    let mut pins = pins.iter().peekable();
    let mut drive = Drive::new(rig);
    let mut before = rig.airframe.sticks.min;
    flight
        .commands
        .iter()
        .filter(|command| command.sticks.throttle.is_finite())
        .map(|command| {
            let time_s = command.time.seconds();
            let commanded =
                rig.output.expected_on_the_pin(&rig.airframe.sticks, drive.throttle(&command.sticks));
            let input = match pins.next_if(|pin| pin.time_s - pin.delay_s <= time_s) {
                Some(pin) => {
                    let plainly_off = (pin.readback - pin.commanded).abs() > FAR_SIGMAS * sigma;
                    let throttle = if plainly_off { pin.readback } else { pin.commanded };
                    Input { time_s: pin.time_s, throttle }
                }
                // Without an answer the virtual airframe flies on from the one before.
                None if read_back && rig.bench == Bench::Loopback => Input { time_s, throttle: before },
                None => Input { time_s, throttle: commanded },
            };
            before = input.throttle;
            input
        })
        .collect()
}

/// Commands that a real output did not answer.
pub(crate) fn unanswered(flight: &Flight, rig: &Rig, pins: &[Pin]) -> usize {
    if rig.bench == Bench::Virtual || pins.is_empty() {
        0
    } else {
        flight.commands.len().saturating_sub(pins.len())
    }
}
