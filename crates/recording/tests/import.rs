//! What the people who bring logs of their own rely on.

use std::{
    fs,
    path::{Path, PathBuf},
};

use bench_device::{Time, TrackStatus};
use bench_recording::{
    Channel, Flight, Level, Mode, Recording, ViewerChannel,
    import::{ImportError, ImportMap, ImportReport, SkipReason, import},
};
use bench_rig::{GRAVITY_M_S2, Phase, Problem, Rig, RigError, Uncertain};
use proptest::prelude::*;
use serde_json::Value;
use tempfile::TempDir;

fn rigs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs")
}

const MAP_FILE: &str = "map.toml";

/// Time in seconds and altitude in metres; what most maps below begin with.
const TIME_AND_Z: &str = r#"
name = "test"
[time]
column = "t"
unit = "s"
[position]
latency_s = 0.0
z = { column = "z", unit = "m" }
"#;

fn map(text: &str) -> ImportMap {
    ImportMap::read(Path::new(MAP_FILE), text).unwrap_or_else(|error| panic!("{error}"))
}

fn map_problems(text: &str) -> Vec<Problem> {
    match ImportMap::read(Path::new(MAP_FILE), text) {
        Err(RigError::Invalid(problems)) => problems,
        other => panic!("expected problems, got {other:?}"),
    }
}

fn map_problem_words(text: &str) -> String {
    map_problems(text).iter().map(ToString::to_string).collect::<Vec<_>>().join("\n")
}

/// A folder with a log; the recording goes beside it.
struct Bench {
    folder: TempDir,
}

impl Bench {
    fn new(log: impl AsRef<[u8]>) -> Self {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("log.csv"), log).unwrap();
        Self { folder }
    }

    fn log(&self) -> PathBuf {
        self.folder.path().join("log.csv")
    }

    fn out(&self) -> PathBuf {
        self.folder.path().join("out.mcap")
    }

    fn import_with(&self, map_text: &str, rig: Option<&Rig>) -> Result<ImportReport, ImportError> {
        import(&map(map_text), &self.log(), &self.out(), rig)
    }

    fn files(&self) -> Vec<String> {
        let mut names: Vec<_> = fs::read_dir(self.folder.path())
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }
}

fn imported(map_text: &str, log: impl AsRef<[u8]>) -> (ImportReport, Flight) {
    imported_on(map_text, log, None)
}

fn imported_on(map_text: &str, log: impl AsRef<[u8]>, rig: Option<&Rig>) -> (ImportReport, Flight) {
    let bench = Bench::new(log);
    let report = bench.import_with(map_text, rig).unwrap_or_else(|error| panic!("{error}"));
    let flight = Flight::load(bench.out()).unwrap();
    assert_eq!(report.rows, report.used + report.filtered + report.skipped_rows());
    assert_eq!(flight.out_of_order, []);
    (report, flight)
}

fn heights(flight: &Flight) -> Vec<f64> {
    flight.positions.iter().map(|position| position.position_m[2]).collect()
}

fn skips(report: &ImportReport) -> Vec<(SkipReason, &str, u64, u64)> {
    report.skipped.iter().map(|s| (s.reason, s.column.as_str(), s.count, s.first_line)).collect()
}

#[test]
fn every_quantity_comes_through_in_the_recordings_units() {
    let map = r#"
        name = "all"
        actuation = "volt"
        [time]
        column = "ms"
        unit = "ms"
        [tick]
        period_s = 0.1
        [position]
        latency_s = 0.05
        x = { column = "x", unit = "mm" }
        y = { column = "y", unit = "cm", scale = -1.0 }
        z = { column = "z", unit = "m", offset = -0.25 }
        heading = { column = "yaw", unit = "deg" }
        [motion]
        velocity_x = { column = "x", unit = "mm/s" }
        velocity_z = { column = "y", unit = "cm/s" }
        vertical_acceleration = { column = "az", unit = "g", gravity = "included" }
        roll = { column = "yaw", unit = "rad" }
        [control]
        phase = { column = "phase", names = { grounded = "idle", closed = "hold" } }
        setpoint_z = { column = "z", unit = "m" }
        [command]
        throttle = { column = "thr", unit = "mV" }
        pitch = 1.65
        [readback]
        throttle = { columns = ["thr", "thr2"], unit = "mV", scale = 2.0, offset = 100.0 }
        [battery]
        voltage = { column = "bat", unit = "mV" }
        current = { column = "bat", unit = "mA" }
        [rotor]
        speed_1 = { column = "rpm", unit = "rpm" }
        speed_3 = { column = "rpm", unit = "rad/s" }
    "#;
    let log = "ms,x,y,z,yaw,az,phase,thr,thr2,bat,rpm\n\
               5000,250,10,0.25,180,1,grounded,0,0,3700,60\n\
               5100,500,-20,1.25,90,1.5,closed,1900,2000,3600,6000\n";
    let (report, flight) = imported(map, log);

    let [position] = flight.positions.as_slice() else { panic!("{:?}", flight.positions) };
    assert_eq!(position.arrived_at, Time::from_seconds(0.1));
    assert_eq!(position.exposed_at, Time::from_seconds(0.05));
    assert_eq!(position.position_m, [0.5, 0.2, 1.0]);
    assert!((position.heading_rad.unwrap() - std::f64::consts::FRAC_PI_2).abs() < 1e-15);
    assert_eq!(position.status, TrackStatus::Found);
    assert_eq!(report.positions_before_origin, 1);

    let motion = flight.motion[1];
    assert_eq!(motion.velocity_m_s, [Some(0.5), None, Some(-0.2)]);
    assert!((motion.vertical_acceleration_m_s2.unwrap() - 0.5 * GRAVITY_M_S2).abs() < 1e-12);
    assert_eq!(motion.attitude_rad, [Some(90.0), None, None]);

    let phases: Vec<_> = flight.states.iter().map(|state| (state.phase, state.setpoint_m[2])).collect();
    assert_eq!(phases, [(Phase::Idle, 0.25), (Phase::Hold, 1.25)]);
    let sticks = flight.commands[1].sticks;
    // A factor of 0.001 is no exact float: one unit in the last place.
    assert!((sticks.throttle - 1.9).abs() < 1e-12);
    assert_eq!((sticks.pitch, sticks.roll, sticks.yaw), (1.65, 0.0, 0.0));
    // The mean of 1.9 V and 2 V, twice, and 0.1 V.
    assert!((flight.readbacks[1].readback.sticks.throttle - 4.0).abs() < 1e-12);
    assert_eq!((flight.battery[1].voltage_v, flight.battery[1].current_a), (3.6, Some(3.6)));
    let turns = flight.rotor[1].speed_rad_s;
    assert!((turns[0].unwrap() - 100.0 * std::f64::consts::TAU).abs() < 1e-9);
    assert_eq!((turns[1], turns[2]), (None, Some(6000.0)));
    assert_eq!(flight.ticks.len(), 2);

    let height = report.quantities.iter().find(|quantity| quantity.name == "position.z").unwrap();
    assert_eq!((height.unit, height.min, height.max), ("m", 1.0, 1.0));
    assert_eq!((report.rows, report.used, report.duration_s, report.time_offset_s), (2, 2, 0.1, 5.0));
}

#[test]
fn an_import_has_the_shape_of_a_simulated_recording() {
    let rig = Rig::load(rigs().join("foreign.toml")).unwrap();
    let foreign = fs::read_to_string(rigs().join("import/foreign.toml")).unwrap();
    let rows: Vec<_> = (0..50)
        .map(|i| {
            let phase = ["idle", "launch", "closed"][(i / 10).min(2)];
            format!("{:.4},{phase},{:.4},{:.4},0.{i:03}\n", f64::from(i as u8) * 0.1, 1.5, 1.51)
        })
        .collect();
    let bench = Bench::new(format!("time_s,phase,throttle_cmd_v,throttle_readback_v,z_m\n{}", rows.concat()));
    let report = bench.import_with(&foreign, Some(&rig)).unwrap();

    let recording = Recording::open(bench.out()).unwrap();
    let session = recording.session();
    assert_eq!((session.mode, session.rig_name.as_str()), (Mode::Import, "foreign"));
    assert_eq!(Rig::read(Path::new("attached"), session.rig_toml.as_deref().unwrap()).unwrap(), rig);
    assert_eq!(session.extra["import.time_offset_s"], "0.000000000");
    assert_eq!(session.extra["import.log"], "log.csv");
    assert_eq!(session.extra["import.map_toml"], foreign);

    let flight = Flight::from_recording(&recording).unwrap();
    let phases: Vec<_> = flight.phases().iter().map(|interval| interval.phase).collect();
    assert_eq!(phases, [Phase::Idle, Phase::Launch, Phase::Hold]);
    let told: Vec<_> = flight.events.iter().map(|event| event.text.as_str()).collect();
    assert_eq!(told, ["phase idle", "phase launch", "phase hold"]);
    // Nothing was exposed before the origin: 0.3 s of latency and half of 33 ms of waiting take four rows.
    assert_eq!(flight.positions.len(), 46);
    assert_eq!(flight.positions[0].exposed_at, Time::from_seconds(0.4 - 0.3 - 0.0165));
    assert_eq!(report.channels["/tracker/position"], 46);
    assert_eq!(report.channels["/control/command"], 50);
    let messages: u64 = report.channels.values().sum();
    assert_eq!(messages, Channel::ALL.into_iter().map(|channel| recording.count(channel)).sum::<u64>());
    // For viewers the attached rig comes along as a scene, and the positions as poses.
    let scenes =
        recording.info().channels.iter().find(|channel| channel.name == ViewerChannel::Scene.topic());
    assert_eq!(scenes.map(|channel| channel.messages), Some(1));

    let again = Bench::new(fs::read(bench.log()).unwrap());
    again.import_with(&foreign, Some(&rig)).unwrap();
    assert_eq!(fs::read(bench.out()).unwrap(), fs::read(again.out()).unwrap(), "bytes repeat");
}

#[test]
fn every_kind_of_bad_row_is_counted_with_its_first_line_and_none_is_used() {
    let map = r#"
        name = "bad"
        actuation = "count"
        [time]
        column = "t"
        unit = "s"
        [position]
        latency_s = 0.0
        z = { column = "z", unit = "m" }
        [control]
        phase = { column = "p", names = { a = "hold" } }
        [command]
        throttle = { columns = ["m1", "m2"], unit = "count", valid = [0, 65535] }
    "#;
    let log = "t,z,p,m1,m2\n\
               0.0,0.0,a,1,1\n\
               0.1,nan,a,1,1\n\
               0.2,inf,a,1,1\n\
               0.3,,a,1,1\n\
               0.4,1.0.0,a,1,1\n\
               0.5,0.5,a,1,4294967295\n\
               0.6,0.5,a,65536,1\n\
               0.7,0.5,b,1,1\n\
               0.8,0.5,a,1\n\
               0.9,0.5,a,1,1,1\n\
               1.0,0.5,a,65535,65535\n\
               1.0,0.6,a,1,1\n\
               0.9,0.7,a,1,1\n\
               what,0.7,a,1,1\n\
               1.1,NaN,a,1,1\n\
               1.2,1.0,a,1,1\n";
    let (report, flight) = imported(map, log);
    assert_eq!(heights(&flight), [0.0, 0.5, 1.0]);
    assert_eq!(
        skips(&report),
        [
            (SkipReason::Nan, "z", 2, 3),
            (SkipReason::Infinite, "z", 1, 4),
            (SkipReason::Empty, "z", 1, 5),
            (SkipReason::NotANumber, "z", 1, 6),
            (SkipReason::OutOfRange, "m2", 1, 7),
            (SkipReason::OutOfRange, "m1", 1, 8),
            (SkipReason::UnknownPhase, "p", 1, 9),
            (SkipReason::CellCount, "", 2, 10),
            (SkipReason::TimeRepeated, "t", 1, 13),
            (SkipReason::TimeBack, "t", 1, 14),
            (SkipReason::NotANumber, "t", 1, 15),
        ]
    );
    assert_eq!(report.skipped[4].first_found, "4294967295");
    assert_eq!((report.rows, report.used), (16, 3));
    // The recording itself tells what is missing from it.
    let warnings = flight.events.iter().filter(|event| event.level == Level::Warning).count();
    assert_eq!(warnings, report.skipped.len());
}

#[test]
fn bytes_that_are_no_text_are_a_bad_row() {
    let (report, flight) = imported(TIME_AND_Z, b"t,z\n0,1\n1,\xff\xfe\n2,\0\0\n3,4\n");
    assert_eq!(heights(&flight), [1.0, 4.0]);
    assert_eq!(skips(&report), [(SkipReason::NotANumber, "z", 2, 3)]);
}

#[test]
fn times_may_be_dates_and_times_in_text() {
    let map = TIME_AND_Z.replace("\"s\"", "\"iso-8601\"");
    let log = "t,z\n\
               2024-04-15 14:43:21.924338,1\n\
               2024-04-15T14:43:22.024338Z,2\n\
               2024-04-15 16:43:22.124338+02:00,3\n\
               22:43:22,4\n\
               2024-04-15 14:43:22.1,5\n";
    let (report, flight) = imported(&map, log);
    let times: Vec<_> = flight.positions.iter().map(|position| position.arrived_at.seconds()).collect();
    assert_eq!(times, [0.0, 0.1, 0.2]);
    assert_eq!(skips(&report), [(SkipReason::NotATime, "t", 1, 5), (SkipReason::TimeBack, "t", 1, 6)]);
    assert_eq!(
        report.skipped[0].to_string(),
        "1 skipped, not a date and time in t (first: line 5, \"22:43:22\")"
    );
    // So many seconds since 1970: `date -u -d 2024-04-15T14:43:21 +%s`.
    assert_eq!(report.time_offset_s, 1_713_192_201.924_338);
}

#[test]
fn columns_of_a_table_without_a_header_go_by_their_numbers() {
    let map = TIME_AND_Z
        .replace("name = \"test\"", "name = \"test\"\nheader = false")
        .replace("\"t\"", "\"1\"")
        .replace("\"z\"", "\"3\"");
    let (report, flight) = imported(&map, "0,9,1.5\n1,9,nan\n2,9,2.5\n");
    assert_eq!(heights(&flight), [1.5, 2.5]);
    assert_eq!((report.rows, skips(&report)), (3, vec![(SkipReason::Nan, "3", 1, 2)]));
    let words = Bench::new("0,1\n").import_with(&map, None).unwrap_err().to_string();
    assert!(words.contains("no column is called \"3\"") && words.contains("has the columns 1, 2"), "{words}");
}

#[test]
fn one_map_is_for_logs_with_and_without_a_column() {
    let map = format!(
        "{TIME_AND_Z}x = {{ column = \"x\", unit = \"m\", optional = true }}
        [control]
        phase = {{ column = \"mode\", names = {{ fly = \"hold\" }}, optional = true }}
        [battery]
        voltage = {{ column = \"v\", unit = \"V\", optional = true }}
        current = {{ columns = [\"a\", \"b\"], unit = \"A\", optional = true }}"
    );
    let (report, flight) =
        imported(&map, "t,z,x,mode,v,a,b,w\n0,1,7,fly,4,1,3,0\n1,2,,,,1,3,0\n2,3,5,fly,3,1,nan,0\n");
    let across: Vec<_> = flight.positions.iter().map(|position| position.position_m).collect();
    // A position says nothing of where it is across as zero.
    assert_eq!(across, [[7.0, 0.0, 1.0], [0.0, 0.0, 2.0], [5.0, 0.0, 3.0]]);
    assert_eq!(flight.states.len(), 2);
    let battery: Vec<_> = flight.battery.iter().map(|of| (of.voltage_v, of.current_a)).collect();
    assert_eq!(battery, [(4.0, Some(2.0)), (3.0, None)]);
    assert_eq!(report.skipped, []);
    let columns = report.columns.unwrap();
    assert_eq!((columns.missing, columns.unused), (vec![], vec!["w".to_owned()]));

    let (report, flight) = imported(&map, "t,z,b\n0,1,3\n1,2,3\n");
    assert_eq!((heights(&flight), flight.states.len(), flight.battery.len()), (vec![1.0, 2.0], 0, 0));
    let words = report.to_string();
    assert!(words.contains("not in the log, and optional: a, mode, v, x\n"), "{words}");
    assert!(!report.quantities.iter().any(|quantity| quantity.name.starts_with("battery")), "{words}");

    // Other columns are asked for, and what is there is held to be right.
    let words = Bench::new("t,x\n0,1\n").import_with(&map, None).unwrap_err().to_string();
    assert!(words.contains("no column is called \"z\"") && !words.contains("called \"v\""), "{words}");
    let (report, _) = imported(&map, "t,z,v\n0,1,4\n1,1,full\n");
    assert_eq!(skips(&report), [(SkipReason::NotANumber, "v", 1, 3)]);
    let words = map_problem_words(&map.replace("optional = true", "optional = 1"));
    assert!(words.contains("true or false"), "{words}");
}

#[test]
fn north_east_down_becomes_the_benchs_signs_by_its_name() {
    let map = "name = \"test\"
        [time]
        column = \"t\"
        unit = \"s\"
        [position]
        frame = \"ned\"
        latency_s = 0.0
        x = { column = \"a\", unit = \"m\" }
        y = { column = \"a\", unit = \"m\" }
        z = { column = \"b\", unit = \"cm\", offset = 50 }
        heading = { column = \"a\", unit = \"rad\" }
        [motion]
        frame = \"ned\"
        velocity_x = { column = \"a\", unit = \"m/s\" }
        velocity_z = { column = \"b\", unit = \"m/s\" }
        vertical_acceleration = { column = \"g\", unit = \"g\", gravity = \"included\" }
        roll = { column = \"a\", unit = \"rad\" }
        pitch = { column = \"a\", unit = \"rad\" }
        yaw = { column = \"a\", unit = \"rad\" }";
    // At rest an accelerometer along an axis that points down shows -1 g.
    let (_, flight) = imported(map, "t,a,b,g\n0,2,-150,-1.5\n");
    let position = flight.positions[0];
    assert_eq!((position.position_m, position.heading_rad), ([2.0, -2.0, 1.0], Some(-2.0)));
    let motion = flight.motion[0];
    assert_eq!(motion.velocity_m_s, [Some(2.0), None, Some(150.0)]);
    assert_eq!(motion.attitude_rad, [Some(2.0), Some(-2.0), Some(-2.0)]);
    assert!((motion.vertical_acceleration_m_s2.unwrap() - 0.5 * GRAVITY_M_S2).abs() < 1e-12);
    let same = imported(&map.replace("\"ned\"", "\"enu\""), "t,a,b,g\n0,2,-150,1\n").1;
    assert_eq!(same.positions[0].position_m, [2.0, 2.0, -1.0]);
}

#[test]
fn a_quaternion_gives_angles_and_squares_of_rotor_speeds_a_throttle() {
    let map = format!(
        "actuation = \"fraction\"\n{TIME_AND_Z}heading = {{ quaternion = [\"w\", \"x\", \"y\", \"q\"] }}
        [motion]
        roll = {{ quaternion = [\"w\", \"x\", \"y\", \"q\"] }}
        pitch = {{ quaternion = [\"w\", \"x\", \"y\", \"q\"], scale = -1 }}
        [command]
        throttle = {{ columns = [\"m1\", \"m2\"], square = true, scale = 1e-8, unit = \"1\" }}"
    );
    // A quarter turn to the left, then the right side down by 60 degrees, then the nose down by 30.
    let log = "t,z,w,x,y,q,m1,m2\n\
               0,1,0.7071067811865476,0,0,0.7071067811865476,3000,4000\n\
               1,1,0.8660254037844387,0.5,0,0,0,0\n\
               2,1,0.9659258262890683,0,0.25881904510252074,0,0,10000\n\
               3,1,0,0,0,0,0,0\n";
    let (report, flight) = imported(&map, log);
    let near = |found: Option<f64>, degrees: f64| {
        assert!((found.unwrap() - degrees.to_radians()).abs() < 1e-9, "{found:?}: {degrees}");
    };
    for (k, [heading, roll, pitch]) in
        [[90.0, 0.0, 0.0], [0.0, 60.0, 0.0], [0.0, 0.0, -30.0]].into_iter().enumerate()
    {
        near(flight.positions[k].heading_rad, heading);
        near(flight.motion[k].attitude_rad[0], roll);
        near(flight.motion[k].attitude_rad[1], pitch);
    }
    let throttles: Vec<_> = flight.commands.iter().map(|command| command.sticks.throttle).collect();
    assert!((throttles[0] - 0.125).abs() < 1e-12 && (throttles[2] - 0.5).abs() < 1e-12, "{throttles:?}");
    // It is no direction.
    assert_eq!(skips(&report), [(SkipReason::OutOfRange, "w", 1, 5)]);
    let words = map_problem_words(&map.replacen("\"w\", ", "", 1));
    assert!(words.contains("four columns, real part first, found 3"), "{words}");
}

#[test]
fn a_log_without_a_usable_row_is_an_error_and_leaves_nothing() {
    let bench = Bench::new("t,z\n0,nan\n1,nan\n");
    let error = bench.import_with(TIME_AND_Z, None).unwrap_err();
    assert!(matches!(&error, ImportError::NoUsableRow { rows: 2, filtered: 0, .. }), "{error}");
    assert!(error.to_string().contains("2 skipped, NaN in z (first: line 2, \"nan\")"), "{error}");
    assert_eq!(bench.files(), ["log.csv"]);

    let empty = Bench::new("t,z\n");
    assert!(matches!(empty.import_with(TIME_AND_Z, None), Err(ImportError::NoUsableRow { rows: 0, .. })));
    let nothing = Bench::new("");
    assert!(matches!(nothing.import_with(TIME_AND_Z, None), Err(ImportError::NoHeader { .. })));
    assert_eq!(nothing.files(), ["log.csv"]);
}

#[test]
fn a_failed_import_leaves_an_older_recording_as_it_was() {
    let bench = Bench::new("t,z\n0,1\n");
    bench.import_with(TIME_AND_Z, None).unwrap();
    let before = fs::read(bench.out()).unwrap();
    fs::write(bench.log(), "t,z\n0,nan\n").unwrap();
    bench.import_with(TIME_AND_Z, None).unwrap_err();
    assert_eq!(fs::read(bench.out()).unwrap(), before);
    assert_eq!(bench.files(), ["log.csv", "out.mcap"]);
}

#[test]
fn the_log_itself_is_never_the_output() {
    let bench = Bench::new("t,z\n0,1\n");
    import(&map(TIME_AND_Z), &bench.log(), &bench.log(), None).unwrap_err();
    assert_eq!(fs::read_to_string(bench.log()).unwrap(), "t,z\n0,1\n");
}

#[test]
fn an_output_that_cannot_be_written_is_told_by_its_own_name() {
    let bench = Bench::new("t,z\n0,1\n");
    let out = bench.folder.path().join("nowhere/out.mcap");
    let words = import(&map(TIME_AND_Z), &bench.log(), &out, None).unwrap_err().to_string();
    assert!(words.contains("nowhere/out.mcap"), "{words}");
}

proptest! {
    // Each case writes files.
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn whatever_a_log_holds_every_row_is_accounted_for(
        rows in prop::collection::vec(prop::collection::vec(
            prop_oneof![
                "[0-9]{1,3}", "-?[0-9]{0,20}\\.?[0-9]{0,12}", "[-+eE.0-9]{0,6}",
                Just("nan".to_owned()), Just("-inf".to_owned()), Just("1e308".to_owned()), "\\PC{0,4}",
            ],
            1..4,
        ), 0..30),
    ) {
        let lines: Vec<_> = rows.iter().map(|cells| cells.join(",")).collect();
        let bench = Bench::new(format!("t,z\n{}", lines.join("\n")));
        let text = TIME_AND_Z.replace("unit = \"m\"", "unit = \"m\", scale = 1000.0");
        match bench.import_with(&text, None) {
            Ok(report) => {
                prop_assert_eq!(report.rows, report.used + report.skipped_rows());
                let flight = Flight::load(bench.out()).unwrap();
                prop_assert_eq!(flight.positions.len() as u64, report.used);
                prop_assert!(heights(&flight).iter().all(|z| z.is_finite()));
                prop_assert!(flight.positions.is_sorted_by(|a, b| a.arrived_at < b.arrived_at));
            }
            Err(ImportError::NoUsableRow { .. }) => prop_assert_eq!(bench.files(), ["log.csv"]),
            Err(other) => prop_assert!(false, "{}", other),
        }
    }
}

#[test]
fn missing_columns_are_told_all_at_once_with_the_maps_lines() {
    let bench = Bench::new("time,alt,alt\n0,1,2\n");
    let text = TIME_AND_Z.replace("column = \"z\"", "column = \"alt\"");
    let words = bench.import_with(&text, None).unwrap_err().to_string();
    assert!(words.contains("map.toml:4: `time.column`: no column is called \"t\""), "{words}");
    assert!(words.contains("map.toml:8: `position.z.column`: 2 times a column is called \"alt\""), "{words}");
    assert!(words.contains("has the columns time, alt, alt"), "{words}");
    assert_eq!(bench.files(), ["log.csv"]);
}

#[test]
fn long_absolute_times_keep_every_nanosecond() {
    let log = "t,z\n1772429894.780505180,0\n1772429894.790504694,1\n";
    let bench = Bench::new(log);
    bench.import_with(TIME_AND_Z, None).unwrap();
    let flight = Flight::load(bench.out()).unwrap();
    assert_eq!(flight.positions[1].arrived_at, Time::from_nanos(9_999_514));
    assert_eq!(flight.session.extra["import.time_offset_s"], "1772429894.780505180");

    for (unit, factor) in [("s", 1_i64), ("ms", 1_000), ("us", 1_000_000), ("ns", 1_000_000_000)] {
        let text = TIME_AND_Z.replace("unit = \"s\"", &format!("unit = \"{unit}\""));
        let (_, flight) = imported(&text, format!("t,z\n{},0\n{},1\n", -2 * factor, factor));
        assert_eq!(flight.positions[1].arrived_at, Time::from_seconds(3.0), "{unit}");
    }
}

#[test]
fn time_starts_at_the_first_row_that_is_used() {
    let (report, flight) = imported(TIME_AND_Z, "t,z\n7,nan\n8,1\n9.5,2\n");
    assert_eq!((report.time_offset_s, report.duration_s), (8.0, 1.5));
    assert_eq!(flight.positions[1].arrived_at, Time::from_seconds(1.5));
}

#[test]
fn filters_keep_rows_from_at_least_to_below() {
    let text = format!("{TIME_AND_Z}[[filter]]\ncolumn = \"armed\"\nat_least = 1\nbelow = 3\n");
    let (report, flight) = imported(&text, "t,z,armed\n0,0,0\n1,1,1\n2,2,2.9\n3,3,3\n4,4,x\n5,nan,0\n");
    assert_eq!(heights(&flight), [1.0, 2.0]);
    assert_eq!((report.rows, report.used, report.filtered), (6, 2, 3));
    assert_eq!(skips(&report), [(SkipReason::NotANumber, "armed", 1, 6)]);
}

#[test]
fn repeated_values_can_be_left_out_by_change_or_by_period() {
    let battery = |how: &str| {
        let text = format!("{TIME_AND_Z}[battery]\nvoltage = {{ column = \"v\", unit = \"V\" }}\n{how}\n");
        let rows: Vec<_> = (0..30).map(|i| format!("{}.{},0,{}\n", i / 10, i % 10, 40 - i / 10)).collect();
        let (report, flight) = imported(&text, format!("t,z,v\n{}", rows.concat()));
        assert_eq!((report.used, flight.positions.len()), (30, 30));
        flight.battery.iter().map(|b| (b.time.seconds(), b.voltage_v)).collect::<Vec<_>>()
    };
    assert_eq!(battery("").len(), 30);
    assert_eq!(battery("keep = \"changes\""), [(0.0, 40.0), (1.0, 39.0), (2.0, 38.0)]);
    let every = battery("every_s = 0.3");
    assert_eq!(every.len(), 10);
    assert!(every.iter().enumerate().all(|(i, (t, _))| (t - 0.3 * i as f64).abs() < 1e-9), "{every:?}");
}

#[test]
fn a_channel_may_be_absent_from_rows_of_a_log_with_several_rates() {
    let text = format!(
        "{TIME_AND_Z}empty = \"absent\"\n[battery]\nempty = \"absent\"\nvoltage = {{ column = \"v\", unit = \"V\" }}\n"
    );
    let (report, flight) = imported(&text, "t,z,v\n0,1,\n1,,3.7\n2,2,NaN\n3,,\n4,3,bad\n");
    assert_eq!((flight.positions.len(), flight.battery.len()), (2, 1));
    assert_eq!(flight.battery[0].time, Time::from_seconds(1.0));
    // A row that says nothing at all, and one that is not merely empty.
    assert_eq!(skips(&report), [(SkipReason::Empty, "v", 1, 5), (SkipReason::NotANumber, "v", 1, 6)]);
}

#[test]
fn ticks_show_how_late_each_row_is_after_the_row_before() {
    let text = format!("{TIME_AND_Z}[tick]\nperiod_s = 0.1\n[[filter]]\ncolumn = \"on\"\nat_least = 1\n");
    let log = "t,z,on\n0.0,0,1\n0.102,0,1\n0.45,0,1\n0.55,nan,1\n0.65,0,1\n0.75,0,0\n0.95,0,1\n";
    let (_, flight) = imported(&text, log);
    let ticks: Vec<_> = flight
        .ticks
        .iter()
        .map(|tick| {
            let late_ms = (tick.started.since_s(tick.scheduled) * 1e3).round() as i32;
            (tick.index, late_ms, tick.overrun)
        })
        .collect();
    // The row with the bad value was an iteration all the same; before the filtered row nothing is known.
    assert_eq!(ticks, [(0, 0, false), (1, 2, false), (2, 248, true), (4, 0, false), (5, 0, false)]);
}

#[test]
fn a_phase_can_be_told_by_thresholds_or_be_constant() {
    let control = |phase: &str| {
        let (_, flight) =
            imported(&format!("{TIME_AND_Z}[control]\nphase = {phase}\n"), "t,z\n0,0\n1,9.9\n2,10\n3,-1\n");
        flight.states.iter().map(|state| state.phase).collect::<Vec<_>>()
    };
    // The last row lies below every threshold: it is skipped, not guessed.
    assert_eq!(
        control("{ column = \"z\", from = [[0, \"idle\"], [10, \"hold\"]] }"),
        [Phase::Idle, Phase::Idle, Phase::Hold]
    );
    assert_eq!(control("\"open\""), [Phase::Open; 4]);
}

#[test]
fn latency_period_and_centre_can_come_from_the_rig() {
    let rig = Rig::load(rigs().join("foreign.toml")).unwrap();
    let text = TIME_AND_Z.replace("latency_s = 0.0", "latency_s = \"rig\"").replacen(
        "name",
        "actuation = \"volt\"\nname",
        1,
    ) + "[tick]\nperiod_s = \"rig\"\n[command]\nthrottle = { column = \"z\", unit = \"V\" }\n";
    let log = "t,z\n0,0\n0.1,0\n0.4,0\n";
    let (_, flight) = imported_on(&text, log, Some(&rig));
    assert_eq!(flight.positions[0].exposed_at, Time::from_seconds(0.1));
    assert_eq!(flight.ticks[1].scheduled, Time::from_seconds(0.1));
    assert_eq!(flight.commands[0].sticks.to_array(), [0.0, 1.65, 1.65, 1.65]);

    let words = Bench::new(log).import_with(&text, None).unwrap_err().to_string();
    assert!(words.contains("map.toml:8: `position.latency_s`"), "{words}");
    assert!(words.contains("--rig"), "{words}");
}

#[test]
fn a_rig_with_other_sticks_is_refused() {
    let rig = Rig::load(rigs().join("foreign.toml")).unwrap();
    let text = format!(
        "actuation = \"count\"\n{TIME_AND_Z}[command]\nthrottle = {{ column = \"z\", unit = \"count\" }}\n"
    );
    let error = Bench::new("t,z\n0,0\n").import_with(&text, Some(&rig)).unwrap_err();
    assert!(matches!(error, ImportError::Actuation { .. }), "{error}");
}

#[test]
fn a_map_names_its_own_rig_relative_to_itself() {
    let map = ImportMap::load(rigs().join("import/foreign.toml")).unwrap();
    assert_eq!(map.load_rig().unwrap().unwrap().name, "foreign");
}

#[test]
fn the_map_in_the_manual_and_those_that_are_kept_read() {
    let manual = fs::read_to_string(rigs().join("../docs/import.md")).unwrap();
    let example = manual.split("```toml\n").nth(1).unwrap().split("```").next().unwrap();
    assert_eq!(map(example).name, "my-quad");
    for entry in fs::read_dir(rigs().join("import")).unwrap() {
        let path = entry.unwrap().path();
        let map = ImportMap::load(&path).unwrap();
        assert_eq!(Some(map.name.as_str()), path.file_stem().unwrap().to_str());
    }
}

#[test]
fn semicolons_byte_order_marks_and_spaces_do_no_harm() {
    let text = format!("delimiter = \";\"\n{TIME_AND_Z}");
    let (_, flight) = imported(&text, "\u{feff}t; z \r\n0; 1.5\r\n1 ;+2e0\r\n");
    assert_eq!(heights(&flight), [1.5, 2.0]);
}

#[test]
fn wrong_maps_are_told_with_line_and_key() {
    let wrong = [
        (
            "unit = \"m\" }",
            "unit = \"ft\" }",
            "map.toml:8: `position.z.unit` is the text \"ft\"; expected one of \"m\"",
        ),
        ("unit = \"m\" }", "unit = \"m\", valid = [1] }", "map.toml:8: `position.z.valid` is a list"),
        ("unit = \"m\" }", "unit = \"m\", valid = [2, 1] }", "2 is above 1"),
        ("unit = \"m\" }", "unt = \"m\" }", "unknown key `position.z.unt`; did you mean `unit`"),
        ("latency_s = 0.0", "", "key `position.latency_s` is missing"),
        (
            "column = \"t\"",
            "column = 3",
            "map.toml:4: `time.column` is the number 3; expected the name of a column",
        ),
        ("[position]", "[positron]", "unknown key `positron`; did you mean `position`"),
        ("[position]", "[battery]\n[position]", "key `battery.voltage` is missing"),
        ("[position]", "[motion]\n[position]", "the table maps no quantity"),
        ("[position]", "[control]\nphase = \"flying\"\n[position]", "`control.phase` is the text \"flying\""),
        (
            "[position]",
            "[control]\nphase = { column = \"p\", from = [[1, \"idle\"], [0, \"hold\"]] }\n[position]",
            "whose numbers rise",
        ),
        ("[position]", "[command]\nthrottle = 1.0\n[position]", "key `actuation` is missing"),
        ("[position]", "[[filter]]\ncolumn = \"z\"\n[position]", "give at_least, below or both"),
        (
            "[position]",
            "[motion]\nvertical_acceleration = { column = \"a\", unit = \"g\" }\n[position]",
            "key `motion.vertical_acceleration.gravity` is missing",
        ),
    ];
    for (old, new, expected) in wrong {
        let words = map_problem_words(&TIME_AND_Z.replace(old, new));
        assert!(words.contains(expected), "{new}: {words}");
    }
    let only_time = TIME_AND_Z.split("[position]").next().unwrap();
    assert!(map_problem_words(only_time).contains("nothing but time is mapped"));
}

#[test]
fn the_report_is_data_with_a_schema() {
    let (report, _) = imported(TIME_AND_Z, "t,z\n0,1\n1,nan\n2,3\n");
    let json = serde_json::to_value(&report).unwrap();
    assert_eq!(json["schema"], "bench.import/1");
    assert_eq!(json["rows"], 3);
    assert_eq!(json["skipped"][0]["reason"], "nan");
    assert_eq!(json["skipped"][0]["first_line"], 3);
    assert_eq!(json["channels"]["/tracker/position"], 2);
    assert_eq!(json["quantities"][0]["max"], 3.0);
    let words = report.to_string();
    assert!(words.contains("rows 3, used 2, filtered 0, skipped 1"), "{words}");
}

/// What an import of published data must look like.
struct Expected {
    map: &'static str,
    altitude_m: [f64; 2],
    command: [f64; 2],
    battery_v: Option<[f64; 2]>,
    /// Median time between rows, s.
    period_s: f64,
    /// Place of the altitude in a row, where it is NaN in some.
    some_altitudes: Option<usize>,
}

const PUBLISHED: [(&str, Expected); 4] = [
    (
        "foreign",
        Expected {
            map: "foreign.toml",
            altitude_m: [-0.01, 1.5],
            command: [0.0, 3.3],
            battery_v: None,
            period_s: 0.102,
            some_altitudes: None,
        },
    ),
    (
        "real/nanobench",
        Expected {
            map: "nanobench.toml",
            altitude_m: [-0.01, 2.2],
            command: [0.0, 65_535.0],
            battery_v: Some([3.0, 4.25]),
            period_s: 0.01,
            some_altitudes: None,
        },
    ),
    (
        "real/crazypad",
        Expected {
            map: "crazypad.toml",
            altitude_m: [-0.1, 0.7],
            command: [0.0, 65_535.0],
            battery_v: Some([2.8, 4.2]),
            period_s: 0.0099,
            some_altitudes: None,
        },
    ),
    (
        "real/bzzz",
        Expected {
            map: "bzzz.toml",
            altitude_m: [0.5, 1.8],
            command: [0.0, 0.5],
            battery_v: None,
            period_s: 0.0223,
            some_altitudes: Some(1),
        },
    ),
];

#[test]
#[ignore = "needs BENCH_DATA; tests/run runs it where that is set"]
fn bench_data_every_published_log_comes_through_whole() {
    let data = PathBuf::from(std::env::var_os("BENCH_DATA").expect("BENCH_DATA names the data folder"));
    let folder = tempfile::tempdir().unwrap();
    for (place, expected) in PUBLISHED {
        let map = ImportMap::load(rigs().join("import").join(expected.map)).unwrap();
        let logs = csv_files(&data.join(place));
        assert!(!logs.is_empty(), "{place} has no logs");
        for log in logs {
            let out = folder.path().join("out.mcap");
            let report = import(&map, &log, &out, None).unwrap_or_else(|error| panic!("{error}"));
            println!("{report}");
            check(&report, &Flight::load(&out).unwrap(), &expected, &log);
        }
    }
}

fn csv_files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(csv_files(&path));
        } else if path.extension().is_some_and(|extension| extension == "csv") {
            found.push(path);
        }
    }
    found.sort();
    found
}

fn check(report: &ImportReport, flight: &Flight, expected: &Expected, log: &Path) {
    let log = log.display();
    let text = fs::read_to_string(&report.log).unwrap();
    assert_eq!(report.rows, text.lines().count() as u64 - 1, "{log}");
    let is_absent =
        |line: &&str| expected.some_altitudes.is_some_and(|place| line.split(',').nth(place) == Some("nan"));
    let absent = text.lines().filter(is_absent).count() as u64;
    assert_eq!(expected.some_altitudes.is_some(), absent > 0, "{log}");
    assert_eq!(report.rows, report.used + report.filtered + report.skipped_rows(), "{log}");
    // These logs are whole; the bad rows that others of the set have are not among them.
    assert_eq!(report.skipped, [], "{log}");
    assert_eq!(flight.commands.len() as u64, report.used, "{log}");
    let positions = report.used - report.positions_before_origin - absent;
    assert_eq!(flight.positions.len() as u64, positions, "{log}");

    let within = |[low, high]: [f64; 2], value: f64, what: &str| {
        // NaN lies in no range.
        assert!((low..=high).contains(&value), "{log}: {what} is {value}");
    };
    for z in heights(flight) {
        within(expected.altitude_m, z, "altitude");
    }
    for command in &flight.commands {
        within(expected.command, command.sticks.throttle, "command");
    }
    assert_eq!(expected.battery_v.is_some(), !flight.battery.is_empty(), "{log}");
    for battery in &flight.battery {
        within(expected.battery_v.unwrap_or_default(), battery.voltage_v, "battery");
    }
    for motion in &flight.motion {
        let numbers = motion.velocity_m_s.iter().chain(&motion.attitude_rad);
        for number in numbers.chain([&motion.vertical_acceleration_m_s2]).flatten() {
            within([-150.0, 150.0], *number, "motion");
        }
    }
    let mut gaps: Vec<_> =
        flight.commands.windows(2).map(|pair| pair[1].time.since_s(pair[0].time)).collect();
    gaps.sort_by(f64::total_cmp);
    let median = gaps[gaps.len() / 2];
    // Stamps are rounded to a millisecond or a tenth of it.
    assert!((median - expected.period_s).abs() < 0.0011, "{log}: rows are {median} s apart");
    // The weakest hop peaks at 0.065 m, in steps of 5 mm.
    let peak = heights(flight).into_iter().fold(f64::MIN, f64::max);
    assert!(peak > 0.06, "{log}: never in the air");
}

#[test]
#[ignore = "needs BENCH_DATA; tests/run runs it where that is set"]
fn bench_data_the_foreign_rig_has_the_numbers_that_came_with_every_flight() {
    let data = PathBuf::from(std::env::var_os("BENCH_DATA").expect("BENCH_DATA names the data folder"));
    let rig = Rig::load(rigs().join("foreign.toml")).unwrap();
    let airframe = &rig.airframe;
    let uncertain = [
        ("mass_kg", airframe.mass_kg),
        ("thrust_gain_n_per_v", airframe.thrust.gain_n_per_unit),
        ("thrust_offset_v", airframe.thrust.offset),
        ("ground_effect_multiplier", airframe.ground_effect.multiplier),
        ("ground_effect_height_m", airframe.ground_effect.height_m),
        ("drag_n_s_per_m", airframe.drag_n_s_per_m),
        ("tracker_latency_s", rig.tracker.latency_s),
    ];
    let exact = [
        ("loop_period_s", rig.control_loop.period_s),
        ("tracker_resolution_m", rig.tracker.resolution_m),
        ("tracker_noise_m", rig.tracker.noise_m),
        ("throttle_max_v", airframe.sticks.max),
        ("dac_bits", f64::from(rig.output.bits)),
        ("tracker_frame_period_s", rig.tracker.frame_period_s),
    ];
    let mut examples = 0;
    for entry in fs::read_dir(data.join("foreign")).unwrap() {
        let path = entry.unwrap().path().join("rig.json");
        if !path.exists() {
            continue;
        }
        let given: Value = serde_json::from_str(&fs::read_to_string(&path).unwrap()).unwrap();
        for (key, Uncertain { value, sigma }) in uncertain {
            assert_eq!(given[key], value, "{}: {key}", path.display());
            assert_eq!(given["one_sigma"][key], sigma, "{}: one_sigma.{key}", path.display());
        }
        for (key, value) in exact {
            assert_eq!(given[key].as_f64(), Some(value), "{}: {key}", path.display());
        }
        assert_eq!(given["one_sigma"].as_object().unwrap().len(), uncertain.len());
        examples += 1;
    }
    assert_eq!(examples, 8);
}
