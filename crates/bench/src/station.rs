//! The log of a station: every run is entered when it begins, and its recording named.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError},
    time::Instant,
};

use anyhow::bail;
use bench_recording::Flight;
use bench_rig::{Mission, Rig};
use bench_station::{Begun, Entry, Finished, Log};
use bench_suite::{MissionCriteria, file_stem, judge};
use clap::Args;

use crate::{arguments::Meta, exit::Exit, recorded, suites::sha256, words};

/// The station of a single flight.
#[derive(Args)]
#[group(skip)]
pub struct StationArgument {
    /// Folder of the station that flies: its log, which names and keeps the recording [default: what `BENCH_STATION` names, if there
    /// is no --output]
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["output", "force"])]
    station: Option<PathBuf>,
}

impl StationArgument {
    /// Opens the station, where there is one; a recording that is named goes to none but a station that is named as well.
    pub fn open(&self, output: Option<&Path>) -> anyhow::Result<Option<Station>> {
        let ours =
            || std::env::var_os("BENCH_STATION").filter(|folder| !folder.is_empty()).map(PathBuf::from);
        let folder = self.station.clone().or_else(|| output.is_none().then(ours).flatten());
        folder.as_deref().map(Station::open).transpose()
    }
}

/// A flight that belongs to no suite.
pub struct Single<'a> {
    /// The command that flies it.
    pub command: &'a str,
    pub mode: &'a str,
    pub nominal: &'a Rig,
    /// Effects beyond the nominal rig.
    pub added: &'a [String],
    pub mission: &'a Mission,
    pub seed: u64,
    pub meta: &'a Meta,
}

impl Single<'_> {
    fn entry(&self) -> Entry {
        Entry {
            started_unix_s: recorded::since_1970().as_secs_f64(),
            suite: self.command.to_owned(),
            test: self.mission.name.clone(),
            rig: self.nominal.name.clone(),
            mission: self.mission.name.clone(),
            mode: self.mode.to_owned(),
            effects: self.added.join("; "),
            seed: self.seed,
            repeat: 0,
            bench_version: env!("CARGO_PKG_VERSION").to_owned(),
        }
    }
}

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

    /// Enters a run, which gives its recording a name that ends in `stem`.
    pub fn begin(&self, entry: &Entry, meta: &BTreeMap<String, String>, stem: &str) -> anyhow::Result<Begun> {
        let begun = self.with(|log| log.begin(entry, meta, stem))?;
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
        flight: &Single<'_>,
        fly: impl FnOnce(&Path) -> anyhow::Result<(Exit, String)>,
    ) -> anyhow::Result<Exit> {
        let began = Instant::now();
        let meta = flight.meta.meta.iter().cloned().collect();
        let Single { command, nominal, mission, seed, .. } = flight;
        let stem = file_stem(&format!("{command}_{}_{}_seed{seed}", nominal.name, mission.name));
        let Begun { id, recording } = self.begin(&flight.entry(), &meta, &stem)?;
        let flown = fly(&recording);
        let (outcome, reason) = match &flown {
            Ok((Exit::Done, _)) => ("passed", None),
            Ok((Exit::CheckFailed, why)) => ("failed", Some(why.clone())),
            Ok((Exit::DataLoss, _)) => ("error", Some("flown, but not all of it was recorded".to_owned())),
            Ok((_, why)) => ("error", Some(why.clone())),
            Err(error) => ("error", Some(words::causes(error))),
        };
        let bytes = std::fs::read(&recording).ok();
        let figures = Flight::load(&recording).map(|flight| {
            judge(&flight, &[], MissionCriteria::Ignore, &mission.criteria).figures.into_iter().collect()
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
