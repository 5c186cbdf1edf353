use std::{
    fmt::Write as _,
    path::{Path, PathBuf},
};

use anyhow::{Context, bail};
use bench_diagnosis::{Calibration, Candidate, Diagnosis, Figure, Problem, Track, Verdict};
use bench_plant::effects::resolve_all;
use bench_recording::Flight;
use bench_rig::Rig;
use clap::Args;

use crate::{
    calibration::{self, Missions},
    exit::Exit,
    files, words,
};

/// Say where the sim-to-real gap of flights lies and which unmodelled effect causes it
#[derive(Args)]
#[command(after_help = "Examples:
  bench diagnose --rig rigs/virtual.toml flight-*.mcap
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
    if let Some(path) = &arguments.write_rig {
        write_rig(path, &rig, &diagnosis)?;
    }
    if arguments.json {
        words::print_json(&diagnosis)?;
    } else {
        words::print(&in_words(&diagnosis))?;
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

fn in_words(diagnosis: &Diagnosis) -> String {
    let mut out = String::new();
    let percent = 100.0 * diagnosis.confidence;
    let _ = match diagnosis.verdict {
        Verdict::Effect => writeln!(out, "{} ({percent:.0} %)", diagnosis.effects.join(" and ")),
        Verdict::None => writeln!(out, "none: no gap beyond tolerance and noise ({percent:.0} %)"),
        Verdict::Unknown => writeln!(out, "unknown: a gap that no known effect explains ({percent:.0} %)"),
    };
    let sightings: usize = diagnosis.flights.iter().map(|flight| flight.sightings).sum();
    let _ = writeln!(
        out,
        "from {} with {}; probabilities by the {} calibration",
        words::count(diagnosis.flights.len() as u64, "flight"),
        words::count(sightings as u64, "sighting"),
        diagnosis.calibration.source
    );
    out += "\nHypotheses\n";
    for candidate in diagnosis.candidates.iter().take(5) {
        let _ = writeln!(
            out,
            "  {:5.1} %  {}{}",
            100.0 * candidate.probability,
            candidate.name,
            parameters(candidate)
        );
    }
    out += "\nWhere\n";
    if let Some(stage) = diagnosis.place.stage {
        let _ = writeln!(out, "  stage: {stage}");
    }
    for region in diagnosis.place.regions.iter().filter(|region| region.gain > 3.0).take(3) {
        let strongest = (0..region.at.len())
            .max_by(|a, b| region.acceleration_m_s2[*a].abs().total_cmp(&region.acceleration_m_s2[*b].abs()));
        if let Some(k) = strongest {
            let _ = writeln!(
                out,
                "  over {}: {:+.2} m/s^2 (one sigma {:.2}) at {:.2} {}",
                region.axis, region.acceleration_m_s2[k], region.sigma_m_s2[k], region.at[k], region.unit
            );
        }
    }
    for number in diagnosis.numbers.iter().filter(|number| number.sigmas.abs() > 3.0) {
        let _ = writeln!(
            out,
            "  without effects {} would be {:.4} instead of {:.4}: {:+.1} tolerances",
            number.name, number.fitted, number.nominal, number.sigmas
        );
    }
    out += "\nHow far: RMS error of predictions over 0.5, 1 and 2 s\n";
    let k = &diagnosis.gap.k_step_m;
    let mut rows = vec![("the rig as it is", k.nominal), ("its numbers re-fitted", k.parameters_only)];
    if diagnosis.gap.closure.is_some() || diagnosis.verdict == Verdict::Effect {
        rows.push(("with the effect", k.with_effect));
    }
    for (name, errors) in rows {
        let errors = errors.map(|error: Option<Figure>| {
            error.map_or("-".to_owned(), |e| format!("{:.1} cm", 100.0 * e.value))
        });
        let _ = writeln!(out, "  {name:<22} {:>9} {:>9} {:>9}", errors[0], errors[1], errors[2]);
    }
    for warning in &diagnosis.warnings {
        let _ = writeln!(out, "warning: {warning}");
    }
    out
}

fn parameters(candidate: &Candidate) -> String {
    candidate.parameters.iter().fold(String::new(), |mut out, p| {
        let unit = if p.unit == "1" { String::new() } else { format!(" {}", p.unit) };
        let _ = write!(out, "   {} = {:.3} ({:.3} to {:.3}){unit}", p.name, p.value, p.low, p.high);
        out
    })
}
