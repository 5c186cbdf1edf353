//! One module a command.

pub mod diagnose;
pub mod blind;
pub mod diff;
pub mod effects;
pub mod export;
pub mod import;
pub mod info;
pub mod recover;
pub mod sim;
