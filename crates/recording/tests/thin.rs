//! The thinned form of a recording: what stays of it, and that it is one.

mod common;

use std::fs;

use bench_device::Time;
use bench_recording::{
    Channel, Info, Level, Record, Recording, RecordingError, Session, Tick, Truth, ViewerChannel, thin,
};
use common::{session, write};
use tempfile::tempdir;

#[test]
fn a_record_of_each_channel_an_interval_stays_with_all_events_and_nothing_for_viewers() {
    let folder = tempdir().unwrap();
    let mut records: Vec<Record> = Vec::new();
    for i in 0..200_u32 {
        let time = Time::from_seconds(f64::from(i) * 0.02);
        records.push(
            Truth { time, position_m: [0.0, 0.0, 0.1], thrust_n: f64::from(i), ..Truth::default() }.into(),
        );
        if i % 5 == 0 {
            // A loop of 10 Hz that is late by up to 30 ms, by turns.
            let started = time.shifted(f64::from(i % 4) * 0.01);
            records.push(Tick { index: u64::from(i / 5), started, ..Tick::default() }.into());
            let text = bench_recording::EventText::from("now").unwrap();
            for later_s in [0.0, 0.001] {
                let event = bench_recording::Event { time: time.shifted(later_s), level: Level::Info, text };
                records.push(event.into());
            }
        }
    }
    let session = Session { epoch_unix_ns: Some(1_700_000_000_000_000_000), ..session() };
    let (whole, _) = write(folder.path(), "whole.mcap", &session, &records);
    let thinned = ["a.mcap", "b.mcap"].map(|name| folder.path().join(name));
    for path in &thinned {
        thin(&whole, path, 0.1).unwrap();
    }
    assert_eq!(fs::read(&thinned[0]).unwrap(), fs::read(&thinned[1]).unwrap());

    let recording = Recording::open(&thinned[0]).unwrap();
    let kept: Vec<Record> = recording.records().unwrap().map(Result::unwrap).collect();
    let of = |channel: Channel| kept.iter().filter(move |record| record.channel() == channel);
    assert_eq!([Channel::Tick, Channel::Event].map(|channel| of(channel).count()), [40, 80]);
    let times: Vec<f64> = of(Channel::Truth).map(|record| record.time().seconds()).collect();
    assert_eq!(times.len(), 40);
    assert!(times.windows(2).all(|pair| (pair[1] - pair[0] - 0.1).abs() < 1e-9), "{times:?}");
    for record in &kept {
        // What stays is as it was, in single precision.
        let mut as_it_was = *record;
        if let Record::Truth(truth) = &mut as_it_was {
            assert_eq!(truth.position_m[2], f64::from(0.1_f32));
            truth.position_m[2] = 0.1;
        }
        assert!(records.contains(&as_it_was), "{record:?}");
    }
    let info = Info::read(&thinned[0]).unwrap();
    assert!(info.channels.iter().all(|channel| ViewerChannel::ALL.iter().all(|v| v.topic() != channel.name)));
    assert_eq!(info.dropped, Some(0));
    let mut expected = session;
    expected.extra.insert("thinned_to_s".to_owned(), "0.1".to_owned());
    assert_eq!(recording.session(), &expected);
}

#[test]
fn what_cannot_be_thinned_is_refused_and_nothing_is_left() {
    let folder = tempdir().unwrap();
    let (whole, _) = write(folder.path(), "whole.mcap", &session(), &common::one_of_each(0.0));
    let other = folder.path().join("other.mcap");
    assert!(matches!(thin(&whole, &whole, 0.1), Err(RecordingError::OutputIsInput { .. })));
    assert!(matches!(thin(&whole, &other, f64::NAN), Err(RecordingError::BadOption { .. })));
    let bytes = fs::read(&whole).unwrap();
    fs::write(&whole, &bytes[..bytes.len() / 2]).unwrap();
    assert!(thin(&whole, &other, 0.1).is_err());
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}
