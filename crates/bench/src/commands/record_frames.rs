mod live;

use std::{
    fmt::Write as _,
    path::{Path, PathBuf},
};

use anyhow::bail;
use bench_device::Time;
use bench_kinect::{
    Frame,
    calibrate::{Place, read_places},
    fakenect::Recorder,
    render::{Pose, scene::Scene},
};
use bench_recording::Record;
use bench_rig::{Calibration, Mission, Rig};
use bench_run::simulate_seen;
use clap::{ArgGroup, Args};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use serde_json::json;

use crate::{
    arguments::{Json, RigArgument},
    exit::Exit,
    eyes::Eyes,
    files::{self, Form, Outputs},
    progress::Progress,
    seen, words,
};

/// Record frames of a Kinect or of the virtual lab, in the folder format of libfreenect's recorder
#[derive(Args)]
#[command(group = ArgGroup::new("what").required(true).args(["positions", "mission", "kinect"]))]
#[command(after_help = "Examples:
  bench record-frames --kinect 0 --exposure-ms 10 --seconds 2 -o p01/
  bench record-frames --positions places.csv --bare
  bench record-frames --mission steps --from-s 5 --seconds 8 -o flight/

With --kinect a real Kinect is recorded, until Ctrl-C or the end of --seconds. With --positions
the marker is put where the table says, and each row's frames go to the folder that it names,
beside the table: what `bench calibrate` reads. With --mission the frames are those of a flight,
and reference.csv has the marker's true way. A second of frames takes 46 MB.")]
pub struct Arguments {
    /// Table of places: CSV with a column `folder` and the marker's centre
    #[arg(long, value_name = "CSV")]
    positions: Option<PathBuf>,
    /// Mission to fly
    #[arg(long, requires = "output")]
    mission: Option<String>,
    #[command(flatten)]
    eyes: Eyes,
    /// Folder for the frames of a flight or of a Kinect
    #[arg(short, long, value_name = "FOLDER")]
    output: Option<PathBuf>,
    #[command(flatten)]
    rig: RigArgument,
    /// Frames at each place
    #[arg(long, default_value_t = 15, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    frames: u32,
    /// Leave the room's red distractors out
    #[arg(long, requires = "positions")]
    bare: bool,
    /// When to begin in a flight
    #[arg(long, default_value_t = 0.0, conflicts_with = "kinect")]
    from_s: f64,
    /// How long to record a flight or a Kinect
    #[arg(long, default_value_t = 10.0)]
    seconds: f64,
    /// Seed of everything random
    #[arg(long, default_value_t = 0)]
    seed: u64,
    #[command(flatten)]
    json: Json,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    Outputs::new(false).and(arguments.output.as_deref(), Form::Folder).check()?;
    if arguments.eyes.named() {
        return live::run(arguments);
    }
    let rig = arguments.rig.load()?;
    let calibration = seen::calibration(&rig, arguments.rig.path())?;
    let recorded = match (&arguments.positions, &arguments.mission, &arguments.output) {
        (Some(table), ..) => places(arguments, &rig, calibration, &read_places(table)?)?,
        (None, Some(mission), Some(folder)) => {
            vec![flight(
                arguments,
                &rig,
                calibration,
                &files::mission(mission, arguments.rig.path())?,
                folder,
            )?]
        }
        // The argument parser asks for one of them.
        _ => bail!("name a table with --positions, or a mission with --mission and a folder with -o"),
    };
    let frames: usize = recorded.iter().map(|(_, frames)| frames).sum();
    if arguments.json.json {
        let folders: Vec<_> =
            recorded.iter().map(|(folder, frames)| json!({ "folder": folder, "frames": frames })).collect();
        words::print_json(&json!({ "schema": "bench.record-frames/1", "folders": folders }))?;
    } else {
        let folders = words::count(recorded.len() as u64, "folder");
        words::print(&format!("{} in {folders}", words::count(frames as u64, "frame")))?;
    }
    Ok(Exit::Done)
}

type Recorded = (PathBuf, usize);

/// The marker at rest at each place, level and facing the camera.
fn places(
    arguments: &Arguments,
    rig: &Rig,
    calibration: &Calibration,
    places: &[Place],
) -> anyhow::Result<Vec<Recorded>> {
    let scene = if arguments.bare { Scene::bare() } else { Scene::with_distractors() };
    let mut renderer = seen::renderer(calibration, &scene, arguments.seed);
    let mut frame = Frame::default();
    let mut recorded = Vec::new();
    let progress = Progress::of("record-frames");
    progress.begin("rendering", places.len() as f64, "places");
    for place in places {
        let mut recorder = Recorder::create(&place.folder, 0.0)?;
        let offset = calibration.marker_offset_m;
        let position = [0, 1, 2].map(|axis| place.measured_m[axis] - offset[axis]);
        for number in 0..arguments.frames {
            let time = Time::from_seconds(1.0 + f64::from(number) * rig.tracker.frame_period_s);
            renderer.render(time, Some(&Pose::at_rest(time, position.into())), &mut frame);
            frame.arrived_at = time.shifted(rig.tracker.latency_s.value);
            recorder.write(&frame)?;
        }
        files::write(&place.folder.join(seen::RIG_BESIDE_FRAMES), &rig.to_toml())?;
        recorded.push((place.folder.clone(), recorder.finish()?));
        progress.step();
    }
    Ok(recorded)
}

/// A stretch of a flight, and the marker's true way all along it.
fn flight(
    arguments: &Arguments,
    rig: &Rig,
    calibration: &Calibration,
    mission: &Mission,
    folder: &Path,
) -> anyhow::Result<Recorded> {
    let window = arguments.from_s..arguments.from_s + arguments.seconds;
    if !(arguments.from_s >= 0.0 && arguments.seconds > 0.0 && window.end.is_finite()) {
        bail!("--from-s must be 0 or more and --seconds above 0");
    }
    seen::check_mission(mission)?;
    let mut recorder = Recorder::create(folder, 0.0)?;
    let mut failed = None;
    let mut records: Vec<Record> = Vec::new();
    let watch = |frame: &Frame, _: &_, _: &_| {
        if failed.is_none() && window.contains(&frame.arrived_at.seconds()) {
            failed = recorder.write(frame).err();
        }
    };
    let see = |exposures| seen::tracker(exposures, calibration, rig, arguments.seed, watch);
    let progress = Progress::of("record-frames");
    progress.begin("flying and rendering", window.end.min(mission.duration_s()), "s of flight");
    simulate_seen(rig, mission, arguments.seed, see, &mut records, |flown| {
        progress.at(flown.now.seconds());
        flown.now.seconds() < window.end
    })?;
    drop(progress);
    if let Some(error) = failed {
        return Err(error.into());
    }
    let mut reference = String::from("time_s,x_m,y_m,z_m\n");
    let offset = Vector3::from(calibration.marker_offset_m);
    for record in &records {
        if let Record::Truth(truth) = record {
            let [w, i, j, k] = truth.attitude;
            let attitude = UnitQuaternion::from_quaternion(Quaternion::new(w, i, j, k));
            let marker = Vector3::from(truth.position_m) + attitude * offset;
            let time_s = truth.time.seconds();
            // Writing to a String cannot fail.
            let _ = writeln!(reference, "{time_s:.6},{:.6},{:.6},{:.6}", marker.x, marker.y, marker.z);
        }
    }
    let path = folder.join("reference.csv");
    files::write(&path, &reference)?;
    files::write(&folder.join(seen::RIG_BESIDE_FRAMES), &rig.to_toml())?;
    Ok((folder.to_owned(), recorder.finish()?))
}
