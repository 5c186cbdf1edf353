//! Nominal flights held against the model of other nominal flights: what the model gets wrong although nothing is.
//!
//! A model is never quite right, so hypotheses gain something on flights that were fine. That is measured here, fold by fold
//! (cross-validation), and kept in the rig: the null distribution of each hypothesis' evidence is an empirical one (Efron,
//! *Large-scale simultaneous hypothesis testing: the choice of a null hypothesis*, J. Am. Stat. Assoc. 99, 2004).

use bench_inference::Problem;
use bench_rig::HeldOut;
use serde::Serialize;

use crate::{
    analysis::Analysis,
    calibration::{Calibration, Told},
    diagnose::Verdict,
    weigh::UNKNOWN,
};

/// Nominal flights that were left out of a model, and what the diagnosis says of them.
#[derive(Clone, Debug, Serialize)]
pub struct Fold {
    /// Their names.
    pub flights: Vec<String>,
    /// Measurements held against a prediction.
    pub measurements: usize,
    /// What leads: `none`, an effect, two of them as `a+b`, or `unknown`.
    pub leading: String,
    /// Its probability.
    pub probability: f64,
    /// Gain of each hypothesis over none, nats, those below one left out.
    pub gains: Vec<Gain>,
}

/// What a hypothesis gains over none.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Gain {
    /// An effect, two of them as `a+b`, or `unknown`.
    pub hypothesis: String,
    /// Gain of log-evidence, nats.
    pub nats: f64,
}

/// What leads where nothing is found.
const NONE: &str = "none";
/// Less is nothing that a model could be blamed for, nats.
const LEAST_NATS: f64 = 1.0;

impl Fold {
    /// Holds flights against a model that was made without them.
    pub fn of(problem: &Problem<'_>, calibration: &Calibration) -> Self {
        let analysis = Analysis::of(problem, calibration);
        let Told { verdict, effects, probability } = analysis.told();
        let leading = match verdict {
            Verdict::Effect => effects.join("+"),
            Verdict::None => NONE.to_owned(),
            Verdict::Unknown => UNKNOWN.to_owned(),
        };
        Self {
            flights: problem.tracks.iter().map(|track| track.name.clone()).collect(),
            measurements: problem.counted(),
            leading,
            probability,
            gains: analysis
                .weighed
                .gains()
                .filter(|(_, nats)| *nats > LEAST_NATS)
                .map(|(hypothesis, nats)| Gain { hypothesis, nats })
                .collect(),
        }
    }

    /// Whether nothing was found, as it should be.
    pub fn is_none(&self) -> bool {
        self.leading == NONE
    }
}

/// What hypotheses gain by the model's own error: the most in any fold, a measurement.
pub fn held_out(folds: &[Fold]) -> Vec<HeldOut> {
    let mut most: Vec<HeldOut> = Vec::new();
    for fold in folds {
        for Gain { hypothesis, nats } in &fold.gains {
            let nats_per_measurement = nats / fold.measurements.max(1) as f64;
            match most.iter_mut().find(|known| known.hypothesis == *hypothesis) {
                Some(known) => {
                    known.nats_per_measurement = known.nats_per_measurement.max(nats_per_measurement);
                }
                None => most.push(HeldOut { hypothesis: hypothesis.clone(), nats_per_measurement }),
            }
        }
    }
    // A pair is told where it gains more than what it is made of.
    let of = |name: &str| {
        most.iter().find(|told| told.hypothesis == name).map_or(0.0, |told| told.nats_per_measurement)
    };
    let more: Vec<bool> = most
        .iter()
        .map(|told| match told.hypothesis.split_once('+') {
            Some((first, second)) => told.nats_per_measurement > of(first).max(of(second)),
            None => true,
        })
        .collect();
    let mut told = more.iter();
    most.retain(|_| told.next() == Some(&true));
    most.sort_by(|a, b| b.nats_per_measurement.total_cmp(&a.nats_per_measurement));
    most
}
