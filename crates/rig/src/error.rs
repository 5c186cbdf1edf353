use std::{fmt, io, path::PathBuf};

use thiserror::Error;

/// A place in a file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Location {
    /// The file, as it was named.
    pub file: PathBuf,
    /// The line, counted from one.
    pub line: usize,
}

impl fmt::Display for Location {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}", self.file.display(), self.line)
    }
}

/// One thing wrong in a rig or mission file.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum Problem {
    /// A key that means nothing here.
    #[error("{at}: unknown key `{key}`; {hint}")]
    UnknownKey {
        /// Where.
        at: Location,
        /// The key with its tables.
        key: String,
        /// What is close to it, or what there is.
        hint: String,
    },
    /// A key that must be there and is not.
    #[error("{at}: key `{key}` is missing; expected {expected}")]
    MissingKey {
        /// The table that should hold it.
        at: Location,
        /// The key with its tables.
        key: String,
        /// What it should hold.
        expected: String,
    },
    /// A value of the wrong kind.
    #[error("{at}: `{key}` is {found}; expected {expected}")]
    WrongType {
        /// Where.
        at: Location,
        /// The key with its tables.
        key: String,
        /// What is there.
        found: String,
        /// What it should hold.
        expected: String,
    },
    /// A number outside what makes sense.
    #[error("{at}: `{key}` = {value} is out of range; expected {expected}")]
    OutOfRange {
        /// Where.
        at: Location,
        /// The key with its tables.
        key: String,
        /// The number found.
        value: f64,
        /// The range.
        expected: String,
    },
    /// Values that are fine one by one but not together.
    #[error("{at}: `{key}`: {detail}")]
    Contradiction {
        /// Where.
        at: Location,
        /// The key with its tables.
        key: String,
        /// What does not fit.
        detail: String,
    },
}

impl Problem {
    /// Where it stands.
    pub fn at(&self) -> &Location {
        match self {
            Self::UnknownKey { at, .. }
            | Self::MissingKey { at, .. }
            | Self::WrongType { at, .. }
            | Self::OutOfRange { at, .. }
            | Self::Contradiction { at, .. } => at,
        }
    }

    /// The key with its tables.
    pub fn key(&self) -> &str {
        match self {
            Self::UnknownKey { key, .. }
            | Self::MissingKey { key, .. }
            | Self::WrongType { key, .. }
            | Self::OutOfRange { key, .. }
            | Self::Contradiction { key, .. } => key,
        }
    }

    /// What is wrong, without place, key and hint.
    pub fn what(&self) -> String {
        match self {
            Self::UnknownKey { .. } => "unknown key".to_owned(),
            Self::MissingKey { .. } => "missing".to_owned(),
            Self::WrongType { found, .. } => format!("is {found}"),
            Self::OutOfRange { value, .. } => format!("{value} is out of range"),
            Self::Contradiction { detail, .. } => detail.clone(),
        }
    }

    /// What to do about it, where there is more to say than [`Problem::what`].
    pub fn hint(&self) -> Option<String> {
        match self {
            Self::UnknownKey { hint, .. } => Some(hint.clone()),
            Self::MissingKey { expected, .. }
            | Self::WrongType { expected, .. }
            | Self::OutOfRange { expected, .. } => Some(format!("expected {expected}")),
            Self::Contradiction { .. } => None,
        }
    }
}

/// Why a file could not be used.
#[derive(Debug, Error)]
pub enum RigError {
    /// The file could not be read.
    #[error("cannot read {what} {}: {source}", path.display())]
    Read {
        /// Rig, airframe or mission.
        what: &'static str,
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The file is not TOML.
    #[error("{at}: not valid TOML: {detail}")]
    Syntax {
        /// Where.
        at: Location,
        /// What the TOML reader says.
        detail: String,
    },
    /// The file is TOML, but not a rig or mission.
    #[error("{}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"))]
    Invalid(
        /// All that is wrong with it.
        Vec<Problem>,
    ),
}
