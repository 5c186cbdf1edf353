//! Frames of a real Kinect.

use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread,
    time::Duration,
};

use anyhow::{Context, bail};
use bench_device::Clock as _;
use bench_kinect::{FrameSource, fakenect::Recorder, usb};
use bench_run::WallClock;
use serde_json::json;
use tokio::signal::unix::{SignalKind, signal};

use super::Arguments;
use crate::{exit::Exit, eyes, progress::Progress, words};

/// How long to wait when no frame is there.
const PAUSE: Duration = Duration::from_millis(2);

/// Records until told to stop, for so long, or until the Kinect is gone; what was recorded stays.
pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    let Some(folder) = &arguments.output else { bail!("name a folder for the frames with -o") };
    // Also refuses NaN.
    if !(arguments.seconds > 0.0 && arguments.seconds.is_finite()) {
        bail!("--seconds must be above 0");
    }
    let stop = stop_on_signal()?;
    let kinect = match usb::open(&arguments.eyes.wanted()) {
        Ok(kinect) => kinect,
        Err(error) => {
            words::fail(format_args!("{error}"));
            return Ok(Exit::Stopped);
        }
    };
    crate::words::say!("{}, serial number {}", kinect.model(), kinect.serial());
    let clock = WallClock::start();
    let origin_s = crate::recorded::since_1970().as_secs_f64();
    // Before the streams: what is in the way should not cost frames.
    let mut recorder = Recorder::create(folder, origin_s)?;
    let mut streaming = match kinect.stream(arguments.eyes.settings(), move || clock.now()) {
        Ok(streaming) => streaming,
        Err(error) => {
            words::fail(format_args!("{error}"));
            return Ok(Exit::Stopped);
        }
    };
    let progress = Progress::of("record-frames");
    progress.begin("recording (Ctrl-C ends it)", arguments.seconds, "s");
    let mut failed = None;
    while clock.now().seconds() < arguments.seconds && !stop.load(Ordering::Relaxed) {
        match streaming.poll_frame() {
            Ok(Some(frame)) => {
                recorder.write(frame)?;
                progress.at(frame.arrived_at.seconds());
            }
            Ok(None) => thread::sleep(PAUSE),
            Err(error) => {
                failed = Some(error);
                break;
            }
        }
    }
    drop(progress);
    let statistics = streaming.statistics();
    let frames = recorder.finish()?;
    if arguments.json.json {
        words::print_json(&json!({
            "schema": "bench.record-frames/1",
            "folders": [{ "folder": folder, "frames": frames }],
            "kinect": eyes::as_json(&statistics),
            "ended": failed.as_ref().map(ToString::to_string),
        }))?;
    } else {
        let frames = words::count(frames as u64, "frame");
        words::print(&format!(
            "{frames} in {}\n  Kinect: {}",
            folder.display(),
            eyes::in_words(&statistics)
        ))?;
    }
    if let Some(error) = failed {
        words::fail(format_args!("{error}; what came before is recorded"));
        return Ok(Exit::Stopped);
    }
    if statistics.overrun > 0 {
        words::warn(format_args!(
            "{} not recorded, the disk was too slow",
            words::count(statistics.overrun, "image")
        ));
        return Ok(Exit::DataLoss);
    }
    Ok(Exit::Done)
}

/// Set by Ctrl-C and `kill`.
fn stop_on_signal() -> anyhow::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&stop);
    let runtime = tokio::runtime::Builder::new_current_thread().enable_io().build()?;
    let mut signals = {
        let _inside = runtime.enter();
        (signal(SignalKind::interrupt())?, signal(SignalKind::terminate())?)
    };
    thread::Builder::new()
        .name("signals".to_owned())
        .spawn(move || {
            runtime.block_on(async {
                tokio::select! {
                    _ = signals.0.recv() => {}
                    _ = signals.1.recv() => {}
                }
            });
            flag.store(true, Ordering::Relaxed);
        })
        .context("cannot start a thread for signals")?;
    Ok(stop)
}
