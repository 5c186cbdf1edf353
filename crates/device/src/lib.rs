//! What stands at the ends of the control loop.
//!
//! The loop reads positions from a [`PositionSource`], writes sticks to a [`VoltageOutput`] and takes its time from a
//! [`Clock`]. It cannot tell a simulated end from a real one. This crate holds those three traits, the values that
//! cross them, and a scripted fake of each for tests ([`fake`]). It depends on no other crate of the bench.

mod error;
pub mod fake;
mod position;
mod sticks;
mod time;

pub use error::DeviceError;
pub use position::{PositionSample, PositionSource, TrackStatus};
pub use sticks::{Faults, Readback, Sticks, VoltageOutput};
pub use time::{Clock, Time};
