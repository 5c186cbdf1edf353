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
    /// A table has no row that names its columns.
    #[error("{} is empty; expected a CSV file whose first line names the columns", path.display())]
    NoHeader {
        /// The log.
        path: PathBuf,
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
    /// A file that holds several flights.
    #[error(
        "{} holds {count} logs; name one of them with --part 1 to --part {count}", path.display()
    )]
    SeveralParts {
        /// The log.
        path: PathBuf,
        /// How many.
        count: usize,
    },
    /// There is no such part.
    #[error("{} has no part {part}: it holds {count}", path.display())]
    NoSuchPart {
        /// The log.
        path: PathBuf,
        /// The part, from one.
        part: usize,
        /// How many there are.
        count: usize,
    },
}
