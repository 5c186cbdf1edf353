//! How well an effect can be seen in a case: its detectability d'.
//!
//! d' is the square root of twice the expected log-likelihood ratio between the flights as they were and the same
//! flights without the effect, for an observer who knows the generator (noise, turbulence, laws) but not this case's
//! own numbers. Along each flown path the laws are run again without the effect; what that changes in acceleration and
//! in the measured altitude goes through the innovations of the observer's Kalman filter (altitude, speed, trim of the
//! flight, wind). The same is done for one sigma of every uncertain number of the rig, and what these can explain under
//! their prior is projected out. What shows in the readback, in time stamps, in lost frames or in the spread of the
//! noise is counted from its distribution instead. Random forces count by the energy that they add.

use bench_rig::{GRAVITY_M_S2, Mission, Rig};
use nalgebra::{DMatrix, DVector, Matrix4, Vector4};

use crate::{
    BlindError,
    cases::{Case, Fault, Lab, STRONGEST_TURBULENCE_M_S},
    flight::{self, Flown, TRIM_SIGMA, Trace},
    physics::{
        actuator::Converter,
        air::GRID_S,
        body::{Numbers, STATES},
        integrator::Integrator,
        timing::LATENESS_S,
        tracker::{BUS_JITTER_S, TrackerFault},
    },
};

/// Larger ones are all the same to everybody.
const LARGEST: f64 = 1000.0;
/// Below this altitude the airframe may stand on the floor, which hides every force that does not lift it, m.
const FLOOR_M: f64 = 0.002;
/// How many numbers in a second of flight tell of a random force: wind is slower than frames.
const RANDOM_FORCE_PER_S: f64 = 4.0;

/// What the flights of a case add up to.
pub(crate) struct Watch<'a> {
    rig: &'a Rig,
    lab: &'a Lab,
    sigma: [f64; 7],
    /// Products of whitened signals: without all faults, without each, then the numbers.
    gram: DMatrix<f64>,
    /// What each fault shows outside of the altitude.
    aside: Vec<f64>,
    frames: f64,
    innovation_variance: f64,
    iterations: f64,
    airborne_s: f64,
}

impl<'a> Watch<'a> {
    pub(crate) fn new(rig: &'a Rig, lab: &'a Lab) -> Self {
        let signals = 1 + lab.faults.len() + Numbers::NAMES.len();
        Self {
            rig,
            lab,
            sigma: Numbers::of(rig).1,
            gram: DMatrix::zeros(signals, signals),
            aside: vec![0.0; lab.faults.len()],
            frames: 0.0,
            innovation_variance: 0.0,
            iterations: 0.0,
            airborne_s: 0.0,
        }
    }

    /// Takes a flight into account.
    pub(crate) fn add(&mut self, trace: &Trace) {
        if self.lab.faults.is_empty() {
            return;
        }
        let signals = self.signals(trace);
        let (gram, frames, variance) = (&mut self.gram, &mut self.frames, &mut self.innovation_variance);
        self.airborne_s += innovations(self.rig, self.lab, trace, &signals, |whitened, own_variance| {
            gram.ger(1.0, whitened, whitened, 1.0);
            *frames += 1.0;
            *variance += own_variance;
        });
        for (fault, aside) in self.lab.faults.iter().zip(&mut self.aside) {
            if let Fault::Output(_) = fault {
                *aside += readback_distance(self.rig, trace);
            }
        }
        self.iterations += trace.pins.len() as f64;
    }

    /// Takes into account what another watch of the same case saw.
    pub(crate) fn absorb(&mut self, other: &Self) {
        self.gram += &other.gram;
        for (own, other) in self.aside.iter_mut().zip(&other.aside) {
            *own += other;
        }
        self.frames += other.frames;
        self.innovation_variance += other.innovation_variance;
        self.iterations += other.iterations;
        self.airborne_s += other.airborne_s;
    }

    /// d' of everything, and of each fault.
    pub(crate) fn detectability(&self) -> (f64, Vec<f64>) {
        let faults = self.lab.faults.len();
        if faults == 0 {
            return (0.0, Vec::new());
        }
        let each: Vec<f64> = (0..faults)
            .map(|i| {
                let force = match &self.lab.faults[i] {
                    fault if is_random(fault) => self.energy(fault, self.gram[(1 + i, 1 + i)]),
                    _ => self.beyond_numbers(1 + i),
                };
                force + self.aside[i] + self.spread(&self.lab.faults[i])
            })
            .collect();
        // Deterministic forces add as signals; the rest is independent of them and of each other.
        let random: f64 = (0..faults)
            .map(|i| {
                let own = each[i];
                if is_random(&self.lab.faults[i]) { own } else { own - self.beyond_numbers(1 + i) }
            })
            .sum();
        let all = self.beyond_numbers(0) + random;
        let root = |squared: f64| squared.max(0.0).sqrt().min(LARGEST);
        (root(all), each.into_iter().map(root).collect())
    }

    /// What a random force adds to the innovations; of wind, no more than exceeds what turbulence may be.
    fn energy(&self, fault: &Fault, squared_length: f64) -> f64 {
        let count = (RANDOM_FORCE_PER_S * self.airborne_s).max(1.0);
        let seen = count * excess(squared_length / count);
        let Fault::Gust(gust) = fault else { return seen };
        let wind = gust.sigma_m_s().powi(2) + self.lab.turbulence.sigma_m_s.powi(2);
        let beyond = (wind / STRONGEST_TURBULENCE_M_S.powi(2) - 1.0).max(0.0);
        seen.min(count * excess(beyond))
    }

    /// A signal's squared length, less what the rig's numbers can explain of it under their prior.
    fn beyond_numbers(&self, signal: usize) -> f64 {
        beyond_numbers(&self.gram, 1 + self.lab.faults.len())[(signal, signal)].max(0.0)
    }

    /// What every signal changes on a flight: acceleration on the grid, altitude at the frames.
    fn signals(&self, trace: &Trace) -> Vec<Signal> {
        let lab = self.lab;
        let all = |_: usize| true;
        let as_flown = accelerations(lab, trace, lab.numbers, all);
        let mut signals = Vec::new();
        let mut without = |keep: &dyn Fn(usize) -> bool| {
            let force = accelerations(lab, trace, lab.numbers, keep);
            let tracker = lab.faults.iter().position(|fault| matches!(fault, Fault::Tracker(_)));
            let sight = match tracker {
                Some(i) if !keep(i) => sight_change(lab, trace),
                _ => vec![0.0; trace.frames.len()],
            };
            signals.push(Signal { force: difference(&as_flown, &force), sight });
        };
        without(&|i| is_random(&lab.faults[i]));
        for fault in 0..lab.faults.len() {
            without(&|i| i != fault);
        }
        signals.extend(of_numbers(lab, trace, &as_flown, &self.sigma));
        signals
    }

    /// What a fault of the tracker or the loop shows in spreads and counts: twice the Kullback-Leibler divergence.
    fn spread(&self, fault: &Fault) -> f64 {
        let frames = self.frames.max(1.0);
        let variance = (self.innovation_variance / frames).max(1e-12);
        match fault {
            Fault::Tracker(TrackerFault::Queue { mean_s, shape }) => {
                frames * excess((mean_s / BUS_JITTER_S).powi(2) / shape)
            }
            Fault::Tracker(TrackerFault::HeldUp { probability, wait_s }) => {
                frames * excess(probability * (1.0 - probability) * (wait_s / BUS_JITTER_S).powi(2))
            }
            Fault::Tracker(TrackerFault::HeavyTails { sigma_m } | TrackerFault::Wander { sigma_m, .. }) => {
                frames * excess(sigma_m.powi(2) / variance)
            }
            Fault::Tracker(
                TrackerFault::Strays { probability, sigma_m: far_m }
                | TrackerFault::WrongMark { probability, offset_m: far_m },
            ) => frames * probability * excess(far_m.powi(2) / variance),
            Fault::Tracker(
                TrackerFault::Bursts { probability, .. } | TrackerFault::Occlusions { probability, .. },
            ) => {
                let usual = self.rig.tracker.dropout_probability.clamp(1e-4, 0.5);
                let p = (usual + probability).min(0.9);
                2.0 * frames * (p * (p / usual).ln() + (1.0 - p) * ((1.0 - p) / (1.0 - usual)).ln())
            }
            Fault::Loop(fault) => {
                let (probability, mean_s) = fault.rate();
                // Exponential waits: the divergence of one mean from another.
                let ratio = 1.0 + mean_s / LATENESS_S;
                2.0 * self.iterations * probability * (ratio - 1.0 - ratio.ln())
            }
            _ => 0.0,
        }
    }
}

/// Runs the observer's filter along a flight and hands each frame's whitened signals and innovation variance to `each`.
/// Returns how long the flight was in the air, s.
fn innovations(
    rig: &Rig,
    lab: &Lab,
    trace: &Trace,
    signals: &[Signal],
    mut each: impl FnMut(&DVector<f64>, f64),
) -> f64 {
    let tracker = &rig.tracker;
    let noise = tracker.noise_m.powi(2) + tracker.resolution_m.powi(2) / 12.0 + 1e-9;
    let [mass_kg, drag, ..] = lab.numbers.0;
    let wind = lab.turbulence;
    let keep = (-GRID_S / wind.correlation_s).exp();
    let wind_variance = (wind.sigma_m_s * drag / mass_kg).powi(2);
    let mut transition = Matrix4::new(
        1.0,
        GRID_S,
        0.5 * GRID_S * GRID_S,
        0.5 * GRID_S * GRID_S,
        0.0,
        1.0 - GRID_S * drag / mass_kg,
        GRID_S,
        GRID_S,
        0.0,
        0.0,
        1.0,
        0.0,
        0.0,
        0.0,
        0.0,
        keep,
    );
    let mut drive = Matrix4::zeros();
    drive[(3, 3)] = wind_variance * (1.0 - keep * keep);
    let at_rest = [0.003_f64.powi(2), 0.03_f64.powi(2)];
    let mut covariance = Matrix4::from_diagonal(&Vector4::new(
        at_rest[0],
        at_rest[1],
        (TRIM_SIGMA * GRAVITY_M_S2).powi(2),
        wind_variance,
    ));
    let mut errors = vec![Vector4::zeros(); signals.len()];
    let mut whitened = DVector::zeros(signals.len());
    let mut next_frame = 0;
    let mut airborne_s = 0.0;
    for cell in 0..trace.path.len() - 1 {
        if trace.path[cell][0] < FLOOR_M {
            for (i, variance) in at_rest.into_iter().enumerate() {
                covariance.row_mut(i).fill(0.0);
                covariance.column_mut(i).fill(0.0);
                covariance[(i, i)] = variance;
            }
            // A lift-off that comes late is an error from there on; while both stand there is none.
            for (error, signal) in errors.iter_mut().zip(signals) {
                let force = signal.force[cell];
                *error = if force == 0.0 { Vector4::zeros() } else { pushed(*error, force) };
            }
            while trace.frames.get(next_frame).is_some_and(|f| f.exposed_s < cell as f64 * GRID_S) {
                next_frame += 1;
            }
            continue;
        }
        airborne_s += GRID_S;
        transition[(1, 0)] = GRID_S * lab.numbers.cushion_per_s2(trace.path[cell][0]);
        covariance = transition * covariance * transition.transpose() + drive;
        for (error, signal) in errors.iter_mut().zip(signals) {
            *error = pushed(transition * *error, signal.force[cell]);
        }
        let end_s = (cell + 1) as f64 * GRID_S;
        while let Some(frame) = trace.frames.get(next_frame).filter(|f| f.exposed_s < end_s) {
            if frame.z_m.is_some() {
                let variance = covariance[(0, 0)] + noise;
                let gain = covariance.column(0) / variance;
                for ((error, signal), white) in errors.iter_mut().zip(signals).zip(whitened.iter_mut()) {
                    let innovation = error[0] + signal.sight[next_frame];
                    *white = innovation / variance.sqrt();
                    *error -= gain * innovation;
                }
                each(&whitened, variance);
                let seen = covariance.row(0).into_owned();
                covariance -= gain * seen;
            }
            next_frame += 1;
        }
    }
    airborne_s
}

/// An error after a cell of the grid in which the acceleration was off, m/s^2.
fn pushed(mut error: Vector4<f64>, force: f64) -> Vector4<f64> {
    error[0] += 0.5 * GRID_S * GRID_S * force;
    error[1] += GRID_S * force;
    error
}

/// What one sigma of each of the rig's numbers changes.
fn of_numbers(lab: &Lab, trace: &Trace, as_flown: &[f64], sigma: &[f64; 7]) -> Vec<Signal> {
    let change = |(i, sigma): (usize, &f64)| {
        let mut signal = Signal::none(trace, as_flown.len());
        if i == Numbers::LATENCY {
            signal.sight = trace.frames.iter().map(|f| -sigma * trace.speed(f.exposed_s)).collect();
        } else if *sigma > 0.0 {
            let mut numbers = lab.numbers;
            numbers.0[i] += sigma;
            signal.force = difference(&accelerations(lab, trace, numbers, |_| true), as_flown);
        }
        signal
    };
    sigma.iter().enumerate().map(change).collect()
}

/// The products of the first `count` signals, less what the rig's numbers behind them explain under their unit prior.
fn beyond_numbers(gram: &DMatrix<f64>, count: usize) -> DMatrix<f64> {
    let numbers = gram.nrows() - count;
    let own = gram.view((0, 0), (count, count)).into_owned();
    let cross = gram.view((count, 0), (numbers, count)).into_owned();
    let prior = gram.view((count, count), (numbers, numbers)) + DMatrix::identity(numbers, numbers);
    // The prior makes it positive definite.
    prior.cholesky().map_or_else(|| own.clone(), |c| &own - cross.transpose() * c.solve(&cross))
}

fn difference(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

/// What kinds of effects show on flights without any: products of their responses, one watch a mission.
pub(crate) struct Responses {
    /// Of readbacks.
    pins: DMatrix<f64>,
    /// Of whitened innovations, the rig's numbers behind the kinds.
    gram: DMatrix<f64>,
    kinds: usize,
}

impl Responses {
    /// How the flight of `trace`, flown by `sound`, would have differed in each of `labs`, which are `sound` but for
    /// their one fault.
    pub(crate) fn of(rig: &Rig, sound: &Lab, trace: &Trace, labs: &[&Lab]) -> Self {
        let as_flown = accelerations(sound, trace, sound.numbers, |_| true);
        let sigma = Numbers::of(rig).1;
        let mut signals: Vec<Signal> = labs
            .iter()
            .map(|lab| Signal {
                force: difference(&accelerations(lab, trace, lab.numbers, |_| true), &as_flown),
                sight: lab.camera.mean_change(&trace.frames, |t_s| trace.altitude(t_s)),
            })
            .collect();
        signals.extend(of_numbers(sound, trace, &as_flown, &sigma));
        let mut gram = DMatrix::zeros(signals.len(), signals.len());
        innovations(rig, sound, trace, &signals, |whitened, _| gram.ger(1.0, whitened, whitened, 1.0));
        let pins: Vec<DVector<f64>> = labs.iter().map(|lab| readback_change(rig, lab, trace)).collect();
        let pins = DMatrix::from_fn(labs.len(), labs.len(), |i, j| pins[i].dot(&pins[j]));
        Self { pins, gram, kinds: labs.len() }
    }

    pub(crate) fn absorb(&mut self, other: &Self) {
        self.pins += &other.pins;
        self.gram += &other.gram;
    }

    /// Products of the kinds' responses beyond what the rig's numbers explain; the diagonal is d' squared.
    pub(crate) fn products(&self) -> DMatrix<f64> {
        beyond_numbers(&self.gram, self.kinds) + &self.pins
    }
}

/// By how many deviations of the readback's noise a lab's fault would have moved each pin.
fn readback_change(rig: &Rig, lab: &Lab, trace: &Trace) -> DVector<f64> {
    let Some(fault) = lab.output_fault() else { return DVector::zeros(trace.pins.len()) };
    let (mut faulty, sigma) = converter(rig);
    let change = trace.pins.iter().map(|[written_s, asked, pin]| {
        let session_min = trace.setting.begins_min + written_s / 60.0;
        (faulty.write(*asked, session_min, Some(fault)) - pin) / sigma
    });
    DVector::from_iterator(trace.pins.len(), change)
}

/// The rig's converter, and one sigma of what is read back from it.
fn converter(rig: &Rig) -> (Converter, f64) {
    let sticks = rig.airframe.sticks;
    let range = sticks.max - sticks.min;
    let sigma = rig.output.readback_noise_fraction.max(1e-5) * range;
    (Converter::new(sticks.min, sticks.max, rig.output.bits), sigma)
}

/// Twice the divergence of a normal number whose variance has grown by `more` of itself.
fn excess(more: f64) -> f64 {
    (more - more.ln_1p()).max(0.0)
}

/// A fault whose force no one can predict.
pub(crate) fn is_random(fault: &Fault) -> bool {
    matches!(fault, Fault::Gust(_) | Fault::Miss(..))
}

struct Signal {
    /// m/s^2, a value for each cell of the grid.
    force: Vec<f64>,
    /// m, a value for each frame.
    sight: Vec<f64>,
}

impl Signal {
    fn none(trace: &Trace, cells: usize) -> Self {
        Self { force: vec![0.0; cells], sight: vec![0.0; trace.frames.len()] }
    }
}

impl Trace {
    fn between(&self, t_s: f64, which: usize) -> f64 {
        let place = (t_s / GRID_S).clamp(0.0, (self.path.len() - 1) as f64);
        let index = (place as usize).min(self.path.len().saturating_sub(2));
        let (a, b) = (self.path[index][which], self.path[index + 1][which]);
        a + (b - a) * (place - index as f64)
    }

    fn altitude(&self, t_s: f64) -> f64 {
        self.between(t_s, 0)
    }

    fn speed(&self, t_s: f64) -> f64 {
        self.between(t_s, 1)
    }

    /// Mean of what the motors hear in each cell of the grid, with the case's radio or a perfect one.
    fn heard(&self, lab: &Lab, with_radio: bool, rest: f64) -> Vec<f64> {
        let cells = self.path.len() - 1;
        let mut means = vec![0.0; cells];
        let (mut value, mut from_s) = (rest, 0.0);
        let mut hold = |value: f64, from_s: f64, to_s: f64| {
            let (first, last) = (from_s / GRID_S, (to_s / GRID_S).min(cells as f64));
            for (cell, mean) in means.iter_mut().enumerate().take(last.ceil() as usize).skip(first as usize) {
                let begin = first.max(cell as f64);
                let end = last.min((cell + 1) as f64);
                *mean += value * (end - begin).max(0.0);
            }
        };
        for [written_s, _, pin] in &self.pins {
            let heard_s = if with_radio { lab.heard_at(*written_s) } else { *written_s };
            hold(value, from_s, heard_s);
            (value, from_s) = (*pin, heard_s.max(from_s));
        }
        hold(value, from_s, cells as f64 * GRID_S);
        means
    }
}

/// Acceleration along the flown path, none while standing, under other numbers or with some faults alone.
fn accelerations(lab: &Lab, trace: &Trace, numbers: Numbers, keep: impl Fn(usize) -> bool) -> Vec<f64> {
    let kept = |wanted: fn(&Fault) -> bool| lab.faults.iter().position(wanted).is_none_or(&keep);
    let gusty = kept(|fault| matches!(fault, Fault::Gust(_)));
    let with_radio = kept(|fault| matches!(fault, Fault::Radio(_)));
    let heard = trace.heard(lab, with_radio, lab.rest);
    let body = lab.body_with(trace.trim, numbers, keep);
    let mut memory = [0.0; STATES - 2];
    memory.copy_from_slice(&body.start()[2..]);
    let mut integrator = Integrator::new();
    let mut accelerations = Vec::with_capacity(heard.len());
    for (cell, heard) in heard.iter().enumerate() {
        let [z0, v0] = trace.path[cell];
        let [z1, v1] = trace.path[cell + 1];
        let (begin_s, end_s) = (cell as f64 * GRID_S, (cell + 1) as f64 * GRID_S);
        // The path is given; only the laws' memories are integrated.
        let at = |t_s: f64, memory: &[f64; STATES - 2]| {
            let part = (t_s - begin_s) / GRID_S;
            let (z_m, v_m_s) = (z0 + part * (z1 - z0), v0 + part * (v1 - v0));
            let now = trace.setting.now(t_s, z_m, v_m_s, *heard, &trace.series, gusty);
            let (acceleration, _, rates) = body.evaluate(&now, memory);
            (acceleration, rates)
        };
        let (before, _) = at(begin_s, &memory);
        integrator.advance(begin_s, end_s, &mut memory, |t_s, memory| at(t_s, memory).1);
        let (after, _) = at(end_s, &memory);
        let mean = 0.5 * (before + after);
        // The floor bears what does not lift.
        accelerations.push(if z0 < FLOOR_M { mean.max(0.0) } else { mean });
    }
    accelerations
}

/// What the tracker's fault changes in the mean of each frame: a sound tracker's frame would have been exposed later.
fn sight_change(lab: &Lab, trace: &Trace) -> Vec<f64> {
    let change = |frame: &crate::physics::tracker::Frame| {
        let told = lab.camera.distorted(trace.altitude(frame.exposed_s), frame.load);
        told - trace.altitude(frame.exposed_s + frame.extra_s)
    };
    trace.frames.iter().map(change).collect()
}

/// Squared distance of the pins from a sound converter's, in the readback's noise.
fn readback_distance(rig: &Rig, trace: &Trace) -> f64 {
    let (mut sound, sigma) = converter(rig);
    let distance = |[_, asked, pin]: &[f64; 3]| ((pin - sound.write(*asked, 0.0, None)) / sigma).powi(2);
    trace.pins.iter().map(distance).sum()
}

/// Flies a case, hands every flight to `each`, and fills in what of it can be seen.
pub(crate) fn fly_and_watch(
    rig: &Rig,
    missions: &[Mission],
    case: &mut Case,
    mut each: impl FnMut(usize, &Flown) -> Result<(), BlindError>,
) -> Result<(), BlindError> {
    let mut watch = Watch::new(rig, &case.lab);
    flight::fly_all(rig, missions, &case.lab, |i, flown| {
        watch.add(&flown.trace);
        each(i, &flown)
    })?;
    let (all, parts) = watch.detectability();
    case.truth.detectability = all;
    for (ingredient, part) in case.truth.ingredients.iter_mut().zip(parts) {
        ingredient.detectability = part;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use bench_rig::{Mission, Rig};

    use super::*;
    use crate::physics::{
        actuator::OutputFault,
        air::{Gust, Turbulence},
        airframe::{Payload, PowerDrag},
        tracker::TrackerFault,
    };

    fn rig() -> Rig {
        Rig::load(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs/virtual.toml")).unwrap()
    }

    /// d' of faults on a climb to 0.6 m.
    fn seen(faults: Vec<Fault>) -> (f64, Vec<f64>) {
        let rig = rig();
        let text = "name = \"climb\"\ndescription = \"climb\"\n[[phase]]\nkind = \"launch\"\nthrust_to_weight = 1.12\n\
                    duration_s = 0.8\n[[phase]]\nkind = \"hold\"\naltitude_m = [[0.0, 0.6], [4.0, 0.6], [4.0, 0.3]]\n\
                    duration_s = 9.0\n";
        let mission = Mission::read(Path::new("climb.toml"), text).unwrap();
        let numbers = Numbers::of(&rig).0;
        let lab = Lab {
            numbers,
            turbulence: Turbulence { sigma_m_s: 0.02, correlation_s: 0.8 },
            drain_per_min: 0.002,
            camera: Lab::camera(&rig, numbers, &faults),
            faults,
            rest: rig.airframe.sticks.min,
            seed: 1,
            stream: 0,
        };
        let mut watch = Watch::new(&rig, &lab);
        flight::fly_all(&rig, &[mission], &lab, |_, flown| {
            watch.add(&flown.trace);
            Ok(())
        })
        .unwrap();
        watch.detectability()
    }

    fn alone(fault: Fault) -> f64 {
        seen(vec![fault]).0
    }

    fn law(law: impl crate::physics::law::Law + 'static) -> Fault {
        Fault::Law(Box::new(law))
    }

    #[test]
    fn more_of_an_effect_is_seen_better_and_none_of_it_not_at_all() {
        for make in [
            (|size| law(Payload { fraction: size })) as fn(f64) -> Fault,
            |size| law(PowerDrag { at_1_m_s_n: 0.2 * size, exponent: 2.0 }),
            |size| Fault::Tracker(TrackerFault::Late { extra_s: size }),
            |size| Fault::Tracker(TrackerFault::HeavyTails { sigma_m: 0.1 * size }),
        ] {
            let seen = [0.0, 0.01, 0.1].map(|size| alone(make(size)));
            assert!(seen[0] < 1e-3 && seen[0] < seen[1] && seen[1] < seen[2], "{seen:?}");
        }
    }

    #[test]
    fn what_the_rigs_tolerance_explains_does_not_count() {
        // A payload of a deviation of the rig's mass: well below one, although the flight shows it.
        let sigma = rig().airframe.mass_kg.sigma / rig().airframe.mass_kg.value;
        assert!(alone(law(Payload { fraction: sigma })) < 1.0);
    }

    #[test]
    fn gusts_no_stronger_than_turbulence_cannot_be_told_from_it() {
        let gust = |sigma_m_s| alone(Fault::Gust(Gust::Dryden { sigma_m_s, correlation_s: 0.8 }));
        assert_eq!(gust(0.03), 0.0);
        assert!(gust(0.6) > 5.0);
    }

    #[test]
    fn both_together_are_seen_at_least_as_well_as_the_plainer_one() {
        let (all, each) = seen(vec![
            law(PowerDrag { at_1_m_s_n: 0.02, exponent: 2.0 }),
            Fault::Output(OutputFault::Stiction { width: 0.1 }),
        ]);
        assert!(each.iter().all(|part| *part > 1.0 && *part <= all + 1e-9), "{all} {each:?}");
    }
}
