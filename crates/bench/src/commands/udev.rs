use std::{
    fs,
    io::ErrorKind,
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Context, bail};
use clap::Args;

use crate::{exit::Exit, progress, words};

/// What the Debian package installs as well.
const RULES: &str = include_str!("../../packaging/60-bench.rules");
const NAME: &str = "60-bench.rules";

/// Print or install the udev rules that let a user open Kinect and PSoC5
#[derive(Args)]
#[command(after_help = "Examples:
  bench udev                        look at them first
  sudo bench udev --install         then plug the device in again

Without `sudo` in the path of root, name the program: sudo $(command -v bench) udev --install")]
pub struct Arguments {
    /// Write them to /etc/udev/rules.d and have udev read them; needs root
    #[arg(long)]
    install: bool,
    /// Replace rules of that name that differ
    #[arg(long, requires = "install")]
    force: bool,
    /// Install into another folder, and leave udev alone
    #[arg(long, requires = "install", value_name = "FOLDER")]
    folder: Option<PathBuf>,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    if !arguments.install {
        words::print(RULES)?;
        return Ok(Exit::Done);
    }
    let folder = arguments.folder.as_deref().unwrap_or(Path::new("/etc/udev/rules.d"));
    let path = folder.join(NAME);
    match fs::read(&path) {
        Ok(there) if there == RULES.as_bytes() => {
            progress::note(&format!("{} is there already", path.display()));
            return Ok(Exit::Done);
        }
        Ok(_) if !arguments.force => {
            bail!(
                "{} is there and differs from `bench udev`; compare them, then add --force to replace it",
                path.display()
            )
        }
        Ok(_) => {}
        Err(error) if error.kind() == ErrorKind::NotFound => {}
        Err(error) => return Err(error).with_context(|| format!("cannot read {}", path.display())),
    }
    fs::write(&path, RULES).with_context(|| match fs::metadata(folder) {
        Ok(_) => format!("cannot write {}; `sudo bench udev --install` may", path.display()),
        Err(_) => format!("cannot write {}: is udev installed here?", path.display()),
    })?;
    progress::note(&format!("wrote {}", path.display()));
    if arguments.folder.is_none() {
        reload();
    }
    Ok(Exit::Done)
}

/// Has udev read its rules again. Where it does not run, they are read when it starts.
fn reload() {
    match Command::new("udevadm").args(["control", "--reload"]).output() {
        Ok(done) if done.status.success() => crate::words::say!("udev has read it; plug the device in again"),
        _ => crate::words::say!(
            "udev could not be told: run `udevadm control --reload` as root, then plug the device in again"
        ),
    }
}
