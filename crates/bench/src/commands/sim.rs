use std::{path::PathBuf, time::Instant};

use anyhow::Context;
use bench_plant::effects::parse_effect;
use bench_recording::{ExportOptions, Options, Recorder, export};
use bench_rig::{Mission, Model, Rig};
use bench_run::{check, simulate, simulate_seen};
use clap::{Args, ValueEnum};

use crate::{
    arguments::{Force, Json, RigArgument},
    exit::Exit,
    files::{self, Form, Outputs},
    flight::Flight,
    progress::{self, Progress},
    recorded,
    recorded_views::RecordedViews,
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
  bench sim --frames --record-views 5 --epoch 1700000000

The same rig, mission and seed give the same recording, byte for byte. Exit code 1 says that the
mission's criteria were missed, 4 that a safety limit stopped the flight.")]
pub struct Arguments {
    #[command(flatten)]
    rig: RigArgument,
    /// Mission: a file, or the name of one in the folder `missions` beside the rig or of a built-in one
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
    /// Record the three views for viewers, so many a second of flight
    #[arg(long, value_name = "HZ", requires = "frames", value_parser = rate)]
    record_views: Option<f64>,
    /// What log times count from, for viewers: seconds since 1970 (UTC), or `none` to count from the start
    #[arg(long, value_name = "UNIX_SECONDS", default_value = "none", value_parser = epoch)]
    epoch: Epoch,
    /// Recording to write [default: in recordings/, named after rig, mission, effects and seed]
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Also write the flight as a table: .csv, .xlsx or .parquet
    #[arg(long, value_name = "FILE")]
    export: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    json: Json,
}

#[derive(Clone, Copy, ValueEnum)]
enum ModelChoice {
    /// The paper's vertical model alone
    Vertical,
    /// Rigid body with six degrees of freedom
    SixDegree,
}

/// An instant in nanoseconds since 1970, or none.
#[derive(Clone, Copy)]
struct Epoch(Option<u64>);

fn epoch(text: &str) -> Result<Epoch, String> {
    if text == "none" {
        return Ok(Epoch(None));
    }
    let seconds = text.parse::<f64>().ok().filter(|seconds| (0.0..EPOCH_MAX_S).contains(seconds));
    let seconds = seconds.ok_or("seconds since 1970, such as 1700000000, or `none`")?;
    Ok(Epoch(Some((seconds * 1e9).round() as u64)))
}

/// Log times are 64 bits of nanoseconds; this leaves room for flights until the year 2500.
const EPOCH_MAX_S: f64 = 16.7e9;

fn rate(text: &str) -> Result<f64, String> {
    let rate_hz = text.parse().ok().filter(|rate_hz| (0.01..=30.0).contains(rate_hz));
    rate_hz.ok_or_else(|| "a rate from 0.01 to 30 a second, the frames' own".to_owned())
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    let mut nominal = arguments.rig.load()?;
    let mission = files::mission(&arguments.mission, arguments.rig.path())?;
    match arguments.model {
        Some(ModelChoice::Vertical) => nominal.plant.model = Model::Vertical,
        Some(ModelChoice::SixDegree) => nominal.plant.model = Model::SixDegree,
        None => {}
    }
    let mut rig = nominal.clone();
    for text in &arguments.effects {
        rig.effects.push(parse_effect(text)?);
    }
    let added = recorded::added_effects(&nominal, &rig);
    // Effects are checked before an output is touched.
    bench_plant::effects::Effects::from_rig(&rig, arguments.seed)?;
    let calibration = arguments.frames.then(|| seen::calibration(&rig, arguments.rig.path())).transpose()?;
    if arguments.frames {
        seen::check_mission(&mission)?;
    }
    let output =
        arguments.output.clone().unwrap_or_else(|| default_recording(arguments, &rig, &mission, &added));
    Outputs::new(arguments.force.force)
        .and(output.as_path(), Form::Recording)
        .and(arguments.export.as_deref(), Form::Table)
        .and(arguments.views.as_deref(), Form::Folder)
        .check()?;
    let mut watch = Watch::new(arguments.views.as_deref(), arguments.views_every)?;
    files::make_folder(&output)?;

    let mut session = recorded::simulated_session(&nominal, &added, &mission, arguments.seed);
    if arguments.frames {
        session.extra.insert("tracker".to_owned(), "rendered frames".to_owned());
    }
    session.epoch_unix_ns = arguments.epoch.0;
    let mut recorder = Recorder::create(&output, &session, Options::SIMULATION)?;
    let record_views = |rate_hz| {
        recorder.images().map(|images| RecordedViews::new(images, rate_hz, rig.tracker.latency_s.value))
    };
    let mut views = arguments.record_views.and_then(record_views);
    let progress = Progress::of("sim");
    progress.begin("flying", mission.duration_s(), "s of flight");
    let began = Instant::now();
    let mut iterations = 0_u32;
    let each = |flown: &bench_run::Progress| {
        iterations += 1;
        if iterations.is_multiple_of(50) {
            progress.at(flown.now.seconds());
            progress.doing(&format!("{} at {:.2} m", flown.phase, flown.altitude_m));
        }
        true
    };
    let flown = match calibration {
        None => simulate(&rig, &mission, arguments.seed, &mut recorder, each)?,
        Some(calibration) => {
            let look = |frame: &_, tracker: &_, sighting: &_| {
                watch.see(frame, tracker, sighting);
                if let Some(views) = &mut views {
                    views.see(frame, tracker, sighting);
                }
            };
            let see = |exposures| seen::tracker(exposures, calibration, &rig, arguments.seed, look);
            simulate_seen(&rig, &mission, arguments.seed, see, &mut recorder, each)?
        }
    };
    let finished = recorder.finish();
    let took = began.elapsed();
    drop(progress);

    let checks = check(&mission.criteria, &flown.summary);
    let flight = Flight {
        rig: &rig,
        mission: &mission,
        seed: arguments.seed,
        flown: &flown,
        checks: &checks,
        watch: arguments.frames.then_some(&watch),
    };
    if arguments.json.json {
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
    if let Some(error) = watch.failed().or(views.as_ref().and_then(RecordedViews::failed)) {
        eprintln!("error: the flight is recorded, but not all views were drawn: {error}");
        return Ok(Exit::DataLoss);
    }
    if let Some(table) = &arguments.export {
        files::make_folder(table)?;
        let exported = export(&output, table, &ExportOptions::default())
            .with_context(|| format!("cannot export to {}", table.display()))?;
        progress::note(&format!("exported {} to {}", words::tables(&exported), table.display()));
    }
    Ok(flight.exit())
}

/// Named after all that tells this simulation from others.
fn default_recording(arguments: &Arguments, rig: &Rig, mission: &Mission, added: &[String]) -> PathBuf {
    let model = arguments.model.and_then(|model| model.to_possible_value());
    let model = model.map(|model| format!("model={}", model.get_name()));
    let frames = arguments.frames.then(|| "frames".to_owned());
    let added: Vec<String> = model.into_iter().chain(frames).chain(added.iter().cloned()).collect();
    files::default_recording(&rig.name, &mission.name, &added, &format!("seed{}", arguments.seed))
}
