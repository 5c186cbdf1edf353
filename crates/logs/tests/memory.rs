//! Reading a log takes memory that does not grow with it.

#[path = "logs/writers.rs"]
#[expect(dead_code, reason = "the other formats are written by other tests")]
mod writers;

use std::{
    fs::File,
    io::{BufWriter, Write as _},
    ops::ControlFlow,
    path::Path,
};

use bench_logs::{Format, Sample, Topic, Visitor, scan};
use peak_alloc::PeakAlloc;
use writers::{Ulog, floats};

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

/// A log is made of so many samples, over and over.
const SAMPLES: u64 = 10_000;

/// Writes a log of so many MB, and returns how many samples it has.
fn write(path: &Path, megabytes: usize) -> u64 {
    let mut head = Ulog::new();
    head.format("sensor_combined:uint64_t timestamp;float[20] values;");
    head.subscribe(0, 0, "sensor_combined");
    let mut with_data = Ulog::new();
    for k in 0..SAMPLES {
        with_data.data(0, k * 1000, &floats(&[k as f64; 20]));
    }
    // Without the head of the second log and its flags.
    let data = with_data.bytes().split_off(16 + 43);
    let mut file = BufWriter::new(File::create(path).unwrap());
    file.write_all(&head.bytes()).unwrap();
    let times = (megabytes * 1_000_000).div_ceil(data.len());
    for _ in 0..times {
        file.write_all(&data).unwrap();
    }
    file.flush().unwrap();
    SAMPLES * times as u64
}

#[derive(Default)]
struct Count(u64);

impl Visitor for Count {
    fn topic(&mut self, topic: &Topic) -> Option<Vec<usize>> {
        Some((0..topic.fields.len()).collect())
    }

    fn sample(&mut self, _: Sample<'_>) -> ControlFlow<()> {
        self.0 += 1;
        ControlFlow::Continue(())
    }
}

/// The most that is held while a log is read, bytes.
fn peak(folder: &Path, megabytes: usize) -> usize {
    let path = folder.join("log.ulg");
    let samples = write(&path, megabytes);
    ALLOCATOR.reset_peak_usage();
    let before = ALLOCATOR.current_usage();
    let mut count = Count::default();
    let losses = scan(&path, Format::Ulog, &mut count).unwrap();
    assert!(losses.is_none() && count.0 == samples, "{losses:?}, {} of {samples}", count.0);
    ALLOCATOR.peak_usage() - before
}

#[test]
fn a_log_of_200_mb_takes_no_more_than_one_of_10() {
    let folder = tempfile::tempdir().unwrap();
    let [small, large] = [10, 200].map(|megabytes| peak(folder.path(), megabytes));
    // The window and what is known of the topics; a message more or less in the window makes no difference of a page.
    assert!(large < small + 4096 && small < 4 << 20, "{small} bytes, and {large}");
}
