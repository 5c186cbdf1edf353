//! How fast a PX4 log is read: the file alone from the disk's cache, `px4-ulog` alone, by this crate the fields of one topic, as a map
//! asks for them, and every field, and by `pyulog` where `BENCH_PYTHON` names a Python that has it.
//!
//! `cargo bench -p bench-logs --bench ulog` writes a log of 200 MB into the temporary folder and takes the best of several readings.

#[path = "../tests/logs/writers.rs"]
#[allow(dead_code, reason = "the other formats are written by tests")]
mod writers;

use std::{
    env,
    fs::File,
    io::{BufWriter, Read as _, Write as _},
    ops::ControlFlow,
    path::Path,
    process::Command,
    time::Instant,
};

use bench_logs::{Cell, Format, Sample, Topic, Visitor, scan};
use px4_ulog::stream_parser::{LogParser, model::DataMessage};
use writers::{Ulog, floats};

const MEGABYTES: usize = 200;
const READINGS: usize = 5;

/// A minute of what a flight controller logs, over and over.
fn write(path: &Path) -> u64 {
    let mut head = Ulog::new();
    head.format("sensor_combined:uint64_t timestamp;float[3] gyro_rad;uint32_t gyro_dt;float[3] accelerometer;uint32_t accelerometer_dt;");
    head.format(
        "vehicle_local_position:uint64_t timestamp;uint64_t timestamp_sample;float[24] state;bool[8] valid;",
    );
    head.format("vehicle_thrust_setpoint:uint64_t timestamp;float[3] xyz;");
    for (id, name) in
        ["sensor_combined", "vehicle_local_position", "vehicle_thrust_setpoint"].iter().enumerate()
    {
        head.subscribe(id as u16, 0, name);
    }
    let mut data = Ulog::new();
    for k in 0..15_000_u64 {
        let (micros, x) = (k * 4000, 1e-3 * k as f64);
        let word = floats(&[0.0]);
        data.data(0, micros, &[floats(&[x; 3]), word.clone(), floats(&[x; 3]), word].concat());
        data.data(1, micros, &[micros.to_le_bytes().to_vec(), floats(&[x; 24]), vec![1; 8]].concat());
        data.data(2, micros, &floats(&[0.0, 0.0, -0.5]));
    }
    let data = data.bytes().split_off(16 + 43);
    let mut file = BufWriter::new(File::create(path).expect("a file in the temporary folder"));
    file.write_all(&head.bytes()).expect("room for a log");
    let mut written = 0;
    while written < MEGABYTES * 1_000_000 {
        file.write_all(&data).expect("room for a log");
        written += data.len();
    }
    file.flush().expect("room for a log");
    written as u64
}

/// Adds up numbers, so that none is read in vain.
#[derive(Default)]
struct Sum {
    /// The topic that is wanted; `None`: all.
    only: Option<&'static str>,
    sum: f64,
}

impl Visitor for Sum {
    fn topic(&mut self, topic: &Topic) -> Option<Vec<usize>> {
        let is_wanted = self.only.is_none_or(|only| only == topic.name);
        is_wanted.then(|| (0..topic.fields.len()).collect())
    }

    fn sample(&mut self, sample: Sample<'_>) -> ControlFlow<()> {
        for cell in sample.cells {
            self.sum += match cell {
                Cell::Number(number) => *number,
                // What stands in this log fits; wider conversions would take longer than the reading.
                Cell::Integer(number) => *number as i64 as f64,
                Cell::Absent | Cell::Text(_) => 0.0,
            };
        }
        ControlFlow::Continue(())
    }
}

fn raw(path: &Path) {
    let mut file = File::open(path).expect("the log");
    let mut buffer = vec![0; 1 << 18];
    while file.read(&mut buffer).expect("the log") > 0 {
        std::hint::black_box(&buffer);
    }
}

fn parser_alone(path: &Path) {
    let mut sum = 0_usize;
    let mut on_data = |message: &DataMessage<'_>| sum += message.data.len();
    let mut parser = LogParser::default();
    parser.set_data_message_callback(&mut on_data);
    let mut file = File::open(path).expect("the log");
    let mut buffer = vec![0; 1 << 18];
    loop {
        match file.read(&mut buffer).expect("the log") {
            0 => break,
            read => parser.consume_bytes(&buffer[..read]).expect("a sound log"),
        }
    }
    std::hint::black_box(sum);
}

fn ours(path: &Path, only: Option<&'static str>) {
    let mut sum = Sum { only, sum: 0.0 };
    scan(path, Format::Ulog, &mut sum).expect("a sound log");
    std::hint::black_box(sum.sum);
}

/// The shortest of several readings, s.
fn best(read: impl Fn()) -> f64 {
    let once = || {
        let began = Instant::now();
        read();
        began.elapsed().as_secs_f64()
    };
    (0..READINGS).map(|_| once()).fold(f64::INFINITY, f64::min)
}

/// How long pyulog takes by its own clock, s.
fn pyulog(path: &Path) -> Option<f64> {
    let script = "import sys, time; from pyulog import ULog; t = time.perf_counter(); ULog(sys.argv[1]); print(time.perf_counter() - t)";
    let output = Command::new(env::var_os("BENCH_PYTHON")?).args(["-c", script]).arg(path).output().ok()?;
    String::from_utf8(output.stdout).ok()?.trim().parse().ok()
}

fn main() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("log.ulg");
    let bytes = write(&path) as f64;
    let told = |name: &str, seconds: f64| {
        println!("{name:<26} {seconds:8.3} s {:9.0} MB/s", bytes / seconds / 1e6);
    };
    told("the file alone", best(|| raw(&path)));
    told("px4-ulog, no field", best(|| parser_alone(&path)));
    told("bench-logs, one topic", best(|| ours(&path, Some("vehicle_thrust_setpoint"))));
    told("bench-logs, every field", best(|| ours(&path, None)));
    match pyulog(&path) {
        Some(seconds) => told("pyulog, every field", seconds),
        None => println!("pyulog: BENCH_PYTHON names no Python that has it"),
    }
}
