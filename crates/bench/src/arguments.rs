//! Arguments that several commands share, so that they read the same everywhere.

use std::path::{Path, PathBuf};

use bench_recording::Session;
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

/// What is known of a flight and cannot be measured, kept in its recording.
#[derive(Args)]
#[group(skip)]
pub struct Meta {
    /// Keep with the recording what else is known, such as airframe-serial=Q4-07, operator=Ada or battery=3; may be repeated
    #[arg(long = "meta", value_name = "KEY=VALUE", value_parser = meta)]
    pub meta: Vec<(String, String)>,
}

/// Stands before the keys of `--meta` in a recording's session.
const META: &str = "meta.";

impl Meta {
    /// Notes it in the session of a recording.
    pub fn note(meta: impl IntoIterator<Item = (String, String)>, session: &mut Session) {
        session.extra.extend(meta.into_iter().map(|(key, value)| (format!("{META}{key}"), value)));
    }
}

fn meta(text: &str) -> Result<(String, String), String> {
    const EXPECTED: &str = "a key of letters, digits, - and _, and a value behind =, such as operator=Ada";
    let (key, value) = text.split_once('=').ok_or(EXPECTED)?;
    let is_plain = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    if key.is_empty() || !key.chars().all(is_plain) || value.trim().is_empty() {
        return Err(EXPECTED.to_owned());
    }
    Ok((key.to_owned(), value.trim().to_owned()))
}
