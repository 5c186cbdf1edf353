//! The sampled loop as it is: its frequency response, and what it forgives.
//!
//! The loop is cut at the output, where the plant begins, and a small sum of sines is added there once an iteration, while the
//! controller's own code holds the airframe in a lab without noise. With `u` what the controller asked for and `p` what
//! the plant got, the loop's gain at each of the sines is `L = -U/P` of their discrete Fourier transforms over a whole
//! period. Two flights with opposite signs are subtracted, which leaves neither launch nor trim nor anything even.
//! Delay, hold, frames and predictor are all in it, whatever the law is.
//!
//! Source: `L` at the plant's input and its margins, Skogestad and Postlethwaite, Multivariable Feedback Control, 2nd
//! edition, 2005, section 2.4; sines with phases of low crest, Schroeder, IEEE Transactions on Information Theory 16, 1970.

use std::f64::consts::{PI, TAU};

use bench_device::{DeviceError, Readback, Sticks, VoltageOutput};
use bench_plant::lab::{Lab, SimulatedOutput};
use bench_rig::{Mission, Model, PhaseAction, Profile, Rig};
use bench_run::{Ending, fly};
use nalgebra::Complex;
use serde::Serialize;

use crate::{
    draw::add_latency,
    flight::{Axis, lifted, quick},
};

/// A loop's frequency response at the plant's input.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Response {
    /// Frequencies, Hz, rising.
    pub frequency_hz: Vec<f64>,
    /// The loop's gain there: real and imaginary part.
    pub gain: Vec<[f64; 2]>,
}

/// What a stable loop forgives. `None`: nothing of that kind loses it below half the loop's rate.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Margins {
    /// By how much the loop's gain may rise, dB.
    pub gain_db: Option<f64>,
    /// By how much it may fall, dB.
    pub gain_reduction_db: Option<f64>,
    /// Phase margin, degrees.
    pub phase_deg: Option<f64>,
    /// By how much the delay may grow, s.
    pub delay_s: Option<f64>,
    /// Least distance of the response from -1.
    pub distance: f64,
    /// Highest frequency at which the loop's gain is one, Hz.
    pub crossover_hz: Option<f64>,
}

/// How long a period of the sines is, s: ten times what the slowest loop of interest takes.
const PERIOD_S: f64 = 40.0;
/// How long the flight settles before, s.
const SETTLED_S: f64 = 16.0;
/// Sines, evenly spaced in the logarithm as far as a period allows.
const LINES: usize = 64;
/// Highest of them, Hz: far above any loop through a delay of a frame or more.
const HIGHEST_HZ: f64 = 20.0;
/// Amplitude of the sum, as a share of what holds the airframe (or of a radian of tilt): small enough for every kink, large
/// enough for arithmetic.
const AMPLITUDE: f64 = 1e-4;
/// A loop that settles repeats itself from period to period but for this share of its power; one that grows or cycles does
/// not.
const CHANGED: f64 = 0.05;

impl Response {
    /// The response of the altitude loop in hold at `altitude_m`, with sightings late by `extra_s` beyond what the rig
    /// says. `None` where the loop does not settle: it is not stable.
    pub fn of_altitude(rig: &Rig, altitude_m: f64, extra_s: f64) -> Option<Self> {
        Self::of(rig, altitude_m, extra_s, Axis::Z)
    }

    /// The same of the lateral loop along the airframe's x.
    pub fn of_lateral(rig: &Rig, altitude_m: f64, extra_s: f64) -> Option<Self> {
        Self::of(rig, altitude_m, extra_s, Axis::X)
    }

    fn of(rig: &Rig, altitude_m: f64, extra_s: f64, axis: Axis) -> Option<Self> {
        let period_s = rig.control_loop.period_s;
        let samples = (PERIOD_S / period_s).round().max(8.0) as usize;
        let lines = lines(samples, period_s);
        let unit = match axis {
            Axis::Z => rig.airframe.throttle_for(rig.airframe.weight_n()) - rig.airframe.thrust.offset.value,
            Axis::X => rig.airframe.sticks.tilt_rad_per_unit.recip(),
        };
        if !unit.is_finite() {
            return None;
        }
        let amplitude = AMPLITUDE * unit / (lines.len() as f64).sqrt();
        let signal: Vec<f64> = (0..samples)
            .map(|n| {
                let angle = |(i, k): (usize, &usize)| {
                    TAU * (k * n % samples) as f64 / samples as f64 - PI * (i * i) as f64 / lines.len() as f64
                };
                amplitude * lines.iter().enumerate().map(|line| angle(line).cos()).sum::<f64>()
            })
            .collect();
        let plus = injected(rig, altitude_m, extra_s, axis, &signal, 1.0)?;
        let minus = injected(rig, altitude_m, extra_s, axis, &signal, -1.0)?;
        let difference: Vec<[f64; 2]> =
            plus.iter().zip(&minus).map(|(a, b)| [a[0] - b[0], a[1] - b[1]]).collect();
        let (before, period) = difference.split_at(difference.len().checked_sub(samples)?);
        // The later half of a period, by when what the beginning stirred up has gone.
        let half = samples / 2;
        let (last, same_before) = (&period[half..], &before[before.len().checked_sub(samples - half)?..]);
        let power = |values: &mut dyn Iterator<Item = f64>| values.map(|x| x * x).sum::<f64>();
        let changed = power(&mut last.iter().zip(same_before).map(|(a, b)| a[1] - b[1]));
        let repeats = changed < CHANGED * power(&mut last.iter().map(|x| x[1]));
        if !repeats {
            return None;
        }
        let transform = |of: usize, k: usize| {
            period.iter().enumerate().fold(Complex::new(0.0, 0.0), |sum, (n, x)| {
                sum + Complex::from_polar(x[of], -TAU * (k * n % samples) as f64 / samples as f64)
            })
        };
        let gain = lines.iter().map(|k| -transform(0, *k) / transform(1, *k));
        Some(Self {
            gain: gain.map(|gain| [gain.re, gain.im]).collect(),
            frequency_hz: lines.iter().map(|k| *k as f64 / (samples as f64 * period_s)).collect(),
        })
    }

    /// What the loop forgives, by straight lines between the frequencies.
    pub fn margins(&self) -> Margins {
        let gain: Vec<Complex<f64>> = self.gain.iter().map(|[re, im]| Complex::new(*re, *im)).collect();
        let mut margins = Margins {
            gain_db: None,
            gain_reduction_db: None,
            phase_deg: None,
            delay_s: None,
            distance: gain.iter().map(|l| (l + 1.0).norm()).fold(f64::INFINITY, f64::min),
            crossover_hz: None,
        };
        let least = |slot: &mut Option<f64>, x: f64| *slot = Some(slot.map_or(x, |least| least.min(x)));
        for (pair, hz) in gain.windows(2).zip(self.frequency_hz.windows(2)) {
            let [a, b] = [pair[0], pair[1]];
            if a.im * b.im <= 0.0 && a.im != b.im {
                let real = a.re + (b.re - a.re) * a.im / (a.im - b.im);
                let factor_db = -20.0 * (-real).log10();
                if real < 0.0 && factor_db >= 0.0 {
                    least(&mut margins.gain_db, factor_db);
                } else if real < 0.0 {
                    least(&mut margins.gain_reduction_db, -factor_db);
                }
            }
            let (size_a, size_b) = (a.norm().ln(), b.norm().ln());
            if size_a * size_b <= 0.0 && size_a != size_b {
                let share = size_a / (size_a - size_b);
                let angle = a.arg() + share * (b / a).arg();
                let at_hz = hz[0] * (hz[1] / hz[0]).powf(share);
                let over = (angle + PI).rem_euclid(TAU);
                least(&mut margins.phase_deg, over.min(TAU - over).to_degrees());
                least(&mut margins.delay_s, over / (TAU * at_hz));
                margins.crossover_hz = Some(at_hz);
            }
        }
        margins
    }
}

/// Whole cycles in a period, without repetition.
fn lines(samples: usize, period_s: f64) -> Vec<usize> {
    let most = (samples as f64 * 0.45).min(HIGHEST_HZ * samples as f64 * period_s);
    let mut lines: Vec<usize> = (0..LINES)
        .map(|i| most.powf(i as f64 / (LINES - 1) as f64).round() as usize)
        .filter(|k| *k >= 1)
        .collect();
    lines.dedup();
    lines
}

/// What the controller asked for and what the plant got, once an iteration, from two periods before the end on.
fn injected(
    rig: &Rig,
    altitude_m: f64,
    extra_s: f64,
    axis: Axis,
    signal: &[f64],
    sign: f64,
) -> Option<Vec<[f64; 2]>> {
    let period_s = rig.control_loop.period_s;
    let mut rig = rig.clone();
    // What the controller takes for noise stays; the lab has none, nor steps, nor limits to the flight.
    rig.output.bits = 0;
    rig.output.readback_noise_fraction = 0.0;
    rig.safety.flight_time_max_s = 3600.0;
    let model = if axis == Axis::Z { Model::Vertical } else { Model::SixDegree };
    let mut plant = quick(rig.clone(), model);
    plant.tracker.noise_m = 0.0;
    plant.tracker.resolution_m = 0.0;
    plant.tracker.dropout_probability = 0.0;
    plant.tracker.heading_noise_rad = None;
    add_latency(&mut plant, extra_s);
    let begin = (SETTLED_S / period_s).ceil() as usize;
    let count = begin + 2 * signal.len();
    let Lab { mut clock, output, mut tracker, .. } = Lab::new(&plant, 0).ok()?;
    let mut output = Injecting { inner: output, axis, signal, sign, begin, seen: Vec::with_capacity(count) };
    let hold = PhaseAction::Hold {
        altitude_m: Profile::constant(altitude_m),
        x_m: Profile::constant(0.0),
        y_m: Profile::constant(0.0),
        heading_rad: Profile::constant(0.0),
        chirp: None,
    };
    let mission = Mission { phases: lifted(hold, count as f64 * period_s), ..Mission::default() };
    let flown = fly((&mut clock, &mut output, &mut tracker), &rig, &mission, &mut (), |_, ()| true);
    let seen = output.seen.get(begin..count)?;
    (flown.ending == Ending::Complete).then(|| seen.to_vec())
}

/// An output with a signal added to one channel from an iteration on.
struct Injecting<'a> {
    inner: SimulatedOutput,
    axis: Axis,
    signal: &'a [f64],
    sign: f64,
    begin: usize,
    seen: Vec<[f64; 2]>,
}

impl VoltageOutput for Injecting<'_> {
    fn write(&mut self, mut sticks: Sticks) -> Result<(), DeviceError> {
        let channel = match self.axis {
            Axis::Z => &mut sticks.throttle,
            Axis::X => &mut sticks.pitch,
        };
        let asked = *channel;
        if let Some(since) = self.seen.len().checked_sub(self.begin) {
            *channel += self.sign * self.signal[since % self.signal.len()];
        }
        self.seen.push([asked, *channel]);
        self.inner.write(sticks)
    }

    fn read_back(&mut self) -> Result<Option<Readback>, DeviceError> {
        self.inner.read_back()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_margins_of_a_delayed_integrator_are_those_of_theory() {
        // L = k e^(-s T)/s: crossover k, phase margin pi/2 - k T, delay margin that over k, gain margin pi/(2 k T).
        let (k, delay_s) = (2.0, 0.3);
        let frequency_hz: Vec<f64> = (0..200).map(|i| 0.02 * 1.03_f64.powi(i)).collect();
        let gain = frequency_hz.iter().map(|hz| {
            let l = Complex::from_polar(k / (TAU * hz), -PI / 2.0 - TAU * hz * delay_s);
            [l.re, l.im]
        });
        let margins = Response { gain: gain.collect(), frequency_hz }.margins();
        let close = |found: Option<f64>, expected: f64| (found.unwrap() / expected - 1.0).abs() < 0.01;
        assert!(close(margins.crossover_hz, k / TAU), "{margins:?}");
        assert!(close(margins.phase_deg, (PI / 2.0 - k * delay_s).to_degrees()), "{margins:?}");
        assert!(close(margins.delay_s, (PI / 2.0 - k * delay_s) / k), "{margins:?}");
        assert!(close(margins.gain_db, 20.0 * (PI / (2.0 * k * delay_s)).log10()), "{margins:?}");
        assert_eq!(margins.gain_reduction_db, None);
    }
}
