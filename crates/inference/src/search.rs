//! Which hypotheses are fitted: none, every effect, and pairs built forward on the best.

use bench_filter::{Point, Track, is_random, spread};
use bench_plant::effects::{LIBRARY, Shows, Spread};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::{
    descent::{Descent, MAX_PASSES, WORTH},
    fit::{Fit, Problem},
    promise::Promise,
    random,
    settle::settle,
};

/// Cosine of a tilt that would show, if vertical thrust were not kept up in it.
const TILTED: f64 = 0.995;
/// The best singles on which pairs are built.
const PAIR_BASES: usize = 3; // numerical
/// Of kinds of noise so many, which gain such a share of what the best of them does.
const SPREAD_BASES: usize = 2; // numerical
const SPREAD_SHARE: f64 = 0.6;
/// So many of the most promising are fitted.
const SINGLES_REFINED: usize = 14; // numerical
const PAIRS_REFINED: usize = 5; // numerical
/// Gain, nats, below which nothing is built on a single, or no second is tried.
const WORTH_A_SECOND: f64 = 2.0; // numerical

/// All fits of one diagnosis: the null first.
pub struct Search {
    /// The fits.
    pub fits: Vec<Fit>,
}

/// Library indices of the effects that flights show in this way.
fn shown_as(shows: Shows) -> impl Iterator<Item = usize> {
    (0..LIBRARY.len()).filter(move |effect| LIBRARY[*effect].signature.shows == shows)
}

/// Library indices of the effects that the filter can fit to any flight, in the library's order.
pub fn fitted_effects() -> Vec<usize> {
    shown_as(Shows::Law).collect()
}

/// Library indices of the effects whose laws these flights may show.
fn laws(problem: &Problem<'_>) -> Vec<usize> {
    let mut effects = fitted_effects();
    if problem.tracks.iter().flat_map(|track| &track.tilt).any(|(_, cosine)| *cosine < TILTED) {
        effects.extend(shown_as(Shows::LawWhenTilted));
    }
    effects
}

/// Fits of one law more that are worth it, most evident first, each on top of a fit whose laws are fitted along.
pub fn with_one_law_more(problem: &Problem<'_>, base: &Fit) -> Vec<Fit> {
    let others: Vec<usize> =
        laws(problem).into_iter().filter(|effect| !base.effects().contains(effect)).collect();
    let promises = problem.promises(base, &others, SINGLES_REFINED);
    refine(problem, base, promises, SINGLES_UNFOLDED)
}

impl Search {
    /// Fits all hypotheses that are worth it. Of many flights a few show the way: there fits begin near where they end.
    pub fn of(problem: &Problem<'_>) -> Self {
        let few = few(problem.tracks);
        let guide = few.map(|tracks| Self::guided(&problem.with_tracks(&tracks), None));
        Self::guided(problem, guide.as_ref())
    }

    fn guided(problem: &Problem<'_>, guide: Option<&Self>) -> Self {
        let mut null = match guide {
            None => problem.fit_null(),
            Some(guide) => settle(problem, problem.refine(guide.fits[0].point.clone(), guide.fits[0].noise)),
        };
        let effects = laws(problem);
        // Where frames keep a clock, what is late or lost shows in their arrivals or nowhere.
        let clocked = problem.tracks.iter().any(|track| !track.waits_s.is_empty());
        let in_arrivals =
            |effect: &usize| matches!(spread(*effect), Some(Spread::LateFrames | Spread::LostFrames));
        let random: Vec<usize> = (0..LIBRARY.len())
            .filter(|effect| is_random(*effect) && !(clocked && in_arrivals(effect)))
            .collect();
        let mut singles = match guide {
            None => with_one_law_more(problem, &null),
            Some(guide) => followed(problem, guide, 1),
        };
        if guide.is_some() {
            // Noise that stands for an effect in the null does not beside it.
            for single in singles.iter_mut().take(PAIR_BASES) {
                *single = settle(problem, single.clone());
            }
            singles.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
            // Nor is a law to be named for noise that the null did not find.
            if let Some(best) = singles.first() {
                let other = settle(problem, problem.refine(null.point.clone(), best.noise));
                if other.objective < null.objective {
                    null = other;
                }
            }
        }
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
            if let Some(guide) = guide {
                pairs.extend(followed(problem, guide, 2));
            } else {
                let mut done = best.effects();
                for base in lesser {
                    done.extend(base.effects());
                    pairs.extend(seconds(base, &others(&done), 0));
                }
            }
        }
        let again = if guide.is_none() { again(problem, &bases, &pairs) } else { None };
        if let Some(found) = &again {
            pairs.extend(all_seconds(found));
        }
        // Under noise that a random effect brings, laws show that the null's own noise would drown or invent.
        let spreads: Vec<&Fit> = singles
            .iter()
            .filter(|single| is_random(single.point.effects[0].0))
            .filter(|single| single.log_evidence > null.log_evidence + WORTH_A_SECOND)
            .collect();
        if let Some(strongest) = spreads.first() {
            let gain = |spread: &Fit| spread.log_evidence - null.log_evidence;
            // A law may hide which of two kinds of noise it is.
            for spread in spreads.iter().take(SPREAD_BASES) {
                if gain(spread) >= SPREAD_SHARE * gain(strongest) {
                    pairs.extend(seconds(spread, &effects, SECONDS_UNFOLDED));
                }
            }
            let leads = is_random(singles[0].point.effects[0].0);
            pairs.extend(pairs_of_noise(problem, &null, &spreads, if leads { &random } else { &[] }));
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

/// The strongest noise with each of the others, and with those that explain nothing alone, for one that leads may hide them.
fn pairs_of_noise(problem: &Problem<'_>, null: &Fit, spreads: &[&Fit], hidden: &[usize]) -> Vec<Fit> {
    let Some((first, others)) = spreads.split_first() else { return Vec::new() };
    let both = others.par_iter().filter_map(|other| random::fit_with_both(problem, null, [*first, *other]));
    let beside = hidden
        .par_iter()
        .filter(|effect| spreads.iter().all(|spread| spread.effects() != [**effect]))
        .filter_map(|effect| random::fit_beside(problem, null, first, *effect));
    both.chain(beside).collect()
}

/// Of more flights than the first, as many as the second show the way.
const MANY_FLIGHTS: usize = 24; // numerical
const FEW_FLIGHTS: usize = 16; // numerical

/// A few of many flights, drawn at random, always the same of as many: of all kinds where those come in turns. `None` where
/// there are few as it is.
fn few(tracks: &[Track]) -> Option<Vec<Track>> {
    if tracks.len() <= MANY_FLIGHTS {
        return None;
    }
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let mut drawn = rand::seq::index::sample(&mut rng, tracks.len(), FEW_FLIGHTS).into_vec();
    drawn.sort_unstable();
    Some(drawn.into_iter().map(|at| tracks[at].clone()).collect())
}

/// Fits of so many laws to all flights, from where they are on a few: of those that are near the best there.
fn followed(problem: &Problem<'_>, guide: &Search, laws: usize) -> Vec<Fit> {
    let best = guide.fits.iter().map(|fit| fit.log_evidence).fold(f64::MIN, f64::max);
    let mut fits: Vec<Fit> = guide
        .fits
        .par_iter()
        .filter(|fit| fit.random.is_empty() && fit.point.effects.len() == laws)
        .filter(|fit| fit.log_evidence > best - FOLLOWED_NATS)
        .map(|fit| problem.refine(fit.point.clone(), fit.noise))
        .collect();
    best_of_each(&mut fits);
    fits
}

/// Of fits of the same effects the best, most evident first.
fn best_of_each(fits: &mut Vec<Fit>) {
    fits.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
    let mut seen: Vec<Vec<usize>> = Vec::new();
    fits.retain(|fit| {
        let effects = fit.effects();
        let new = !seen.contains(&effects);
        seen.push(effects);
        new
    });
}

/// A pair that is so many nats ahead of one of its laws may stand where that law alone had not found the way.
const AGAIN_NATS: f64 = 8.0; // numerical

/// The best pairs from which the better law is looked for anew.
const AGAIN_FROM: usize = 3; // numerical

/// The better law of the best pair, fitted anew alone from where it stands in the best pairs that it is part of; `None` where that
/// gains nothing.
fn again(problem: &Problem<'_>, bases: &[&Fit], pairs: &[Fit]) -> Option<Fit> {
    let mut best_first: Vec<&Fit> = pairs.iter().collect();
    best_first.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
    let best = best_first.first()?;
    let base = bases.iter().find(|base| best.effects().contains(&base.point.effects[0].0))?;
    if best.log_evidence < base.log_evidence + AGAIN_NATS {
        return None;
    }
    let effect = base.point.effects[0].0;
    best_first.retain(|pair| pair.effects().contains(&effect));
    best_first.truncate(AGAIN_FROM);
    best_first
        .into_par_iter()
        .map(|pair| {
            let mut start = pair.point.clone();
            start.effects.retain(|(other, _)| *other == effect);
            problem.refine(start, pair.noise)
        })
        .filter(|fit| fit.log_evidence > base.log_evidence)
        .max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence))
}

/// Passes after which those that promise less than they are behind are left: such a one only creeps on.
const FIRST_LOOK: usize = 2; // numerical
/// Passes after which fits are compared, or the nats that a step of them still promises, and nats by which one may be behind
/// the best then to be followed to its end.
const FIRST_PASSES: usize = 5; // numerical
const FIRST_WORTH: f64 = 1.0; // numerical
const FOLLOWED_NATS: f64 = 60.0; // numerical
/// So many of the best single effects are then fitted in other than their plainest form, and of the laws on top of the best
/// law and of the strongest noise,
const SINGLES_UNFOLDED: usize = 4; // numerical
const SECONDS_UNFOLDED: usize = 1; // numerical
/// where they are not behind the best by more than that, or than this share of what it gains.
const FORM_SHARE: f64 = 0.95;

/// A start that is so many nats worse than what it stands on went too far along a straight line: it is halved so often.
const OVERSHOT_NATS: f64 = 20.0; // numerical
const MOST_HALVINGS: usize = 3; // numerical
/// One that is still as far behind after its first passes is left for another, so often.
const OTHERS_TRIED: usize = 2; // numerical

/// A start half as far from the point that it stands on: the size of the effect that it adds, last, and all that moved with it.
fn nearer(base: &Point, mut start: Point) -> Point {
    for (value, from) in start.nuisances.0.iter_mut().zip(base.nuisances.0) {
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
    let mut descents: Vec<(Descent, Vec<(f64, Point)>)> = promises
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
            descent.go(problem, FIRST_LOOK, FIRST_WORTH);
            (descent, promise.others)
        })
        .collect();
    let best = descents.iter().map(|(descent, _)| descent.log_evidence()).fold(f64::MIN, f64::max);
    descents
        .par_iter_mut()
        .filter(|(descent, _)| {
            let behind = best - FOLLOWED_NATS - descent.log_evidence();
            descent.objective() > base.objective + OVERSHOT_NATS || descent.promise() > behind
        })
        .for_each(|(descent, others)| {
            descent.go(problem, FIRST_PASSES, FIRST_WORTH);
            // A law with an edge may stop on its way there.
            for (_, start) in others.drain(..).take(OTHERS_TRIED) {
                if descent.objective() < base.objective + OVERSHOT_NATS || !descent.stopped(FIRST_WORTH) {
                    break;
                }
                let mut other = problem.descent(start, base.noise, base.point.effects.len());
                other.go(problem, FIRST_PASSES, FIRST_WORTH);
                if other.objective() < descent.objective() {
                    *descent = other;
                }
            }
        });
    let mut descents: Vec<Descent> = descents.into_iter().map(|(descent, _)| descent).collect();
    // Who is far behind and still on the way is not given up.
    for passes in FIRST_PASSES + 1..=MAX_PASSES {
        let best = descents.iter().map(Descent::log_evidence).fold(f64::MIN, f64::max);
        descents
            .par_iter_mut()
            .filter(|descent| {
                let behind = best - FOLLOWED_NATS - descent.log_evidence();
                behind > 0.0 && descent.promise() > behind
            })
            .for_each(|descent| descent.go(problem, passes, FIRST_WORTH));
    }
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
    descents.par_iter_mut().zip(&unfolded).for_each(|(descent, unfolded)| {
        if *unfolded {
            descent.unfold(problem);
        }
        if *unfolded || descent.log_evidence() > best - FOLLOWED_NATS {
            descent.go(problem, MAX_PASSES, WORTH);
        }
    });
    // Another start of the same effect may have overtaken the one that was unfolded.
    let overtaking: Vec<usize> = leading
        .iter()
        .filter_map(|effects| {
            let starts = (0..descents.len()).filter(|i| descents[*i].effects() == *effects);
            starts.max_by(|i, j| descents[*i].log_evidence().total_cmp(&descents[*j].log_evidence()))
        })
        .filter(|best| !unfolded[*best])
        .collect();
    descents.par_iter_mut().enumerate().filter(|(i, _)| overtaking.contains(i)).for_each(|(_, descent)| {
        descent.unfold(problem);
        descent.go(problem, MAX_PASSES + FIRST_PASSES, WORTH);
    });
    let with_base = |fit: Fit| Fit {
        log_evidence: fit.log_evidence + base.random_ln,
        random: base.random.clone(),
        random_ln: base.random_ln,
        ..fit
    };
    let mut fits: Vec<Fit> = descents.into_iter().map(|descent| with_base(descent.into_fit())).collect();
    best_of_each(&mut fits);
    fits
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_few_of_many_flights_are_of_all_kinds() {
        for kinds in 1..=12 {
            for flights in [25, 90, 1000] {
                let named = |flight: usize| Track { name: (flight % kinds).to_string(), ..Track::default() };
                let tracks: Vec<Track> = (0..flights).map(named).collect();
                let few = few(&tracks).unwrap();
                assert_eq!(few.len(), FEW_FLIGHTS);
                let mut seen: Vec<&str> = few.iter().map(|track| track.name.as_str()).collect();
                seen.sort_unstable();
                seen.dedup();
                // Sixteen at random of twelve kinds are of nine on average, with a deviation of one.
                assert!(2 * seen.len() > kinds, "{kinds} kinds, {flights} flights: {seen:?}");
            }
        }
        assert!(few(&vec![Track::default(); MANY_FLIGHTS]).is_none());
    }
}
