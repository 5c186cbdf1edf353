use std::{fmt::Write as _, path::PathBuf};

use anyhow::bail;
use bench_diagnosis::{Calibration, Candidate, Diagnosis, Figure, Problem, Verdict};
use clap::Args;

use crate::{commands::tracks::Selection, exit::Exit, files, words};

/// Say where the sim-to-real gap of flights lies and which unmodelled effect causes it
#[derive(Args)]
#[command(after_help = "Examples:
  bench diagnose --rig rigs/virtual.toml flight-*.mcap
  bench diagnose --rig rigs/foreign.toml flight-*.mcap --json
  bench diagnose --rig my-quad.toml --above 0.3 --without battery log-*.mcap

The rig is the nominal model with its tolerances. All flights must be of one airframe in one condition;
more and richer flights (launches, steps, descents, low hover) tell more. docs/diagnosis.md has the method,
and what it does not do yet.")]
pub struct Arguments {
    #[command(flatten)]
    selection: Selection,
    /// Nominal model with tolerances
    #[arg(long, default_value = files::DEFAULT_RIG)]
    rig: PathBuf,
    /// Exit with 1 unless the verdict is `none`
    #[arg(long)]
    fail_on_gap: bool,
    /// Print as JSON (schema bench.diagnosis/1)
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    let mut rig = files::rig(&arguments.rig)?;
    // The rig's own effects belong to its simulations; the nominal model is what is asked about.
    let ignored = std::mem::take(&mut rig.effects).len();
    let (tracks, mut warnings) = arguments.selection.tracks(&rig)?;
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
        words::print(&in_words(&diagnosis))?;
    }
    let gap = diagnosis.verdict != Verdict::None;
    Ok(if arguments.fail_on_gap && gap { Exit::CheckFailed } else { Exit::Done })
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
