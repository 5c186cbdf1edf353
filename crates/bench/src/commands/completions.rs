use anyhow::Context;
use clap::{Args, CommandFactory};
use clap_complete::{Generator, Shell};

use crate::{Cli, exit::Exit, words};

/// Print a shell's completions of this program
#[derive(Args)]
#[command(after_help = "Examples:
  bench completions bash > ~/.local/share/bash-completion/completions/bench
  bench completions zsh > ~/.zfunc/_bench          # a folder of $fpath
  bench completions fish > ~/.config/fish/completions/bench.fish

The Debian package brings them along.")]
pub struct Arguments {
    /// Which shell
    #[arg(value_enum)]
    shell: Shell,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    let mut command = Cli::command();
    command.set_bin_name("bench");
    command.build();
    let mut script = Vec::new();
    arguments.shell.generate(&command, &mut script);
    words::print(&String::from_utf8(script).context("the completions are no text")?)?;
    Ok(Exit::Done)
}
