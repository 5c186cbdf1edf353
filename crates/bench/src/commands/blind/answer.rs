use std::{
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError},
    time::Instant,
};

use anyhow::Context;
use bench_blind::{Answer, BlindError, Seal, Unfinished, Verdict};
use bench_campaign::caught;
use clap::Args;
use rayon::prelude::*;

use crate::{
    arguments::{Force, Json},
    blind_answer,
    exit::Exit,
    files::{Form, Outputs},
    progress::{self, Progress},
    words,
};

/// Diagnose every sealed case without the key, and write the answers with their hash
#[derive(Args)]
#[command(after_help = "Examples:
  bench blind answer sealed/ -o answers.json
  bench blind answer sealed/ -o answers.json --force --json | jq -r .sha256

Interrupted, the same command goes on where it stopped: what is done lies beside the answers as
ANSWERS.unfinished. A case that cannot be diagnosed is answered `failed` with the reason, and
counts as wrong. Publish the hash before the key is opened.")]
pub struct AnswerArguments {
    /// Sealed folder
    folder: PathBuf,
    /// File for the answers (bench.answers/1)
    #[arg(short, long, visible_alias = "out")]
    output: PathBuf,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    json: Json,
}

/// What was done, for machines.
#[derive(serde::Serialize)]
struct Answered<'a> {
    schema: &'static str,
    answers: &'a Path,
    sha256: &'a str,
    tool: &'a str,
    seal: &'a str,
    cases: usize,
    /// Cases that an interrupted run had answered.
    resumed: usize,
    failed: Vec<&'a str>,
    /// Of this run.
    seconds: f64,
}

pub fn answer(arguments: &AnswerArguments) -> anyhow::Result<Exit> {
    let output = &arguments.output;
    Outputs::new(arguments.force.force).and(output.as_path(), Form::Any).check()?;
    let seal = Seal::load(&arguments.folder)?;
    seal.check_files(&arguments.folder)?;
    let tool = concat!("bench diagnose ", env!("CARGO_PKG_VERSION"));
    let unfinished = Unfinished::begin_or_resume(output, tool, &program_sha256()?, &seal.key_sha256)?;
    let resumed = unfinished.count();
    let cases = seal.cases();
    let to_do: Vec<&str> = cases.iter().copied().filter(|case| !unfinished.has(case)).collect();
    if resumed > 0 {
        progress::note(&format!(
            "going on: {resumed} of {} answered before",
            words::count(cases.len() as u64, "case")
        ));
    }
    let progress = Progress::of("blind answer");
    progress.begin("diagnosing", cases.len() as f64, "cases");
    progress.resume_at(resumed as f64);
    let began = Instant::now();
    let unfinished = Mutex::new(unfinished);
    to_do.into_par_iter().try_for_each(|case| -> Result<(), BlindError> {
        let rig = arguments.folder.join(case).join("rig.toml");
        let flights: Vec<PathBuf> =
            seal.flights(case).iter().map(|file| arguments.folder.join(file)).collect();
        let answer = or_failed(|| blind_answer::diagnosed(&rig, &flights));
        unfinished.lock().unwrap_or_else(PoisonError::into_inner).keep(case, answer)?;
        progress.step();
        Ok(())
    })?;
    drop(progress);
    let unfinished = unfinished.into_inner().unwrap_or_else(PoisonError::into_inner);
    let (answers, sha256) = unfinished.finish(output)?;
    let failed = answers.cases.iter().filter(|(_, answer)| answer.verdict == Verdict::Failed);
    let failed: Vec<(&str, &str)> =
        failed.map(|(case, answer)| (case.as_str(), answer.note.as_deref().unwrap_or_default())).collect();
    let seconds = began.elapsed().as_secs_f64();
    if arguments.json.json {
        words::print_json(&Answered {
            schema: "bench.answered/1",
            answers: output,
            sha256: &sha256,
            tool,
            seal: &seal.key_sha256,
            cases: answers.cases.len(),
            resumed,
            failed: failed.iter().map(|(case, _)| *case).collect(),
            seconds,
        })?;
    } else {
        for (case, note) in &failed {
            words::warn(format_args!("{case} failed: {note}"));
        }
        words::print(&format!(
            "{} answered in {} ({seconds:.0} s{})\n  sha256  {sha256}: publish it before the key is opened",
            words::count(answers.cases.len() as u64, "case"),
            output.display(),
            if failed.is_empty() { String::new() } else { format!(", {} failed", failed.len()) },
        ))?;
    }
    Ok(Exit::Done)
}

/// An answer; whatever goes wrong on the way is told in it.
fn or_failed(answer: impl FnOnce() -> anyhow::Result<Answer>) -> Answer {
    let reason = match caught(answer) {
        Ok(Ok(answer)) => return answer,
        Ok(Err(error)) => words::causes(&error),
        Err(words) => format!("panicked: {words}"),
    };
    Answer { note: Some(reason), ..Answer::bare(Verdict::Failed) }
}

/// Hash of this very program.
fn program_sha256() -> anyhow::Result<String> {
    let program = std::env::current_exe().context("cannot find this program's own file")?;
    Ok(bench_blind::sha256_of_file(&program)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_and_a_panic_are_failed_answers_with_the_reason() {
        let error = or_failed(|| anyhow::bail!("no flight could be read"));
        assert_eq!(error.verdict, Verdict::Failed);
        assert_eq!(error.note.as_deref(), Some("no flight could be read"));
        let nothing: Vec<f64> = Vec::new();
        let panic =
            or_failed(|| Ok(Answer { note: Some(nothing[3].to_string()), ..Answer::bare(Verdict::None) }));
        assert_eq!(panic.verdict, Verdict::Failed);
        let note = panic.note.unwrap();
        assert!(note.starts_with("panicked: index out of bounds"), "{note}");
    }
}
