//! The public Python packages read a recording in full and see the same values.

mod common;

use std::{env, path::Path, process::Command};

use bench_recording::{Channel, Field, Record, Value, ViewerChannel};
use common::{one_of_each, session, write};
use serde_json::Value as Json;
use tempfile::tempdir;

#[test]
#[ignore = "needs BENCH_PYTHON; tests/run sets it up"]
fn python_sees_the_same_values() {
    let python = env::var_os("BENCH_PYTHON").expect("BENCH_PYTHON names a Python with mcap-protobuf-support");
    let folder = tempdir().unwrap();
    let records: Vec<_> = (0..30).flat_map(|i| one_of_each(f64::from(i) * 0.1)).collect();
    let (path, finished) = write(folder.path(), "python.mcap", &session(), &records);
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/python_reader.py");
    let output = Command::new(python).arg(script).arg(&path).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let seen: Json = serde_json::from_slice(&output.stdout).unwrap();

    assert_eq!(seen["message_count"], finished.messages);
    assert_eq!(seen["attachments"]["rig.toml"], session().rig_toml.unwrap());
    assert_eq!(seen["metadata"]["bench"]["seed"], "7");
    for channel in Channel::ALL {
        let messages = seen["messages"][channel.topic()].as_array().unwrap();
        let of_channel: Vec<_> = records.iter().filter(|record| record.channel() == channel).collect();
        assert_eq!(messages.len(), of_channel.len(), "{channel:?}");
        for (message, record) in messages.iter().zip(of_channel) {
            assert_eq!(message[0], record.time().nanos());
            check(&message[1], record);
        }
    }
    let poses = seen["messages"][ViewerChannel::Pose.topic()].as_array().unwrap();
    assert_eq!(poses.len(), 30);
    let Record::Truth(truth) = records[5] else { panic!("the sixth record is a truth") };
    assert_eq!(poses[0][1]["frame_id"], "world");
    assert_eq!(poses[0][1]["pose"]["position"]["z"], truth.position_m[2]);
    assert_eq!(poses[0][1]["pose"]["orientation"]["w"], truth.attitude[0]);
}

fn check(message: &Json, record: &Record) {
    if let Record::Event(event) = record {
        assert_eq!(message["message"], event.text.as_str());
        assert_eq!(message["level"], "WARNING");
        return;
    }
    for (field, value) in record.channel().fields().iter().zip(record.values()) {
        let seen = find(message, field);
        let context = format!("{:?} {}: {seen}", record.channel(), field.name);
        match value {
            Value::Missing => assert!(seen.is_null(), "{context}"),
            Value::Float(x) => assert_eq!(seen.as_f64(), Some(x), "{context}"),
            Value::Bool(yes) => assert_eq!(seen.as_bool(), Some(yes), "{context}"),
            // In JSON, protobuf's 64-bit integers are strings.
            Value::Integer(n) => assert_eq!(seen.as_str(), Some(n.to_string().as_str()), "{context}"),
            Value::Time(t) => assert_eq!(seen.as_str(), Some(t.nanos().to_string().as_str()), "{context}"),
            // Enumerations carry their type's name: TRACK_STATUS_FOUND.
            Value::Text(name) => {
                let ending = format!("_{}", name.to_uppercase());
                assert!(seen.as_str().is_some_and(|seen| seen.ends_with(&ending)), "{context}");
            }
        }
    }
}

/// The message's value of a field; times are in nanoseconds there.
fn find<'a>(message: &'a Json, field: &Field) -> &'a Json {
    let name = match field.kind {
        bench_recording::Kind::Time => format!("{}ns", field.name.strip_suffix('s').unwrap()),
        _ => field.name.to_owned(),
    };
    name.split('.').fold(message, |within, part| &within[part])
}
