//! Measures the tracker against the renderer's truth: accuracy over the working volume, how often the marker is found, and how
//! often something else is. Prints JSON for `tools/tracker`.
//!
//! `survey accuracy`, `survey clutter`: the figures. `survey dump FOLDER COUNT`: frames for other chains, Bayer and true pixel.
//! `survey time FOLDER`: seconds a frame of this tracker on dumped frames, one a line.

use std::{
    fmt::Write as _,
    fs,
    path::{Path, PathBuf},
    time::Instant,
};

use bench_device::{Time, TrackStatus};
use bench_kinect::{
    Frame,
    camera::Camera,
    frame::{PACKED_DEPTH_BYTES, PIXELS, pack_depth, unpack_depth},
    render::{
        Pose, Renderer, Settings,
        scene::{RED, Scene},
    },
    track::{DepthFrom, Tracker},
};
use bench_rig::{Calibration, Rig};
use nalgebra::{UnitQuaternion, Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::json;

/// Camera to marker along the camera's axis, m.
const DISTANCES_M: [f64; 8] = [0.8, 1.0, 1.25, 1.5, 1.75, 2.0, 2.5, 3.0];
const SIDEWAYS_M: f64 = 0.6;
const SPEED_MAX_M_S: f64 = 2.0;
const TILT_MAX_RAD: f64 = 0.15;
const HEADING_MAX_RAD: f64 = 0.4;
/// Frames of one straight flight, and flights at each distance.
const FRAMES: usize = 11;
const FLIGHTS: u64 = 80;
const PERIOD_S: f64 = 1.0 / 30.0;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match arguments.iter().map(String::as_str).collect::<Vec<_>>().as_slice() {
        ["accuracy"] => println!("{}", accuracy()),
        ["clutter"] => println!("{}", clutter()),
        ["dump", folder, count] => dump(Path::new(folder), count.parse()?)?,
        ["time", folder] => time(Path::new(folder))?,
        _ => return Err("usage: survey accuracy | clutter | dump FOLDER COUNT | time FOLDER".into()),
    }
    Ok(())
}

fn calibration() -> Calibration {
    let rig = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs/virtual.toml");
    Rig::load(rig).expect("the rig reads").calibration.expect("the rig has a calibration")
}

/// A straight flight that stays in view, about a distance from the camera: poses frame by frame.
fn flight(camera: &Camera, calibration: &Calibration, distance_m: f64, rng: &mut ChaCha8Rng) -> Vec<Pose> {
    let origin = Vector3::from(calibration.camera_position_m);
    loop {
        let direction = UnitQuaternion::from_euler_angles(0.0, 0.0, rng.random_range(-3.2..3.2))
            * Vector3::new(1.0, 0.0, rng.random_range(-1.0..1.0)).normalize();
        let velocity_m_s = direction * rng.random_range(0.0..SPEED_MAX_M_S);
        let middle = origin
            + Vector3::new(
                distance_m,
                rng.random_range(-SIDEWAYS_M..SIDEWAYS_M),
                rng.random_range(-0.6..0.6) - calibration.marker_offset_m[2],
            );
        let tilt = |rng: &mut ChaCha8Rng| rng.random_range(-TILT_MAX_RAD..TILT_MAX_RAD);
        let heading = rng.random_range(-HEADING_MAX_RAD..HEADING_MAX_RAD);
        let attitude = UnitQuaternion::from_euler_angles(tilt(rng), tilt(rng), heading);
        let start = Time::from_seconds(1.0);
        let poses: Vec<Pose> = (0..FRAMES)
            .map(|i| {
                let time_s = i as f64 * PERIOD_S;
                let from_middle_s = time_s - 0.5 * (FRAMES - 1) as f64 * PERIOD_S;
                Pose {
                    time: start.shifted(time_s),
                    position_m: middle + velocity_m_s * from_middle_s,
                    velocity_m_s,
                    attitude,
                    body_rate_rad_s: Vector3::zeros(),
                }
            })
            .collect();
        let in_view = |pose: &Pose| {
            let at = marker_px(camera, pose);
            // Half the marker, its blur and the shutter's shear on every side.
            let room = 60.0;
            (room..640.0 - room).contains(&at.x) && (room..480.0 - room).contains(&at.y)
        };
        if poses.iter().all(in_view) && poses.iter().all(|pose| pose.position_m.z > 0.0) {
            return poses;
        }
    }
}

fn marker_m(camera: &Camera, pose: &Pose, at: Time) -> Vector3<f64> {
    pose.position_m + pose.velocity_m_s * at.since_s(pose.time) + pose.attitude * camera.marker_offset_m
}

fn marker_px(camera: &Camera, pose: &Pose) -> Vector2<f64> {
    let point = camera.to_camera(&marker_m(camera, pose, pose.time));
    camera.colour_pixel(&point).unwrap_or(Vector2::new(-1.0, -1.0))
}

/// Whether no red thing of the room is behind the marker or beside it: merged they are one red blob to any such tracker.
fn is_clear(camera: &Camera, scene: &Scene, pose: &Pose) -> bool {
    let at = marker_px(camera, pose);
    let z_m = camera.to_camera(&pose.position_m).z;
    let room = 0.5 * 560.0 * (camera.marker_side_m + 0.02) / z_m + 6.0;
    scene.surfaces.iter().filter(|surface| surface.albedo == RED).all(|surface| {
        let corners = [(0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0)].map(|(a, b)| {
            let corner = surface.corner_m + surface.across_m * a + surface.up_m * b;
            camera.colour_pixel(&camera.to_camera(&corner)).unwrap_or(Vector2::new(-1e3, -1e3))
        });
        let low = corners.iter().fold(Vector2::repeat(f64::MAX), |low, corner| low.inf(corner));
        let high = corners.iter().fold(Vector2::repeat(f64::MIN), |high, corner| high.sup(corner));
        at.x + room < low.x || at.x - room > high.x || at.y + room < low.y || at.y - room > high.y
    })
}

fn accuracy() -> serde_json::Value {
    let calibration = calibration();
    let camera = Camera::new(&calibration);
    let scene = Scene::with_distractors();
    let mut renderer = Renderer::new(&calibration, &scene, Settings::default(), 11);
    let (mut rows, mut frame) = (Vec::new(), Frame::default());
    for (number, distance_m) in DISTANCES_M.into_iter().enumerate() {
        let mut rng = ChaCha8Rng::seed_from_u64(number as u64);
        let (mut clear, mut found, mut ambiguous, mut wrong, mut by_size) = (0, 0, 0, 0, 0);
        let (mut errors, mut sigmas) = (Vec::new(), Vec::new());
        for _ in 0..FLIGHTS {
            let mut tracker = Tracker::new(&calibration);
            let mut was_clear = false;
            for pose in flight(&camera, &calibration, distance_m, &mut rng) {
                renderer.render(pose.time, Some(&pose), &mut frame);
                let sighting = tracker.track(&frame, pose.time);
                // A new marker is believed in its second frame.
                let is_clear = is_clear(&camera, &scene, &pose);
                if !(std::mem::replace(&mut was_clear, is_clear) && is_clear) {
                    continue;
                }
                clear += 1;
                if sighting.status == TrackStatus::Lost {
                    continue;
                }
                ambiguous += usize::from(sighting.status == TrackStatus::Ambiguous);
                let seen = Vector3::from(sighting.position_m) + camera.marker_offset_m;
                let error =
                    camera.rotation().transpose() * (seen - marker_m(&camera, &pose, sighting.exposed_at));
                if error.norm() > 0.15 {
                    wrong += 1;
                    continue;
                }
                found += 1;
                by_size += usize::from(sighting.depth_from == DepthFrom::Size);
                sigmas.push([0, 1, 2].map(|i| sighting.covariance_m2[i][i].sqrt()));
                errors.push(error);
            }
        }
        let count = errors.len() as f64;
        let bias: Vector3<f64> = errors.iter().sum::<Vector3<f64>>() / count;
        let rms = (errors.iter().map(|e| e.component_mul(e)).sum::<Vector3<f64>>() / count).map(f64::sqrt);
        let sigma_z = sigmas.iter().map(|s| s[0]).sum::<f64>() / count;
        rows.push(json!({
            "distance_m": distance_m, "clear": clear, "found": found, "ambiguous": ambiguous, "wrong": wrong,
            "by_size": by_size,
            "bias_mm": (bias * 1e3).as_slice(), "rms_mm": (rms * 1e3).as_slice(), "stated_depth_sigma_mm": sigma_z * 1e3,
        }));
    }
    json!({ "rows": rows })
}

/// A thousand frames of a hundred rooms without a marker, full of red things, each room looked at for ten frames.
fn clutter() -> serde_json::Value {
    let calibration = calibration();
    let (mut false_finds, mut frames, mut candidates, mut reasons) =
        (0, 0, 0, std::collections::BTreeMap::new());
    let mut frame = Frame::default();
    for room in 0..100 {
        let scene = Scene::cluttered(room, 20);
        let mut renderer = Renderer::new(&calibration, &scene, Settings::default(), room);
        let mut tracker = Tracker::new(&calibration);
        for i in 0..10 {
            let time = Time::from_seconds(1.0 + f64::from(i) * PERIOD_S);
            renderer.render(time, None, &mut frame);
            let sighting = tracker.track(&frame, time);
            frames += 1;
            candidates += tracker.candidates().len();
            if sighting.status != TrackStatus::Lost {
                false_finds += 1;
            }
            for candidate in tracker.candidates() {
                *reasons.entry(format!("{:?}", candidate.rejection)).or_insert(0) += 1;
            }
        }
    }
    json!({ "frames": frames, "red_blobs": candidates, "false_finds": false_finds, "reasons": reasons })
}

/// Frames of flights at all distances among distractors: `NNNN.bayer`, `NNNN.depth` (packed) and `truth.csv`.
fn dump(folder: &Path, count: usize) -> Result<(), Box<dyn std::error::Error>> {
    fs::create_dir_all(folder)?;
    let calibration = calibration();
    let camera = Camera::new(&calibration);
    let mut renderer = Renderer::new(&calibration, &Scene::with_distractors(), Settings::default(), 12);
    let mut rng = ChaCha8Rng::seed_from_u64(99);
    let (mut frame, mut packed) = (Frame::default(), vec![0; PACKED_DEPTH_BYTES]);
    let mut truth = String::from("frame,column_px,row_px\n");
    let mut made = 0;
    while made < count {
        let distance_m = DISTANCES_M[made / FRAMES % DISTANCES_M.len()];
        for pose in flight(&camera, &calibration, distance_m, &mut rng).into_iter().take(count - made) {
            renderer.render(pose.time, Some(&pose), &mut frame);
            pack_depth(&frame.depth, &mut packed)?;
            fs::write(folder.join(format!("{made:04}.bayer")), &frame.colour)?;
            fs::write(folder.join(format!("{made:04}.depth")), &packed)?;
            let at = marker_px(&camera, &pose);
            writeln!(truth, "{made},{:.3},{:.3}", at.x, at.y)?;
            made += 1;
        }
    }
    fs::write(folder.join("truth.csv"), truth)?;
    Ok(())
}

fn files(folder: &Path, ending: &str) -> Result<Vec<PathBuf>, std::io::Error> {
    let mut paths: Vec<PathBuf> =
        fs::read_dir(folder)?.map(|entry| entry.map(|entry| entry.path())).collect::<Result<_, _>>()?;
    paths.retain(|path| path.extension().is_some_and(|found| found == ending));
    paths.sort();
    Ok(paths)
}

/// Times the tracker and the unpacking, each frame once, in order; the frames are in memory before the clock starts.
fn time(folder: &Path) -> Result<(), Box<dyn std::error::Error>> {
    let colours = files(folder, "bayer")?.iter().map(fs::read).collect::<Result<Vec<_>, _>>()?;
    let depths = files(folder, "depth")?.iter().map(fs::read).collect::<Result<Vec<_>, _>>()?;
    let mut tracker = Tracker::new(&calibration());
    let mut frame = Frame::default();
    let (mut track_s, mut unpack_s, mut found) = (Vec::new(), Vec::new(), 0);
    for round in 0..2 {
        for (i, (colour, depth)) in colours.iter().zip(&depths).enumerate() {
            assert_eq!(colour.len(), PIXELS, "a frame has a byte a pixel");
            if i % FRAMES == 0 {
                tracker.forget();
            }
            frame.colour.copy_from_slice(colour);
            let began = Instant::now();
            unpack_depth(depth, &mut frame.depth)?;
            let unpacked = began.elapsed().as_secs_f64();
            let at = Time::from_seconds(1.0 + (i % FRAMES) as f64 * PERIOD_S);
            let began = Instant::now();
            let sighting = tracker.track(&frame, at);
            let tracked = began.elapsed().as_secs_f64();
            // The first round warms up.
            if round == 1 {
                track_s.push(tracked);
                unpack_s.push(unpacked);
                found += usize::from(sighting.status != TrackStatus::Lost);
            }
        }
    }
    println!("{}", json!({ "track_s": track_s, "unpack_s": unpack_s, "found": found }));
    Ok(())
}
