use std::fmt::Write as _;

use anyhow::bail;
use clap::Args;

use crate::{
    exit::Exit,
    schema::{Kind, OUTPUTS},
    words,
};

/// Print the JSON Schema of a file that the bench reads, or of what a command prints with --json
#[derive(Args)]
#[command(after_help = "Examples:
  bench schema                         all names, a line each
  bench schema rig > rig.schema.json   for an editor: first line of a rig `#:schema rig.schema.json`
  bench schema diagnosis               what `bench diagnose --json` prints
  bench schema rig --markdown          every key in words, as in docs/rig.md")]
pub struct Arguments {
    /// A file's kind (rig, airframe, mission, map, calibration, tolerances, suite, sweep) or an output's name
    name: Option<String>,
    /// Print the page of documentation instead; files only
    #[arg(long, requires = "name")]
    markdown: bool,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    let Some(name) = &arguments.name else {
        words::print(&overview())?;
        return Ok(Exit::Done);
    };
    if let Some(kind) = Kind::ALL.into_iter().find(|kind| kind.name() == name) {
        if arguments.markdown {
            words::print(&kind.page())?;
        } else {
            words::print_json(&kind.schema())?;
        }
        return Ok(Exit::Done);
    }
    // `bench.diagnosis/2`, as it stands in the output itself, is taken as well.
    let bare = name.strip_prefix("bench.").unwrap_or(name);
    let bare = bare.split_once('/').map_or(bare, |(bare, _)| bare);
    match OUTPUTS.iter().find(|output| output.name == bare) {
        Some(_) if arguments.markdown => bail!("{name} is an output; only files have a page: {}", files()),
        Some(output) => words::print(output.schema)?,
        None => bail!("no schema is called {name:?}; `bench schema` lists them"),
    }
    Ok(Exit::Done)
}

fn files() -> String {
    Kind::ALL.map(Kind::name).join(", ")
}

fn overview() -> String {
    let files = Kind::ALL.map(|kind| (kind.name(), kind.title().to_owned()));
    let outputs = OUTPUTS.iter().map(|output| (output.name, output.title()));
    let mut out = "files\n".to_owned();
    // Writing to a String cannot fail.
    for (name, title) in files {
        let _ = writeln!(out, "  {name:<30} {title}");
    }
    out += "outputs of --json\n";
    for (name, title) in outputs {
        let _ = writeln!(out, "  {name:<30} {title}");
    }
    out
}
