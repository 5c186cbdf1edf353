//! The laws of a pin: what each holds of what it was told, by its readback.

use bench_filter::{Pin, Track, dragged, readback_sigma};
use bench_plant::effects::{LIBRARY, Reading, read_as};
use bench_rig::Rig;
use bench_statistics::{FAR_SIGMAS, evenly_in_log, median_high};
use rayon::prelude::*;

use crate::{
    chain::{Bend, chain},
    direct::{Direct, DirectEffect, Finding, LAW_COST, MOST_DIRECT},
};

/// Squared residuals of a readback count at most so many sigma squared: a hypothesis wins by many samples, not by one.
const CAP: f64 = 30.0;
/// Share of its gain that a law of another form may leave unexplained.
const FORM_SHARE: f64 = 0.3;
/// Share of the first's gain that a second law must gain, or what is left is the first's of another form.
const SECOND_SHARE: f64 = 0.02;
/// Steps of its own that a law has which an output rounds again, as a fraction of the output's: from, to, by what part of a step
/// those that are tried differ at the range's end, and on how many readbacks they are tried.
const FINEST: f64 = 0.2; // numerical
const COARSEST: f64 = 3.0; // numerical
const FINE_APART: f64 = 0.2; // numerical
/// More than an output of 8 bits needs: what a finer one rounds again is below its readback's noise.
const MOST_FINE: u32 = 6_000; // numerical
const FINE_PINS: usize = 500; // numerical
/// About so many of the best, so many to either side are tried.
const FINE_REFINED: usize = 8; // numerical
/// So many times its softness below a limit, nothing of it is felt.
const FADED: f64 = 8.0; // numerical
const FINE_BETWEEN: i32 = 10; // numerical
/// Treads are found on so many readbacks, each costs so many nats, for its level and where it begins, and moves no pin by more
/// than so many mean rises.
const TREAD_PINS: usize = 1_500; // numerical
const TREAD_COST: f64 = 6.0;
const LONGEST_TREAD: f64 = 2.2;
/// Where in a period a pin may have been read, in logs that do not say.
const READ_AFTER: [f64; 6] = [0.0, 0.1, 0.3, 0.5, 0.7, 0.95]; // numerical
/// Fewest flights whose scales are compared, and nats that each one's costs.
const LEAST_FLIGHTS: usize = 3;
const SCALE_COST: f64 = 1.0;

/// A law of the pins: what each holds, iteration by iteration of a flight.
struct PinLaw {
    effect: usize,
    /// Half the squared residuals, capped, in sigmas.
    excess: f64,
    values: Vec<f64>,
}

/// What scales that differ between flights explain.
struct Scales {
    /// Half the squared residuals, capped, in sigmas, and what the scales cost.
    excess: f64,
    /// Gain over one scale, nats.
    gain: f64,
    /// Between the largest and the smallest.
    spread: f64,
}

/// One sigma of what another form of a law makes of the displacement of a pin, as a share of it.
const FORM_SIGMA: f64 = 0.1;

/// How many readbacks are off, and the RMS of how far those are from what the output was told, in units of the actuation.
fn displacement(pins: &[Pin], noise: f64) -> (usize, f64) {
    let off =
        pins.iter().map(|pin| pin.readback - pin.commanded).filter(|off| off.abs() > FAR_SIGMAS * noise);
    let (count, squares) = off.fold((0, 0.0), |(count, squares), off| (count + 1, squares + off * off));
    (count, (squares / count.max(1) as f64).sqrt())
}

/// Half a squared residual in sigmas, capped.
fn capped(off: f64, sigma: f64) -> f64 {
    (0.5 * (off / sigma).powi(2)).min(CAP)
}

/// The pins of all flights.
pub struct PinChannel<'a> {
    pub rig: &'a Rig,
    pub flights: Vec<&'a [Pin]>,
    /// One sigma of a readback.
    sigma: f64,
    /// One step of the output.
    step: f64,
}

impl PinChannel<'_> {
    /// Flights from all over the set with so many readbacks together, one at least.
    pub fn some(&self, most: usize) -> Self {
        let stride = self.pins().count().div_ceil(most).clamp(1, self.flights.len());
        Self { flights: self.flights.iter().copied().step_by(stride).collect(), ..*self }
    }

    /// Excess of one flight under a law that says what a pin is told to hold, before rounding.
    fn flight(&self, pins: &[Pin], law: &mut dyn FnMut(&Pin, bool) -> f64) -> f64 {
        let mut sum = 0.0;
        for (i, pin) in pins.iter().enumerate() {
            let told = law(pin, i == 0);
            // Where a law bends the command, the step it then rounds to hangs on its numbers' last digits.
            let (at, sigma) = if told == pin.asked {
                (pin.commanded, self.sigma)
            } else {
                (told, self.sigma.hypot(self.step / 12_f64.sqrt())) // unit
            };
            sum += capped(pin.readback - at, sigma) + (sigma / self.sigma).ln();
        }
        sum
    }

    /// The same of all flights.
    pub fn all(&self, mut law: impl FnMut(&Pin, bool) -> f64) -> f64 {
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

    /// Levels that the pin does not pass upwards, downwards or both, softly or hard, their own in each flight as supplies fade.
    fn saturation(&self) -> Option<PinLaw> {
        let ends: [&[f64]; 3] = [&[1.0], &[-1.0], &[1.0, -1.0]];
        let tried = ends.into_iter().flat_map(|ends| {
            [0.0, 0.002, 0.005, 0.012].into_iter().map(move |softness| self.limits(ends, softness)) // numerical
        });
        tried.min_by(|a, b| a.excess.total_cmp(&b.excess))
    }

    /// The same in these directions, 1 upwards and -1 downwards, with one softness.
    fn limits(&self, ends: &[f64], softness: f64) -> PinLaw {
        let softness = softness * (self.rig.airframe.sticks.max - self.rig.airframe.sticks.min);
        // A second one has a number of its own.
        let mut excess = LAW_COST * (ends.len() - 1) as f64;
        let mut levels = [Vec::new(), Vec::new()];
        for pins in &self.flights {
            let mut told: Vec<f64> = pins.iter().map(|pin| pin.asked).collect();
            let mut left = 0.0;
            for up in ends {
                let level;
                (left, level) = self.limit(pins, &mut told, *up, softness);
                levels[usize::from(*up < 0.0)].extend(level);
            }
            excess += left;
        }
        self.limited(levels.map(median_high), excess)
    }

    /// Limits what the pins of a flight are told, in one direction, at the level that leaves the least excess: that, and the level
    /// where one is reached.
    fn limit(&self, pins: &[Pin], told: &mut [f64], up: f64, softness: f64) -> (f64, Option<f64>) {
        let (min, max) = (self.rig.airframe.sticks.min, self.rig.airframe.sticks.max);
        // How far along the way from the other end of the range.
        let along = |throttle: f64| if up > 0.0 { throttle - min } else { max - throttle };
        let furthest = told.iter().map(|told| along(*told)).fold(f64::MIN, f64::max);
        let limited = |told: f64, pin: &Pin, level: f64| {
            let over = along(told) - level;
            let beyond = if softness == 0.0 {
                over.max(0.0)
            } else if over < -FADED * softness {
                0.0
            } else {
                softness * (over / softness).min(40.0).exp().ln_1p().max(over / softness) // numerical
            };
            // The stick at its lower end may stop the motors, floor or not.
            let off = up < 0.0 && pin.asked <= min && 2.0 * (pin.readback - pin.asked) < beyond;
            if off { told } else { told - up * beyond }
        };
        let at = |level: f64| {
            let mut held = told.iter().zip(pins).map(|(told, pin)| limited(*told, pin, level));
            (self.flight(pins, &mut |pin, _| held.next().unwrap_or(pin.asked)), level)
        };
        let step = 0.01 * furthest; // numerical
        let coarse = (0..60).map(|i| at(furthest - step * f64::from(i))); // numerical
        let near = coarse.min_by(|a, b| a.0.total_cmp(&b.0));
        let finer = near
            .into_iter()
            .flat_map(|(_, level)| (-9..10).map(move |i| (level + 0.1 * step * f64::from(i)).min(furthest))); // numerical
        let Some((excess, level)) = finer.map(at).min_by(|a, b| a.0.total_cmp(&b.0)) else {
            return (0.0, None);
        };
        for (told, pin) in told.iter_mut().zip(pins) {
            *told = limited(*told, pin, level);
        }
        (excess, (level < furthest).then_some(if up > 0.0 { min + level } else { max - level }))
    }

    /// The law of limits at levels, upwards and downwards.
    fn limited(&self, levels: [Option<f64>; 2], excess: f64) -> PinLaw {
        let a = &self.rig.airframe;
        let ratio =
            |level: f64| a.thrust.gain_n_per_unit.value * (level - a.thrust.offset.value) / a.weight_n();
        let effect = read_as(Reading::PinLimit);
        let ends = LIBRARY[effect].parameters.iter().zip(levels);
        let values = ends.filter_map(|(p, level)| match level {
            Some(level) => Some(ratio(level).clamp(p.min, p.max)),
            None => p.neutral,
        });
        PinLaw { effect, excess, values: values.collect() }
    }

    /// The library's law of one link of a chain.
    fn link(&self, bend: Bend, excess: f64) -> PinLaw {
        let range = self.rig.airframe.sticks.max - self.rig.airframe.sticks.min;
        let of_range =
            |reading, size: f64| PinLaw { effect: read_as(reading), excess, values: vec![size / range] };
        match bend {
            Bend::Steps(step) => of_range(Reading::PinSteps, step),
            Bend::Play(width) => of_range(Reading::PinHysteresis, width),
            Bend::Limit(level) => self.limited([Some(level), None], excess),
        }
    }

    /// All readbacks.
    pub fn pins(&self) -> impl Iterator<Item = &Pin> {
        self.flights.iter().flat_map(|pins| pins.iter())
    }

    /// A scale of its own in each flight, as of a reference that drifts. `None` where flights are too few to differ.
    fn scales(&self) -> Option<Scales> {
        if self.flights.len() < LEAST_FLIGHTS {
            return None;
        }
        let (min, max) = (self.rig.airframe.sticks.min, self.rig.airframe.sticks.max);
        let scale = |pins: &[Pin]| {
            let above = || pins.iter().filter(|pin| pin.commanded > min);
            let rough =
                median_high(above().map(|pin| (pin.readback - min) / (pin.commanded - min)).collect())?;
            // A median needs half as many readbacks again for what least squares tell.
            let near = above().filter(|pin| {
                (pin.readback - min - rough * (pin.commanded - min)).abs() < FAR_SIGMAS * self.sigma
            });
            let (xy, xx) = near.fold((0.0, 0.0), |(xy, xx), pin| {
                let x = pin.commanded - min;
                (xy + x * (pin.readback - min), xx + x * x)
            });
            Some(if xx > 0.0 { xy / xx } else { rough })
        };
        let excess = |pins: &[Pin], scale: f64| {
            // No pin leaves the range, whatever its scale.
            let held = |pin: &Pin| (min + scale * (pin.commanded - min)).min(max);
            pins.iter().map(|pin| capped(pin.readback - held(pin), self.sigma)).sum::<f64>()
        };
        let shared = scale(&self.flights.concat())?;
        let (mut gain, mut left, mut range) = (-LAW_COST, 0.0, (shared, shared));
        for pins in &self.flights {
            let own = scale(pins).unwrap_or(shared);
            left += excess(pins, own) + SCALE_COST;
            gain += excess(pins, shared) - excess(pins, own) - SCALE_COST;
            range = (range.0.min(own), range.1.max(own));
        }
        Some(Scales { excess: left, gain, spread: range.1 - range.0 })
    }

    /// Steps that are tried, coarser than the output's own.
    pub fn coarse_steps(&self) -> impl Iterator<Item = f64> {
        let range = self.rig.airframe.sticks.max - self.rig.airframe.sticks.min;
        evenly_in_log((1.2 * self.step / range).max(0.001), 0.12, 160).map(move |step| step * range) // numerical
    }

    /// Coarse steps from rest, rounded or cut.
    fn quantisation(&self) -> Option<PinLaw> {
        let sticks = &self.rig.airframe.sticks;
        let range = sticks.max - sticks.min;
        self.coarse_steps()
            .flat_map(|step| [0.5, 0.0].map(|shift| (step, shift)))
            .map(|(step, shift)| {
                let law = |x: f64| sticks.min + step * ((x - sticks.min) / step + shift).floor();
                (self.all(|pin, _| law(pin.asked)), step)
            })
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map(|(excess, step)| PinLaw {
                effect: read_as(Reading::PinSteps),
                excess,
                values: vec![step / range],
            })
    }

    /// Steps about as fine as the output's own, which rounds them again: what is told lies one of its steps off now and
    /// then.
    fn fine_quantisation(&self) -> Option<PinLaw> {
        // What does not round leaves steps to be seen as they are.
        if self.step <= 0.0 {
            return None;
        }
        let sticks = &self.rig.airframe.sticks;
        let output = &self.rig.output;
        let excess = |pins: &mut dyn Iterator<Item = &Pin>, step: f64| -> f64 {
            pins.map(|pin| {
                let told = sticks.min + step * ((pin.asked - sticks.min) / step).round();
                capped(pin.readback - output.expected_on_the_pin(sticks, told), self.sigma)
            })
            .sum()
        };
        let stride = self.pins().count().div_ceil(FINE_PINS);
        let range = sticks.max - sticks.min;
        let tried = |in_range: f64| {
            let step = range / in_range;
            (excess(&mut self.pins().step_by(stride), step), in_range)
        };
        // Even in how many there are: of hundreds of steps up to a pin the last hangs on each one's length to a part in thousands.
        let (fewest, most) = (range / (COARSEST * self.step), range / (FINEST * self.step));
        let count = (((most - fewest) / FINE_APART) as u32).min(MOST_FINE);
        let coarse = (0..=count).into_par_iter().map(|i| tried(fewest + FINE_APART * f64::from(i)));
        let mut coarse: Vec<(f64, f64)> = coarse.collect();
        coarse.sort_by(|a, b| a.0.total_cmp(&b.0));
        coarse
            .into_iter()
            .take(FINE_REFINED)
            .flat_map(|(_, near)| {
                (-FINE_BETWEEN..=FINE_BETWEEN)
                    .map(move |i| near + FINE_APART * f64::from(i) / f64::from(FINE_BETWEEN))
            })
            .map(tried)
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map(|(_, in_range)| PinLaw {
                effect: read_as(Reading::PinSteps),
                excess: excess(&mut self.pins(), range / in_range),
                values: vec![in_range.recip()],
            })
    }

    /// Treads of any length: what the pin holds is constant between some commands, found by dynamic programming over the
    /// commands in their order (Bellman, *On the approximation of curves by line segments using dynamic programming*,
    /// Communications of the ACM 4(6), 1961).
    fn treads(&self) -> Option<PinLaw> {
        let sticks = &self.rig.airframe.sticks;
        let mut moved: Vec<&Pin> = self.pins().filter(|pin| pin.asked > sticks.min).collect();
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
            effect: read_as(Reading::PinSteps),
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
                evenly_in_log(0.003, 0.5, 60).map(move |time_constant_s| (time_constant_s, read_s)) // numerical
            })
            .map(|(time_constant_s, read_s)| PinLaw {
                effect: read_as(Reading::PinLag),
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
                held = dragged(held, pin.commanded, width);
                held
            })
        };
        evenly_in_log(0.0005, 0.15, 120) // numerical
            .map(|fraction| fraction * range)
            .map(|width| PinLaw {
                effect: read_as(Reading::PinHysteresis),
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
                    let dragged = dragged(held, pin.asked, width);
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
        let creeps: &[f64] = if jumps { &[0.0] } else { &[0.0, 0.07, 0.14] }; // numerical
        let try_all = |widths: &mut dyn Iterator<Item = f64>| {
            widths
                .flat_map(|width| creeps.iter().map(move |creep| (width, *creep)))
                .map(|(width, creep)| (excess(width, creep), width))
                .min_by(|a, b| a.0.total_cmp(&b.0))
        };
        let coarse = evenly_in_log(0.0015, 0.15, 60).map(|fraction| fraction * range); // numerical
        let (_, about) = try_all(&mut { coarse })?;
        // One jump missed is many residuals: the width must be right to a fraction of a step.
        let fine = (-40..=40).map(|i| about * (1.0 + 0.002 * f64::from(i))); // numerical
        let (excess, width) = try_all(&mut { fine })?;
        Some(PinLaw { effect: read_as(Reading::PinHysteresis), excess, values: vec![width / range] })
    }
}

/// Reads all pins.
pub fn pins(tracks: &[Track], rig: &Rig, out: &mut Direct) {
    let flights: Vec<&[Pin]> = tracks.iter().map(|t| t.pins.as_slice()).filter(|p| p.len() > 10).collect();
    if flights.is_empty() {
        return;
    }
    let all: Vec<Pin> = flights.iter().flat_map(|pins| pins.iter().copied()).collect();
    let range = rig.airframe.sticks.max - rig.airframe.sticks.min;
    let step = rig.output.step(&rig.airframe.sticks);
    let noise = readback_sigma(&all, rig);
    // Steps in places of their own are as good as noise.
    let noise = if rig.output.own_step.is_some() { noise.hypot(step / 12_f64.sqrt()) } else { noise }; // unit
    let exact = PinChannel { rig, flights, sigma: noise, step };
    let readbacks = all.len() as f64;
    // What a right law leaves of so many readbacks of noise; that is itself estimated from them, the fewer the worse.
    let left = |of_noise: f64| (1.15 + 5.0 / readbacks.sqrt()) * 0.5 * of_noise + 10.0;
    let is_ordinary = exact.all(|pin, _| pin.asked) - left(readbacks) < LAW_COST;
    let scales = exact.scales().filter(|scales| scales.gain > 0.0 && scales.excess < left(readbacks));
    if scales.is_none() && is_ordinary {
        return;
    }
    // What is off is explained as far as a law of the library may be expected to be of the right form: readbacks without any
    // noise would else refute every law but the true one.
    let (off, displacement) = displacement(&all, noise);
    let sigma = noise.hypot(FORM_SIGMA * displacement);
    let channel = PinChannel { sigma, ..exact };
    let ordinary = channel.all(|pin, _| pin.asked);
    let floor = left((readbacks * (noise / sigma).powi(2) + off as f64).min(readbacks));
    // No law of the library changes a scale. Where that leaves but noise, none of those with many numbers is asked for more.
    let of_one_number = [channel.lag(), channel.play(), channel.quantisation(), channel.fine_quantisation()]
        .map(Option::into_iter);
    let of_one_number: Vec<PinLaw> = of_one_number.into_iter().flatten().collect();
    let plain = of_one_number.iter().map(|law| law.excess).fold(f64::MAX, f64::min);
    if let Some(scales) = scales.filter(|_| channel.scales().is_some_and(|scales| scales.excess < plain)) {
        out.findings.push(Finding {
            channel: "readback",
            text: format!(
                "the scale of readback over command differs between flights by up to {:.2} %",
                100.0 * scales.spread // unit
            ),
        });
        out.unexplained_pins = scales.gain.min(MOST_DIRECT);
        return;
    }
    let of_many = [channel.saturation(), channel.treads(), channel.backlash(false), channel.backlash(true)]
        .map(Option::into_iter);
    let mut laws: Vec<PinLaw> = of_one_number.into_iter().chain(of_many.into_iter().flatten()).collect();
    laws.sort_by(|a, b| a.excess.total_cmp(&b.excess));
    let Some((leading, alone)) = laws.first().map(|law| (law.effect, law.excess)) else { return };
    let both = if alone > floor + LAW_COST { chain(&channel) } else { None };
    let both = both.filter(|both| alone - both.excess > LAW_COST + SECOND_SHARE * (ordinary - alone));
    let best = both.as_ref().map_or(alone, |both| both.excess);
    if both.is_none() {
        out.lag_of_pins = (leading == read_as(Reading::PinLag) && !channel.answered()).then_some(leading);
    }
    out.unexplained_pins = (best - floor - FORM_SHARE * (ordinary - best)).max(0.0);
    let mut found = |law: PinLaw, gain: f64| {
        if gain > 0.0 && out.effects.iter().all(|other| other.effect != law.effect) {
            out.effects.push(DirectEffect {
                effect: law.effect,
                channel: "readback",
                gain,
                values: law.values,
                relative_sigma: 0.05,
            });
        }
    };
    // They explain the same readbacks: what the best has over another counts in full.
    let most = (ordinary - best - LAW_COST).min(MOST_DIRECT);
    if let Some(both) = &both {
        // Neither explains them alone.
        let links = both.bends.map(|bend| channel.link(bend, best));
        out.together = Some([links[0].effect, links[1].effect]);
        for link in links {
            found(link, 0.5 * most);
        }
    }
    for law in laws {
        let gain = most - (law.excess - best);
        found(law, gain);
    }
    out.findings.push(Finding {
        channel: "readback",
        text: format!(
            "{off} of {} readbacks differ from the command by more than four sigma of their noise ({:.2} % of the range)",
            all.len(),
            100.0 * noise / range // unit
        ),
    });
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn a_limit_is_found_where_readbacks_have_no_noise() {
        let rig = Rig::load(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs/virtual.toml")).unwrap();
        let (sticks, output) = (&rig.airframe.sticks, &rig.output);
        let range = sticks.max - sticks.min;
        let limit = sticks.min + 0.6137 * range;
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        // One command in seven is beyond the limit.
        let pins: Vec<Pin> = (0..2000)
            .map(|i| {
                let asked = sticks.min + range * rng.random_range(0.4..0.65);
                let time_s = 0.1 * f64::from(i);
                let commanded = output.expected_on_the_pin(sticks, asked);
                let readback = output.expected_on_the_pin(sticks, asked.min(limit));
                Pin { time_s, delay_s: 0.0, asked, commanded, readback }
            })
            .collect();
        let mut out = Direct::default();
        super::pins(&[Track { pins, ..Track::default() }], &rig, &mut out);
        let best = out.effects.iter().max_by(|a, b| a.gain.total_cmp(&b.gain)).unwrap();
        assert_eq!(best.effect, read_as(Reading::PinLimit), "{:?}", out.effects);
        assert_eq!(out.unexplained_pins, 0.0);
    }

    #[test]
    fn fine_steps_are_found_among_hundreds_up_to_a_pin() {
        let rig = Rig::load(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs/virtual.toml")).unwrap();
        let (sticks, output) = (&rig.airframe.sticks, &rig.output);
        let range = sticks.max - sticks.min;
        let sigma = 0.001 * range;
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        for step_fraction in [0.001_033, 0.001_540_7, 0.002_219, 0.003_771] {
            let step = step_fraction * range;
            let pins: Vec<Pin> = (0..2000)
                .map(|i| {
                    let asked = sticks.min + range * rng.random_range(0.45..0.75);
                    let told = sticks.min + step * ((asked - sticks.min) / step).round();
                    // Even noise of the same deviation.
                    let noise = sigma * 3_f64.sqrt() * rng.random_range(-1.0..1.0);
                    Pin {
                        time_s: 0.1 * f64::from(i),
                        delay_s: 0.0,
                        asked,
                        commanded: output.expected_on_the_pin(sticks, asked),
                        readback: output.expected_on_the_pin(sticks, told) + noise,
                    }
                })
                .collect();
            let channel = PinChannel { rig: &rig, flights: vec![&pins], sigma, step: output.step(sticks) };
            let law = channel.fine_quantisation().unwrap();
            // The noise alone leaves a half for each; a step missed once in twenty pins as much as the noise again.
            assert!(law.excess < 0.6 * 2000.0, "{step_fraction}: {} {:?}", law.excess, law.values);
            assert!((law.values[0] / step_fraction - 1.0).abs() < 1e-3, "{step_fraction}: {:?}", law.values);
        }
    }
}
