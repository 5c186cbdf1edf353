//! The board's application (`firmware/app.c`) on its scripted board: what a host, and whoever stands beside the rotors,
//! relies on. Time is the script's, so that hours take seconds and nothing depends on the machine.

mod arming;
mod campaign;
mod line;
mod scripted;
