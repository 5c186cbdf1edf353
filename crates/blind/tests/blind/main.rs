//! Seals and how they are opened.

mod common;
mod open;
mod seal;
mod unfinished;
