//! The loop: devices, controller and recorder, iteration by iteration.
//!
//! ```text
//! wait for the tick -> poll positions -> decide -> write and read back -> record -> safety -> next tick
//! ```
//!
//! [`fly`] drives any three ends through the traits of `bench_device`; [`simulate`] drives the virtual lab in lockstep, [`Loopback`]
//! puts it behind a real output in real time. [`WallClock`] and [`Granted`] are what a loop in real time needs of the system, and
//! [`fly_guarded`] what it needs around it.
//! [`simulate_seen`] drives the virtual lab with a tracker that looks at frames.
//! [`simulate_together`] simulates many flights whose physics share the lanes of the processor.
//! [`Tee`] lets others watch what is recorded, without a cost to the loop.
//! What a flight achieved is a [`Summary`], computed the same way for every bench from what the tracker saw.

mod fly;
mod guarded;
mod loopback;
mod real_time;
mod safety;
mod simulate;
mod sink;
mod summary;
mod tee;
mod together;

pub use fly::{Directive, Ending, Flown, Progress, fly};
pub use guarded::{await_marker, fly_guarded};
pub use loopback::{Loopback, LoopbackOutput, LoopbackTracker, drain_truth};
pub use real_time::{Granted, WallClock};
pub use safety::StopReason;
pub use simulate::{SimulationError, simulate, simulate_on, simulate_seen};
pub use sink::Sink;
pub use summary::{Check, Percentiles, Summary, Timing, check};
pub use tee::{Tee, Watcher};
pub use together::{Simulation, simulate_together};
