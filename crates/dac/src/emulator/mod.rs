//! An emulated PSoC5 on a pseudo terminal, with faults to order.
//!
//! [`Board`] is what the board does, in a time that it is told; [`EmulatedPsoc5`] runs one behind a pty in real time, so that whoever
//! opens that port cannot tell it from a slow, noisy or vanishing board.

mod board;
mod faults;
mod port;

pub use board::{Board, Moment};
pub use faults::LinkFaults;
pub use port::EmulatedPsoc5;
