//! How long comparing two recordings takes beside reading both with the `mcap` crate alone.
//!
//! `cargo bench -p bench-recording --bench diff [MESSAGES]` makes two recordings of so many messages each (400,000 unless told;
//! 3,300,000 are 50 minutes of a lab) and prints both times and their ratio, each the best of three; the processors'
//! time beside it hardly depends on what else the machine does.

use std::{
    fs,
    path::{Path, PathBuf},
    time::Instant,
};

use bench_device::{PositionSample, Sticks, Time, TrackStatus};
use bench_recording::{
    Command, ControlState, Mode, Options, Record, Recorder, Session, Truth,
    diff::{DiffOptions, diff},
};
use bench_rig::Phase;
use mcap::sans_io::{LinearReadEvent, LinearReader};

/// `messages` records of four channels at 275 Hz each, with noise in every number.
fn write(path: PathBuf, messages: u64, seed: u64) -> PathBuf {
    let mut recorder =
        Recorder::create(&path, &Session::new(Mode::Sim), Options::SIMULATION).expect("a recorder");
    let mut state = seed;
    let mut noise = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 * 1e-17
    };
    for i in 0..messages / 4 {
        let time = Time::from_nanos(i * 3_636_364);
        let z = 0.4 + 0.1 * (time.seconds() * 0.7).sin();
        let phase = if i < 275 { Phase::Idle } else { Phase::Hold };
        let mut three = || [noise(), noise(), z + noise()];
        let position_m = three();
        recorder.record(PositionSample {
            exposed_at: time,
            arrived_at: time,
            position_m,
            status: TrackStatus::Found,
            ..Default::default()
        });
        let estimate_m = three();
        let estimate_m_s = three();
        recorder.record(ControlState { time, phase, estimate_m, estimate_m_s, ..ControlState::default() });
        let [pitch, roll, throttle] = three();
        recorder.record(Command { time, sticks: Sticks { throttle, pitch, roll, yaw: 0.0 } });
        let (position_m, velocity_m_s) = (three(), three());
        let body_rate_rad_s = three();
        recorder.record(Record::from(Truth {
            time,
            position_m,
            velocity_m_s,
            attitude: [1.0, 0.0, 0.0, 0.0],
            body_rate_rad_s,
            thrust_n: 0.15,
            ..Truth::default()
        }));
    }
    recorder.finish().expect("a recording");
    path
}

/// Reads every message with the crate's own streaming reader, from a file in pieces, and does nothing with them.
fn read_with_mcap(path: &Path) -> u64 {
    use std::io::Read;
    let mut file = fs::File::open(path).expect("the recording");
    let mut reader = LinearReader::new();
    let mut messages = 0;
    while let Some(event) = reader.next_event() {
        match event.expect("sound") {
            LinearReadEvent::ReadRequest(wanted) => {
                let read = file.read(reader.insert(wanted)).expect("the recording");
                reader.notify_read(read);
            }
            LinearReadEvent::Record { opcode, data } => {
                if let mcap::records::Record::Message { .. } =
                    mcap::parse_record(opcode, data).expect("sound")
                {
                    messages += 1;
                }
            }
        }
    }
    messages
}

/// Least wall-clock time of three, and least time of all processors, s.
fn best_of_three(mut work: impl FnMut()) -> [f64; 2] {
    let mut once = || {
        let (began, used_s) = (Instant::now(), processors_s());
        work();
        [began.elapsed().as_secs_f64(), processors_s() - used_s]
    };
    (0..3)
        .map(|_| once())
        .fold([f64::INFINITY; 2], |least, took| [least[0].min(took[0]), least[1].min(took[1])])
}

/// Processor time of this process and its threads so far, s, in hundredths; not a number where the system does not tell.
fn processors_s() -> f64 {
    let stat = fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // The name in brackets may hold blanks; user and system time are the twelfth and thirteenth field after it.
    let fields = stat.rsplit(')').next().unwrap_or_default();
    let ticks: Vec<f64> = fields.split_whitespace().skip(11).take(2).filter_map(|x| x.parse().ok()).collect();
    if ticks.len() == 2 { (ticks[0] + ticks[1]) / 100.0 } else { f64::NAN }
}

fn main() {
    let messages = std::env::args().find_map(|text| text.parse().ok()).unwrap_or(400_000);
    let folder = tempfile::tempdir().expect("a folder");
    let a = write(folder.path().join("a.mcap"), messages, 1);
    let b = write(folder.path().join("b.mcap"), messages, 2);
    let bytes = fs::metadata(&a).expect("the recording").len();
    let alone_s = best_of_three(|| {
        std::hint::black_box(read_with_mcap(&a) + read_with_mcap(&b));
    });
    let diff_s = best_of_three(|| {
        std::hint::black_box(diff(&a, &b, &DiffOptions::default()).expect("a report"));
    });
    println!("two recordings of {messages} messages, {:.1} MB each", bytes as f64 / 1e6);
    let [ratio, used] = [0, 1].map(|i| diff_s[i] / alone_s[i]);
    println!("read with mcap alone  {:.2} s, {:.2} s of processors", alone_s[0], alone_s[1]);
    println!(
        "compared              {:.2} s, {:.2} s of processors: {ratio:.1} times as long, {used:.1} times the work",
        diff_s[0], diff_s[1]
    );
}
