use std::{
    fmt::Write as _,
    io::IsTerminal,
    path::PathBuf,
    time::{Duration, Instant},
};

use anyhow::Context;
use bench_plant::effects::parse_effect;
use bench_recording::{ExportOptions, Finished, Mode, Options, Recorder, RecordingError, Session, export};
use bench_rig::{Mission, Model, Rig};
use bench_run::{Check, Ending, Flown, Progress, check, simulate, simulate_seen};
use clap::{Args, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::json;

use crate::{
    exit::Exit,
    files,
    seen::{self, Watch},
    words,
};

/// Fly a mission in the virtual lab, as fast as it goes, and record it
#[derive(Args)]
#[command(after_help = "Examples:
  bench sim
  bench sim --mission hold-3d --seed 7 -o hold.mcap --export hold.xlsx
  bench sim --mission hop --effect battery-load:sag=0.05,recovery_s=0.5 --json
  bench sim --frames --views views/

The same rig, mission and seed give the same recording, byte for byte. Exit code 1 says that the
mission's criteria were missed, 4 that a safety limit stopped the flight.")]
pub struct Arguments {
    /// Rig file
    #[arg(long, default_value = files::DEFAULT_RIG)]
    rig: PathBuf,
    /// Mission file, or the name of one in the folder `missions` beside the rig
    #[arg(long, default_value = "climb-040")]
    mission: String,
    /// Seed of everything random
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Add an effect to the rig: NAME:param=value,... (`bench effects` lists them); may be repeated
    #[arg(long = "effect", value_name = "NAME:PARAM=VALUE")]
    effects: Vec<String>,
    /// Equations of the airframe, instead of the rig's
    #[arg(long)]
    model: Option<ModelChoice>,
    /// Render what a Kinect sees, and fly by what the tracker finds in the frames
    #[arg(long)]
    frames: bool,
    /// Draw the three views of frames into this folder as PNG
    #[arg(long, value_name = "FOLDER", requires = "frames")]
    views: Option<PathBuf>,
    /// Draw the first of every so many frames
    #[arg(long, default_value_t = 15, value_name = "FRAMES", value_parser = clap::value_parser!(u64).range(1..))]
    views_every: u64,
    /// Recording to write [default: recordings/MISSION-SEED.mcap]
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Also write the flight as a table: .csv, .xlsx or .parquet
    #[arg(long, value_name = "FILE")]
    export: Option<PathBuf>,
    /// Replace an output that no simulation can make again
    #[arg(long)]
    force: bool,
    /// Print the summary as JSON (schema bench.sim/1)
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum ModelChoice {
    /// The paper's vertical model alone
    Vertical,
    /// Rigid body with six degrees of freedom
    SixDegree,
}

pub fn run(arguments: Arguments) -> anyhow::Result<Exit> {
    let mut rig = files::rig(&arguments.rig)?;
    let mission = files::mission(&arguments.mission, &arguments.rig)?;
    for text in &arguments.effects {
        rig.effects.push(parse_effect(text)?);
    }
    match arguments.model {
        Some(ModelChoice::Vertical) => rig.plant.model = Model::Vertical,
        Some(ModelChoice::SixDegree) => rig.plant.model = Model::SixDegree,
        None => {}
    }
    // Effects are checked before an output is touched.
    bench_plant::effects::Effects::from_rig(&rig, arguments.seed)?;
    let calibration = arguments.frames.then(|| seen::calibration(&rig, &arguments.rig)).transpose()?;
    if arguments.frames {
        seen::check_mission(&mission)?;
    }
    let mut watch = Watch::new(arguments.views.as_deref(), arguments.views_every)?;
    let output = arguments.output.unwrap_or_else(|| files::default_recording(&mission.name, arguments.seed));
    files::make_room(&output, arguments.force)?;

    let mut session = session(&rig, &mission, arguments.seed);
    if arguments.frames {
        session.extra.insert("tracker".to_owned(), "rendered frames".to_owned());
    }
    let mut recorder = Recorder::create(&output, &session, Options::SIMULATION)?;
    let bar = progress_bar(mission.duration_s());
    let began = Instant::now();
    let mut iterations = 0_u32;
    let each = |progress: &Progress| {
        iterations += 1;
        if iterations.is_multiple_of(50) {
            bar.set_position(progress.now.nanos() / 1_000_000);
            bar.set_message(format!("{} at {:.2} m", progress.phase, progress.altitude_m));
        }
        true
    };
    let flown = match calibration {
        None => simulate(&rig, &mission, arguments.seed, &mut recorder, each)?,
        Some(calibration) => {
            let look = |frame: &_, tracker: &_, sighting: &_| watch.see(frame, tracker, sighting);
            let see = |exposures| seen::tracker(exposures, calibration, &rig, arguments.seed, look);
            simulate_seen(&rig, &mission, arguments.seed, see, &mut recorder, each)?
        }
    };
    let finished = recorder.finish();
    let took = began.elapsed();
    bar.finish_and_clear();

    let checks = check(&mission.criteria, &flown.summary);
    let flight = Flight {
        rig: &rig,
        mission: &mission,
        seed: arguments.seed,
        flown: &flown,
        checks: &checks,
        watch: arguments.frames.then_some(&watch),
    };
    if arguments.json {
        words::print_json(&flight.as_json(&finished))?;
    } else {
        words::print(&flight.in_words(&finished, took))?;
    }
    if let Err(error) = finished {
        eprintln!("error: the flight was simulated, but not all of it recorded: {error}");
        return Ok(Exit::DataLoss);
    }
    if let Some(error) = watch.failed() {
        eprintln!("error: the flight is recorded, but not all views were drawn: {error}");
        return Ok(Exit::DataLoss);
    }
    if let Some(table) = &arguments.export {
        let exported = export(&output, table, &ExportOptions::default())
            .with_context(|| format!("cannot export to {}", table.display()))?;
        eprintln!("exported {} to {}", words::tables(&exported), table.display());
    }
    Ok(flight.exit())
}

fn session(rig: &Rig, mission: &Mission, seed: u64) -> Session {
    Session {
        rig_name: rig.name.clone(),
        rig_toml: Some(rig.to_toml()),
        mission_name: mission.name.clone(),
        mission_toml: Some(mission.to_toml()),
        seed: Some(seed),
        ..Session::new(Mode::Sim)
    }
}

fn progress_bar(duration_s: f64) -> ProgressBar {
    if !std::io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let style = ProgressStyle::with_template("{wide_bar} {percent}% {msg}")
        .unwrap_or_else(|_| ProgressStyle::default_bar());
    let bar = ProgressBar::new((duration_s * 1000.0) as u64).with_style(style);
    bar.enable_steady_tick(Duration::from_millis(100));
    bar
}

/// A flight as told to a person or a program.
struct Flight<'a> {
    rig: &'a Rig,
    mission: &'a Mission,
    seed: u64,
    flown: &'a Flown,
    checks: &'a [Check],
    /// What became of the frames, if there were any.
    watch: Option<&'a Watch>,
}

impl Flight<'_> {
    fn exit(&self) -> Exit {
        match &self.flown.ending {
            Ending::Stopped(_) | Ending::Fault(_) => Exit::Stopped,
            Ending::Complete if self.checks.iter().all(|check| check.passed) => Exit::Done,
            Ending::Complete => Exit::CheckFailed,
        }
    }

    /// Name, value, unit of every figure that the flight defines.
    fn figures(&self) -> Vec<(&'static str, f64, &'static str)> {
        let s = &self.flown.summary;
        [
            ("peak", s.peak_m, "m"),
            ("overshoot", s.overshoot_m, "m"),
            ("settling time", s.settling_time_s, "s"),
            ("RMS error", s.rms_error_m, "m"),
            ("lateral RMS error", s.lateral_rms_error_m, "m"),
            ("rebound at", s.rebound_m, "m"),
            ("overruns", Some(s.overruns as f64), ""),
        ]
        .into_iter()
        .filter_map(|(name, value, unit)| Some((name, value?, unit)))
        .collect()
    }

    fn in_words(&self, finished: &Result<Finished, RecordingError>, took: Duration) -> String {
        let summary = &self.flown.summary;
        let mut out = format!(
            "{} with {} on rig {}, seed {}: {:.1} s flown in {:.0} ms ({} x real time)\n",
            self.mission.name,
            self.rig.airframe.name,
            self.rig.name,
            self.seed,
            summary.duration_s,
            took.as_secs_f64() * 1e3,
            words::grouped((summary.duration_s / took.as_secs_f64()) as u64)
        );
        for effect in &self.rig.effects {
            let values: Vec<_> = effect.parameters.iter().map(|(key, x, _)| format!("{key} = {x}")).collect();
            let _ = writeln!(out, "  with {}: {}", effect.name, values.join(", "));
        }
        for (name, value, unit) in self.figures() {
            let digits = match unit {
                "m" => 3,
                "s" => 2,
                _ => 0,
            };
            let _ = writeln!(out, "{}", format!("  {name:<18} {value:>8.digits$} {unit}").trim_end());
        }
        if let Some(watch) = self.watch {
            out += &watch.in_words();
        }
        match &self.flown.ending {
            Ending::Complete => {}
            Ending::Stopped(reason) => _ = writeln!(out, "  stopped: {reason}"),
            Ending::Fault(error) => _ = writeln!(out, "  fault: {error}"),
        }
        for check in self.checks {
            let value = check.value.map_or("not reached".to_owned(), |value| format!("{value:.3}"));
            let relation = if check.at_least { "at least" } else { "at most" };
            let verdict = if check.passed { "passed" } else { "FAILED" };
            let _ = writeln!(out, "  {verdict}  {}: {value}, {relation} {}", check.key, check.limit);
        }
        if let Ok(finished) = finished {
            let _ = writeln!(
                out,
                "recorded {} ({}) to {}",
                words::count(finished.messages, "message"),
                words::size(finished.bytes),
                finished.path.display()
            );
        }
        out
    }

    fn as_json(&self, finished: &Result<Finished, RecordingError>) -> serde_json::Value {
        let s = &self.flown.summary;
        let (ending, reason) = match &self.flown.ending {
            Ending::Complete => ("complete", None),
            Ending::Stopped(reason) => ("stopped", Some(reason.to_string())),
            Ending::Fault(error) => ("fault", Some(error.to_string())),
        };
        let checks: Vec<_> = self
            .checks
            .iter()
            .map(|c| json!({ "key": c.key, "value": c.value, "limit": c.limit, "passed": c.passed }))
            .collect();
        let recording = finished.as_ref().ok().map(|finished| {
            json!({ "path": finished.path, "messages": finished.messages, "bytes": finished.bytes })
        });
        json!({
            "schema": "bench.sim/1",
            "rig": self.rig.name,
            "airframe": self.rig.airframe.name,
            "mission": self.mission.name,
            "seed": self.seed,
            "effects": self.rig.effects.iter().map(|effect| json!({
                "name": effect.name,
                "parameters": effect.parameters.iter()
                    .map(|(key, value, _)| (key.clone(), json!(value)))
                    .collect::<serde_json::Map<_, _>>(),
            })).collect::<Vec<_>>(),
            "tracking": self.watch.map(Watch::as_json),
            "ending": ending,
            "reason": reason,
            "passed": self.exit() == Exit::Done,
            "summary": {
                "duration_s": s.duration_s,
                "peak_m": s.peak_m,
                "overshoot_m": s.overshoot_m,
                "settling_time_s": s.settling_time_s,
                "rms_error_m": s.rms_error_m,
                "lateral_rms_error_m": s.lateral_rms_error_m,
                "rebound_m": s.rebound_m,
                "ticks": s.ticks,
                "overruns": s.overruns,
                "lateness_max_s": s.lateness_max_s,
                "positions": s.positions,
            },
            "checks": checks,
            "recording": recording,
        })
    }
}
