//! The nominal model's numbers and their tolerances, from measurements.
//!
//! ```text
//! balance readings (CSV)           -> Readings -> identify_thrust        -> the rig with gain, offset, throttle that hovers
//!                                              -> identify_ground_effect -> the rig with the ground effect
//! flights, and no rig              -> Draft                  -> a rig with wide tolerances, each guess marked
//! nominal flights + a rig as prior -> identify_flights -> the rig with values and tolerances that cover the flights
//!                                  -> identify_nominal -> the same with the laws that belong to it, held against flights left out
//! open-loop flights + a rig        -> verify           -> how well the rig's model predicts them
//! ```
//!
//! Flights are fitted by the filter of the diagnosis, so that a rig identified here is what the diagnosis holds flights
//! against. `docs/identify.md` has the equations.

mod blocks;
mod draft;
mod error;
mod flight;
mod ground;
mod laws;
mod noise;
mod plausible;
mod readings;
mod spread;
mod statistics;
mod thrust;
mod verify;

pub use blocks::{Block, LEAST_FLIGHTS};
pub use draft::{Draft, DraftError, Known, Note, Source};
pub use error::{Contradiction, IdentifyError};
pub use flight::{FlightIdentification, IdentifiedNumber, identify_flights};
pub use ground::{
    GroundIdentification, GroundNumber, GroundPoint, Law, LawTold, ThrottleTold, identify_ground_effect,
};
pub use laws::{NominalLaw, identify_nominal};
pub use plausible::plausible_altitude;
pub use readings::{Mounting, Reading, Readings, Refused};
pub use thrust::{
    LevelLine, LevelsDiffer, Linearity, Measured, Point, ThrustIdentification, ThrustOptions, Use,
    identify_thrust,
};
pub use verify::{
    DISTURBANCE, FlightVerified, OpenLoop, RANGES, Share, Tolerance, Trajectory, Verification, VerifyCheck,
    VerifyVerdict, verify,
};
