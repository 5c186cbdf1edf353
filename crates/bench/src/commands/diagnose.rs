use std::{
    fmt::Write as _,
    path::{Path, PathBuf},
};

use anyhow::{Context, bail};
use bench_diagnosis::{Calibration, Candidate, Diagnosis, Figure, MARK, NextFlight, Problem, Track, Verdict};
use bench_recording::{Flight, Mode, Record, Session};
use bench_rig::{Mission, Rig};
use bench_run::{Ending, simulate_on};
use clap::Args;

use crate::{exit::Exit, files, words};

/// Say where the sim-to-real gap of flights lies and which unmodelled effect causes it
#[derive(Args)]
#[command(after_help = "Examples:
  bench diagnose --rig rigs/virtual.toml flight-*.mcap
  bench diagnose --rig rigs/foreign.toml flight-*.mcap --json
  bench diagnose flight-*.mcap --next-flight next.toml --between quadratic-drag,inflow-damping

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
    /// Write the mission that best tells the two leading hypotheses apart
    #[arg(long, value_name = "FILE")]
    next_flight: Option<PathBuf>,
    /// The two hypotheses that the next flight is to tell apart: names of effects, pairs as A+B, or none
    #[arg(long, value_name = "A,B", requires = "next_flight")]
    between: Option<String>,
    /// Print as JSON (schema bench.diagnosis/1)
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    let mut rig = files::rig(&arguments.rig)?;
    // The rig's own effects belong to its simulations; the nominal model is what is asked about.
    let ignored = std::mem::take(&mut rig.effects).len();
    let between = between(arguments)?;
    let (mut tracks, mut warnings, mut missions) = (Vec::new(), Vec::new(), Vec::new());
    for path in &arguments.flights {
        let flight = Flight::load(path)?;
        match Track::from_flight(&path.display().to_string(), &flight, &rig) {
            Ok(track) => tracks.push(track),
            Err(error) => warnings.push(error.to_string()),
        }
        // Only what is compared with a next flight.
        let mission = flight.mission_toml().and_then(|text| Mission::read(path, text).ok());
        missions.extend(mission.filter(|mission| !missions.contains(mission)));
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
    let problem = Problem::new(&tracks, &rig);
    let mut diagnosis = Diagnosis::of(&problem, &Calibration::built_in());
    let mut refused = false;
    if arguments.next_flight.is_some() {
        match NextFlight::propose(&problem, &diagnosis.candidates, between, &missions, fly) {
            Ok(next) => diagnosis.next_flight = Some(next),
            Err(reason) => {
                refused = true;
                warnings.push(reason.to_string());
            }
        }
    }
    diagnosis.warnings = warnings;
    if arguments.json {
        words::print_json(&diagnosis)?;
    } else {
        words::print(&in_words(&diagnosis))?;
    }
    if let (Some(next), Some(file)) = (&diagnosis.next_flight, &arguments.next_flight) {
        std::fs::write(file, next.to_toml())
            .with_context(|| format!("cannot write the mission to {}", file.display()))?;
        if !arguments.json {
            words::print(&next_in_words(next, file, diagnosis.calibration.temperature))?;
        }
    }
    let gap = diagnosis.verdict != Verdict::None;
    Ok(if refused || arguments.fail_on_gap && gap { Exit::CheckFailed } else { Exit::Done })
}

/// The two hypotheses of `--between`; also whether the file of the next flight may be written, before the work.
fn between(arguments: &Arguments) -> anyhow::Result<Option<[&str; 2]>> {
    if let Some(file) = &arguments.next_flight {
        let proposed = || std::fs::read_to_string(file).is_ok_and(|text| text.starts_with(MARK));
        if file.exists() && !proposed() {
            bail!("{} exists and is not a proposed mission; name another file", file.display());
        }
    }
    let Some(names) = &arguments.between else { return Ok(None) };
    let Some((first, second)) = names.split_once(',') else {
        bail!("--between {names:?}: expected two hypotheses, such as quadratic-drag,inflow-damping");
    };
    let names = [first.trim(), second.trim()];
    NextFlight::check(names).context("--between")?;
    Ok(Some(names))
}

/// Flies a mission on a plant that the controller takes for the nominal rig.
fn fly(plant: &Rig, nominal: &Rig, mission: &Mission) -> Option<Flight> {
    let mut records: Vec<Record> = Vec::new();
    let flown = simulate_on(plant, nominal, mission, 0, &mut records, |_| true).ok()?;
    let whole = flown.ending == Ending::Complete;
    whole.then(|| Flight::from_records(Session::new(Mode::Sim), records))
}

fn next_in_words(next: &NextFlight, file: &Path, temperature: f64) -> String {
    let [first, second] = &next.between;
    let mut out = format!("\nNext flight: tells {first} from {second}\n  {}\n", next.flies);
    let nats = |gain: f64| format!("{}{gain:.1}", if gain < NextFlight::MOST { "" } else { "over " });
    let _ = writeln!(
        out,
        "  expected gain {:.1} nats ({} if {first} is true, {} if {second} is): odds {} times as clear",
        next.gain,
        nats(next.gain_if[0]),
        nats(next.gain_if[1]),
        match (next.gain / temperature).exp() {
            factor if factor < 1000.0 => format!("{factor:.1}"),
            _ => "over 1,000".to_owned(),
        }
    );
    let _ = match &next.repeat {
        Some(repeat) => {
            writeln!(out, "  flying {} once more would bring {:.1} nats", repeat.mission, repeat.gain)
        }
        None => writeln!(out, "  the recordings hold no mission to compare with"),
    };
    let _ = writeln!(
        out,
        "  written to {} after {}; fly it, then diagnose all recordings together",
        file.display(),
        words::count(next.tried as u64, "mission")
    );
    out
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
