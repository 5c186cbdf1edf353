use bench_logs::Format;

use crate::{
    beginnings_hold, names, read,
    writers::{Ulog, floats},
};

/// A log of 10 ms steps with one position and two batteries in each.
pub fn log(steps: u32) -> Vec<u8> {
    let mut log = Ulog::new();
    log.info("sys_name", "PX4");
    log.parameter("MPC_THR_HOVER", 0.5);
    log.format("vehicle_local_position:uint64_t timestamp;uint64_t timestamp_sample;float[3] at;bool valid;uint8_t[3] _padding0;int16_t count;");
    log.format("battery_status:uint64_t timestamp;float voltage_v;");
    log.subscribe(0, 0, "vehicle_local_position");
    log.subscribe(1, 0, "battery_status");
    log.subscribe(2, 1, "battery_status");
    for k in 0..steps {
        let micros = u64::from(k) * 10_000;
        let count = (-2_i16).to_le_bytes();
        let values =
            [&(micros / 2).to_le_bytes()[..], &floats(&[0.5, f64::from(k), -1.0]), &[1, 0, 0, 0], &count]
                .concat();
        log.data(0, micros, &values);
        log.data(1, micros, &floats(&[4.0]));
        log.data(2, micros, &floats(&[3.5]));
    }
    log.bytes()
}

#[test]
fn topics_fields_and_values_are_those_that_were_written() {
    let read = read(Format::Ulog, &log(3)).unwrap();
    assert_eq!(names(&read), ["vehicle_local_position", "battery_status", "battery_status[1]"]);
    let fields: Vec<_> = read.topics[0].fields.iter().map(|field| field.name.as_str()).collect();
    assert_eq!(fields[..5], ["timestamp", "timestamp_sample", "at[0]", "at[1]", "at[2]"]);
    let value = |name: &str| {
        let place = fields.iter().position(|field| *field == name).unwrap();
        read.samples[3].cells[place].as_str()
    };
    assert_eq!(read.samples[3].time_ns, Some(10_000_000));
    assert_eq!(
        [value("timestamp_sample"), value("at[1]"), value("valid"), value("count")],
        ["5000", "1", "1", "-2"]
    );
    assert_eq!(read.samples[5].cells[1], "3.5");
    assert_eq!(read.parameters, [("MPC_THR_HOVER".to_owned(), 0.5)]);
}

#[test]
fn dropouts_are_counted() {
    let mut bytes = log(2);
    let mut more = Ulog::new();
    more.dropout(250);
    more.dropout(50);
    // Without the head of the second log and its flags.
    bytes.extend(&more.bytes()[16 + 43..]);
    let losses = read(Format::Ulog, &bytes).unwrap().losses;
    assert_eq!((losses.dropouts, losses.cut, losses.damaged), (2, false, 0));
    assert!((losses.dropout_s - 0.3).abs() < 1e-9);
}

#[test]
fn a_cut_log_gives_what_came_before() {
    beginnings_hold(Format::Ulog, &log(6), 0);
    assert!(read(Format::Ulog, &log(6)[..log(6).len() - 3]).unwrap().losses.cut);
}
