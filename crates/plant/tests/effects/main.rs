//! The library of effects: what each does to a flight, to frames and to timing, and how it is asked for.

mod asking;
mod bench;
mod flights;
mod frames;
mod library;
mod page;
mod steps;
