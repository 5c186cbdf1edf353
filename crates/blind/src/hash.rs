//! SHA-256 in hexadecimal digits.

use std::{fmt::Write as _, fs, path::Path};

use sha2::{Digest, Sha256};

use crate::BlindError;

pub(crate) struct Sha(Sha256);

impl Sha {
    pub(crate) fn new() -> Self {
        Self(Sha256::new())
    }

    pub(crate) fn and(mut self, bytes: &[u8]) -> Self {
        self.0.update(bytes);
        self
    }

    pub(crate) fn finish(self) -> String {
        self.0.finalize().iter().fold(String::with_capacity(64), |mut digits, byte| {
            // Writing to a String cannot fail.
            let _ = write!(digits, "{byte:02x}");
            digits
        })
    }
}

pub(crate) fn of(bytes: &[u8]) -> String {
    Sha::new().and(bytes).finish()
}

/// SHA-256 of a file in hexadecimal digits.
pub fn of_file(path: &Path) -> Result<String, BlindError> {
    Ok(of(&fs::read(path).map_err(BlindError::io("read", path))?))
}
