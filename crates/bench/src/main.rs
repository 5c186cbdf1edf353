//! The command line: glue between the crates, and the words on the screen.
//!
//! Data goes to standard output, talk to standard error. Exit codes: see [`exit::Exit`].

mod balance;
mod blind_answer;
mod calibration;
mod commands;
mod diagnosis;
mod exit;
mod eyes;
mod files;
mod flight;
mod model_page;
mod repeats;
mod seen;
mod words;

use clap::{Parser, Subcommand};

use crate::exit::Exit;

/// A hardware-in-the-loop test bench for very small aircraft.
#[derive(Parser)]
#[command(
    version,
    after_help = "Examples:
  bench sim                                    fly to 0.4 m and record it
  bench sim --mission hop --effect rotor-lag:time_constant_s=0.08 -o lag.mcap
  bench diff recordings/climb-040-0.mcap lag.mcap
  bench hil --port /dev/ttyACM0                the same flight through a real PSoC5, in real time

Exit codes: 0 done (and passed), 1 a check failed, 2 wrong usage or bad input, 3 done with data
loss, 4 device fault or safety stop."
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Sim(commands::sim::Arguments),
    Hil(commands::hil::Arguments),
    Devices(commands::devices::Arguments),
    Emulate(commands::emulate::Arguments),
    Effects(commands::effects::Arguments),
    Info(commands::info::Arguments),
    Export(commands::export::Arguments),
    Recover(commands::recover::Arguments),
    Import(commands::import::Arguments),
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
}

fn main() -> std::process::ExitCode {
    let outcome = match Cli::parse().command {
        Command::Sim(arguments) => commands::sim::run(arguments),
        Command::Hil(arguments) => commands::hil::run(&arguments),
        Command::Devices(arguments) => commands::devices::run(&arguments),
        Command::Emulate(arguments) => commands::emulate::run(arguments),
        Command::Effects(arguments) => commands::effects::run(&arguments),
        Command::Info(arguments) => commands::info::run(&arguments),
        Command::Export(arguments) => commands::export::run(&arguments),
        Command::Recover(arguments) => commands::recover::run(&arguments),
        Command::Import(arguments) => commands::import::run(&arguments),
        Command::Diff(arguments) => commands::diff::run(&arguments),
        Command::Blind(arguments) => commands::blind::run(arguments),
        Command::Identify(arguments) => commands::identify::run(&arguments),
        Command::Verify(arguments) => commands::verify::run(&arguments),
        Command::Paper(arguments) => commands::paper::run(&arguments),
        Command::Tune(arguments) => commands::tune::run(&arguments),
        Command::Laws(arguments) => commands::laws::run(&arguments),
        Command::Diagnose(arguments) => commands::diagnose::run(&arguments),
        Command::RecordFrames(arguments) => commands::record_frames::run(&arguments),
        Command::Track(arguments) => commands::track::run(&arguments),
        Command::Calibrate(arguments) => commands::calibrate::run(&arguments),
    };
    match outcome {
        Ok(exit) => exit.into(),
        Err(error) if words::is_closed_pipe(&error) => Exit::Done.into(),
        Err(error) => {
            eprintln!("error: {}", words::causes(&error));
            Exit::BadInput.into()
        }
    }
}
