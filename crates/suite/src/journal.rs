//! What a suite has flown so far, a line a flight, so that one that was killed can go on.

use std::{
    fs::{File, OpenOptions, TryLockError},
    io::{self, Write as _},
    path::{Path, PathBuf},
};

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::Run;

/// A flight that is in the journal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Kept {
    /// The test's id.
    pub test: String,
    /// What the flight came to.
    pub run: Run,
}

#[derive(Serialize, Deserialize)]
struct Head {
    journal: String,
    /// Of all that decides what is flown.
    of: String,
}

const FORM: &str = "bench.journal/1";

/// Why a journal could not be used.
#[derive(Debug, Error)]
pub enum JournalError {
    /// It could not be read or written.
    #[error("cannot use the journal {}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// Another process flies into the same folder.
    #[error("{} is being written by another bench test; wait for it, or name another folder with --output", path.display())]
    InUse {
        /// The file.
        path: PathBuf,
    },
    /// It is of another suite, or of the same before it was changed.
    #[error(
        "{} is of a run with another suite, rig, mission, effect or version of the bench; start afresh with --force, or in another folder with --output",
        path.display()
    )]
    Other {
        /// The file.
        path: PathBuf,
    },
}

/// Keeps other processes off a journal for as long as the file is open, which the system ends with the process.
fn lock(file: &File, path: &Path) -> Result<(), JournalError> {
    file.try_lock().map_err(|error| match error {
        TryLockError::WouldBlock => JournalError::InUse { path: path.to_owned() },
        TryLockError::Error(source) => JournalError::Io { path: path.to_owned(), source },
    })
}

/// The open journal. Each flight is one write at its end, which a killed process has either made or not.
#[derive(Debug)]
pub struct Journal {
    path: PathBuf,
    file: File,
}

impl Journal {
    /// Begins a journal. `of` stands for all that decides what is flown.
    pub fn begin(path: &Path, of: &str) -> Result<Self, JournalError> {
        let failed = |source| JournalError::Io { path: path.to_owned(), source };
        let file = OpenOptions::new().write(true).create(true).truncate(false).open(path).map_err(failed)?;
        lock(&file, path)?;
        file.set_len(0).map_err(failed)?;
        let mut journal = Self { path: path.to_owned(), file };
        journal.line(&Head { journal: FORM.to_owned(), of: of.to_owned() })?;
        Ok(journal)
    }

    /// Goes on with a journal: gives what it holds. A last line that was cut is taken off.
    pub fn resume(path: &Path, of: &str) -> Result<(Self, Vec<Kept>), JournalError> {
        let failed = |source| JournalError::Io { path: path.to_owned(), source };
        let other = || JournalError::Other { path: path.to_owned() };
        let file = OpenOptions::new().append(true).open(path).map_err(failed)?;
        lock(&file, path)?;
        let text = std::fs::read_to_string(path).map_err(failed)?;
        let whole = text.rfind('\n').map_or(0, |end| end + 1);
        let mut lines = text[..whole].lines();
        let head: Head = lines.next().and_then(|line| serde_json::from_str(line).ok()).ok_or_else(other)?;
        if head.journal != FORM || head.of != of {
            return Err(other());
        }
        let kept = lines.map(serde_json::from_str).collect::<Result<Vec<Kept>, _>>().map_err(|_| other())?;
        file.set_len(whole as u64).map_err(failed)?;
        Ok((Self { path: path.to_owned(), file }, kept))
    }

    /// Keeps a flight.
    pub fn keep(&mut self, kept: &Kept) -> Result<(), JournalError> {
        self.line(kept)
    }

    fn line(&mut self, value: &impl Serialize) -> Result<(), JournalError> {
        let failed = |source| JournalError::Io { path: self.path.clone(), source };
        let mut line = serde_json::to_vec(value).map_err(|error| failed(error.into()))?;
        line.push(b'\n');
        self.file.write_all(&line).map_err(failed)
    }
}
