//! A flight as a live page in the browser: traces, the camera's views, what the loop says, and the operator's commands.
//!
//! ```text
//! loop's thread                        | thread "live" (tokio)                         | browsers
//! Record -> bounded queue ------------> | Telemetry: batches, 30 a second -> broadcast -> traces, events
//! Frame -> pool of buffers -> "views" -> | three JPEGs, the newest only -> watch        -> views
//! Controls <- atomic flag, queue <------ | Desk: token, who commands, rate, envelope    <- START, altitude, STOP
//! ```
//! What leads to the browsers is bounded and loses what a browser has no time for, so that no browser delays the loop. What leads to the loop
//! is an atomic flag and a bounded queue of altitudes. Nothing that a flight calls here allocates or locks.
//!
//! The page and its scripts are part of the program; nothing is fetched from anywhere.

mod about;
mod controls;
mod desk;
mod error;
mod frames;
mod server;
mod socket;
mod telemetry;
mod token;

pub use about::{About, Outcome, Stage};
pub use controls::{Ask, Controls};
pub use desk::Start;
pub use error::ViewError;
pub use frames::Frames;
pub use server::Live;
