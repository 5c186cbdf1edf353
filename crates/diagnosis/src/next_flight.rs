//! The mission that best tells two hypotheses apart: T-optimal, the rival re-fitted (docs/diagnosis.md).

use std::fmt::Write as _;

use bench_filter::Point;
use bench_inference::{Fit, Problem, fitted_effects};
use bench_plant::effects::{LIBRARY, index_of};
use bench_recording::Flight;
use bench_rig::{Mission, Rig};
use rayon::prelude::*;
use serde::Serialize;
use thiserror::Error;

mod arena;
mod profile;

use arena::{Arena, Drop, Gain};

use crate::{diagnose::Candidate, hypothesis::same};

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
        "no next flight: {effect} does not show in how altitude follows throttle but in readbacks, ticks, frames or the spread of measurements, which any flight has; fly longer instead"
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
/// Expected gain below which a mission is not worth flying, nats.
const WORTH_FLYING: f64 = 1.0;

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
