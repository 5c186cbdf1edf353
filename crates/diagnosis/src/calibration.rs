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
    /// What is used where a rig has none of its own: learnt on 270 cases of the blind check's generator (seeds 2001 and
    /// 3001, without the kinds that it reserves), half of them as a log that holds the newest frame.
    pub fn built_in() -> Self {
        Self {
            temperature: 3.3,
            doubt: 0.15,
            ln_prior_none: 0.0,
            ln_prior_single: -2.4,
            ln_prior_pair: -4.4,
            ln_prior_unknown: -0.2,
            source: "built in".to_owned(),
            cases: 270,
        }
    }

    /// Moves the weight of `none` so that only a small share of flights known to be nominal would raise an alarm.
    /// `margins` are those of [`crate::alarm_margin`] under this calibration.
    #[must_use]
    pub fn with_margins(&self, mut margins: Vec<f64>, source: String) -> Self {
        margins.sort_by(f64::total_cmp);
        let at = ((margins.len() as f64 - 1.0) * (1.0 - FALSE_ALARMS)).round() as usize;
        let margin = margins.get(at).copied().unwrap_or(0.0).clamp(-MOST_MOVED, MOST_MOVED);
        Self { ln_prior_none: self.ln_prior_none + margin, source, cases: margins.len(), ..self.clone() }
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
