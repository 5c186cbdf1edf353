//! Recordings and the rig that they are held against: the right one without being told, never another airframe's, and no flight
//! counted twice.

use std::{fmt::Write as _, fs};

use crate::support::{Scratch, bench, json, refused, stdout};

/// Without what this machine may have learnt of a rig.
fn diagnose(scratch: &Scratch, arguments: &[&str]) -> assert_cmd::Command {
    let mut command = bench(["diagnose"]);
    command.env("XDG_CACHE_HOME", scratch.path("cache")).args(arguments);
    command
}

#[test]
fn flights_are_held_against_the_rig_that_they_carry() {
    let scratch = Scratch::new();
    let flight = scratch.fly("cf.mcap", &["--rig", "crazyflie-2", "--mission", "steps"]);
    let report = json(&diagnose(&scratch, &[&flight, "--json"]).assert().success());
    // The right rig predicts to centimetres; another airframe's was off by thousands of kilometres.
    let error_m = report["gap"]["k_step_m"]["nominal"][1]["value"].as_f64();
    let error_m = error_m.unwrap_or_else(|| panic!("{}", report["gap"]));
    assert!(error_m < 0.1, "{error_m}");

    for command in [
        diagnose(&scratch, &[&flight, "--rig", "virtual"]),
        bench(["verify", &flight, "--rig", "virtual"]),
        bench(["identify", "flight", &flight, "--rig", "virtual", "-o", &scratch.name("never.toml")]),
    ] {
        let words = refused(command, 2);
        assert!(
            words.contains("counts") && words.contains("volts") && words.contains("leave --rig out"),
            "{words}"
        );
    }
    assert!(!scratch.path("never.toml").exists());
}

#[test]
fn an_added_effect_is_no_part_of_the_rig_that_a_recording_carries() {
    let scratch = Scratch::new();
    let lag = ["--effect", "rotor-lag:time_constant_s=0.12", "--model", "vertical"];
    let flights = ["hop", "climb-040", "low-hover"].map(|mission| {
        scratch.fly(&format!("{mission}.mcap"), &[&["--mission", mission], &lag[..]].concat())
    });
    let named: Vec<&str> = flights.iter().map(String::as_str).collect();
    let words = stdout(&diagnose(&scratch, &named).assert().success());
    assert!(words.starts_with("The gap comes from rotor-lag"), "{words}");
    let words = stdout(&bench(["info", &flights[0]]).assert().success());
    assert!(words.contains("added_effects rotor-lag:time_constant_s=0.12"), "{words}");

    // A rig's own effect is part of the model: once it is written into the rig, nothing is left.
    let better = scratch.name("better.toml");
    diagnose(&scratch, &[&named[..], &["--write-rig", &better]].concat()).assert().success();
    let with_lag = scratch.fly("own.mcap", &["--rig", &better, "--mission", "climb-040", "--seed", "5"]);
    let words = stdout(&diagnose(&scratch, &[&with_lag, "--min-confidence", "0"]).assert().success());
    assert!(words.starts_with("No gap"), "{words}");
}

#[test]
fn another_loop_or_output_is_said_in_one_line_each() {
    let scratch = Scratch::new();
    let flight = scratch.fly("loopback.mcap", &["--rig", "loopback", "--mission", "hop"]);
    let report = json(&diagnose(&scratch, &[&flight, "--rig", "virtual", "--json"]).assert().success());
    let warnings = report["warnings"].to_string();
    assert!(
        warnings.contains("output.bits is 8") && warnings.contains("output.own_step is absent"),
        "{warnings}"
    );
    // Nothing to say of the rig that it carries.
    let report = json(&diagnose(&scratch, &[&flight, "--rig", "loopback", "--json"]).assert().success());
    assert!(!report["warnings"].to_string().contains("attached"), "{}", report["warnings"]);
}

#[test]
fn flights_of_two_rigs_or_of_none_are_refused() {
    let scratch = Scratch::new();
    let first = scratch.fly("virtual.mcap", &["--mission", "hop"]);
    let second = scratch.fly("loopback.mcap", &["--rig", "loopback", "--mission", "hop"]);
    let words = refused(diagnose(&scratch, &[&first, &second]), 2);
    assert!(
        words.contains("different rigs, virtual and loopback") && words.contains("output.bits"),
        "{words}"
    );

    let mut log = String::from("t,z,throttle\n");
    for row in 0..200 {
        writeln!(log, "{},0.1,1.9", 0.1 * f64::from(row)).unwrap();
    }
    fs::write(scratch.path("log.csv"), log).unwrap();
    fs::write(
        scratch.path("map.toml"),
        "name = \"bare\"\nactuation = \"volt\"\n[time]\ncolumn = \"t\"\nunit = \"s\"\n[control]\nphase = \"hold\"\n\
         [position]\nlatency_s = 0.0\nz = { column = \"z\", unit = \"m\" }\n[command]\nthrottle = { column = \"throttle\", unit = \"V\" }\n",
    )
    .unwrap();
    let bare = scratch.name("bare.mcap");
    let imported =
        bench(["import", "--map", &scratch.name("map.toml"), &scratch.name("log.csv"), "-o", &bare])
            .output()
            .unwrap();
    assert!(imported.status.success(), "{imported:?}");
    let words = refused(diagnose(&scratch, &[&bare]), 2);
    assert!(words.contains("no rig is attached") && words.contains("--rig"), "{words}");
}

#[test]
fn a_flight_that_is_given_twice_is_counted_once_whatever_its_name() {
    let scratch = Scratch::new();
    let flight = scratch.fly("hop.mcap", &["--mission", "hop"]);
    let (copy, whole) = (scratch.name("copy.mcap"), scratch.name("whole.mcap"));
    fs::copy(&flight, &copy).unwrap();
    // Another container: what recovery writes has other chunks and other metadata.
    bench(["recover", &flight, "-o", &whole]).assert().success();
    assert!(fs::read(&flight).unwrap() != fs::read(&whole).unwrap());
    let once = json(&diagnose(&scratch, &[&flight, "--json"]).assert().success());
    let thrice = json(&diagnose(&scratch, &[&flight, &copy, &whole, "--json"]).assert().success());
    assert_eq!(once["candidates"], thrice["candidates"]);
    assert_eq!(thrice["warnings"].to_string().matches("counted once").count(), 2, "{}", thrice["warnings"]);
}

/// A rig of the same airframe by name and unit, with one line of its airframe another.
fn rig_with(scratch: &Scratch, name: &str, airframe: &str, line: &str, other: &str) -> String {
    let root = crate::support::root();
    let text = fs::read_to_string(root.join(format!("rigs/airframes/{airframe}.toml"))).unwrap();
    assert!(text.contains(line), "{line}");
    fs::write(scratch.path("airframe.toml"), text.replace(line, other)).unwrap();
    let rig = fs::read_to_string(root.join(format!("rigs/{name}.toml"))).unwrap();
    let of = rig.lines().find(|line| line.starts_with("airframe = ")).unwrap();
    let file = scratch.name("other.toml");
    fs::write(&file, rig.replace(of, "airframe = \"airframe.toml\"")).unwrap();
    file
}

#[test]
fn a_rig_that_cannot_be_a_model_of_the_flights_is_refused_and_its_numbers_are_named() {
    let scratch = Scratch::new();
    let flight = scratch.fly("steps.mcap", &["--mission", "steps", "--model", "vertical"]);
    let cases = [
        ("gain_n_per_v = { value = 0.1051,", "gain_n_per_v = { value = 0.2,", "thrust_gain would have to be"),
        ("offset_v = { value = 0.5,", "offset_v = { value = 1.2,", "thrust_offset would have to be"),
    ];
    for (line, other, named) in cases {
        let rig = rig_with(&scratch, "virtual", "hubsan-q4", line, other);
        let words = refused(diagnose(&scratch, &[&flight, "--rig", &rig, "--json"]), 2);
        assert!(
            words.contains("cannot be a model of these flights")
                && words.contains("tolerances)")
                && words.contains(named)
                && !words.contains("NaN"),
            "{named}: {words}"
        );
    }
}

#[test]
fn a_large_effect_of_the_library_is_diagnosed_and_not_refused() {
    let scratch = Scratch::new();
    // Three sigma of its prior: it lands before the mission ends.
    let flight = scratch.name("lost.mcap");
    bench(["sim", "-o", &flight, "--mission", "climb-040", "--model", "vertical"])
        .args(["--effect", "thrust-loss:fraction=0.18"])
        .assert()
        .code(vec![0, 1, 4]);
    let report = json(&diagnose(&scratch, &[&flight, "--json"]).assert().success());
    assert_eq!(report["ahead"]["beyond"], false, "{}", report["ahead"]);
    assert_ne!(report["leading"], "none", "{}", report["candidates"]);
}

#[test]
fn altitudes_in_another_unit_are_refused() {
    let scratch = Scratch::new();
    let mut log = String::from("t,z,throttle\n");
    for row in 0..200 {
        let t = 0.1 * f64::from(row);
        writeln!(log, "{t},{},{}", 400.0 + 50.0 * t.sin(), if row < 10 { 0.0 } else { 1.9 }).unwrap();
    }
    fs::write(scratch.path("mm.csv"), log).unwrap();
    fs::write(
        scratch.path("map.toml"),
        "name = \"wrong\"\nactuation = \"volt\"\n[time]\ncolumn = \"t\"\nunit = \"s\"\n[control]\nphase = \"hold\"\n\
         [position]\nlatency_s = 0.0\nz = { column = \"z\", unit = \"m\" }\n[command]\nthrottle = { column = \"throttle\", unit = \"V\" }\n",
    )
    .unwrap();
    let out = scratch.name("mm.mcap");
    bench(["import", "--map", &scratch.name("map.toml"), &scratch.name("mm.csv"), "-o", &out])
        .assert()
        .success();
    let words = refused(diagnose(&scratch, &[&out, "--rig", "virtual"]), 2);
    assert!(words.contains("millimetres taken for metres") && words.contains("nothing diagnosed"), "{words}");
}

#[test]
fn flights_of_two_conditions_are_inconclusive_and_the_groups_are_told() {
    let scratch = Scratch::new();
    let fly = |name: &str, effect: &[&str], seed: &str| {
        let arguments = [&["--mission", "climb-040", "--model", "vertical", "--seed", seed], effect].concat();
        scratch.fly(name, &arguments)
    };
    let lag = |size: &'static str| ["--effect", size];
    let short: Vec<String> = ["1", "2", "3"]
        .map(|seed| fly(&format!("short-{seed}.mcap"), &lag("rotor-lag:time_constant_s=0.05"), seed))
        .into();
    let long: Vec<String> = ["4", "5", "6"]
        .map(|seed| fly(&format!("long-{seed}.mcap"), &lag("rotor-lag:time_constant_s=0.25"), seed))
        .into();
    let all: Vec<&str> = short.iter().chain(&long).map(String::as_str).collect();
    let report = json(&diagnose(&scratch, &[&all[..], &["--json"]].concat()).assert().success());
    assert_eq!(report["verdict"], "inconclusive", "{}", report["disagreement"]);
    assert_eq!(report["inconclusive_because"][0], "flights-disagree");
    assert_eq!(report["effects"].as_array().map(Vec::len), Some(0));
    let groups = &report["disagreement"]["groups"];
    assert_eq!(groups[0]["flights"].as_array().map(Vec::len), Some(3), "{groups}");
    assert!(report["warnings"][0].as_str().is_some_and(|text| text.contains("flights 1 to 3")), "{report:#}");
}
