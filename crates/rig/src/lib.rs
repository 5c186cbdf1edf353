//! Rig, airframe and mission files: TOML to checked values.
//!
//! A [`Rig`] is the nominal model of a bench: airframe, output, tracker, loop and gains, each uncertain number with its
//! one-sigma tolerance ([`Uncertain`]). A [`Mission`] is what to fly on it. Nothing is guessed: a wrong key, unit,
//! range or file is a [`Problem`] that names file, line, key and what was expected, and all problems of a file are told
//! at once. Each struct's keys are listed once, in a `visit` function that both reads and writes them, so that
//! [`Rig::to_toml`] gives back a file that reads to the same rig.

mod airframe;
mod calibration;
mod change;
mod control_state;
mod error;
pub mod keys;
mod mission;
mod phase;
mod rig;
mod uncertain;
pub mod visit;

pub use airframe::{Actuation, Airframe, GroundEffect, Stabiliser, StickRange, Thrust};
pub use calibration::{Calibration, Depth, Lens};
pub use change::ChangeError;
pub use control_state::ControlState;
pub use error::{Location, Problem, RigError};
pub use mission::{Chirp, Criteria, Mission, PhaseAction, PhasePlan, Profile};
pub use phase::{Phase, UnknownPhase};
pub use rig::{
    Bench, Control, Disturbance, EffectEntry, FeedForward, HeldOut, Loop, Model, Observer, Output, Plant,
    Predictor, ReadText, Rig, Safety, Tracker,
};
pub use uncertain::Uncertain;

/// Standard gravity, m/s^2 (ISO 80000-3).
pub const GRAVITY_M_S2: f64 = 9.806_65;
