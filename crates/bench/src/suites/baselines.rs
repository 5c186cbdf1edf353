//! Stored recordings that later ones are held against.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

use anyhow::{Context, bail};
use bench_recording::{Recording, thin};
use bench_rig::{Problem, Rig};
use bench_suite::{Case, Comparison, Run};
use clap::ValueEnum;
use serde::{Deserialize, Serialize};

use super::{Flying, Plan, Planned, comparison, sha256};
use crate::{files, library, recorded, repeats};

/// The list of a folder's baselines.
const INDEX: &str = "baselines.json";
const FORM: &str = "bench.baselines/1";
/// How many differing keys of two rigs are told.
const TOLD: usize = 4;

/// What is known of a baseline. As JSON it stands in the folder's list.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Baseline {
    file: String,
    sha256: String,
    bench_version: String,
    rig: String,
    mission: String,
    seed: u64,
    /// SHA-256 of the rig and the mission as files.
    rig_sha256: String,
    mission_sha256: String,
}

#[derive(Serialize, Deserialize)]
struct Index {
    schema: String,
    baselines: BTreeMap<String, Baseline>,
}

/// The baselines of a suite.
pub struct Baselines {
    folder: PathBuf,
    index: BTreeMap<String, Baseline>,
}

/// What is stored of a flight.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum Stored {
    /// Two records of each channel per iteration of the loop, in single precision, and nothing for viewers
    Thinned,
    /// The recording as it is
    Whole,
}

impl Stored {
    fn of(self, recording: &Path, rig: &Rig) -> anyhow::Result<Vec<u8>> {
        let read = |path: &Path| fs::read(path).with_context(|| format!("cannot read {}", path.display()));
        match self {
            Self::Whole => read(recording),
            Self::Thinned => {
                let folder = tempfile::tempdir().context("cannot make a folder for the thinned form")?;
                let thinned = folder.path().join("thinned.mcap");
                thin(recording, &thinned, 0.5 * rig.control_loop.period_s)?;
                read(&thinned)
            }
        }
    }
}

/// What recording a baseline comes to.
pub enum Change {
    /// There was none.
    New,
    /// The same bytes.
    Same,
    /// It was replaced, or would be.
    Differs { comparison: Comparison, replaced: bool },
}

impl Baselines {
    /// Those of a suite, in the folder that is named, that the suite names, or beside it.
    pub fn open(plan: &Plan, named: Option<&Path>) -> anyhow::Result<Self> {
        let folder = match (named, &plan.suite.baselines) {
            (Some(folder), _) => folder.to_owned(),
            (None, Some(folder)) => plan.beside(folder),
            (None, None) => {
                let stem = plan.path.file_stem().unwrap_or_default().to_string_lossy();
                let name = format!("{stem}.baselines");
                if library::is_embedded(&plan.path) {
                    PathBuf::from(name)
                } else {
                    plan.path.with_file_name(name)
                }
            }
        };
        let list = folder.join(INDEX);
        if !list.exists() {
            return Ok(Self { folder, index: BTreeMap::new() });
        }
        let text = files::read(&list)?;
        let index: Index = serde_json::from_str(&text).with_context(|| {
            format!("{} is no list of baselines; record them again with --record-baselines", list.display())
        })?;
        if index.schema != FORM {
            bail!("{} has the form {:?}, and {FORM} is known here", list.display(), index.schema);
        }
        Ok(Self { folder, index: index.baselines })
    }

    /// All that keeps tests from being held against their baselines.
    pub fn check(&self, plan: &Plan) -> Vec<Problem> {
        let mut problems = Vec::new();
        for planned in &plan.tests {
            let case = &plan.suite.cases[planned.test.case];
            if case.compare.baseline
                && let Some(problem) = self.problem(planned)
            {
                problems.push(case.problem(&plan.path, "compare", &problem));
            }
        }
        problems
    }

    fn problem(&self, planned: &Planned) -> Option<String> {
        let id = &planned.test.id;
        let Some(baseline) = self.index.get(id) else {
            return Some(format!(
                "{} has no baseline of {id}; `bench test --record-baselines` records it",
                self.folder.display()
            ));
        };
        let path = self.folder.join(&baseline.file);
        let bytes = match fs::read(&path) {
            Ok(bytes) => bytes,
            Err(error) => return Some(format!("the baseline {} cannot be read: {error}", path.display())),
        };
        if sha256(&bytes) != baseline.sha256 {
            return Some(format!(
                "the baseline {} is not the one that was recorded: its SHA-256 is another",
                path.display()
            ));
        }
        if sha256(planned.nominal.to_toml()) != baseline.rig_sha256 {
            let told = differing(&path, &planned.nominal);
            return Some(format!(
                "the baseline {} was recorded with another rig{told}; with the rig as it was, or anew with --record-baselines --force",
                path.display()
            ));
        }
        if sha256(planned.mission.to_toml()) != baseline.mission_sha256 {
            return Some(format!(
                "the baseline {} was recorded with another mission; fly the mission as it was, or record anew with --record-baselines --force",
                path.display()
            ));
        }
        None
    }

    /// A recording against the baseline of its test.
    pub fn compare(&self, plan: &Plan, planned: &Planned, recording: &Path) -> anyhow::Result<Comparison> {
        let file =
            self.index.get(&planned.test.id).map(|baseline| baseline.file.as_str()).unwrap_or_default();
        let derived = repeats::of(planned.nominal.clone(), &planned.mission);
        comparison(plan, planned, &self.folder.join(file), recording, derived, &[]).map(|found| Comparison {
            kind: bench_suite::Kind::Baseline,
            with: file.to_owned(),
            ..found
        })
    }

    /// Takes a flight as the baseline of its test; one that is there and differs is replaced with `force` alone.
    pub fn record(
        &mut self,
        plan: &Plan,
        flying: &Flying<'_>,
        planned: &Planned,
        run: &Run,
        (stored, force): (Stored, bool),
    ) -> anyhow::Result<Change> {
        let Some(attached) = &run.recording else { bail!("{} has no recording", planned.test.id) };
        let recording = flying.recording(attached);
        let bytes = stored.of(&recording, &planned.nominal)?;
        let digest = sha256(&bytes);
        let before = self.index.get(&planned.test.id);
        let change = match before {
            None => Change::New,
            Some(before) if before.sha256 == digest => Change::Same,
            Some(before) => {
                let old = self.folder.join(&before.file);
                let derived = repeats::of(planned.nominal.clone(), &planned.mission);
                let comparison =
                    comparison(plan, planned, &old, &recording, derived, &[]).with_context(|| {
                        format!(
                            "{} cannot be compared; take it out of {} to record it anew",
                            old.display(),
                            self.folder.display()
                        )
                    })?;
                let comparison =
                    Comparison { kind: bench_suite::Kind::Baseline, with: before.file.clone(), ..comparison };
                Change::Differs { comparison, replaced: force }
            }
        };
        let is_taken = match &change {
            Change::New => true,
            Change::Same => false,
            Change::Differs { replaced, .. } => *replaced,
        };
        if is_taken {
            let file = format!("{}.mcap", planned.test.file_stem);
            let path = self.folder.join(&file);
            files::make_folder(&path)?;
            fs::write(&path, bytes).with_context(|| format!("cannot write {}", path.display()))?;
            let baseline = Baseline {
                file,
                sha256: digest,
                bench_version: env!("CARGO_PKG_VERSION").to_owned(),
                rig: planned.nominal.name.clone(),
                mission: planned.mission.name.clone(),
                seed: run.seed,
                rig_sha256: sha256(planned.nominal.to_toml()),
                mission_sha256: sha256(planned.mission.to_toml()),
            };
            self.index.insert(planned.test.id.clone(), baseline);
            self.write()?;
        }
        Ok(change)
    }

    fn write(&self) -> anyhow::Result<()> {
        let index = Index { schema: FORM.to_owned(), baselines: self.index.clone() };
        let path = self.folder.join(INDEX);
        files::write(&path, &(serde_json::to_string_pretty(&index)? + "\n"))
    }

    /// Where they are.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Baselines of tests that the whole suite does not have any more.
    pub fn unused<'a>(&'a self, plan: &'a Plan) -> impl Iterator<Item = &'a str> {
        let has = |id: &str| {
            plan.tests
                .iter()
                .any(|planned| planned.test.id == id && wants(&plan.suite.cases[planned.test.case]))
        };
        self.index.keys().map(String::as_str).filter(move |id| !plan.is_part && !has(id))
    }
}

fn wants(case: &Case) -> bool {
    case.compare.baseline
}

/// How the rig that a recording carries differs from another, in brackets.
fn differing(recording: &Path, rig: &Rig) -> String {
    let own = Recording::open(recording).ok().and_then(|recording| recording.session().rig_toml.clone());
    let own = own.and_then(|text| Rig::read(&recording.join("rig.toml"), &text).ok());
    let told = own.map(|own| recorded::rig_differences(&own, rig)).unwrap_or_default();
    if told.is_empty() {
        return String::new();
    }
    let more = told.len().saturating_sub(TOLD);
    let more = if more > 0 { format!("; and {more} more") } else { String::new() };
    format!(" ({}{more})", told[..told.len().min(TOLD)].join("; "))
}
