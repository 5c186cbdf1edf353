#[cfg(feature = "exchange")]
pub mod from_log;
#[cfg(not(feature = "exchange"))]
crate::left_out::stand_in! {
    from_log: "rigs from-log" "exchange";
}

use std::{
    fmt::Write as _,
    path::{Path, PathBuf},
};

use anyhow::{Context, bail};
use bench_rig::{Rig, visit};
use clap::{Args, Subcommand};
use serde_json::json;

use crate::{
    arguments::{Force, Json},
    exit::Exit,
    files::{self, Form, Outputs},
    library::{self, Kind},
    progress, words,
};

/// List the rigs, missions, maps, suites and sweeps that are built in, copy one to start from, or draft a rig from logs
#[derive(Args)]
#[command(
    args_conflicts_with_subcommands = true,
    after_help = "Examples:
  bench rigs
  bench rigs copy virtual            virtual.toml here, and airframes/hubsan-q4.toml beside it
  bench rigs copy missions/hop -o my-hop.toml
  bench rig from-log log.ulg -o my-draft.toml

A name stands for the built-in file wherever a command takes a rig, mission, map, suite or sweep. A file of that
path wins over the name. Names of a kind other than rigs have the kind's folder before them here."
)]
pub struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    json: Json,
}

#[derive(Subcommand)]
enum Command {
    Copy(CopyArguments),
    FromLog(from_log::Arguments),
}

/// Write a built-in file to start one of your own from, with the files that it names
#[derive(Args)]
#[command(after_help = "Examples:
  bench rigs copy crazyflie-2 -o my-quad.toml
  bench rigs copy import/crazypad")]
struct CopyArguments {
    /// Name of a rig, or folder and name of another file, as `bench rigs` lists them
    name: String,
    /// File to write [default: its own name, in this folder]
    #[arg(short, long)]
    output: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    match &arguments.command {
        Some(Command::Copy(arguments)) => copy(arguments),
        Some(Command::FromLog(arguments)) => from_log::run(arguments),
        None => list(arguments.json.json),
    }
}

/// A rig drafted from logs, without words; `None` of what else is done with rigs.
#[cfg(feature = "exchange")]
pub fn drafted(arguments: &Arguments) -> Option<anyhow::Result<serde_json::Value>> {
    match &arguments.command {
        Some(Command::FromLog(arguments)) => {
            Some(from_log::written(arguments).map(|draft| from_log::as_json(&draft, arguments)))
        }
        Some(Command::Copy(_)) | None => None,
    }
}

/// A file of the library, by kind, with its name as it is listed and what it says of itself.
fn entries() -> anyhow::Result<Vec<(Kind, String, PathBuf, String)>> {
    let mut entries = Vec::new();
    for kind in Kind::ALL {
        for name in kind.names() {
            let path = kind.find(&name).with_context(|| format!("{name} is not built in"))?;
            let text = files::read(&path)?;
            let about = match kind {
                Kind::Rig => {
                    let rig = Rig::read_with(&path, &text, &library::read)?;
                    format!("airframe {}, loop {} s", rig.airframe.name, rig.control_loop.period_s)
                }
                Kind::Mission | Kind::Suite | Kind::Sweep => text_at(&path, &text, "description")?,
                _ => text
                    .lines()
                    .find_map(|line| line.strip_prefix('#'))
                    .map(|line| line.trim().to_owned())
                    .unwrap_or_default(),
            };
            let listed = if kind.folder().is_empty() { name } else { format!("{}/{name}", kind.folder()) };
            entries.push((kind, listed, path, about));
        }
    }
    Ok(entries)
}

fn list(as_json: bool) -> anyhow::Result<Exit> {
    let entries = entries()?;
    if as_json {
        let files: Vec<_> = entries
            .iter()
            .map(|(kind, name, _, about)| json!({ "kind": kind.name(), "name": name, "about": about }))
            .collect();
        words::print_json(&json!({ "schema": "bench.rigs/1", "files": files }))?;
        return Ok(Exit::Done);
    }
    let mut out = String::new();
    let mut before = None;
    for (kind, name, _, about) in entries {
        if before.replace(kind) != Some(kind) {
            let gap = if out.is_empty() { "" } else { "\n" };
            // Writing to a String cannot fail, here and below.
            let _ = writeln!(out, "{gap}{}s", kind.name());
        }
        let _ = writeln!(out, "  {name:<28} {about}");
    }
    out += "\n`bench rigs copy NAME` writes one to start from.\n";
    words::print(&out)?;
    Ok(Exit::Done)
}

fn copy(arguments: &CopyArguments) -> anyhow::Result<Exit> {
    let name = &arguments.name;
    let entries = entries()?;
    let Some((_, _, path, _)) = entries.iter().find(|(_, listed, ..)| listed == name) else {
        let last = name.rsplit('/').next().unwrap_or(name);
        let known = |listed: &str| listed.rsplit('/').next() == Some(last);
        let close: Vec<&str> =
            entries.iter().map(|(_, listed, ..)| listed.as_str()).filter(|listed| known(listed)).collect();
        if close.is_empty() {
            bail!("nothing built in is called {name}; `bench rigs` lists what there is");
        }
        bail!("nothing built in is called {name}; did you mean {}?", close.join(" or "));
    };
    let text = files::read(path)?;
    let own_name = path.file_name().map(PathBuf::from).unwrap_or_default();
    let output = arguments.output.clone().unwrap_or(own_name);
    let mut written = vec![(output.clone(), text.clone())];
    // Files that it names go where it looks for them.
    for named in named_files(path, &text) {
        let from = path.parent().unwrap_or(path).join(&named);
        // A map names the rig above its own folder: that is asked for by its name, and not copied out of this one.
        if named.starts_with("..") {
            continue;
        }
        let to = output.parent().unwrap_or(Path::new("")).join(&named);
        written.push((to, files::read(&from)?));
    }
    // A file that is there already and says the same is no loss.
    written.retain(|(to, text)| !std::fs::read_to_string(to).is_ok_and(|there| there == *text));
    if written.is_empty() {
        progress::note(&format!("{} is there already and says the same", output.display()));
    }
    let mut outputs = Outputs::new(arguments.force.force);
    for (to, _) in &written {
        outputs = outputs.and(to.as_path(), Form::Any);
    }
    outputs.check()?;
    for (to, text) in &written {
        files::write_and_say(to, text)?;
    }
    Ok(Exit::Done)
}

/// What stands at a key at the top of a file; nothing where it has none.
fn text_at(path: &Path, text: &str, key: &str) -> anyhow::Result<String> {
    let visit::Value::Table(entries) = visit::parse(path, text)?.value else { return Ok(String::new()) };
    let found = entries.into_iter().find_map(|(name, node)| match node.value {
        visit::Value::Text(found) if name == key => Some(found),
        _ => None,
    });
    Ok(found.unwrap_or_default())
}

/// Files that a rig or map names, as it names them.
fn named_files(path: &Path, text: &str) -> Vec<PathBuf> {
    let root = visit::parse(path, text);
    // A table of readings is no TOML and names nothing.
    let Ok(visit::Node { value: visit::Value::Table(entries), .. }) = root else { return Vec::new() };
    let names = entries.into_iter().filter_map(|(key, node)| match (key.as_str(), node.value) {
        ("airframe" | "calibration" | "rig", visit::Value::Text(name)) => Some(PathBuf::from(name)),
        _ => None,
    });
    names.collect()
}
