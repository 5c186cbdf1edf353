use std::path::PathBuf;

use bench_recording::import::import;
use clap::Args;

use crate::{
    arguments::{Force, Json},
    exit::Exit,
    files::{self, Form, Outputs},
    words,
};

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
    /// Map: which column is what, in which unit; a file, or the name of a built-in one (`bench rigs` lists them)
    #[arg(long, value_name = "MAP")]
    map: PathBuf,
    /// Rig to attach, instead of the map's own: a file, or the name of a built-in one
    #[arg(long, value_name = "RIG")]
    rig: Option<PathBuf>,
    /// Recording to write
    #[arg(short, long)]
    output: PathBuf,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    json: Json,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    Outputs::new(arguments.force.force)
        .and(arguments.output.as_path(), Form::Recording)
        .from([arguments.log.as_path(), arguments.map.as_path()])
        .check()?;
    let map = files::import_map(&arguments.map)?;
    let rig = arguments.rig.as_deref().or(map.rig.as_deref()).map(files::rig).transpose()?;
    files::make_folder(&arguments.output)?;
    let report = import(&map, &arguments.log, &arguments.output, rig.as_ref())?;
    if arguments.json.json {
        words::print_json(&report)?;
    } else {
        words::print(&report.to_string())?;
    }
    Ok(Exit::Done)
}
