use std::path::PathBuf;

use bench_recording::{ExportOptions, export};
use clap::Args;

use crate::{
    arguments::Force,
    exit::Exit,
    files::{self, Form, Outputs},
    words,
};

/// Write a recording as a table for spreadsheets and data tools
#[derive(Args)]
#[command(after_help = "Examples:
  bench export flight.mcap -o flight.xlsx
  bench export flight.mcap -o truth.parquet --channel /plant/truth

The ending of the output decides: .csv, .xlsx or .parquet. Without --channel, one row is one
iteration of the loop: command, readback, position, estimate, timing and, where simulated, the
true state.")]
pub struct Arguments {
    /// Recording
    recording: PathBuf,
    /// Table to write
    #[arg(short, long)]
    output: PathBuf,
    /// One channel as recorded, instead of one row an iteration
    #[arg(long)]
    channel: Option<String>,
    #[command(flatten)]
    force: Force,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    Outputs::new(arguments.force.force)
        .and(arguments.output.as_path(), Form::Table)
        .from([arguments.recording.as_path()])
        .check()?;
    let options = ExportOptions { channel: arguments.channel.clone() };
    files::make_folder(&arguments.output)?;
    let exported = export(&arguments.recording, &arguments.output, &options)?;
    words::print(&format!("{} to {}", words::tables(&exported), arguments.output.display()))?;
    Ok(Exit::Done)
}
