//! What the decision was learnt to be: prior weights, and how far evidence is believed.

use std::sync::LazyLock;

use serde::{Deserialize, Serialize};

use crate::diagnose::Verdict;

/// Share of nominal flights that may raise an alarm: half of what is promised, for few flights are simulated.
const FALSE_ALARMS: f64 = 0.01;
/// Share of margins that makes up the tail.
const TAIL: f64 = 0.1;
/// The weight of `none` is moved by no more than this, as a logarithm: few simulated flights cannot say more.
const MOST_MOVED: f64 = 4.0;

/// Numbers learnt on cases whose cause was known; what each does is in `decision.rs`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// Of what is asked, the share with nothing wrong that the weight of `none` stands for.
    pub prior_none: f64,
    /// Natural logarithm of the weight of `none`.
    pub ln_prior_none: f64,
    /// The same of each single effect.
    pub ln_prior_single: f64,
    /// The same of each pair.
    pub ln_prior_pair: f64,
    /// The same of `unknown`.
    pub ln_prior_unknown: f64,
    /// Nats at stake add this share of themselves to the temperature.
    pub misfit_share: f64,
    /// Probability that the evidence misleads by more.
    pub doubt: f64,
    /// Probability that reality has another form of a law than the library.
    pub form_probability: f64,
    /// Mean share of what is explained that another form leaves.
    pub form_share: f64,
    /// Share of effects that are too small to be seen.
    pub hidden_share: f64,
    /// Probability that the model of an airframe in order leaves a nameless part.
    pub nominal_misfit_probability: f64,
    /// Mean of what that part gains, nats.
    pub nominal_misfit_nats: f64,
    /// Where the numbers are from.
    pub source: String,
    /// On how many cases they were learnt.
    pub cases: usize,
}

impl Default for Calibration {
    fn default() -> Self {
        Self::built_in()
    }
}

static BUILT_IN: LazyLock<Calibration> = LazyLock::new(|| {
    serde_json::from_str(include_str!("calibration.json")).expect("calibration.json is a calibration")
});

impl Calibration {
    /// What is used where a rig has none of its own: `calibration.json`, which `tools/learn` makes.
    pub fn built_in() -> Self {
        BUILT_IN.clone()
    }

    /// Moves the weight of `none` so that only a small share of flights known to be nominal would raise an alarm.
    /// `margins` are those of [`crate::alarm_margin`] under this calibration.
    #[must_use]
    pub fn with_margins(&self, margins: Vec<f64>, source: String) -> Self {
        let cases = margins.len();
        let margin = exceeded_by_next(margins, FALSE_ALARMS).clamp(-MOST_MOVED, MOST_MOVED);
        Self { ln_prior_none: self.ln_prior_none + margin, source, cases, ..self.clone() }
    }

    /// The same for another share of questions with nothing wrong: it moves the odds of `none` against all else.
    #[must_use]
    pub fn with_prior_none(&self, share: f64) -> Self {
        let ln_odds = |share: f64| (share / (1.0 - share)).ln();
        let moved = ln_odds(share) - ln_odds(self.prior_none);
        Self { prior_none: share, ln_prior_none: self.ln_prior_none + moved, ..self.clone() }
    }

    /// Whether probabilities come out of it that are from 0 to 1.
    pub fn is_sound(&self) -> bool {
        let weights = [self.ln_prior_none, self.ln_prior_single, self.ln_prior_pair, self.ln_prior_unknown];
        let shares = [
            self.misfit_share,
            self.doubt,
            self.form_probability,
            self.hidden_share,
            self.nominal_misfit_probability,
        ];
        let means = [self.form_share, self.nominal_misfit_nats];
        weights.iter().all(|weight| weight.is_finite())
            && shares.iter().all(|share| (0.0..=1.0).contains(share))
            && means.iter().all(|mean| *mean > 0.0 && mean.is_finite())
            && self.prior_none > 0.0
            && self.prior_none < 1.0
    }

    /// Logarithm of the weight of a hypothesis of so many effects.
    pub(crate) fn ln_prior(&self, effects: usize) -> f64 {
        match effects {
            0 => self.ln_prior_none,
            1 => self.ln_prior_single,
            _ => self.ln_prior_pair,
        }
    }
}

/// What is told of flights.
#[derive(Clone, Debug, PartialEq)]
pub struct Told {
    /// What it comes to.
    pub verdict: Verdict,
    /// The effects named.
    pub effects: Vec<&'static str>,
    /// Probability of exactly that.
    pub probability: f64,
}

/// The value that a next draw exceeds with the given probability. Draws of most laws exceed a high threshold by
/// exponential amounts (Pickands, *Statistical inference using extreme order statistics*, Annals of Statistics 3(1), 1975);
/// with the mean of `m` such amounts for what is known of them, a next one exceeds `x` times it with probability
/// `(1 + x/m)^-m`.
fn exceeded_by_next(mut draws: Vec<f64>, probability: f64) -> f64 {
    draws.sort_by(|a, b| b.total_cmp(a));
    let tail = (TAIL * draws.len() as f64).ceil();
    let Some(threshold) = draws.get(tail as usize) else { return draws.first().copied().unwrap_or(0.0) };
    let mean = draws.iter().take(tail as usize).map(|draw| draw - threshold).sum::<f64>() / tail;
    let beyond = (tail / draws.len() as f64 / probability).powf(tail.recip());
    threshold + mean * tail * (beyond - 1.0)
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn what_was_learnt_is_sound() {
        assert!(Calibration::built_in().is_sound());
        assert!(!Calibration { form_share: 0.0, ..Calibration::built_in() }.is_sound());
        assert!(!Calibration { doubt: 1.5, ..Calibration::built_in() }.is_sound());
        assert!(!Calibration { ln_prior_none: f64::NAN, ..Calibration::built_in() }.is_sound());
    }

    #[test]
    fn the_share_of_questions_with_nothing_wrong_moves_the_odds_of_none() {
        let built_in = Calibration::built_in();
        let half = built_in.with_prior_none(0.5);
        let odds = (half.ln_prior_none - built_in.ln_prior_none).exp();
        assert!((odds - (1.0 - built_in.prior_none) / built_in.prior_none).abs() < 1e-12);
        let back = half.with_prior_none(built_in.prior_none);
        assert!((back.ln_prior_none - built_in.ln_prior_none).abs() < 1e-12);
    }

    #[test]
    fn one_next_set_in_a_hundred_raises_an_alarm() {
        // Of exponential margins: 2,000 calibrations on 100 sets each, and the chance of an alarm that each leaves.
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut alarms = 0.0;
        for _ in 0..2000 {
            let mut exponential = || -(1.0 - rng.random::<f64>()).ln();
            let margins = (0..100).map(|_| 0.3 * exponential() - 0.5).collect();
            let moved = Calibration::built_in().with_margins(margins, String::new());
            let margin = moved.ln_prior_none - Calibration::built_in().ln_prior_none;
            alarms += (-(margin + 0.5).max(0.0) / 0.3).exp() / 2000.0;
        }
        // The threshold, a quantile of 100, is not known exactly either, which the formula leaves out: some 5 % more.
        assert!((alarms - 0.01).abs() < 0.001, "{alarms}");
    }

    #[test]
    fn a_few_margins_are_a_tail_too() {
        assert_eq!(exceeded_by_next(Vec::new(), 0.01), 0.0);
        assert_eq!(exceeded_by_next(vec![0.3], 0.01), 0.3);
        assert!(exceeded_by_next(vec![0.1, 0.3], 0.01) > 0.3);
    }
}
