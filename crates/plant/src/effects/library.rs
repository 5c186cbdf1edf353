//! Every effect that the bench knows.

use std::{
    ops::Deref,
    sync::{Mutex, OnceLock, PoisonError},
};

use thiserror::Error;

use super::{
    EffectSpec, Reading, actuator_backlash, actuator_lag, actuator_quantisation, actuator_saturation,
    battery_discharge, battery_load, ceiling_effect, descent_thrust_loss, ground_effect_dynamic,
    ground_effect_shape, gusts, inflow_damping, loop_overrun, mass_change, quadratic_drag, rotor_lag,
    thrust_curve, thrust_loss, tilt_loss, tracker_dropout, tracker_jitter, tracker_latency, tracker_noise,
    tracker_outliers, tracker_scale, updraft,
};

/// The bench's own effects, by stage from the tracker to the airframe.
const OWN: [&EffectSpec; 26] = [
    &tracker_latency::SPEC,
    &tracker_jitter::SPEC,
    &tracker_scale::SPEC,
    &tracker_noise::SPEC,
    &tracker_dropout::SPEC,
    &tracker_outliers::SPEC,
    &loop_overrun::SPEC,
    &actuator_lag::SPEC,
    &actuator_saturation::SPEC,
    &actuator_quantisation::SPEC,
    &actuator_backlash::SPEC,
    &rotor_lag::SPEC,
    &thrust_curve::SPEC,
    &thrust_loss::SPEC,
    &battery_discharge::SPEC,
    &battery_load::SPEC,
    &ground_effect_shape::SPEC,
    &ground_effect_dynamic::SPEC,
    &ceiling_effect::SPEC,
    &gusts::SPEC,
    &updraft::SPEC,
    &mass_change::SPEC,
    &quadratic_drag::SPEC,
    &descent_thrust_loss::SPEC,
    &inflow_damping::SPEC,
    &tilt_loss::SPEC,
];

/// Every effect the bench knows: its own by stage, then those that were registered. Those listed in a rig act in this
/// order. An effect's index here stands for it in a program, never in a file.
pub static LIBRARY: Library = Library { registered: Mutex::new(Vec::new()), all: OnceLock::new() };

/// The effects, as a slice that does not change once it has been looked at.
pub struct Library {
    registered: Mutex<Vec<&'static EffectSpec>>,
    all: OnceLock<Vec<&'static EffectSpec>>,
}

impl Library {
    /// Adds an effect that is written elsewhere: it is simulated, fitted, named and reported as the bench's own are.
    /// Before anything looks at the library, such as a rig that lists effects.
    pub fn register(&self, spec: &'static EffectSpec) -> Result<(), RegisterError> {
        let mut registered = self.registered.lock().unwrap_or_else(PoisonError::into_inner);
        if self.all.get().is_some() {
            return Err(RegisterError::InUse { name: spec.name });
        }
        if OWN.iter().chain(registered.iter()).any(|other| other.name == spec.name) {
            return Err(RegisterError::Repeated { name: spec.name });
        }
        registered.push(spec);
        Ok(())
    }
}

impl Deref for Library {
    type Target = [&'static EffectSpec];

    fn deref(&self) -> &Self::Target {
        self.all.get_or_init(|| {
            let registered = self.registered.lock().unwrap_or_else(PoisonError::into_inner);
            OWN.iter().chain(registered.iter()).copied().collect()
        })
    }
}

/// Why an effect could not be registered.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
pub enum RegisterError {
    /// Somebody may hold indices already.
    #[error("effect {name}: the library is in use; register it at the start of the program")]
    InUse {
        /// The effect's name.
        name: &'static str,
    },
    /// Names tell effects apart.
    #[error("effect {name}: the library has one of that name; give it another")]
    Repeated {
        /// The name.
        name: &'static str,
    },
}

/// Where an effect stands in the [`LIBRARY`].
pub fn index_of(name: &str) -> Option<usize> {
    LIBRARY.iter().position(|spec| spec.name == name)
}

/// Library index of the effect that is read directly as this; the bench's own has one for each.
pub fn read_as(reading: Reading) -> usize {
    LIBRARY
        .iter()
        .position(|spec| spec.signature.reading == Some(reading))
        .expect("the bench's own effects have every reading, which a test shows")
}
