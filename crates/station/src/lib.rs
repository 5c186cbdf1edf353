//! The log of a station: every run with its result, figures and recording, in one `SQLite` file that stands in the station's folder.
//!
//! - A run is entered when it begins and finished when it ends. One that was killed stays entered as `begun`.
//! - The log gives each recording its name, which no other run has, so that none is ever overwritten.
//! - Several processes may write at a time: each entry is a transaction, and who finds the file busy waits.
//!
//! Nothing of the bench is known here: runs are texts and numbers.

mod log;
mod schema;
mod trend;

use std::{io, path::PathBuf};

use thiserror::Error;

pub use log::{Begun, Entry, Filter, Finished, Log, Run};
pub use trend::{Drift, Trend, Week};

/// Why the log could not be used.
#[derive(Debug, Error)]
pub enum StationError {
    /// A folder or a file could not be made.
    #[error("cannot use the station's folder {}: {source}", path.display())]
    Folder {
        /// The folder or file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The database refuses.
    #[error("cannot use the station's log {}: {source}", path.display())]
    Database {
        /// The file.
        path: PathBuf,
        /// Why.
        source: rusqlite::Error,
    },
    /// The file is a database of something else.
    #[error("{} is a database, but no log of a station; name another folder with --station", path.display())]
    Foreign {
        /// The file.
        path: PathBuf,
    },
    /// The log was written by a later version of the bench.
    #[error("{} was written by a newer version of the bench (form {found}, this one knows {known}); use that one", path.display())]
    Newer {
        /// The file.
        path: PathBuf,
        /// The form that it has.
        found: i64,
        /// The latest form that is known here.
        known: i64,
    },
    /// There is no log.
    #[error("{} holds no log of a station; `bench test --station` makes one", path.display())]
    Absent {
        /// The folder.
        path: PathBuf,
    },
}
