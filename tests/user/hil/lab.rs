//! The whole lab, emulated: in a user-mode kernel a Kinect and a board with the real firmware, joined by a virtual airframe in another
//! process. The bench sees all of it through its real drivers alone, and is not told what the lab has that its rig has not.

use std::{fs, time::Duration};

use bench_usb_lab::host::{Lab, Outcome};

use super::short_mission;
use crate::support::{Page, Scratch, bench, conforms, json, root};

/// What the lab has: rotors that follow slowly.
const PLANTED_S: f64 = 0.12;

fn variable(name: &str) -> String {
    std::env::var(name).unwrap_or_else(|_| panic!("{name} is set by tests/run"))
}

/// Runs a script in the kernel with camera, motor and board plugged in.
fn run(scratch: &Scratch, effects: &str, script: &str) -> Outcome {
    run_drifted(scratch, effects, 0.0, script)
}

/// The same with a board whose throttle output has drifted since it was calibrated.
fn run_drifted(scratch: &Scratch, effects: &str, drift_v: f64, script: &str) -> Outcome {
    let rig = root().join("rigs/transmitter.toml").canonicalize().unwrap();
    let settings = format!(
        "rig = \"{}\"\nseed = 5\nboard_drift_v = {drift_v:?}\neffects = [{effects}]\nboard = \"{}\"\ntruth = \"{}\"\nhidden_while = \"{}\"\n",
        rig.display(),
        variable("BENCH_FIRMWARE_HOST"),
        scratch.name("truth.csv"),
        scratch.name("hidden"),
    );
    fs::write(scratch.path("lab.toml"), settings).unwrap();
    let lab = Lab::from_env(variable("BENCH_LAB")).expect("BENCH_USB_KERNEL names the kernel (tests/run)");
    let prelude = format!(
        "bench={}\nwork=$PWD\ncd {}\necho plug 1 > /run/usb-lab\necho plug 2 > /run/usb-lab
        until [ -e /dev/ttyACM0 ]; do sleep 0.05; done
        hil=\"$bench hil --rig rigs/transmitter.toml --port /dev/ttyACM0 --exposure-ms 10 --json\"\n",
        env!("CARGO_BIN_EXE_bench"),
        root().canonicalize().unwrap().display()
    );
    let outcome = lab.run(&scratch.path(""), &(prelude + script), Duration::from_secs(1200)).unwrap();
    assert_eq!(outcome.status, Some(0), "{}", outcome.console);
    outcome
}

fn report(scratch: &Scratch, name: &str) -> serde_json::Value {
    let told = serde_json::from_str(&fs::read_to_string(scratch.path(name)).unwrap()).unwrap();
    conforms(&told);
    told
}

/// Altitude and throttle of the airframe, as it really was.
fn truth(scratch: &Scratch) -> Vec<[f64; 2]> {
    let mut reader = csv::Reader::from_path(scratch.path("truth.csv")).unwrap();
    let number = |row: &csv::StringRecord, i: usize| row[i].parse().unwrap();
    // The kernel is switched off in the middle of a line.
    let rows = reader.records().map_while(Result::ok).filter(|row| row.len() == 5);
    let mut rows: Vec<_> = rows.map(|row| [number(&row, 3), number(&row, 4)]).collect();
    rows.pop();
    rows
}

#[test]
#[ignore = "needs a user-mode kernel: tests/run"]
fn usb_lab_is_flown_through_the_real_drivers_and_what_was_planted_in_it_is_found() {
    let scratch = Scratch::new();
    run(
        &scratch,
        &format!("\"rotor-lag:time_constant_s={PLANTED_S}\""),
        "$bench devices --json > $work/devices.json || exit 1
        # Criteria are made for a lab without anything planted in it.
        fly() { $hil --mission $1 -o $work/$1.mcap > $work/$1.json 2> $work/$1.words; [ $? -le 1 ] || { cat $work/$1.words $work/$1.json; exit 2; } }
        fly hop
        fly climb-040
        $bench record-frames --kinect A00EMULATED0001A --seconds 3 -o $work/frames --json > $work/frames.json
        case $? in 0|3) ;; *) exit 4;; esac",
    );
    let devices = report(&scratch, "devices.json");
    let kinect = &devices["kinects"][0];
    assert_eq!((&kinect["motor"], &kinect["problem"]), (&true.into(), &serde_json::Value::Null), "{devices}");
    assert!(kinect["model"].as_str().unwrap().contains("1414"), "{devices}");

    for flight in ["hop.json", "climb-040.json"] {
        let report = report(&scratch, flight);
        assert_eq!(
            (&report["ending"], &report["outputs_at_zero"]["confirmed"]),
            (&"complete".into(), &true.into()),
            "{report}"
        );
        let (frames, found) =
            (report["tracking"]["frames"].as_f64().unwrap(), report["tracking"]["found"].as_f64().unwrap());
        // 30 a second from before the first iteration on, with the marker in all but those at the start.
        let duration_s = report["summary"]["duration_s"].as_f64().unwrap();
        assert!(frames > 29.0 * duration_s && found > 0.95 * frames, "{report}");
    }
    // Armed, climbed, held at 0.4 m for 17 s; landed, and the rotors stand still.
    let truth = truth(&scratch);
    let peak = truth.iter().fold(0.0_f64, |peak, [z, _]| peak.max(*z));
    assert!((0.4..0.5).contains(&peak), "{peak}");
    let mut aloft: Vec<f64> = truth.iter().map(|[z, _]| *z).filter(|z| *z > 0.2).collect();
    aloft.sort_by(f64::total_cmp);
    let held = aloft.get(aloft.len() / 2);
    assert!(held.is_some_and(|z| (0.36..0.44).contains(z)), "{held:?}");
    let [z, throttle_v] = truth[truth.len() - 1];
    assert!(z == 0.0 && throttle_v < 0.1, "{z} {throttle_v}");

    // A recording is what a lab machine would make: it knows nothing of the truth.
    let recorded = json(&bench(["info", &scratch.name("climb-040.mcap"), "--json"]).assert().success());
    assert_eq!(
        (&recorded["mode"], recorded["rig"].to_string().contains("transmitter")),
        (&"hil".into(), true),
        "{recorded}"
    );
    let simulated = scratch.fly("sim.mcap", &["--rig", "rigs/transmitter.toml"]);
    let compared =
        json(&bench(["diff", &simulated, &scratch.name("climb-040.mcap"), "--json"]).assert().code(1));
    assert_eq!(compared["verdict"], "different", "{compared}");

    let flights = [scratch.name("hop.mcap"), scratch.name("climb-040.mcap")];
    let diagnosed = json(
        &bench([
            "diagnose",
            "--rig",
            "rigs/transmitter.toml",
            "--json",
            "--min-confidence",
            "0",
            &flights[0],
            &flights[1],
        ])
        .assert()
        .success(),
    );
    let named = diagnosed["effects"].as_array().unwrap();
    assert!(named.contains(&"rotor-lag".into()), "{diagnosed}");
    let parameters = diagnosed["candidates"][0]["parameters"].as_array().unwrap();
    let lag = parameters.iter().find(|parameter| parameter["effect"] == "rotor-lag").unwrap();
    // The diagnosis' own interval is 5 %; three times that.
    assert!((lag["value"].as_f64().unwrap() - PLANTED_S).abs() < 0.15 * PLANTED_S, "{lag}");

    let frames = report(&scratch, "frames.json");
    // The tracker believes a marker in its second frame.
    assert!(frames["folders"][0]["frames"].as_u64().unwrap() >= 3, "{frames}");
    // The airframe stands where it landed, and the frames show it there.
    let arguments = ["track", &scratch.name("frames"), "--rig", "rigs/transmitter.toml", "--json"];
    let tracked = json(&bench(arguments).assert());
    assert!(tracked["tracking"]["found"].as_u64().unwrap() >= 1, "{tracked}");
    let last =
        tracked["positions"].as_array().unwrap().iter().rfind(|position| position["status"] == "found");
    // Half of the depth's noise stays the same from frame to frame: 4 mm at 1.8 m. Height has none of it.
    let z_m = last.unwrap()["position_m"][2].as_f64().unwrap();
    assert!(z_m.abs() < 0.005, "{tracked}");
}

#[test]
#[ignore = "needs a user-mode kernel: tests/run"]
fn usb_lab_without_anything_planted_shows_none() {
    let scratch = Scratch::new();
    run(
        &scratch,
        "",
        "fly() { $hil --mission $1 -o $work/$1.mcap > $work/$1.json 2> $work/$1.words; [ $? -le 1 ] || { cat $work/$1.words $work/$1.json; exit 2; } }
        fly hop
        fly climb-040",
    );
    let flights = [scratch.name("hop.mcap"), scratch.name("climb-040.mcap")];
    let diagnosed = json(
        &bench([
            "diagnose",
            "--rig",
            "rigs/transmitter.toml",
            "--json",
            "--min-confidence",
            "0",
            &flights[0],
            &flights[1],
        ])
        .assert()
        .success(),
    );
    assert_eq!(
        (&diagnosed["verdict"], &diagnosed["effects"]),
        (&"none".into(), &serde_json::json!([])),
        "{diagnosed}"
    );
}

#[test]
#[ignore = "needs a user-mode kernel: tests/run"]
fn usb_kinect_that_is_unplugged_in_flight_stops_it_with_the_throttle_at_rest() {
    let scratch = Scratch::new();
    run(
        &scratch,
        "",
        "$hil --mission climb-040 -o $work/flown.mcap > $work/report.json 2> $work/words &
        id=$!
        until awk -F, 'NR > 1 && $4 > 0.2 { found = 1 } END { exit !found }' $work/truth.csv; do sleep 0.2; done
        echo unplug 0 > /run/usb-lab
        wait $id
        echo $? > $work/code
        $hil --mission hop -o $work/second.mcap > $work/second.json 2> $work/second
        echo $? > $work/second.code",
    );
    let read = |name: &str| fs::read_to_string(scratch.path(name)).unwrap();
    assert_eq!(read("code").trim(), "4", "{}", read("words"));
    let report = report(&scratch, "report.json");
    assert_eq!(
        (&report["ending"], &report["outputs_at_zero"]["confirmed"]),
        (&"fault".into(), &true.into()),
        "{report}"
    );
    assert!(report["reason"].as_str().unwrap().contains("the Kinect is gone"), "{report}");
    bench(["info", &scratch.name("flown.mcap")]).assert().success();
    let throttle_v = truth(&scratch).last().unwrap()[1];
    assert!(throttle_v < 0.1, "{throttle_v}");
    // Without a camera nothing is armed; what remains of the Kinect says what is missing.
    assert_eq!(read("second.code").trim(), "4");
    assert!(
        read("second").contains("not its camera: plug in the Kinect's own power supply"),
        "{}",
        read("second")
    );
    assert!(!scratch.path("second.mcap").exists());
}

#[test]
#[ignore = "needs a user-mode kernel: tests/run"]
fn usb_lab_is_flown_with_a_live_page_in_the_time_of_the_flight() {
    let scratch = Scratch::new();
    run(
        &scratch,
        "",
        "ip link set lo up || ifconfig lo 127.0.0.1 up
        $hil --live --autostart --listen 127.0.0.1:0 --mission hop -o $work/hop.mcap > $work/hop.json 2> $work/hop.words
        [ $? -le 1 ] || { cat $work/hop.words $work/hop.json; exit 2; }",
    );
    let report = report(&scratch, "hop.json");
    assert_eq!(report["ending"], "complete", "{report}");
    assert!(report["tracking"]["found"].as_f64() > Some(100.0), "{report}");
    // The Kinect streamed before the flight began, which nothing of the recording's times shows.
    let flight = bench_recording::Flight::load(scratch.path("hop.mcap")).unwrap();
    assert!(flight.ticks[0].started.seconds() < 3.5, "{:?}", flight.ticks[0]);
    let newest =
        flight.positions.iter().rfind(|sample| sample.arrived_at <= flight.ticks[50].started).unwrap();
    let behind_s = flight.ticks[50].started.since_s(newest.arrived_at);
    assert!(behind_s < 0.3, "{behind_s} s");
    assert!(newest.arrived_at.since_s(newest.exposed_at) > 0.0);
}

#[test]
#[ignore = "needs a user-mode kernel: tests/run"]
fn usb_lab_is_flown_by_a_second_start_once_the_marker_is_in_sight() {
    let scratch = Scratch::new();
    fs::write(scratch.path("hidden"), "").unwrap();
    run(
        &scratch,
        "",
        "ip link set lo up || ifconfig lo 127.0.0.1 up
        $hil --live --listen 127.0.0.1:0 --mission hop -o $work/hop.mcap > $work/hop.json 2> $work/hop.words &
        id=$!
        python3 tests/user/hil/start_again.py $work/hop.words $work/hidden > $work/told || { cat $work/hop.words; exit 2; }
        wait $id
        [ $? -le 1 ] || { cat $work/hop.words $work/hop.json; exit 3; }",
    );
    let told = fs::read_to_string(scratch.path("told")).unwrap();
    let [warning, headline] = told.lines().collect::<Vec<_>>().try_into().expect("a warning, then a flight");
    assert!(warning.starts_with("Not armed: the tracker has not seen the marker"), "{warning}");
    assert!(headline.starts_with("Flown, "), "{headline}");
    let report = report(&scratch, "hop.json");
    assert_eq!(
        (&report["ending"], &report["outputs_at_zero"]["confirmed"]),
        (&"complete".into(), &true.into()),
        "{report}"
    );
    // The recording is that of the flight alone, from its beginning.
    let flight = bench_recording::Flight::load(scratch.path("hop.mcap")).unwrap();
    assert!(flight.ticks[0].started.seconds() < 3.5, "{:?}", flight.ticks[0]);
    assert_eq!(flight.ticks.len() as u64, report["summary"]["ticks"].as_u64().unwrap());
    let peak = truth(&scratch).iter().fold(0.0_f64, |peak, [z, _]| peak.max(*z));
    assert!(peak > 0.1, "{peak}");
}

/// The loopback bench against the real airframe, each with a board of its own. One mission, as nobody puts the airframe back.
const PAIR: &str = r#"
name = "pair"
description = "The airframe flies as the board's loop does."

[[case]]
name = "pair"
rig = ["loopback", "transmitter"]
mode = ["loopback", "transmitter"]
mission = "short.toml"
compare = "back-to-back"
mission_criteria = "ignore"

[case.limits]
peak_min_m = 0.3
peak_max_m = 1.0
"#;

/// How far a board's throttle output is off, mV: three of its steps.
const OFF_MV: i32 = 48;

/// Flies the pair with a loopback board on a pty and the lab's board on USB, off by so much; the exit code with what was said, and the report.
fn fly_pair(scratch: &Scratch, [loopback_mv, lab_mv]: [i32; 2]) -> (String, serde_json::Value) {
    short_mission(scratch);
    fs::write(scratch.path("pair.toml"), PAIR).unwrap();
    run_drifted(
        scratch,
        "",
        f64::from(lab_mv) * 1e-3,
        &format!(
            "export XDG_CACHE_HOME=$work/cache
            $bench emulate psoc5 --link /run/psoc5 --dac-offset-mv {loopback_mv} > /dev/null 2>&1 &
            until [ -e /run/psoc5 ]; do sleep 0.05; done
            $bench test $work/pair.toml --port loopback=/run/psoc5 --port transmitter=/dev/ttyACM0 --exposure-ms 10 \
                -o $work/results --json > $work/report.json 2> $work/words
            echo $? > $work/code"
        ),
    );
    let read = |name: &str| fs::read_to_string(scratch.path(name)).unwrap();
    (read("code").trim().to_owned() + &read("words"), report(scratch, "report.json"))
}

/// What the tests of the pair came to, the loopback bench's first. Each was flown to its end, and the second was held against the first.
fn outcomes(report: &serde_json::Value) -> [&str; 2] {
    let tests: Vec<_> = report["tests"].as_array().unwrap().iter().collect();
    let [loopback, transmitter] = tests[..] else { panic!("{report}") };
    for (test, mode) in [(loopback, "loopback"), (transmitter, "transmitter")] {
        let run = &test["runs"][0];
        assert_eq!(test["mode"], mode, "{report}");
        assert_eq!((&run["stopped"], &run["data_lost"]), (&false.into(), &false.into()), "{test}");
    }
    assert_eq!(transmitter["runs"][0]["comparisons"][0]["with"], loopback["id"], "{report}");
    [loopback, transmitter].map(|test| test["outcome"].as_str().unwrap())
}

#[test]
#[ignore = "needs a user-mode kernel: tests/run"]
fn usb_lab_flies_as_the_loopback_bench_where_both_boards_are_right() {
    let scratch = Scratch::new();
    let (code, report) = fly_pair(&scratch, [0, 0]);
    assert!(code.starts_with('0'), "{code}: {report}");
    assert_eq!(outcomes(&report), ["passed", "passed"], "{report}");
    assert_eq!(report["diagnoses"], serde_json::json!([]));
}

/// Flies the pair with one board off, and looks for what is said of which.
fn finds_the_board_that_is_off(off_mv: [i32; 2], off: &str) {
    let scratch = Scratch::new();
    let (code, report) = fly_pair(&scratch, off_mv);
    assert!(code.starts_with('1'), "{code}: {report}");
    assert_eq!(outcomes(&report), ["passed", "failed"], "{report}");
    // The flight through the right board is as its rig says, and that through the other is not.
    let diagnoses = report["diagnoses"].as_array().unwrap();
    assert_eq!(diagnoses.len(), 2, "{report}");
    let page = Page::read(&scratch.name("results/report.html"));
    for diagnosed in diagnoses {
        let is_off = diagnosed["tests"][0].as_str().unwrap().contains(off);
        assert_eq!(diagnosed["verdict"] != "none", is_off, "{off}: {diagnosed}");
        assert!(diagnosed["verdict"].is_string(), "{diagnosed}");
        assert!(page.section("Diagnosis of what differs").contains(diagnosed["words"].as_str().unwrap()));
    }
}

#[test]
#[ignore = "needs a user-mode kernel: tests/run"]
fn usb_lab_against_the_loopback_bench_names_the_loopback_board_that_is_off() {
    finds_the_board_that_is_off([OFF_MV, 0], "loopback");
}

#[test]
#[ignore = "needs a user-mode kernel: tests/run"]
fn usb_lab_against_the_loopback_bench_names_the_transmitter_board_that_is_off() {
    finds_the_board_that_is_off([0, OFF_MV], "transmitter");
}
