//! Innovations: what was measured less what was predicted.

use bench_plant::effects::Axis;

use crate::passenger::{Measured, Passenger, Updated};

/// One measurement held against its prediction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Innovation {
    /// Exposure as the tracker believes, s.
    pub exposed_s: f64,
    /// Seen less predicted, m.
    pub residual_m: f64,
    /// Predicted variance, m^2.
    pub variance_m2: f64,
    /// Its share of the negative log-likelihood.
    pub nll: f64,
    /// The quantities of [`Axis::ALL`].
    pub axes: [f64; Axis::COUNT],
}

/// Every innovation that counts.
#[derive(Default)]
pub(crate) struct Innovations(pub(crate) Vec<Innovation>);

impl Passenger for Innovations {
    fn updated(&mut self, update: &Updated<'_>) {
        let Measured::Altitude { measurement, .. } = &update.measured else { return };
        if update.counts {
            self.0.push(Innovation {
                exposed_s: measurement.exposed_s,
                residual_m: update.residual,
                variance_m2: update.scored.variance,
                nll: update.scored.nll,
                axes: *update.axes,
            });
        }
    }
}
