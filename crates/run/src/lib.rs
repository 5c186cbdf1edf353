//! The loop: devices, controller and recorder, iteration by iteration.
//!
//! ```text
//! wait for the tick -> poll positions -> decide -> write and read back -> record -> safety -> next tick
//! ```
//!
//! [`fly`] drives any three ends through the traits of `bench_device`; [`simulate`] drives the virtual lab in lockstep.
//! What a flight achieved is a [`Summary`], computed the same way for every bench from what the tracker saw.

mod fly;
mod safety;
mod simulate;
mod sink;
mod summary;

pub use fly::{Ending, Flown, Progress, fly};
pub use safety::StopReason;
pub use simulate::{SimulationError, simulate, simulate_on};
pub use sink::Sink;
pub use summary::{Check, Summary, check};
