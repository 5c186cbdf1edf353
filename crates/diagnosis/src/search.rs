//! Which hypotheses are fitted: none, every effect, and pairs built forward on the best.

use bench_plant::effects::{LIBRARY, index_of};
use rayon::prelude::*;

use crate::{
    fit::{Descent, Fit, MAX_PASSES, Problem, Promise},
    law::Point,
    random::{self, is_random},
};

/// Effects whose law acts on altitude or on the tracker's view of it. The others show directly in readbacks, ticks and
/// frames, or as noise.
const FITTED: [&str; 16] = [
    "tracker-latency",
    "tracker-scale",
    "actuator-lag",
    "rotor-lag",
    "thrust-curve",
    "thrust-loss",
    "battery-discharge",
    "battery-load",
    "ground-effect-shape",
    "ground-effect-dynamic",
    "ceiling-effect",
    "updraft",
    "mass-change",
    "quadratic-drag",
    "descent-thrust-loss",
    "inflow-damping",
];

/// Cosine of a tilt that would show, if vertical thrust were not kept up in it.
const TILTED: f64 = 0.995;
/// The best singles on which pairs are built.
const PAIR_BASES: usize = 3;
/// So many of the most promising are fitted.
const SINGLES_REFINED: usize = 14;
const PAIRS_REFINED: usize = 5;
/// Gain, nats, below which nothing is built on a single, or no second is tried.
const WORTH_A_SECOND: f64 = 2.0;

/// All fits of one diagnosis: the null first.
pub struct Search {
    /// The fits.
    pub fits: Vec<Fit>,
}

/// Library indices of the effects that the filter can fit.
pub fn fitted_effects() -> Vec<usize> {
    FITTED.iter().filter_map(|name| index_of(name)).collect()
}

impl Search {
    /// Fits all hypotheses that are worth it.
    pub fn of(problem: &Problem<'_>) -> Self {
        let null = problem.fit_null();
        let mut effects = fitted_effects();
        if problem.tracks.iter().flat_map(|track| &track.tilt).any(|(_, cosine)| *cosine < TILTED) {
            effects.extend(index_of("tilt-loss"));
        }
        // Where frames keep a clock, what is late or lost shows in their arrivals or nowhere.
        let clocked = problem.tracks.iter().any(|track| !track.waits_s.is_empty());
        let random: Vec<usize> = (0..LIBRARY.len())
            .filter(|effect| {
                is_random(*effect)
                    && !(clocked && ["tracker-jitter", "tracker-dropout"].contains(&LIBRARY[*effect].name))
            })
            .collect();
        let promises = problem.promises(&null, &effects, SINGLES_REFINED);
        let mut singles = refine(problem, &null, promises, SINGLES_UNFOLDED);
        singles.par_extend(random.par_iter().filter_map(|effect| random::fit_with(problem, &null, *effect)));
        singles.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));

        // A second effect is worth a look only on top of a first one that is.
        let seconds = |base: &Fit, effects: &[usize], unfolded: usize| {
            let promises = problem.promises(base, effects, PAIRS_REFINED);
            let worth = promises.into_iter().filter(|promise| promise.gain > WORTH_A_SECOND).collect();
            refine(problem, base, worth, unfolded)
        };
        let bases: Vec<&Fit> = singles
            .iter()
            .filter(|single| !is_random(single.point.effects[0].0))
            .take(PAIR_BASES)
            .filter(|single| single.log_evidence > null.log_evidence + WORTH_A_SECOND)
            .collect();
        let others = |taken: &[usize]| -> Vec<usize> {
            effects.iter().copied().filter(|effect| !taken.contains(effect)).collect()
        };
        let all_seconds = |base: &Fit| {
            let mut pairs = seconds(base, &others(&base.effects()), SECONDS_UNFOLDED);
            pairs.par_extend(random.par_iter().filter_map(|effect| random::fit_with(problem, base, *effect)));
            pairs
        };
        let mut pairs: Vec<Fit> = Vec::new();
        if let Some((best, lesser)) = bases.split_first() {
            pairs.extend(all_seconds(best));
            let mut done = best.effects();
            for base in lesser {
                done.extend(base.effects());
                pairs.extend(seconds(base, &others(&done), 0));
            }
        }
        let again = again(problem, &bases, &pairs);
        if let Some(found) = &again {
            pairs.extend(all_seconds(found));
        }
        // Under noise that a random effect brings, laws show that the null's own noise would drown or invent.
        let spreads: Vec<&Fit> = singles
            .iter()
            .filter(|single| is_random(single.point.effects[0].0))
            .filter(|single| single.log_evidence > null.log_evidence + WORTH_A_SECOND)
            .collect();
        if let Some((first, others)) = spreads.split_first() {
            pairs.extend(seconds(first, &effects, SECONDS_UNFOLDED));
            pairs.par_extend(
                others.par_iter().filter_map(|other| random::fit_with_both(problem, &null, [*first, *other])),
            );
            // One that leads may hide another that would explain nothing alone.
            if is_random(singles[0].point.effects[0].0) {
                let hidden: Vec<usize> = random
                    .iter()
                    .copied()
                    .filter(|effect| spreads.iter().all(|spread| spread.effects() != [*effect]))
                    .collect();
                pairs.par_extend(
                    hidden.par_iter().filter_map(|effect| random::fit_beside(problem, &null, first, *effect)),
                );
            }
        }
        let mut fits = vec![null];
        fits.extend(again);
        fits.extend(singles);
        fits.extend(pairs);
        Self { fits }
    }

    /// Gain of log-evidence of a fit over the null's, nats.
    pub fn gain(&self, fit: usize) -> f64 {
        self.fits[fit].log_evidence - self.fits[0].log_evidence
    }

    /// The best gain of any one of these effects alone.
    pub fn alone(&self, effects: &[usize]) -> f64 {
        (1..self.fits.len())
            .filter(|i| {
                let own = &self.fits[*i].point.effects;
                own.len() == 1 && effects.contains(&own[0].0)
            })
            .map(|i| self.gain(i))
            .fold(0.0, f64::max)
    }
}

/// A pair that is so many nats ahead of one of its laws may stand where that law alone had not found the way.
const AGAIN_NATS: f64 = 8.0;

/// The better law of the best pair, fitted anew alone from where it stands there; `None` where that gains nothing.
fn again(problem: &Problem<'_>, bases: &[&Fit], pairs: &[Fit]) -> Option<Fit> {
    let best = pairs.iter().max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence))?;
    let base = bases.iter().find(|base| best.effects().contains(&base.point.effects[0].0))?;
    if best.log_evidence < base.log_evidence + AGAIN_NATS {
        return None;
    }
    let mut start = best.point.clone();
    start.effects.retain(|(effect, _)| *effect == base.point.effects[0].0);
    Some(problem.refine(start, best.noise)).filter(|fit| fit.log_evidence > base.log_evidence)
}

/// Passes after which fits are compared, and nats by which one may be behind the best then to be followed to its end.
const FIRST_PASSES: usize = 5;
const FOLLOWED_NATS: f64 = 60.0;
/// So many of the best single effects are then fitted in other than their plainest form, and of the laws on top of the best
/// law and of the strongest noise,
const SINGLES_UNFOLDED: usize = 4;
const SECONDS_UNFOLDED: usize = 1;
/// where they are not behind the best by more than that, or than this share of what it gains.
const FORM_SHARE: f64 = 0.3;

/// A start that is so many nats worse than what it stands on went too far along a straight line: it is halved so often.
const OVERSHOT_NATS: f64 = 20.0;
const MOST_HALVINGS: usize = 3;

/// A start half as far from the point that it stands on: the size of the effect that it adds, last, and all that moved with it.
fn nearer(base: &Point, mut start: Point) -> Point {
    for (value, from) in start.nuisances.iter_mut().zip(base.nuisances) {
        *value = 0.5 * (*value + from);
    }
    for ((_, values), (_, from)) in start.effects.iter_mut().zip(&base.effects) {
        for (value, from) in values.iter_mut().zip(from) {
            *value = 0.5 * (*value + from);
        }
    }
    if let Some((effect, values)) = start.effects.last_mut() {
        for (value, p) in values.iter_mut().zip(LIBRARY[*effect].parameters) {
            if let Some(neutral) = p.neutral {
                *value = 0.5 * (*value + neutral);
            }
        }
    }
    start
}

/// Fits starts, with the random effects of what they stand on as those are; of those of one effect, the better fit.
fn refine(problem: &Problem<'_>, base: &Fit, promises: Vec<Promise>, most_unfolded: usize) -> Vec<Fit> {
    let mut descents: Vec<Descent> = promises
        .into_par_iter()
        .map(|promise| {
            let mut start = promise.start;
            let mut descent = problem.descent(start.clone(), base.noise, base.point.effects.len());
            let halvings = if base.point.effects.is_empty() { 0 } else { MOST_HALVINGS };
            for _ in 0..halvings {
                if descent.objective() < base.objective + OVERSHOT_NATS {
                    break;
                }
                start = nearer(&base.point, start);
                descent = problem.descent(start.clone(), base.noise, base.point.effects.len());
            }
            descent.go(problem, FIRST_PASSES);
            descent
        })
        .collect();
    descents.sort_by(|a, b| b.log_evidence().total_cmp(&a.log_evidence()));
    let best = descents.first().map_or(0.0, Descent::log_evidence);
    let worth_another_form = best - FOLLOWED_NATS.max(FORM_SHARE * (best - base.log_evidence));
    let mut leading: Vec<Vec<usize>> = Vec::new();
    let unfolded: Vec<bool> = descents
        .iter()
        .map(|descent| {
            let effects = descent.effects();
            let leads = leading.len() < most_unfolded
                && !leading.contains(&effects)
                && descent.log_evidence() > worth_another_form;
            leading.extend(leads.then_some(effects));
            leads
        })
        .collect();
    descents.par_iter_mut().zip(unfolded).for_each(|(descent, unfolded)| {
        if unfolded {
            descent.unfold(problem);
        }
        if unfolded || descent.log_evidence() > best - FOLLOWED_NATS {
            descent.go(problem, MAX_PASSES);
        }
    });
    let with_base = |fit: Fit| Fit {
        log_evidence: fit.log_evidence + base.random_ln,
        random: base.random.clone(),
        random_ln: base.random_ln,
        ..fit
    };
    let mut fits: Vec<Fit> = descents.into_iter().map(|descent| with_base(descent.into_fit())).collect();
    fits.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
    let mut seen: Vec<Vec<usize>> = Vec::new();
    fits.retain(|fit| {
        let effects = fit.effects();
        let new = !seen.contains(&effects);
        seen.push(effects);
        new
    });
    fits
}
