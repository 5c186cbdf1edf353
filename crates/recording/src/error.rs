use std::{io, path::PathBuf};

use bench_device::Time;
use thiserror::Error;

use crate::FileKind;

/// What can go wrong with a recording.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RecordingError {
    /// The operating system refused.
    #[error("cannot {action} {}: {source}", path.display())]
    Io {
        /// What was tried, such as `write`.
        action: &'static str,
        /// Which file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// An option of [`crate::Recorder::create`] makes no sense.
    #[error("recorder option {option} is {value}; it must be {expected}")]
    BadOption {
        /// Which.
        option: &'static str,
        /// Its value.
        value: String,
        /// What it may be.
        expected: &'static str,
    },
    /// The file has no bytes.
    #[error("{} is empty: nothing was ever recorded into it", path.display())]
    Empty {
        /// Which file.
        path: PathBuf,
    },
    /// The file is of another kind.
    #[error("{} is {}, not a recording: {}", path.display(), kind.name(), kind.instead_of_recording(path))]
    NotMcap {
        /// Which file.
        path: PathBuf,
        /// What it is.
        kind: FileKind,
    },
    /// The file has no proper end.
    #[error("{} was not closed; run `bench recover` on it to get back what it holds", path.display())]
    Unfinished {
        /// Which file.
        path: PathBuf,
    },
    /// The file's bytes contradict its checksums or the MCAP format.
    #[error("{} is damaged: {detail}; run `bench recover` on it to get back what is whole", path.display())]
    Damaged {
        /// Which file.
        path: PathBuf,
        /// What was found.
        detail: String,
    },
    /// An MCAP file from elsewhere.
    #[error(
        "{} is an MCAP file of {}, no recording of this bench; it has the channels {}; {}",
        path.display(), origin.unwrap_or("another program"), list(channels),
        "write those with position and throttle as one CSV file, for instance with PlotJuggler, then `bench import --map MAP` makes a recording of that"
    )]
    NotBench {
        /// Which file.
        path: PathBuf,
        /// What wrote it, as its schemas tell.
        origin: Option<&'static str>,
        /// The topics that it has, each with its schema.
        channels: Vec<String>,
    },
    /// Written by a later version of the bench.
    #[error(
        "{} has recording schema {found}, this bench reads up to {known}; update the bench",
        path.display()
    )]
    NewerSchema {
        /// Which file.
        path: PathBuf,
        /// Its version.
        found: u32,
        /// The newest version that can be read.
        known: u32,
    },
    /// The session's metadata cannot be read.
    #[error("{}: metadata {key} is {value:?}, expected {expected}", path.display())]
    BadSession {
        /// Which file.
        path: PathBuf,
        /// Which key.
        key: &'static str,
        /// What it holds.
        value: String,
        /// What it should hold.
        expected: &'static str,
    },
    /// A message contradicts its schema.
    #[error("{}: a message of {channel} at {time} cannot be read: {detail}", path.display())]
    BadMessage {
        /// Which file.
        path: PathBuf,
        /// Its topic.
        channel: &'static str,
        /// Its log time.
        time: Time,
        /// What is wrong.
        detail: String,
    },
    /// The thread that writes ended in a panic.
    #[error("the writer of {} stopped unexpectedly; what was flushed is in the file, `bench recover` gets it back", path.display())]
    WriterPanicked {
        /// Which file.
        path: PathBuf,
    },
    /// There is no session in what is left of a file.
    #[error(
        "{} holds nothing that can be recovered: no session of this bench is in it (channels seen: {})",
        path.display(), list(channels)
    )]
    NothingToRecover {
        /// Which file.
        path: PathBuf,
        /// The topics seen.
        channels: Vec<String>,
    },
    /// Output and input are one file.
    #[error("{} is the input itself; name another file for the output", path.display())]
    OutputIsInput {
        /// Which file.
        path: PathBuf,
    },
    /// The output exists and is a directory, a device or the like.
    #[error("{} exists and is no ordinary file; name another one for the output", path.display())]
    OutputNotAFile {
        /// Which.
        path: PathBuf,
    },
    /// The output's name has no extension that is known.
    #[error("{}: unknown kind of table; name it .csv, .xlsx or .parquet", path.display())]
    UnknownTable {
        /// Which file.
        path: PathBuf,
    },
    /// The crate was built without the table's format.
    #[error("{}: only .csv can be written without the feature `exchange`", path.display())]
    TableNotBuilt {
        /// Which file.
        path: PathBuf,
    },
    /// The recording does not hold what was asked for.
    #[error("{} has no messages in {channel}; it has {}", path.display(), list(present))]
    NoMessages {
        /// Which file.
        path: PathBuf,
        /// Which topic.
        channel: String,
        /// The topics that have messages.
        present: Vec<String>,
    },
    /// More rows than a spreadsheet takes.
    #[error("{channel} has {rows} rows and a sheet holds {limit}; export to .csv or .parquet instead")]
    TooManyRows {
        /// Which topic or sheet.
        channel: String,
        /// How many rows it has.
        rows: u64,
        /// How many fit.
        limit: u64,
    },
    /// A table could not be written for a reason of its format.
    #[error("cannot write table {}: {detail}", path.display())]
    Table {
        /// Which file.
        path: PathBuf,
        /// Why.
        detail: String,
    },
}

fn list(names: &[String]) -> String {
    if names.is_empty() { "none".to_owned() } else { names.join(", ") }
}
