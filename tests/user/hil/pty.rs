use std::fs;

use super::{Emulated, Flight, Process, rig_with, short_mission, wait_for};
use crate::support::{Scratch, bench, json, refused, stdout};

#[test]
fn a_loopback_flight_is_flown_recorded_and_like_the_simulated_one() {
    let scratch = Scratch::new();
    let mission = short_mission(&scratch);
    let board = Emulated::start(&scratch, &[]);
    let (flown, table) = (scratch.name("hil.mcap"), scratch.name("hil.csv"));
    let hil =
        ["hil", "--port", &board.port, "--mission", &mission, "-o", &flown, "--export", &table, "--json"];
    let report = json(&bench(hil).assert().success());
    assert_eq!((&report["schema"], &report["ending"]), (&"bench.hil/1".into(), &"complete".into()));
    assert_eq!(report["outputs_at_zero"]["confirmed"], true);
    assert_eq!(report["passed"], true);
    for figure in ["p50", "p99", "max"] {
        assert!(report["timing"]["lateness_s"][figure].as_f64().unwrap() >= 0.0);
        assert!(report["timing"]["round_trip_s"][figure].as_f64().unwrap() > 0.0);
    }
    assert!(fs::read_to_string(table).unwrap().lines().next().unwrap().contains("truth"));

    let info = json(&bench(["info", &flown, "--json"]).assert().success());
    assert_eq!((&info["mode"], &info["rig"]), (&"hil".into(), &"loopback".into()));
    // What cannot be made again is not replaced.
    let again = bench(["hil", "--port", &board.port, "--mission", &mission, "-o", &flown]);
    assert!(refused(again, 2).contains("--force"));

    // The same mission in lockstep, as docs/hil.md has it: the loopback flight is one of its kind.
    let simulated = scratch.name("sim.mcap");
    bench(["sim", "--rig", "rigs/loopback.toml", "--mission", &mission, "-o", &simulated]).assert().success();
    let words = stdout(&bench(["diff", &simulated, &flown]).assert().success());
    assert!(words.starts_with("within tolerance") && words.contains("derived from rig loopback"), "{words}");
}

#[test]
fn a_flight_goes_on_where_nobody_reads_what_it_says() {
    let scratch = Scratch::new();
    let mission = short_mission(&scratch);
    let board = Emulated::start(&scratch, &[]);
    let flown = scratch.name("hil.mcap");
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let mut hil = std::process::Command::new(env!("CARGO_BIN_EXE_bench"));
    hil.args(["hil", "--port", &board.port, "--mission", &mission, "-o", &flown]).stderr(writer);
    assert_eq!(hil.output().unwrap().status.code(), Some(0));
    assert_eq!(json(&bench(["info", &flown, "--json"]).assert().success())["mode"], "hil");
}

#[test]
fn a_station_logs_flights_whether_they_come_about_or_not() {
    let scratch = Scratch::new();
    let mission = short_mission(&scratch);
    let board = Emulated::start(&scratch, &[]);
    let station = scratch.name("lab");
    let hil = |port: &str| {
        bench(["hil", "--port", port, "--mission", &mission, "--station", &station, "--meta", "operator=Ada"])
    };
    hil(&board.port).assert().success();
    assert!(refused(hil(&scratch.name("no-board")), 4).contains("no-board"));
    // What is wrong with the command itself is no run.
    refused(bench(["hil", "--station", &station]), 2);
    let runs =
        json(&bench(["runs", "--station", &station, "--meta", "operator=Ada", "--json"]).assert().success());
    let [late, early] = runs["runs"].as_array().unwrap().as_slice() else { panic!("{runs:#}") };
    assert_eq!((&early["mode"], &early["outcome"]), (&"loopback".into(), &"passed".into()));
    assert!(fs::exists(format!("{station}/{}", early["recording"].as_str().unwrap())).unwrap());
    assert_eq!(late["outcome"], "error");
    assert!(late["reason"].as_str().unwrap().contains("no-board"), "{late:#}");
    let trend =
        stdout(&bench(["runs", "--station", &station, "--trend", "round_trip_p50"]).assert().success());
    assert!(trend.contains("round_trip_p50"), "{trend}");
}

#[test]
fn a_board_whose_outputs_lag_is_different_from_the_simulation() {
    let scratch = Scratch::new();
    let mission = short_mission(&scratch);
    let board = Emulated::start(&scratch, &["--dac-lag-ms", "150"]);
    let (simulated, flown) = (scratch.name("sim.mcap"), scratch.name("hil.mcap"));
    bench(["sim", "--rig", "rigs/loopback.toml", "--mission", &mission, "-o", &simulated]).assert().success();
    // The lag may well miss the mission's criteria.
    bench(["hil", "--port", &board.port, "--mission", &mission, "-o", &flown]).assert().code(vec![0, 1]);
    let words = stdout(&bench(["diff", &simulated, &flown]).assert().code(1));
    assert!(words.starts_with("differ") && words.contains("sticks.throttle"), "{words}");
}

/// What is ordered of the board, or done to the process, and the effect that it is.
#[test]
fn what_goes_wrong_on_the_way_to_the_airframe_is_diagnosed() {
    let cases: [(&[&str], bool, Option<&str>); 5] = [
        (&[], false, None),
        (&["--dac-lag-ms", "80"], false, Some("actuator-lag")),
        (&["--latency-ms", "15", "--jitter-ms", "5"], false, Some("actuator-lag")),
        (&["--drop", "0.05"], false, Some("loop-overrun")),
        (&[], true, Some("loop-overrun")),
    ];
    std::thread::scope(|scope| {
        for (faults, held_up, expected) in cases {
            scope.spawn(move || {
                let scratch = Scratch::new();
                let flights = ["a.mcap", "b.mcap"].map(|name| scratch.name(name));
                let mission = short_mission(&scratch);
                for (number, flight) in flights.iter().enumerate() {
                    fly_to_the_end(&scratch, &mission, faults, held_up, number, flight);
                }
                let diagnose = [
                    "diagnose",
                    "--rig",
                    "rigs/loopback.toml",
                    "--json",
                    "--min-confidence",
                    "0",
                    &flights[0],
                    &flights[1],
                ];
                let report = json(&bench(diagnose).assert().success());
                let named: Vec<&str> =
                    report["effects"].as_array().unwrap().iter().filter_map(|name| name.as_str()).collect();
                match expected {
                    Some(effect) => {
                        assert!(named.contains(&effect), "{faults:?}, held up {held_up}: {report}");
                    }
                    // On a busy machine iterations are late in earnest.
                    None => assert!(named.iter().all(|name| *name == "loop-overrun"), "{report}"),
                }
            });
        }
    });
}

/// Two commands in a row that are lost or late trip the board, as they should; then the lab flies again.
fn fly_to_the_end(
    scratch: &Scratch,
    mission: &str,
    faults: &[&str],
    held_up: bool,
    number: usize,
    recording: &str,
) {
    let tries = 8;
    let mut words = String::new();
    for attempt in 0..tries {
        let seed = (1 + number * tries + attempt).to_string();
        let board = Emulated::start(scratch, &[faults, &["--seed", &seed]].concat());
        let mut flying = Flight::start(scratch, &board.port, recording, &["--mission", mission, "--force"]);
        // A machine that has better to do: three times a fifth of a second without a slice of time. The board waits for 0.3 s.
        for size in [10_000, 25_000, 40_000].into_iter().filter(|_| held_up) {
            let mut ended = false;
            wait_for("a recording", || {
                ended = flying.ended();
                ended || fs::metadata(recording).is_ok_and(|file| file.len() > size)
            });
            if !ended {
                flying.process.signal("STOP");
                std::thread::sleep(std::time::Duration::from_millis(200));
                flying.process.signal("CONT");
            }
        }
        let code;
        (code, words) = flying.end();
        match code {
            Some(0) => return,
            Some(4) => {}
            _ => panic!("{faults:?}: {words}"),
        }
    }
    panic!("{faults:?}, held up {held_up}: stopped {tries} times, the last time so: {words}");
}

#[test]
fn signals_bring_the_throttle_to_rest_before_the_recording_is_closed() {
    let scratch = Scratch::new();
    let mission = short_mission(&scratch);
    let board = Emulated::start(&scratch, &[]);
    for (signal, word) in [("INT", "Ctrl-C"), ("TERM", "SIGTERM"), ("HUP", "SIGHUP")] {
        let recording = scratch.name(&format!("{signal}.mcap"));
        let flight = Flight::start(&scratch, &board.port, &recording, &["--mission", &mission]);
        // In flight: the recording has grown beyond its head.
        wait_for("a recording", || fs::metadata(&recording).is_ok_and(|file| file.len() > 10_000));
        flight.process.signal(signal);
        let (code, words) = flight.end();
        assert_eq!(code, Some(4), "{words}");
        assert!(words.contains(word) && words.contains("stopped: asked to stop"), "{words}");
        assert!(words.contains("outputs seen at zero, board disarmed"), "{words}");
        let table = scratch.name("end.csv");
        bench(["export", &recording, "-o", &table, "--channel", "/control/command", "--force"])
            .assert()
            .success();
        let commands = fs::read_to_string(&table).unwrap();
        let throttle = column(&commands, "throttle");
        assert!(throttle.iter().any(|v| *v > 1.0) && throttle.last() == Some(&0.0), "{throttle:?}");
    }
}

/// The numbers of the column whose header holds `name`.
fn column(table: &str, name: &str) -> Vec<f64> {
    let mut rows = csv::Reader::from_reader(table.as_bytes());
    let at = rows.headers().unwrap().iter().position(|header| header.contains(name)).unwrap();
    rows.records().map(|row| row.unwrap()[at].parse().unwrap()).collect()
}

#[test]
fn safety_limits_stop_the_flight_with_their_reason() {
    let scratch = Scratch::new();
    let mission = short_mission(&scratch);
    let board = Emulated::start(&scratch, &[]);
    let cases = [
        ("ceiling_m = 2.0", "ceiling_m = 0.2", "above the ceiling"),
        ("flight_time_max_s = 300.0", "flight_time_max_s = 0.5", "in flight for more than 0.5 s"),
        // No frame is ever as young as that.
        ("tracker_timeout_s = 1.0", "tracker_timeout_s = 0.000001", "no position for"),
    ];
    for (old, new, reason) in cases {
        let rig = rig_with(&scratch, old, new);
        let recording = scratch.name("stopped.mcap");
        let words = stdout(
            &bench([
                "hil",
                "--port",
                &board.port,
                "--rig",
                &rig,
                "--mission",
                &mission,
                "-o",
                &recording,
                "--force",
            ])
            .assert()
            .code(4),
        );
        assert!(words.contains("stopped: ") && words.contains(reason), "{new}: {words}");
        assert!(words.contains("outputs seen at zero"), "{words}");
        // Whole, and says why.
        bench(["info", &recording]).assert().success();
    }
}

#[test]
fn a_board_that_fails_ends_the_flight_and_its_return_is_seen() {
    let scratch = Scratch::new();
    let mission = short_mission(&scratch);
    let cases: [(&[&str], &str, &str); 3] = [
        (&["--unplug", "1.5:0.5"], "is gone", "after opening the port again, outputs seen at zero"),
        (&["--stall", "1.5:1"], "gave no answer for", "outputs seen at zero"),
        (&["--brown-out", "1.5"], "its supply sagged", "the board says: its supply sagged"),
    ];
    for (faults, reason, end) in cases {
        let board = Emulated::start(&scratch, faults);
        let recording = scratch.name("failed.mcap");
        let hil = ["hil", "--port", &board.port, "--mission", &mission, "-o", &recording, "--force"];
        let words = stdout(&bench(hil).assert().code(4));
        assert!(
            words.contains("fault: ") && words.contains(reason) && words.contains(end),
            "{faults:?}: {words}"
        );
        bench(["info", &recording]).assert().success();
    }
}

#[test]
fn a_full_disk_loses_records_and_not_the_flight() {
    let scratch = Scratch::new();
    let mission = short_mission(&scratch);
    let board = Emulated::start(&scratch, &[]);
    let out = scratch.name("full.mcap");
    // A file-size limit of 16 blocks of 512 bytes stands for a full disk.
    let script = "trap '' XFSZ; ulimit -f 16; exec \"$0\" hil --port \"$1\" --mission \"$2\" -o \"$3\"";
    let output = std::process::Command::new("sh")
        .args(["-c", script, env!("CARGO_BIN_EXE_bench"), &board.port, &mission, &out])
        .current_dir(crate::support::root())
        .output()
        .unwrap();
    let (words, talk) =
        (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr).into_owned());
    assert_eq!(output.status.code(), Some(3), "{words}{talk}");
    assert!(words.contains("passed  peak_min_m") && words.contains("outputs seen at zero"), "{words}");
    assert!(talk.contains("not all of it recorded"), "{talk}");
}

#[test]
fn what_cannot_be_flown_is_refused_before_anything_moves() {
    let scratch = Scratch::new();
    let board = Emulated::start(&scratch, &["--protocol-version", "9"]);
    let transmitter = rig_with(&scratch, "bench = \"loopback\"", "bench = \"transmitter\"");
    let out = scratch.name("x.mcap");
    let cases: [(&[&str], i32, &str); 10] = [
        (&[], 2, "--port"),
        (&["--port", "/dev/ttyNONE"], 4, "there is no port /dev/ttyNONE"),
        (&["--port", "/dev/null"], 4, "is it a serial port?"),
        (&["--port", &board.port], 4, "protocol 9"),
        (&["--port", &board.port, "--rig", "rigs/virtual.toml"], 2, "bench sim"),
        (
            &["--port", &board.port, "--rig", &transmitter, "--mission", "rigs/missions/hop.toml"],
            2,
            "no calibration",
        ),
        (
            &[
                "--port",
                &board.port,
                "--rig",
                "rigs/transmitter.toml",
                "--effect",
                "gusts:sigma_m_s=0.1,correlation_time_s=1",
            ],
            2,
            "real airframe",
        ),
        // Nobody has ninety Kinects; some have no USB.
        (&["--port", &board.port, "--rig", "rigs/transmitter.toml", "--kinect", "89"], 4, "USB"),
        (&["--port", &board.port, "--mission", "loop"], 2, "climb-040"),
        (
            &["--port", &board.port, "--effect", "loop-overrun:probability=0.1,mean_lateness_s=0.1"],
            2,
            "loop-overrun",
        ),
    ];
    for (arguments, code, expected) in cases {
        let mut command = bench(["hil", "-o", &out]);
        command.args(arguments);
        let words = refused(command, code);
        assert!(words.contains(expected), "{arguments:?}: {words}");
        assert!(!scratch.path("x.mcap").exists(), "{arguments:?} left a recording");
    }
}

#[test]
fn a_port_in_use_names_who_has_it() {
    let scratch = Scratch::new();
    let mission = short_mission(&scratch);
    let board = Emulated::start(&scratch, &[]);
    let recording = scratch.name("a.mcap");
    let flight = Flight::start(&scratch, &board.port, &recording, &["--mission", &mission]);
    wait_for("a recording", || scratch.path("a.mcap").exists());
    let words = refused(bench(["hil", "--port", &board.port, "-o", &scratch.name("b.mcap")]), 4);
    assert!(words.contains("in use by bench"), "{words}");
    assert_eq!(flight.end().0, Some(0), "the other was not disturbed");
}

#[test]
fn devices_are_listed_whatever_there_is() {
    let listed = json(&bench(["devices", "--json"]).assert().success());
    assert_eq!(listed["schema"], "bench.devices/1");
    assert!(listed["ports"].is_array() && listed["kinects"].is_array());
    let words = stdout(&bench(["devices"]).assert().success());
    assert!(words.contains("serial ports") && words.contains("Kinects"), "{words}");
}

#[test]
fn an_emulated_board_refuses_faults_that_make_no_sense() {
    let cases: [(&[&str], &str); 5] = [
        (&["--drop", "1.5"], "--drop"),
        (&["--latency-ms=-1"], "--latency-ms"),
        (&["--stall", "3"], "AT:FOR"),
        (&["--unplug", "soon"], "--unplug"),
        (&["--unplug", "1:1"], "--link"),
    ];
    for (arguments, expected) in cases {
        let mut command = bench(["emulate", "psoc5"]);
        command.args(arguments);
        let output = command.assert().code(2).get_output().clone();
        let words = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(words.contains(expected), "{arguments:?}: {words}");
    }
    // Somebody's file is not replaced by the link.
    let scratch = Scratch::new();
    fs::write(scratch.path("notes"), "mine").unwrap();
    refused(bench(["emulate", "psoc5", "--link", &scratch.name("notes")]), 2);
    assert_eq!(fs::read_to_string(scratch.path("notes")).unwrap(), "mine");
}

#[test]
fn a_host_that_is_killed_leaves_outputs_that_zero_themselves() {
    let scratch = Scratch::new();
    let mission = short_mission(&scratch);
    let board = Emulated::start(&scratch, &[]);
    let recording = scratch.name("killed.mcap");
    let mut flight = Flight::start(&scratch, &board.port, &recording, &["--mission", &mission]);
    wait_for("a recording", || fs::metadata(&recording).is_ok_and(|file| file.len() > 10_000));
    let Process(child) = &mut flight.process;
    child.kill().unwrap();
    child.wait().unwrap();
    // The next one finds the board tripped or still armed, and both at zero once it is connected.
    let next = scratch.name("next.mcap");
    bench(["hil", "--port", &board.port, "--mission", &mission, "-o", &next]).assert().success();
    // And of the first flight all but the last half second is there; whether that lost anything depends on when it ended.
    crate::support::unclosed(&recording);
    let back = scratch.name("back.mcap");
    bench(["recover", &recording, "-o", &back]).assert().code(vec![0, 3]);
    let info = json(&bench(["info", &back, "--json"]).assert().code(vec![0, 3]));
    assert!(info["messages"].as_u64().unwrap() > 50, "{info}");
}
