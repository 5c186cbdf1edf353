use bench_logs::Format;
use proptest::prelude::*;

use crate::{
    Read, beginnings_hold, names, read,
    writers::{Blackbox, Packed},
};

/// Every encoding and every predictor that Betaflight writes.
pub const FIELDS: [Packed; 17] = [
    ("axisP[0]", true, [0, 0], [1, 7]),
    ("axisP[1]", true, [0, 0], [1, 7]),
    ("axisP[2]", true, [0, 0], [1, 7]),
    ("rcCommand[0]", true, [0, 0], [1, 8]),
    ("rcCommand[1]", true, [0, 0], [1, 8]),
    ("rcCommand[2]", true, [0, 0], [1, 8]),
    ("rcCommand[3]", false, [4, 1], [1, 8]),
    ("vbatLatest", false, [9, 3], [1, 6]),
    ("amperageLatest", true, [0, 0], [1, 6]),
    ("baroAlt", true, [0, 0], [1, 6]),
    ("gyroADC[0]", true, [0, 0], [3, 0]),
    ("accSmooth[0]", true, [0, 0], [3, 0]),
    ("setpoint[3]", true, [0, 0], [2, 0]),
    ("motor[0]", false, [11, 1], [3, 0]),
    ("motor[1]", false, [5, 0], [3, 0]),
    ("servo[5]", false, [8, 0], [1, 0]),
    ("debug[0]", true, [0, 0], [0, 1]),
];

/// Numbers that need few bits and many, of both signs, from one step to the next.
fn values(step: i64) -> Vec<i64> {
    let jump = |size: i64| if step % 7 == 3 { size } else { 0 };
    vec![
        step % 2 + jump(3),
        -(step % 5),
        step * step % 90 - jump(40_000),
        step % 3 - 1,
        -step % 9 * 20,
        jump(-4_000),
        1070 + step % 11 * 80,
        1620 - step % 4,
        step * 3,
        100 + step % 6 * 7,
        -1_000 + step * 17 % 301,
        -2_048 + step,
        step * 5 % 1000,
        158 + step * 13 % 1_800,
        160 + step * 11 % 1_700,
        1_500 - step % 30,
        step % 250,
    ]
}

/// Frames 500 us apart, with a slow frame now and then.
pub fn frames(steps: i64) -> Blackbox {
    let mut log = Blackbox::new(&FIELDS, &["flightModeFlags", "failsafePhase"], &[]);
    for step in 0..steps {
        log.main(1_000_000 + step * 500 + step % 3, &values(step));
        if step % 10 == 4 {
            log.slow(&[step, -step]);
        }
    }
    log
}

fn column(read: &Read, topic: &str, field: &str) -> Vec<i64> {
    let place = read.topics.iter().position(|known| known.name == topic).unwrap();
    let at = read.topics[place].fields.iter().position(|known| known.name == field).unwrap();
    let of_topic = read.samples.iter().filter(|sample| sample.topic == place);
    of_topic.map(|sample| sample.cells[at].parse().unwrap()).collect()
}

#[test]
fn frames_have_the_numbers_that_were_packed() {
    let read = read(Format::Blackbox, &frames(200).bytes()).unwrap();
    assert_eq!(names(&read), ["main", "slow"]);
    assert!(read.losses.is_none(), "{:?}", read.losses);
    for (place, (field, ..)) in FIELDS.iter().enumerate() {
        let written: Vec<i64> = (0..200).map(|step| values(step)[place]).collect();
        assert_eq!(column(&read, "main", field), written, "{field}");
    }
    assert_eq!(column(&read, "main", "loopIteration"), (0..200).map(|step| 4 * step).collect::<Vec<_>>());
    assert_eq!(column(&read, "slow", "failsafePhase"), (0..20).map(|k| -10 * k - 4).collect::<Vec<_>>());
    let times: Vec<_> = read.samples.iter().filter(|sample| sample.topic == 0).map(|s| s.time_ns).collect();
    assert_eq!(
        times,
        (0..200).map(|step| Some(1_000_000 * 1000 + (step * 500 + step % 3) * 1000)).collect::<Vec<_>>()
    );
    assert!(read.parameters.contains(&("minthrottle".to_owned(), 1070.0)), "{:?}", read.parameters);
}

#[test]
fn positions_of_the_receiver_are_counted_from_home_and_times_run_on() {
    let mut log = Blackbox::new(
        &[("baroAlt", true, [0, 0], [1, 0])],
        &["flightModeFlags"],
        &["GPS_coord[0]", "GPS_coord[1]", "GPS_altitude"],
    );
    // The clock of 32 bits runs over after 71 minutes.
    let begins = (1_i64 << 32) - 2_000;
    log.slow(&[5]);
    log.home([473_977_000, -85_455_000]);
    for step in 0..8 {
        log.main(begins + step * 500, &[step]);
        log.gps(7, &[473_977_000 + step, -85_455_000 - step, 4_000 + step]);
    }
    let read = read(Format::Blackbox, &log.bytes()).unwrap();
    assert_eq!(
        column(&read, "gps", "GPS_coord[1]"),
        (0..8).map(|step| -85_455_000 - step).collect::<Vec<_>>()
    );
    assert_eq!(column(&read, "gps", "GPS_altitude")[7], 4_007);
    let stamps = |topic: usize| {
        let of_topic = read.samples.iter().filter(|sample| sample.topic == topic);
        of_topic.map(|sample| sample.time_ns.unwrap() / 1000 - i128::from(begins)).collect::<Vec<_>>()
    };
    assert_eq!(stamps(0), (0..8).map(|step| step * 500).collect::<Vec<_>>());
    assert_eq!(stamps(2), (0..8).map(|step| step * 500 + 7).collect::<Vec<_>>());
    // A slow frame before the first main one has its time.
    assert_eq!(stamps(1), [0]);
}

#[test]
fn a_cut_log_gives_what_came_before() {
    let whole = frames(40).bytes();
    let head = whole.windows(2).position(|pair| pair == b"\nI").unwrap() + 1;
    beginnings_hold(Format::Blackbox, &whole, head);
    // A flight that ended in a crash has no end of the log.
    let cut = read(Format::Blackbox, &frames(40).cut()).unwrap();
    assert!(cut.losses.cut && cut.losses.damaged == 0, "{:?}", cut.losses);
    assert_eq!(column(&cut, "main", "baroAlt").len(), 40);
}

#[test]
fn after_a_damaged_frame_the_next_whole_one_is_read() {
    let whole = frames(200).bytes();
    let sound = read(Format::Blackbox, &whole).unwrap();
    let mut damaged = whole.clone();
    let middle = whole.len() / 2;
    for byte in &mut damaged[middle..middle + 3] {
        *byte = 0xff;
    }
    let found = read(Format::Blackbox, &damaged).unwrap();
    assert!(found.losses.damaged >= 1 && found.losses.skipped_bytes > 0, "{:?}", found.losses);
    let (before, after) = (column(&sound, "main", "loopIteration"), column(&found, "main", "loopIteration"));
    assert!(after.iter().all(|iteration| before.contains(iteration)), "{after:?}");
    // Eight frames are of one whole one; the frame before the damage may be lost, too.
    assert!(after.len() >= before.len() - 17, "{} of {}", after.len(), before.len());
    assert_eq!(after.last(), before.last());
}

#[test]
fn several_flights_in_one_memory_are_told_apart_and_gaps_are_counted() {
    let mut first = frames(20);
    // Logging was switched off and on again.
    first.event(14, &[80, 0x90, 0x4e]);
    let both = [first.bytes(), vec![0xff; 300], frames(30).bytes(), vec![0; 10]].concat();
    let read = read(Format::Blackbox, &both).unwrap();
    assert_eq!(names(&read), ["main", "slow", "main[1]", "slow[1]"]);
    assert_eq!([column(&read, "main", "time").len(), column(&read, "main[1]", "time").len()], [20, 30]);
    assert_eq!((read.losses.dropouts, read.losses.damaged, read.losses.cut), (1, 0, false));
}

#[test]
fn a_head_that_cannot_be_understood_is_told() {
    let text = String::from_utf8_lossy(&frames(0).bytes()).into_owned();
    for (of, into, said) in [
        ("Field P encoding:9,", "Field P encoding:77,", "encoding"),
        ("Field P predictor:6,", "Field P predictor:66,", "predictor"),
        ("Field I name:loopIteration,time,", "Field I name:loopIteration,tome,", "with a time"),
        ("Field I signed:0,", "Field I signed:0,0,", "differ in length"),
    ] {
        let changed = text.replacen(of, into, 1);
        assert_ne!(changed, text, "{of}");
        let words = read(Format::Blackbox, changed.as_bytes()).unwrap_err().to_string();
        assert!(words.contains(said), "{said}: {words}");
    }
}

proptest! {
    #[test]
    fn bytes_of_any_kind_never_panic(at in 0_usize..3000, noise in prop::collection::vec(any::<u8>(), 1..40)) {
        let mut log = frames(60).bytes();
        let at = at.min(log.len());
        let end = (at + noise.len()).min(log.len());
        log.splice(at..end, noise);
        // A head that says something else is an error, or other numbers.
        drop(read(Format::Blackbox, &log));
    }
}
