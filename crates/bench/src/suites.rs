//! What `bench test` is made of: a suite resolved to rigs and missions, its flights, baselines, and files of results.

mod baselines;
mod diagnose;
mod flying;
mod plan;
mod ports;
mod results;

pub use baselines::{Baselines, Change, Stored};
pub use diagnose::{compare_back_to_back, comparison};
pub use flying::Flying;
pub use plan::{Plan, Planned, Selected};
pub use ports::Ports;
pub use results::{Folder, PAGE};

use std::fmt::Write as _;

use sha2::{Digest as _, Sha256};

/// SHA-256 in hexadecimal digits.
pub fn sha256(bytes: impl AsRef<[u8]>) -> String {
    Sha256::digest(bytes).iter().fold(String::new(), |mut text, byte| {
        // Writing to a String cannot fail.
        let _ = write!(text, "{byte:02x}");
        text
    })
}
