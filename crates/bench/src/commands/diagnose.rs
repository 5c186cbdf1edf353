use std::{
    fmt::Write as _,
    path::{Path, PathBuf},
};

use anyhow::{Context, bail};
use bench_diagnosis::{Calibration, Diagnosis, NextFlight, Problem, Track, Verdict};
use bench_recording::{Flight, Mode, Record, Session};
use bench_rig::{Mission, Rig};
use bench_run::{Ending, simulate_on};
use clap::Args;

use crate::{
    arguments::{Force, Json, Page},
    calibration::{self, Missions},
    commands::tracks::Selection,
    diagnosis::{
        page::{Made, page},
        terminal::in_words,
    },
    exit::Exit,
    files::{self, Form, Outputs},
    progress::Progress,
    recorded::NominalRig,
    words,
};

/// Say where the sim-to-real gap of flights lies and which unmodelled effect causes it
#[derive(Args)]
#[command(after_help = "Examples:
  bench diagnose flight-*.mcap
  bench diagnose --rig virtual flight-*.mcap --html diagnosis.html
  bench diagnose flight-*.mcap --json
  bench diagnose --rig virtual flight-*.mcap --write-rig better.toml
  bench diagnose --rig my-quad.toml --above 0.3 --without battery log-*.mcap
  bench diagnose flight-*.mcap --next-flight next.toml --between quadratic-drag,inflow-damping

Probabilities come from a calibration: one for this rig and these missions if --calibrate made
it before, else the built-in one.

A rig's own [[effect]] tables are part of the model: flights diagnosed with the rig that
--write-rig wrote should say `none`.

The rig is the nominal model with its tolerances. All flights must be of one airframe in one
condition; more and richer flights (launches, steps, descents, low hover) tell more.
docs/diagnosis.md has the method, and what it does not do yet.")]
pub struct Arguments {
    #[command(flatten)]
    selection: Selection,
    #[command(flatten)]
    rig: NominalRig,
    /// First calibrate for this rig: simulate so many sets of nominal flights of these missions, and three times as many
    /// with effects of the library, and keep what they teach in the cache
    #[arg(long, value_name = "SETS", num_args = 0..=1, default_missing_value = "100")]
    calibrate: Option<usize>,
    /// Write the rig with the named effect added, as a new rig file
    #[arg(long, value_name = "FILE")]
    write_rig: Option<PathBuf>,
    /// Exit with 1 unless the verdict is `none`
    #[arg(long)]
    fail_on_gap: bool,
    #[command(flatten)]
    page: Page,
    /// Write the mission that best tells the two leading hypotheses apart
    #[arg(long, value_name = "FILE")]
    next_flight: Option<PathBuf>,
    /// The two hypotheses that the next flight is to tell apart: names of effects, pairs as A+B, or none
    #[arg(long, value_name = "A,B", requires = "next_flight")]
    between: Option<String>,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    json: Json,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    let between = between(arguments)?;
    Outputs::new(arguments.force.force)
        .and(arguments.page.html.as_deref(), Form::Html)
        .and(arguments.write_rig.as_deref(), Form::Toml)
        .and(arguments.next_flight.as_deref(), Form::Toml)
        .from(arguments.selection.flights.iter().map(PathBuf::as_path))
        .check()?;
    let recorded = arguments.selection.load()?;
    let nominal = arguments.rig.resolve(&recorded)?;
    let rig = nominal.rig;
    let (tracks, refused) = arguments.selection.tracks(&recorded, &rig);
    if tracks.is_empty() {
        bail!("none of the flights can be diagnosed:\n{}", refused.join("\n"));
    }
    let mut warnings = [recorded.remarks.clone(), nominal.remarks, refused].concat();
    let mut flown = Missions::default();
    for (path, flight) in &recorded.flights {
        match flight.mission_toml().map(|text| Mission::read(path, text)) {
            Some(Ok(mission)) => flown.0.push(mission),
            // The flights can be diagnosed all the same.
            Some(Err(error)) => warnings.push(format!("the mission that {} holds: {error}", path.display())),
            None => {}
        }
    }
    warnings.extend(unused_motion(&tracks, &rig));
    let calibration = match arguments.calibrate {
        Some(sets) => calibration::learn(&rig, &flown, sets)?,
        None => calibration::cached(&rig, &flown).unwrap_or_else(Calibration::built_in),
    };
    let problem = Problem::new(&tracks, &rig);
    let progress = Progress::of("diagnose");
    let flights = words::count(tracks.len() as u64, "flight");
    progress.begin_untold(&format!("weighing what explains {flights}"));
    let mut diagnosis = Diagnosis::of(&problem, &calibration);
    let mut refused = false;
    if arguments.next_flight.is_some() {
        progress.begin_untold("trying missions for the next flight");
        match NextFlight::propose(&problem, &diagnosis.candidates, between, &flown.distinct(), fly) {
            Ok(next) => diagnosis.next_flight = Some(next),
            Err(reason) => {
                refused = true;
                warnings.push(reason.to_string());
            }
        }
    }
    drop(progress);
    diagnosis.warnings = warnings;
    if arguments.json.json {
        words::print_json(&diagnosis)?;
    } else {
        words::print(&in_words(&diagnosis, rig.airframe.actuation))?;
    }
    if let Some(file) = &arguments.page.html {
        let command = std::iter::once("bench".to_owned())
            .chain(std::env::args_os().skip(1).map(|word| word.to_string_lossy().into_owned()))
            .collect();
        files::write_and_say(file, &page(&diagnosis, &Made { rig: &rig, command }))?;
    }
    if let Some(path) = &arguments.write_rig {
        write_rig(path, &rig, &diagnosis)?;
    }
    if let (Some(next), Some(file)) = (&diagnosis.next_flight, &arguments.next_flight) {
        files::write(file, &next.to_toml())?;
        if !arguments.json.json {
            words::print(&next_in_words(next, file, diagnosis.calibration.temperature))?;
        }
    }
    let gap = diagnosis.verdict != Verdict::None;
    Ok(if refused || arguments.fail_on_gap && gap { Exit::CheckFailed } else { Exit::Done })
}

/// What was measured on board and is not used, because the rig does not say how good it is.
fn unused_motion(tracks: &[Track], rig: &Rig) -> Option<String> {
    let felt = || tracks.iter().flat_map(|track| &track.felt);
    let d = &rig.disturbance;
    let unused = [
        (felt().any(|f| f.velocity_m_s.is_some()) && d.velocity_noise_m_s.is_none(), "velocity_noise_m_s"),
        (
            felt().any(|f| f.acceleration_m_s2.is_some()) && d.acceleration_noise_m_s2.is_none(),
            "acceleration_noise_m_s2",
        ),
    ];
    let keys: Vec<&str> = unused.iter().filter(|(unused, _)| *unused).map(|(_, key)| *key).collect();
    (!keys.is_empty()).then(|| {
        format!(
            "vertical motion was measured on board, but the rig's [disturbance] does not say how well ({}): it is not used",
            keys.join(", ")
        )
    })
}

/// The two hypotheses of `--between`.
fn between(arguments: &Arguments) -> anyhow::Result<Option<[&str; 2]>> {
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

fn write_rig(path: &Path, rig: &Rig, diagnosis: &Diagnosis) -> anyhow::Result<()> {
    let Some(changed) = diagnosis.rig_with_effect(rig) else {
        let verdict = &diagnosis.candidates[0].name;
        bail!("the verdict is {verdict}: there is no effect to write into {}", path.display());
    };
    files::write_and_say(path, &changed.to_toml())
}
