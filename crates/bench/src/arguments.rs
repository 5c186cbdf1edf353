//! Arguments that several commands share, so that they read the same everywhere.

use std::path::{Path, PathBuf};

use bench_rig::Rig;
use clap::Args;

use crate::files;

/// The rig of commands that fly or calculate.
#[derive(Args)]
#[group(skip)]
pub struct RigArgument {
    /// Rig: a file, or the name of a built-in one (`bench rigs` lists them)
    #[arg(long, value_name = "RIG", default_value = files::DEFAULT_RIG)]
    pub rig: PathBuf,
}

impl RigArgument {
    /// Reads it.
    pub fn load(&self) -> anyhow::Result<Rig> {
        files::rig(&self.rig)
    }

    /// As it was named.
    pub fn path(&self) -> &Path {
        &self.rig
    }
}

/// Whether outputs that exist are replaced.
#[derive(Args)]
#[group(skip)]
pub struct Force {
    /// Replace outputs that exist
    #[arg(long)]
    pub force: bool,
}

/// Whether a program reads the result.
#[derive(Args)]
#[group(skip)]
pub struct Json {
    /// Print the result as JSON; `bench schema` prints the schema of each command's
    #[arg(long)]
    pub json: bool,
}

/// A page of the result.
#[derive(Args)]
#[group(skip)]
pub struct Page {
    /// Also write the result as one self-contained page
    #[arg(long, value_name = "FILE")]
    pub html: Option<PathBuf>,
}
