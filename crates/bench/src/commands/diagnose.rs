use std::path::PathBuf;

use anyhow::{Context, bail};
use bench_diagnosis::{Calibration, Diagnosis, Problem, Track, Verdict};
use bench_recording::Flight;
use clap::Args;

use crate::{
    diagnosis::{
        page::{Made, page},
        terminal::in_words,
    },
    exit::Exit,
    files, words,
};

/// Say where the sim-to-real gap of flights lies and which unmodelled effect causes it
#[derive(Args)]
#[command(after_help = "Examples:
  bench diagnose --rig rigs/virtual.toml flight-*.mcap
  bench diagnose --rig rigs/foreign.toml flight-*.mcap --html diagnosis.html
  bench diagnose --rig rigs/foreign.toml flight-*.mcap --json

The rig is the nominal model with its tolerances. All flights must be of one airframe in one condition;
more and richer flights (launches, steps, descents, low hover) tell more. docs/diagnosis.md has the method,
and what it does not do yet.")]
pub struct Arguments {
    /// Recordings of flights
    #[arg(required = true)]
    flights: Vec<PathBuf>,
    /// Nominal model with tolerances
    #[arg(long, default_value = files::DEFAULT_RIG)]
    rig: PathBuf,
    /// Exit with 1 unless the verdict is `none`
    #[arg(long)]
    fail_on_gap: bool,
    /// Also write a page with plots
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
    /// Print as JSON (schema bench.diagnosis/1)
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    let mut rig = files::rig(&arguments.rig)?;
    // The rig's own effects belong to its simulations; the nominal model is what is asked about.
    let ignored = std::mem::take(&mut rig.effects).len();
    let (mut tracks, mut warnings) = (Vec::new(), Vec::new());
    for path in &arguments.flights {
        match Track::from_flight(&path.display().to_string(), &Flight::load(path)?, &rig) {
            Ok(track) => tracks.push(track),
            Err(error) => warnings.push(error.to_string()),
        }
    }
    if tracks.is_empty() {
        bail!("none of the flights can be diagnosed:\n{}", warnings.join("\n"));
    }
    if ignored > 0 {
        warnings.push(format!(
            "{} of the rig left out: the nominal model is diagnosed",
            words::count(ignored as u64, "effect")
        ));
    }
    let mut diagnosis = Diagnosis::of(&Problem::new(&tracks, &rig), &Calibration::built_in());
    diagnosis.warnings = warnings;
    if arguments.json {
        words::print_json(&diagnosis)?;
    } else {
        words::print(&in_words(&diagnosis, rig.airframe.actuation))?;
    }
    if let Some(file) = &arguments.html {
        let command = std::iter::once("bench".to_owned())
            .chain(std::env::args_os().skip(1).map(|word| word.to_string_lossy().into_owned()))
            .collect();
        std::fs::write(file, page(&diagnosis, &Made { rig: &rig, command }))
            .with_context(|| format!("cannot write {}", file.display()))?;
        eprintln!("wrote {}", file.display());
    }
    let gap = diagnosis.verdict != Verdict::None;
    Ok(if arguments.fail_on_gap && gap { Exit::CheckFailed } else { Exit::Done })
}
