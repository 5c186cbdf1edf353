//! What a flight on hardware is surrounded by, on scripted ends.

use std::path::{Path, PathBuf};

use bench_device::{
    Clock, DeviceError, Faults, PositionSample, PositionSource, Readback, Sticks, Time, TrackStatus,
    VoltageOutput,
    fake::{FakeClock, FakePositionSource, FakeVoltageOutput},
};
use bench_recording::Record;
use bench_rig::{Mission, Rig};
use bench_run::{Ending, StopReason, WallClock, await_marker, fly, fly_guarded};

fn rigs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs")
}

fn climb() -> (Rig, Mission) {
    let rig = Rig::load(rigs().join("loopback.toml")).unwrap();
    (rig, Mission::load(rigs().join("missions/climb-040.toml")).unwrap())
}

/// An output whose readbacks follow a script by the number of the write; exact otherwise.
struct Scripted<F> {
    written: Vec<Sticks>,
    script: F,
}

impl<F: FnMut(usize) -> Result<Option<Faults>, DeviceError>> VoltageOutput for Scripted<F> {
    fn write(&mut self, sticks: Sticks) -> Result<(), DeviceError> {
        self.written.push(sticks);
        Ok(())
    }

    fn read_back(&mut self) -> Result<Option<Readback>, DeviceError> {
        let sticks = *self.written.last().unwrap();
        let readback = |faults| Readback { device_time: Time::ZERO, sticks, faults };
        Ok((self.script)(self.written.len())?.map(readback))
    }
}

/// A marker that stands still: one sample an iteration.
struct Still(u64);

impl PositionSource for Still {
    fn poll(&mut self) -> Result<Option<PositionSample>, DeviceError> {
        // Every second call ends an iteration's polling.
        self.0 += 1;
        let arrived_at = Time::from_seconds(self.0 as f64 / 2.0 * 0.1);
        let sample = PositionSample {
            exposed_at: arrived_at,
            arrived_at,
            status: TrackStatus::Found,
            ..PositionSample::default()
        };
        Ok((!self.0.is_multiple_of(2)).then_some(sample))
    }
}

fn still() -> Still {
    Still(0)
}

#[test]
fn a_panic_in_flight_sends_the_throttle_to_rest() {
    struct Panicking(u32);
    impl PositionSource for Panicking {
        fn poll(&mut self) -> Result<Option<PositionSample>, DeviceError> {
            self.0 += 1;
            assert!(self.0 < 15, "the tracker lost its mind");
            Ok(None)
        }
    }
    let (rig, mission) = climb();
    let (mut clock, mut output, mut records) =
        (FakeClock::default(), FakeVoltageOutput::default(), Vec::new());
    let ends = (&mut clock, &mut output, &mut Panicking(0));
    let flown = fly_guarded(ends, &rig, &mission, &mut records, |_, _| true);
    assert_eq!(flown.ending, Ending::Panicked("the tracker lost its mind".to_owned()));
    let rest = rig.airframe.sticks.at_rest();
    assert!(output.written.iter().any(|sticks| sticks.throttle > rest.throttle), "it had not begun to fly");
    assert_eq!(output.written.last(), Some(&rest));
}

#[test]
fn an_output_that_panics_does_not_take_the_recording_with_it() {
    let (rig, mission) = climb();
    let mut output = Scripted {
        written: Vec::new(),
        script: |count| {
            if count < 15 { Ok(Some(Faults::default())) } else { panic!("the driver lost its mind") }
        },
    };
    let mut records = Vec::new();
    let ends = (&mut FakeClock::default(), &mut output, &mut still());
    let flown = fly_guarded(ends, &rig, &mission, &mut records, |_, _| true);
    assert!(matches!(flown.ending, Ending::Panicked(_)));
    assert_eq!(records.iter().filter(|record| matches!(record, Record::Tick(_))).count(), 14);
}

#[test]
fn lost_answers_are_counted_and_leave_no_readback() {
    let (rig, mission) = climb();
    let mut output = Scripted {
        written: Vec::new(),
        script: |count: usize| Ok((!count.is_multiple_of(4)).then(Faults::default)),
    };
    let mut records = Vec::new();
    let ends = (&mut FakeClock::default(), &mut output, &mut still());
    let flown = fly(ends, &rig, &mission, &mut records, |_, _| true);
    assert_eq!(flown.ending, Ending::Complete);
    let readbacks = records.iter().filter(|record| matches!(record, Record::Readback(_))).count() as u64;
    assert_eq!(flown.summary.unanswered, flown.summary.ticks / 4);
    assert_eq!(readbacks, flown.summary.ticks - flown.summary.unanswered);
}

#[test]
fn outputs_that_read_something_else_stop_the_flight_but_not_for_a_moment() {
    let (rig, mission) = climb();
    let bad = Faults { mismatch: true, ..Faults::default() };
    let fly_with = |bad_from: usize, bad_until: usize| {
        let script =
            |count| Ok(Some(if (bad_from..bad_until).contains(&count) { bad } else { Faults::default() }));
        let mut output = Scripted { written: Vec::new(), script };
        let ends = (&mut FakeClock::default(), &mut output, &mut still());
        fly(ends, &rig, &mission, &mut Vec::new(), |_, _| true).ending
    };
    assert_eq!(fly_with(20, 29), Ending::Complete);
    assert!(matches!(fly_with(20, 60), Ending::Stopped(StopReason::Mismatch { .. })));
}

#[test]
fn the_marker_is_waited_for_and_given_up() {
    let found = PositionSample { status: TrackStatus::Found, ..PositionSample::default() };
    let lost = PositionSample::default();
    let mut tracker = FakePositionSource::default();
    for sample in [None, Some(lost), None, Some(found)] {
        tracker.push(Ok(sample));
    }
    let mut clock = FakeClock::default();
    assert_eq!(await_marker(&mut clock, &mut tracker, 1.0), Ok(true));
    assert_eq!(await_marker(&mut clock, &mut tracker, 1.0), Ok(false));
    assert!(clock.now() > Time::from_seconds(1.0));
}

#[test]
fn a_flight_begins_when_the_clock_says_and_not_at_zero() {
    let (rig, mut mission) = climb();
    mission.phases.truncate(1);
    let mut clock = FakeClock::default();
    clock.wait_until(Time::from_seconds(7.3)).unwrap();
    let mut records = Vec::new();
    let ends = (&mut clock, &mut FakeVoltageOutput::default(), &mut still());
    let flown = fly(ends, &rig, &mission, &mut records, |_, _| true);
    let ticks: Vec<_> = records
        .iter()
        .filter_map(|record| if let Record::Tick(tick) = record { Some(tick.scheduled) } else { None })
        .collect();
    assert_eq!(ticks[0], Time::from_seconds(7.3));
    // One second idle and half a second of tail, all of it.
    assert!((flown.summary.duration_s - 1.5).abs() < 1e-9, "{}", flown.summary.duration_s);
}

#[test]
fn by_the_wall_clock_ticks_start_at_or_after_their_schedule_and_missed_ones_are_left_out() {
    let (mut rig, mut mission) = climb();
    rig.control_loop.period_s = 0.005;
    // The overruns are made here; a streak of them would stop the flight.
    rig.safety.overrun_streak = 10_000;
    mission.phases.truncate(1);
    mission.phases[0].duration_s = 0.2;
    let mut output = Scripted {
        written: Vec::new(),
        script: |count| {
            if count == 10 {
                // Two periods and a half, whatever else the machine does.
                std::thread::sleep(std::time::Duration::from_micros(12_500));
            }
            Ok(Some(Faults::default()))
        },
    };
    let mut records = Vec::new();
    let ends = (&mut WallClock::start(), &mut output, &mut still());
    let flown = fly(ends, &rig, &mission, &mut records, |_, _| true);
    let ticks: Vec<_> =
        records.iter().filter_map(|r| if let Record::Tick(tick) = r { Some(*tick) } else { None }).collect();
    assert!(ticks.iter().all(|tick| tick.started >= tick.scheduled));
    let origin = ticks[0].scheduled;
    for pair in ticks.windows(2) {
        let periods = pair[1].index - pair[0].index;
        assert!(periods >= 1);
        assert_eq!(pair[1].scheduled.nanos() - origin.nanos(), pair[1].index * 5_000_000);
        // A tick that overran is followed by a gap, one that did not by the next.
        assert_eq!(pair[0].overrun, periods > 1, "{pair:?}");
    }
    assert!(ticks[9].overrun && flown.summary.overruns >= 1);
}

#[test]
fn lateness_of_an_iteration_does_not_make_a_phase_longer() {
    let (rig, mission) = climb();
    let mut clock = FakeClock::default();
    // The first iteration of a flight and of its second phase are late, the others on time.
    for lateness_s in [0.004, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.003] {
        clock.push_lateness_s(lateness_s);
    }
    let mut phases = Vec::new();
    let ends = (&mut clock, &mut FakeVoltageOutput::default(), &mut still());
    fly(ends, &rig, &mission, &mut Vec::new(), |progress, _| {
        phases.push(progress.phase);
        true
    });
    // One second idle, 0.7 s of launch, at ten iterations a second.
    assert_eq!(phases.iter().position(|phase| *phase == bench_rig::Phase::Launch), Some(10));
    assert_eq!(phases.iter().position(|phase| *phase == bench_rig::Phase::Hold), Some(17));
}

#[test]
fn iterations_that_all_take_too_long_stop_the_flight() {
    let (mut rig, mission) = climb();
    rig.control_loop.period_s = 0.002;
    rig.safety.overrun_streak = 5;
    let mut output = Scripted {
        written: Vec::new(),
        script: |_| {
            std::thread::sleep(std::time::Duration::from_millis(3));
            Ok(Some(Faults::default()))
        },
    };
    let ends = (&mut WallClock::start(), &mut output, &mut still());
    let flown = fly(ends, &rig, &mission, &mut Vec::new(), |_, _| true);
    assert_eq!(flown.ending, Ending::Stopped(StopReason::Overruns { streak: 5 }));
    assert_eq!(output.written.last(), Some(&rig.airframe.sticks.at_rest()));
}
