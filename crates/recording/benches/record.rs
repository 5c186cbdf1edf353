//! What recording costs: the loop's side a record, the writer's side a message, and a whole simulated flight.
//!
//! Numbers depend on the machine; run on a quiet one. Percentiles of `record` are printed first.

use std::{
    hint::black_box,
    path::PathBuf,
    time::{Duration, Instant},
};

use bench_device::{PositionSample, Readback, Sticks, Time, TrackStatus};
use bench_recording::{
    Command, ControlState, Mode, Options, ReadbackAt, Record, Recorder, Recording, Session, Tick, Truth,
    View, ViewerChannel,
};
use divan::{Bencher, counter::ItemsCount};
use tempfile::{TempDir, tempdir};

fn main() {
    print_percentiles();
    divan::main();
}

/// A flight of 20 s with a tick each 0.1 s and truth each 0.02 s; its numbers vary as a flight's do.
fn flight() -> Vec<Record> {
    let mut records = Vec::new();
    for step in 0..1000_u32 {
        let t_s = f64::from(step) * 0.02;
        let time = Time::from_seconds(t_s);
        let z = 0.4 * (1.0 - (-t_s).exp()) + 0.01 * (7.0 * t_s).sin();
        let position_m = [0.02 * t_s.sin(), 0.03 * t_s.cos(), z];
        records.push(
            Truth {
                time,
                position_m,
                velocity_m_s: [0.02 * t_s.cos(), -0.03 * t_s.sin(), 0.07 * (7.0 * t_s).cos()],
                attitude: [0.999, 0.01 * t_s.sin(), 0.01 * t_s.cos(), 0.001],
                body_rate_rad_s: [0.01 * t_s.cos(), -0.01 * t_s.sin(), 0.0],
                thrust_n: 0.147 + 0.01 * t_s.sin(),
                rotor_speed_ratio: 1.0 + 0.03 * t_s.sin(),
                charge_hover_min: t_s / 60.0,
            }
            .into(),
        );
        if step % 2 == 0 {
            records.push(
                PositionSample {
                    exposed_at: time.shifted(-0.3),
                    arrived_at: time,
                    position_m: position_m.map(|x| (x / 0.005).round() * 0.005),
                    status: TrackStatus::Found,
                    ..PositionSample::default()
                }
                .into(),
            );
        }
        if step % 5 == 0 {
            let sticks = Sticks { throttle: 1.9 + 0.1 * t_s.sin(), pitch: 1.65, roll: 1.65, yaw: 1.65 };
            records.extend::<[Record; 4]>([
                ControlState { time, estimate_m: position_m, thrust_n: z, ..ControlState::default() }.into(),
                Command { time, sticks }.into(),
                ReadbackAt {
                    time,
                    readback: Readback { device_time: time, sticks, faults: bench_device::Faults::default() },
                }
                .into(),
                Tick { index: u64::from(step / 5), scheduled: time, started: time, ..Tick::default() }.into(),
            ]);
        }
    }
    records
}

fn recorder(folder: &TempDir, options: Options) -> Recorder {
    let path: PathBuf = folder.path().join("bench.mcap");
    Recorder::create(path, &Session::new(Mode::Sim), options).unwrap()
}

/// `record` at the pace of a loop, one record each 100 us; without views and with three of them each 1000 records, which the writer
/// compresses meanwhile.
fn print_percentiles() {
    for with_views in [false, true] {
        let folder = tempdir().unwrap();
        let mut recorder = recorder(&folder, Options::REAL_TIME);
        let mut images = recorder.images().unwrap();
        let (mut costs, mut view_costs) = (Vec::new(), Vec::new());
        for (i, record) in flight().into_iter().cycle().take(20_000).enumerate() {
            if with_views && i % 1000 == 0 {
                for channel in [ViewerChannel::Full, ViewerChannel::Red, ViewerChannel::Depth] {
                    let view = view(channel, record.time(), images.buffer());
                    let begun = Instant::now();
                    images.give(black_box(view));
                    view_costs.push(begun.elapsed());
                }
            }
            let begun = Instant::now();
            recorder.record(black_box(record));
            costs.push(begun.elapsed());
            std::thread::sleep(Duration::from_micros(100));
        }
        let finished = recorder.finish().unwrap();
        println!("record, one each 100 us{}: {}", if with_views { ", with views" } else { "" }, words(costs));
        if with_views {
            println!("a view handed over: {}; {} dropped", words(view_costs), finished.dropped_views);
        }
    }
}

fn words(mut costs: Vec<Duration>) -> String {
    costs.sort();
    let at = |share: f64| costs[((costs.len() - 1) as f64 * share) as usize];
    format!(
        "p50 {:?}, p99 {:?}, p99.9 {:?}, max {:?} ({})",
        at(0.5),
        at(0.99),
        at(0.999),
        at(1.0),
        costs.len()
    )
}

/// A Kinect's image that compresses as badly as a real one: noise on a gradient.
fn view(channel: ViewerChannel, at: Time, mut rgb: Vec<u8>) -> View {
    let size = [640, 480];
    let mut state = at.nanos() | 1;
    rgb.clear();
    rgb.extend((0..3 * size[0] * size[1]).map(|i| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (i / 7680) as u8 + (state >> 62) as u8
    }));
    View { channel, exposed_at: at, arrived_at: at, size, rgb }
}

/// Create, record a 20 s flight, finish: what a simulation pays by the wall clock.
#[divan::bench(sample_count = 100)]
fn whole_flight(bencher: Bencher) {
    let folder = tempdir().unwrap();
    let records = flight();
    bencher.counter(ItemsCount::new(records.len())).bench_local(|| {
        let mut recorder = recorder(&folder, Options::SIMULATION);
        for record in &records {
            recorder.record(*record);
        }
        recorder.finish().unwrap()
    });
}

/// Fifty flights in one recording: the writer's throughput.
#[divan::bench(sample_count = 20)]
fn writer_throughput(bencher: Bencher) {
    let folder = tempdir().unwrap();
    let records: Vec<_> = flight().into_iter().cycle().take(150_000).collect();
    bencher.counter(ItemsCount::new(records.len())).bench_local(|| {
        let mut recorder = recorder(&folder, Options::SIMULATION);
        for record in &records {
            recorder.record(*record);
        }
        recorder.finish().unwrap()
    });
}

/// Reading a 20 s flight.
#[divan::bench(sample_count = 100)]
fn read_flight(bencher: Bencher) {
    let folder = tempdir().unwrap();
    let mut recorder = recorder(&folder, Options::SIMULATION);
    let records = flight();
    for record in &records {
        recorder.record(*record);
    }
    let path = recorder.finish().unwrap().path;
    bencher
        .counter(ItemsCount::new(records.len()))
        .bench_local(|| Recording::open(&path).unwrap().records().unwrap().map(Result::unwrap).count());
}
