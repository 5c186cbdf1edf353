//! `bench hil`: three threads share the work. The loop's thread has the board and flies; the recorder's writes the recording; this one
//! has the signals and the screen.

mod loop_thread;
mod report;
mod screen;

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc,
    },
    time::Duration,
};

use anyhow::{Context, bail};
use bench_dac::ports;
use bench_plant::effects::{self, Effects, LIBRARY, parse_effect};
use bench_recording::{ExportOptions, Mode, Options, Recorder, Session, export};
use bench_rig::{Bench, Mission, Rig};
use bench_view::{About, Outcome, Stage, Start};
use clap::Args;
use rustix::process::set_parent_process_death_signal;
use tokio::{
    runtime::Runtime,
    sync::mpsc::{UnboundedReceiver, unbounded_channel},
};

use crate::{
    arguments::{Force, Json, Meta},
    exit::Exit,
    eyes::Eyes,
    files::{self, Form, Outputs},
    foxglove::{FoxgloveArguments, Server},
    live::{self, LiveArguments, Page},
    progress, recorded, seen,
    signals::{PARENT_ENDED, Signals},
    station::{Single, StationArgument},
    words,
};
use loop_thread::{Landed, LoopThread, Order, Ready, Seeing, Sees};
use report::Report;
use screen::Screen;

/// Fly a mission through real hardware, in real time, and record it
#[derive(Args)]
#[command(after_help = "Examples:
  bench hil --port /dev/ttyACM0
  bench hil --port /dev/ttyACM0 --mission hold-3d -o hold.mcap
  bench emulate psoc5 --link /tmp/psoc5 & bench hil --port /tmp/psoc5
  bench hil --rig transmitter --port /dev/ttyACM0 --exposure-ms 10
  bench hil --port /dev/ttyACM0 --live
  bench hil --port /dev/ttyACM0 --station lab/ --meta operator=Ada

With --live the flight is on a page in the browser, which waits for START once the devices are
checked; docs/live.md tells what it shows and takes. `bench devices` lists ports and Kinects; docs/hil.md tells wiring, checks and what stops a
flight. Exit code 1 says that the mission's criteria were missed, 4 that a device failed or the
flight was stopped; the throttle is at rest then.")]
pub struct Arguments {
    /// Serial port of the board
    #[arg(long)]
    port: Option<String>,
    /// Rig: a file, or the name of a built-in one (`bench rigs` lists them)
    #[arg(long, value_name = "RIG", default_value = files::LOOPBACK_RIG)]
    rig: PathBuf,
    /// Mission: a file, or the name of one in the folder `missions` beside the rig or of a built-in one
    #[arg(long, default_value = "climb-040")]
    mission: String,
    /// Seed of the virtual airframe's and tracker's noise
    #[arg(long, default_value_t = 0)]
    seed: u64,
    #[command(flatten)]
    eyes: Eyes,
    /// Add an effect to the virtual airframe: NAME:param=value,... (`bench effects` lists them); may be repeated
    #[arg(long = "effect", value_name = "NAME:PARAM=VALUE")]
    effects: Vec<String>,
    /// Recording to write [default: in recordings/, named after rig, mission, effects, seed and time]
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
    /// For who starts this as a process of their own: end the flight when they end, however that comes
    #[arg(long, hide = true)]
    end_with_parent: bool,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    json: Json,
}

const FAILED: &str = "the loop's thread failed; the board zeroes its outputs by itself. Please report this";

/// How often the screen is brought up to date.
const REDRAWN: Duration = Duration::from_millis(100);

/// What is to be flown, with which board.
struct Planned {
    port: String,
    nominal: Rig,
    /// With the effects that were added.
    rig: Rig,
    added: Vec<String>,
    mission: Mission,
    seeing: Option<Seeing>,
}

impl Planned {
    fn read(arguments: &Arguments) -> anyhow::Result<Self> {
        let Some(port) = arguments.port.clone() else {
            bail!("which port is the board on? name it with --port; {}", there_is());
        };
        let nominal = files::rig(&arguments.rig)?;
        let rig = with_effects(arguments, nominal.clone())?;
        let added = recorded::added_effects(&nominal, &rig);
        let mission = files::mission(&arguments.mission, &arguments.rig)?;
        let seeing = seeing(arguments, &rig, &mission)?;
        Ok(Self { port, nominal, rig, added, mission, seeing })
    }

    /// Named after all that tells this flight from others.
    fn default_recording(&self, seed: u64) -> PathBuf {
        let which = format!("seed{seed}_{}", recorded::since_1970().as_secs());
        files::default_recording(&format!("hil_{}", self.rig.name), &self.mission.name, &self.added, &which)
    }
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    let planned = Planned::read(arguments)?;
    let station = arguments.station.open(arguments.output.as_deref())?;
    let check = |output: Option<&Path>| {
        Outputs::new(arguments.force.force)
            .and(output, Form::Recording)
            .and(arguments.export.as_deref(), Form::Table)
            .check()
    };
    let Some(station) = station else {
        let output = arguments.output.clone();
        let output = output.unwrap_or_else(|| planned.default_recording(arguments.seed));
        check(Some(&output))?;
        return fly(arguments, &planned, &output).map(|(exit, _)| exit);
    };
    // What is wrong with the command is told before anything is entered.
    check(None)?;
    let flight = Single {
        command: "hil",
        mode: if planned.seeing.is_some() { "transmitter" } else { "loopback" },
        nominal: &planned.nominal,
        added: &planned.added,
        mission: &planned.mission,
        seed: arguments.seed,
        meta: &arguments.meta,
    };
    station.fly(&flight, |recording| fly(arguments, &planned, recording))
}

/// Flies and records to `output`; how it ended, also in a sentence.
#[expect(clippy::too_many_lines, reason = "one step of a flight after the other")]
fn fly(arguments: &Arguments, planned: &Planned, output: &Path) -> anyhow::Result<(Exit, String)> {
    let Planned { port, nominal, rig, added, mission, seeing } = planned;
    let stop = Arc::new(AtomicBool::new(false));
    let (progress, mut screen) = Screen::new();
    let (ready_sender, ready) = mpsc::channel();
    let (order, orders) = mpsc::channel();
    let (landed_sender, mut landed) = unbounded_channel();
    // Signals are caught before anything can be armed.
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let mut signals = {
        let _inside = runtime.enter();
        Signals::catch()?
    };
    if arguments.end_with_parent {
        set_parent_process_death_signal(Some(rustix::process::Signal::USR1))
            .context("cannot ask to be told when the process that started this one ends")?;
    }
    // The servers' threads are started here, so that they do not inherit the loop's priority.
    let foxglove = arguments.foxglove.open()?;
    let (mut page, ends) = arguments.live.open(|| about(rig, mission))?.unzip();
    let frames = match (&page, seeing) {
        (Some(page), Some(seeing)) => Some(page.frames(&seeing.calibration)?),
        _ => None,
    };
    let thread = LoopThread {
        port: port.clone(),
        rig: rig.clone(),
        seed: arguments.seed,
        seeing: seeing.clone(),
        frames,
        ends,
        stop: Arc::clone(&stop),
        progress,
    };
    let handle = std::thread::Builder::new()
        .name("loop".to_owned())
        .spawn(move || thread.run(&ready_sender, &orders, &landed_sender))
        .context("cannot start the loop's thread")?;

    let ready = match ready.recv() {
        Ok(Ok(ready)) => ready,
        Ok(Err(error)) => {
            let _ = handle.join();
            words::fail(&error);
            not_flown(page, &error.to_string());
            return Ok((Exit::Stopped, error.to_string()));
        }
        Err(_) => {
            let _ = handle.join();
            bail!("the loop's thread ended before it was ready");
        }
    };
    let checked = ready.in_words(port);
    for line in &checked {
        crate::words::say!("{line}");
    }
    if let Some(sees) = &ready.sees {
        warn_of_other_constants(rig, sees);
    }
    let mut warning = None;
    let (mission, landed) = loop {
        let start =
            started(page.as_mut(), &runtime, &mut signals, mission, (checked.clone(), warning.take()));
        let Start { mission, changes } = match start {
            Ok(start) => start,
            Err(why) => {
                // Without an order the thread disarms and ends.
                drop(order);
                let _ = handle.join();
                crate::words::say!("not flown: {why}");
                not_flown(page, &why);
                return Ok((Exit::Stopped, why));
            }
        };
        let mut session = session(nominal, added, &mission, arguments.seed, port, &ready);
        recorded::note_changes(&mut session, &changes);
        Meta::note(arguments.meta.meta.clone(), &mut session);
        let recorder = match recorder(output, &session, foxglove.as_ref()) {
            Ok(recorder) => recorder,
            Err(error) => {
                drop(order);
                let _ = handle.join();
                not_flown(page, &error.to_string());
                return Err(error);
            }
        };
        let _ = order.send(Order::Fly(recorder, mission.clone()));
        let watching =
            watch(&mut landed, &mut screen, page.as_ref(), &mut signals, &stop, mission.duration_s());
        let landed = runtime.block_on(watching);
        // Who presses START can put the airframe into sight, and press it again.
        let waits = page.as_ref().is_some_and(Page::waits);
        let missed = landed.as_ref().filter(|_| waits).and_then(Landed::missed_marker);
        let Some(missed) = missed.map(ToString::to_string) else { break (mission, landed) };
        discard(landed, output);
        words::warn(format_args!("not armed: {missed}"));
        warning = Some(format!("Not armed: {missed}, and press START again."));
    };
    drop(order);
    let joined = handle.join();
    let (Some(landed), Ok(())) = (landed, joined) else {
        words::fail(FAILED);
        not_flown(page, FAILED);
        return Ok((Exit::Stopped, FAILED.to_owned()));
    };
    let (exit, outcome) = finish(arguments, rig, &mission, port, &ready, landed, output)?;
    let headline = outcome.headline.clone();
    if let Some(page) = page {
        runtime.block_on(page.stay(outcome, signals.next()));
    }
    Ok((exit, headline))
}

fn about(rig: &Rig, mission: &Mission) -> About {
    About {
        mode: "hil",
        rig: rig.clone(),
        mission: mission.clone(),
        real_time: true,
        views: rig.bench == Bench::Transmitter,
        truth: rig.bench == Bench::Loopback,
    }
}

/// The mission, as the operator wants it where there is a page; or why nothing is flown.
fn started(
    page: Option<&mut Page>,
    runtime: &Runtime,
    signals: &mut Signals,
    mission: &Mission,
    (checked, warning): (Vec<String>, Option<String>),
) -> Result<Start, String> {
    match page {
        None => Ok(Start { mission: mission.clone(), changes: Vec::new() }),
        Some(page) => runtime.block_on(page.start(mission, checked, warning, signals.next())),
    }
}

/// Tells the page, if there is one, that nothing is flown, and ends it.
fn not_flown(page: Option<Page>, why: &str) {
    if let Some(page) = page {
        page.close(live::not_flown(why));
    }
}

fn recorder(output: &Path, session: &Session, foxglove: Option<&Server>) -> anyhow::Result<Recorder> {
    files::make_folder(output)?;
    let observer = foxglove.map(Server::observer);
    Ok(Recorder::create_observed(output, session, Options::REAL_TIME, observer)?)
}

/// Removes the recording of a START after which nothing was flown.
fn discard(landed: Option<Landed>, output: &Path) {
    drop(landed);
    if let Err(error) = std::fs::remove_file(output) {
        words::warn(format_args!("{} holds nothing and could not be removed: {error}", output.display()));
    }
}

/// Waits for the flight to end, with the screen and the signals.
async fn watch(
    landed: &mut UnboundedReceiver<Landed>,
    shown: &mut Screen,
    page: Option<&Page>,
    signals: &mut Signals,
    stop: &AtomicBool,
    duration_s: f64,
) -> Option<Landed> {
    let mut flies = false;
    let mut screen = tokio::time::interval(REDRAWN);
    shown.begin(duration_s);
    loop {
        tokio::select! {
            landed = landed.recv() => {
                shown.end();
                return landed;
            }
            name = signals.next() => {
                if stop.swap(true, Ordering::Relaxed) {
                    if name == PARENT_ENDED {
                        continue;
                    }
                    shown.end();
                    crate::words::say!("{name} again: leaving at once; the board zeroes its outputs by itself within 300 ms");
                    std::process::exit(Exit::Stopped as i32);
                }
                shown.say(&format!("{name}: throttle to rest"));
            }
            _ = screen.tick() => {
                let flew = flies;
                flies = shown.draw();
                if let Some(page) = page.filter(|_| flies && !flew) {
                    page.stage(Stage::Flying);
                }
            }
        }
    }
}

fn finish(
    arguments: &Arguments,
    rig: &Rig,
    mission: &Mission,
    port: &str,
    ready: &Ready,
    landed: Landed,
    output: &Path,
) -> anyhow::Result<(Exit, Outcome)> {
    let Landed { outcome, safe, counts, saw, recorder } = landed;
    let finished = recorder.finish();
    let flown = match outcome {
        Ok(flown) => flown,
        Err(error) => {
            words::fail(format_args!("not armed: {error}"));
            return Ok((Exit::Stopped, live::not_flown(&format!("not armed: {error}"))));
        }
    };
    let report = Report {
        rig,
        mission,
        seed: arguments.seed,
        port,
        ready,
        flown: &flown,
        safe: &safe,
        counts,
        saw: saw.as_ref(),
        checks: bench_run::check(&mission.criteria, &flown.summary),
    };
    if arguments.json.json {
        words::print_json(&report.as_json(&finished))?;
    } else {
        words::print(&report.in_words(&finished))?;
    }
    let exit = report.exit();
    let outcome = report.outcome(&finished);
    let whole = match &finished {
        Ok(finished) if finished.dropped == 0 => true,
        Ok(finished) => {
            let records = words::count(finished.dropped, "record");
            words::warn(format_args!("{records} not recorded, the disk was too slow"));
            false
        }
        Err(error) => {
            words::fail(format_args!("flown, but not all of it recorded: {error}"));
            false
        }
    };
    if let (Some(table), Ok(_)) = (&arguments.export, &finished) {
        files::make_folder(table)?;
        let exported = export(output, table, &ExportOptions::default())
            .with_context(|| format!("cannot export to {}", table.display()))?;
        progress::note(&format!("exported {} to {}", words::tables(&exported), table.display()));
    }
    // That a flight was stopped matters more than that records are missing.
    Ok((if exit != Exit::Stopped && !whole { Exit::DataLoss } else { exit }, outcome))
}

/// The rig with the effects that were asked for, if hardware can fly it.
fn with_effects(arguments: &Arguments, mut rig: Rig) -> anyhow::Result<Rig> {
    let path = arguments.rig.display();
    match rig.bench {
        Bench::Loopback => {}
        Bench::Transmitter => {
            if !(rig.effects.is_empty() && arguments.effects.is_empty()) {
                bail!(
                    "{path} flies the real airframe, to which no effect can be added; leave effects out, or fly {}",
                    files::LOOPBACK_RIG
                );
            }
        }
        Bench::Virtual => {
            bail!("{path} has no hardware in it; fly it with `bench sim`, or give it `bench = \"loopback\"`")
        }
    }
    for text in &arguments.effects {
        rig.effects.push(parse_effect(text)?);
    }
    for entry in &rig.effects {
        if LIBRARY.iter().any(|spec| spec.name == entry.name && spec.stage == effects::Stage::Loop) {
            bail!(
                "{} acts on the loop's time, which is real here; leave it out, or slow the link down with `bench emulate psoc5`",
                entry.name
            );
        }
    }
    // Effects are checked before anything is touched.
    Effects::from_rig(&rig, arguments.seed)?;
    Ok(rig)
}

/// How the airframe is seen, where it is a real one.
fn seeing(arguments: &Arguments, rig: &Rig, mission: &Mission) -> anyhow::Result<Option<Seeing>> {
    if rig.bench != Bench::Transmitter {
        return Ok(None);
    }
    let calibration = seen::calibration(rig, &arguments.rig)?.clone();
    seen::check_mission(mission)?;
    Ok(Some(Seeing { wanted: arguments.eyes.wanted(), settings: arguments.eyes.settings(), calibration }))
}

/// A calibration holds for the constants that it was made with.
fn warn_of_other_constants(rig: &Rig, sees: &Sees) {
    let Some(calibration) = &rig.calibration else { return };
    for (key, calibrated, device) in sees.blocks.differences(&calibration.depth) {
        words::warn(format_args!(
            "the rig's calibration has {key} = {calibrated}, this Kinect {device}; is it the one that was calibrated? \
             `bench calibrate` with its own frames"
        ));
    }
}

fn there_is() -> String {
    let paths: Vec<_> = ports::list().into_iter().map(|port| port.path).collect();
    if paths.is_empty() {
        "this machine has no serial port (`bench emulate psoc5` makes one)".to_owned()
    } else {
        format!("there is {}", paths.join(", "))
    }
}

fn session(rig: &Rig, added: &[String], mission: &Mission, seed: u64, port: &str, ready: &Ready) -> Session {
    let host = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let extra = [
        (Session::ADDED_EFFECTS, added.join("; ")),
        ("started_unix_s", recorded::since_1970().as_secs().to_string()),
        ("host", host.trim().to_owned()),
        ("port", port.to_owned()),
        ("board", ready.identity.to_string()),
        ("loop_calibration", ready.calibration.to_string()),
        ("scheduling", ready.granted.to_string()),
    ];
    let sees =
        ready.sees.as_ref().map(|sees| [("kinect", sees.to_string()), ("tracker", "Kinect".to_owned())]);
    let extra = extra.into_iter().chain(sees.into_iter().flatten());
    Session {
        seed: Some(seed),
        // The loop's clock starts as soon as the recorder is there.
        epoch_unix_ns: u64::try_from(recorded::since_1970().as_nanos()).ok(),
        extra: extra.map(|(key, value)| (key.to_owned(), value)).collect::<BTreeMap<_, _>>(),
        ..Session::new(Mode::Hil).with_rig(rig).with_mission(mission)
    }
}
