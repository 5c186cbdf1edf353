use bench_logs::Format;
use proptest::prelude::*;

use crate::{
    names, read,
    writers::{Crazyflie, floats},
};

const EVENTS: [(&str, &[(&str, char)]); 2] =
    [("fixedFrequency", &[("stateEstimate.z", 'f'), ("motor.m1", 'H')]), ("estTDOA", &[("id", 'B')])];

fn log(version: u8, steps: u16) -> Crazyflie {
    let mut log = Crazyflie::new(version, &EVENTS);
    for step in 0..steps {
        let micros = 5_000_000 + u64::from(step) * 10_000;
        log.data(
            0,
            micros,
            &[floats(&[0.25 * f64::from(step)]), (step + 40_000).to_le_bytes().to_vec()].concat(),
        );
        if step % 3 == 0 {
            log.data(1, micros + 1000, &[step as u8]);
        }
    }
    log
}

#[test]
fn events_have_the_variables_that_were_written() {
    for version in [1, 2] {
        let read = read(Format::Crazyflie, &log(version, 6).bytes()).unwrap();
        assert_eq!(names(&read), ["fixedFrequency", "estTDOA"]);
        assert!(read.losses.is_none(), "{:?}", read.losses);
        assert_eq!(read.samples.len(), 8);
        let last = read.samples.last().unwrap();
        assert_eq!(
            (last.time_ns, &last.cells[..]),
            (Some(5_050_000_000), &["1.25".to_owned(), "40005".to_owned()][..])
        );
    }
}

#[test]
fn a_log_without_its_end_gives_what_came_before() {
    let whole = log(2, 5).bytes();
    let all = read(Format::Crazyflie, &whole).unwrap().samples;
    let head = log(2, 0).cut().len();
    for end in head..whole.len() {
        let cut = read(Format::Crazyflie, &whole[..end]).unwrap();
        assert!(cut.losses.cut && all.starts_with(&cut.samples), "{end}: {:?}", cut.losses);
    }
    assert!(read(Format::Crazyflie, &whole[..head - 3]).is_err());
    // Nothing tells where an event begins, so what follows a damaged number is lost.
    let mut damaged = log(2, 10_000).bytes();
    damaged[head] = 99;
    let losses = read(Format::Crazyflie, &damaged).unwrap().losses;
    assert!((losses.damaged, losses.skipped_bytes) == (1, (damaged.len() - head) as u64), "{losses:?}");
    // A checksum that is another's.
    let mut damaged = whole;
    *damaged.last_mut().unwrap() ^= 1;
    assert!(read(Format::Crazyflie, &damaged).unwrap().losses.cut);
}

#[test]
fn a_block_of_the_client_is_rows_with_stamps() {
    let table =
        "Timestamp,stateEstimate.z,pm.vbat\n120,0.5,3.9\n130,nan,3.8\nwhen,0.5,3.9\n140,0.75,3.7\n150,0.";
    let read = read(Format::Crazyflie, table.as_bytes()).unwrap();
    assert_eq!(names(&read), ["log"]);
    let seen: Vec<_> =
        read.samples.iter().map(|sample| (sample.time_ns.unwrap(), sample.cells[0].as_str())).collect();
    assert_eq!(seen, [(120_000_000, "0.5"), (130_000_000, "NaN"), (140_000_000, "0.75")]);
    assert_eq!((read.losses.damaged, read.losses.cut), (1, true));
}

proptest! {
    #[test]
    fn bytes_of_any_kind_never_panic(at in 0_usize..400, noise in prop::collection::vec(any::<u8>(), 1..40)) {
        let mut log = log(1, 30).bytes();
        let at = at.min(log.len());
        let end = (at + noise.len()).min(log.len());
        log.splice(at..end, noise);
        drop(read(Format::Crazyflie, &log));
    }
}
