use std::{fmt::Write as _, path::PathBuf};

use anyhow::bail;
use bench_device::TrackStatus;
use bench_kinect::{
    fakenect::Replay,
    track::{DepthFrom, Sighting, Tracker},
};
use bench_rig::Rig;
use clap::Args;
use serde_json::json;

use crate::{
    arguments::{Force, Json},
    exit::Exit,
    files::{self, Form, Outputs},
    progress::Progress,
    seen::{self, Watch},
    words,
};

/// Track the marker in recorded frames (a folder made by `bench record-frames` or libfreenect's recorder)
#[derive(Args)]
#[command(after_help = "Examples:
  bench track frames/
  bench track frames/ --views views/ --csv positions.csv
  bench track frames/ --rig virtual --json

Exit code 1 says that the marker was found in no frame.")]
pub struct Arguments {
    /// Folder of recorded frames, with INDEX.txt
    folder: PathBuf,
    /// Rig whose calibration is believed: a file, or the name of a built-in one [default: the rig.toml that the bench
    /// wrote beside the frames]
    #[arg(long, value_name = "RIG")]
    rig: Option<PathBuf>,
    /// Write the positions as CSV
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Draw the three views of frames into this folder as PNG
    #[arg(long, value_name = "FOLDER")]
    views: Option<PathBuf>,
    /// Draw the first of every so many frames
    #[arg(long, default_value_t = 15, value_name = "FRAMES", value_parser = clap::value_parser!(u64).range(1..))]
    views_every: u64,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    json: Json,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    Outputs::new(arguments.force.force)
        .and(arguments.csv.as_deref(), Form::Csv)
        .and(arguments.views.as_deref(), Form::Folder)
        .check()?;
    let mut replay = Replay::open(&arguments.folder)?;
    let (rig, path) = rig(arguments)?;
    let calibration = seen::calibration(&rig, &path)?;
    let mut watch = Watch::new(arguments.views.as_deref(), arguments.views_every)?;
    let mut tracker = Tracker::new(calibration);
    let mut rows = Vec::with_capacity(replay.frames());
    let progress = Progress::of("track");
    progress.begin("looking", replay.frames() as f64, "frames");
    while let Some(frame) = replay.next_frame()? {
        let exposed_at = frame.arrived_at.shifted(-rig.tracker.latency_s.value);
        let sighting = tracker.track(frame, exposed_at);
        watch.see(frame, &tracker, &sighting);
        rows.push((frame.arrived_at.seconds(), sighting));
        progress.step();
    }
    drop(progress);
    if let Some(path) = &arguments.csv {
        files::write(path, &as_csv(&rows))?;
    }
    if arguments.json.json {
        let positions: Vec<_> = rows
            .iter()
            .map(|(arrived_s, sighting)| {
                let found = sighting.status != TrackStatus::Lost;
                json!({
                    "arrived_s": arrived_s,
                    "status": status(sighting),
                    "position_m": found.then_some(sighting.position_m),
                    "sigma_m": found.then(|| sigmas_m(sighting)),
                    "pixel": found.then_some(sighting.pixel),
                    "size_px": found.then_some(sighting.size_px),
                })
            })
            .collect();
        words::print_json(&json!({
            "schema": "bench.track/1",
            "folder": arguments.folder,
            "unpaired_images": replay.unpaired(),
            "tracking": watch.as_json(),
            "positions": positions,
        }))?;
    } else {
        words::print(&in_words(arguments, &replay, &watch, &rows))?;
    }
    if let Some(error) = watch.failed() {
        words::fail(format_args!("not all views were drawn: {error}"));
        return Ok(Exit::DataLoss);
    }
    Ok(if watch.lost == watch.frames { Exit::CheckFailed } else { Exit::Done })
}

/// The rig that was named, or that lies beside the frames.
fn rig(arguments: &Arguments) -> anyhow::Result<(Rig, PathBuf)> {
    let beside = arguments.folder.join(seen::RIG_BESIDE_FRAMES);
    let path = match &arguments.rig {
        Some(named) => named.clone(),
        None if beside.is_file() => beside.clone(),
        None => bail!(
            "{} has frames but no {} that says how the camera sees; name a rig with --rig",
            arguments.folder.display(),
            seen::RIG_BESIDE_FRAMES
        ),
    };
    let rig = files::rig(&path)?;
    if arguments.rig.is_some() && beside.is_file() {
        let own = files::rig(&beside)?;
        if own.calibration != rig.calibration || own.tracker.latency_s != rig.tracker.latency_s {
            words::warn(format_args!(
                "calibration or latency of {} are not those of {}, by which the frames were recorded",
                path.display(),
                beside.display()
            ));
        }
    }
    Ok((rig, path))
}

fn status(sighting: &Sighting) -> &'static str {
    match sighting.status {
        TrackStatus::Found => "found",
        TrackStatus::Lost => "lost",
        TrackStatus::Ambiguous => "ambiguous",
    }
}

fn sigmas_m(sighting: &Sighting) -> [f64; 3] {
    [0, 1, 2].map(|axis| sighting.covariance_m2[axis][axis].sqrt())
}

fn as_csv(rows: &[(f64, Sighting)]) -> String {
    let mut out = String::from("arrived_s,status,x_m,y_m,z_m,x_sigma_m,y_sigma_m,z_sigma_m,depth_from\n");
    for (arrived_s, sighting) in rows {
        // Writing to a String cannot fail.
        let _ = if sighting.status == TrackStatus::Lost {
            writeln!(out, "{arrived_s:.6},lost,,,,,,,")
        } else {
            let [x, y, z] = sighting.position_m;
            let [sx, sy, sz] = sigmas_m(sighting);
            let from = match sighting.depth_from {
                DepthFrom::Disparity => "disparity",
                DepthFrom::Size => "size",
            };
            writeln!(
                out,
                "{arrived_s:.6},{},{x:.5},{y:.5},{z:.5},{sx:.5},{sy:.5},{sz:.5},{from}",
                status(sighting)
            )
        };
    }
    out
}

fn in_words(arguments: &Arguments, replay: &Replay, watch: &Watch, rows: &[(f64, Sighting)]) -> String {
    let mut out = format!("{}: {:.1} s\n", arguments.folder.display(), rows.last().map_or(0.0, |row| row.0));
    out += &watch.in_words();
    if replay.unpaired() > 0 {
        let _ = writeln!(
            out,
            "  left out: {} without a partner of the same time",
            words::count(replay.unpaired() as u64, "image")
        );
    }
    let found: Vec<_> = rows.iter().filter(|(_, sighting)| sighting.status != TrackStatus::Lost).collect();
    for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
        let values = || found.iter().map(|(_, sighting)| sighting.position_m[axis]);
        if let (Some(low), Some(high)) = (values().reduce(f64::min), values().reduce(f64::max)) {
            let mean = values().sum::<f64>() / found.len() as f64;
            let _ = writeln!(out, "  {name}  mean {mean:>7.4} m, {low:>7.4} to {high:>7.4}");
        }
    }
    out
}
