//! Comparing recordings takes memory that does not grow with them.

use std::path::{Path, PathBuf};

use bench_device::{PositionSample, Sticks, Time, TrackStatus};
use bench_recording::{
    Command, ControlState, Mode, Options, Record, Recorder, Session, Truth,
    diff::{DiffOptions, Verdict, diff},
};
use bench_rig::Phase;
use peak_alloc::PeakAlloc;

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

/// `messages` records of four channels at 250 Hz each, with noise that no two seeds share.
fn write(path: PathBuf, messages: u64, seed: u64) -> PathBuf {
    let mut recorder =
        Recorder::create(&path, &Session::new(Mode::Sim), Options::SIMULATION).expect("a recorder");
    let mut noise = seed;
    for i in 0..messages / 4 {
        noise = noise.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let time = Time::from_nanos(i * 4_000_000);
        let z = 0.4 + 0.1 * (time.seconds() * 0.7).sin() + (noise >> 40) as f64 * 1e-10;
        let phase = if i < 250 { Phase::Idle } else { Phase::Hold };
        let position_m = [0.0, 0.0, z];
        let status = TrackStatus::Found;
        recorder.record(PositionSample {
            exposed_at: time,
            arrived_at: time,
            position_m,
            status,
            ..Default::default()
        });
        recorder.record(ControlState { time, phase, estimate_m: position_m, ..ControlState::default() });
        recorder.record(Command { time, sticks: Sticks { throttle: z, ..Sticks::default() } });
        recorder.record(Record::from(Truth { time, position_m, ..Truth::default() }));
    }
    recorder.finish().expect("a recording");
    path
}

fn peak_of_diff(folder: &Path, messages: u64) -> usize {
    let a = write(folder.join("a.mcap"), messages, 1);
    let b = write(folder.join("b.mcap"), messages, 2);
    ALLOCATOR.reset_peak_usage();
    let before = ALLOCATOR.current_usage();
    let report = diff(&a, &b, &DiffOptions::default()).expect("a report");
    assert_eq!(report.verdict(), Verdict::WithinTolerance, "{}", report.summary);
    assert_eq!(report.a.records, messages);
    ALLOCATOR.peak_usage() - before
}

#[test]
fn memory_does_not_grow_with_the_recordings() {
    let folder = tempfile::tempdir().expect("a folder");
    let (short, long) = (peak_of_diff(folder.path(), 50_000), peak_of_diff(folder.path(), 200_000));
    // Four times the messages: the same windows, series and traces; a tenth is for how vectors happen to grow.
    assert!(long as f64 <= 1.1 * short as f64, "{short} bytes for 50 000 messages, {long} for 200 000");
    // Series (2048 bins of 24 bytes) and traces (240 stretches of 32 bytes) of some 50 fields, twice over, and a chunk.
    assert!(long < 24 << 20, "{long} bytes");
    println!("peak {short} bytes for 50 000 messages, {long} for 200 000");
}
