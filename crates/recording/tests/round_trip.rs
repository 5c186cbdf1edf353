//! What is recorded is what is read, and the same records give the same bytes.

mod common;

use std::{fs, path::Path};

use bench_device::Time;
use bench_recording::{Channel, Flight, Info, Mode, Recording, Session, Value};
use bench_rig::{Phase, Rig};
use common::{flight, one_of_each, session, write};
use tempfile::tempdir;

#[test]
fn every_kind_of_record_comes_back_as_it_was() {
    let folder = tempdir().unwrap();
    let records: Vec<_> = (0..30).flat_map(|i| one_of_each(f64::from(i) * 0.1)).collect();
    let (path, finished) = write(folder.path(), "all.mcap", &session(), &records);
    let recording = Recording::open(&path).unwrap();
    let read: Vec<_> = recording.records().unwrap().map(Result::unwrap).collect();
    assert_eq!(read, records);
    for channel in Channel::ALL {
        assert_eq!(recording.count(channel), 30, "{channel:?}");
    }
    // For viewers the truth stands twice more, as a pose and as a transform; so does the first position, which comes before any truth.
    // The rig tells no room.
    assert_eq!(finished.messages, 300 + 2 * 30 + 2);
    assert_eq!(finished.bytes, fs::metadata(&path).unwrap().len());
    assert_eq!(finished.dropped, 0);
}

#[test]
fn the_session_comes_back_as_it_was() {
    let folder = tempdir().unwrap();
    for session in
        [session(), Session::new(Mode::Import), Session { seed: Some(u64::MAX), ..session() }, with_epoch()]
    {
        let (path, _) = write(folder.path(), "session.mcap", &session, &one_of_each(0.0));
        assert_eq!(Recording::open(&path).unwrap().session(), &session);
    }
}

/// A session that began in 2023.
fn with_epoch() -> Session {
    Session { epoch_unix_ns: Some(1_700_000_000_250_000_000), ..session() }
}

/// Log times and events count from the epoch in the file, and from the origin in what is read.
#[test]
fn an_epoch_moves_log_times_and_nothing_that_is_read() {
    let folder = tempdir().unwrap();
    let records = flight(3.0);
    let (plain, _) = write(folder.path(), "plain.mcap", &session(), &records);
    let (path, _) = write(folder.path(), "epoch.mcap", &with_epoch(), &records);
    let recording = Recording::open(&path).unwrap();
    assert_eq!(recording.records().unwrap().map(Result::unwrap).collect::<Vec<_>>(), records);
    let (info, without) = (Info::read(&path).unwrap(), Info::read(plain).unwrap());
    assert_eq!((info.first_time_s, info.last_time_s), (without.first_time_s, without.last_time_s));
    assert_eq!((info.epoch_unix_s, without.epoch_unix_s), (Some(1_700_000_000.25), None));
    // Readers of before would take the time of events for a time of flight.
    assert_eq!((info.schema_version, without.schema_version), (2, 1));
    let bytes = fs::read(&path).unwrap();
    let first = mcap::MessageStream::new(&bytes).unwrap().next().unwrap().unwrap();
    assert_eq!(first.log_time, 1_700_000_000_250_000_000);
}

#[test]
fn the_same_records_give_the_same_bytes() {
    let folder = tempdir().unwrap();
    let records = flight(20.0);
    let bytes: Vec<_> = ["a.mcap", "b.mcap"]
        .map(|name| fs::read(write(folder.path(), name, &session(), &records).0).unwrap())
        .into();
    assert!(bytes[0] == bytes[1]);
}

#[test]
fn info_tells_what_a_recording_holds() {
    let folder = tempdir().unwrap();
    let (path, finished) = write(folder.path(), "info.mcap", &session(), &flight(2.0));
    let info = Info::read(&path).unwrap();
    assert_eq!((info.closed, info.recovered, info.dropped), (true, false, Some(0)));
    assert_eq!((info.mode.as_str(), info.rig.as_str(), info.mission.as_str()), ("sim", "virtual", "hop"));
    assert_eq!(info.seed, Some(7));
    assert_eq!(info.messages, finished.messages);
    assert_eq!(info.size_bytes, finished.bytes);
    assert_eq!(info.first_time_s, Some(0.0));
    assert_eq!(info.last_time_s, Some(1.98));
    let counts: Vec<_> = info.channels.iter().map(|c| (c.name.as_str(), c.messages)).collect();
    assert_eq!(
        counts,
        [
            ("/battery", 2),
            ("/bench/event", 2),
            ("/control/command", 20),
            ("/control/state", 20),
            ("/dac/readback", 20),
            ("/loop/tick", 20),
            // One each 0.04 s, for at most thirty a second.
            ("/plant/pose", 50),
            ("/plant/truth", 100),
            ("/rotor", 2),
            // Where the truth was, viewers have the airframe.
            ("/tf", 50),
            ("/tracker/position", 50),
        ]
    );
    let json = serde_json::to_value(&info).unwrap();
    assert_eq!(json["schema"], "bench.info/1");
    assert_eq!(json["attachments"][0]["name"], "rig.toml");
}

#[test]
fn a_recording_without_messages_is_whole_and_has_no_times() {
    let folder = tempdir().unwrap();
    let (path, _) = write(folder.path(), "empty.mcap", &session(), &[]);
    let info = Info::read(&path).unwrap();
    assert_eq!((info.messages, info.first_time_s, info.duration_s), (0, None, 0.0));
    assert!(info.channels.is_empty());
    assert_eq!(Recording::open(&path).unwrap().records().unwrap().count(), 0);
}

#[test]
fn each_field_has_values_of_its_kind_and_the_first_is_the_time() {
    for record in one_of_each(0.3) {
        let values = record.values();
        let fields = record.channel().fields();
        assert_eq!(values.len(), fields.len());
        assert_eq!(values[0], Value::Time(record.time()), "{:?}", record.channel());
        for (field, value) in fields.iter().zip(&values) {
            let kind = value.kind();
            assert!(kind.is_none_or(|kind| kind == field.kind), "{}: {value:?}", field.name);
        }
    }
}

#[test]
fn a_flight_is_sorted_and_counts_what_was_not() {
    let mut records = flight(1.0);
    let moved = records.remove(0);
    records.insert(10, moved);
    let flight = Flight::from_records(session(), records);
    assert!(flight.truth.is_sorted_by_key(|truth| truth.time));
    assert_eq!(flight.truth.len(), 50);
    assert_eq!(flight.out_of_order, [(Channel::Truth, 1)]);
}

#[test]
fn commands_hold_until_the_next() {
    let flight = Flight::from_records(session(), flight(1.0));
    assert_eq!(flight.command_at(Time::from_seconds(0.199)).unwrap().time, Time::from_seconds(0.1));
    assert_eq!(flight.command_at(Time::from_seconds(0.2)).unwrap().time, Time::from_seconds(0.2));
    assert_eq!(flight.command_at(Time::from_seconds(9.0)).unwrap().time, Time::from_seconds(0.9));
    let late = Flight::from_records(session(), one_of_each(1.0));
    assert_eq!(late.command_at(Time::from_seconds(0.5)), None);
}

#[test]
fn phases_follow_one_another_without_gaps() {
    use bench_recording::Record;
    let phases = [Phase::Idle, Phase::Idle, Phase::Launch, Phase::Hold, Phase::Hold];
    let states = phases.into_iter().zip(0..).map(|(phase, i)| {
        let mut record = one_of_each(f64::from(i) * 0.1)[2];
        if let Record::ControlState(state) = &mut record {
            state.phase = phase;
        }
        record
    });
    let intervals = Flight::from_records(session(), states).phases();
    let summary: Vec<_> = intervals
        .iter()
        .map(|i| (i.phase, i.from.nanos() / 100_000_000, i.to.nanos() / 100_000_000))
        .collect();
    assert_eq!(summary, [(Phase::Idle, 0, 2), (Phase::Launch, 2, 3), (Phase::Hold, 3, 4)]);
}

#[test]
fn the_document_lists_every_channel_and_field() {
    let document = include_str!("../../../docs/recording.md");
    for channel in Channel::ALL {
        let row = document.lines().find(|line| line.starts_with(&format!("| `{}` |", channel.topic())));
        let row = row.unwrap_or_else(|| panic!("docs/recording.md has no row of {}", channel.topic()));
        for field in channel.fields() {
            assert!(row.contains(&format!("`{}`", field.name)), "{} lacks {}", channel.topic(), field.name);
        }
    }
}

#[test]
fn a_rig_at_hand_and_its_text_alone_give_the_same_bytes() {
    let rigs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs");
    let rig = Rig::load(rigs.join("transmitter.toml")).unwrap();
    let with_text = Session { rig_toml: Some(rig.to_toml()), ..session() };
    let with_rig = Session { rig: Some(Box::new(rig)), ..with_text.clone() };
    let folder = tempdir().unwrap();
    let [text, at_hand] = [("text.mcap", with_text), ("rig.mcap", with_rig)].map(|(name, session)| {
        let (path, _) = write(folder.path(), name, &session, &one_of_each(0.5));
        fs::read(path).unwrap()
    });
    assert!(mcap::MessageStream::new(&at_hand).unwrap().any(|m| m.unwrap().channel.topic == "/scene"));
    assert!(text == at_hand);
}
