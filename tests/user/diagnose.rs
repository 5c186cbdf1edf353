use std::{
    fmt::Write as _,
    fs,
    path::{Path, PathBuf},
};

use crate::support::{Page, Scratch, bench, json, refused, stdout};

const VERTICAL: [&str; 2] = ["--model", "vertical"];

/// Flights of three missions, with an effect or without.
fn flown(scratch: &Scratch, effect: Option<&str>) -> Vec<String> {
    ["hop", "climb-040", "low-hover"]
        .iter()
        .map(|mission| {
            let out = scratch.name(&format!("{mission}.mcap"));
            bench(["sim", "-o", &out, "--force", "--mission", mission])
                .args(VERTICAL)
                .args(effect.iter().flat_map(|effect| ["--effect", effect]))
                .assert()
                .code(vec![0, 1, 4]);
            out
        })
        .collect()
}

/// Flights of `rigs/foreign.toml`'s nominal model, on which an acceleration swings that no effect has: 1.2 m/s^2 at
/// 0.7 Hz, in a phase of its own each flight.
fn swung(scratch: &Scratch) -> Vec<String> {
    (1..=3)
        .map(|flight| {
            let log = scratch.name(&format!("swing-{flight}.csv"));
            fs::write(&log, swing(f64::from(flight))).unwrap();
            let out = scratch.name(&format!("swing-{flight}.mcap"));
            bench(["import", "--map", "rigs/import/foreign.toml", &log, "-o", &out]).assert().success();
            out
        })
        .collect()
}

fn swing(flight: f64) -> String {
    let (mass, gain, offset, drag) = (0.015, 0.1051, 0.5, 0.012);
    let (frame_s, latency_s, step_s) = (0.033, 0.3, 0.001);
    let (mut z, mut v, mut throttle) = (0.0_f64, 0.0_f64, 0.0);
    let mut altitudes: Vec<f64> = Vec::new();
    let mut log = String::from("time_s,phase,throttle_cmd_v,throttle_readback_v,z_m\n");
    for k in 0..15_000 {
        let t = f64::from(k) * step_s;
        if k % 100 == 0 {
            let exposed = ((t - latency_s) / frame_s).floor() * frame_s;
            let seen = if exposed < 0.0 { 0.0 } else { altitudes[(exposed / step_s) as usize] };
            let idle = t < 1.0;
            let wanted = offset + mass * (9.81 + 3.0 * (0.5 - z) - 3.0 * v) / gain;
            // As the output rounds it.
            throttle = if idle { 0.0 } else { (wanted.clamp(0.0, 3.3) / 3.3 * 255.0).round() / 255.0 * 3.3 };
            let phase = if idle { "idle" } else { "closed" };
            writeln!(log, "{t:.4},{phase},{throttle:.4},{throttle:.4},{:.3}", (seen / 0.005).round() * 0.005)
                .unwrap();
        }
        altitudes.push(z);
        let near = 1.0 + 0.3 * (1.0 - z / 0.05).max(0.0);
        let pull = if t < 1.0 { 0.0 } else { 1.2 * (4.4 * t + 2.0 * flight).sin() };
        let a = gain * (throttle - offset).max(0.0) * near / mass - drag * v / mass - 9.81 + pull;
        v += a * step_s;
        z += v * step_s;
        if z < 0.0 {
            (z, v) = (0.0, 0.0);
        }
    }
    log
}

/// Writes the page beside the words and checks what every page must be.
fn page_of(scratch: &Scratch, flights: &[String], rig: &str) -> (String, Page) {
    let file = scratch.name("page.html");
    let words = stdout(
        &bench(["diagnose", "--rig", rig, "--html", &file, "--force"]).args(flights).assert().success(),
    );
    let page = Page::read(&file);
    for part in
        ["How far the gap shrinks", "Where it lies", "Which effect", "Flight by flight", "Make it again"]
    {
        assert!(!page.section(part).is_empty(), "{part}");
    }
    assert!(page.section("Make it again").contains("bench diagnose --rig"));
    // One plot of each flight's altitude, with its axes.
    assert_eq!(page.panels().iter().filter(|title| *title == "altitude, m").count(), flights.len());
    assert!(words.lines().count() <= 35, "{words}");
    (words, page)
}

#[test]
fn a_page_shows_the_verdict_and_needs_nothing_else() {
    let scratch = Scratch::new();
    let rig = "rigs/virtual.toml";
    let (_, page) = page_of(&scratch, &flown(&scratch, Some("rotor-lag:time_constant_s=0.12")), rig);
    assert!(page.headline().contains("The gap comes from rotor-lag"), "{}", page.headline());
    assert!(page.section("Which effect").contains("time constant of rotor speed"));

    let (words, page) = page_of(&scratch, &flown(&scratch, None), rig);
    assert!(words.starts_with("No gap beyond tolerance and noise: "), "{words}");
    assert!(page.headline().contains("No gap beyond tolerance and noise: "), "{}", page.headline());

    let swung = swung(&scratch);
    let report =
        json(&bench(["diagnose", "--rig", "rigs/foreign.toml", "--json"]).args(&swung).assert().success());
    assert_eq!(report["verdict"], "unknown");
    let (words, page) = page_of(&scratch, &swung, "rigs/foreign.toml");
    assert!(words.starts_with("There is a gap that no known effect explains: "), "{words}");
    assert!(
        page.headline().contains("There is a gap that no known effect explains: "),
        "{}",
        page.headline()
    );
    let place = page.section("Where it lies");
    let (_, told) = place.split_once("Something swings at ").expect("a frequency is told");
    let hz: f64 = told.split_once(" Hz").unwrap().0.parse().unwrap();
    // Tones that are tried in flights of 14 s are half of 1/14 Hz from one another: the nearest is within half of that.
    assert!((hz - 4.4 / std::f64::consts::TAU).abs() < 0.25 / 14.0, "{hz}");
}

#[test]
fn a_page_that_cannot_be_written_is_said_before_the_work() {
    let scratch = Scratch::new();
    let flight = scratch.fly("hop.mcap", &["--mission", "hop", "--model", "vertical"]);
    let command = bench(["diagnose", &flight, "--html", "/proc/page.html"]);
    assert!(refused(command, 2).contains("cannot write /proc/page.html"));
}

#[test]
fn flights_with_a_planted_effect_are_diagnosed_in_words_and_json() {
    let scratch = Scratch::new();
    let flights = flown(&scratch, Some("tracker-latency:extra_s=0.12"));
    let words = stdout(&bench(["diagnose"]).args(&flights).assert().success());
    assert!(words.starts_with("The gap comes from tracker-latency: "), "{words}");
    assert!(words.contains("error of predictions in cm"), "{words}");

    let report = json(&bench(["diagnose", "--json", "--fail-on-gap"]).args(&flights).assert().code(1));
    assert_eq!(report["schema"], "bench.diagnosis/2");
    assert_eq!(report["verdict"], "effect");
    let extra_s = report["candidates"][0]["parameters"][0]["value"].as_f64().unwrap();
    assert!((extra_s - 0.12).abs() < 0.02, "{extra_s}");
}

/// The published cases of another simulator, by the answers that came with them.
#[test]
#[ignore = "needs BENCH_DATA; tests/run runs it where that is set"]
fn bench_data_every_foreign_case_has_its_published_answer() {
    let data = PathBuf::from(std::env::var_os("BENCH_DATA").expect("BENCH_DATA names the data folder"))
        .join("foreign");
    let answers = fs::read_to_string(data.join("answers.json")).unwrap();
    let answers: Vec<serde_json::Value> = serde_json::from_str(&answers).unwrap();
    assert_eq!(answers.len(), 8);
    let mut not_alone = Vec::new();
    for answer in &answers {
        let [case, cause] = ["case", "effect"].map(|key| answer[key].as_str().unwrap());
        let told = told_of(&data.join(case));
        // Lags of first order: which of them it is, the flights need not say.
        let right = told == cause || (cause == "rotor-lag" && told == "actuator-lag");
        let words = format!("{case}: {cause} was told as {told}");
        assert!(told.split(" + ").any(|law| law == cause) || right, "{words}");
        if !right {
            not_alone.push(words);
        }
    }
    // The battery of example-1 is of another form than the library's, and air of no known strength takes what that leaves.
    assert!(not_alone.iter().all(|words| words.starts_with("example-1")), "{not_alone:?}");
}

/// What a folder of foreign logs is told as: the laws named, or `none` or `unknown`.
fn told_of(case: &Path) -> String {
    let scratch = Scratch::new();
    let mut logs: Vec<_> = fs::read_dir(case).unwrap().map(|entry| entry.unwrap().path()).collect();
    logs.retain(|path| path.extension().is_some_and(|extension| extension == "csv"));
    logs.sort();
    assert!(!logs.is_empty(), "no flights in {}", case.display());
    let flights: Vec<String> = logs
        .iter()
        .map(|log| {
            let out = scratch.name(&format!("{}.mcap", log.file_stem().unwrap().to_str().unwrap()));
            bench(["import", "--map", "rigs/import/foreign.toml", "-o", &out]).arg(log).assert().success();
            out
        })
        .collect();
    // What leads, however sure.
    let mut command = bench(["diagnose", "--rig", "rigs/foreign.toml", "--min-confidence", "0", "--json"]);
    let report = json(&command.args(&flights).assert().success());
    match report["effects"].as_array().unwrap().as_slice() {
        [] => report["verdict"].as_str().unwrap().to_owned(),
        laws => laws.iter().map(|law| law.as_str().unwrap()).collect::<Vec<_>>().join(" + "),
    }
}

#[test]
fn what_cannot_be_diagnosed_is_said() {
    let scratch = Scratch::new();
    let words = refused(bench(["diagnose", &scratch.name("absent.mcap")]), 2);
    assert!(words.contains("absent.mcap"), "{words}");
    // A mission that never leaves idle has nothing to predict.
    let mission = "name = \"sit\"\ndescription = \"sits\"\n[[phase]]\nkind = \"idle\"\nduration_s = 3\n";
    std::fs::write(scratch.path("sit.toml"), mission).unwrap();
    let sat = scratch.fly("sat.mcap", &["--mission", &scratch.name("sit.toml")]);
    let words = refused(bench(["diagnose", &sat]), 2);
    assert!(words.contains("never flew"), "{words}");
}

#[test]
fn what_is_not_sure_enough_is_inconclusive_and_fails_a_check() {
    let scratch = Scratch::new();
    let flights = flown(&scratch, None);
    let diagnose = |more: &[&str]| {
        let mut command = bench(["diagnose", "--rig", "virtual"]);
        command.env("XDG_CACHE_HOME", scratch.path("cache")).args(&flights).args(more);
        command
    };
    let page = scratch.name("inconclusive.html");
    let words = stdout(&diagnose(&["--min-confidence", "0.999", "--html", &page]).assert().success());
    assert!(
        words.starts_with("Inconclusive: none leads with ") && words.contains(" was asked for\n"),
        "{words}"
    );
    assert!(words.contains("what would help: "), "{words}");
    assert!(Page::read(&page).headline().starts_with("? Inconclusive: none leads with "));
    let report = json(&diagnose(&["--min-confidence", "0.999", "--fail-on-gap", "--json"]).assert().code(1));
    assert_eq!(report["verdict"], "inconclusive");
    assert_eq!(report["leading"], "none");
    assert_eq!(report["min_confidence"], 0.999);
    assert_eq!(report["inconclusive_because"], serde_json::json!(["confidence"]));
    let report = json(&diagnose(&["--min-confidence", "0", "--fail-on-gap", "--json"]).assert().success());
    assert_eq!(report["verdict"], "none");
    let words = refused(diagnose(&["--min-confidence", "1.5"]), 2);
    assert!(words.contains("a probability from 0 to below 1"), "{words}");
}

#[test]
fn the_calibration_is_told_and_one_that_cannot_be_used_is_refused() {
    let scratch = Scratch::new();
    let flight = scratch.fly("hop.mcap", &["--mission", "hop", "--model", "vertical"]);
    let diagnose = |more: &[&str]| {
        let mut command = bench(["diagnose", &flight]);
        command.env("XDG_CACHE_HOME", scratch.path("cache")).args(more);
        command
    };
    let report = json(&diagnose(&["--json"]).assert().success());
    assert_eq!(report["calibration_choice"]["how"], "built-in");
    let again = report["calibration_choice"]["again"].as_str().unwrap();
    assert!(again.starts_with("--calibration built-in"), "{again}");

    let file = scratch.name("damaged.json");
    fs::write(&file, "{\"schema\": \"bench.calibration/1\", \"gener").unwrap();
    let words = refused(diagnose(&["--calibration", &file]), 2);
    assert!(words.contains("damaged.json") && words.contains("--write-calibration"), "{words}");
    let words = refused(diagnose(&["--calibration", &scratch.name("absent.json")]), 2);
    assert!(words.contains("absent.json"), "{words}");
    let words = refused(diagnose(&["--write-calibration", &scratch.name("never.json")]), 2);
    assert!(words.contains("--calibrate learns one"), "{words}");
    assert!(!scratch.path("never.json").exists());
}
