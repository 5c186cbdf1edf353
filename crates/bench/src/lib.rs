//! The command line: glue between the crates, and the words on the screen.
//!
//! Data goes to standard output, talk to standard error. Exit codes: see `exit::Exit`. [`call`] does the work of a command for a
//! program that is no shell.

// `words::say` never fails, where a flight must go on.
#![cfg_attr(not(test), deny(clippy::print_stderr))]
// What is left out uses the rest of what the commands share.
#![cfg_attr(not(all(feature = "exchange", feature = "lab", feature = "studies")), allow(dead_code))]

mod arguments;
#[cfg(any(feature = "lab", feature = "studies"))]
mod balance;
#[cfg(feature = "studies")]
mod blind_answer;
mod calibration;
#[cfg(feature = "studies")]
mod call;
mod commands;
mod diagnosis;
mod exit;
#[cfg(feature = "lab")]
mod eyes;
mod files;
mod flight;
mod foxglove;
#[cfg(not(all(feature = "exchange", feature = "lab", feature = "studies")))]
mod left_out;
mod library;
mod live;
mod logs;
mod model_page;
mod nominal;
mod progress;
mod recorded;
mod recorded_views;
mod repeats;
mod report;
#[cfg(all(feature = "lab", feature = "studies"))]
mod schema;
mod seen;
#[cfg(feature = "lab")]
mod signals;
#[cfg(feature = "lab")]
mod station;
#[cfg(feature = "lab")]
mod suites;
#[cfg(feature = "studies")]
mod sweeps;
mod words;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};

#[cfg(feature = "studies")]
pub use crate::call::call;
use crate::exit::Exit;
pub use crate::words::causes as in_words;

/// A hardware-in-the-loop test bench for very small aircraft.
#[derive(Parser)]
#[command(
    version,
    after_help = "Examples:
  bench sim                                    fly to 0.4 m and record it
  bench sim --effect rotor-lag:time_constant_s=0.08 -o lag.mcap
  bench diff recordings/virtual_climb-040_seed0.mcap lag.mcap
  bench hil --port /dev/ttyACM0                the same flight through a real PSoC5, in real time

Exit codes: 0 done (and passed), 1 a check failed, 2 wrong usage or bad input, 3 done with data
loss, 4 device fault or safety stop."
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    /// Tell neither progress nor what was written; warnings and errors are told
    #[arg(long, global = true)]
    quiet: bool,
}

#[derive(Subcommand)]
enum Command {
    Sim(commands::sim::Arguments),
    Hil(commands::hil::Arguments),
    Devices(commands::devices::Arguments),
    Emulate(commands::emulate::Arguments),
    #[command(visible_alias = "rig")]
    Rigs(commands::rigs::Arguments),
    Effects(commands::effects::Arguments),
    Info(commands::info::Arguments),
    Export(commands::export::Arguments),
    Recover(commands::recover::Arguments),
    Import(commands::import::Arguments),
    Report(commands::report::Arguments),
    Test(commands::test::Arguments),
    Sweep(commands::sweep::Arguments),
    Runs(commands::runs::Arguments),
    Diff(commands::diff::Arguments),
    Blind(commands::blind::Arguments),
    Diagnose(commands::diagnose::Arguments),
    RecordFrames(commands::record_frames::Arguments),
    Track(commands::track::Arguments),
    Calibrate(commands::calibrate::Arguments),
    Identify(commands::identify::Arguments),
    Verify(commands::verify::Arguments),
    Paper(commands::paper::Arguments),
    Tune(commands::tune::Arguments),
    Laws(commands::laws::Arguments),
    Udev(commands::udev::Arguments),
    Completions(commands::completions::Arguments),
    Man(commands::man::Arguments),
    Schema(commands::schema::Arguments),
    Check(commands::check::Arguments),
}

/// The command line. A negative number is taken for a value, so that whoever checks it can say what it must be.
fn command() -> clap::Command {
    fn with_negative_numbers(command: clap::Command) -> clap::Command {
        command.allow_negative_numbers(true).mut_subcommands(with_negative_numbers)
    }
    with_negative_numbers(Cli::command()).styles(words::help_styles())
}

/// Does what the arguments of the process say.
pub fn main() -> std::process::ExitCode {
    let Cli { command, quiet } =
        Cli::from_arg_matches(&command().get_matches()).unwrap_or_else(|error| error.exit());
    if quiet {
        progress::be_quiet();
    }
    let outcome = match command {
        Command::Sim(arguments) => commands::sim::run(&arguments),
        Command::Hil(arguments) => commands::hil::run(&arguments),
        Command::Devices(arguments) => commands::devices::run(&arguments),
        Command::Emulate(arguments) => commands::emulate::run(arguments),
        Command::Rigs(arguments) => commands::rigs::run(&arguments),
        Command::Effects(arguments) => commands::effects::run(&arguments),
        Command::Info(arguments) => commands::info::run(&arguments),
        Command::Export(arguments) => commands::export::run(&arguments),
        Command::Recover(arguments) => commands::recover::run(&arguments),
        Command::Import(arguments) => commands::import::run(&arguments),
        Command::Report(arguments) => commands::report::run(&arguments),
        Command::Test(arguments) => commands::test::run(&arguments),
        Command::Sweep(arguments) => commands::sweep::run(&arguments),
        Command::Runs(arguments) => commands::runs::run(&arguments),
        Command::Diff(arguments) => commands::diff::run(&arguments),
        Command::Blind(arguments) => commands::blind::run(arguments),
        Command::Identify(arguments) => commands::identify::run(&arguments),
        Command::Verify(arguments) => commands::verify::run(&arguments),
        Command::Paper(arguments) => commands::paper::run(&arguments),
        Command::Tune(arguments) => commands::tune::run(&arguments),
        Command::Laws(arguments) => commands::laws::run(&arguments),
        Command::Udev(arguments) => commands::udev::run(&arguments),
        Command::Completions(arguments) => commands::completions::run(&arguments),
        Command::Man(arguments) => commands::man::run(&arguments),
        Command::Schema(arguments) => commands::schema::run(&arguments),
        Command::Check(arguments) => commands::check::run(&arguments),
        Command::Diagnose(arguments) => commands::diagnose::run(&arguments),
        Command::RecordFrames(arguments) => commands::record_frames::run(&arguments),
        Command::Track(arguments) => commands::track::run(&arguments),
        Command::Calibrate(arguments) => commands::calibrate::run(&arguments),
    };
    match outcome {
        Ok(exit) => exit.into(),
        Err(error) if words::is_closed_pipe(&error) => Exit::Done.into(),
        Err(error) => {
            words::fail(format_args!("{}", words::causes(&error)));
            Exit::BadInput.into()
        }
    }
}
