//! What a bench relies on: rendered frames, tracked, give the truth back.

use std::path::Path;

use bench_device::{Time, TrackStatus};
use bench_kinect::{
    Frame,
    render::{
        Pose, Renderer, Settings,
        scene::{RED, Scene, Shape, Surface},
    },
    track::{DepthFrom, Rejection, Sighting, Tracker},
};
use bench_rig::{Calibration, Rig};
use nalgebra::{UnitQuaternion, Vector3};

fn calibration() -> Calibration {
    let rig = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs/virtual.toml");
    Rig::load(rig).unwrap().calibration.unwrap()
}

struct Lab {
    renderer: Renderer,
    tracker: Tracker,
    frame: Frame,
    now: Time,
}

impl Lab {
    fn new(scene: &Scene, settings: Settings) -> Self {
        let calibration = calibration();
        Self {
            renderer: Renderer::new(&calibration, scene, settings, 5),
            tracker: Tracker::new(&calibration),
            frame: Frame::default(),
            now: Time::from_seconds(1.0),
        }
    }

    /// The next frame, of a pose made for its time; `change` may spoil it.
    fn see(&mut self, pose: impl Fn(Time) -> Option<Pose>, change: impl Fn(&mut Frame)) -> Sighting {
        self.now = self.now.shifted(1.0 / 30.0);
        self.renderer.render(self.now, pose(self.now).as_ref(), &mut self.frame);
        change(&mut self.frame);
        self.tracker.track(&self.frame, self.now)
    }
}

fn at_rest(position: [f64; 3]) -> impl Fn(Time) -> Option<Pose> {
    move |time| Some(Pose::at_rest(time, position.into()))
}

fn untouched(_: &mut Frame) {}

#[test]
fn a_marker_at_rest_is_where_it_is_over_the_working_volume() {
    let mut lab = Lab::new(&Scene::bare(), Settings::default());
    for (x, y, z) in
        [(-1.0, 0.2, 0.5), (-0.3, -0.5, 0.3), (-0.3, 0.4, 0.9), (0.2, 0.6, 0.2), (1.2, -0.6, 1.0)]
    {
        lab.tracker.forget();
        assert_eq!(
            lab.see(at_rest([x, y, z]), untouched).status,
            TrackStatus::Lost,
            "believed at first sight"
        );
        for _ in 0..3 {
            let sighting = lab.see(at_rest([x, y, z]), untouched);
            assert_eq!(sighting.status, TrackStatus::Found);
            assert_eq!(sighting.depth_from, DepthFrom::Disparity);
            let error = Vector3::from(sighting.position_m) - Vector3::new(x, y, z);
            // Ahead: half a count of disparity for the noise that neighbours share; across: 0.3 pixels. Both are more than
            // five of the deviations that `tools/tracker` measures.
            let distance_m = x + 1.8;
            assert!(error.x.abs() < 0.5 * 2.89e-3 * distance_m.powi(2) + 0.002, "{error} at {distance_m} m");
            assert!(error.yz().norm() < 0.3 * 1.5 * distance_m / 529.0, "{error} at {distance_m} m");
            let sigma_m = sighting.covariance_m2[0][0].sqrt();
            assert!(sigma_m > 0.0 && error.x.abs() < 5.0 * sigma_m, "{error} against {sigma_m}");
        }
    }
}

#[test]
fn a_moving_marker_is_told_at_the_time_of_its_row_and_in_the_middle_of_its_blur() {
    let velocity_m_s = Vector3::new(0.5, 1.2, -1.2);
    let start = Vector3::new(-0.4, -0.25, 1.15);
    let position = |time: Time| start + velocity_m_s * (time.seconds() - 1.0);
    let moving = |time: Time| {
        let attitude = UnitQuaternion::from_euler_angles(0.1, -0.1, 0.2);
        Some(Pose { velocity_m_s, attitude, ..Pose::at_rest(time, position(time)) })
    };
    let mut lab = Lab::new(&Scene::bare(), Settings::default());
    lab.see(moving, untouched);
    for _ in 0..8 {
        let sighting = lab.see(moving, untouched);
        assert_eq!(sighting.status, TrackStatus::Found);
        // The shutter takes 26 ms from top to bottom: rows off the middle are exposed earlier or later.
        let row_s = (sighting.pixel[1] - 239.5) * 5.421e-5;
        assert!((sighting.exposed_at.since_s(lab.now) - row_s).abs() < 1e-8);
        let attitude = moving(lab.now).unwrap().attitude;
        let offset = Vector3::new(0.0, 0.0, 0.055);
        let marker = position(sighting.exposed_at) + attitude * offset;
        let error = Vector3::from(sighting.position_m) + offset - marker;
        // 1.7 m/s for a tenth of the exposure is 1.7 mm; the depth has its half count.
        assert!(error.x.abs() < 0.006 && error.yz().norm() < 0.0025, "{error}");
    }
}

#[test]
fn a_red_door_a_thousand_times_as_large_is_not_the_marker() {
    let mut lab = Lab::new(&Scene::with_distractors(), Settings::default());
    for _ in 0..3 {
        lab.see(at_rest([0.0, 0.2, 0.4]), untouched);
    }
    let sizes: Vec<_> = lab.tracker.candidates().iter().map(|candidate| candidate.blob.area).collect();
    let chosen: Vec<_> = lab.tracker.candidates().iter().filter(|candidate| candidate.chosen).collect();
    assert_eq!(chosen.len(), 1);
    assert!(sizes.iter().max() > Some(&(chosen[0].blob.area * 20)), "{sizes:?}");
    let reasons: Vec<_> =
        lab.tracker.candidates().iter().filter_map(|candidate| candidate.rejection).collect();
    for reason in [Rejection::Size, Rejection::Aspect, Rejection::Fill] {
        assert!(reasons.contains(&reason), "{reason:?} is not among {reasons:?}");
    }
    for _ in 0..3 {
        assert_eq!(lab.see(|_| None, untouched).status, TrackStatus::Lost);
    }
}

#[test]
fn nothing_red_in_clutter_is_believed() {
    for room in 0..6 {
        let mut lab = Lab::new(&Scene::cluttered(1000 + room, 20), Settings::default());
        for _ in 0..3 {
            assert_eq!(lab.see(|_| None, untouched).status, TrackStatus::Lost, "room {room}");
        }
        assert!(lab.tracker.candidates().len() > 3, "a room without red things tests nothing");
    }
}

#[test]
fn a_second_marker_is_ambiguous_until_the_track_tells_them_apart() {
    let mut scene = Scene::bare();
    scene.surfaces.push(Surface::facing([0.0, 0.5, 0.6], 0.05, 0.05, Shape::Rectangle, RED));
    let mut lab = Lab::new(&scene, Settings::default());
    // Seen for the first time, either may be the marker.
    let far = [0.0, 0.0, 0.5];
    lab.see(at_rest(far), untouched);
    assert_eq!(lab.tracker.candidates().iter().filter(|c| c.rejection.is_none()).count(), 2);
    // From then on the one that was chosen is half a metre from the other.
    assert_eq!(lab.see(at_rest(far), untouched).status, TrackStatus::Found);
    // Eight centimetres apart nothing tells them apart.
    lab.tracker.forget();
    let near = [0.0, 0.42, 0.545];
    lab.see(at_rest(near), untouched);
    assert_eq!(lab.see(at_rest(near), untouched).status, TrackStatus::Ambiguous);
}

#[test]
fn without_depth_a_known_marker_goes_on_by_its_size_and_an_unknown_one_is_not_believed() {
    let blind = |frame: &mut Frame| frame.depth.fill(2047);
    let mut lab = Lab::new(&Scene::bare(), Settings::default());
    let place = [0.0, 0.1, 0.5];
    for _ in 0..3 {
        assert_eq!(lab.see(at_rest(place), blind).status, TrackStatus::Lost);
    }
    for _ in 0..3 {
        lab.see(at_rest(place), untouched);
    }
    for _ in 0..5 {
        let sighting = lab.see(at_rest(place), blind);
        assert_eq!((sighting.status, sighting.depth_from), (TrackStatus::Found, DepthFrom::Size));
        // By the size alone a pixel of 15 is 12 cm; the track holds it to a few centimetres.
        assert!((sighting.position_m[0] - place[0]).abs() < 0.04, "{:?}", sighting.position_m);
        assert!(sighting.covariance_m2[0][0] > 0.1_f64.powi(2));
    }
}

#[test]
fn what_was_lost_on_the_wire_is_not_tracked() {
    let mut lab = Lab::new(&Scene::bare(), Settings::default());
    let place = [0.0, 0.0, 0.5];
    for _ in 0..2 {
        lab.see(at_rest(place), untouched);
    }
    let row = lab.see(at_rest(place), untouched).pixel[1] as usize;
    let torn = |frame: &mut Frame| frame.colour_valid.lose(row * 640..row * 640 + 1908);
    assert_eq!(lab.see(at_rest(place), torn).status, TrackStatus::Lost);
    assert_eq!(lab.tracker.candidates()[0].rejection, Some(Rejection::Cut));
    // Elsewhere in the image it does no harm, and lost depth is as no depth.
    let far = |frame: &mut Frame| frame.colour_valid.lose(0..1908);
    assert_eq!(lab.see(at_rest(place), far).status, TrackStatus::Found);
    let deep = |frame: &mut Frame| frame.depth_valid.lose(0..640 * 480);
    assert_eq!(lab.see(at_rest(place), deep).depth_from, DepthFrom::Size);
}

#[test]
fn a_jump_is_not_followed_but_the_marker_is_found_again() {
    let mut lab = Lab::new(&Scene::bare(), Settings::default());
    for _ in 0..3 {
        lab.see(at_rest([0.0, 0.0, 0.5]), untouched);
    }
    let far = [0.0, 0.5, 0.5];
    assert_eq!(lab.see(at_rest(far), untouched).status, TrackStatus::Lost);
    assert!(lab.tracker.candidates().iter().any(|c| c.rejection == Some(Rejection::Elsewhere)));
    let again = (0..20).position(|_| lab.see(at_rest(far), untouched).status == TrackStatus::Found);
    // 0.10 m and 2 m/s: half a metre is within reach after 0.2 s.
    assert!(again.is_some_and(|frames| (4..=8).contains(&frames)), "{again:?}");
}

#[test]
fn the_same_seed_renders_the_same_frames() {
    let frames = |seed| {
        let mut renderer = Renderer::new(&calibration(), &Scene::bare(), Settings::default(), seed);
        let mut frame = Frame::default();
        let time = Time::from_seconds(1.0);
        renderer.render(time, Some(&Pose::at_rest(time, Vector3::zeros())), &mut frame);
        let first = frame.clone();
        renderer.render(time, None, &mut frame);
        (first, frame)
    };
    let ((a, empty), (b, _)) = (frames(1), frames(1));
    assert!(a == b && a != frames(2).0);
    // The airframe leaves nothing behind: its place is noise about the room again.
    let changed = a.colour.iter().zip(&empty.colour).filter(|(a, b)| a.abs_diff(**b) > 30).count();
    assert!((100..2000).contains(&changed), "{changed}");
}

#[test]
fn depth_has_the_quantisation_noise_holes_and_shadow_that_are_asked_for() {
    let settings = Settings { lateral_jitter_px: 0.0, ..Settings::default() };
    let mut lab = Lab::new(&Scene::bare(), settings);
    lab.see(at_rest([-0.3, 0.0, 0.5]), untouched);
    let law = *lab.tracker.camera().disparity();
    // The wall is 3.5 m from the camera, and nothing stands before its upper left part.
    let wall: Vec<f64> = (20..180)
        .flat_map(|y| (40..280).map(move |x| y * 640 + x))
        .map(|pixel| lab.frame.depth[pixel])
        .filter(|raw| *raw < 2047)
        .map(f64::from)
        .collect();
    let holes = 1.0 - wall.len() as f64 / (160.0 * 240.0);
    // Patches of 25 pixels: about 1500 of them, so the share is known to 0.01.
    assert!((holes - 0.1).abs() < 0.03, "{holes}");
    let mean = wall.iter().sum::<f64>() / wall.len() as f64;
    let sigma = (wall.iter().map(|raw| (raw - mean).powi(2)).sum::<f64>() / wall.len() as f64).sqrt();
    assert!((mean - law.raw(3.5)).abs() < 0.05, "{mean}");
    // Noise of 0.4 and rounding: sqrt(0.4^2 + 1/12) = 0.49.
    assert!((sigma - 0.49).abs() < 0.03, "{sigma}");
    assert!((0..480).all(|y| lab.frame.depth[y * 640 + 632..y * 640 + 640].iter().all(|raw| *raw == 2047)));

    // 7.5 cm between emitter and camera: 594 px x 0.075 m (1/1.5 m - 1/3.5 m) = 17 pixels of shadow, left of the marker.
    let row = lab
        .tracker
        .camera()
        .depth_pixel(&lab.tracker.camera().to_camera(&Vector3::new(-0.3, 0.0, 0.555)))
        .unwrap();
    let left = (row.x - 0.5 * 594.0 * 0.05 / 1.5) as usize;
    let line = &lab.frame.depth[row.y as usize * 640..][..640];
    assert!(line[left - 15..left - 1].iter().all(|raw| *raw == 2047), "{:?}", &line[left - 20..left + 5]);
    assert!(line[left - 40..left - 20].iter().filter(|raw| **raw < 2047).count() > 10);
}
