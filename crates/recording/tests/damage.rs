//! Damage is named, never read as data, and what is whole comes back.

mod common;

use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
    sync::LazyLock,
};

use bench_recording::{
    Channel, Info, Mode, Options, Record, Recorder, Recording, RecordingError, Session, recover,
};
use common::{flight, one_of_each, session, write};
use mcap::records::op;
use proptest::prelude::*;
use tempfile::{TempDir, tempdir};

fn records(path: &Path) -> Vec<Record> {
    Recording::open(path).unwrap().records().unwrap().map(Result::unwrap).collect()
}

fn file(folder: &TempDir, name: &str, content: &[u8]) -> PathBuf {
    let path = folder.path().join(name);
    fs::write(&path, content).unwrap();
    path
}

/// A closed flight of 5 s.
struct Whole {
    bytes: Vec<u8>,
    records: Vec<Record>,
    chunks: Vec<Chunk>,
}

/// Where a chunk lies in the file, and how many records there are up to its end.
struct Chunk {
    start: usize,
    end: usize,
    records: usize,
}

static WHOLE: LazyLock<Whole> = LazyLock::new(|| {
    let folder = tempdir().unwrap();
    let records = flight(5.0);
    let (path, _) = write(folder.path(), "whole.mcap", &session(), &records);
    let bytes = fs::read(path).unwrap();
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let mut records_so_far = 0;
    let chunks = summary
        .chunk_indexes
        .iter()
        .map(|index| {
            let messages = summary.stream_chunk(&bytes, index).unwrap();
            let is_record = |m: &mcap::Message| Channel::from_topic(&m.channel.topic).is_some();
            records_so_far += messages.filter(|m| is_record(m.as_ref().unwrap())).count();
            Chunk {
                start: index.chunk_start_offset as usize,
                end: (index.chunk_start_offset + index.chunk_length) as usize,
                records: records_so_far,
            }
        })
        .collect();
    Whole { bytes, records, chunks }
});

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_cut_file_gives_back_every_chunk_before_the_cut(share in 0.0..1.0_f64) {
        let whole = &*WHOLE;
        let cut = (whole.bytes.len() as f64 * share) as usize;
        let folder = tempdir().unwrap();
        let input = file(&folder, "cut.mcap", &whole.bytes[..cut]);
        let output = folder.path().join("recovered.mcap");
        let flushed = whole.chunks.iter().rfind(|chunk| chunk.end <= cut).map_or(0, |chunk| chunk.records);
        match recover(&input, &output) {
            Ok(report) => {
                let got = records(&output);
                prop_assert_eq!(got.len(), flushed);
                prop_assert!(got[..] == whole.records[..got.len()]);
                prop_assert!(!report.closed);
                // Nothing is lost silently: a file with all records was cut within what follows them.
                prop_assert!(report.lost || report.trailing_bytes == 0);
                let recording = Recording::open(&output).unwrap();
                prop_assert!(recording.info().recovered);
                prop_assert_eq!(recording.session().mode, Mode::Sim);
                if !got.is_empty() {
                    prop_assert_eq!(recording.session(), &session());
                }
            }
            // Cut before its session was whole.
            Err(error) => {
                prop_assert_eq!(flushed, 0);
                prop_assert!(cut < 600, "{}: {}", cut, error);
                prop_assert!(!output.exists());
            }
        }
    }

    #[test]
    fn a_flipped_byte_is_an_error_or_changes_nothing(at in 0.0..1.0_f64, mask in 1..=255_u8) {
        let at = (WHOLE.bytes.len() as f64 * at) as usize;
        flipped(at, mask);
    }
}

/// A byte of the flight with some of its bits flipped gives an error, or nothing but what was recorded.
fn flipped(at: usize, mask: u8) {
    let whole = &*WHOLE;
    let mut bytes = whole.bytes.clone();
    bytes[at] ^= mask;
    let folder = tempdir().unwrap();
    let input = file(&folder, "flipped.mcap", &bytes);
    // Whatever was read before the damage was found is right.
    let read = Recording::open(&input).and_then(|recording| Ok(recording.records()?.collect::<Vec<_>>()));
    if let Ok(read) = read {
        let good: Vec<_> = read.iter().map_while(|record| record.as_ref().ok().copied()).collect();
        assert!(good[..] == whole.records[..good.len()], "byte {at} by {mask}");
        assert!(
            good.len() == whole.records.len() || read.last().is_some_and(Result::is_err),
            "byte {at} by {mask}"
        );
    }
    // What is recovered is a part of what was recorded, in its order.
    let output = folder.path().join("recovered.mcap");
    if recover(&input, &output).is_ok() {
        let mut rest = whole.records.iter();
        let recovered = records(&output);
        assert!(
            recovered.iter().all(|record| rest.any(|original| original == record)),
            "byte {at} by {mask}"
        );
    }
}

/// An index of messages taken for a message, say: records outside chunks have no checksum of their own.
#[test]
fn a_record_whose_kind_is_damaged_is_not_read_as_another() {
    let Whole { bytes, chunks, .. } = &*WHOLE;
    // One chunk's followers are like another's.
    let alike = chunks[1].start..chunks[chunks.len() - 1].start;
    let mut at = mcap::MAGIC.len();
    let mut kinds = BTreeSet::new();
    while at < bytes.len() - mcap::MAGIC.len() {
        let kind = bytes[at];
        kinds.insert(kind);
        for other in (1..=op::DATA_END).filter(|other| *other != kind && !alike.contains(&at)) {
            flipped(at, kind ^ other);
        }
        at += 9 + u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
    }
    assert!(kinds.contains(&op::MESSAGE_INDEX), "{kinds:?}");
}

/// A chunk whose head is damaged may look like a record that a reader has to skip.
#[test]
fn a_chunk_with_a_damaged_head_is_missed_where_it_should_be() {
    let whole = &*WHOLE;
    let folder = tempdir().unwrap();
    let chunk = &whole.chunks[2];
    for (byte, bit) in (0..9).flat_map(|byte| (0..8).map(move |bit| (byte, bit))) {
        let mut bytes = whole.bytes.clone();
        bytes[chunk.start + byte] ^= 1 << bit;
        let input = file(&folder, "head.mcap", &bytes);
        let read: Vec<_> = Recording::open(&input).unwrap().records().unwrap().collect();
        let (last, good) = read.split_last().unwrap();
        assert!(last.is_err(), "byte {byte}, bit {bit}");
        let good: Vec<_> = good.iter().map(|record| *record.as_ref().unwrap()).collect();
        // With a wrong length, what the chunk's own checksum covers may still be whole.
        let whole_chunks = [&whole.chunks[1], chunk].map(|chunk| chunk.records);
        assert!(whole_chunks.contains(&good.len()), "byte {byte}, bit {bit}: {}", good.len());
        assert!(good[..] == whole.records[..good.len()], "byte {byte}, bit {bit}");
        let report = recover(&input, folder.path().join("recovered.mcap")).unwrap();
        assert!(report.lost, "byte {byte}, bit {bit}: {report:?}");
    }
}

#[test]
fn a_session_that_nobody_could_read_is_not_recovered() {
    let folder = tempdir().unwrap();
    let mut bytes = WHOLE.bytes.clone();
    let key = b"schema_version";
    let at = bytes.windows(key.len()).position(|window| window == key).unwrap();
    bytes[at] ^= 1;
    let input = file(&folder, "session.mcap", &bytes);
    let output = folder.path().join("recovered.mcap");
    let error = recover(&input, &output).unwrap_err();
    assert!(matches!(error, RecordingError::BadSession { key: "schema_version", .. }), "{error}");
    assert!(!output.exists());
}

#[test]
fn a_damaged_chunk_is_left_out_and_told() {
    let whole = &*WHOLE;
    let folder = tempdir().unwrap();
    let mut bytes = whole.bytes.clone();
    let (before, after) = (whole.chunks[1].records, whole.chunks[2].records);
    bytes[usize::midpoint(whole.chunks[2].start, whole.chunks[2].end)] ^= 0x10;
    let input = file(&folder, "chunk.mcap", &bytes);

    let error = Recording::open(&input).unwrap().records().unwrap().find_map(Result::err).unwrap();
    assert!(matches!(error, RecordingError::Damaged { .. }), "{error}");

    let output = folder.path().join("recovered.mcap");
    let report = recover(&input, &output).unwrap();
    assert!(report.lost && report.closed);
    assert_eq!(report.damaged_records, 1);
    assert_eq!(records(&output), [&whole.records[..before], &whole.records[after..]].concat());
}

#[test]
fn a_whole_recording_recovers_to_itself() {
    let whole = &*WHOLE;
    let folder = tempdir().unwrap();
    let input = file(&folder, "whole.mcap", &whole.bytes);
    let output = folder.path().join("recovered.mcap");
    let report = recover(&input, &output).unwrap();
    assert!(report.closed && !report.lost);
    assert_eq!(report.attachments, ["rig.toml", "mission.toml"]);
    assert_eq!(records(&output), whole.records);
    assert_eq!(Recording::open(&output).unwrap().session(), &session());
}

#[test]
fn a_recorder_that_is_dropped_leaves_a_file_that_is_open_and_recovers_whole() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("dropped.mcap");
    let records_in = flight(3.0);
    let mut recorder = Recorder::create(&path, &session(), Options::SIMULATION).unwrap();
    for record in &records_in {
        recorder.record(*record);
    }
    drop(recorder);

    assert!(matches!(Recording::open(&path), Err(RecordingError::Unfinished { .. })));
    let info = Info::read(&path).unwrap();
    assert!(!info.closed);
    assert_eq!(info.rig, "virtual");

    let output = folder.path().join("recovered.mcap");
    let report = recover(&path, &output).unwrap();
    assert!(!report.closed && !report.lost);
    assert_eq!(report.messages, info.messages);
    assert_eq!(records(&output), records_in);
}

#[test]
fn recover_does_not_write_over_its_input() {
    let folder = tempdir().unwrap();
    let input = file(&folder, "whole.mcap", &WHOLE.bytes);
    let error = recover(&input, folder.path().join(".").join("whole.mcap")).unwrap_err();
    assert!(matches!(error, RecordingError::OutputIsInput { .. }), "{error}");
    assert_eq!(fs::read(&input).unwrap(), WHOLE.bytes);
}

#[test]
fn a_failed_recovery_leaves_no_file() {
    let folder = tempdir().unwrap();
    let input = file(&folder, "foreign.mcap", &foreign_mcap());
    let error = recover(&input, folder.path().join("out.mcap")).unwrap_err();
    assert!(error.to_string().contains("/imu"), "{error}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}

/// An MCAP file of somebody else.
fn foreign_mcap() -> Vec<u8> {
    let mut writer = mcap::Writer::new(std::io::Cursor::new(Vec::new())).unwrap();
    let channel = writer.add_channel(0, "/imu", "json", &[].into()).unwrap();
    let header =
        mcap::records::MessageHeader { channel_id: channel, sequence: 0, log_time: 1, publish_time: 1 };
    writer.write_to_known_channel(&header, b"{}").unwrap();
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

#[test]
fn files_that_are_no_recordings_are_told_apart() {
    let folder = tempdir().unwrap();
    let open = |content: &[u8]| Recording::open(file(&folder, "x.mcap", content)).unwrap_err();
    assert!(matches!(open(b""), RecordingError::Empty { .. }));
    assert!(matches!(open(b"time,z\n0,0\n"), RecordingError::NotMcap { .. }));
    assert!(matches!(open(b"x"), RecordingError::NotMcap { .. }));
    let whole = &WHOLE.bytes;
    assert!(matches!(open(&whole[..whole.len() / 2]), RecordingError::Unfinished { .. }));
    assert!(matches!(open(&whole[..whole.len() - 1]), RecordingError::Unfinished { .. }));
    let RecordingError::NotBench { channels, .. } = open(&foreign_mcap()) else { panic!("not told apart") };
    assert!(matches!(channels.as_slice(), [only] if only.starts_with("/imu")), "{channels:?}");
    let missing = Recording::open(folder.path().join("none.mcap")).unwrap_err();
    assert!(missing.to_string().contains("none.mcap"), "{missing}");
}

#[test]
fn a_later_schema_is_refused_with_both_versions() {
    let folder = tempdir().unwrap();
    let mut writer = mcap::Writer::new(std::io::Cursor::new(Vec::new())).unwrap();
    let metadata = [("mode", "sim"), ("schema_version", "1000")].map(|(k, v)| (k.to_owned(), v.to_owned()));
    writer
        .write_metadata(&mcap::records::Metadata { name: "bench".into(), metadata: metadata.into() })
        .unwrap();
    writer.finish().unwrap();
    let path = file(&folder, "later.mcap", &writer.into_inner().into_inner());
    let error = Recording::open(path).unwrap_err();
    assert!(matches!(error, RecordingError::NewerSchema { found: 1000, known: 2, .. }), "{error}");
}

#[test]
fn options_that_make_no_sense_are_refused() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("x.mcap");
    for flush_interval_s in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let options = Options { flush_interval_s, ..Options::SIMULATION };
        let error = Recorder::create(&path, &Session::new(Mode::Sim), options).unwrap_err();
        assert!(matches!(error, RecordingError::BadOption { option: "flush_interval_s", .. }), "{error}");
    }
    let options = Options { queue_capacity: 0, ..Options::SIMULATION };
    assert!(Recorder::create(&path, &Session::new(Mode::Sim), options).is_err());
    assert!(!path.exists());
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_told() {
    let error = Recorder::create("/dev/full", &session(), Options::SIMULATION).unwrap_err();
    let RecordingError::Io { source, .. } = &error else { panic!("{error}") };
    assert_eq!(source.kind(), std::io::ErrorKind::StorageFull);
}

#[test]
fn a_queue_of_one_loses_nothing_when_it_may_block() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("small.mcap");
    let options = Options { queue_capacity: 1, ..Options::SIMULATION };
    let mut recorder = Recorder::create(&path, &session(), options).unwrap();
    let records_in: Vec<_> = (0..20).flat_map(|i| one_of_each(f64::from(i))).collect();
    for record in &records_in {
        recorder.record(*record);
    }
    assert_eq!(recorder.finish().unwrap().dropped, 0);
    assert_eq!(records(&path), records_in);
}
