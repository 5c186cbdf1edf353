//! What a mission would bring: both hypotheses fly it without noise, and each is re-fitted to what the other flew.

use std::path::PathBuf;

use bench_filter::{Noise, Pass, Point, Scored, Track, added, innovations, is_random, run};
use bench_inference::{Fit, Free, Problem, directions, limited_step};
use bench_plant::effects::{EffectSpec, LIBRARY, RigNumber};
use bench_recording::Flight;
use bench_rig::{EffectEntry, Location, Mission, Model, PhaseAction, Rig};
use bench_statistics::ln_det;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::{
    PLAIN,
    profile::{LAND_S, LOWEST_M},
};

const TIE: f64 = 1e-4;
/// How much of the ceiling is used: the tracker's noise and the hypotheses' spread must not stop the flight.
const OF_CEILING: f64 = 0.8;
/// An open-loop flight ends with the rotors off: at this altitude at most, m.
const DROP_M: f64 = 0.2;
/// Time in the air, s: that of the longest flight given, within these bounds.
const SHORTEST_S: f64 = 12.0;
const LONGEST_S: f64 = 40.0;
/// Passes of a re-fit, and what a step must promise, nats.
const REFIT_PASSES: usize = 8;
const WORTH_A_STEP: f64 = 0.05;
/// Factors of turbulence by which a wrong hypothesis may excuse itself.
const TURBULENCE_FACTORS: [f64; 8] = [1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0, 16.0];

/// What a mission is expected to bring, nats.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gain {
    /// If the first is true, if the second is.
    pub(super) either: [f64; 2],
    pub(super) expected: f64,
    /// By what missions are compared.
    pub(super) rank: f64,
}

/// Whether the rotors may stop in the air.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Drop {
    /// A mission that somebody flew already.
    Any,
    /// Low only.
    Low,
}

/// Where candidates compete.
pub(super) struct Arena<'a, F> {
    pub(super) problem: &'a Problem<'a>,
    fits: &'a [Fit; 2],
    /// The two as rigs without noise.
    plants: [Rig; 2],
    noises: [Noises; 2],
    /// Probability of the first beside the second.
    first: f64,
    fly: &'a F,
    pub(super) highest_m: f64,
    pub(super) lowest_m: f64,
    /// Time in the air, landing left out, s.
    pub(super) time_s: f64,
}

impl<'a, F: Fn(&Rig, &Rig, &Mission) -> Option<Flight> + Sync> Arena<'a, F> {
    pub(super) fn new(problem: &'a Problem<'a>, fits: &'a [Fit; 2], first: f64, fly: &'a F) -> Self {
        let rig = problem.rig;
        let longest_s = problem.tracks.iter().map(|track| track.end_s - track.begin_s).fold(0.0, f64::max);
        Self {
            problem,
            fits,
            noises: [Noises::of(problem, &fits[0]), Noises::of(problem, &fits[1])],
            plants: [plant(rig, &fits[0].point), plant(rig, &fits[1].point)],
            first,
            fly,
            highest_m: OF_CEILING * rig.safety.ceiling_m,
            lowest_m: (0.6 * rig.airframe.ground_effect.height_m.value).max(LOWEST_M),
            time_s: (longest_s - LAND_S).clamp(SHORTEST_S, LONGEST_S).min(rig.safety.flight_time_max_s),
        }
    }

    /// What a mission brings; `None` where it leaves the envelope under one of the two, or shows nothing.
    pub(super) fn gain(&self, mission: &Mission, drop: Drop) -> Option<Gain> {
        let in_air = mission.phases.iter().filter(|plan| plan.action != PhaseAction::Idle);
        if in_air.map(|plan| plan.duration_s).sum::<f64>() > self.problem.rig.safety.flight_time_max_s + 1e-9
        {
            return None;
        }
        let one = |truth: usize| {
            let flight = (self.fly)(&self.plants[truth], self.problem.rig, mission)?;
            let inside = |z: f64| z <= self.highest_m;
            if !flight.positions.iter().all(|position| inside(position.position_m[2])) {
                return None;
            }
            let track = Track::from_flight(&mission.name, &flight, self.problem.rig).ok()?;
            let end_m = track.measurements.last().map_or(0.0, |measurement| measurement.z_m);
            if drop == Drop::Low && end_m > DROP_M {
                return None;
            }
            let tracks = [track];
            let own = self.noises[truth].own(self.problem, &self.fits[truth]);
            let own = expect(self.problem, &self.fits[truth], &own, &tracks, None, None)?;
            let rival = self.rival(1 - truth, &tracks, &own)?;
            Some(rival.nll - own.nll + 0.5 * (rival.width - own.width)).filter(|gain| gain.is_finite())
        };
        let found = [one(0)?, one(1)?];
        let mean = |[a, b]: [f64; 2]| self.first * a + (1.0 - self.first) * b;
        let either = found.map(|gain| gain.min(PLAIN));
        Some(Gain { either, expected: mean(either), rank: mean(either) + mean(found) * TIE })
    }

    /// What the wrong hypothesis makes of a flight, free to call its errors turbulence at the price that the given
    /// flights ask for that.
    fn rival(&self, which: usize, tracks: &[Track], truth: &Expectation) -> Option<Expectation> {
        let mut best: Option<Expectation> = None;
        for (noise, price) in &self.noises[which].0 {
            let fit = &self.fits[which];
            let full = added(&fit.point, noise, self.problem.rig);
            let start = best.as_ref().map(|best| &best.point);
            let mut found = expect(self.problem, fit, &full, tracks, Some(&truth.variances_m2), start)?;
            found.nll += price;
            if best.as_ref().is_some_and(|best| best.nll <= found.nll) {
                break;
            }
            best = Some(found);
        }
        best
    }
}

/// Noise of a fit at rising turbulence, and what each costs on the given flights, nats.
struct Noises(Vec<(Noise, f64)>);

impl Noises {
    fn of(problem: &Problem<'_>, fit: &Fit) -> Self {
        let with = |factor: f64| Noise { turbulence: factor * fit.noise.turbulence, ..fit.noise };
        let objective = |noise: &Noise| problem.objective(&fit.point, noise, &fit.free);
        let least = objective(&fit.noise);
        let steps = TURBULENCE_FACTORS.par_iter().map(|factor| {
            let noise = with(*factor);
            (noise, (objective(&noise) - least).max(0.0))
        });
        Self(steps.collect())
    }

    /// The fit's own.
    fn own(&self, problem: &Problem<'_>, fit: &Fit) -> Noise {
        added(&fit.point, &self.0[0].0, problem.rig)
    }
}

/// What a hypothesis makes of a flight after all the others.
struct Expectation {
    /// Expected negative log-likelihood with the parameters moved to where all flights together want them, the cost to
    /// the others included.
    nll: f64,
    /// How much narrower the flight makes its parameters: `ln det (H + F) - ln det H - tr (H + F)^-1 F`.
    width: f64,
    /// Variances that it expects of the innovations, m^2.
    variances_m2: Vec<f64>,
    /// Where its parameters went.
    point: Point,
}

/// Re-fits a hypothesis to one more flight without noise; the others are the parabola of its posterior. `truth` are the
/// innovations' true variances, where it is not the true hypothesis itself; `start` is where to begin instead of at the
/// fit.
fn expect(
    problem: &Problem<'_>,
    fit: &Fit,
    noise: &Noise,
    tracks: &[Track],
    truth: Option<&[f64]>,
    start: Option<&Point>,
) -> Option<Expectation> {
    let free: &[Free] = &fit.free;
    let before = &fit.hessian;
    let own = |point: &Point| DVector::from_iterator(free.len(), free.iter().map(|f| f.own(point.get(f.at))));
    let mode = own(&fit.point);
    let look = |point: Point| {
        let pass = run(tracks, problem.rig, &point, noise, &directions(free, &point));
        let moved = own(&point) - &mode;
        let pull = before * &moved;
        let slopes = DVector::from_iterator(free.len(), free.iter().map(|f| f.slope(point.get(f.at))));
        let information =
            DMatrix::from_fn(free.len(), free.len(), |i, j| pass.information[(i, j)] * slopes[i] * slopes[j]);
        let gradient = pass.gradient.component_mul(&slopes) - &pull;
        Look { cost: 0.5 * moved.dot(&pull), pass, gradient, information, point }
    };
    let mut here = look(start.unwrap_or(&fit.point).clone());
    let mut share = 1.0;
    for _ in 0..if truth.is_some() { REFIT_PASSES } else { 0 } {
        let step = limited_step(free, &(before + &here.information), &here.gradient)? * share;
        if here.gradient.dot(&step) < WORTH_A_STEP {
            break;
        }
        let mut next = here.point.clone();
        for (f, dx) in free.iter().zip(step.iter()) {
            *next.get_mut(f.at) = f.value(f.own(here.point.get(f.at)) + dx);
        }
        let there = look(next);
        if there.pass.nll + there.cost < here.pass.nll + here.cost {
            here = there;
            share = 1.0;
        } else {
            share *= 0.3;
        }
    }
    let predicted = problem.with_tracks(tracks).predict(&here.point, noise);
    let variances_m2: Vec<f64> = innovations(&predicted).map(|innovation| innovation.variance_m2).collect();
    let nll = innovations(&predicted).zip(truth.unwrap_or(&variances_m2)).map(|(innovation, true_m2)| {
        Scored::bounded(innovation.residual_m.hypot(true_m2.sqrt()), innovation.variance_m2).nll
    });
    let nll = nll.sum::<f64>() + here.cost;
    let after = (before + &here.information).cholesky()?;
    let width = ln_det(&after) - ln_det(&before.clone().cholesky()?) - after.solve(&here.information).trace();
    Some(Expectation { nll, width, variances_m2, point: here.point })
}

/// A point at which a flight was looked at.
struct Look {
    pass: Pass,
    /// Cost to the given flights, nats.
    cost: f64,
    gradient: DVector<f64>,
    information: DMatrix<f64>,
    point: Point,
}

/// A point of the parameter space as a rig to fly on, without noise: what is expected is asked for.
fn plant(rig: &Rig, point: &Point) -> Rig {
    let mut plant = rig.clone();
    plant.plant.model = Model::Vertical;
    plant.tracker.noise_m = 0.0;
    plant.tracker.resolution_m = 0.0;
    plant.tracker.dropout_probability = 0.0;
    let n = &point.nuisances;
    plant.airframe = point.airframe(rig);
    let mut effects: Vec<(usize, Vec<f64>)> =
        point.effects.iter().filter(|(effect, _)| !is_random(*effect)).cloned().collect();
    // Latency and origin are what the tracker does, not what it believes.
    let mut add = |number: RigNumber, value: f64| {
        let adds = |spec: &EffectSpec| spec.signature.adds_to.iter().find(|(to, _)| *to == number).copied();
        let found = LIBRARY.iter().enumerate().find_map(|(index, spec)| Some((index, adds(spec)?.1)));
        let Some((index, parameter)) = found else { return };
        let at = effects.iter().position(|(effect, _)| *effect == index).unwrap_or_else(|| {
            effects.push((index, vec![0.0; LIBRARY[index].parameters.len()]));
            effects.len() - 1
        });
        let p = LIBRARY[index].parameters[parameter];
        let sum = &mut effects[at].1[parameter];
        *sum = (*sum + value).clamp(p.min, p.max);
    };
    add(RigNumber::Latency, n[RigNumber::Latency] - rig.tracker.latency_s.value);
    add(RigNumber::Origin, n[RigNumber::Origin]);
    plant.effects = effects.into_iter().map(|(index, values)| entry(index, &values)).collect();
    plant
}

fn entry(index: usize, values: &[f64]) -> EffectEntry {
    let spec = LIBRARY[index];
    EffectEntry {
        name: spec.name.to_owned(),
        parameters: spec.parameters.iter().zip(values).map(|(p, x)| (p.key.to_owned(), *x, 1)).collect(),
        at: Location { file: PathBuf::from("hypothesis"), line: 1 },
    }
}
