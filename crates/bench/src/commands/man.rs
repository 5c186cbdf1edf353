use std::{fs, path::PathBuf};

use anyhow::Context;
use clap::{Args, CommandFactory};

use crate::{Cli, exit::Exit, files, progress};

/// Write the manual pages, one a command
#[derive(Args)]
#[command(after_help = "Examples:
  bench man -o ~/.local/share/man/man1          # then: man bench-sim
  bench man -o man && man -l man/bench-sim.1

The Debian package brings them along.")]
pub struct Arguments {
    /// The folder to write `bench.1`, `bench-sim.1`, ... to
    #[arg(short, long, value_name = "FOLDER")]
    output: PathBuf,
    /// Replace pages that are there and differ
    #[arg(long)]
    force: bool,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    let mut command = Cli::command();
    command.build();
    let mut pages = Vec::new();
    collect(&command, &mut pages)?;
    for (name, page) in &pages {
        let path = arguments.output.join(name);
        let differs = fs::read_to_string(&path).is_ok_and(|there| there != *page);
        if differs && !arguments.force {
            anyhow::bail!("{} exists and differs; name another folder or add --force", path.display());
        }
    }
    for (name, page) in &pages {
        files::write(&arguments.output.join(name), page)?;
    }
    progress::note(&format!("wrote {} pages to {}", pages.len(), arguments.output.display()));
    Ok(Exit::Done)
}

/// The page of a command and those of its subcommands, each by the name of its file.
fn collect(command: &clap::Command, pages: &mut Vec<(String, String)>) -> anyhow::Result<()> {
    let page = clap_mangen::Man::new(command.clone());
    let name = page.get_filename();
    let mut text = Vec::new();
    page.render(&mut text).with_context(|| format!("cannot write {name}"))?;
    pages.push((name, String::from_utf8(text).context("a manual page is no text")?));
    let subcommands = command.get_subcommands();
    subcommands
        .filter(|sub| !sub.is_hide_set() && sub.get_name() != "help")
        .try_for_each(|sub| collect(sub, pages))
}
