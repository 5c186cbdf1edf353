use std::path::PathBuf;

use bench_recording::{ExportOptions, export};
use clap::Args;

use crate::{exit::Exit, files, words};

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
    /// Replace an existing table
    #[arg(long)]
    force: bool,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    files::make_room(&arguments.output, arguments.force)?;
    let options = ExportOptions { channel: arguments.channel.clone() };
    let exported = export(&arguments.recording, &arguments.output, &options)?;
    words::print(&format!("{} to {}", words::tables(&exported), arguments.output.display()))?;
    Ok(Exit::Done)
}
