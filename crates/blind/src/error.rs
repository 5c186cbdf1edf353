use std::{io, path::PathBuf};

use bench_recording::RecordingError;
use thiserror::Error;

/// Why a blind check could not be made or opened.
#[derive(Debug, Error)]
pub enum BlindError {
    /// A file could not be read or written.
    #[error("cannot {action} {}: {source}", path.display())]
    Io {
        /// What was tried.
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// A recording could not be written.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The folder or the key is there already.
    #[error("{} exists; a seal is made once: name another place", path.display())]
    Exists {
        /// What is there.
        path: PathBuf,
    },
    /// The key would lie beside what it opens.
    #[error("the key {} would lie in the sealed folder, where whoever answers finds it; name a place outside of it", path.display())]
    KeyInside {
        /// Where it would lie.
        path: PathBuf,
    },
    /// Nothing can be sealed from this.
    #[error("nothing can be sealed: {detail}")]
    Plan {
        /// Why.
        detail: String,
    },
    /// What flights can show cannot be computed from this.
    #[error("what flights can show cannot be computed: {detail}")]
    Power {
        /// Why.
        detail: String,
    },
    /// A file is not what it should be.
    #[error("{}: {detail}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        detail: String,
    },
    /// The key is not the one that was sealed.
    #[error(
        "the key {} does not match the seal: it hashes to {found}, sealed was {sealed}; it is another seal's key or was changed",
        path.display()
    )]
    WrongKey {
        /// The key.
        path: PathBuf,
        /// Its hash.
        found: String,
        /// The seal's.
        sealed: String,
    },
    /// Sealed files are not as they were.
    #[error("{} changed since the seal was made: {}; scores would be worthless", plural(.files.len(), "sealed file"), .files.join(", "))]
    Changed {
        /// Which, with what happened to them.
        files: Vec<String>,
    },
    /// The answers are not as they were hashed.
    #[error(
        "the answers {} changed after they were hashed: they say {told}, they hash to {found}",
        path.display()
    )]
    ChangedAnswers {
        /// The answers.
        path: PathBuf,
        /// The hash that they carry.
        told: String,
        /// Their hash.
        found: String,
    },
    /// Another run is answering into the same file.
    #[error("{} is in use: another run is answering into it", path.display())]
    Busy {
        /// The unfinished answers.
        path: PathBuf,
    },
    /// Unfinished answers of another program or to another seal are in the way.
    #[error(
        "{} has unfinished answers of another run ({whose}); remove it to answer from the beginning, or name another output",
        path.display()
    )]
    OtherUnfinished {
        /// The unfinished answers.
        path: PathBuf,
        /// Tool, program and seal.
        whose: String,
    },
    /// The answers are to other cases.
    #[error("the answers {} are to another seal ({told}); this one is {sealed}", path.display())]
    OtherSeal {
        /// The answers.
        path: PathBuf,
        /// The seal that they name.
        told: String,
        /// The seal at hand.
        sealed: String,
    },
}

/// `1 file`, `2 files`.
fn plural(count: usize, one: &str) -> String {
    format!("{count} {one}{}", if count == 1 { "" } else { "s" })
}

impl BlindError {
    pub(crate) fn io(action: &'static str, path: impl Into<PathBuf>) -> impl FnOnce(io::Error) -> Self {
        let path = path.into();
        move |source| Self::Io { action, path, source }
    }
}
