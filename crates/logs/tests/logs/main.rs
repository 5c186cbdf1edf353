//! Logs that the tests write, read whole, cut and damaged.

mod writers;

use std::{fs, ops::ControlFlow};

use bench_logs::{Cell, Format, LogError, Losses, Sample, Survey, Topic, Visitor, scan};
use proptest::prelude::*;

mod blackbox;
mod crazyflie;
mod dataflash;
mod mcap;
mod parquet;
mod python;
mod ulog;

/// One sample, in words and numbers.
#[derive(Clone, Debug, PartialEq)]
struct Taken {
    topic: usize,
    time_ns: Option<i128>,
    cells: Vec<String>,
}

/// All that a log said.
#[derive(Debug, Default)]
struct Read {
    topics: Vec<Topic>,
    samples: Vec<Taken>,
    parameters: Vec<(String, f64)>,
    losses: Losses,
}

impl Visitor for Read {
    fn topic(&mut self, topic: &Topic) -> Option<Vec<usize>> {
        self.topics.push(topic.clone());
        Some((0..topic.fields.len()).collect())
    }

    fn sample(&mut self, sample: Sample<'_>) -> ControlFlow<()> {
        let cells = sample.cells.iter().map(|cell| match cell {
            Cell::Absent => String::new(),
            Cell::Number(number) => number.to_string(),
            Cell::Integer(number) => number.to_string(),
            Cell::Text(text) => String::from_utf8_lossy(text).into_owned(),
        });
        self.samples.push(Taken { topic: sample.topic, time_ns: sample.time_ns, cells: cells.collect() });
        ControlFlow::Continue(())
    }

    fn parameter(&mut self, name: &str, value: f64) {
        self.parameters.push((name.to_owned(), value));
    }
}

fn read(format: Format, bytes: &[u8]) -> Result<Read, LogError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log");
    fs::write(&path, bytes).unwrap();
    let mut read = Read::default();
    let losses = scan(&path, format, &mut read)?;
    Ok(Read { losses, ..read })
}

fn names(read: &Read) -> Vec<&str> {
    read.topics.iter().map(|topic| topic.name.as_str()).collect()
}

/// What is read of a log that ends at each of its bytes is a beginning of what is read of the whole.
fn beginnings_hold(format: Format, bytes: &[u8], from: usize) {
    let whole = read(format, bytes).unwrap();
    assert!(whole.losses.is_none(), "{:?}", whole.losses);
    let mut most = 0;
    for end in from..bytes.len() {
        // Where nothing was defined yet there is nothing to read.
        let Ok(cut) = read(format, &bytes[..end]) else { continue };
        assert!(whole.samples.starts_with(&cut.samples), "{end}");
        most = most.max(cut.samples.len());
    }
    assert!(most + 1 >= whole.samples.len(), "{most} of {}", whole.samples.len());
}

/// How many samples of the whole are there, in their order.
fn kept(whole: &Read, part: &Read) -> usize {
    let mut kept = 0;
    let mut left = whole.samples.as_slice();
    for sample in &part.samples {
        if let Some(place) = left.iter().position(|known| known == sample) {
            kept += 1;
            left = &left[place + 1..];
        }
    }
    kept
}

#[test]
fn a_survey_says_what_there_is_and_from_when_to_when() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.ulg");
    fs::write(&path, ulog::log(100)).unwrap();
    let survey = Survey::of(&path, Format::Ulog).unwrap();
    let found: Vec<_> =
        survey.topics.iter().map(|topic| (topic.topic.name.as_str(), topic.samples)).collect();
    assert_eq!(found, [("vehicle_local_position", 100), ("battery_status", 100), ("battery_status[1]", 100)]);
    assert_eq!(survey.parameters["MPC_THR_HOVER"], 0.5);
    assert_eq!(survey.about["sys_name"], "PX4");
    assert!(survey.topics.iter().all(|topic| topic.span_ns == Some([0, 990_000_000])));
}

#[test]
fn a_file_that_is_not_there_is_named() {
    for format in [Format::Ulog, Format::Dataflash, Format::Parquet, Format::Mcap] {
        let error = scan("nowhere.log".as_ref(), format, &mut Read::default()).unwrap_err();
        assert!(error.to_string().contains("nowhere.log"), "{error}");
    }
}

proptest! {
    // Each case opens four files.
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn bytes_of_any_kind_are_read_without_a_panic(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
        let heads: [(Format, &[u8]); 4] = [
            (Format::Ulog, b"ULog\x01\x12\x35\x01\0\0\0\0\0\0\0\0"),
            (Format::Dataflash, b"\xa3\x95\x80\x80"),
            (Format::Parquet, b"PAR1"),
            (Format::Mcap, b"\x89MCAP0\r\n"),
        ];
        for (format, head) in heads {
            let _ = read(format, &[head, &bytes].concat());
        }
    }

    /// Damage of eight bytes costs the messages that it lies in, and those that the search for the next ones passes over.
    #[test]
    fn damage_costs_what_is_damaged(at in 0.1_f64..0.9, with in prop::array::uniform8(any::<u8>())) {
        for (format, bytes) in [(Format::Ulog, ulog::log(200)), (Format::Dataflash, dataflash::log(200))] {
            let whole = read(format, &bytes).unwrap();
            let mut damaged = bytes.clone();
            let at = bytes.len() / 10 + (at * 0.9 * bytes.len() as f64) as usize;
            damaged[at..at + 8].copy_from_slice(&with);
            let part = read(format, &damaged).unwrap();
            prop_assert!(kept(&whole, &part) + 8 >= whole.samples.len(), "{format:?}: {} of {}", kept(&whole, &part), whole.samples.len());
        }
    }

    #[test]
    fn damage_anywhere_is_read_without_a_panic(at in 0.0_f64..1.0, with in any::<u8>()) {
        let logs = [
            (Format::Ulog, ulog::log(20)),
            (Format::Dataflash, dataflash::log(20)),
            (Format::Parquet, parquet::log(20)),
            (Format::Mcap, mcap::log(20)),
        ];
        for (format, mut bytes) in logs {
            let at = (at * bytes.len() as f64) as usize;
            bytes[at] = with;
            let _ = read(format, &bytes);
        }
    }
}
