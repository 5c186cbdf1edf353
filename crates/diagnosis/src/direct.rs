//! What can be read without a model of flight: readbacks against commands, the loop's lateness, frames that are late or
//! lost.
//!
//! Each channel has its own likelihood, in which effects of its stage compete with ordinary behaviour. A channel's
//! evidence adds to the evidence of the filter, which is fed with what the pins held and when.

use bench_plant::effects::{LIBRARY, index_of};
use bench_rig::Rig;
use serde::Serialize;

use crate::{
    cycle::cycle,
    frame_clock::TOGETHER_S,
    law::known,
    track::{Pin, Track},
};

/// What the direct channels say.
#[derive(Clone, Debug, Default)]
pub struct Direct {
    /// Effects with a gain of log-likelihood over ordinary behaviour.
    pub effects: Vec<DirectEffect>,
    /// The lag of pins that were read on their way at a time that nobody knows: what they held is what it makes of the commands.
    pub lag_of_pins: Option<usize>,
    /// Log-likelihood that the pins' own stage leaves on the table: no law of the library explains the readback.
    pub unexplained_pins: f64,
    /// What was seen, for people.
    pub findings: Vec<Finding>,
}

impl Direct {
    /// Whether the readback says that pins do not hold what they were told.
    pub fn doubts_pins(&self) -> bool {
        self.unexplained_pins > 0.0 || self.effects.iter().any(|found| found.channel == "readback")
    }
}

/// An effect that a direct channel speaks for.
#[derive(Clone, Debug)]
pub struct DirectEffect {
    /// Library index.
    pub effect: usize,
    /// Where it was read. Effects of one channel explain the same.
    pub channel: &'static str,
    /// Gain of log-evidence over ordinary behaviour, nats.
    pub gain: f64,
    /// Its parameters in the order of the library.
    pub values: Vec<f64>,
    /// One sigma of each, as a fraction of the value.
    pub relative_sigma: f64,
}

/// A sentence of evidence.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// Channel: `readback`, `round trip`, `answers`, `ticks`, `frames` or `arrivals`.
    pub channel: &'static str,
    /// What was found.
    pub text: String,
}

fn library(name: &str) -> usize {
    index_of(name).unwrap_or_default()
}

/// Reads the direct channels of all flights.
pub fn direct(tracks: &[Track], rig: &Rig) -> Direct {
    let mut out = Direct::default();
    pins(tracks, rig, &mut out);
    answers(tracks, rig, &mut out);
    ticks(tracks, &mut out);
    frames(tracks, rig, &mut out);
    arrivals(tracks, rig, &mut out);
    // What the rig says is there is no finding.
    let known = known(rig);
    out.effects.retain(|found| known.iter().all(|(effect, _)| *effect != found.effect));
    out
}

/// Squared residuals of a readback count at most so many sigma squared: a hypothesis wins by many samples, not by one.
const CAP: f64 = 30.0;
/// Nats that a law with a free number must gain.
const LAW_COST: f64 = 8.0;
/// Share of its gain that a law of another form may leave unexplained.
const FORM_SHARE: f64 = 0.3;
/// Steps of its own that a law has which an output rounds again, as a fraction of the output's: from, to, how many are
/// tried, and on how many readbacks.
const FINEST: f64 = 0.2;
const COARSEST: f64 = 3.0;
const FINE_STEPS: u32 = 2_000;
const FINE_PINS: usize = 500;
/// Treads are found on so many readbacks, each costs so many nats, for its level and where it begins, and moves no pin by more
/// than so many mean rises.
const TREAD_PINS: usize = 1_500;
const TREAD_COST: f64 = 6.0;
const LONGEST_TREAD: f64 = 2.2;
/// Where in a period a pin may have been read, in logs that do not say.
const READ_AFTER: [f64; 6] = [0.0, 0.1, 0.3, 0.5, 0.7, 0.95];
/// Fewest flights whose scales are compared, and nats that each one's costs.
const LEAST_FLIGHTS: usize = 3;
const SCALE_COST: f64 = 1.0;
/// Readbacks nearer than this to a scale tell it.
const NEAR_SIGMAS: f64 = 4.0;
/// Fewest neighbours under the same command that show the readback's noise.
const LEAST_NEIGHBOURS: usize = 10;
/// Median of a normal's magnitude over its deviation.
pub(crate) const MEDIAN_OF_NORMAL: f64 = 0.6745;

pub(crate) fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

/// One sigma of the readback's noise: from what differs from the command where that is all noise, else from neighbours
/// under the same command, else the rig's figure.
pub(crate) fn readback_sigma(pins: &[Pin], rig: &Rig) -> f64 {
    let range = rig.airframe.sticks.max - rig.airframe.sticks.min;
    let least = 1e-5 * range;
    let neighbours: Vec<f64> = pins
        .windows(2)
        .filter(|pair| pair[0].commanded == pair[1].commanded)
        .map(|pair| (pair[1].readback - pair[0].readback).abs() / std::f64::consts::SQRT_2)
        .collect();
    let told = (rig.output.readback_noise_fraction * range).max(1e-4 * range);
    let enough = neighbours.len() >= LEAST_NEIGHBOURS;
    let still = if enough { median(neighbours).map_or(told, |m| m / MEDIAN_OF_NORMAL) } else { told };
    let off = pins.iter().map(|pin| (pin.readback - pin.commanded).abs()).collect();
    let all = median(off).map_or(told, |m| m / MEDIAN_OF_NORMAL);
    // Most readbacks are as commanded: they are more than the neighbours, so the better estimate.
    (if all < 1.5 * still { all } else { still }).max(least)
}

/// A law of the pins: what each holds, iteration by iteration of a flight.
struct PinLaw {
    effect: usize,
    /// Half the squared residuals, capped, in sigmas.
    excess: f64,
    values: Vec<f64>,
}

/// What scales that differ between flights explain.
struct Scales {
    /// Half the squared residuals, capped, in sigmas.
    excess: f64,
    /// Gain over one scale, nats.
    gain: f64,
    /// Between the largest and the smallest.
    spread: f64,
}

/// Half a squared residual in sigmas, capped.
fn capped(off: f64, sigma: f64) -> f64 {
    (0.5 * (off / sigma).powi(2)).min(CAP)
}

struct PinChannel<'a> {
    rig: &'a Rig,
    flights: Vec<&'a [Pin]>,
    sigma: f64,
    /// One step of the output.
    step: f64,
}

impl PinChannel<'_> {
    /// Excess of one flight under a law that says what a pin is told to hold, before rounding.
    fn flight(&self, pins: &[Pin], law: &mut dyn FnMut(&Pin, bool) -> f64) -> f64 {
        let mut sum = 0.0;
        for (i, pin) in pins.iter().enumerate() {
            let told = law(pin, i == 0);
            // Where a law bends the command, the step it then rounds to hangs on its numbers' last digits.
            let (at, sigma) = if told == pin.asked {
                (pin.commanded, self.sigma)
            } else {
                (told, self.sigma.hypot(self.step / 12_f64.sqrt()))
            };
            sum += capped(pin.readback - at, sigma) + (sigma / self.sigma).ln();
        }
        sum
    }

    fn all(&self, mut law: impl FnMut(&Pin, bool) -> f64) -> f64 {
        self.flights.iter().map(|pins| self.flight(pins, &mut law)).sum()
    }

    /// The same under a law that says what a pin holds of what the output has rounded.
    fn behind_the_output(&self, mut law: impl FnMut(&Pin, bool) -> f64) -> f64 {
        let of_flight = |pins: &&[Pin]| -> f64 {
            let off = |(i, pin): (usize, &Pin)| capped(pin.readback - law(pin, i == 0), self.sigma);
            pins.iter().enumerate().map(off).sum()
        };
        self.flights.iter().map(of_flight).sum()
    }

    /// A level that the pin does not pass, upwards or downwards, softly or hard, its own in each flight as supplies fade.
    fn saturation(&self) -> Option<PinLaw> {
        let ends = [1.0, -1.0].into_iter().flat_map(|up| {
            [0.0, 0.002, 0.005, 0.012].into_iter().map(move |softness| self.limit(up, softness))
        });
        ends.min_by(|a, b| a.excess.total_cmp(&b.excess))
    }

    /// The same in one direction, with one softness.
    fn limit(&self, up: f64, softness: f64) -> PinLaw {
        let a = &self.rig.airframe;
        let (min, max) = (a.sticks.min, a.sticks.max);
        let softness = softness * (max - min);
        let ratio =
            |level: f64| a.thrust.gain_n_per_unit.value * (level - a.thrust.offset.value) / a.weight_n();
        let (mut excess, mut levels) = (0.0, Vec::new());
        for pins in &self.flights {
            // Of what was asked for, how far along the way from the other end of the range.
            let along = |throttle: f64| if up > 0.0 { throttle - min } else { max - throttle };
            let furthest = pins.iter().map(|pin| along(pin.asked)).fold(f64::MIN, f64::max);
            let at = |level: f64| {
                let beyond = |pin: &Pin| {
                    let over = along(pin.asked) - level;
                    if softness == 0.0 {
                        over.max(0.0)
                    } else if over < -8.0 * softness {
                        0.0
                    } else {
                        softness * (over / softness).min(40.0).exp().ln_1p().max(over / softness)
                    }
                };
                // The stick at its lower end may stop the motors, floor or not.
                let off = |pin: &Pin| {
                    up < 0.0 && pin.asked <= min && 2.0 * (pin.readback - pin.asked) < beyond(pin)
                };
                let told = |pin: &Pin| if off(pin) { pin.asked } else { pin.asked - up * beyond(pin) };
                (self.flight(pins, &mut |pin, _| told(pin)), level)
            };
            let step = 0.01 * furthest;
            let coarse = (0..60).map(|i| at(furthest - step * f64::from(i)));
            let near = coarse.min_by(|a, b| a.0.total_cmp(&b.0));
            let finer = near.into_iter().flat_map(|(_, level)| {
                (-9..10).map(move |i| (level + 0.1 * step * f64::from(i)).min(furthest))
            });
            if let Some((value, level)) = finer.map(at).min_by(|a, b| a.0.total_cmp(&b.0)) {
                excess += value;
                if level < furthest {
                    levels.push(if up > 0.0 { min + level } else { max - level });
                }
            }
        }
        let effect = library("actuator-saturation");
        let told = median(levels).map(ratio);
        let mut values: Vec<f64> = LIBRARY[effect].parameters.iter().filter_map(|p| p.neutral).collect();
        let end = usize::from(up < 0.0);
        let parameter = &LIBRARY[effect].parameters[end];
        values[end] = told.map_or(values[end], |told| told.clamp(parameter.min, parameter.max));
        PinLaw { effect, excess, values }
    }

    /// A scale of its own in each flight, as of a reference that drifts. `None` where flights are too few to differ.
    fn scales(&self) -> Option<Scales> {
        if self.flights.len() < LEAST_FLIGHTS {
            return None;
        }
        let min = self.rig.airframe.sticks.min;
        let scale = |pins: &[Pin]| {
            let above = || pins.iter().filter(|pin| pin.commanded > min);
            let rough = median(above().map(|pin| (pin.readback - min) / (pin.commanded - min)).collect())?;
            // A median needs half as many readbacks again for what least squares tell.
            let near = above().filter(|pin| {
                (pin.readback - min - rough * (pin.commanded - min)).abs() < NEAR_SIGMAS * self.sigma
            });
            let (xy, xx) = near.fold((0.0, 0.0), |(xy, xx), pin| {
                let x = pin.commanded - min;
                (xy + x * (pin.readback - min), xx + x * x)
            });
            Some(if xx > 0.0 { xy / xx } else { rough })
        };
        let excess = |pins: &[Pin], scale: f64| {
            let sizes =
                pins.iter().map(|pin| capped(pin.readback - min - scale * (pin.commanded - min), self.sigma));
            sizes.sum::<f64>()
        };
        let shared = scale(&self.flights.concat())?;
        let (mut gain, mut left, mut range) = (-LAW_COST, 0.0, (shared, shared));
        for pins in &self.flights {
            let own = scale(pins).unwrap_or(shared);
            left += excess(pins, own);
            gain += excess(pins, shared) - excess(pins, own) - SCALE_COST;
            range = (range.0.min(own), range.1.max(own));
        }
        Some(Scales { excess: left, gain, spread: range.1 - range.0 })
    }

    /// Coarse steps from rest, rounded or cut.
    fn quantisation(&self) -> Option<PinLaw> {
        let sticks = &self.rig.airframe.sticks;
        let range = sticks.max - sticks.min;
        let least = (1.2 * self.step / range).max(0.001);
        (0..160)
            .map(|i| least * (0.12_f64 / least).powf(f64::from(i) / 159.0) * range)
            .flat_map(|step| [0.5, 0.0].map(|shift| (step, shift)))
            .map(|(step, shift)| {
                let law = |x: f64| sticks.min + step * ((x - sticks.min) / step + shift).floor();
                (self.all(|pin, _| law(pin.asked)), step)
            })
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map(|(excess, step)| PinLaw {
                effect: library("actuator-quantisation"),
                excess,
                values: vec![step / range],
            })
    }

    /// Steps about as fine as the output's own, which rounds them again: what is told lies one of its steps off now and
    /// then.
    fn fine_quantisation(&self) -> Option<PinLaw> {
        let sticks = &self.rig.airframe.sticks;
        let output = &self.rig.output;
        let excess = |pins: &mut dyn Iterator<Item = &Pin>, step: f64| -> f64 {
            pins.map(|pin| {
                let told = sticks.min + step * ((pin.asked - sticks.min) / step).round();
                capped(pin.readback - output.expected_on_the_pin(sticks, told), self.sigma)
            })
            .sum()
        };
        let pins = || self.flights.iter().flat_map(|pins| pins.iter());
        let stride = pins().count().div_ceil(FINE_PINS);
        (0..FINE_STEPS)
            .map(|i| self.step * FINEST * (COARSEST / FINEST).powf(f64::from(i) / f64::from(FINE_STEPS - 1)))
            .map(|step| (excess(&mut pins().step_by(stride), step), step))
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map(|(_, step)| PinLaw {
                effect: library("actuator-quantisation"),
                excess: excess(&mut pins(), step),
                values: vec![step / (sticks.max - sticks.min)],
            })
    }

    /// Treads of any length: what the pin holds is constant between some commands, found by dynamic programming over the
    /// commands in their order (Bellman, *On the approximation of curves by line segments using dynamic programming*,
    /// Communications of the ACM 4(6), 1961).
    fn treads(&self) -> Option<PinLaw> {
        let sticks = &self.rig.airframe.sticks;
        let mut moved: Vec<&Pin> =
            self.flights.iter().flat_map(|pins| pins.iter()).filter(|pin| pin.asked > sticks.min).collect();
        moved.sort_by(|a, b| a.asked.total_cmp(&b.asked));
        let stride = moved.len().div_ceil(TREAD_PINS).max(1);
        let shown: Vec<&Pin> = moved.iter().copied().step_by(stride).collect();
        let first = shown.first()?;
        // Sums up to each pin, from the first readback: differences of squares must not be lost.
        let mut sums = vec![(0.0, 0.0)];
        for (i, pin) in shown.iter().enumerate() {
            let off = (pin.readback - first.readback) / self.sigma;
            sums.push((sums[i].0 + off, sums[i].1 + off * off));
        }
        let off = |from: usize, to: usize| {
            let (sum, square) = (sums[to].0 - sums[from].0, sums[to].1 - sums[from].1);
            0.5 * (square - sum * sum / (to - from) as f64)
        };
        // The least excess of all pins before one, and where the last tread before it begins.
        let mut least: Vec<(f64, usize)> = vec![(0.0, 0)];
        for to in 1..=shown.len() {
            let best = (0..to)
                .filter(|from| *from == 0 || shown[*from].asked > shown[*from - 1].asked)
                .map(|from| (least[from].0 + off(from, to) + TREAD_COST, from))
                .min_by(|a, b| a.0.total_cmp(&b.0))?;
            least.push(best);
        }
        // From where on, and what the pin holds there.
        let mut treads: Vec<(f64, f64)> = Vec::new();
        let mut to = shown.len();
        while to > 0 {
            let from = least[to].1;
            let level = shown[from..to].iter().map(|pin| pin.readback).sum::<f64>() / (to - from) as f64;
            treads.push((shown[from].asked, level));
            to = from;
        }
        treads.reverse();
        let mut commands: Vec<f64> = moved.iter().map(|pin| pin.commanded).collect();
        commands.dedup();
        if treads.len() < 3 || treads.len() >= commands.len() {
            return None;
        }
        let (_, lowest) = *treads.first()?;
        let step = (treads.last()?.1 - lowest) / (treads.len() - 1) as f64;
        let excess = self.all(|pin, _| {
            if pin.asked <= sticks.min {
                return pin.asked;
            }
            let above = treads.partition_point(|(from, _)| *from <= pin.asked);
            let (_, level) = treads[above.saturating_sub(1)];
            // A tread moves a pin by no more than its length, a limit does.
            if (level - pin.asked).abs() < LONGEST_TREAD * step { level } else { pin.asked }
        });
        let excess = excess + TREAD_COST * treads.len() as f64;
        Some(PinLaw {
            effect: library("actuator-quantisation"),
            excess,
            values: vec![step / (sticks.max - sticks.min)],
        })
    }

    /// Whether readbacks are answers, so that their times tell when they were taken.
    fn answered(&self) -> bool {
        self.flights.iter().any(|pins| pins.iter().any(|pin| pin.delay_s > 0.0))
    }

    /// The pin follows with a first-order lag, and is read on its way: when, where no answer tells, is tried.
    fn lag(&self) -> Option<PinLaw> {
        let excess = |time_constant_s: f64, read_s: f64| {
            let left = |s: f64| (-s.max(0.0) / time_constant_s).exp();
            // Where the pin was when it was told, what it was told, and when.
            let (mut was, mut told, mut told_s) = (0.0, 0.0, 0.0);
            self.behind_the_output(|pin, first| {
                let now_s = pin.time_s - pin.delay_s;
                was = if first { pin.asked } else { told + (was - told) * left(now_s - told_s) };
                (told, told_s) = (pin.commanded, now_s);
                told + (was - told) * left(pin.delay_s + read_s)
            })
        };
        let read: &[f64] = if self.answered() { &[0.0] } else { &READ_AFTER };
        read.iter()
            .map(|share| share * self.rig.control_loop.period_s)
            .flat_map(|read_s| {
                (0..60).map(move |i| (0.003 * (0.5_f64 / 0.003).powf(f64::from(i) / 59.0), read_s))
            })
            .map(|(time_constant_s, read_s)| PinLaw {
                effect: library("actuator-lag"),
                excess: excess(time_constant_s, read_s),
                values: vec![time_constant_s],
            })
            .min_by(|a, b| a.excess.total_cmp(&b.excess))
    }

    /// Play behind the output, of what it has rounded: less than one of its steps shows, too.
    fn play(&self) -> Option<PinLaw> {
        let range = self.rig.airframe.sticks.max - self.rig.airframe.sticks.min;
        let excess = |width: f64| {
            let mut held = 0.0;
            self.behind_the_output(|pin, first| {
                if first {
                    held = pin.commanded;
                }
                held = held.clamp(pin.commanded - 0.5 * width, pin.commanded + 0.5 * width);
                held
            })
        };
        (0..120)
            .map(|i| 0.0005 * (0.15_f64 / 0.0005).powf(f64::from(i) / 119.0) * range)
            .map(|width| PinLaw {
                effect: library("actuator-backlash"),
                excess: excess(width),
                values: vec![width / range],
            })
            .min_by(|a, b| a.excess.total_cmp(&b.excess))
    }

    /// Play: the pin is dragged along, or sticks and jumps.
    fn backlash(&self, jumps: bool) -> Option<PinLaw> {
        let sticks = &self.rig.airframe.sticks;
        let range = sticks.max - sticks.min;
        let excess = |width: f64, creep: f64| {
            let mut held = 0.0;
            self.all(|pin, first| {
                if first {
                    held = pin.asked;
                }
                if !jumps {
                    let dragged = held.clamp(pin.asked - 0.5 * width, pin.asked + 0.5 * width);
                    held = dragged + creep * (pin.asked - dragged);
                    return held;
                }
                // What sticks is where the output's own rounding put it.
                if (pin.asked - held).abs() > 0.5 * width || pin.asked == sticks.min {
                    held = pin.commanded;
                    return pin.asked;
                }
                held
            })
        };
        let creeps: &[f64] = if jumps { &[0.0] } else { &[0.0, 0.07, 0.14] };
        let try_all = |widths: &mut dyn Iterator<Item = f64>| {
            widths
                .flat_map(|width| creeps.iter().map(move |creep| (width, *creep)))
                .map(|(width, creep)| (excess(width, creep), width))
                .min_by(|a, b| a.0.total_cmp(&b.0))
        };
        let coarse = (0..60).map(|i| 0.0015 * (0.15_f64 / 0.0015).powf(f64::from(i) / 59.0) * range);
        let (_, about) = try_all(&mut { coarse })?;
        // One jump missed is many residuals: the width must be right to a fraction of a step.
        let fine = (-40..=40).map(|i| about * (1.0 + 0.002 * f64::from(i)));
        let (excess, width) = try_all(&mut { fine })?;
        Some(PinLaw { effect: library("actuator-backlash"), excess, values: vec![width / range] })
    }
}

fn pins(tracks: &[Track], rig: &Rig, out: &mut Direct) {
    let flights: Vec<&[Pin]> = tracks.iter().map(|t| t.pins.as_slice()).filter(|p| p.len() > 10).collect();
    if flights.is_empty() {
        return;
    }
    let all: Vec<Pin> = flights.iter().flat_map(|pins| pins.iter().copied()).collect();
    let range = rig.airframe.sticks.max - rig.airframe.sticks.min;
    let step = rig.output.step(&rig.airframe.sticks);
    let noise = readback_sigma(&all, rig);
    // Steps in places of their own are as good as noise.
    let sigma = if rig.output.own_step.is_some() { noise.hypot(step / 12_f64.sqrt()) } else { noise };
    let channel = PinChannel { rig, flights, sigma, step };
    let ordinary = channel.all(|pin, _| pin.asked);
    // The noise is itself estimated from these readbacks, the fewer the worse.
    let readbacks = all.len() as f64;
    let floor = (1.15 + 5.0 / readbacks.sqrt()) * 0.5 * readbacks + 10.0;
    let scales = channel.scales().filter(|scales| scales.gain > 0.0 && scales.excess < floor);
    if scales.is_none() && ordinary - floor < LAW_COST {
        return;
    }
    let (lag, play) = (channel.lag(), channel.play());
    // No law of the library changes a scale. Where that leaves but noise, none of those with many numbers is asked for more.
    let gain = |law: &PinLaw| ordinary - law.excess - LAW_COST;
    let plain = [&lag, &play].into_iter().flatten().map(gain).fold(0.0, f64::max);
    if let Some(scales) = scales.filter(|scales| scales.gain > plain) {
        out.findings.push(Finding {
            channel: "readback",
            text: format!(
                "the scale of readback over command differs between flights by up to {:.2} %",
                100.0 * scales.spread
            ),
        });
        out.unexplained_pins = scales.gain.min(MOST_DIRECT);
        return;
    }
    let mut laws: Vec<PinLaw> = [
        channel.saturation(),
        channel.quantisation(),
        channel.fine_quantisation(),
        channel.treads(),
        lag,
        play,
        channel.backlash(false),
        channel.backlash(true),
    ]
    .into_iter()
    .flatten()
    .collect();
    laws.sort_by(|a, b| a.excess.total_cmp(&b.excess));
    let Some((leading, best)) = laws.first().map(|law| (law.effect, law.excess)) else { return };
    out.lag_of_pins = (leading == library("actuator-lag") && !channel.answered()).then_some(leading);
    out.unexplained_pins = (best - floor - FORM_SHARE * (ordinary - best)).max(0.0);
    // They explain the same readbacks: what the best has over another counts in full.
    let most = (ordinary - best - LAW_COST).min(MOST_DIRECT);
    for law in laws {
        let gain = most - (law.excess - best);
        if gain > 0.0 && out.effects.iter().all(|other| other.effect != law.effect) {
            out.effects.push(DirectEffect {
                effect: law.effect,
                channel: "readback",
                gain,
                values: law.values,
                relative_sigma: 0.05,
            });
        }
    }
    let off = all.iter().filter(|p| (p.readback - p.commanded).abs() > 4.0 * sigma).count();
    out.findings.push(Finding {
        channel: "readback",
        text: format!(
            "{off} of {} readbacks differ from the command by more than four sigma of their noise ({:.2} % of the range)",
            all.len(),
            100.0 * sigma / range
        ),
    });
}

/// A channel's likelihood is not exact: so many nats are as good as certain.
const MOST_DIRECT: f64 = 60.0;

/// A command's way to a real output that any serial port has, s.
const ORDINARY_WAY_S: f64 = 0.006;

/// How late a real output follows, and what it does not answer.
fn answers(tracks: &[Track], rig: &Rig, out: &mut Direct) {
    let Some(typical_s) = median(tracks.iter().flat_map(|t| &t.pins).map(|pin| pin.delay_s).collect()) else {
        return;
    };
    let answered: usize = tracks.iter().map(|t| t.pins.len()).sum();
    if typical_s > ORDINARY_WAY_S {
        out.findings.push(Finding {
            channel: "round trip",
            text: format!("the output follows its commands {:.0} ms late in the median", 1e3 * typical_s),
        });
        let ratio = typical_s / ORDINARY_WAY_S;
        let gain = answered as f64 * (0.5 * (ratio * ratio - 1.0) - ratio.ln()) - LAW_COST;
        if gain > 0.0 && out.effects.iter().all(|other| other.effect != library("actuator-lag")) {
            out.effects.push(DirectEffect {
                effect: library("actuator-lag"),
                channel: "round trip",
                gain: gain.min(MOST_DIRECT),
                values: vec![typical_s],
                relative_sigma: 0.1,
            });
        }
    }
    let unanswered: usize = tracks.iter().map(|t| t.unanswered).sum();
    let (k, n) = (unanswered as f64, (answered + unanswered) as f64);
    let share = k / n;
    if k < 1.0 || share <= ORDINARY_LOSS {
        return;
    }
    let gain = k * (share / ORDINARY_LOSS).ln() - (n - k) * (share - ORDINARY_LOSS) - LAW_COST;
    if gain > 0.0 {
        out.findings.push(Finding {
            channel: "answers",
            text: format!(
                "{unanswered} of {n} commands were not answered: the pins may have kept what they held"
            ),
        });
        // A command that is lost comes with the next iteration's.
        out.effects.push(DirectEffect {
            effect: library("loop-overrun"),
            channel: "answers",
            gain: gain.min(MOST_DIRECT),
            values: vec![share, rig.control_loop.period_s],
            relative_sigma: k.sqrt().recip(),
        });
    }
}

/// Fewest iterations of which anything is told.
const LEAST_TICKS: usize = 50;
/// Lateness that any soft real-time loop has, s: below, nothing is told.
const ORDINARY_LATENESS_S: f64 = 0.001;
/// Less than this in turn is the beat of two clocks, s.
const LATE_IN_TURN_S: f64 = 0.002;
/// So many scales of the ordinary beyond the median an iteration is late.
const LATE_SCALES: f64 = 8.0;

fn ticks(tracks: &[Track], out: &mut Direct) {
    let flights: Vec<&[f64]> = tracks.iter().map(|track| track.lateness_s.as_slice()).collect();
    let mut all = flights.concat();
    if all.len() < LEAST_TICKS {
        return;
    }
    all.sort_by(f64::total_cmp);
    let tail = late_tail(&all);
    let in_turn = cycle(&flights)
        .filter(|cycle| cycle.gain > LAW_COST && cycle.later_s > LATE_IN_TURN_S)
        .map(|cycle| {
            let text = format!(
                "in turn, one in {} of {} iterations started late, by {:.1} ms in the mean",
                cycle.length,
                all.len(),
                1e3 * cycle.later_s
            );
            (cycle.gain - LAW_COST, vec![(cycle.length as f64).recip(), cycle.later_s], text)
        });
    let best = [tail, in_turn].into_iter().flatten().max_by(|a, b| a.0.total_cmp(&b.0));
    if let Some((gain, values, text)) = best {
        let late = values[0] * all.len() as f64;
        out.findings.push(Finding { channel: "ticks", text });
        out.effects.push(DirectEffect {
            effect: library("loop-overrun"),
            channel: "ticks",
            gain: gain.min(MOST_DIRECT),
            values,
            relative_sigma: late.sqrt().recip(),
        });
    }
}

/// What of sorted lateness, s, lies beyond the ordinary: gain, the share of iterations and their mean lateness, and that in words.
fn late_tail(all: &[f64]) -> Option<(f64, Vec<f64>, String)> {
    let median = all[all.len() / 2];
    let upper = all[all.len() * 3 / 4] - median;
    // The scale of an exponential tail, from its quartile above the median (ln 2 of it), and not below the ordinary; then,
    // as clocks that count milliseconds blur quartiles, from the mean of all that is not late by that, where that is less.
    let late_by = |scale: f64| median + LATE_SCALES * scale;
    let coarse = (upper / std::f64::consts::LN_2).max(ORDINARY_LATENESS_S);
    let above = all.iter().filter(|x| (median..=late_by(coarse)).contains(*x)).map(|x| x - median);
    let scale = (above.clone().sum::<f64>() / above.count() as f64).clamp(ORDINARY_LATENESS_S, coarse);
    let threshold = late_by(scale);
    let late: Vec<f64> = all.iter().filter(|x| **x > threshold).map(|x| x - median).collect();
    let (n, k) = (all.len() as f64, late.len() as f64);
    let mean = late.iter().sum::<f64>() / k;
    let share = k / n;
    // Exponential waits of that mean at that rate, against the tail of the ordinary.
    let gain = late.iter().map(|x| (share / mean).ln() - x / mean + x / scale + scale.ln()).sum::<f64>()
        - (n - k) * share
        - LAW_COST;
    if gain <= 0.0 {
        return None;
    }
    let text = format!(
        "{} of {} iterations started late, by {:.0} ms in the mean and {:.0} ms at most",
        late.len(),
        all.len(),
        1e3 * mean,
        1e3 * late.iter().copied().fold(0.0, f64::max)
    );
    Some((gain, vec![share, mean], text))
}

/// Share of frames that any tracker may lose.
const ORDINARY_LOSS: f64 = 5e-4;

fn frames(tracks: &[Track], rig: &Rig, out: &mut Direct) {
    let told: usize = tracks.iter().map(|t| t.frames_told).sum();
    let bursts: Vec<usize> = tracks.iter().flat_map(|t| t.bursts.iter().copied()).collect();
    let lost: usize = bursts.iter().sum();
    if told < 50 || lost == 0 {
        return;
    }
    let n = (told + lost) as f64;
    let ordinary = rig.tracker.dropout_probability.max(ORDINARY_LOSS);
    // Gilbert's chain against single losses at the ordinary rate.
    let k = bursts.len() as f64;
    let rate = k / n;
    let stay = ((lost as f64 - k) / lost as f64).clamp(0.02, 0.98);
    let gain = k * (rate / ordinary).ln() - (n - lost as f64) * (rate - ordinary)
        + (lost as f64 - k) * (stay / ordinary).ln()
        + k * (1.0 - stay).ln()
        - LAW_COST;
    if gain > 0.0 && rate > ordinary {
        let mean = lost as f64 / k;
        out.findings.push(Finding {
            channel: "frames",
            text: format!("{lost} of {} frames are missing, in {} bursts", told + lost, bursts.len()),
        });
        out.effects.push(DirectEffect {
            effect: library("tracker-dropout"),
            channel: "frames",
            gain: gain.min(MOST_DIRECT),
            values: vec![lost as f64 / n, mean],
            relative_sigma: k.sqrt().recip(),
        });
    }
}

/// Spread of arrivals about a regular clock that any bus has, s.
const ORDINARY_JITTER_S: f64 = 0.0018;

/// Share of frames that come with the one before, from which on they wait in a queue.
const QUEUED: f64 = 0.1;

fn arrivals(tracks: &[Track], rig: &Rig, out: &mut Direct) {
    let (mut n, mut fast, mut slow, mut wait) = (0.0, 0.0, 0.0, 0.0);
    let (mut together, mut own_s) = (0.0, 0.0);
    for track in tracks {
        if track.waits_s.len() < 50 {
            continue;
        }
        let waits = &track.waits_s;
        let mean = waits.iter().sum::<f64>() / waits.len() as f64;
        wait += waits.iter().sum::<f64>();
        n += waits.len() as f64;
        slow += waits.iter().map(|w| (w - mean).powi(2)).sum::<f64>();
        for w in waits.windows(2) {
            fast += 0.5 * (w[1] - w[0]).powi(2);
            // What the frame before leaves of its wait when the next is exposed, that one waits too; then its own, which
            // does not remember how long it has lasted.
            let rest = w[0] - rig.tracker.frame_period_s;
            if rest <= 0.0 {
                own_s += w[1];
            } else if w[1] - rest < TOGETHER_S {
                together += 1.0;
            } else {
                own_s += w[1] - rest - TOGETHER_S;
            }
        }
    }
    if n < 100.0 {
        return;
    }
    let (fast, slow) = ((fast / n).sqrt(), (slow / n).sqrt());
    let gain = |spread: f64| {
        let ratio = spread / ORDINARY_JITTER_S;
        if ratio > 1.0 { n * (0.5 * (ratio * ratio - 1.0) - ratio.ln()) - LAW_COST } else { 0.0 }
    };
    // Waits that do not remember one another: a queue. Waits that do: a latency that moves.
    let queued = together > QUEUED * n;
    if gain(fast) > 0.0 && (queued || fast > 0.6 * slow) {
        out.findings.push(Finding {
            channel: "arrivals",
            text: format!("frames arrive {:.1} ms (one sigma) off a regular clock", 1e3 * slow),
        });
        out.effects.push(DirectEffect {
            effect: library("tracker-jitter"),
            channel: "arrivals",
            gain: gain(fast).min(MOST_DIRECT),
            values: vec![if queued { own_s / (n - together) } else { fast }],
            relative_sigma: 0.05,
        });
    } else if gain(slow) > 0.0 {
        out.findings.push(Finding {
            channel: "arrivals",
            text: format!("the latency of frames wanders by {:.1} ms (one sigma)", 1e3 * slow),
        });
        out.effects.push(DirectEffect {
            effect: library("tracker-latency"),
            channel: "arrivals",
            gain: gain(slow).min(MOST_DIRECT),
            values: vec![wait / n],
            relative_sigma: 0.2,
        });
    }
}
