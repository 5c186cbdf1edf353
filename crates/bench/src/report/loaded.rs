//! Recordings as far as they are whole.

use std::path::{Path, PathBuf};

use anyhow::Context;
use bench_recording::{Flight, Info, RecordingError, recover};

use crate::words;

/// A recording that was read.
pub struct Loaded {
    /// The file as it was named.
    pub path: PathBuf,
    /// What it holds.
    pub flight: Flight,
    /// Its particulars.
    pub info: Info,
    /// What should be known of how whole it is.
    pub warnings: Vec<String>,
    /// Whether data was lost.
    pub is_lossy: bool,
}

impl Loaded {
    /// Reads a recording. Of one that is damaged or was not closed, what is whole is read, with a warning.
    pub fn read(path: &Path) -> anyhow::Result<Self> {
        match Flight::load(path) {
            Ok(flight) => {
                let info = Info::read(path)?;
                let mut warnings = Vec::new();
                let dropped = info.dropped.unwrap_or(0);
                if dropped > 0 {
                    warnings.push(format!(
                        "{}: {} found the recorder's queue full and are lost",
                        path.display(),
                        words::count(dropped, "record")
                    ));
                }
                if info.recovered {
                    warnings.push(format!("{} was recovered; its end may be missing", path.display()));
                }
                for (channel, late) in &flight.out_of_order {
                    warnings.push(format!(
                        "{}: {} of {} stood out of order, and were sorted",
                        path.display(),
                        words::count(*late, "message"),
                        channel.topic()
                    ));
                }
                Ok(Self { path: path.to_owned(), flight, info, warnings, is_lossy: dropped > 0 })
            }
            Err(error @ (RecordingError::Unfinished { .. } | RecordingError::Damaged { .. })) => {
                Self::read_what_is_whole(path, &error)
            }
            Err(error) => Err(error.into()),
        }
    }

    fn read_what_is_whole(path: &Path, error: &RecordingError) -> anyhow::Result<Self> {
        let folder = tempfile::tempdir().context("cannot make a folder for what is whole of a recording")?;
        let whole = folder.path().join("whole.mcap");
        let found = recover(path, &whole)?;
        let flight = Flight::load(&whole)?;
        let mut info = Info::read(&whole)?;
        path.clone_into(&mut info.path);
        let told = format!("{error}. This shows what is whole: {}", words::count(found.messages, "message"));
        Ok(Self { path: path.to_owned(), flight, info, warnings: vec![told], is_lossy: true })
    }
}
