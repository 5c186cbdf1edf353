//! How hypotheses are weighed against one another: evidence of filter and direct channels, forms, and what is left.

use bench_plant::effects::LIBRARY;
use rayon::prelude::*;

use crate::{
    calibration::Calibration,
    direct::{Direct, direct},
    fit::{Fit, Problem},
    random::is_random,
    region::{Regions, regions},
    search::Search,
};

/// Laws of another form leave some structure even where their cause is named rightly: so many nats are forgiven before a
/// gap counts as unexplained, and this share of the winner's own gain. A second effect must gain the same share of what
/// the first gains alone.
const FORGIVEN_NATS: f64 = 15.0;
const FORGIVEN_SHARE: f64 = 0.08;
/// The same of a random effect that comes second: it takes in whatever a law leaves.
const RANDOM_SHARE: f64 = 0.25;
/// In doubt, evidence counts so many times less.
const DOUBTFUL: f64 = 10.0;
/// Hypotheses whose forms are looked at: those that others cannot overtake by form are left out.
const FORMS_WEIGHED: usize = 6;
/// A form may add this share of what its effect gains itself, and such a share of what is seen along its quantities.
const FORM_OF_GAIN: f64 = 0.35;
const FORM_BELIEVED: f64 = 0.9;
/// So much of its gain may lie along an effect's own quantities without being called unknown.
const FORM_LEFT_OF_GAIN: f64 = 0.8;
/// Forgiven where nothing is named: flights without an effect leave next to nothing.
const FORGIVEN_NONE_NATS: f64 = 5.0;

/// A hypothesis with what speaks for it.
pub struct Hypothesis {
    /// Library indices; none for the null.
    pub effects: Vec<usize>,
    /// The fit over its effects that the filter sees.
    pub fit: usize,
    /// Those of its effects that direct channels speak for.
    pub direct: Vec<usize>,
    /// Gain of log-evidence over none, all channels, and what another form of its laws would add.
    pub gain: f64,
    /// What its fit leaves, where that was looked at.
    pub regions: Option<Regions>,
    /// What a second effect must gain before it counts.
    forgiven: f64,
}

/// All hypotheses, most probable first, and the one that none of them is true.
pub struct Weighed {
    /// The hypotheses.
    pub hypotheses: Vec<Hypothesis>,
    /// Their probabilities.
    pub probabilities: Vec<f64>,
    /// Gain of the hypothesis that no known effect explains the gap.
    pub unknown_gain: f64,
    /// Its probability.
    pub unknown: f64,
    /// What the re-fitted rig leaves.
    pub on_null: Regions,
}

impl Weighed {
    /// Weighs all fits and direct findings.
    pub fn of(problem: &Problem<'_>, search: &Search, direct: &Direct, calibration: &Calibration) -> Self {
        let on_null = regions(problem, &search.fits[0]);
        let mut hypotheses = hypotheses(search, direct);
        let weight = |h: &Hypothesis| {
            calibration.ln_prior(&h.effects) + (h.gain - h.forgiven) / calibration.temperature
        };
        let by_weight = |a: &Hypothesis, b: &Hypothesis| weight(b).total_cmp(&weight(a));
        hypotheses.sort_by(by_weight);
        weigh_forms(problem, search, &on_null, &mut hypotheses);
        hypotheses.sort_by(by_weight);

        let best = &hypotheses[0];
        let left = unexplained(best, &search.fits[best.fit], &on_null, direct);
        let unknown_gain = best.gain + left;
        let posterior = |temperature: f64| {
            let at = |prior: f64, gain: f64| prior + gain / temperature;
            let mut weights: Vec<f64> = hypotheses
                .iter()
                .map(|h| at(calibration.ln_prior(&h.effects), h.gain - h.forgiven))
                .collect();
            weights.push(at(calibration.ln_prior_unknown, unknown_gain));
            let highest = weights.iter().copied().fold(f64::MIN, f64::max);
            let total: f64 = weights.iter().map(|w| (w - highest).exp()).sum();
            weights.into_iter().map(|w| (w - highest).exp() / total).collect::<Vec<f64>>()
        };
        let doubt = calibration.doubt;
        let doubted = posterior(DOUBTFUL * calibration.temperature);
        let mut probabilities: Vec<f64> = posterior(calibration.temperature)
            .into_iter()
            .zip(doubted)
            .map(|(p, q)| (1.0 - doubt) * p + doubt * q)
            .collect();
        let unknown = probabilities.pop().unwrap_or(0.0);
        Self { hypotheses, probabilities, unknown_gain, unknown, on_null }
    }
}

/// By how much the best hypothesis that names or suspects something outweighs `none`, as a logarithm: for flights known
/// to be nominal, how near a false alarm was.
pub fn alarm_margin(problem: &Problem<'_>, calibration: &Calibration) -> f64 {
    let search = Search::of(problem);
    let weighed = Weighed::of(problem, &search, &direct(problem.tracks, problem.rig), calibration);
    let (mut none, mut other) = (weighed.unknown.min(1e-300), weighed.unknown);
    for (h, probability) in weighed.hypotheses.iter().zip(&weighed.probabilities) {
        if h.effects.is_empty() {
            none = *probability;
        } else {
            other = other.max(*probability);
        }
    }
    other.max(1e-300).ln() - none.max(1e-300).ln()
}

/// All hypotheses of at most two effects that were fitted or read.
fn hypotheses(search: &Search, direct: &Direct) -> Vec<Hypothesis> {
    let mut all: Vec<Hypothesis> = Vec::new();
    let mut add = |fit: usize, read: &[usize]| {
        let mut effects = search.fits[fit].effects();
        for effect in read {
            if !effects.contains(effect) {
                effects.push(*effect);
            }
        }
        if effects.len() > 2 {
            return;
        }
        let found = |effect: &usize| {
            direct.effects.iter().find(|found| found.effect == *effect).map_or(0.0, |found| found.gain)
        };
        // An effect that the filter sees and a direct channel too has both for it.
        let gain = search.gain(fit) + effects.iter().map(found).sum::<f64>();
        let forgiven = forgiven(search, fit, &effects);
        if all
            .iter()
            .any(|other| same(&other.effects, &effects) && other.gain - other.forgiven >= gain - forgiven)
        {
            return;
        }
        all.retain(|other| !same(&other.effects, &effects));
        all.push(Hypothesis { effects, fit, direct: read.to_vec(), gain, regions: None, forgiven });
    };
    for fit in 0..search.fits.len() {
        add(fit, &[]);
        for found in &direct.effects {
            add(fit, &[found.effect]);
        }
    }
    for (i, a) in direct.effects.iter().enumerate() {
        for b in direct.effects[i + 1..].iter().filter(|b| b.channel != a.channel) {
            add(0, &[a.effect, b.effect]);
        }
    }
    all
}

/// What a second effect must gain, because the first one's law may be of another form.
fn forgiven(search: &Search, fit: usize, effects: &[usize]) -> f64 {
    if effects.len() == 2 && search.fits[fit].point.effects.len() == 1 {
        // A channel was read wrongly by a law of another form, and the flight is fed with that.
        return FORGIVEN_NATS / 2.0;
    }
    if search.fits[fit].point.effects.len() < 2 {
        return 0.0;
    }
    let first = search.alone(effects);
    if effects.iter().any(|effect| is_random(*effect)) {
        FORGIVEN_NATS + RANDOM_SHARE * first
    } else {
        FORGIVEN_SHARE * first
    }
}

fn same(a: &[usize], b: &[usize]) -> bool {
    a.len() == b.len() && a.iter().all(|x| b.contains(x))
}

/// Adds to the leading hypotheses what their laws would gain in another form.
fn weigh_forms(problem: &Problem<'_>, search: &Search, on_null: &Regions, hypotheses: &mut [Hypothesis]) {
    let leading = hypotheses.len().min(FORMS_WEIGHED);
    let looked: Vec<Regions> = hypotheses[..leading]
        .par_iter()
        .map(|h| if h.fit == 0 { on_null.clone() } else { regions(problem, &search.fits[h.fit]) })
        .collect();
    for (h, found) in hypotheses.iter_mut().zip(looked) {
        h.gain += FORM_BELIEVED * found.form.min(FORM_OF_GAIN * h.gain.max(0.0));
        h.regions = Some(found);
    }
}

/// What no known law explains on top of a hypothesis, nats; below zero where less is left than is forgiven.
fn unexplained(best: &Hypothesis, fit: &Fit, on_null: &Regions, direct: &Direct) -> f64 {
    let on_best = best.regions.as_ref().unwrap_or(on_null);
    let gain = best.gain.max(0.0);
    let mut structure = on_best.ceiling - on_best.form.min(FORM_LEFT_OF_GAIN * gain);
    let mut wave = on_best.wave().1;
    let only_gusts = fit.point.effects.len() == 1 && LIBRARY[fit.point.effects[0].0].name == "gusts";
    if only_gusts {
        // Wind has no structure: what a law would have explained, no gust does.
        structure = structure.max(on_null.ceiling);
        wave = wave.max(on_null.wave().1 - 0.5 * gain);
    }
    let tracker = on_best.tracker.iter().map(|(_, gain)| *gain).fold(0.0, f64::max);
    let structure = structure.max(tracker);
    let left = structure.max(wave).max(0.7 * (structure + wave));
    let forgiven =
        if best.effects.is_empty() { FORGIVEN_NONE_NATS } else { FORGIVEN_NATS + FORGIVEN_SHARE * gain };
    let flight = left - forgiven;
    if direct.unexplained_pins > 0.0 { flight.max(0.0) + direct.unexplained_pins } else { flight }
}
