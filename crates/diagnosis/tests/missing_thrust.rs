//! Thrust that is missing for moments, which no effect of the library is: a motor that misses now and then.

mod support;

use bench_device::{DeviceError, Readback, Sticks, VoltageOutput};
use bench_diagnosis::{Calibration, Diagnosis, Problem, Track, Verdict};
use bench_plant::lab::Lab;
use bench_recording::{Flight, Mode, Record, Session};
use support::{mission, rig};

/// One miss in so many commands, at no beat; three commands long.
const BETWEEN: f64 = 40.0;
const LENGTH: f64 = 3.0;

/// Outputs between which and the motors a share of the throttle is lost now and then; the readback does not show it.
struct Missing<V> {
    output: V,
    share: f64,
    written: f64,
    lost: f64,
}

impl<V: VoltageOutput> VoltageOutput for Missing<V> {
    fn write(&mut self, sticks: Sticks) -> Result<(), DeviceError> {
        let (number, since) = (self.written.div_euclid(BETWEEN), self.written.rem_euclid(BETWEEN));
        let begins = (BETWEEN - LENGTH) * (0.618 * number).fract();
        let misses = (begins..begins + LENGTH).contains(&since);
        self.lost = if misses { self.share * sticks.throttle } else { 0.0 };
        self.written += 1.0;
        self.output.write(Sticks { throttle: sticks.throttle - self.lost, ..sticks })
    }

    fn read_back(&mut self) -> Result<Option<Readback>, DeviceError> {
        let mut told = self.output.read_back()?;
        if let Some(readback) = &mut told {
            readback.sticks.throttle += self.lost;
        }
        Ok(told)
    }
}

fn diagnose(share: f64) -> Diagnosis {
    let rig = rig();
    let missions = ["hop", "climb-040", "steps", "low-hover"];
    let tracks: Vec<Track> = missions
        .into_iter()
        .zip(1..)
        .map(|(name, seed)| {
            let Lab { mut clock, output, mut tracker, .. } = Lab::new(&rig, seed).unwrap();
            let mut output = Missing { output, share, written: 0.0, lost: 0.0 };
            let mut records: Vec<Record> = Vec::new();
            let ends = (&mut clock, &mut output, &mut tracker);
            bench_run::fly(ends, &rig, &mission(name), &mut records, |_, _| true);
            let flight = Flight::from_records(Session::new(Mode::Sim), records);
            Track::from_flight(name, &flight, &rig).unwrap()
        })
        .collect();
    Diagnosis::of(&Problem::new(&tracks, &rig), &Calibration::built_in())
}

#[test]
fn thrust_that_is_missing_for_moments_is_no_known_effect() {
    // A hundredth of the throttle is less than what turbulence does; it is one-sided, and comes for moments.
    for share in [0.01, 0.04] {
        let said = diagnose(share);
        assert_eq!(said.verdict, Verdict::Unknown, "{share}: {:#?}", said.candidates);
    }
    assert_eq!(diagnose(0.0).verdict, Verdict::None);
}
