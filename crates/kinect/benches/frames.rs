//! Frames: how long rendering, tracking, unpacking and demosaicing one takes. The room has red distractors, the marker is 1.8 m
//! away. For figures of one core, pin the process: `taskset -c 1 cargo bench -p bench-kinect`.

use std::{hint::black_box, path::Path};

use bench_device::Time;
use bench_kinect::{
    Frame,
    frame::{PACKED_DEPTH_BYTES, PIXELS, demosaic, pack_depth, unpack_depth},
    render::{Pose, Renderer, Settings, scene::Scene},
    track::Tracker,
};
use bench_rig::{Calibration, Rig};
use divan::Bencher;
use nalgebra::Vector3;

fn main() {
    divan::main();
}

fn calibration() -> Calibration {
    let rig = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs/virtual.toml");
    Rig::load(rig).unwrap().calibration.unwrap()
}

fn renderer() -> Renderer {
    Renderer::new(&calibration(), &Scene::with_distractors(), Settings::default(), 1)
}

fn pose() -> Pose {
    let velocity_m_s = Vector3::new(0.0, 0.3, 0.5);
    Pose { velocity_m_s, ..Pose::at_rest(Time::from_seconds(1.0), Vector3::new(0.0, 0.0, 0.4)) }
}

fn frame() -> Frame {
    let mut frame = Frame::default();
    renderer().render(pose().time, Some(&pose()), &mut frame);
    frame
}

#[divan::bench]
fn render(bencher: Bencher) {
    let (mut renderer, mut frame) = (renderer(), Frame::default());
    bencher.bench_local(|| renderer.render(pose().time, Some(black_box(&pose())), &mut frame));
}

#[divan::bench]
fn room(bencher: Bencher) {
    bencher.bench_local(renderer);
}

#[divan::bench(sample_count = 1000)]
fn track(bencher: Bencher) {
    let (mut tracker, frame) = (Tracker::new(&calibration()), frame());
    bencher.bench_local(|| tracker.track(black_box(&frame), Time::from_seconds(1.0)));
}

#[divan::bench(sample_count = 1000)]
fn unpack(bencher: Bencher) {
    let (frame, mut packed, mut depth) = (frame(), vec![0; PACKED_DEPTH_BYTES], vec![0; PIXELS]);
    pack_depth(&frame.depth, &mut packed).unwrap();
    bencher.bench_local(|| unpack_depth(black_box(&packed), &mut depth).unwrap());
}

#[divan::bench]
fn demosaic_to_rgb(bencher: Bencher) {
    let (frame, mut rgb) = (frame(), vec![0; PIXELS * 3]);
    bencher.bench_local(|| demosaic(black_box(&frame.colour), &mut rgb).unwrap());
}
