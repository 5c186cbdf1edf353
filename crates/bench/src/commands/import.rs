use std::path::PathBuf;

use bench_recording::import::{ImportMap, import};
use clap::Args;

use crate::{exit::Exit, files, words};

/// Turn a CSV flight log into a recording, by a mapping file
#[derive(Args)]
#[command(after_help = "Examples:
  bench import --map rigs/import/crazypad.toml flight-1.csv -o flight-1.mcap
  bench import --map my-quad.toml --rig my-rig.toml log.csv -o log.mcap --json

docs/import.md says how to write a map. Rows with something wrong in them are counted and told,
never used.")]
pub struct Arguments {
    /// Flight log
    log: PathBuf,
    /// Mapping file: which column is what, in which unit
    #[arg(long)]
    map: PathBuf,
    /// Rig to attach, instead of the map's own
    #[arg(long)]
    rig: Option<PathBuf>,
    /// Recording to write
    #[arg(short, long)]
    output: PathBuf,
    /// Replace an existing output
    #[arg(long)]
    force: bool,
    /// Print the report as JSON (schema bench.import/1)
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    let map = ImportMap::load(&arguments.map)?;
    let rig = arguments.rig.as_deref().map(files::rig).transpose()?;
    files::make_room(&arguments.output, arguments.force)?;
    let report = import(&map, &arguments.log, &arguments.output, rig.as_ref())?;
    if arguments.json {
        words::print_json(&report)?;
    } else {
        words::print(&report.to_string())?;
    }
    Ok(Exit::Done)
}
