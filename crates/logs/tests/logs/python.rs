//! The formats' own Python packages see the same in a log, field by field: `pyulog`, `pymavlink`, `orangebox`, `rosbags`.

use std::{collections::BTreeSet, env, fs, path::Path, process::Command};

use bench_logs::Format;
use serde_json::Value;

use crate::{
    Read, blackbox, dataflash, read, ulog,
    writers::{Ulog, floats},
};

fn reference(arguments: &[&str]) -> Value {
    let python = env::var_os("BENCH_PYTHON")
        .expect("BENCH_PYTHON names a Python with pyulog, pymavlink, orangebox and rosbags");
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/python_logs.py");
    let output = Command::new(python).arg(script).args(arguments).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Whether a cell is what the reference has: numbers to their last bit.
fn is_same(cell: &str, theirs: &Value) -> bool {
    match theirs {
        Value::String(text) => cell == text || text == "NaN" && cell.parse::<f64>().is_ok_and(f64::is_nan),
        Value::Number(number) => match (number.as_i64(), number.as_u64()) {
            (Some(whole), _) => cell.parse() == Ok(whole) || cell.parse() == Ok(whole as f64),
            (None, Some(whole)) => cell.parse() == Ok(whole),
            (None, None) => cell.parse::<f64>().ok() == number.as_f64(),
        },
        other => panic!("{other}"),
    }
}

/// Holds what we read against what the reference reads: every topic, every message, every field.
fn holds(ours: &Read, theirs: &Value) {
    let theirs = theirs["topics"].as_object().unwrap();
    let known: BTreeSet<&str> = ours.topics.iter().map(|topic| topic.name.as_str()).collect();
    let mut compared = 0;
    for (place, topic) in ours.topics.iter().enumerate() {
        let rows =
            theirs.get(&topic.name).unwrap_or_else(|| panic!("{} is not in {:?}", topic.name, theirs.keys()));
        let samples: Vec<_> = ours.samples.iter().filter(|sample| sample.topic == place).collect();
        assert_eq!(samples.len(), rows.as_array().unwrap().len(), "{}", topic.name);
        for (sample, row) in samples.iter().zip(rows.as_array().unwrap()) {
            for (name, value) in row.as_object().unwrap() {
                let at = topic.fields.iter().position(|field| field.name == *name);
                let at = at.unwrap_or_else(|| panic!("{}.{name}: {:?}", topic.name, topic.fields));
                let cell = &sample.cells[at];
                assert!(is_same(cell, value), "{}.{name}: {cell}, and by the reference {value}", topic.name);
                compared += 1;
            }
            // What the reference does not have is a list that is shorter in this message.
            for (field, cell) in topic.fields.iter().zip(&sample.cells) {
                let is_there = row.get(&field.name).is_some();
                assert!(is_there || cell.is_empty(), "{}.{}", topic.name, field.name);
            }
        }
    }
    // Formats and what describes others are no topics here.
    let described = ["FMT", "FMTU", "UNIT", "MULT"];
    assert!(
        theirs.keys().all(|name| known.contains(name.as_str()) || described.contains(&name.as_str())),
        "{known:?}"
    );
    assert!(compared > 0);
}

/// A log with every type that the format has, a message in a message, and texts.
fn of_all_types() -> Vec<u8> {
    let mut log = Ulog::new();
    log.info("sys_name", "PX4");
    log.parameter("MPC_THR_HOVER", 0.5);
    log.parameter("VM_MASS", 1.25);
    log.format("report:float rpm;int16_t count;uint8_t[2] _padding0;");
    log.format(
        "all:uint64_t timestamp;double d;int64_t i64;float f;int32_t i32;uint32_t u32;int16_t i16;uint16_t u16;int8_t i8;uint8_t u8;bool b;\
         uint8_t[1] _padding0;report[2] esc;float[3] three;",
    );
    log.subscribe(3, 0, "all");
    for k in 0..50_i32 {
        let mut values = Vec::new();
        values.extend((f64::from(k) / 3.0).to_le_bytes());
        values.extend((i64::from(k) - i64::MAX).to_le_bytes());
        values.extend(if k == 7 { f32::NAN } else { 0.1 * k as f32 }.to_le_bytes());
        values.extend((-k).to_le_bytes());
        values.extend((u32::MAX - k.unsigned_abs()).to_le_bytes());
        values.extend((-3_i16).to_le_bytes());
        values.extend((65_000_u16).to_le_bytes());
        values.extend([(-5_i8).cast_unsigned(), 250, 1, 0]);
        for esc in 0..2_i16 {
            values.extend(floats(&[1000.5 + f64::from(k)]));
            values.extend((esc - 1).to_le_bytes());
            values.extend([0, 0]);
        }
        values.extend(floats(&[1.0, 2.0, f64::from(k)]));
        log.data(3, 1000 + u64::from(k.unsigned_abs()) * 4000, &values);
        if k == 20 {
            log.dropout(30);
        }
    }
    log.bytes()
}

#[test]
#[ignore = "needs BENCH_PYTHON; tests/run sets it up"]
fn python_reads_the_same_of_a_ulog_and_writes_one_that_we_read() {
    let folder = tempfile::tempdir().unwrap();
    let name = |file: &str| folder.path().join(file).to_str().unwrap().to_owned();
    for bytes in [ulog::log(100), of_all_types()] {
        fs::write(name("log.ulg"), &bytes).unwrap();
        let theirs = reference(&["ulog", &name("log.ulg"), &name("again.ulg")]);
        let ours = read(Format::Ulog, &bytes).unwrap();
        holds(&ours, &theirs);
        assert_eq!(theirs["dropouts"], ours.losses.dropouts);
        for (parameter, value) in &ours.parameters {
            assert_eq!(theirs["parameters"][parameter], *value);
        }
        // What pyulog wrote.
        let again = read(Format::Ulog, &fs::read(name("again.ulg")).unwrap()).unwrap();
        assert_eq!((again.losses.cut, again.losses.damaged), (false, 0));
        holds(&again, &theirs);
        assert_eq!(again.parameters, ours.parameters);
        // A flight that ended in a crash, cut in the middle of a message and between two.
        for end in [bytes.len() / 2, bytes.len() / 2 + 7, bytes.len() - 3] {
            fs::write(name("cut.ulg"), &bytes[..end]).unwrap();
            holds(&read(Format::Ulog, &bytes[..end]).unwrap(), &reference(&["ulog", &name("cut.ulg")]));
        }
    }
}

#[test]
#[ignore = "needs BENCH_PYTHON; tests/run sets it up"]
fn python_reads_the_same_of_a_dataflash_log() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("log.bin");
    let bytes = dataflash::log(100);
    for end in [bytes.len(), bytes.len() / 2, bytes.len() - 3] {
        fs::write(&file, &bytes[..end]).unwrap();
        let ours = read(Format::Dataflash, &bytes[..end]).unwrap();
        let theirs = reference(&["dataflash", file.to_str().unwrap()]);
        holds(&ours, &theirs);
        assert_eq!(theirs["parameters"]["MOT_THST_HOVER"], 0.25);
    }
}

#[test]
#[ignore = "needs BENCH_PYTHON; tests/run sets it up"]
fn python_reads_the_same_of_a_blackbox_log() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("log.bbl");
    let bytes = blackbox::frames(300).bytes();
    fs::write(&file, &bytes).unwrap();
    let ours = read(Format::Blackbox, &bytes).unwrap();
    assert_eq!(ours.samples.len(), 330);
    holds(&ours, &reference(&["blackbox", file.to_str().unwrap()]));
}

#[test]
#[ignore = "needs BENCH_PYTHON; tests/run sets it up"]
fn python_writes_a_bag_of_which_we_read_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("bag");
    let theirs = reference(&["bag", bag.to_str().unwrap()]);
    let files = fs::read_dir(&bag).unwrap().map(|entry| entry.unwrap().path());
    let file =
        files.into_iter().find(|file| file.extension().is_some_and(|ending| ending == "mcap")).unwrap();
    let ours = read(Format::Mcap, &fs::read(file).unwrap()).unwrap();
    assert!(ours.losses.is_none(), "{:?}", ours.losses);
    holds(&ours, &theirs);
    assert_eq!(ours.samples.len(), 80);
}
