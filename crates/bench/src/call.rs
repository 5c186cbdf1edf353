//! Commands for programs that are no shell.

use std::{
    cell::RefCell,
    ffi::OsString,
    sync::{Arc, atomic::AtomicBool},
};

use clap::FromArgMatches as _;
use serde::Serialize;

use crate::{
    Cli, Command,
    commands::{diagnose, diff, identify, import, info, rigs, sim, sweep},
    progress, words,
};

thread_local! {
    /// Set by another thread that wants the call of this one to end.
    static STOP: RefCell<Arc<AtomicBool>> = RefCell::default();
}

/// Whether the call at hand is to end early.
pub fn stop() -> Arc<AtomicBool> {
    STOP.with_borrow(Arc::clone)
}

/// Does what the words of a command say, the program's name left out, and gives the JSON that `--json` prints. Nothing is printed but warnings.
/// An error is in the words of the command line. Commands without a result for programs, and those that fly devices, are refused.
///
/// A sweep ends between two runs once `stop` is set; all else is done by then or soon.
pub fn call(given: &[OsString], stop: Arc<AtomicBool>) -> Result<String, String> {
    progress::be_quiet();
    words::called_by(given);
    STOP.set(stop);
    let command = std::iter::once("bench".into()).chain(given.iter().cloned());
    let matches = crate::command().try_get_matches_from(command);
    let cli = matches.and_then(|matches| Cli::from_arg_matches(&matches)).map_err(|error| usage(&error))?;
    done(&cli.command).map_err(|error| words::causes(&error))
}

fn done(command: &Command) -> anyhow::Result<String> {
    let made = match command {
        Command::Sim(arguments) => Some(as_json(sim::report(arguments))),
        Command::Info(arguments) => Some(as_json(info::info(arguments))),
        Command::Import(arguments) => Some(as_json(import::imported(arguments).map(|(_, report)| report))),
        Command::Rigs(arguments) => rigs::drafted(arguments).map(as_json),
        Command::Identify(arguments) => identify::from_flights(arguments).map(as_json),
        Command::Diff(arguments) => Some(as_json(diff::report(arguments))),
        Command::Diagnose(arguments) => Some(as_json(diagnose::report(arguments))),
        Command::Sweep(arguments) => sweep::ran(arguments).map(as_json),
        _ => None,
    };
    made.unwrap_or_else(|| anyhow::bail!("this command is for the command line alone"))
}

fn as_json(made: anyhow::Result<impl Serialize>) -> anyhow::Result<String> {
    Ok(serde_json::to_string(&made?)?)
}

/// What is wrong with the words, without how a shell is helped.
fn usage(error: &clap::Error) -> String {
    let text = error.to_string();
    let first = text.split("\n\n").next().unwrap_or_default();
    first.strip_prefix("error: ").unwrap_or(first).to_owned()
}
