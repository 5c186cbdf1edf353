#[cfg(not(feature = "lab"))]
mod unwatched;
#[cfg(feature = "lab")]
mod watched;

use std::{
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

use anyhow::{Context, anyhow, bail};
use bench_device::Clock as _;
use bench_kinect::KinectError;
use bench_plant::effects::parse_effect;
use bench_recording::{ExportOptions, Finished, Options, Recorder, RecordingError, Session, export};
use bench_rig::{Mission, Model, Rig};
use bench_run::{Directive, Tee, WallClock, check, simulate, simulate_seen};
use clap::{Args, ValueEnum};

#[cfg(not(feature = "lab"))]
use crate::left_out::StationArgument;
#[cfg(feature = "lab")]
use crate::station::{Single, Station, StationArgument};
use crate::{
    arguments::{Force, Json, Meta, RigArgument},
    exit::Exit,
    files::{self, Form, Outputs},
    flight::Flight,
    foxglove::{FoxgloveArguments, Server},
    live::LiveArguments,
    progress::{self, Progress},
    recorded,
    recorded_views::RecordedViews,
    seen::{self, Watch},
    words,
};
#[cfg(not(feature = "lab"))]
use unwatched::Watched;
#[cfg(feature = "lab")]
use watched::Watched;

/// Fly a mission in the virtual lab, as fast as it goes, and record it
#[derive(Args)]
#[cfg_attr(
    feature = "foxglove",
    command(
        group = clap::ArgGroup::new("watched").args(["live", "foxglove"]).multiple(true),
        mut_arg("foxglove", |foxglove| foxglove.requires("realtime")),
    )
)]
#[command(after_help = "Examples:
  bench sim
  bench sim --mission hold-3d --seed 7 -o hold.mcap --export hold.xlsx
  bench sim --mission hop --effect battery-load:sag=0.05,time_constant_s=0.5 --json
  bench sim --frames --views views/
  bench sim --live --realtime --frames
  bench sim --frames --record-views 5 --epoch 1700000000 -o views.mcap
  bench sim --station lab/ --meta operator=Ada

With --live the flight is on a page in the browser, whose address is printed; docs/live.md tells
what it shows and takes. The same rig, mission and seed give the same recording, byte for byte. Exit code 1 says that the
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
    #[command(flatten)]
    station: StationArgument,
    /// Also write the flight as a table: .csv, .xlsx or .parquet
    #[arg(long, value_name = "FILE")]
    export: Option<PathBuf>,
    #[command(flatten)]
    meta: Meta,
    #[command(flatten)]
    live: LiveArguments,
    #[command(flatten)]
    foxglove: FoxgloveArguments,
    /// Fly by the wall clock instead of as fast as it goes
    #[arg(long)]
    #[cfg_attr(not(feature = "foxglove"), arg(requires = "live"))]
    #[cfg_attr(feature = "foxglove", arg(requires = "watched"))]
    realtime: bool,
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

/// What is to be flown.
struct Planned {
    nominal: Rig,
    /// With the effects that were added.
    rig: Rig,
    added: Vec<String>,
    mission: Mission,
}

impl Planned {
    fn read(arguments: &Arguments) -> anyhow::Result<Self> {
        let (nominal, rig) = rigs(arguments)?;
        let mission = files::mission(&arguments.mission, arguments.rig.path())?;
        // Effects are checked before an output is touched.
        bench_plant::effects::Effects::from_rig(&rig, arguments.seed)?;
        if arguments.frames {
            seen::calibration(&rig, arguments.rig.path())?;
            seen::check_mission(&mission)?;
        }
        Ok(Self { added: recorded::added_effects(&nominal, &rig), nominal, rig, mission })
    }
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    flown(arguments, &mut |flight, finished, took| tell(arguments, flight, finished, took))
}

/// The flight as a program reads it, without words.
pub fn report(arguments: &Arguments) -> anyhow::Result<serde_json::Value> {
    let mut report = serde_json::Value::Null;
    let exit = flown(arguments, &mut |flight, finished, _| {
        report = flight.as_json(SCHEMA, finished);
        finished.as_ref().map(drop).map_err(|error| anyhow!(unrecorded(error)))
    })?;
    if exit == Exit::DataLoss {
        bail!("the flight is recorded, but not all views were drawn");
    }
    Ok(report)
}

const SCHEMA: &str = "bench.sim/1";

/// What is told of a flight and its recording, and how long it took.
type Told<'a> =
    dyn FnMut(&Flight<'_>, &Result<Finished, RecordingError>, Duration) -> anyhow::Result<()> + 'a;

fn unrecorded(error: &RecordingError) -> String {
    format!("the flight was simulated, but not all of it recorded: {error}")
}

/// Flies, and has `tell` say what came of it.
fn flown(arguments: &Arguments, tell: &mut Told<'_>) -> anyhow::Result<Exit> {
    let planned = Planned::read(arguments)?;
    #[cfg(not(feature = "lab"))]
    arguments.station.refuse()?;
    #[cfg(feature = "lab")]
    if let Some(station) = arguments.station.open(arguments.output.as_deref())? {
        return in_station(arguments, &planned, &station, tell);
    }
    let output = arguments.output.clone().unwrap_or_else(|| default_recording(arguments, &planned));
    check_outputs(arguments, Some(&output))?;
    fly(arguments, &planned, &output, tell).map(|(exit, _)| exit)
}

/// Flies under the name that the station's log gives the recording.
#[cfg(feature = "lab")]
fn in_station(
    arguments: &Arguments,
    planned: &Planned,
    station: &Station,
    tell: &mut Told<'_>,
) -> anyhow::Result<Exit> {
    // What is wrong with the command is told before anything is entered.
    check_outputs(arguments, None)?;
    let flight = Single {
        command: "sim",
        mode: if arguments.frames { "frames" } else { "sim" },
        nominal: &planned.nominal,
        added: &planned.added,
        mission: &planned.mission,
        seed: arguments.seed,
        meta: &arguments.meta,
    };
    station.fly(&flight, |recording| fly(arguments, planned, recording, tell))
}

fn check_outputs(arguments: &Arguments, output: Option<&Path>) -> anyhow::Result<()> {
    Outputs::new(arguments.force.force)
        .and(output, Form::Recording)
        .and(arguments.export.as_deref(), Form::Table)
        .and(arguments.views.as_deref(), Form::Folder)
        .check()
}

/// Flies and records to `output`; how it ended, also in a sentence.
fn fly(
    arguments: &Arguments,
    planned: &Planned,
    output: &Path,
    tell: &mut Told<'_>,
) -> anyhow::Result<(Exit, String)> {
    let Planned { nominal, rig, added, mission } = planned;
    let calibration = rig.calibration.as_ref().filter(|_| arguments.frames);
    let mut watch = Watch::new(arguments.views.as_deref(), arguments.views_every)?;
    let foxglove = arguments.foxglove.open()?;
    let (mut watched, mission, changes) = match Watched::open(arguments, rig, mission)? {
        None => (None, mission.clone(), Vec::new()),
        Some(watched) => match watched.started(mission) {
            Ok((watched, mission, changes)) => (Some(watched), mission, changes),
            Err(why) => return Ok((Exit::Stopped, why)),
        },
    };
    files::make_folder(output)?;

    let mut session = Session::simulated(nominal, added, &mission, arguments.seed);
    if arguments.frames {
        session.extra.insert("tracker".to_owned(), "rendered frames".to_owned());
    }
    recorded::note_changes(&mut session, &changes);
    Meta::note(arguments.meta.meta.clone(), &mut session);
    session.epoch_unix_ns = arguments.epoch.0;
    let observer = foxglove.as_ref().map(Server::observer);
    let mut recorder = Recorder::create_observed(output, &session, Options::SIMULATION, observer)?;
    let record_views = |rate_hz| {
        recorder.images().map(|images| RecordedViews::new(images, rate_hz, rig.tracker.latency_s.value))
    };
    let mut recorded_views = arguments.record_views.and_then(record_views);
    let mut sink = Tee::new(recorder, watched.as_mut().and_then(Watched::watcher));
    let mut frames = match (&watched, calibration) {
        (Some(watched), Some(calibration)) => Some(watched.frames(calibration)?),
        _ => None,
    };
    let progress = Progress::of("sim");
    progress.begin("flying", mission.duration_s(), "s of flight");
    let began = Instant::now();
    let mut pace = arguments.realtime.then(WallClock::start);
    let mut iterations = 0_u32;
    let each = |flown: &bench_run::Progress| {
        iterations += 1;
        if arguments.realtime || iterations.is_multiple_of(50) {
            progress.at(flown.now.seconds());
            progress.doing(&format!("{} at {:.2} m", flown.phase, flown.altitude_m));
        }
        if let Some(clock) = &mut pace {
            // A clock that fails does not wait, which costs the pace alone.
            let _ = clock.wait_until(flown.now.shifted(rig.control_loop.period_s));
        }
        watched.as_mut().map_or(Directive::GoOn, Watched::asks)
    };
    let flown = match calibration {
        None => simulate(rig, &mission, arguments.seed, &mut sink, each)?,
        Some(calibration) => {
            let look = |frame: &_, tracker: &_, sighting: &_| {
                watch.see(frame, tracker, sighting);
                if let Some(frames) = &mut frames {
                    frames.see(frame, tracker, sighting);
                }
                if let Some(views) = &mut recorded_views {
                    views.see(frame, tracker, sighting);
                }
            };
            let see = |exposures| seen::tracker(exposures, calibration, rig, arguments.seed, look);
            simulate_seen(rig, &mission, arguments.seed, see, &mut sink, each)?
        }
    };
    let finished = sink.into_inner().finish();
    let took = began.elapsed();
    drop(progress);

    let checks = check(&mission.criteria, &flown.summary);
    let flight = Flight {
        rig,
        mission: &mission,
        seed: arguments.seed,
        flown: &flown,
        checks: &checks,
        watch: arguments.frames.then_some(&watch),
    };
    tell(&flight, &finished, took)?;
    let failed = watch.failed().or(recorded_views.as_ref().and_then(RecordedViews::failed));
    let exit = keep(arguments, output, &finished, failed)?.unwrap_or_else(|| flight.exit());
    if let Some(watched) = watched {
        watched.landed(&flight, &finished);
    }
    Ok((exit, flight.headline()))
}

/// The rig as it is thought to be, and the one that flies.
fn rigs(arguments: &Arguments) -> anyhow::Result<(Rig, Rig)> {
    let mut nominal = arguments.rig.load()?;
    match arguments.model {
        Some(ModelChoice::Vertical) => nominal.plant.model = Model::Vertical,
        Some(ModelChoice::SixDegree) => nominal.plant.model = Model::SixDegree,
        None => {}
    }
    let mut rig = nominal.clone();
    for text in &arguments.effects {
        rig.effects.push(parse_effect(text)?);
    }
    Ok((nominal, rig))
}

/// What the flight came to, on standard output.
fn tell(
    arguments: &Arguments,
    flight: &Flight<'_>,
    finished: &Result<Finished, RecordingError>,
    took: Duration,
) -> anyhow::Result<()> {
    if arguments.json.json {
        return words::print_json(&flight.as_json(SCHEMA, finished));
    }
    let duration_s = flight.flown.summary.duration_s;
    let pace = if arguments.realtime {
        "in real time".to_owned()
    } else {
        let times = words::grouped((duration_s / took.as_secs_f64()) as u64);
        format!("in {:.0} ms ({times} x real time)", took.as_secs_f64() * 1e3)
    };
    let head = format!("{}: {duration_s:.1} s flown {pace}\n", flight.name());
    words::print(&(head + &flight.in_words(finished)))
}

/// Writes the table, if one is wanted; another exit code than the flight's when something is missing.
fn keep(
    arguments: &Arguments,
    output: &Path,
    finished: &Result<Finished, RecordingError>,
    views: Option<&KinectError>,
) -> anyhow::Result<Option<Exit>> {
    if let Err(error) = finished {
        words::fail(unrecorded(error));
        return Ok(Some(Exit::DataLoss));
    }
    if let Some(error) = views {
        words::fail(format_args!("the flight is recorded, but not all views were drawn: {error}"));
        return Ok(Some(Exit::DataLoss));
    }
    if let Some(table) = &arguments.export {
        files::make_folder(table)?;
        let exported = export(output, table, &ExportOptions::default())
            .with_context(|| format!("cannot export to {}", table.display()))?;
        progress::note(&format!("exported {} to {}", words::tables(&exported), table.display()));
    }
    Ok(None)
}

/// Named after all that tells this simulation from others.
fn default_recording(arguments: &Arguments, planned: &Planned) -> PathBuf {
    let model = arguments.model.and_then(|model| model.to_possible_value());
    let model = model.map(|model| format!("model={}", model.get_name()));
    let frames = arguments.frames.then(|| "frames".to_owned());
    let added: Vec<String> = model.into_iter().chain(frames).chain(planned.added.iter().cloned()).collect();
    let Planned { rig, mission, .. } = planned;
    files::default_recording(&rig.name, &mission.name, &added, &format!("seed{}", arguments.seed))
}
