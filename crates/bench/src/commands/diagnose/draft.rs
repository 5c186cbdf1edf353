use std::path::{Path, PathBuf};

use anyhow::Context;
use bench_rig::Rig;

use crate::{
    commands::{rigs::from_log, tracks::Selection},
    logs::Flown,
};

/// A rig drafted from flights of which nothing else is known.
pub fn draft(flights: &[PathBuf], selection: &Selection) -> anyhow::Result<Rig> {
    let flown = flights.iter().map(|path| Flown::read(path, selection.map()));
    let flown = flown.collect::<anyhow::Result<Vec<Flown>>>()?;
    let draft =
        from_log::drafted(flown, Path::new("model"), None).context("no model of the nominal flights")?;
    Ok(draft.rig)
}
