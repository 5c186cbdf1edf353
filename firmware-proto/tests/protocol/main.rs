//! The protocol as its users rely on it: Rust and C agree on every byte, and nothing but whole frames gets through.

mod c;
mod cross;
mod golden;
mod noise;
mod properties;
mod random;
mod text;
