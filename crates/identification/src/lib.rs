//! The nominal model's numbers and their tolerances, from measurements.
//!
//! ```text
//! nominal flights + a rig as prior -> identify_flights -> the rig with values and tolerances that cover the flights
//! ```
//!
//! Flights are fitted by the filter of the diagnosis, so that a rig identified here is what the diagnosis holds flights
//! against. `docs/identify.md` has the equations.

mod error;
mod flight;
mod noise;
mod plausible;
mod spread;

pub use error::{Contradiction, IdentifyError};
pub use flight::{FlightIdentification, IdentifiedNumber, identify_flights};
