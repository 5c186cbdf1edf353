//! Physics that shares nothing with the bench's plant: other integrator, other forms, other noise.

pub(crate) mod actuator;
pub(crate) mod air;
pub(crate) mod airframe;
pub(crate) mod body;
pub(crate) mod environment;
pub(crate) mod integrator;
pub(crate) mod law;
pub(crate) mod outside;
pub(crate) mod propulsion;
pub(crate) mod timing;
pub(crate) mod tracker;
pub(crate) mod world;
