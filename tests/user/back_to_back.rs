//! Cases whose flights are held against one another, and what the diagnosis says where they differ.

use std::fs;

use serde_json::Value;

use crate::{
    hil::{Emulated, short_mission},
    support::{Page, Scratch, bench, json},
};

fn write(scratch: &Scratch, name: &str, text: &str) -> String {
    fs::write(scratch.path(name), text).unwrap();
    scratch.name(name)
}

#[test]
fn what_differs_back_to_back_is_named_by_the_diagnosis() {
    let scratch = Scratch::new();
    let suite = write(
        &scratch,
        "pairs.toml",
        r#"
name = "pairs"
description = "With and without what the nominal model lacks."

[[case]]
name = "lag"
rig = "virtual"
mission = ["low-hover", "steps", "hop"]
effects = ["none", "rotor-lag:time_constant_s=0.15"]
mission_criteria = "ignore"
compare = "back-to-back"

[[case]]
name = "thrust"
rig = "virtual"
mission = ["low-hover", "steps", "climb-040"]
effects = ["none", "thrust-loss:fraction=0.01"]
seeds = [0, 1, 2]
mission_criteria = "ignore"
compare = "back-to-back"
"#,
    );
    let assert = bench(["test", &suite, "-o", &scratch.name("results"), "--json"]).assert().code(1);
    let report = json(&assert);
    for test in report["tests"].as_array().unwrap() {
        let expected = if test["id"].as_str().unwrap().contains("/none") { "passed" } else { "failed" };
        assert_eq!(test["outcome"], expected, "{}", test["id"]);
    }
    let [lag, thrust] = report["diagnoses"].as_array().unwrap().as_slice() else { panic!("{report}") };
    assert_eq!((lag["tests"].as_array().unwrap().len(), &lag["verdict"]), (3, &"rotor-lag".into()), "{lag}");
    // One hundredth of thrust is named, with what in these flights looks the same: a mass that much larger. Which of the two leads is
    // chance; together they are the answer.
    assert_eq!(thrust["tests"].as_array().unwrap().len(), 9);
    let mut named = vec![thrust["verdict"].as_str().unwrap()];
    named.extend(thrust["alternatives"].as_array().unwrap().iter().filter_map(Value::as_str));
    assert!(["thrust-loss", "mass-change"].iter().all(|cause| named.contains(cause)), "{thrust}");
    // The probability is that of the group: of all its members together, and more than that of any other answer.
    let leading: Vec<(&str, f64)> = thrust["leading"]
        .as_array()
        .unwrap()
        .iter()
        .map(|pair| (pair[0].as_str().unwrap(), pair[1].as_f64().unwrap()))
        .collect();
    let in_group = |name: &str| named.contains(&name);
    let group: f64 =
        leading.iter().filter(|(name, _)| in_group(name)).map(|(_, probability)| probability).sum();
    assert!(
        ["thrust-loss", "mass-change"].iter().all(|cause| leading.iter().any(|(name, _)| name == cause)),
        "{thrust}"
    );
    let probability = thrust["probability"].as_f64().unwrap();
    assert!((probability - group).abs() < 1e-9 && probability > 0.5, "{thrust}");
    assert!(leading.iter().all(|(name, rival)| in_group(name) || 3.0 * rival < probability), "{thrust}");
    let words = thrust["words"].as_str().unwrap();
    let (answer, others) = words.split_once(" sure").unwrap();
    for cause in ["thrust-loss", "mass-change"] {
        assert!(answer.contains(cause) && !others.contains(cause), "{words}");
    }
    let page = Page::read(&scratch.name("results/report.html"));
    assert!(page.section("Diagnosis of what differs").contains("rotor-lag"));
}

/// How far the throttle output of a board is off, mV: three of its steps.
const OFF_MV: i32 = 48;

#[test]
fn a_board_whose_output_is_off_fails_and_is_diagnosed() {
    let scratch = Scratch::new();
    short_mission(&scratch);
    let suite = write(
        &scratch,
        "off.toml",
        r#"
name = "off"
description = "The simulator and a board, two flights."

[[case]]
name = "short"
rig = "loopback"
mission = "short.toml"
mode = ["sim", "loopback"]
seeds = [0, 1]
compare = "back-to-back"
mission_criteria = "ignore"
"#,
    );
    let board = Emulated::start(&scratch, &["--dac-offset-mv", &OFF_MV.to_string()]);
    let results = scratch.name("results");
    let assert = bench(["test", &suite, "--port", &board.port, "-o", &results, "--json"]).assert().code(1);
    let report = json(&assert);
    for test in report["tests"].as_array().unwrap() {
        let expected = if test["mode"] == "sim" { "passed" } else { "failed" };
        assert_eq!(test["outcome"], expected, "{test}");
    }
    // The airframe needs the same voltage at the pin, so the controller asks for that much less.
    let mut tests = report["tests"].as_array().unwrap().iter();
    let through_board = tests.find(|test| test["mode"] == "loopback").unwrap();
    let differs = through_board["runs"][0]["comparisons"][0]["differences"].as_array().unwrap();
    let throttle = differs.iter().find(|field| field["field"] == "/control/command/sticks.throttle");
    let mean_v = throttle.and_then(|field| field["mean"].as_f64()).unwrap();
    assert!((-1e3 * mean_v - f64::from(OFF_MV)).abs() < 0.5 * f64::from(OFF_MV), "{mean_v} V: {differs:?}");
    // Both flights through the board are diagnosed together, and the page tells what that says.
    let [diagnosed] = report["diagnoses"].as_array().unwrap().as_slice() else { panic!("{report}") };
    assert_eq!(diagnosed["tests"], serde_json::json!(["short/loopback/seed0", "short/loopback/seed1"]));
    assert!(diagnosed["verdict"].is_string() && diagnosed["verdict"] != "none", "{diagnosed}");
    let page = Page::read(&scratch.name("results/report.html"));
    assert!(
        page.section("Diagnosis of what differs").contains(diagnosed["words"].as_str().unwrap()),
        "{diagnosed}"
    );
}
