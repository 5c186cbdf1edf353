//! Rig, airframe and mission files: TOML to checked values with one-sigma tolerances.

mod phase;

pub use phase::Phase;
