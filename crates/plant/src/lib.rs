//! The plant: a virtual airframe, the effects that its nominal model lacks, and the simulated ends of the loop.
//!
//! ```text
//! sticks [V] -> SimulatedOutput -> actuator -> propulsion -> airframe in its environment -> SimulatedTracker -> positions
//!                (quantise, hold)   effects     effects       Body + effects                 + tracker effects
//! ```
//!
//! The nominal airframe is the paper's vertical model ([`nominal`]), alone or carried by a rigid body with six degrees of
//! freedom ([`body`]) that is exactly that model when level. [`effects`] holds one file an effect; the same laws serve
//! this simulator and the diagnosis. [`batch`] moves several rigid bodies at once. [`lab`] ties it all to the traits of
//! `bench_device`; [`balance`] holds the airframe still on a balance instead.

#![allow(
    clippy::inline_always,
    reason = "what computes in lanes is compiled for the processor's own only where it is part of the one function that asks for it"
)]

pub mod balance;
pub mod batch;
pub mod body;
pub mod effects;
mod integrator;
pub mod lab;
mod lanes;
pub mod nominal;
mod rigid;
