use std::{fmt::Write as _, fs};

use crate::support::{Scratch, bench, json, refused};

/// A log of the shape of `rigs/import/foreign.toml`, with two bad rows.
fn log(scratch: &Scratch) -> String {
    let mut text = String::from("time_s,phase,throttle_cmd_v,throttle_readback_v,z_m\n");
    for k in 0..100 {
        let t = f64::from(k) * 0.1;
        let phase = if k < 10 { "idle" } else { "open" };
        writeln!(text, "{t:.4},{phase},1.9,1.9,{:.3}", 0.01 * f64::from(k)).unwrap();
    }
    text += "10.0,open,nan,1.9,0.5\n9.0,open,1.9,1.9,0.5\n";
    fs::write(scratch.path("log.csv"), text).unwrap();
    scratch.name("log.csv")
}

#[test]
fn a_log_becomes_a_recording_like_any_other() {
    let scratch = Scratch::new();
    let (log, out) = (log(&scratch), scratch.name("log.mcap"));
    let report = json(
        &bench(["import", "--map", "rigs/import/foreign.toml", &log, "-o", &out, "--json"])
            .assert()
            .success(),
    );
    assert_eq!(
        (&report["schema"], &report["rows"], &report["used"]),
        (&"bench.import/1".into(), &102.into(), &100.into())
    );
    assert_eq!(json(&bench(["info", &out, "--json"]).assert().success())["mode"], "import");
    bench(["diff", &out, &out]).assert().success();
    bench(["export", &out, "-o", &scratch.name("log.csv2.csv")]).assert().success();
    // An import is not replaced unasked.
    refused(bench(["import", "--map", "rigs/import/foreign.toml", &log, "-o", &out]), 2);
}

#[test]
fn a_log_that_does_not_fit_its_map_is_refused_and_leaves_nothing() {
    let scratch = Scratch::new();
    let out = scratch.name("x.mcap");
    fs::write(scratch.path("empty.csv"), "").unwrap();
    fs::write(scratch.path("other.csv"), "a,b\n1,2\n").unwrap();
    for name in ["empty.csv", "other.csv", "absent.csv"] {
        let words = refused(
            bench(["import", "--map", "rigs/import/foreign.toml", &scratch.name(name), "-o", &out]),
            2,
        );
        assert!(words.contains(name), "{words}");
        assert!(!scratch.path("x.mcap").exists());
    }
}

/// What a flight's altitudes and throttles come to in a report.
fn ranges(report: &serde_json::Value, name: &str) -> (f64, f64, String) {
    let found = report["quantities"].as_array().unwrap().iter().find(|quantity| quantity["name"] == name);
    let found = found.unwrap_or_else(|| panic!("{name}: {report}"));
    (
        found["min"].as_f64().unwrap(),
        found["max"].as_f64().unwrap(),
        found["unit"].as_str().unwrap().to_owned(),
    )
}

#[test]
fn a_map_guessed_of_our_own_table_reads_it_as_our_own_map_does() {
    let scratch = Scratch::new();
    let flown = scratch.fly("flown.mcap", &["--mission", "hop"]);
    let (table, map) = (scratch.name("flown.csv"), scratch.name("guessed.toml"));
    bench(["export", &flown, "-o", &table]).assert().success();
    bench(["import", "--guess", &table, "-o", &map]).assert().success();
    bench(["check", &map]).assert().success();
    let report = |more: &[&str], out: &str| {
        let out = scratch.name(out);
        let fixed = ["import", &table, "--rig", "virtual", "-o", &out, "--json"];
        json(&bench(fixed.iter().chain(more)).assert().success())
    };
    let (own, guessed) = (report(&[], "own.mcap"), report(&["--map", &map], "guessed.mcap"));
    assert_eq!((&guessed["used"], &guessed["skipped"]), (&own["used"], &serde_json::json!([])));
    for name in [
        "position.x",
        "position.y",
        "position.z",
        "control.setpoint_z",
        "command.throttle",
        "command.pitch",
        "readback.throttle",
    ] {
        assert_eq!(ranges(&guessed, name), ranges(&own, name));
    }
    // The same positions of the same exposures.
    let exposures = |name: &str| -> Vec<u64> {
        let flight = bench_recording::Flight::load(scratch.path(name)).unwrap();
        flight.positions.iter().map(|position| position.exposed_at.nanos()).collect()
    };
    assert_eq!(exposures("guessed.mcap"), exposures("own.mcap"));
}

#[test]
fn a_map_guessed_of_a_strangers_table_has_its_units() {
    let scratch = Scratch::new();
    let mut text =
        String::from("t_ms;mode;pos x [mm];alt_cm;vel_z (m/s);yaw;thrust_pct;target_alt_cm;vbat_mv;note\n");
    for k in 0..200 {
        let mode = ["STANDBY", "takeoff", "PosHold", "landing"][k / 50];
        let throttle = if k < 50 { 0.0 } else { 55.5 };
        writeln!(text, "{};{mode};{};{};0.5;{};{throttle};120;{};ok", 20 * k, 10 * k, k, k, 4200 - k)
            .unwrap();
    }
    let table = scratch.name("stranger.csv");
    fs::write(&table, &text).unwrap();
    let printed = bench(["import", "--guess", &table]).assert().success();
    let map = String::from_utf8(printed.get_output().stdout.clone()).unwrap();
    // Every line that names a column says that it is a guess.
    assert!(
        map.lines().filter(|line| line.contains("column")).all(|line| line.contains("# guess: ")),
        "{map}"
    );
    assert!(map.contains("# Not used: note"), "{map}");
    let words = stderr(&printed);
    assert!(words.contains("How old a position is"), "{words}");
    fs::write(scratch.path("map.toml"), &map).unwrap();
    let out = scratch.name("stranger.mcap");
    let fixed = ["import", "--map", &scratch.name("map.toml"), &table, "-o", &out, "--json"];
    let report = json(&bench(fixed).assert().success());
    assert_eq!((&report["used"], &report["skipped"]), (&200.into(), &serde_json::json!([])));
    for (name, min, max, unit) in [
        ("position.x", 0.0, 1.99, "m"),
        ("position.z", 0.0, 1.99, "m"),
        ("motion.velocity_z", 0.5, 0.5, "m/s"),
        // Up to 199 is no angle in radians.
        ("motion.yaw", 0.0, 199.0_f64.to_radians(), "rad"),
        ("control.setpoint_z", 1.2, 1.2, "m"),
        ("command.throttle", 0.0, 0.555, "1"),
        ("battery.voltage", 4.001, 4.2, "V"),
    ] {
        let (low, high, found) = ranges(&report, name);
        assert!(
            (low - min).abs() < 1e-9 && (high - max).abs() < 1e-9 && found == unit,
            "{name}: {low} to {high} {found}"
        );
    }
    assert!((report["duration_s"].as_f64().unwrap() - 3.98).abs() < 1e-9, "{report}");
    let flight = bench_recording::Flight::load(&out).unwrap();
    let phases: Vec<&str> = flight.phases().iter().map(|phase| phase.phase.name()).collect();
    assert_eq!(phases, ["idle", "launch", "hold", "land"]);
}

#[test]
fn a_log_of_the_crazyflie_client_needs_no_map() {
    let scratch = Scratch::new();
    let mut text = String::from(
        "Timestamp,stateEstimate.x,stateEstimate.y,stateEstimate.z,stabilizer.thrust,stateEstimate.yaw,pm.vbat\n",
    );
    for k in 0..100 {
        writeln!(text, "{},0.1,0.2,{:.3},{},-90.5,3.9", 123_456 + 10 * k, 0.01 * f64::from(k), 300 * k)
            .unwrap();
    }
    let (table, map, out) = (scratch.name("log.csv"), scratch.name("map.toml"), scratch.name("log.mcap"));
    fs::write(&table, &text).unwrap();
    let words = refused(bench(["import", "--guess", &table, "-o", &map]), 2);
    assert!(words.contains("--guess") && words.contains("has maps for it"), "{words}");
    let report = json(&bench(["import", &table, "-o", &out, "--json"]).assert().success());
    let near = |name: &str, low: f64, high: f64| {
        let (min, max, _) = ranges(&report, name);
        assert!((min - low).abs() < 1e-9 && (max - high).abs() < 1e-9, "{name}: {report}");
    };
    near("position.x", 0.1, 0.1);
    near("position.z", 0.0, 0.99);
    near("command.throttle", 0.0, 29_700.0);
    near("motion.yaw", -90.5_f64.to_radians(), -90.5_f64.to_radians());
    assert!((report["duration_s"].as_f64().unwrap() - 0.99).abs() < 1e-9, "{report}");
}

#[test]
fn a_map_guessed_of_a_table_with_dates_and_times_reads_it() {
    let scratch = Scratch::new();
    let mut text = String::from("datetime,z,z_ref,z_hat,tau\n");
    for k in 0..100 {
        let [z, z_ref] = if k < 20 { ["nan", "nan"] } else { ["0.5", "0.6"] };
        writeln!(
            text,
            "2024-04-15 14:43:{:02}.{:06},{z},{z_ref},0.5,{}",
            k / 10,
            k % 10 * 100_000,
            f64::from(k) / 200.0
        )
        .unwrap();
    }
    let (table, map, out) = (scratch.name("log.csv"), scratch.name("map.toml"), scratch.name("log.mcap"));
    fs::write(&table, &text).unwrap();
    bench(["import", "--guess", &table, "-o", &map]).assert().success();
    let report = json(&bench(["import", "--map", &map, &table, "-o", &out, "--json"]).assert().success());
    assert_eq!((&report["used"], &report["skipped"]), (&100.into(), &serde_json::json!([])), "{report}");
    assert!((report["duration_s"].as_f64().unwrap() - 9.9).abs() < 1e-9, "{report}");
    let flight = bench_recording::Flight::load(&out).unwrap();
    assert_eq!((flight.positions.len(), flight.commands.len()), (80, 100));
    // The phase is told where there is no set-point, too.
    assert_eq!(flight.states[0].phase.name(), "idle");
    assert_eq!(ranges(&report, "control.setpoint_z"), (0.6, 0.6, "m".to_owned()));
}

#[test]
fn a_parquet_table_without_an_optional_column_is_read_by_the_same_map() {
    let scratch = Scratch::new();
    let flown = scratch.fly("flown.mcap", &["--mission", "hop"]);
    let (table, map, out) =
        (scratch.name("flown.parquet"), scratch.name("map.toml"), scratch.name("log.mcap"));
    bench(["export", &flown, "-o", &table]).assert().success();
    let text = "name = \"mine\"
        [time]
        column = \"time_s\"
        unit = \"s\"
        [position]
        latency_s = 0.0
        x = { column = \"across\", unit = \"m\", optional = true }
        z = { column = \"position_z_m\", unit = \"m\" }
        empty = \"absent\"
        [battery]
        voltage = { column = \"battery\", unit = \"V\", optional = true }
        [control]
        phase = \"hold\"
        setpoint_z = { column = \"setpoint_z_m\", unit = \"m\" }";
    fs::write(&map, text).unwrap();
    let words = bench(["import", "--map", &map, &table, "-o", &out, "--explain"]).assert().success();
    let words = String::from_utf8(words.get_output().stdout.clone()).unwrap();
    assert!(words.contains("not in the log, and optional: across, battery"), "{words}");
    assert!(
        words.contains("named by the map, not in the log:\n  across\n  battery\n")
            && words.contains("in the log, not used:\n  phase\n"),
        "{words}"
    );
    let flight = bench_recording::Flight::load(&out).unwrap();
    assert!(flight.positions.len() > 20 && flight.battery.is_empty());
    let report =
        json(&bench(["import", "--map", &map, &table, "-o", &out, "--force", "--json"]).assert().success());
    assert_eq!(report["columns"]["missing"], serde_json::json!(["across", "battery"]));
}

#[test]
fn what_cannot_be_guessed_is_said() {
    let scratch = Scratch::new();
    let guess = |text: &str| {
        fs::write(scratch.path("log.csv"), text).unwrap();
        bench(["import", "--guess", &scratch.name("log.csv")])
    };
    // Altitudes that count downwards, in whatever unit they may be, and no throttle.
    let rows: String =
        (0..50).fold(String::from("time,z,who\n"), |text, k| text + &format!("{}.5,{},x\n", k, -10 * k));
    let printed = guess(&rows).assert().success();
    let (map, words) = (String::from_utf8(printed.get_output().stdout.clone()).unwrap(), stderr(&printed));
    assert!(
        map.contains("scale = -1") && map.contains("unit = \"cm\"") && !map.contains("[command]"),
        "{map}"
    );
    assert!(
        words.contains("The throttle: no column is one") && words.contains("cm is by its range, -490 to 0"),
        "{words}"
    );
    for (text, says) in [
        ("a,b\n1,2\n3,4\n", "no column is an altitude"),
        ("t,b\n1,2\n2,4\n", "no column is an altitude"),
        ("time,z\n19:25:47,1\n19:25:48,2\n", "no dates and times by ISO 8601"),
        ("t,z\n5,1\n4,2\n3,1\n", "rises from row to row"),
        ("0.0,1\n0.1,2\n", "header = false"),
        ("", "is empty"),
        ("{\"a\": 1}", "a JSON text"),
    ] {
        let words = refused(guess(text), 2);
        assert!(words.contains(says), "{text}: {words}");
    }
    // A log of PX4 needs no guess.
    fs::write(scratch.path("log.ulg"), crate::logs::short(true)).unwrap();
    let words = refused(bench(["import", "--guess", &scratch.name("log.ulg")]), 2);
    assert!(words.contains("a PX4 log (ULog)"), "{words}");
    refused_by_the_command_line(&["import", "log.csv"]);
    refused_by_the_command_line(&["import", "--guess", "--map", "crazypad", "log.csv"]);
}

fn stderr(assert: &assert_cmd::assert::Assert) -> String {
    String::from_utf8(assert.get_output().stderr.clone()).unwrap()
}

fn refused_by_the_command_line(arguments: &[&str]) {
    bench(arguments).assert().code(2);
}
