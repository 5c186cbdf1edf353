//! The filter with other noise: what the likelihood would be.

use crate::{
    covariance::{
        Covariance, State, initial_covariance, lift_off_covariance, predicted_variance, reset_covariance,
        stop_covariance, update_along, update_by_altitude,
    },
    measurement::Scored,
    noise::Noise,
    passenger::{Measured, Passenger, Propagated, Reset, Updated},
};

/// Logarithms of the factors by which the probes' noise differs: process noise down and up, tracker noise down and up.
pub const PROBES: [f64; 4] = [-0.25, 0.25, -0.05, 0.05]; // numerical

/// The filter with the noise of each of [`PROBES`], linearised about the filter itself.
pub(crate) struct Probes([Probe; 4]);

#[derive(Clone, Copy, Debug)]
struct Probe {
    noise: Noise,
    p: Covariance,
    /// Its state less the filter's.
    aside: State,
    /// How probably the last measurement was of an older frame than its own.
    stale: f64,
    nll: f64,
}

impl Probes {
    pub(crate) fn around(noise: &Noise) -> Self {
        let mut probes = [Probe {
            noise: *noise,
            p: initial_covariance(noise),
            aside: [0.0; 4],
            stale: noise.stale_probability,
            nll: 0.0,
        }; 4];
        for (i, (probe, ln_factor)) in probes.iter_mut().zip(PROBES).enumerate() {
            if i < 2 {
                probe.noise.turbulence *= ln_factor.exp();
            } else {
                probe.noise.measurement_m *= ln_factor.exp();
            }
        }
        Self(probes)
    }

    /// Negative log-likelihoods, in the order of [`PROBES`].
    pub(crate) fn nll(&self) -> [f64; 4] {
        self.0.map(|probe| probe.nll)
    }
}

impl Passenger for Probes {
    fn propagated(&mut self, step: &Propagated<'_>) {
        let Some(flown) = &step.flown else { return };
        for probe in &mut self.0 {
            flown.transition.propagate_covariance(&mut probe.p, step.h, flown.near_ground, &probe.noise);
            probe.aside = flown.transition.apply(probe.aside);
        }
    }

    fn updated(&mut self, update: &Updated<'_>) {
        for probe in &mut self.0 {
            let (own, k) = match &update.measured {
                Measured::Altitude { of, .. } => {
                    let residual = update.residual - of.factor * probe.aside[0];
                    let own = of.score(&probe.p, &probe.noise, residual, probe.stale);
                    probe.stale = own.stale;
                    (own, update_by_altitude(&mut probe.p, of.factor, &own))
                }
                Measured::OnBoard { slopes, sigma, .. } => {
                    let aside = slopes.iter().zip(&probe.aside).map(|(h, x)| h * x).sum::<f64>();
                    let own = Scored::bounded(
                        update.residual - aside,
                        predicted_variance(&probe.p, slopes) + sigma * sigma,
                    );
                    (own, update_along(&mut probe.p, slopes, &own))
                }
            };
            if update.counts {
                probe.nll += own.nll;
            }
            // Against the filter, which moves by its own gain.
            for (x, k) in probe.aside.iter_mut().zip(k) {
                *x += k * own.residual;
            }
            for (x, k) in probe.aside.iter_mut().zip(update.gain) {
                *x -= k * update.scored.residual;
            }
        }
    }

    fn reset(&mut self, reset: &Reset<'_>) {
        for probe in &mut self.0 {
            match reset {
                Reset::Standing => {}
                Reset::LiftOff(spread_m_s) => lift_off_covariance(&mut probe.p, *spread_m_s),
                Reset::Stopped { .. } => {
                    stop_covariance(&mut probe.p);
                    probe.aside[0] = 0.0;
                    probe.aside[1] = 0.0;
                }
                Reset::Carried { .. } => {
                    reset_covariance(&mut probe.p, &probe.noise);
                    probe.aside = [0.0, 0.0, probe.aside[2], 0.0];
                }
            }
        }
    }
}
