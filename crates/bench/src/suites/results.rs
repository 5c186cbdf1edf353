//! The folder of a suite's results.

use std::{
    fs::{self, OpenOptions},
    io::Write as _,
    path::{Path, PathBuf},
};

use anyhow::{Context, bail};
use bench_page::{Page, Section};
use bench_suite::{Journal, Kept, Outcome, Report, junit, markdown, page};
use maud::html;

use super::{Flying, flying::RECORDINGS};
use crate::{
    files::{self, Form, Outputs},
    report::{Flown, Loaded},
    words,
};

const JOURNAL: &str = "journal.jsonl";
const JSON: &str = "results.json";
const JUNIT: &str = "junit.xml";
const MARKDOWN: &str = "summary.md";
/// The page.
pub const PAGE: &str = "report.html";

/// Flights of so many tests stand on the page in full; of more tests only those that did not pass.
const IN_FULL: usize = 12;
/// No page has more flights.
const FLIGHTS_MAX: usize = 40;

/// The folder, before anything is flown.
pub struct Folder(PathBuf);

impl Folder {
    /// Takes a folder for results: a new or empty one, with `force` any, or to go on with `resume` the one that was begun.
    pub fn open(path: &Path, force: bool, resume: bool) -> anyhow::Result<Self> {
        if resume {
            if !path.join(JOURNAL).is_file() {
                bail!(
                    "{} holds nothing to go on with; leave out --resume, or name the folder with --output",
                    path.display()
                );
            }
        } else {
            let hint = || format!("go on with what is in {} by --resume", path.display());
            Outputs::new(force).and(path, Form::Folder).check().with_context(hint).map_err(|error| {
                // The rule first, then what else there is to do.
                anyhow::anyhow!("{}; or {}", error.root_cause(), hint())
            })?;
        }
        Ok(Self(path.to_owned()))
    }

    /// Its path.
    pub fn path(&self) -> &Path {
        &self.0
    }

    /// Begins the journal, or opens the one of the run that was begun; gives what was flown already and still is there.
    pub fn journal(
        &self,
        digest: &str,
        resume: bool,
        flying: &Flying<'_>,
    ) -> anyhow::Result<(Journal, Vec<Kept>)> {
        let path = self.0.join(JOURNAL);
        if resume {
            let (journal, mut kept) = Journal::resume(&path, digest)?;
            kept.retain(|kept| {
                kept.run.recording.as_ref().is_some_and(|attached| {
                    fs::read(flying.recording(attached))
                        .is_ok_and(|bytes| super::sha256(bytes) == attached.sha256)
                })
            });
            return Ok((journal, kept));
        }
        let recordings = self.0.join(RECORDINGS);
        fs::create_dir_all(&recordings)
            .with_context(|| format!("cannot make the folder {}", recordings.display()))?;
        let journal = Journal::begin(&path, digest)?;
        for name in [JSON, JUNIT, MARKDOWN, PAGE] {
            // What is left of a run before must not be taken for this one's.
            match fs::remove_file(self.0.join(name)) {
                Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                    return Err(error)
                        .with_context(|| format!("cannot replace {name} in {}", self.0.display()));
                }
                _ => {}
            }
        }
        Ok((journal, Vec::new()))
    }

    /// Writes all reports.
    pub fn write(&self, report: &Report, flying: &Flying<'_>) -> anyhow::Result<()> {
        files::write(&self.0.join(JSON), &(serde_json::to_string_pretty(report)? + "\n"))?;
        files::write(&self.0.join(JUNIT), &junit::junit(report))?;
        let summary = markdown::markdown(report);
        files::write(&self.0.join(MARKDOWN), &summary)?;
        if let Some(file) = std::env::var_os("GITHUB_STEP_SUMMARY").filter(|file| !file.is_empty()) {
            let file = PathBuf::from(file);
            OpenOptions::new()
                .create(true)
                .append(true)
                .open(&file)
                .and_then(|mut file| file.write_all(summary.as_bytes()))
                .with_context(|| format!("cannot write the summary to {}", file.display()))?;
        }
        write_page(&self.0.join(PAGE), report, flying)
    }
}

/// Writes the page: the suite's own sections, then flights as `bench report` shows them.
fn write_page(path: &Path, report: &Report, flying: &Flying<'_>) -> anyhow::Result<()> {
    let in_full = report.tests.len() <= IN_FULL;
    let mut parts = Vec::new();
    let mut left = 0;
    for test in report.tests.iter().filter(|test| in_full || test.outcome != Outcome::Passed) {
        for run in &test.runs {
            let Some(attached) = &run.recording else { continue };
            if parts.len() == FLIGHTS_MAX {
                left += 1;
                continue;
            }
            let title = match test.runs.len() {
                1 => test.id.clone(),
                _ => format!("{}, flight {}", test.id, run.repeat + 1),
            };
            let part = match Loaded::read(&flying.recording(attached)).map(Flown::new) {
                Ok(flown) => Section::new(title, html! {}).verdict(flown.verdict()).parts(flown.sections()),
                Err(error) => Section::new(title, html! { p { (words::causes(&error)) } }),
            };
            parts.push(part);
        }
    }
    let mut sections = page::sections(report);
    if !parts.is_empty() {
        let told = if in_full {
            "Every flight as bench report shows it. The verdicts are those of the mission's criteria alone."
        } else {
            "Flights of tests that did not pass, as bench report shows them. The verdicts are those of the mission's criteria alone."
        };
        let left = match left {
            0 => String::new(),
            left => format!(" {} more are not shown here; bench report shows them.", words::grouped(left)),
        };
        sections.push(Section::new("Flights", html! {}).told(told.to_owned() + &left).parts(parts));
    }
    let page = Page::new(format!("Suite: {}", report.suite), page::verdict(report))
        .sections(sections)
        .made_by(words::command())
        .foot(Report::SCHEMA)
        .html();
    files::write(path, &page)
}
