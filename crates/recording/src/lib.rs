//! MCAP recordings.
mod record;
pub use record::*;
