//! One module a command.

pub mod blind;
pub mod calibrate;
pub mod check;
pub mod devices;
pub mod diagnose;
pub mod diff;
pub mod effects;
pub mod emulate;
pub mod export;
pub mod hil;
pub mod identify;
pub mod import;
pub mod info;
pub mod laws;
pub mod paper;
pub mod record_frames;
pub mod recover;
pub mod schema;
pub mod sim;
pub mod track;
pub mod tracks;
pub mod tune;
pub mod verify;
