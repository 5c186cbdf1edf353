//! `docs/your-own-logs.md`, command by command, on logs that are flown here and written in PX4's format.

use std::fs;

use bench_recording::Flight;
use serde_json::Value;

use crate::{
    examples::Shell,
    logs,
    support::{Scratch, bench, json, refused, root, stdout},
};

const NOMINAL: [&str; 5] = ["steps", "climb-040", "low-hover", "hop", "steps"];
const TESTED: [&str; 3] = ["hop", "climb-040", "low-hover"];

/// Flies missions and writes each as a PX4 log into a folder.
fn flown(scratch: &Scratch, rig: &str, name: &str, missions: &[&str], seed: usize, more: &[&str]) {
    for (index, mission) in missions.iter().enumerate() {
        let out = scratch.name("flown.mcap");
        let seed = (seed + index).to_string();
        let arguments = ["sim", "--rig", rig, "--mission", mission, "--seed", &seed, "-o", &out, "--force"];
        // A flight may miss its mission's criteria; it is recorded all the same.
        bench(arguments.iter().chain(more)).assert().code(vec![0, 1, 4]);
        let log = scratch.path("page").join(format!("{name}-{}.ulg", index + 1));
        fs::write(log, logs::px4(&Flight::load(&out).unwrap())).unwrap();
    }
}

/// The lines of a page's console blocks.
fn commands(page: &str) -> Vec<String> {
    let text = fs::read_to_string(root().join("docs").join(page)).unwrap();
    let blocks = text.split("```console\n").skip(1).map(|part| part.split("```").next().unwrap_or_default());
    blocks.flat_map(str::lines).map(str::to_owned).collect()
}

#[test]
fn the_page_goes_from_logs_to_the_effect_that_was_flown() {
    let scratch = Scratch::new();
    fs::create_dir(scratch.path("page")).unwrap();
    let rig = logs::rig(&scratch);
    flown(&scratch, &rig, "nominal", &NOMINAL, 1, &[]);
    flown(&scratch, &rig, "test", &TESTED, 21, &["--effect", "battery-discharge:loss_per_hover_minute=0.08"]);
    let folder = scratch.path("page");
    // What a simulator flew, and what was flown with the effect.
    for (name, of) in [("sim", ("nominal", NOMINAL.len())), ("real", ("test", TESTED.len()))] {
        for index in 1..=of.1 {
            fs::copy(
                folder.join(format!("{}-{index}.ulg", of.0)),
                folder.join(format!("{name}-{index}.ulg")),
            )
            .unwrap();
        }
    }
    let shell = Shell::in_folder(&scratch, &folder);
    let commands = commands("your-own-logs.md");
    assert!(commands.iter().any(|line| line.starts_with("bench rig from-log")), "{commands:?}");
    for line in &commands {
        let (code, said) = shell.run(line);
        assert!(code == Some(0) && !said.contains("panicked"), "{line}: {code:?}\n{said}");
        eprintln!("{line}\n{said}");
    }
    let told = |file: &str| fs::read_to_string(folder.join(file)).unwrap();
    assert!(told("draft.toml").contains("# guess: ") && told("draft.toml").contains("# from the flights: "));
    let diagnosed = |arguments: &[&str]| -> Value {
        let (code, said) =
            shell.run(&format!("bench diagnose {} --json 2>progress.txt", arguments.join(" ")));
        assert_eq!(code, Some(0), "{said}");
        serde_json::from_str(&said).unwrap()
    };
    let found = diagnosed(&["--rig my-quad.toml test-*.mcap"]);
    assert_eq!((&found["verdict"], &found["leading"]), (&"effect".into(), &"battery-discharge".into()));
    // By one command from the logs, the same.
    let found = diagnosed(&["real-*.ulg --model sim-*.ulg"]);
    assert_eq!((&found["verdict"], &found["leading"]), (&"effect".into(), &"battery-discharge".into()));
    // Nominal flights that no step has seen.
    flown(&scratch, &rig, "other", &TESTED, 41, &[]);
    let (code, said) = shell.run("for n in 1 2 3; do bench import other-$n.ulg -o other-$n.mcap; done");
    assert_eq!(code, Some(0), "{said}");
    assert_eq!(diagnosed(&["--rig my-quad.toml other-*.mcap"])["verdict"], "none");
}

#[test]
fn a_model_that_cannot_be_one_is_refused() {
    let scratch = Scratch::new();
    fs::create_dir(scratch.path("page")).unwrap();
    let rig = logs::rig(&scratch);
    flown(&scratch, &rig, "sim", &["hop", "climb-040"], 1, &[]);
    let of = |name: &str| scratch.path("page").join(name).to_str().unwrap().to_owned();
    let (one, two) = (of("sim-1.ulg"), of("sim-2.ulg"));
    let words = refused(bench(["diagnose", &one, "--model", &one, &two]), 2);
    assert!(words.contains("--model") && words.contains("at least 3"), "{words}");
    let words = refused(bench(["diagnose", &one, "--model", &one, "--rig", "virtual"]), 2);
    assert!(words.contains("cannot be used with"), "{words}");
    // A rig whose throttle is in another unit is no model of a log.
    let words = refused(bench(["diagnose", "--rig", "virtual", &one]), 2);
    assert!(words.contains("it cannot be a model"), "{words}");
}

#[test]
fn a_draft_says_what_it_was_drawn_from_and_refuses_what_is_no_flight() {
    let scratch = Scratch::new();
    let (log, out) = (scratch.name("short.ulg"), scratch.name("draft.toml"));
    fs::write(&log, logs::short(true)).unwrap();
    let draft = json(&bench(["rig", "from-log", &log, "-o", &out, "--json"]).assert().success());
    let number = |key: &str| {
        let numbers = draft["numbers"].as_array().unwrap();
        numbers.iter().find(|number| number["key"] == key).unwrap_or_else(|| panic!("{key}: {draft}")).clone()
    };
    // A climb at 0.5 of constant throttle: it tells where it hovers, and not how thrust goes with throttle.
    assert_eq!(number("airframe.thrust.offset_fraction")["from"], "guess");
    assert_eq!(number("loop.period_s")["value"], "0.02");
    assert_eq!(number("airframe.mass_kg")["from"], "guess");
    bench(["check", &out]).assert().success();
    let words = stdout(
        &bench(["rigs", "from-log", &log, "--mass-kg", "0.8", "-o", &out, "--force"]).assert().success(),
    );
    assert!(
        words.contains("airframe.mass_kg = 0.8") && words.contains("guesses, marked in the file"),
        "{words}"
    );

    let words = refused(bench(["rig", "from-log", &log, "-o", &out]), 2);
    assert!(words.contains("--force"), "{words}");
    fs::write(&log, logs::short(false)).unwrap();
    let out = scratch.name("none.toml");
    let words = refused(bench(["rig", "from-log", &log, "-o", &out]), 2);
    assert!(words.contains("the unit of its throttle"), "{words}");
    let table = scratch.name("table.csv");
    fs::write(&table, "a,b\n1,2\n").unwrap();
    refused(bench(["rig", "from-log", &table, "-o", &out]), 2);
    refused(bench(["rig", "from-log", &log, "--mass-kg", "-1", "-o", &out]), 2);
    // Throttles in volts and in fractions are not of one aircraft.
    let flown = scratch.fly("flown.mcap", &["--mission", "hop"]);
    fs::write(&log, logs::short(true)).unwrap();
    let words = refused(bench(["rig", "from-log", &log, &flown, "-o", &out]), 2);
    assert!(words.contains("not of one aircraft"), "{words}");
    assert!(!scratch.path("none.toml").exists());
}
