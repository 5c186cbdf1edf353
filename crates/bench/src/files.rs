//! Where rigs and missions are found, and when an output may be replaced.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use bench_recording::{Info, Mode};
use bench_rig::{Mission, Rig};

/// The rig when none is named.
pub const DEFAULT_RIG: &str = "rigs/virtual.toml";

/// The rig of the loopback bench when none is named.
pub const LOOPBACK_RIG: &str = "rigs/loopback.toml";

/// Reads a rig file.
pub fn rig(path: &Path) -> anyhow::Result<Rig> {
    if !path.exists() && [DEFAULT_RIG, LOOPBACK_RIG].iter().any(|default| path == Path::new(default)) {
        bail!(
            "there is no {} here; run from the project's folder, or name a rig file with --rig",
            path.display()
        );
    }
    Ok(Rig::load(path)?)
}

/// Reads a mission: a file, or the name of one in the folder `missions` beside the rig.
pub fn mission(name: &str, rig_file: &Path) -> anyhow::Result<Mission> {
    let as_file = Path::new(name);
    if as_file.extension().is_some() || as_file.exists() {
        return Ok(Mission::load(as_file)?);
    }
    let folder = rig_file.parent().unwrap_or(Path::new("")).join("missions");
    let path = folder.join(name).with_extension("toml");
    if !path.exists() {
        bail!("no mission is called {name:?}; {} has {}", folder.display(), missions_in(&folder));
    }
    Ok(Mission::load(path)?)
}

fn missions_in(folder: &Path) -> String {
    let mut names: Vec<_> = std::fs::read_dir(folder)
        .into_iter()
        .flatten()
        .filter_map(|entry| {
            Some(entry.ok()?.path()).filter(|path| path.is_file())?.file_stem()?.to_str().map(str::to_owned)
        })
        .collect();
    names.sort();
    if names.is_empty() { "none".to_owned() } else { names.join(", ") }
}

/// Makes room for an output: its folder is made, and what stands there is only replaced if a simulation can make it
/// again, or `force` says so.
pub fn make_room(output: &Path, force: bool) -> anyhow::Result<()> {
    // A device or a pipe is written to, not replaced.
    let stands_there = std::fs::metadata(output).is_ok_and(|found| found.is_file());
    let replaceable = || Info::read(output).is_ok_and(|info| info.mode == Mode::Sim.name());
    if stands_there && !force && !replaceable() {
        bail!(
            "{} exists and is not a whole simulated recording; name another output or add --force",
            output.display()
        );
    }
    if let Some(folder) = output.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        std::fs::create_dir_all(folder)
            .with_context(|| format!("cannot make the folder {}", folder.display()))?;
    }
    Ok(())
}

/// Says whether a new file may be written here, before the work.
pub fn may_write(output: &Path, force: bool) -> anyhow::Result<()> {
    if output.exists() && !force {
        bail!("{} exists; name another output or add --force", output.display());
    }
    Ok(())
}

/// Writes a rig under the name of its file, below lines that say how it was made. What is written must read back.
pub fn write_rig(output: &Path, head: &str, rig: &Rig) -> anyhow::Result<()> {
    let mut rig = rig.clone();
    if let Some(name) = output.file_stem() {
        rig.name = name.to_string_lossy().into_owned();
    }
    let text = format!("# {}: {head}\n{}", rig.name, rig.to_toml());
    Rig::read(output, &text).context("what was identified makes no rig; nothing written")?;
    write(output, &text)
}

/// Writes a text; its folder is made.
pub fn write(output: &Path, text: &str) -> anyhow::Result<()> {
    if let Some(folder) = output.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        std::fs::create_dir_all(folder)
            .with_context(|| format!("cannot make the folder {}", folder.display()))?;
    }
    std::fs::write(output, text).with_context(|| format!("cannot write {}", output.display()))
}

/// Where a simulation is recorded when no output is named.
pub fn default_recording(mission: &str, seed: u64) -> PathBuf {
    Path::new("recordings").join(format!("{mission}-{seed}.mcap"))
}
