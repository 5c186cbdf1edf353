use bench_logs::Format;

use crate::{
    beginnings_hold, names, read,
    writers::{Dataflash, floats},
};

/// A log of 10 ms steps with the position by two filters and a battery in each.
pub fn log(steps: u32) -> Vec<u8> {
    let mut log = Dataflash::new();
    log.format(64, "PARM", "QNff", "TimeUS,Name,Value,Default");
    log.format(65, "UNIT", "QbZ", "TimeUS,Id,Label");
    log.format(66, "FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds");
    log.format(70, "XKF1", "QBccf", "TimeUS,C,Roll,Pitch,PD");
    log.format(71, "BAT", "Qf", "TimeUS,Volt");
    let padded = |text: &str, width: usize| {
        let mut bytes = text.as_bytes().to_vec();
        bytes.resize(width, 0);
        bytes
    };
    log.data(65, 0, &[vec![b'd'], padded("deg", 64)].concat());
    log.data(65, 0, &[vec![b'm'], padded("m", 64)].concat());
    log.data(66, 0, &[vec![70], padded("s#ddm", 16), padded("F-BB0", 16)].concat());
    log.data(64, 0, &[padded("MOT_THST_HOVER", 16), floats(&[0.25, 0.5])].concat());
    for k in 0..steps {
        let micros = u64::from(k) * 10_000;
        for core in [0, 1] {
            let angles = [(-150_i16).to_le_bytes(), 25_i16.to_le_bytes()].concat();
            log.data(70, micros, &[vec![core], angles, floats(&[f64::from(k) * -0.5])].concat());
        }
        log.data(71, micros, &floats(&[4.0]));
    }
    log.bytes()
}

#[test]
fn topics_units_and_scaled_values_are_those_that_were_written() {
    let read = read(Format::Dataflash, &log(3)).unwrap();
    assert_eq!(names(&read), ["PARM", "XKF1", "XKF1[1]", "BAT"]);
    let filter = read.topics.iter().position(|topic| topic.name == "XKF1").unwrap();
    let units: Vec<_> = read.topics[filter].fields.iter().map(|field| field.unit.as_deref()).collect();
    assert_eq!(units[2..], [Some("deg"), Some("deg"), Some("m")]);
    let last = read.samples.iter().rfind(|sample| sample.topic == filter).unwrap();
    assert_eq!(
        (last.time_ns, &last.cells[2..]),
        (Some(20_000_000), &["-1.5", "0.25", "-1"].map(str::to_owned)[..])
    );
    assert_eq!(read.parameters, [("MOT_THST_HOVER".to_owned(), 0.25)]);
}

#[test]
fn a_cut_log_gives_what_came_before() {
    beginnings_hold(Format::Dataflash, &log(6), 89);
    assert!(read(Format::Dataflash, &log(6)[..log(6).len() - 3]).unwrap().losses.cut);
}

#[test]
fn filler_at_the_end_of_a_card_is_no_damage() {
    let whole = log(6);
    for filler in [0, 0xff] {
        let padded = read(Format::Dataflash, &[whole.clone(), vec![filler; 700]].concat()).unwrap();
        assert!(padded.losses.is_none(), "{:?}", padded.losses);
        assert_eq!(padded.samples, read(Format::Dataflash, &whole).unwrap().samples);
    }
}
