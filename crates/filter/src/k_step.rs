//! Predictions over several seconds, from the filtered state on.

use crate::{
    covariance::State,
    passenger::{Measured, Passenger, Propagated, Reset, Updated},
};

/// Horizons of prediction, s.
pub const HORIZONS_S: [f64; 3] = [0.5, 1.0, 2.0]; // numerical
/// Time between two starts of a prediction, s.
const START_EVERY_S: f64 = 1.0; // numerical
/// The filter gets so long to find the state before the first prediction, s.
const SETTLE_S: f64 = 1.5;
/// A measurement so much after a horizon still stands for it, s.
const HORIZON_SLACK_S: f64 = 0.12;

/// Predictions over [`HORIZONS_S`], one begun each second.
pub(crate) struct KStepPredictors {
    under_way: Vec<Prediction>,
    next_start_s: f64,
    /// Sum of squared errors, m^2, and their number, by horizon.
    pub(crate) errors: [(f64, u32); 3],
}

/// A prediction under way, linearised about the filter itself: it does not learn.
#[derive(Clone, Copy, Debug)]
struct Prediction {
    begin_s: f64,
    /// Its state less the filter's.
    aside: State,
    /// Horizons that it has passed.
    passed: usize,
}

impl KStepPredictors {
    pub(crate) fn from(begin_s: f64) -> Self {
        Self { under_way: Vec::new(), next_start_s: begin_s + SETTLE_S, errors: [(0.0, 0); 3] }
    }
}

impl Passenger for KStepPredictors {
    fn propagated(&mut self, step: &Propagated<'_>) {
        if let Some(flown) = &step.flown {
            for prediction in &mut self.under_way {
                prediction.aside = flown.transition.apply(prediction.aside);
            }
        }
    }

    fn updated(&mut self, update: &Updated<'_>) {
        let at_s = match &update.measured {
            Measured::Altitude { measurement, of, .. } => {
                for prediction in &mut self.under_way {
                    let ahead_s = measurement.exposed_s - prediction.begin_s;
                    while prediction.passed < HORIZONS_S.len() && ahead_s >= HORIZONS_S[prediction.passed] {
                        if update.counts && ahead_s < HORIZONS_S[prediction.passed] + HORIZON_SLACK_S {
                            let error = update.residual - of.factor * prediction.aside[0];
                            let (sum, n) = &mut self.errors[prediction.passed];
                            *sum += error * error;
                            *n += 1;
                        }
                        prediction.passed += 1;
                    }
                }
                self.under_way.retain(|prediction| prediction.passed < HORIZONS_S.len());
                Some(measurement.exposed_s)
            }
            Measured::OnBoard { .. } => None,
        };
        for prediction in &mut self.under_way {
            for (x, k) in prediction.aside.iter_mut().zip(update.gain) {
                *x -= k * update.scored.residual;
            }
        }
        if let Some(at_s) = at_s.filter(|at_s| update.counts && *at_s >= self.next_start_s) {
            self.under_way.push(Prediction { begin_s: at_s, aside: [0.0; 4], passed: 0 });
            self.next_start_s = at_s + START_EVERY_S;
        }
    }

    fn reset(&mut self, reset: &Reset<'_>) {
        match reset {
            Reset::Standing | Reset::LiftOff(_) => {}
            // Where the one is stopped and the other not, they cannot be compared.
            Reset::Stopped { .. } => self.under_way.clear(),
            Reset::Carried { exposed_s, .. } => {
                self.under_way.clear();
                self.next_start_s = exposed_s + SETTLE_S;
            }
        }
    }
}
