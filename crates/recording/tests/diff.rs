//! What `bench diff` tells of recordings whose differences are known.

use std::path::{Path, PathBuf};

use bench_device::{PositionSample, Readback, Sticks, Time, TrackStatus};
use bench_recording::{
    Battery, Command, ControlState, Event, EventText, Level, Mode, Options, ReadbackAt, Record, Recorder,
    Session, Tick, Truth,
    diff::{
        Align, Derived, DiffError, DiffOptions, DiffReport, Exclusion, FieldReport, Reason, Repeats, SizeOf,
        ToleranceKey, ToleranceOrigin, Tolerances, Verdict, diff, render_html, render_text,
    },
};
use bench_rig::{Actuation, Phase, Rig};
use proptest::prelude::*;
use tempfile::TempDir;

const Z: &str = "/tracker/position/position_m.z";
const THROTTLE: &str = "/control/command/sticks.throttle";
const PHASE: &str = "/control/state/phase";

/// A made-up flight: idle, launch, hold with set-points that move, land, idle. Each closure changes one thing of it.
struct Flight {
    mode: Mode,
    duration_s: f64,
    /// How long it stays idle at first.
    idle_s: f64,
    /// What the recording's clock reads `t` seconds after the start.
    clock: fn(f64) -> f64,
    /// Altitude, m, at a time since leaving idle, s.
    altitude: fn(f64) -> f64,
    truth: bool,
    battery: bool,
    rig: Option<Rig>,
    /// When the controller takes the airframe for down, s since leaving idle.
    down_s: Option<f64>,
}

fn altitude(t_s: f64) -> f64 {
    let rise = 1.0 - (-(t_s.max(0.0)) / 1.2).exp();
    rise * (0.4 + 0.06 * (0.9 * t_s).sin() + 0.03 * (2.1 * t_s).cos())
}

impl Default for Flight {
    fn default() -> Self {
        Self {
            mode: Mode::Sim,
            duration_s: 24.0,
            idle_s: 1.0,
            clock: |t| t,
            altitude,
            truth: true,
            battery: false,
            rig: None,
            down_s: None,
        }
    }
}

impl Flight {
    fn phase(&self, t_s: f64) -> Phase {
        match t_s - self.idle_s {
            t if t < -1e-9 => Phase::Idle,
            t if t < 0.7 - 1e-9 => Phase::Launch,
            t if t < self.duration_s - 6.0 => Phase::Hold,
            t if t < self.duration_s - 3.0 => Phase::Land,
            _ => Phase::Idle,
        }
    }

    fn time(&self, t_s: f64) -> Time {
        Time::from_seconds((self.clock)(t_s))
    }

    /// All records, each with the time since the start, s, in order.
    fn records(&self) -> Vec<(f64, Record)> {
        let mut records = Vec::new();
        let every = |step_s: f64| {
            (0..).map(move |i| f64::from(i) * step_s).take_while(|t| *t < self.duration_s + self.idle_s)
        };
        let height = |t: f64| (self.altitude)(t - self.idle_s);
        for t in every(1.0 / 30.0) {
            let sample = PositionSample {
                exposed_at: self.time((t - 0.3).max(0.0)),
                arrived_at: self.time(t),
                position_m: [0.01 * t, -0.02, height(t)],
                status: TrackStatus::Found,
                ..PositionSample::default()
            };
            records.push((t, sample.into()));
        }
        for (index, t) in every(0.1).enumerate() {
            let time = self.time(t);
            let sticks = Sticks { throttle: 1.9 + height(t), ..Sticks::default() };
            let state = ControlState {
                time,
                phase: self.phase(t),
                setpoint_m: [0.0, 0.0, 0.4],
                estimate_m: [0.01 * t, -0.02, height(t)],
                integral_n: self
                    .down_s
                    .map_or(0.0, |down_s| if t < self.idle_s + down_s - 1e-9 { 0.15 } else { 0.0 }),
                ..ControlState::default()
            };
            records.push((t, state.into()));
            records.push((t, Command { time, sticks }.into()));
            let readback = Readback { device_time: time, sticks, faults: bench_device::Faults::default() };
            records.push((t, ReadbackAt { time: self.time(t + 0.004), readback }.into()));
            let tick = Tick { index: index as u64, scheduled: time, started: time, ..Tick::default() };
            records.push((t, tick.into()));
        }
        if self.truth {
            for t in every(0.02) {
                let truth = Truth {
                    time: self.time(t),
                    position_m: [0.01 * t, -0.02, height(t)],
                    attitude: [1.0, 0.0, 0.0, 0.0],
                    ..Truth::default()
                };
                records.push((t, truth.into()));
            }
        }
        if self.battery {
            for t in every(1.0) {
                let battery = Battery { time: self.time(t), voltage_v: 4.1 - 0.01 * t, current_a: None };
                records.push((t, battery.into()));
            }
        }
        records.sort_by(|(a, _), (b, _)| a.total_cmp(b));
        records
    }

    fn session(&self) -> Session {
        let mut session = Session::new(self.mode);
        session.rig_toml = self.rig.as_ref().map(Rig::to_toml);
        session
    }

    fn write(&self, folder: &TempDir, name: &str) -> PathBuf {
        write(folder, name, &self.session(), self.records().into_iter().map(|(_, record)| record))
    }
}

fn write(
    folder: &TempDir,
    name: &str,
    session: &Session,
    records: impl IntoIterator<Item = Record>,
) -> PathBuf {
    let path = folder.path().join(name);
    let mut recorder = Recorder::create(&path, session, Options::SIMULATION).expect("a recorder");
    for record in records {
        recorder.record(record);
    }
    recorder.finish().expect("a recording");
    path
}

fn folder() -> TempDir {
    tempfile::tempdir().expect("a folder")
}

fn compare(a: &Path, b: &Path) -> DiffReport {
    compare_with(a, b, &DiffOptions::default())
}

/// Every report that is made in these tests is also checked for what must hold of any.
fn compare_with(a: &Path, b: &Path, options: &DiffOptions) -> DiffReport {
    let report = diff(a, b, options).expect("a report");
    let json = serde_json::to_string(&report).expect("JSON");
    let read: DiffReport =
        serde_json::from_str(&json).expect("the same schema, and no number that JSON cannot hold");
    assert_eq!(read, report);
    let html = render_html(&report, "bench diff");
    assert!(html.contains("default-src 'none'"), "the page may load something");
    // The plotting library has words of its own.
    let (page, _) = html.split_once("<script>").unwrap_or((&html, ""));
    for word in ["NaN", "Infinity", "inf,", "http:", "https:", "src=", "url("] {
        assert!(!page.contains(word), "{word} in the page");
    }
    assert!(render_text(&report, true).starts_with(&report.summary));
    report
}

fn field<'a>(report: &'a DiffReport, path: &str) -> &'a FieldReport {
    report.fields.iter().find(|field| field.path() == path).unwrap_or_else(|| panic!("no {path}"))
}

#[test]
fn a_repeated_simulation_is_the_same_in_every_field() {
    let folder = folder();
    let (a, b) = (Flight::default().write(&folder, "a.mcap"), Flight::default().write(&folder, "b.mcap"));
    let report = compare(&a, &b);
    assert_eq!(report.verdict(), Verdict::Same);
    assert!(report.fields.iter().all(|field| field.verdict == Verdict::Same));
    assert!(report.fields.len() > 50, "{}", report.fields.len());
    assert_eq!(report.alignment.used, Align::None);
    assert_eq!(report.summary, format!("same: {} fields equal at equal times", report.fields.len()));
}

#[test]
fn a_landing_is_aligned_at_the_instant_the_airframe_is_down() {
    let folder = folder();
    let phases = |report: &DiffReport| -> Vec<String> {
        report.alignment.segments.iter().map(|segment| segment.phase.clone()).collect()
    };
    let by_phase = DiffOptions { align: Align::Phase, ..DiffOptions::default() };
    let early = Flight { down_s: Some(19.0), ..Flight::default() }.write(&folder, "early.mcap");
    let late = Flight { down_s: Some(19.6), ..Flight::default() }.write(&folder, "late.mcap");
    let report = compare_with(&early, &late, &by_phase);
    assert_eq!(phases(&report), ["launch", "hold", "land", "down", "idle"]);
    let land = &report.alignment.segments[2];
    assert!((land.b_duration_s - land.a_duration_s - 0.6).abs() < 1e-6, "{land:?}");
    // The integral falls in one sample; that it does so at another time is told by the segments alone.
    assert_eq!(field(&report, "/control/state/integral_n").difference.as_ref().expect("numbers").beyond, 0);
    // A landing of which only one recording tells the instant is one piece.
    let untold = Flight::default().write(&folder, "untold.mcap");
    assert_eq!(phases(&compare_with(&early, &untold, &by_phase)), ["launch", "hold", "land", "idle"]);
}

#[test]
fn exactly_compared_recordings_are_the_same_or_different() {
    let folder = folder();
    let exact = DiffOptions { exact: true, ..DiffOptions::default() };
    let a = Flight::default().write(&folder, "a.mcap");
    let b = Flight { altitude: |t| altitude(t) + 1e-12, ..Flight::default() }.write(&folder, "b.mcap");
    assert_eq!(compare_with(&a, &a, &exact).verdict(), Verdict::Same);
    let report = compare_with(&a, &b, &exact);
    assert_eq!(report.verdict(), Verdict::Different);
    assert_eq!(field(&report, Z).tolerance.expect("told").origin, ToleranceOrigin::Exact);
    let both = DiffOptions { floor: vec![a.clone(), b.clone()], ..exact };
    assert!(matches!(diff(&a, &b, &both), Err(DiffError::BadOption { option: "exact", .. })));
}

#[test]
fn tolerances_of_repeats_hold_for_one_more_and_not_for_another_flight() {
    let folder = folder();
    let rig = Rig::load(concat!(env!("CARGO_MANIFEST_DIR"), "/../../rigs/virtual.toml")).expect("a rig");
    // Each flight wanders from the others by a wave of its own.
    let flights: [fn(f64) -> f64; 6] = [
        |t| altitude(t) + 0.02 * (0.31 * t).sin(),
        |t| altitude(t) + 0.02 * (0.37 * t).cos(),
        |t| altitude(t) - 0.02 * (0.43 * t).sin(),
        |t| altitude(t) - 0.02 * (0.51 * t).cos(),
        |t| altitude(t) + 0.02 * (0.59 * t + 1.0).sin(),
        |t| altitude(t) + 0.02 * (0.67 * t + 2.0).sin(),
    ];
    let repeats = flights.map(|altitude| {
        let flight = Flight { altitude, ..Flight::default() };
        (flight.session(), flight.records().into_iter().map(|(_, record)| record).collect())
    });
    let repeats = Repeats::of(&rig, repeats.into()).expect("enough repeats");
    let derived = Derived { rig: rig.clone(), mission: "made up".to_owned(), repeats: Some(repeats) };
    let options = DiffOptions { derived: Some(derived), ..DiffOptions::default() };
    let a = Flight::default().write(&folder, "a.mcap");
    let wanders = Flight { altitude: |t| altitude(t) + 0.02 * (0.8 * t + 0.5).sin(), ..Flight::default() };
    let report = compare_with(&a, &wanders.write(&folder, "b.mcap"), &options);
    assert_eq!(report.verdict(), Verdict::WithinTolerance, "{}", report.summary);
    assert_eq!(field(&report, Z).tolerance.expect("told").origin, ToleranceOrigin::Repeats);
    assert!(render_text(&report, false).contains("6 simulations"));
    // An offset as large as the waves is beyond the mean of any pair, if within the largest difference.
    let raised = Flight { altitude: |t| altitude(t) + 0.03, ..Flight::default() }.write(&folder, "c.mcap");
    let report = compare_with(&a, &raised, &options);
    assert_eq!(report.verdict(), Verdict::Different);
    // Which size is beyond is told: of the altitude the mean alone.
    let z = field(&report, Z).difference.as_ref().expect("numbers");
    let beyond: Vec<SizeOf> = z.sizes.iter().filter(|size| size.is_beyond()).map(|size| size.of).collect();
    assert_eq!(beyond, [SizeOf::Mean]);
    assert_eq!(z.sizes[0].times_tolerance, z.times_tolerance);
    assert!((z.sizes[0].value - 0.03).abs() < 1e-6, "{:?}", z.sizes);
    assert!(render_text(&report, true).contains(" mean 0.03 m ("), "{}", report.summary);
    // Without repeats the rig's numbers hold: 5 mm of resolution and 8.5 mm of noise of two samples.
    let alone = Derived { rig, mission: "made up".to_owned(), repeats: None };
    let options = DiffOptions { derived: Some(alone), ..DiffOptions::default() };
    let z = field(&compare_with(&a, &raised, &options), Z).tolerance.expect("told");
    assert_eq!(z.origin, ToleranceOrigin::Rig);
    assert!((z.absolute - 0.013_485).abs() < 1e-5 && z.time_s == 0.1, "{z:?}");
}

#[test]
fn a_difference_below_the_resolution_is_within_tolerance() {
    let folder = folder();
    let a = Flight::default().write(&folder, "a.mcap");
    let b = Flight { altitude: |t| altitude(t) + 0.003, ..Flight::default() }.write(&folder, "b.mcap");
    let report = compare(&a, &b);
    assert_eq!(report.verdict(), Verdict::WithinTolerance);
    let z = field(&report, Z);
    assert_eq!(z.verdict, Verdict::WithinTolerance);
    let difference = z.difference.as_ref().expect("numbers");
    assert!((difference.largest.expect("a number") - 0.003).abs() < 1e-12);
    assert!((difference.rms.expect("a number") - 0.003).abs() < 1e-12);
    assert!((difference.mean.expect("a number") - 0.003).abs() < 1e-12);
    assert!((difference.times_tolerance.expect("a number") - 0.6).abs() < 1e-9);
    assert_eq!(difference.beyond, 0);
    assert_eq!(field(&report, PHASE).verdict, Verdict::Same);
}

#[test]
fn a_difference_is_told_with_its_start_size_and_place() {
    let folder = folder();
    let a = Flight::default().write(&folder, "a.mcap");
    let bumped = |t: f64| altitude(t) + if (5.0..8.0).contains(&t) { 0.05 * (t - 4.0) / 4.0 } else { 0.0 };
    let b = Flight { altitude: bumped, ..Flight::default() }.write(&folder, "b.mcap");
    let report = compare(&a, &b);
    assert_eq!(report.verdict(), Verdict::Different);
    let z = field(&report, Z);
    let difference = z.difference.as_ref().expect("numbers");
    // From 6 s to 9 s of the recording, the bump grows from 12.5 mm to 50 mm; samples are 1/30 s apart.
    assert!((difference.first_s.expect("a time") - 6.0).abs() < 0.04, "{difference:?}");
    assert!((difference.largest_at_s.expect("a time") - 9.0).abs() < 0.04, "{difference:?}");
    assert!((difference.largest.expect("a number") - 0.05).abs() < 0.001, "{difference:?}");
    let text = render_text(&report, false);
    assert!(text.starts_with("differ: "), "{text}");
    assert!(text.contains(Z) && !text.contains("position_m.x"), "{text}");
}

#[test]
fn what_only_one_recording_has_is_missing_and_counts_only_between_equal_modes() {
    let folder = folder();
    let a = Flight { battery: true, ..Flight::default() }.write(&folder, "a.mcap");
    let b = Flight::default().write(&folder, "b.mcap");
    let voltage = "/battery/voltage_v";
    let report = compare(&a, &b);
    assert_eq!(report.verdict(), Verdict::Different);
    assert_eq!(field(&report, voltage).verdict, Verdict::Missing);
    assert_eq!(field(&report, voltage).reason, Some(Reason::OnlyInA));
    assert_eq!(field(&compare(&b, &a), voltage).reason, Some(Reason::OnlyInB));

    let hardware = Flight { mode: Mode::Hil, truth: false, ..Flight::default() }.write(&folder, "c.mcap");
    let report = compare(&b, &hardware);
    assert!(report.verdict().passes(), "{}", report.summary);
    assert_eq!(field(&report, "/plant/truth/position_m.z").excluded, Some(Exclusion::ModesDiffer));
    assert_eq!(field(&report, "/loop/tick/sense_s").excluded, Some(Exclusion::Bookkeeping));
    assert!(report.notes.iter().any(|note| note.contains("bookkeeping")), "{:?}", report.notes);
}

#[test]
fn sticks_in_volts_and_in_counts_are_not_compared() {
    let rig = |actuation| {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs/virtual.toml");
        let mut rig = Rig::load(file).expect("a rig");
        rig.airframe.actuation = actuation;
        Some(rig)
    };
    let folder = folder();
    let volts = Flight { rig: rig(Actuation::Volt), ..Flight::default() }.write(&folder, "a.mcap");
    let counts = Flight { rig: rig(Actuation::Count), ..Flight::default() }.write(&folder, "b.mcap");
    let unknown = Flight::default().write(&folder, "c.mcap");
    let report = compare(&volts, &counts);
    let throttle = field(&report, THROTTLE);
    assert_eq!(throttle.verdict, Verdict::NotComparable);
    let units = Reason::UnitDiffers { a: Some("V".to_owned()), b: Some("count".to_owned()) };
    assert_eq!(throttle.reason, Some(units));
    assert_eq!(report.verdict(), Verdict::WithinTolerance, "what can be compared is the same");
    let reason = Reason::UnitDiffers { a: Some("V".to_owned()), b: None };
    assert_eq!(field(&compare(&volts, &unknown), THROTTLE).reason, Some(reason));
    assert_eq!(field(&compare(&volts, &volts), THROTTLE).unit, "V");
}

#[test]
fn recordings_that_share_no_time_or_too_little_are_not_comparable() {
    let folder = folder();
    let a = Flight::default().write(&folder, "a.mcap");
    let later = Flight { clock: |t| t + 1000.0, ..Flight::default() }.write(&folder, "b.mcap");
    let report = compare_with(&a, &later, &DiffOptions { align: Align::None, ..DiffOptions::default() });
    assert_eq!(report.verdict(), Verdict::NotComparable);
    assert!(!report.verdict().passes());
    assert_eq!(field(&report, Z).reason, Some(Reason::NoOverlap));
    assert_eq!(report.coverage.shared_s, 0.0);

    let one =
        |t_s: f64| [Record::from(Battery { time: Time::from_seconds(t_s), voltage_v: 4.0, current_a: None })];
    let session = Session::new(Mode::Import);
    let (c, d) = (write(&folder, "c.mcap", &session, one(1.0)), write(&folder, "d.mcap", &session, one(1.2)));
    assert_eq!(field(&compare(&c, &d), "/battery/voltage_v").reason, Some(Reason::TooFewSamples));
    assert_eq!(compare(&c, &c).verdict(), Verdict::Same);
}

#[test]
fn empty_recordings_and_empty_channels_are_told() {
    let folder = folder();
    let empty = write(&folder, "empty.mcap", &Session::new(Mode::Sim), []);
    let report = compare(&empty, &empty);
    assert_eq!(report.verdict(), Verdict::NotComparable);
    assert!(report.fields.is_empty());
    let full = Flight::default().write(&folder, "full.mcap");
    let report = compare(&empty, &full);
    assert_eq!(report.verdict(), Verdict::Different);
    assert!(report.fields.iter().all(|field| field.reason == Some(Reason::OnlyInB)));
}

#[test]
fn a_lag_is_found_within_a_sample() {
    let folder = folder();
    let a = Flight::default().write(&folder, "a.mcap");
    let b = Flight { altitude: |t| altitude(t - 0.13), ..Flight::default() }.write(&folder, "b.mcap");
    let report = compare(&a, &b);
    let tolerance_s = [(Z, 1.0 / 30.0), (THROTTLE, 0.1), ("/plant/truth/position_m.z", 0.02)];
    for (path, sample_s) in tolerance_s {
        let lag = field(&report, path).lag.unwrap_or_else(|| panic!("no lag of {path}"));
        assert!((lag.lag_s - 0.13).abs() < sample_s, "{path}: {lag:?}");
        assert!(lag.explained > 0.9, "{path}: {lag:?}");
    }
    let back = compare_with(&b, &a, &DiffOptions { trace_stretches: 0, ..DiffOptions::default() });
    assert_eq!(field(&back, Z).trace, None);
    assert!((field(&back, Z).lag.expect("a lag").lag_s + 0.13).abs() < 1.0 / 30.0);
}

#[test]
fn offset_and_drift_of_a_clock_are_recovered() {
    let folder = folder();
    let long = || Flight { duration_s: 120.0, mode: Mode::Hil, truth: false, ..Flight::default() };
    let a = long().write(&folder, "a.mcap");
    let b = Flight { clock: |t| 5.25 + t * (1.0 + 300e-6), ..long() }.write(&folder, "b.mcap");
    let report = compare_with(&a, &b, &DiffOptions { align: Align::Clock, ..DiffOptions::default() });
    let found = &report.alignment;
    assert_eq!(found.used, Align::Clock, "{}", found.reason);
    // The same samples on another clock: bins of 64 ms move their means by less than a sample, 33 ms; over 120 s and a
    // thousand bins that leaves a few milliseconds and some ten millionths.
    assert!((found.offset_s - 5.25).abs() < 0.005, "{found:?}");
    assert!((found.drift_ppm.expect("a drift") - 300.0).abs() < 60.0, "{found:?}");
    assert!(found.correlation.expect("a correlation") > 0.99);
    assert!(report.verdict().passes(), "{}", report.summary);
}

#[test]
fn a_flight_that_leaves_idle_later_is_aligned_by_its_phases() {
    let folder = folder();
    let a = Flight::default().write(&folder, "a.mcap");
    // The same flight 2.7 s later: position samples keep their places relative to the departure.
    let later = Flight { idle_s: 3.7, ..Flight::default() };
    let b = later.write(&folder, "b.mcap");
    let report = compare(&a, &b);
    assert_eq!(report.alignment.used, Align::Phase);
    assert!((report.alignment.offset_s - 2.7).abs() < 1e-9);
    let phases: Vec<&str> = report.alignment.segments.iter().map(|segment| segment.phase.as_str()).collect();
    assert_eq!(phases, ["launch", "hold", "land", "idle"]);
    for path in [Z, THROTTLE, PHASE, "/control/state/estimate_m.z"] {
        let field = field(&report, path);
        assert!(field.verdict.passes(), "{path}: {field:?}");
        let largest = field.difference.as_ref().and_then(|difference| difference.largest).unwrap_or(0.0);
        assert!(largest < 1e-9, "{path}: {largest}");
    }
    assert!(report.coverage.share > 0.99, "{:?}", report.coverage);
}

#[test]
fn without_phases_the_clock_is_used_and_the_reason_is_told() {
    let folder = folder();
    let a = Flight { mode: Mode::Hil, ..Flight::default() }.write(&folder, "a.mcap");
    let flight = Flight { mode: Mode::Import, clock: |t| t + 40.0, ..Flight::default() };
    let positions = flight.records().into_iter().map(|(_, record)| record);
    let positions = positions.filter(|record| matches!(record, Record::Position(_)));
    let b = write(&folder, "b.mcap", &flight.session(), positions);
    let report = compare(&a, &b);
    assert_eq!(report.alignment.used, Align::Clock);
    assert!(report.alignment.reason.contains("B has no /control/state"), "{}", report.alignment.reason);
    assert!((report.alignment.offset_s - 40.0).abs() < 0.005, "{:?}", report.alignment);
    assert!(field(&report, Z).verdict.passes());
}

#[test]
fn an_aborted_flight_is_different_even_if_all_it_holds_agrees() {
    let folder = folder();
    let whole = Flight::default();
    let a = whole.write(&folder, "a.mcap");
    let start = whole.records().into_iter().filter(|(t, _)| *t < 10.0).map(|(_, record)| record);
    let b = write(&folder, "b.mcap", &whole.session(), start);
    let report = compare(&a, &b);
    assert_eq!(report.verdict(), Verdict::Different);
    assert!(!report.coverage.enough);
    assert!(report.summary.contains("share only"), "{}", report.summary);
    assert!(report.fields.iter().all(|field| field.verdict != Verdict::Different));
    let lenient = DiffOptions { coverage_min: 0.2, ..DiffOptions::default() };
    assert_eq!(compare_with(&a, &b, &lenient).verdict(), Verdict::WithinTolerance);
}

#[test]
fn gaps_and_lost_frames_are_left_out_and_counted() {
    let folder = folder();
    let flight = Flight::default();
    let a = flight.write(&folder, "a.mcap");
    let with_gap = flight.records().into_iter().filter_map(|(t, record)| match record {
        Record::Position(_) if (8.0..10.0).contains(&t) => None,
        Record::Position(position) if (12.0..12.1).contains(&t) => {
            let lost = PositionSample { position_m: [0.0; 3], status: TrackStatus::Lost, ..position };
            Some(lost.into())
        }
        record => Some(record),
    });
    let b = write(&folder, "b.mcap", &flight.session(), with_gap);
    let z = field(&compare(&a, &b), Z).clone();
    assert_eq!(z.verdict, Verdict::WithinTolerance);
    // 60 samples are missing; three lost ones are bridged: 1/6 s is within five intervals.
    assert_eq!(z.samples.a - z.samples.a_compared, 60);
    assert_eq!(z.samples.b, z.samples.a - 63);
    assert_eq!(z.samples.b, z.samples.b_compared);
    let gaps = z.trace.expect("a trace").b.iter().filter(|point| point.is_none()).count();
    assert_eq!(gaps, 1);
}

#[test]
fn repeats_set_the_floor() {
    let folder = folder();
    // Repeats differ by up to 8 mm, more than the built-in 5 mm.
    let repeat = |altitude| Flight { altitude, ..Flight::default() };
    let floor: Vec<PathBuf> = [
        repeat(|t| altitude(t) + 0.004 * (5.0 * t).sin()),
        repeat(|t| altitude(t) - 0.004 * (5.0 * t).sin()),
        repeat(altitude),
    ]
    .iter()
    .enumerate()
    .map(|(i, flight)| flight.write(&folder, &format!("repeat{i}.mcap")))
    .collect();
    let options = DiffOptions { floor: floor.clone(), ..DiffOptions::default() };
    let another = repeat(|t| altitude(t) + 0.008 * (3.0 * t).cos()).write(&folder, "another.mcap");
    let off = repeat(|t| altitude(t) + 0.014).write(&folder, "off.mcap");
    let biased = repeat(|t| altitude(t) + 0.0118).write(&folder, "biased.mcap");

    let report = compare_with(&floor[2], &another, &options);
    let tolerance = field(&report, Z).tolerance.expect("a tolerance");
    assert_eq!(tolerance.origin, ToleranceOrigin::Floor);
    // 1.5 times the largest and the RMS of 8 mm of amplitude, between the first two.
    assert!((tolerance.absolute - 0.012).abs() < 2e-4, "{tolerance:?}");
    assert!((tolerance.rms.expect("a limit") - 0.012 / 2.0_f64.sqrt()).abs() < 2e-4, "{tolerance:?}");
    assert_eq!(field(&report, Z).verdict, Verdict::WithinTolerance);
    assert_eq!(field(&compare_with(&floor[2], &off, &options), Z).verdict, Verdict::Different);
    // No sample is beyond the largest, but the RMS is: 11.8 mm everywhere.
    let report = compare_with(&floor[2], &biased, &options);
    let by_rms = field(&report, Z);
    assert_eq!(by_rms.difference.as_ref().expect("numbers").beyond, 0);
    assert_eq!(by_rms.verdict, Verdict::Different);
    // What repeats to the bit must repeat to the bit.
    assert_eq!(field(&report, "/plant/truth/position_m.x").tolerance.expect("a tolerance").absolute, 0.0);

    let one = DiffOptions { floor: floor[..1].to_vec(), ..DiffOptions::default() };
    assert!(matches!(diff(&floor[0], &floor[1], &one), Err(DiffError::BadOption { option: "floor", .. })));
}

#[test]
fn rules_decide_what_passes() {
    let folder = folder();
    let a = Flight::default().write(&folder, "a.mcap");
    let b = Flight { altitude: |t| altitude(t) + 0.02, ..Flight::default() }.write(&folder, "b.mcap");
    let mut tolerances = Tolerances::default();
    tolerances.add_flag(ToleranceKey::Absolute, "*.z=0.03").expect("a rule");
    tolerances.add_flag(ToleranceKey::Relative, "sticks.throttle=0.02").expect("a rule");
    let options = DiffOptions { tolerances: tolerances.clone(), ..DiffOptions::default() };
    let report = compare_with(&a, &b, &options);
    assert_eq!(report.verdict(), Verdict::WithinTolerance, "{}", report.summary);
    assert_eq!(field(&report, Z).tolerance.expect("a tolerance").origin, ToleranceOrigin::Given);

    tolerances.add_flag(ToleranceKey::Absolute, "position_m.z=0").expect("a rule");
    let strict = DiffOptions { tolerances: tolerances.clone(), ..DiffOptions::default() };
    let report = compare_with(&a, &b, &strict);
    assert_eq!(report.verdict(), Verdict::Different);
    assert_eq!(field(&report, Z).difference.as_ref().expect("numbers").times_tolerance, None);

    tolerances.ignore("position_m.z").expect("a rule");
    let report = compare_with(&a, &b, &DiffOptions { tolerances, ..DiffOptions::default() });
    assert_eq!(report.verdict(), Verdict::WithinTolerance);
    assert_eq!(field(&report, Z).excluded, Some(Exclusion::Ignored));
    assert_eq!(field(&report, Z).verdict, Verdict::Different);
}

#[test]
fn a_time_tolerance_forgives_a_late_step_and_no_more() {
    let folder = folder();
    let command = |late: u32| {
        (0..200).map(move |i| {
            let throttle = if i >= 100 + late { 2.0 } else { 1.0 };
            let time = Time::from_nanos(u64::from(i) * 100_000_000);
            Record::from(Command { time, sticks: Sticks { throttle, ..Sticks::default() } })
        })
    };
    let session = Session::new(Mode::Sim);
    let a = write(&folder, "a.mcap", &session, command(0));
    let b = write(&folder, "b.mcap", &session, command(3));
    assert_eq!(field(&compare(&a, &b), THROTTLE).verdict, Verdict::Different);
    let verdict = |time_s: &str| {
        let mut tolerances = Tolerances::default();
        tolerances.add_flag(ToleranceKey::Time, &format!("sticks.throttle={time_s}")).expect("a rule");
        let options = DiffOptions { tolerances, ..DiffOptions::default() };
        field(&compare_with(&a, &b, &options), THROTTLE).verdict
    };
    assert_eq!(verdict("0.3"), Verdict::WithinTolerance);
    assert_eq!(verdict("0.1"), Verdict::Different);
}

#[test]
fn names_that_differ_are_quoted() {
    let folder = folder();
    let a = Flight::default().write(&folder, "a.mcap");
    let aborted = Flight::default().records().into_iter().map(|(t, record)| match record {
        Record::ControlState(state) if t > 15.0 => ControlState { phase: Phase::Abort, ..state }.into(),
        record => record,
    });
    let b = write(&folder, "b.mcap", &Session::new(Mode::Sim), aborted);
    let report = compare(&a, &b);
    let difference = field(&report, PHASE).difference.as_ref().expect("a difference");
    assert_eq!(difference.first_names, Some(["hold".to_owned(), "abort".to_owned()]));
    assert!((difference.first_s.expect("a time") - 15.1).abs() < 1e-9);
    assert!(report.summary.contains("hold in A, abort in B"), "{}", report.summary);
}

#[test]
fn an_event_without_counterpart_is_a_difference_between_simulations() {
    let folder = folder();
    let flight = Flight::default();
    let event = |t_s: f64, words: &str| {
        let text = EventText::from(words).expect("short");
        Record::from(Event { time: Time::from_seconds(t_s), level: Level::Warning, text })
    };
    let with = |events: &[(f64, &str)]| {
        let events: Vec<(f64, Record)> = events.iter().map(|(t, words)| (*t, event(*t, words))).collect();
        let mut records = flight.records();
        records.extend(events);
        records.sort_by(|(a, _), (b, _)| a.total_cmp(b));
        records.into_iter().map(|(_, record)| record).collect::<Vec<_>>()
    };
    let a = write(&folder, "a.mcap", &flight.session(), with(&[(3.0, "one"), (6.0, "two")]));
    let b = write(&folder, "b.mcap", &flight.session(), with(&[(3.0, "one")]));
    let report = compare(&a, &b);
    let text = field(&report, "/bench/event/text");
    assert_eq!(text.verdict, Verdict::Different);
    let names = text.difference.as_ref().and_then(|difference| difference.first_names.clone());
    assert_eq!(names, Some(["two".to_owned(), "nothing".to_owned()]));
}

#[test]
fn records_out_of_order_and_values_that_are_no_numbers_do_no_harm() {
    let folder = folder();
    let flight = Flight::default();
    let a = flight.write(&folder, "a.mcap");
    // One channel after the other, as a careless converter writes them.
    let mut records = flight.records();
    records.sort_by_key(|(_, record)| record.channel());
    let unsorted = records.iter().map(|(_, record)| *record);
    let b = write(&folder, "b.mcap", &flight.session(), unsorted);
    let report = compare(&a, &b);
    assert_eq!(report.verdict(), Verdict::Same, "{}", render_text(&report, true));
    assert!(report.notes.iter().any(|note| note.contains("not in order of time")), "{:?}", report.notes);

    let broken = flight.records().into_iter().map(|(t, record)| match record {
        Record::Position(position) if (5.0..6.0).contains(&t) => {
            PositionSample { position_m: [f64::NAN, f64::INFINITY, 1e300], ..position }.into()
        }
        record => record,
    });
    let c = write(&folder, "c.mcap", &flight.session(), broken);
    let report = compare(&a, &c);
    assert_eq!(field(&report, Z).samples.b_unusable, 30);
    assert!(report.verdict().passes(), "{}", report.summary);
}

#[test]
fn angles_are_compared_around_the_circle() {
    let folder = folder();
    let heading = |off: f64| {
        (0..300).map(move |i| {
            let t_s = f64::from(i) / 30.0;
            let angle = 3.0 + 0.1 * t_s + off;
            let wrapped = if angle > std::f64::consts::PI { angle - std::f64::consts::TAU } else { angle };
            Record::from(PositionSample {
                arrived_at: Time::from_seconds(t_s),
                exposed_at: Time::from_seconds(t_s),
                heading_rad: Some(wrapped),
                status: TrackStatus::Found,
                ..PositionSample::default()
            })
        })
    };
    let session = Session::new(Mode::Sim);
    let a = write(&folder, "a.mcap", &session, heading(0.0));
    let b = write(&folder, "b.mcap", &session, heading(0.01));
    let report = compare(&a, &b);
    let difference = field(&report, "/tracker/position/heading_rad").difference.as_ref().expect("numbers");
    assert!((difference.largest.expect("a number") - 0.01).abs() < 1e-9, "{difference:?}");
}

#[test]
fn times_at_the_ends_of_what_a_clock_holds_do_no_harm() {
    let folder = folder();
    let session = Session::new(Mode::Hil);
    let battery =
        |nanos: u64| Record::from(Battery { time: Time::from_nanos(nanos), voltage_v: 4.0, current_a: None });
    let state = |nanos: u64, phase| {
        Record::from(ControlState { time: Time::from_nanos(nanos), phase, ..ControlState::default() })
    };
    let early = [battery(0), state(0, Phase::Idle), state(1, Phase::Hold), battery(2), battery(3)];
    let late = [battery(5), state(6, Phase::Idle), state(u64::MAX, Phase::Hold), battery(u64::MAX)];
    let (a, b) = (write(&folder, "a.mcap", &session, early), write(&folder, "b.mcap", &session, late));
    for align in Align::ALL {
        let options = DiffOptions { align, ..DiffOptions::default() };
        compare_with(&a, &b, &options);
        compare_with(&b, &a, &options);
    }
}

#[test]
fn a_file_that_is_no_recording_is_an_error() {
    let folder = folder();
    let a = Flight::default().write(&folder, "a.mcap");
    let missing = folder.path().join("missing.mcap");
    let error = diff(&a, &missing, &DiffOptions::default()).expect_err("no file");
    assert!(
        matches!(error, DiffError::Recording(_)) && error.to_string().contains("missing.mcap"),
        "{error}"
    );
}

/// A recording of a few channels with whatever values and times.
fn any_records() -> impl Strategy<Value = Vec<Record>> {
    let sample = (0_u64..3_000, -1.0..1.0_f64, prop::bool::ANY, 0_usize..Phase::ALL.len());
    prop::collection::vec(sample, 0..120).prop_map(|mut samples| {
        samples.sort_by_key(|sample| sample.0);
        let record = |(ms, value, is_state, phase): (u64, f64, bool, usize)| {
            let time = Time::from_nanos(ms * 1_000_000);
            if is_state {
                let state = ControlState {
                    time,
                    phase: Phase::ALL[phase],
                    thrust_n: value,
                    ..ControlState::default()
                };
                state.into()
            } else {
                Record::from(Battery { time, voltage_v: value, current_a: (value > 0.0).then_some(value) })
            }
        };
        samples.into_iter().map(record).collect()
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_recording_is_the_same_as_itself_and_order_does_not_matter(
        a in any_records(),
        b in any_records(),
        align in prop::sample::select(vec![Align::None, Align::Phase]),
    ) {
        let folder = folder();
        let session = Session::new(Mode::Sim);
        let a = write(&folder, "a.mcap", &session, a);
        let b = write(&folder, "b.mcap", &session, b);
        let options = DiffOptions { align, ..DiffOptions::default() };
        let itself = compare_with(&a, &a, &options);
        prop_assert!(itself.fields.iter().all(|field| field.verdict == Verdict::Same));
        let (there, back) = (compare_with(&a, &b, &options), compare_with(&b, &a, &options));
        prop_assert_eq!(there.verdict(), back.verdict());
        for field_there in &there.fields {
            prop_assert_eq!(field_there.verdict, field(&back, &field_there.path()).verdict, "{}", field_there.path());
        }
    }
}
