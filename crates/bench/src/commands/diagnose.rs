use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use bench_diagnosis::{Calibration, Diagnosis, Problem, Track, Verdict};
use bench_plant::effects::resolve_all;
use bench_recording::Flight;
use bench_rig::Rig;
use clap::Args;

use crate::{
    calibration::{self, Missions},
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
  bench diagnose --rig rigs/virtual.toml flight-*.mcap --write-rig better.toml

Probabilities come from a calibration: one for this rig and these missions if --calibrate made it before,
else the built-in one.

A rig's own [[effect]] tables are part of the model: flights diagnosed with the rig that --write-rig wrote
should say `none`.

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
    /// First calibrate for this rig: simulate so many sets of nominal flights of these missions, and keep what they
    /// teach in the cache
    #[arg(long, value_name = "SETS", num_args = 0..=1, default_missing_value = "100")]
    calibrate: Option<usize>,
    /// Write the rig with the named effect added, as a new rig file
    #[arg(long, value_name = "FILE")]
    write_rig: Option<PathBuf>,
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
    let rig = files::rig(&arguments.rig)?;
    // The rig's own effects are part of the model that is asked about.
    resolve_all(&rig.effects)?;
    let (mut tracks, mut warnings, mut missions) = (Vec::new(), Vec::new(), Vec::new());
    for path in &arguments.flights {
        let flight = Flight::load(path)?;
        missions.push(flight.mission_toml().map(str::to_owned));
        match Track::from_flight(&path.display().to_string(), &flight, &rig) {
            Ok(track) => tracks.push(track),
            Err(error) => warnings.push(error.to_string()),
        }
    }
    if tracks.is_empty() {
        bail!("none of the flights can be diagnosed:\n{}", warnings.join("\n"));
    }
    let missions = Missions::of(missions)?;
    let calibration = match arguments.calibrate {
        Some(sets) => calibration::learn(&rig, &missions, sets)?,
        None => calibration::cached(&rig, &missions).unwrap_or_else(Calibration::built_in),
    };
    let mut diagnosis = Diagnosis::of(&Problem::new(&tracks, &rig), &calibration);
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
    if let Some(path) = &arguments.write_rig {
        write_rig(path, &rig, &diagnosis)?;
        eprintln!("wrote {}", path.display());
    }
    let gap = diagnosis.verdict != Verdict::None;
    Ok(if arguments.fail_on_gap && gap { Exit::CheckFailed } else { Exit::Done })
}

fn write_rig(path: &Path, rig: &Rig, diagnosis: &Diagnosis) -> anyhow::Result<()> {
    let Some(changed) = diagnosis.rig_with_effect(rig) else {
        let verdict = &diagnosis.candidates[0].name;
        bail!("the verdict is {verdict}: there is no effect to write into {}", path.display());
    };
    if path.exists() {
        bail!("{} exists; name another file for the rig", path.display());
    }
    std::fs::write(path, changed.to_toml()).with_context(|| format!("cannot write {}", path.display()))
}
