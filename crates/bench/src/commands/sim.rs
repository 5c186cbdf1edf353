use std::{
    io::IsTerminal,
    path::PathBuf,
    time::{Duration, Instant},
};

use anyhow::Context;
use bench_plant::effects::parse_effect;
use bench_recording::{ExportOptions, Mode, Options, Recorder, Session, export};
use bench_rig::{Mission, Model, Rig};
use bench_run::{Progress, check, simulate, simulate_seen};
use clap::{Args, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};

use crate::{
    exit::Exit,
    files,
    flight::Flight,
    seen::{self, Watch},
    words,
};

/// Fly a mission in the virtual lab, as fast as it goes, and record it
#[derive(Args)]
#[command(after_help = "Examples:
  bench sim
  bench sim --mission hold-3d --seed 7 -o hold.mcap --export hold.xlsx
  bench sim --mission hop --effect battery-load:sag=0.05,time_constant_s=0.5 --json
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
        words::print_json(&flight.as_json("bench.sim/1", &finished))?;
    } else {
        let duration_s = flown.summary.duration_s;
        let head = format!(
            "{}: {duration_s:.1} s flown in {:.0} ms ({} x real time)\n",
            flight.name(),
            took.as_secs_f64() * 1e3,
            words::grouped((duration_s / took.as_secs_f64()) as u64)
        );
        words::print(&(head + &flight.in_words(&finished)))?;
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
