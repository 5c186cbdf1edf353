use std::{io, path::PathBuf};

use bench_logs::LogError;
use bench_rig::{Actuation, Location, RigError};
use thiserror::Error;

use super::Skipped;
use crate::{FileKind, RecordingError};

/// Why a log could not be imported. No output file is left behind, and an older one stays as it was.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ImportError {
    /// The mapping file, or the rig that it names, cannot be used.
    #[error(transparent)]
    Map(#[from] RigError),
    /// The log cannot be read.
    #[error("cannot read log {}: {source}", path.display())]
    Read {
        /// The log.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The log is no table.
    #[error("{} is {}, not a table of a flight: {advice}", path.display(), kind.name())]
    NotCsv {
        /// The log.
        path: PathBuf,
        /// What it is.
        kind: FileKind,
        /// What to do.
        advice: String,
    },
    /// A log of topics cannot be read.
    #[error(transparent)]
    Log(#[from] LogError),
    /// The map is for logs of another kind.
    #[error("{} is {}, and map {map} is for {expected}; name another map, or none", path.display(), kind.name())]
    OtherLog {
        /// The log.
        path: PathBuf,
        /// What it is.
        kind: FileKind,
        /// The map's name.
        map: String,
        /// What the map is for, in words.
        expected: &'static str,
    },
    /// Several topics of a log have what the map calls by their type.
    #[error(
        "{}: map {map} takes {column} from the one topic of its type, and there are several: {}. Copy the map (`bench rigs copy import/{map}`) and \
         name in it the topic of the vehicle that is wanted",
        path.display(), topics.join(", ")
    )]
    SeveralTopics {
        /// The log.
        path: PathBuf,
        /// The map's name.
        map: String,
        /// The column.
        column: String,
        /// The topics that have it.
        topics: Vec<String>,
    },
    /// A log of topics has no altitude that a map finds.
    #[error(
        "{} has no altitude that {} looks for: of {} there is none. {}. Without an altitude there is no flight; {instead}a map of your own \
         may name another topic (docs/import.md)",
        path.display(), maps.join(" or "), missing.join(", "),
        if topics.is_empty() { "It has no topics at all".to_owned() } else { format!("Its topics are {}", topics.join(", ")) }
    )]
    NoAltitude {
        /// The log.
        path: PathBuf,
        /// The maps' names.
        maps: Vec<String>,
        /// Columns that the maps name and the log does not have.
        missing: Vec<String>,
        /// What the log has.
        topics: Vec<String>,
        /// What else can be done with logs of this format, in words that another sentence follows; or nothing.
        instead: &'static str,
    },
    /// A table whose columns tell no flight.
    #[error(
        "no map can be guessed for {}: {}. Its columns are {}. docs/import.md tells how a map is written",
        path.display(), missing.join("; "), columns.join(", ")
    )]
    NotGuessed {
        /// The log.
        path: PathBuf,
        /// What was not found, in words.
        missing: Vec<String>,
        /// The columns that the log has.
        columns: Vec<String>,
    },
    /// The log has no header.
    #[error("{} is empty; expected a CSV file whose first line names the columns", path.display())]
    NoHeader {
        /// The log.
        path: PathBuf,
    },
    /// The map names columns that the log does not have exactly once.
    #[error(
        "{}\n{} has the columns {}",
        problems.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"), path.display(), columns.join(", ")
    )]
    Columns {
        /// The log.
        path: PathBuf,
        /// One for each place in the map.
        problems: Vec<ColumnProblem>,
        /// The columns that the log has.
        columns: Vec<String>,
    },
    /// Map and rig command their sticks in different units.
    #[error(
        "{}: the map's actuation is {}, but rig {rig}'s sticks are in {}; use the map or the rig that fits the log",
        file.display(), map.unit(), expected.unit()
    )]
    Actuation {
        /// The map.
        file: PathBuf,
        /// The map's actuation.
        map: Actuation,
        /// The rig's name.
        rig: String,
        /// The rig's actuation.
        expected: Actuation,
    },
    /// Not one row could be used.
    #[error(
        "{} has no row that can be used: of {rows} rows, {filtered} were filtered out{}",
        path.display(), skipped.iter().map(|skipped| format!("\n{skipped}")).collect::<Vec<_>>().concat()
    )]
    NoUsableRow {
        /// The log.
        path: PathBuf,
        /// Rows below the header.
        rows: u64,
        /// Rows that the map's filters left out.
        filtered: u64,
        /// The others, by what is wrong with them.
        skipped: Vec<Skipped>,
    },
    /// The recording cannot be written.
    #[error(transparent)]
    Recording(#[from] RecordingError),
}

/// A column that the map names and the log does not have exactly once.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{at}: `{key}`: {} column is called {column:?}", if *count == 0 { "no".to_owned() } else { count.to_string() + " times a" })]
pub struct ColumnProblem {
    /// Where the map names it.
    pub at: Location,
    /// The key there.
    pub key: String,
    /// The column.
    pub column: String,
    /// How often the log has it.
    pub count: usize,
}
