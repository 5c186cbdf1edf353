//! The controller: figure 14 of the paper for altitude, the same idea sideways and for heading, and the mission's
//! phases. The same object flies the virtual and the real airframe; it sees positions and a clock, nothing else.
//!
//! ```text
//! positions -> Estimator (slope, extrapolation over the delay) -> AltitudeLaw, LateralLaw -> sticks
//!              or Observer (the airframe's model over the delay)
//!                                       mission phases: idle, launch, open, hold, land, abort
//! ```

mod altitude;
mod controller;
mod estimator;
mod ground_effect;
mod lateral;
mod observer;

pub use controller::{AltitudeRefused, Controller, Decision, Landed, NoLanding};
