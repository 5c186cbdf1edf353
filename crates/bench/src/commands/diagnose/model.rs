use std::path::{Path, PathBuf};

use anyhow::Context;
use bench_identification::identify_flights;

use crate::{
    commands::{rigs::from_log, tracks::Selection},
    logs::Flown,
    progress::Progress,
    recorded::Nominal,
    words,
};

/// The rig that flights tell of which nothing else is known.
pub fn model(selection: &Selection, flights: &[PathBuf]) -> anyhow::Result<Nominal> {
    let flown = flights.iter().map(|path| Flown::read(path, None)).collect::<anyhow::Result<Vec<Flown>>>()?;
    let draft =
        from_log::drafted(flown, Path::new("model"), None).context("no model of the flights of --model")?.rig;
    let (tracks, mut remarks) = selection.of(flights).tracks(&draft, |_, _| ())?;
    let progress = Progress::of("diagnose");
    let count = words::count(tracks.len() as u64, "flight");
    progress.begin_untold(&format!("identifying the model from {count}"));
    let found = identify_flights(&tracks, &draft);
    drop(progress);
    let found = found.with_context(|| match remarks.as_slice() {
        [] => "no model of the flights of --model".to_owned(),
        remarks => format!("no model of the flights of --model; not used:\n{}", remarks.join("\n")),
    })?;
    let left: Vec<&str> =
        found.numbers.iter().filter(|number| !number.identified).map(|number| number.name).collect();
    if !left.is_empty() {
        remarks.push(format!(
            "the flights of --model do not tell, and the model has as drafted: {}",
            left.join(", ")
        ));
    }
    Ok(Nominal { rig: found.rig, from: format!("the model of the {count} of --model"), remarks })
}
