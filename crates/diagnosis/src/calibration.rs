//! How evidence becomes probability.
//!
//! Evidence counts divided by a temperature: sightings are not as independent, nor laws as exact, as the likelihood
//! thinks. Prior weights say how often a kind of cause is met.

use serde::{Deserialize, Serialize};

/// Share of nominal flights that may raise an alarm.
const FALSE_ALARMS: f64 = 0.02;
/// The weight of `none` is moved by no more than this, as a logarithm: few simulated flights cannot say more.
const MOST_MOVED: f64 = 4.0;

/// Numbers learnt on cases whose cause was known.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// Evidence counts divided by this.
    pub temperature: f64,
    /// Share of belief that does not follow the evidence so far: where a law outside of the library, or another form of one
    /// in it, misleads, it does so by any number of nats.
    pub doubt: f64,
    /// Natural logarithm of the weight of `none`.
    pub ln_prior_none: f64,
    /// The same of each single effect.
    pub ln_prior_single: f64,
    /// The same of each pair.
    pub ln_prior_pair: f64,
    /// The same of `unknown`.
    pub ln_prior_unknown: f64,
    /// Power by which the odds of `none` against all else count more than those among causes: the nominal model is what it
    /// is, the law of a cause may be of another form. Even odds are left as they are.
    pub none_power: f64,
    /// Share of named single effects beside which there is a second one, too small to be seen.
    pub hidden_second: f64,
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

impl Calibration {
    /// What is used where a rig has none of its own: learnt on 650 cases of the blind check's generator (seeds 2001, 3001,
    /// 5001 and 5002, without the kinds that it reserves), half of them as a log that holds the newest frame.
    pub fn built_in() -> Self {
        Self {
            temperature: 3.3,
            doubt: 0.15,
            ln_prior_none: 0.0,
            ln_prior_single: -2.4,
            ln_prior_pair: -4.0,
            ln_prior_unknown: -0.5,
            none_power: 3.0,
            hidden_second: 0.1,
            source: "built in".to_owned(),
            cases: 650,
        }
    }

    /// Moves the weight of `none` so that only a small share of flights known to be nominal would raise an alarm.
    /// `margins` are those of [`crate::alarm_margin`] under this calibration.
    #[must_use]
    pub fn with_margins(&self, mut margins: Vec<f64>, source: String) -> Self {
        margins.sort_by(f64::total_cmp);
        // A next set exceeds the k-th largest of n with probability k/(n + 1).
        let k = (FALSE_ALARMS * (margins.len() + 1) as f64).floor().max(1.0) as usize;
        let margin = margins.iter().rev().nth(k - 1).copied().unwrap_or(0.0).clamp(-MOST_MOVED, MOST_MOVED);
        Self { ln_prior_none: self.ln_prior_none + margin, source, cases: margins.len(), ..self.clone() }
    }

    /// The probability of `none` from the one that it would have if it were a cause like any other.
    pub(crate) fn none(&self, probability: f64) -> f64 {
        let probability = probability.clamp(1e-12, 1.0 - 1e-12);
        let odds_against = ((1.0 - probability) / probability).powf(self.none_power);
        (1.0 + odds_against).recip()
    }

    /// Logarithm of the weight of a hypothesis of so many effects.
    pub(crate) fn ln_prior(&self, effects: &[usize]) -> f64 {
        match effects.len() {
            0 => self.ln_prior_none,
            1 => self.ln_prior_single,
            _ => self.ln_prior_pair,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn odds_of_none_are_sharpened_about_even_ones() {
        let calibration = Calibration::built_in();
        assert!((calibration.none(0.5) - 0.5).abs() < 1e-9);
        assert!(calibration.none(0.6) > 0.6 && calibration.none(0.3) < 0.3);
        assert!(calibration.none(0.0) < 1e-9 && calibration.none(1.0) > 1.0 - 1e-9);
    }

    #[test]
    fn one_set_in_fifty_may_raise_an_alarm() {
        let margins = |n: u32| (0..n).map(|i| 0.01 * f64::from(i)).collect();
        let moved = |n: u32| {
            let built_in = Calibration::built_in();
            built_in.with_margins(margins(n), String::new()).ln_prior_none - built_in.ln_prior_none
        };
        // A next one beyond the largest of 50, or the second largest of 100: chances of 1 in 51 and 2 in 101.
        assert!((moved(50) - 0.49).abs() < 1e-9 && (moved(100) - 0.98).abs() < 1e-9);
    }
}
