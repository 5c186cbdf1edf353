//! What each hypothesis weighs: evidence, what a nameless part adds on top of it, and the decision.

use bench_inference::{Problem, Regions, Search, Waves, regions};
use rayon::prelude::*;

use crate::{
    calibration::{Calibration, Told},
    decision::{self, Decided, decide},
    diagnose::Verdict,
    direct::{Direct, direct},
    hypothesis::{Hypothesis, hidden_seconds, hypotheses, nominal_gain},
    nameless::Nameless,
};

/// The hypothesis that no effect of the library explains the gap.
pub const UNKNOWN: &str = "unknown";

/// So many of the leading hypotheses are looked at for what they leave, and as many single effects at least,
const LOOKED_AT: usize = 6; // numerical
const SINGLES_LOOKED_AT: usize = 5; // numerical
/// and so many of them closely.
const LOOKED_AT_CLOSELY: usize = 4; // numerical

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
    /// By what nats were divided.
    pub temperature: f64,
    /// What the re-fitted rig leaves.
    pub on_null: Regions,
    /// The same that swings.
    pub waves_on_null: Waves,
    /// What the most probable hypothesis that names its effects leaves, and what of it swings.
    pub left: Nameless,
    /// See [`Self::left`].
    pub waves_on_best: Waves,
}

impl Weighed {
    /// Weighs all fits and direct findings.
    pub fn of(problem: &Problem<'_>, search: &Search, direct: &Direct, calibration: &Calibration) -> Self {
        let mut all = hypotheses(problem, search, direct);
        let weighables = |all: &[Hypothesis]| all.iter().map(Hypothesis::weighable).collect::<Vec<_>>();
        let temperature = decision::temperature(&weighables(&all), calibration);
        let weight = |h: &Hypothesis| calibration.ln_prior(h.effects.len()) + h.gain() / temperature;
        all.sort_by(|a, b| weight(b).total_cmp(&weight(a)));

        let mut singles = 0;
        let looked_at: Vec<usize> = (0..all.len())
            .filter(|i| {
                let effects = all[*i].effects.len();
                singles += usize::from(effects == 1 && !all[*i].hidden);
                effects == 0
                    || !all[*i].hidden && (*i < LOOKED_AT || effects == 1 && singles <= SINGLES_LOOKED_AT)
            })
            .collect();
        let found: Vec<(Regions, Nameless, Option<Waves>)> = looked_at
            .par_iter()
            .map(|i| {
                let fit = &search.fits[all[*i].fit];
                let regions = regions(problem, fit);
                let closely = *i < LOOKED_AT_CLOSELY || all[*i].effects.is_empty();
                let (nameless, waves) =
                    Nameless::of(problem, fit, &regions, closely, direct.unexplained_pins);
                (regions, nameless, waves)
            })
            .collect();
        let mut swings: Vec<Option<Waves>> = vec![None; all.len()];
        for (i, (regions, nameless, waves)) in looked_at.into_iter().zip(found) {
            all[i].grounds.nameless = Some(nameless);
            all[i].regions = Some(regions);
            swings[i] = waves;
        }

        all.extend(hidden_seconds(&all));
        swings.resize(all.len(), None);
        let none = all.iter().position(|h| h.effects.is_empty()).expect("the null is a hypothesis");
        let nominal = nominal_gain(problem, &[UNKNOWN]);
        let Decided { probabilities, unknown, temperature } = decide(&weighables(&all), nominal, calibration);
        let unknown_gain = all
            .iter()
            .filter_map(|h| {
                let nominal = if h.effects.is_empty() { nominal } else { 0.0 };
                Some(h.gain() + h.grounds.nameless?.evidence() - nominal)
            })
            .fold(f64::NEG_INFINITY, f64::max);
        let mut order: Vec<usize> = (0..all.len()).collect();
        order.sort_by(|i, j| probabilities[*j].total_cmp(&probabilities[*i]));
        let best = order[0];
        let on_null = all[none].regions.clone().expect("the null was looked at");
        let waves_of = |i: usize| swings[i].clone().unwrap_or_default();
        let (waves_on_null, waves_on_best) = (waves_of(none), waves_of(best));
        let left = all[best].grounds.nameless.unwrap_or_default();
        let mut all: Vec<Option<Hypothesis>> = all.into_iter().map(Some).collect();
        Self {
            hypotheses: order.iter().filter_map(|i| all[*i].take()).collect(),
            probabilities: order.iter().map(|i| probabilities[*i]).collect(),
            unknown_gain,
            unknown,
            temperature,
            on_null,
            waves_on_null,
            left,
            waves_on_best,
        }
    }

    /// What each hypothesis gains, `unknown` among them, nats.
    pub fn gains(&self) -> impl Iterator<Item = (String, f64)> + '_ {
        let named = self.hypotheses.iter().filter(|h| !h.effects.is_empty() && !h.hidden);
        named.map(|h| (h.names().join("+"), h.gain())).chain([(UNKNOWN.to_owned(), self.unknown_gain)])
    }

    /// What is told of it.
    pub fn told(&self) -> Told {
        let leading = Some(0).filter(|_| self.probabilities[0] >= self.unknown);
        let effects = leading.map_or_else(Vec::new, |i| self.hypotheses[i].names());
        let verdict = Verdict::of(leading.map(|i| self.hypotheses[i].effects.as_slice()));
        let probability = leading.map_or(self.unknown, |i| self.probabilities[i]);
        Told { verdict, effects, probability }
    }
}

/// By how much the weight of `none` must be moved, as a logarithm, for the best hypothesis that names or suspects something
/// not to outweigh it: for flights known to be nominal, how near a false alarm was.
pub fn alarm_margin(problem: &Problem<'_>, calibration: &Calibration) -> f64 {
    let search = Search::of(problem);
    let weighed = Weighed::of(problem, &search, &direct(problem.tracks, problem.rig), calibration);
    let told = || weighed.hypotheses.iter().zip(&weighed.probabilities);
    let none = told().find(|(h, _)| h.effects.is_empty()).map_or(0.0, |(_, probability)| *probability);
    let others = told().filter(|(h, _)| !h.effects.is_empty()).map(|(_, probability)| *probability);
    let most = others.fold(weighed.unknown, f64::max);
    most.max(f64::MIN_POSITIVE).ln() - none.max(f64::MIN_POSITIVE).ln()
}
