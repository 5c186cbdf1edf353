//! The PSoC5 board at the end of a serial port.
//!
//! [`Psoc5`] is the `VoltageOutput` of a real bench: it finds out who is on the port, calibrates the loop from the board's
//! outputs to its inputs, arms, and exchanges voltages for readbacks. [`emulator`] is such a board on a pseudo terminal, with
//! faults to order. [`ports`] tells what there is to connect to.
//!
//! Promises: between arming and disarming, a command and its readback neither allocate nor lock; a port that is slow, noisy,
//! unplugged or somebody else's ends in a [`DacError`] that says what to do, never in a panic or a wait without end.

mod calibration;
mod clock;
pub mod emulator;
mod error;
mod link;
pub mod ports;
mod psoc5;

pub use calibration::{Calibration, ChannelLoop};
pub use error::DacError;
pub use psoc5::{Identity, LinkCounts, Psoc5, Safe};
