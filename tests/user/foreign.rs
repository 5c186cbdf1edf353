//! Files that are not what a command wants: each is told for what it is, with what to do.

use std::fs;

use crate::support::{Scratch, bench, json, refused, root};

/// Beginnings of files of other programs, what they are called, and what the advice names.
const FOREIGN: &[(&str, &[u8], &str, &str)] = &[
    ("log.ulg", b"ULog\x01\x12\x35\x01 and more", "a PX4 log (ULog)", "import"),
    ("log.bin", b"\xa3\x95\x80\x80\x59", "an ArduPilot log", "import"),
    (
        "log.bbl",
        b"H Product:Blackbox flight data recorder by Nicholas Sherlock\n",
        "a Betaflight log",
        "import",
    ),
    ("log00", b"\xbc\x02\x00\x00\x00", "a log of the Crazyflie", "import"),
    ("table.parquet", b"PAR1\x15\x04", "a Parquet table", "--map"),
    ("bag.db3", b"SQLite format 3\0 and more", "a bag of ROS 2", "PlotJuggler"),
    ("bag.bag", b"#ROSBAG V2.0\n", "a bag of ROS 1", "PlotJuggler"),
    ("packed.gz", b"\x1f\x8b\x08\x00", "a compressed file", "unpack"),
    ("empty.mcap", b"", "empty", "CSV"),
    ("noise.mcap", b"\xff\xfe\x00\x01\x02", "none of the kinds of file", "CSV"),
];

#[test]
fn logs_of_other_programs_are_told_for_what_they_are() {
    let scratch = Scratch::new();
    let out = scratch.name("out.mcap");
    for (name, bytes, kind, advice) in FOREIGN {
        fs::write(scratch.path(name), bytes).unwrap();
        let file = scratch.name(name);
        let empty = bytes.is_empty();
        for arguments in [
            vec!["info", &file],
            vec!["diagnose", &file],
            vec!["diff", &file, &file],
            vec!["export", &file, "-o", &scratch.name("out.csv")],
            vec!["recover", &file, "-o", &out],
        ] {
            let words = refused(bench(&arguments), 2);
            assert!(words.contains(kind), "{arguments:?}: {words}");
            assert!(empty || words.contains(advice), "{arguments:?}: {words}");
        }
        // What `import` reads says what is wrong with it instead: tests/user/logs.rs.
        if ["log.ulg", "log.bin", "log.bbl", "log00", "table.parquet"].contains(name) {
            continue;
        }
        for map in [&["--map", "crazypad"][..], &[]] {
            let words = refused(bench(["import", &file, "-o", &out].iter().chain(map)), 2);
            assert!(words.contains(kind) && words.contains(advice), "{name}: {words}");
        }
    }
    let xlsx = scratch.name("flight.xlsx");
    let flight = scratch.fly("flight.mcap", &["--mission", "hop", "--export", &xlsx]);
    for arguments in [vec!["info", &xlsx], vec!["import", &xlsx, "-o", &out]] {
        assert!(refused(bench(arguments), 2).contains("an Excel workbook"));
    }
    // A recording needs no import.
    assert!(refused(bench(["import", &flight, "-o", &out]), 2).contains("needs no import"));
    assert!(!scratch.path("out.mcap").exists());
}

#[test]
fn folders_tables_and_toml_files_are_told_apart() {
    let scratch = Scratch::new();
    scratch.fly("flight.mcap", &["--mission", "hop"]);
    let rig = root().join("rigs/virtual.toml").to_str().unwrap().to_owned();
    let mission = root().join("rigs/missions/hop.toml").to_str().unwrap().to_owned();
    let map = root().join("rigs/import/foreign.toml").to_str().unwrap().to_owned();
    let table = scratch.name("t.csv");
    fs::write(&table, "t,z\n0,1\n").unwrap();
    let folder = scratch.path("flight.mcap").parent().unwrap().to_str().unwrap().to_owned();
    let out = scratch.name("out.mcap");
    let cases: [(&[&str], &[&str]); 9] = [
        (&["info", &folder], &["is a folder", "flight.mcap"]),
        (&["info", &table], &["a table (CSV)", "bench import --map"]),
        (&["info", &rig], &["is a rig", "--rig"]),
        (&["diagnose", &mission], &["is a mission", "bench sim --mission"]),
        (&["sim", "--rig", &mission, "-o", &out], &["is a mission", "a rig is wanted", "--mission"]),
        (&["sim", "--mission", &rig, "-o", &out], &["is a rig", "a mission is wanted", "--rig"]),
        (&["sim", "--rig", &map, "-o", &out], &["is an import map", "a rig is wanted"]),
        (&["import", "--map", &rig, &table, "-o", &out], &["is a rig", "an import map is wanted"]),
        (&["import", &table, "-o", &out], &["--map", "bench rigs"]),
    ];
    for (arguments, expected) in cases {
        let words = refused(bench(arguments), 2);
        assert!(expected.iter().all(|part| words.contains(part)), "{arguments:?}: {words}");
    }
}

#[test]
fn a_table_of_our_own_becomes_the_flight_that_it_was() {
    let scratch = Scratch::new();
    for rig in ["virtual", "crazyflie-2"] {
        let [flight, table, again] =
            ["mcap", "csv", "again.mcap"].map(|ending| scratch.name(&format!("{rig}.{ending}")));
        bench(["sim", "--rig", rig, "-o", &flight, "--export", &table]).assert().success();
        let words = refused(bench(["import", &table, "-o", &again]), 2);
        assert!(words.contains("--rig"), "nobody guesses a rig: {words}");
        let report =
            json(&bench(["import", &table, "--rig", rig, "-o", &again, "--json"]).assert().success());
        assert_eq!(report["used"], report["rows"], "{report:#}");
        // Each frame once, however many rows show it.
        let channels = &report["channels"];
        let (sightings, ticks) = (channels["/tracker/position"].as_u64(), channels["/loop/tick"].as_u64());
        assert!(sightings > Some(80) && sightings < ticks, "{channels:#}");
        let of = |recording: &str| json(&bench(["info", recording, "--json"]).assert().success());
        assert_eq!(of(&again)["rig"], rig);
        let [before, after] = [&flight, &again].map(|recording| {
            json(&bench(["diagnose", recording, "--json"]).assert().success())["leading"].clone()
        });
        assert_eq!(before, after, "{rig}");
    }
}

#[test]
fn a_table_of_another_unit_is_refused() {
    let scratch = Scratch::new();
    let table = scratch.name("c.csv");
    let flight = scratch.name("c.mcap");
    bench(["sim", "--rig", "crazyflie-2", "-o", &flight, "--export", &table]).assert().success();
    let words = refused(bench(["import", &table, "--rig", "virtual", "-o", &scratch.name("x.mcap")]), 2);
    assert!(words.contains("count") && words.contains("virtual"), "{words}");
}
