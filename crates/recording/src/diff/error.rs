use std::path::PathBuf;

use thiserror::Error;

use crate::RecordingError;

/// Why two recordings could not be compared at all.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum DiffError {
    /// A recording cannot be read.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// A file of tolerances cannot be read.
    #[error("cannot read tolerances {}: {source}", path.display())]
    Read {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A file of tolerances is not what it should be.
    #[error("{}: {detail}; see docs/diff.md for the keys", path.display())]
    BadFile {
        /// Which file.
        path: PathBuf,
        /// What is wrong and where, as the TOML reader says.
        detail: String,
    },
    /// A tolerance that makes no sense.
    #[error("{origin}: {key} = {value} for {field}; it must be {expected}")]
    BadTolerance {
        /// The file or the flag.
        origin: String,
        /// Which tolerance.
        key: &'static str,
        /// Its value.
        value: f64,
        /// The pattern that it stands for.
        field: String,
        /// What it may be.
        expected: &'static str,
    },
    /// A flag that is not `FIELD=NUMBER`.
    #[error("tolerance {text:?} cannot be read; write FIELD=NUMBER, such as position_m.z=0.02")]
    BadFlag {
        /// What was written.
        text: String,
    },
    /// A pattern that no field answers to.
    #[error("{origin}: no field matches {pattern:?}; the closest is {closest}")]
    NoSuchField {
        /// The file or the flag.
        origin: String,
        /// The pattern.
        pattern: String,
        /// The field most like it.
        closest: String,
    },
    /// An option out of range.
    #[error("diff option {option} is {value}; it must be {expected}")]
    BadOption {
        /// Which.
        option: &'static str,
        /// Its value.
        value: String,
        /// What it may be.
        expected: &'static str,
    },
}
