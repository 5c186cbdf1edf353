//! The log of a station: every run is entered when it begins, and its recording named.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError},
    time::Instant,
};

use anyhow::bail;
use bench_recording::Flight;
use bench_rig::Criteria;
use bench_station::{Begun, Entry, Finished, Log};
use bench_suite::{MissionCriteria, judge};

use crate::{exit::Exit, suites::sha256, words};

/// Where runs are logged and their recordings kept.
pub struct Station {
    folder: PathBuf,
    log: Mutex<Log>,
}

impl Station {
    /// Opens a station's folder.
    pub fn open(folder: &Path) -> anyhow::Result<Self> {
        Ok(Self { folder: folder.to_owned(), log: Mutex::new(Log::open(folder)?) })
    }

    /// Its folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Enters a run, which gives its recording a name.
    pub fn begin(&self, entry: &Entry) -> anyhow::Result<Begun> {
        let begun = self.with(|log| log.begin(entry))?;
        if begun.recording.exists() {
            bail!(
                "{} exists, although the log gave its name to no run; move it away",
                begun.recording.display()
            );
        }
        Ok(begun)
    }

    /// Says what a run came to.
    pub fn finish(&self, id: i64, finished: &Finished) -> anyhow::Result<()> {
        Ok(self.with(|log| log.finish(id, finished))?)
    }

    /// Has a single flight flown under the name that the log gives it, and enters what it came to: by its exit code, with the sentence
    /// that says why.
    pub fn fly(
        &self,
        entry: &Entry,
        criteria: &Criteria,
        fly: impl FnOnce(&Path) -> anyhow::Result<(Exit, String)>,
    ) -> anyhow::Result<Exit> {
        let began = Instant::now();
        let Begun { id, recording } = self.begin(entry)?;
        let flown = fly(&recording);
        let (outcome, reason) = match &flown {
            Ok((Exit::Done, _)) => ("passed", None),
            Ok((Exit::CheckFailed, why)) => ("failed", Some(why.clone())),
            Ok((_, why)) => ("error", Some(why.clone())),
            Err(error) => ("error", Some(words::causes(error))),
        };
        let bytes = std::fs::read(&recording).ok();
        let figures = Flight::load(&recording).map(|flight| {
            judge(&flight, &[], MissionCriteria::Ignore, criteria).figures.into_iter().collect()
        });
        let finished = Finished {
            outcome: outcome.to_owned(),
            reason,
            took_s: began.elapsed().as_secs_f64(),
            sha256: bytes.map(sha256),
            // What was not flown has none.
            figures: figures.unwrap_or_else(|_| BTreeMap::new()),
        };
        // The flight matters more than its entry.
        let entered = self.finish(id, &finished);
        let (exit, _) = flown?;
        entered?;
        Ok(exit)
    }

    fn with<T>(&self, work: impl FnOnce(&mut Log) -> T) -> T {
        // A transaction is whole or not there: a panic elsewhere spoils none.
        work(&mut self.log.lock().unwrap_or_else(PoisonError::into_inner))
    }
}
