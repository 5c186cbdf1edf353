//! A camera that stands elsewhere than believed, found out from recorded frames.

use std::{fmt::Write as _, path::Path};

use bench_device::Time;
use bench_kinect::{
    Frame, KinectError,
    calibrate::{MIN_PLACES, Place, Seen, calibrate, latency, look, read_places, read_reference},
    camera::Camera,
    fakenect::Recorder,
    render::{Pose, Renderer, Settings, scene::Scene},
};
use bench_rig::{Calibration, Rig, Uncertain};
use nalgebra::Vector3;
use tempfile::tempdir;

fn believed() -> Calibration {
    let rig = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs/virtual.toml");
    Rig::load(rig).unwrap().calibration.unwrap()
}

/// The camera as it really stands and measures.
fn truth() -> Calibration {
    Calibration {
        camera_position_m: [-1.9, 0.06, 0.64],
        camera_attitude_rad: [-0.03, -0.02, 0.015],
        depth_scale: Uncertain::exact(1.02),
        depth_bias_m: Uncertain::exact(-0.012),
        ..believed()
    }
}

const PLACES_M: [[f64; 3]; 12] = [
    [-1.0, -0.2, 0.5],
    [-0.9, 0.25, 0.8],
    [-0.6, 0.3, 0.4],
    [-0.5, -0.35, 0.9],
    [-0.1, 0.5, 0.9],
    [0.0, -0.5, 0.4],
    [0.1, 0.0, 0.6],
    [0.5, 0.5, 0.4],
    [0.5, -0.6, 1.1],
    [0.9, 0.0, 0.8],
    [1.0, 0.6, 1.2],
    [1.1, -0.5, 0.5],
];

/// What the true camera sees of a place, without rendering: for what only the fit has to be asked.
fn seen(place_m: [f64; 3]) -> Seen {
    let camera = Camera::new(&truth());
    let point = camera.to_camera(&place_m.into());
    let pixel = camera.colour_pixel(&point).unwrap();
    Seen { frames: 10, found: 10, pixel: pixel.into(), z_m: (point.z + 0.012) / 1.02, z_sigma_m: 0.001 }
}

fn place(place_m: [f64; 3]) -> Place {
    Place { folder: "x".into(), measured_m: place_m }
}

#[test]
fn exact_sightings_give_the_camera_back_exactly() {
    let places = PLACES_M.map(|at| (place(at), seen(at))).to_vec();
    let report = calibrate(&believed(), places).unwrap();
    let (found, truth) = (&report.calibration, truth());
    for axis in 0..3 {
        assert!((found.camera_position_m[axis] - truth.camera_position_m[axis]).abs() < 1e-6);
        assert!((found.camera_attitude_rad[axis] - truth.camera_attitude_rad[axis]).abs() < 1e-7);
    }
    assert!((found.depth_scale.value - 1.02).abs() < 1e-7 && (found.depth_bias_m.value + 0.012).abs() < 1e-6);
    assert!(report.met() && report.all.rms_m.iter().all(|rms| *rms < 1e-6));
    let file = tempdir().unwrap().keep().join("k.toml");
    std::fs::write(&file, found.to_toml()).unwrap();
    assert_eq!(&Calibration::load(&file).unwrap(), found);
}

#[test]
fn a_place_that_was_measured_wrong_shows_where_it_is_and_5_mm_is_not_met() {
    let mut places = PLACES_M.map(|at| (place(at), seen(at))).to_vec();
    places[6].0.measured_m[1] += 0.03;
    let report = calibrate(&believed(), places).unwrap();
    assert!(!report.met());
    let worst = (0..12).max_by(|a, b| {
        let size = |i: &usize| Vector3::from(report.places[*i].residual_m).norm();
        size(a).total_cmp(&size(b))
    });
    assert_eq!(worst, Some(6));
    // Tracked less measured, foretold by the others: all of the 3 cm.
    assert!((report.places[6].residual_m[1] + 0.03).abs() < 1e-5);
}

#[test]
fn places_that_do_not_determine_a_camera_are_refused() {
    let few = PLACES_M[..MIN_PLACES - 1].iter().map(|at| (place(*at), seen(*at))).collect();
    assert!(calibrate(&believed(), few).unwrap_err().to_string().contains("at least 6"));
    // All at one depth: pose and scale cannot be told apart.
    let flat = (0..8)
        .map(|i| [0.0, f64::from(i % 3) * 0.02, 0.5 + f64::from(i / 3) * 0.02])
        .map(|at| (place(at), seen(at)))
        .collect();
    assert!(calibrate(&believed(), flat).unwrap_err().to_string().contains("spread them"));
}

#[test]
fn recorded_frames_of_places_and_of_a_motion_calibrate_to_5_mm() {
    let folder = tempdir().unwrap();
    let truth = truth();
    let mut renderer = Renderer::new(&truth, &Scene::bare(), Settings::default(), 3);
    let offset = Vector3::from(truth.marker_offset_m);
    let mut frame = Frame::default();
    let mut table = String::from("folder, x_m, y_m, z_m\n# by tape measure\n");
    for (number, at) in PLACES_M.iter().enumerate() {
        let mut recorder = Recorder::create(folder.path().join(format!("p{number}")), 1e9).unwrap();
        for i in 0..7 {
            let time = Time::from_seconds(f64::from(i) / 30.0);
            renderer.render(time, Some(&Pose::at_rest(time, Vector3::from(*at) - offset)), &mut frame);
            frame.arrived_at = time.shifted(0.2);
            recorder.write(&frame).unwrap();
        }
        recorder.finish().unwrap();
        writeln!(table, "p{number}, {}, {}, {}", at[0], at[1], at[2]).unwrap();
    }
    let path = folder.path().join("places.csv");
    std::fs::write(&path, table).unwrap();
    let places = read_places(&path).unwrap().into_iter().map(|place| {
        let seen = look(&place, &believed()).unwrap();
        (place, seen)
    });
    let report = calibrate(&believed(), places.collect()).unwrap();
    assert!(report.met(), "{:?}", report.all);
    // What counts is where it puts the marker: within 5 mm of the truth all over the volume.
    let (found, truth_camera) = (Camera::new(&report.calibration), Camera::new(&truth));
    for at in PLACES_M {
        let place_m = Vector3::from(at) * 0.9;
        let point = truth_camera.to_camera(&place_m);
        let raw = truth_camera.disparity().raw(point.z);
        let pixel = truth_camera.colour_pixel(&point).unwrap();
        let told = found.to_world(&found.from_colour(pixel, found.disparity().depth_m(raw).unwrap()));
        assert!((told - place_m).norm() < 0.005 * 3.0_f64.sqrt(), "{told} for {place_m}");
    }

    // A swing of 30 cm, seen 0.2 s late.
    let swing = |time_s: f64| Vector3::new(0.0, 0.3 * (4.0 * time_s).sin(), 0.5);
    let moving = folder.path().join("moving");
    let mut recorder = Recorder::create(&moving, 1e9).unwrap();
    for i in 0..45 {
        let time = Time::from_seconds(2.0 + f64::from(i) / 30.0);
        let velocity_m_s = Vector3::new(0.0, 1.2 * (4.0 * time.seconds()).cos(), 0.0);
        let pose = Pose { velocity_m_s, ..Pose::at_rest(time, swing(time.seconds()) - offset) };
        renderer.render(time, Some(&pose), &mut frame);
        frame.arrived_at = time.shifted(0.2);
        recorder.write(&frame).unwrap();
    }
    recorder.finish().unwrap();
    let reference: Vec<_> =
        (0..500).map(|i| f64::from(i) * 0.01).map(|t| (1e9 + t, swing(t).into())).collect();
    let measured = latency(&report.calibration, &moving, &reference).unwrap();
    // A millimetre at 1.2 m/s is 0.8 ms; 43 frames average it. Five of the stated sigmas and the table's step.
    assert!((measured.value - 0.2).abs() < 5.0 * measured.sigma + 0.0005, "{measured:?}");
    assert!(measured.sigma < 0.002, "{measured:?}");

    let still: Vec<_> = (0..500).map(|i| (1e9 + f64::from(i) * 0.01, [0.0; 3])).collect();
    let error = latency(&report.calibration, &moving, &still).unwrap_err().to_string();
    assert!(error.contains("does not tell the latency"), "{error}");
}

#[test]
fn wrong_tables_are_named_by_line() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("t.csv");
    let read = |text: &str| {
        std::fs::write(&path, text).unwrap();
        (read_places(&path).map_err(|e| e.to_string()), read_reference(&path).map_err(|e| e.to_string()))
    };
    let (places, _) = read("folder,x_m,y_m\na,1,2\n");
    assert!(places.unwrap_err().contains("no column z_m"));
    let (places, _) = read("folder,x_m,y_m,z_m\na,1,2,3\nb,1,nan,3\n");
    assert!(places.unwrap_err().contains("t.csv:3: y_m is \"nan\""));
    let (_, reference) = read("time_s,x_m,y_m,z_m\n1,0,0,0\n1,0,0,0\n");
    assert!(reference.unwrap_err().contains("t.csv:3: time_s = 1 is not later"));
    let (_, reference) = read("time_s,x_m,y_m,z_m\n1,0,0\n");
    assert!(reference.unwrap_err().contains("t.csv:2"));
    assert!(matches!(read_places(&folder.path().join("none")), Err(KinectError::File { .. })));
}
