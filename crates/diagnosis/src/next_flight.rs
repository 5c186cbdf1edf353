//! The mission that best tells two hypotheses apart: T-optimal, the rival re-fitted (docs/diagnosis.md).

use std::{fmt::Write as _, path::PathBuf};

use bench_filter::{Noise, Pass, Point, Scored, Track, added, innovations, is_random, run};
use bench_inference::{Fit, Free, Problem, directions, fitted_effects, limited_step};
use bench_plant::effects::{EffectSpec, LIBRARY, RigNumber, index_of};
use bench_recording::Flight;
use bench_rig::{Chirp, EffectEntry, Location, Mission, Model, PhaseAction, PhasePlan, Profile, Rig};
use bench_statistics::ln_det;
use nalgebra::{DMatrix, DVector};
use rand::{Rng, RngExt as _, SeedableRng, seq::IndexedRandom as _};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::Serialize;
use thiserror::Error;

use crate::{diagnose::Candidate, weigh::same};

/// A mission that tells two hypotheses apart, and what it is expected to bring.
#[derive(Clone, Debug, Serialize)]
pub struct NextFlight {
    /// The two.
    pub between: [String; 2],
    /// What is flown, in words.
    pub flies: String,
    /// Expected gain of log-evidence of the true one over the other, nats: mean of the two below, weighted by how
    /// probable each is beside the other. No gain is told beyond 50 nats, which leave no doubt.
    pub gain: f64,
    /// The same where the first is true, and where the second is.
    pub gain_if: [f64; 2],
    /// The best of the given flights, flown once more, for comparison; none where the recordings hold no mission.
    pub repeat: Option<Repeat>,
    /// How many missions were flown in simulation to find it.
    pub tried: usize,
    /// What to fly.
    #[serde(skip)]
    pub mission: Mission,
}

/// One more flight of a mission that was given.
#[derive(Clone, Debug, Serialize)]
pub struct Repeat {
    /// The mission.
    pub mission: String,
    /// Expected gain as in [`NextFlight::gain`], nats.
    pub gain: f64,
}

/// Why no mission is proposed.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum NextFlightError {
    /// One hypothesis leads.
    #[error(
        "no next flight: nothing is close to {first} ({:.0} %); name two hypotheses with --between A,B to tell them apart all the same",
        100.0 * probability
    )]
    NothingClose {
        /// The leading hypothesis.
        first: String,
        /// Its probability.
        probability: f64,
    },
    /// Not a hypothesis.
    #[error("{name:?} is no hypothesis; `none`, or one or two of these joined by `+`: {known}")]
    UnknownName {
        /// What was asked for.
        name: String,
        /// What there is.
        known: String,
    },
    /// It does not move the airframe.
    #[error(
        "no next flight: {effect} does not show in how altitude follows throttle but in readbacks, ticks, frames or the spread of sightings, which any flight has; fly longer instead"
    )]
    NoLaw {
        /// The effect.
        effect: String,
    },
    /// Both are the same.
    #[error("--between wants two different hypotheses, not {name} twice")]
    Same {
        /// The one.
        name: String,
    },
    /// No candidate stays inside the envelope.
    #[error(
        "no next flight: none of {tried} missions stays below {limit_m:.2} m (most of the ceiling of {ceiling_m} m) and within {time_s} s under both hypotheses"
    )]
    NoneInside {
        /// How many were flown.
        tried: usize,
        /// Highest altitude allowed, m.
        limit_m: f64,
        /// The rig's ceiling, m.
        ceiling_m: f64,
        /// The rig's longest flight, s.
        time_s: f64,
    },
    /// No candidate helps.
    #[error(
        "no next flight: none of {tried} missions inside the envelope tells {first} from {second} (the best brings {gain:.1} nats); measure something else, such as mass, thrust on a stand or rotor speed"
    )]
    NoneHelps {
        /// One hypothesis.
        first: String,
        /// The other.
        second: String,
        /// What the best mission brings, nats.
        gain: f64,
        /// How many were flown.
        tried: usize,
    },
}

/// Probability beyond which the first hypothesis needs no rival.
const SURE: f64 = 0.7;
/// A rival this much less probable is not close.
const CLOSE: f64 = 0.05;
/// So many nats leave no doubt; more are not told, since linearised they are far off, and count next to nothing.
const PLAIN: f64 = 50.0;
const TIE: f64 = 1e-4;
/// Expected gain below which a mission is not worth flying, nats.
const WORTH_FLYING: f64 = 1.0;
/// How much of the ceiling is used: the tracker's noise and the hypotheses' spread must not stop the flight.
const OF_CEILING: f64 = 0.8;
/// How high set-points go, as a share of what may be used: the loop overshoots.
const HIGHEST_SETPOINT: f64 = 0.8;
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
/// Rounds of local search, and neighbours flown in each.
const ROUNDS: usize = 8;
const NEIGHBOURS: usize = 6;

/// The two leading hypotheses that a flight may tell apart, where they are close.
pub(crate) fn close(candidates: &[Candidate]) -> Option<[&Candidate; 2]> {
    let mut flyable = candidates.iter().filter(|candidate| Contender::of(candidate).is_ok());
    let (first, second) = (flyable.next()?, flyable.next()?);
    let near = candidates[0].probability < SURE && second.probability > CLOSE * first.probability;
    near.then_some([first, second])
}

/// A hypothesis that flights can show.
struct Contender {
    /// As it was asked for, or is told.
    name: String,
    /// Library indices of its laws.
    effects: Vec<usize>,
}

impl Contender {
    /// By name as it is written on the command line: effects joined by `+`, or `none`.
    fn named(name: &str) -> Result<Self, NextFlightError> {
        let unknown = |known: String| NextFlightError::UnknownName { name: name.to_owned(), known };
        let parts = if name == "none" { Vec::new() } else { name.split('+').collect() };
        let known = || LIBRARY.iter().map(|spec| spec.name).collect::<Vec<_>>().join(", ");
        let effects: Vec<usize> = parts
            .into_iter()
            .map(|part| index_of(part).ok_or_else(|| unknown(known())))
            .collect::<Result<_, _>>()?;
        Self::flown_apart(name, effects)
    }

    /// A candidate of a diagnosis.
    fn of(candidate: &Candidate) -> Result<Self, NextFlightError> {
        let Candidate { name, indices, .. } = candidate;
        let unnamed =
            || NextFlightError::UnknownName { name: name.clone(), known: "causes by name".to_owned() };
        Self::flown_apart(name, indices.clone().ok_or_else(unnamed)?)
    }

    /// Each of its effects must be a law of flight.
    fn flown_apart(name: &str, effects: Vec<usize>) -> Result<Self, NextFlightError> {
        for (position, effect) in effects.iter().enumerate() {
            let called = || LIBRARY[*effect].name.to_owned();
            if !fitted_effects().contains(effect) {
                return Err(NextFlightError::NoLaw { effect: called() });
            }
            if effects[..position].contains(effect) {
                return Err(NextFlightError::Same { name: called() });
            }
        }
        if effects.len() > 2 {
            let known = "two at most".to_owned();
            return Err(NextFlightError::UnknownName { name: name.to_owned(), known });
        }
        Ok(Self { name: name.to_owned(), effects })
    }

    fn pair(names: [&str; 2]) -> Result<[Self; 2], NextFlightError> {
        let (a, b) = (Self::named(names[0])?, Self::named(names[1])?);
        if same(&a.effects, &b.effects) { Err(NextFlightError::Same { name: a.name }) } else { Ok([a, b]) }
    }
}

impl NextFlight {
    /// Gains beyond this are not told, nats.
    pub const MOST: f64 = PLAIN;

    /// Checks two names of hypotheses, before the work.
    pub fn check(names: [&str; 2]) -> Result<(), NextFlightError> {
        Contender::pair(names).map(|_| ())
    }

    /// Finds the mission that best tells two hypotheses apart: those named in `between`, else the leading two of
    /// `candidates`. `flown` are the missions of the given flights, as far as they are known.
    ///
    /// `fly` flies a mission on a plant (first) under the controller of the nominal rig (second); it returns `None` where
    /// a safety stop ends the flight. It is called from several threads.
    pub fn propose(
        problem: &Problem<'_>,
        candidates: &[Candidate],
        between: Option<[&str; 2]>,
        flown: &[Mission],
        fly: impl Fn(&Rig, &Rig, &Mission) -> Option<Flight> + Sync,
    ) -> Result<Self, NextFlightError> {
        let contenders = match (between, close(candidates)) {
            (Some(names), _) => Contender::pair(names)?,
            (None, Some([first, second])) => [Contender::of(first)?, Contender::of(second)?],
            (None, None) => {
                let Candidate { name, probability, .. } = &candidates[0];
                return Err(NextFlightError::NothingClose { first: name.clone(), probability: *probability });
            }
        };
        let null = problem.fit_null();
        let fits = contenders.each_ref().map(|contender| fit(problem, &null, &contender.effects));
        let [p, q] = contenders.each_ref().map(|contender| {
            let known =
                |c: &&Candidate| c.indices.as_ref().is_some_and(|effects| same(&contender.effects, effects));
            candidates.iter().find(known).map_or(0.0, |c| c.probability).max(f64::MIN_POSITIVE)
        });
        let between = contenders.map(|contender| contender.name);
        let arena = Arena::new(problem, &fits, p / (p + q), &fly);

        let again: Vec<(&Mission, Gain)> =
            flown.par_iter().filter_map(|mission| Some((mission, arena.gain(mission, Drop::Any)?))).collect();
        let again = again.into_iter().max_by(|a, b| a.1.rank.total_cmp(&b.1.rank));
        let search = arena.search();
        let tried = search.tried + flown.len();
        let limit_m = arena.highest_m;
        let Some((best, gain)) = search.best else {
            let safety = problem.rig.safety;
            return Err(NextFlightError::NoneInside {
                tried,
                limit_m,
                ceiling_m: safety.ceiling_m,
                time_s: safety.flight_time_max_s,
            });
        };
        let repeat = again
            .as_ref()
            .map(|(mission, gain)| Repeat { mission: mission.name.clone(), gain: gain.expected });
        let (mut mission, flies, gain) = match again {
            // Nothing found beats what was flown already.
            Some((mission, again)) if again.rank >= gain.rank => {
                let flies = format!("{} once more", mission.name);
                (mission.clone(), flies, again)
            }
            _ => (arena.mission(&best), best.in_words(), gain),
        };
        if gain.expected < WORTH_FLYING {
            let [first, second] = between;
            return Err(NextFlightError::NoneHelps { first, second, gain: gain.expected, tried });
        }
        "next-flight".clone_into(&mut mission.name);
        mission.description = format!("Tells {} from {}: {flies}.", between[0], between[1]);
        Ok(Self { between, flies, gain: gain.expected, gain_if: gain.either, repeat, tried, mission })
    }

    /// The mission as a file, with a comment that says what it is for.
    pub fn to_toml(&self) -> String {
        let [first, second] = &self.between;
        let mut text = format!(
            "{MARK}\n# Tells {first} from {second}: expected gain {:.1} nats ({:.1} if {first} is true, {:.1} if {second} is).\n",
            self.gain, self.gain_if[0], self.gain_if[1]
        );
        if let Some(repeat) = &self.repeat {
            let _ = writeln!(text, "# {} once more would bring {:.1} nats.", repeat.mission, repeat.gain);
        }
        text + "# Fly it, and diagnose its recording together with the others.\n" + &self.mission.to_toml()
    }
}

/// The first line of a proposed mission's file.
pub const MARK: &str = "# Proposed by `bench diagnose --next-flight`.";

/// Fits a hypothesis to the given flights.
fn fit(problem: &Problem<'_>, null: &Fit, effects: &[usize]) -> Fit {
    let mut fit = null.clone();
    for effect in effects {
        let mut starts: Vec<Point> =
            problem.promises(&fit, &[*effect], 1).into_iter().map(|promise| promise.start).collect();
        if starts.is_empty() {
            // These flights do not feel it at all: what is thought of it beforehand.
            let typical =
                LIBRARY[*effect].parameters.iter().map(|p| p.default.unwrap_or(p.prior.typical())).collect();
            let mut start = fit.point.clone();
            start.effects.push((*effect, typical));
            starts.push(start);
        }
        let refined: Vec<Fit> =
            starts.into_par_iter().map(|start| problem.refine(start, fit.noise)).collect();
        if let Some(best) = refined.into_iter().max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence)) {
            fit = best;
        }
    }
    fit
}

/// What a mission is expected to bring, nats.
#[derive(Clone, Copy, Debug)]
struct Gain {
    /// If the first is true, if the second is.
    either: [f64; 2],
    expected: f64,
    /// By what missions are compared.
    rank: f64,
}

/// Whether the rotors may stop in the air.
#[derive(Clone, Copy, PartialEq)]
enum Drop {
    /// A mission that somebody flew already.
    Any,
    /// Low only.
    Low,
}

/// Where candidates compete.
struct Arena<'a, F> {
    problem: &'a Problem<'a>,
    fits: &'a [Fit; 2],
    /// The two as rigs without noise.
    plants: [Rig; 2],
    noises: [Noises; 2],
    /// Probability of the first beside the second.
    first: f64,
    fly: &'a F,
    highest_m: f64,
    lowest_m: f64,
    /// Time in the air, landing left out, s.
    time_s: f64,
}

impl<'a, F: Fn(&Rig, &Rig, &Mission) -> Option<Flight> + Sync> Arena<'a, F> {
    fn new(problem: &'a Problem<'a>, fits: &'a [Fit; 2], first: f64, fly: &'a F) -> Self {
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
    fn gain(&self, mission: &Mission, drop: Drop) -> Option<Gain> {
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
            let end_m = track.sightings.last().map_or(0.0, |sighting| sighting.z_m);
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

/// A candidate: what is flown between launch and landing.
#[derive(Clone, Debug, PartialEq)]
enum Shape {
    /// Closed loop on altitudes.
    Hold {
        /// Altitudes one after another, m.
        levels_m: Vec<f64>,
        /// Each level's share of the time; any unit.
        shares: Vec<f64>,
        /// Straight lines from level to level instead of steps.
        ramps: bool,
        /// Amplitude, m, and frequencies.
        chirp: Option<Chirp>,
    },
    /// Open loop inside the ground effect.
    Hop {
        /// Thrust-to-weight ratios one after another, each for an equal time.
        ratios: Vec<f64>,
        /// Amplitude and frequencies.
        chirp: Option<Chirp>,
    },
}

const LAUNCH_THRUST_TO_WEIGHT: f64 = 1.12;
const LAUNCH_S: f64 = 0.8;
/// A hold shorter than this shows nothing, s.
const SHORTEST_HOLD_S: f64 = 4.0;
const LAND_DESCENT_M_S: f64 = 0.2;
const LAND_FROM_M: f64 = 0.3;
/// What a landing from there takes, with the settling, s.
const LAND_S: f64 = 3.0;
/// Lowest set-point, m.
const LOWEST_M: f64 = 0.03;
/// Knots of a profile.
const KNOTS: std::ops::RangeInclusive<usize> = 1..=10;
const RATIOS: std::ops::RangeInclusive<f64> = 0.85..=1.0;
const CHIRP_HZ: std::ops::RangeInclusive<f64> = 0.05..=1.5;

fn rounded(x: f64, step: f64) -> f64 {
    let per_unit = step.recip().round();
    (x * per_unit).round() / per_unit
}

impl Shape {
    fn steps(levels_m: &[f64]) -> Self {
        let shares = vec![1.0; levels_m.len()];
        Self::Hold { levels_m: levels_m.to_vec(), shares, ramps: false, chirp: None }
    }

    fn ramps(levels_m: &[f64]) -> Self {
        let shares = vec![1.0; levels_m.len()];
        Self::Hold { levels_m: levels_m.to_vec(), shares, ramps: true, chirp: None }
    }

    fn with(mut self, amplitude: f64, from_hz: f64, to_hz: f64) -> Self {
        let (Self::Hold { chirp, .. } | Self::Hop { chirp, .. }) = &mut self;
        *chirp = Some(Chirp { amplitude, from_hz, to_hz });
        self
    }

    fn in_words(&self) -> String {
        let swept = |chirp: &Option<Chirp>, unit: &str| {
            chirp.map_or(String::new(), |c| {
                format!(", a sine of {}{unit} swept from {} to {} Hz on top", c.amplitude, c.from_hz, c.to_hz)
            })
        };
        let list = |values: &[f64]| values.iter().map(f64::to_string).collect::<Vec<_>>().join(", ");
        match self {
            Self::Hold { levels_m, ramps, chirp, .. } => {
                let how = match (levels_m.len(), ramps) {
                    (1, _) => "hold at",
                    (_, true) => "ramps between",
                    (_, false) => "steps between",
                };
                format!("{how} {} m{}", list(levels_m), swept(chirp, " m"))
            }
            Self::Hop { ratios, chirp } => {
                format!("hops at thrust-to-weight {}{}", list(ratios), swept(chirp, ""))
            }
        }
    }
}

/// What a search found.
struct Found {
    best: Option<(Shape, Gain)>,
    tried: usize,
}

impl<F: Fn(&Rig, &Rig, &Mission) -> Option<Flight> + Sync> Arena<'_, F> {
    /// The best of a structured family, then of what lies around it. It draws from a fixed seed.
    fn search(&self) -> Found {
        let score = |shapes: Vec<Shape>| -> Vec<(Shape, Gain)> {
            shapes
                .into_par_iter()
                .filter_map(|shape| Some((self.gain(&self.mission(&shape), Drop::Low)?, shape)))
                .map(|(gain, shape)| (shape, gain))
                .collect()
        };
        let family = self.family();
        let mut tried = family.len();
        let mut found = score(family);
        let sort = |found: &mut Vec<(Shape, Gain)>| {
            found.sort_by(|a, b| b.1.rank.total_cmp(&a.1.rank));
            found.truncate(3);
        };
        sort(&mut found);
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        for _ in 0..ROUNDS {
            let mut around: Vec<Shape> = Vec::new();
            for i in 0..NEIGHBOURS {
                // Mostly about the best.
                let Some((parent, _)) = found.get([0, 1, 0, 2][i % 4]).or(found.first()) else { break };
                around.push(self.neighbour(parent, &mut rng));
            }
            tried += around.len();
            found.extend(score(around));
            sort(&mut found);
        }
        Found { best: found.into_iter().next(), tried }
    }

    /// Profiles of all kinds: dwells low and high, steps, ramps, drops, swept sines, hops.
    fn family(&self) -> Vec<Shape> {
        let top = rounded(HIGHEST_SETPOINT * self.highest_m, 0.05);
        let at = |share: f64| self.level(share * top);
        let low = self.level(self.lowest_m);
        let ground = self.level(1.4 * self.problem.rig.airframe.ground_effect.height_m.value);
        let swings =
            |a: f64, b: f64, n: usize| (0..n).map(|i| if i % 2 == 0 { a } else { b }).collect::<Vec<_>>();
        let hop = |ratios: &[f64]| Shape::Hop { ratios: ratios.to_vec(), chirp: None };
        let mut family = vec![
            Shape::steps(&[at(0.25)]),
            Shape::steps(&[at(0.5)]),
            Shape::steps(&[at(1.0)]),
            Shape::steps(&[at(0.2), ground]),
            Shape::steps(&[at(0.2), low]),
            Shape::steps(&[at(0.2), ground, low, ground, low, ground]),
            Shape::steps(&[at(0.2), at(0.4), at(0.6), at(0.8), at(1.0), at(0.5)]),
            Shape::ramps(&[at(0.2), low, at(0.2), low, at(0.2)]),
        ];
        for n in [4, 6, 8] {
            family.push(Shape::steps(&swings(at(1.0), at(0.2), n)));
            family.push(Shape::ramps(&swings(at(1.0), at(0.2), n)));
            family.push(Shape::steps(&swings(at(0.6), at(0.3), n)));
        }
        for (share, amplitude, from_hz, to_hz) in
            [(0.4, 0.12, 0.1, 0.6), (0.5, 0.3, 0.05, 0.3), (0.3, 0.08, 0.3, 1.2), (0.12, 0.05, 0.1, 0.6)]
        {
            family.push(Shape::steps(&[at(share)]).with(amplitude, from_hz, to_hz));
        }
        for ratio in [0.9, 0.94, 0.98] {
            family.push(hop(&[ratio]));
        }
        family.push(hop(&[0.98, 0.92, 0.97, 0.9, 0.95, 0.88]));
        family.push(hop(&[0.95]).with(0.03, 0.2, 1.2));
        family
    }

    fn level(&self, z_m: f64) -> f64 {
        // A ceiling below the lowest level leaves no candidate inside the envelope.
        rounded(z_m.min(HIGHEST_SETPOINT * self.highest_m).max(self.lowest_m), 0.01)
    }

    /// A profile with one thing or two changed.
    fn neighbour(&self, shape: &Shape, rng: &mut impl Rng) -> Shape {
        let mut shape = shape.clone();
        for _ in 0..rng.random_range(1..=2) {
            match &mut shape {
                Shape::Hold { levels_m, shares, ramps, chirp } => match rng.random_range(0..8) {
                    0..=2 => {
                        let i = rng.random_range(0..levels_m.len());
                        levels_m[i] = self.any_level(rng);
                    }
                    3 => {
                        let i = rng.random_range(0..shares.len());
                        shares[i] = *[0.5, 1.0, 2.0].choose(rng).unwrap_or(&1.0);
                    }
                    4 if levels_m.len() < *KNOTS.end() => {
                        let i = rng.random_range(0..=levels_m.len());
                        levels_m.insert(i, self.any_level(rng));
                        shares.insert(i, 1.0);
                    }
                    5 if levels_m.len() > *KNOTS.start() => {
                        let i = rng.random_range(0..levels_m.len());
                        levels_m.remove(i);
                        shares.remove(i);
                    }
                    6 => *ramps = !*ramps,
                    _ => *chirp = some_chirp(rng, 0.3 * self.highest_m),
                },
                Shape::Hop { ratios, chirp } => match rng.random_range(0..5) {
                    0 if ratios.len() < *KNOTS.end() => ratios.push(rounded(rng.random_range(RATIOS), 0.01)),
                    1 if ratios.len() > 1 => _ = ratios.pop(),
                    2 => *chirp = some_chirp(rng, 0.06),
                    _ => {
                        let i = rng.random_range(0..ratios.len());
                        ratios[i] = rounded(rng.random_range(RATIOS), 0.01);
                    }
                },
            }
        }
        shape
    }

    /// Low and high are equally likely, on a scale of ratios.
    fn any_level(&self, rng: &mut impl Rng) -> f64 {
        let ends = [self.lowest_m.ln(), (HIGHEST_SETPOINT * self.highest_m).max(1.01 * self.lowest_m).ln()];
        self.level(rng.random_range(ends[0]..ends[1]).exp())
    }

    /// The mission of a profile.
    fn mission(&self, shape: &Shape) -> Mission {
        let phase = |action: PhaseAction, duration_s: f64| PhasePlan { action, duration_s };
        let constant = Profile::constant;
        let mut phases = vec![phase(PhaseAction::Idle, 1.0)];
        match shape {
            Shape::Hold { levels_m, shares, ramps, chirp } => {
                // From high up, the landing takes as long as it takes.
                let top_m = levels_m.last().copied().unwrap_or(0.0) + chirp.map_or(0.0, |c| c.amplitude);
                let down_s = LAND_S + (top_m - LAND_FROM_M).max(0.0) / LAND_DESCENT_M_S;
                let land_s = down_s.ceil() + 2.0;
                let longest_s = self.problem.rig.safety.flight_time_max_s - land_s;
                let hold_s = (self.time_s.min(longest_s) - LAUNCH_S).max(SHORTEST_HOLD_S);
                let hold_s = (10.0 * hold_s).floor() / 10.0;
                let launch = PhaseAction::Launch { thrust_to_weight: constant(LAUNCH_THRUST_TO_WEIGHT) };
                phases.push(phase(launch, LAUNCH_S));
                let hold = PhaseAction::Hold {
                    altitude_m: profile(levels_m, shares, *ramps, hold_s),
                    x_m: constant(0.0),
                    y_m: constant(0.0),
                    heading_rad: constant(0.0),
                    chirp: *chirp,
                };
                phases.push(phase(hold, hold_s));
                let land = PhaseAction::Land { descent_m_s: LAND_DESCENT_M_S, cut_below_m: 0.06 };
                phases.push(phase(land, land_s));
            }
            Shape::Hop { ratios, chirp } => {
                let open_s = (10.0 * self.time_s).floor() / 10.0;
                let thrust_to_weight = profile(ratios, &vec![1.0; ratios.len()], false, open_s);
                phases.push(phase(PhaseAction::Open { thrust_to_weight, chirp: *chirp }, open_s));
            }
        }
        Mission { name: "candidate".to_owned(), phases, ..Mission::default() }
    }
}

/// Values one after another over a time, as steps or as straight lines.
fn profile(values: &[f64], shares: &[f64], ramps: bool, duration_s: f64) -> Profile {
    let total: f64 = shares.iter().sum();
    let mut points = Vec::with_capacity(2 * values.len());
    let mut from_s = 0.0;
    for (value, share) in values.iter().zip(shares) {
        let to_s = rounded(from_s + share / total * duration_s, 0.1);
        points.push([from_s, *value]);
        if !ramps {
            points.push([to_s, *value]);
        }
        from_s = to_s;
    }
    if values.len() == 1 {
        return Profile::constant(values[0]);
    }
    if !ramps {
        points.pop();
    }
    Profile::from_points(points).unwrap_or_default()
}

fn some_chirp(rng: &mut impl Rng, most: f64) -> Option<Chirp> {
    if rng.random_range(0..4) == 0 {
        return None;
    }
    let mut hz = || rounded(rng.random_range(CHIRP_HZ.start().ln()..CHIRP_HZ.end().ln()).exp(), 0.05);
    let (from_hz, to_hz) = (hz(), hz());
    Some(Chirp { amplitude: rounded(rng.random_range(0.1..1.0) * most, 0.01).max(0.01), from_hz, to_hz })
}
