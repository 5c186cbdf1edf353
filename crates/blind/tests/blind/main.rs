//! Seals and how they are opened.

mod common;
mod open;
mod power;
mod seal;
mod unfinished;
