use std::{io, path::PathBuf};

use thiserror::Error;

/// Why a log could not be read at all.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LogError {
    /// The file cannot be read.
    #[error("cannot read log {}: {source}", path.display())]
    Read {
        /// The log.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// It begins like a log of a format and is none.
    #[error("{} cannot be read as {format}: {detail}", path.display())]
    Malformed {
        /// The log.
        path: PathBuf,
        /// The format, in words.
        format: &'static str,
        /// What is wrong, and what to do where that is known.
        detail: String,
        /// What the reader of the format says.
        source: Option<Box<dyn std::error::Error + Send + Sync>>,
    },
}
