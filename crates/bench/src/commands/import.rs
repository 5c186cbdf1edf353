use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use bench_recording::{
    FileKind,
    import::{ImportMap, ImportReport, choose, guess, import},
};
use bench_rig::Actuation;
use clap::Args;

use crate::{
    arguments::{Force, Json},
    exit::Exit,
    files::{self, Form, Outputs},
    library, logs, progress, words,
};

/// Turn a flight log into a recording: logs of PX4, ArduPilot, Betaflight, the Crazyflie and ROS 2 as they are, tables by a mapping file
#[derive(Args)]
#[command(after_help = "Examples:
  bench import log.ulg -o px4.mcap
  bench import log.bin --explain -o ardupilot.mcap
  bench import --map crazypad log.csv -o log.mcap
  bench import --map my-map.toml --rig my-quad.toml log.csv -o mine.mcap --json
  bench import flight.csv --rig virtual -o again.mcap
  bench import --guess flight.csv -o guessed.toml

For logs of PX4 (ULog), ArduPilot (dataflash), Betaflight and INAV (blackbox), the Crazyflie and
ROS 2 (MCAP) a built-in map is chosen by what is in them; --map names another. A table that `bench export` wrote needs no map, but its rig. docs/import.md says how to
write a map. Rows with something wrong in them are counted and told, never used.")]
pub struct Arguments {
    /// Flight log
    log: PathBuf,
    /// Map: which column is what, in which unit; a file, or the name of a built-in one (`bench rigs` lists them). Not needed for
    /// a log of an autopilot or ROS 2, or a table that `bench export` wrote
    #[arg(long, value_name = "MAP")]
    map: Option<PathBuf>,
    /// Rig to attach, instead of the map's own: a file, or the name of a built-in one
    #[arg(long, value_name = "RIG")]
    rig: Option<PathBuf>,
    /// Recording to write; with --guess the map to write, which is printed without
    #[arg(short, long, required_unless_present = "guess")]
    output: Option<PathBuf>,
    /// Import nothing, but propose a map for a CSV file by names, units and ranges; each line of it says that it is a guess
    #[arg(long, conflicts_with_all = ["map", "rig", "explain", "json"])]
    guess: bool,
    /// Say what of the log was used, what the map looked for in vain, and what was left
    #[arg(long)]
    explain: bool,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    json: Json,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    if arguments.guess {
        return propose(arguments);
    }
    let (map, report) = imported(arguments)?;
    if arguments.json.json {
        words::print_json(&report)?;
    } else {
        if arguments.map.is_none() && report.topics.is_some() {
            words::print(&format!("map {map}: the first of the built-in ones that finds what it needs\n"))?;
        }
        words::print(&report.to_string())?;
        if arguments.explain {
            words::print(&report.explained())?;
        }
    }
    Ok(Exit::Done)
}

/// Imports the log; gives the name of the map, and what became of the log.
pub fn imported(arguments: &Arguments) -> anyhow::Result<(String, ImportReport)> {
    let output = arguments.output.as_deref().context("name the recording to write with -o")?;
    Outputs::new(arguments.force.force)
        .and(output, Form::Recording)
        .from(std::iter::once(arguments.log.as_path()).chain(arguments.map.as_deref()))
        .check()?;
    let map = match &arguments.map {
        Some(map) => logs::import_map(map)?,
        None => map_of(&arguments.log, arguments.rig.is_some())?,
    };
    let rig = arguments.rig.as_deref().or(map.rig.as_deref()).map(files::rig).transpose()?;
    files::make_folder(output)?;
    let report = import(&map, &arguments.log, output, rig.as_ref())?;
    Ok((map.name, report))
}

/// Proposes a map, and says what could not be guessed.
fn propose(arguments: &Arguments) -> anyhow::Result<Exit> {
    Outputs::new(arguments.force.force)
        .and(arguments.output.as_deref(), Form::Toml)
        .from([arguments.log.as_path()])
        .check()?;
    let guessed = guess(&arguments.log)?;
    match &arguments.output {
        Some(output) => files::write_and_say(output, &guessed.text)?,
        None => words::print(&guessed.text)?,
    }
    for unknown in &guessed.unknown {
        progress::note(&format!("not guessed: {unknown}"));
    }
    Ok(Exit::Done)
}

/// The map of a table that `bench export` wrote, or of an autopilot's log. Of other logs nobody knows it.
pub fn map_of(log: &Path, has_rig: bool) -> anyhow::Result<ImportMap> {
    let shown = log.display();
    let kind = FileKind::of(log).with_context(|| format!("cannot read {shown}"))?;
    if let Some(map) = map_of_topics(log, &kind)? {
        return Ok(map);
    }
    let map = match kind {
        FileKind::OwnTable(Some(Actuation::Volt)) => "bench",
        FileKind::OwnTable(Some(Actuation::Fraction)) => "bench-fraction",
        FileKind::OwnTable(Some(Actuation::Count)) => "bench-count",
        FileKind::OwnTable(None) => bail!(
            "{shown} was exported from a recording without a rig, so its heading does not tell the unit of the sticks; name the map with --map"
        ),
        kind => match kind.instead_of_log() {
            Some(advice) => bail!("{shown} is {}, which `bench import` does not read: {advice}", kind.name()),
            None => bail!(
                "{shown}: say with --map which column is what; `bench import --guess {shown}` proposes a map, docs/import.md tells how one is written, `bench rigs` lists those built in"
            ),
        },
    };
    if !has_rig {
        bail!(
            "{shown} was written by `bench export`; name the rig that it was flown on with --rig, it is not in the table"
        );
    }
    logs::import_map(Path::new(map))
}

/// The built-in map that suits what is in a log of topics.
fn map_of_topics(log: &Path, kind: &FileKind) -> anyhow::Result<Option<ImportMap>> {
    let Some(format) = kind.log_format() else { return Ok(None) };
    if *kind == FileKind::Mcap && logs::is_own(log) {
        return Ok(None);
    }
    let maps = library::LOG_MAPS.map(|name| logs::import_map(Path::new(name)));
    let mut maps = maps.into_iter().collect::<anyhow::Result<Vec<_>>>()?;
    let chosen = choose(&maps, format, log)?;
    Ok(Some(maps.swap_remove(chosen)))
}
