//! One module a command.

pub mod blind;
pub mod diagnose;
pub mod diff;
pub mod effects;
pub mod export;
pub mod identify;
pub mod import;
pub mod info;
pub mod recover;
pub mod sim;
pub mod tracks;
