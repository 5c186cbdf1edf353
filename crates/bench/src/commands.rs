//! One module a command.

pub mod blind;
pub mod calibrate;
pub mod completions;
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
pub mod man;
pub mod paper;
pub mod record_frames;
pub mod recover;
pub mod rigs;
pub mod sim;
pub mod track;
pub mod tracks;
pub mod tune;
pub mod udev;
pub mod verify;
