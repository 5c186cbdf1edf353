//! `docs/your-own-logs.md`, command by command, on logs that are flown here and written in PX4's format, and `docs/your-flights.md` on
//! real ones.

use std::{fs, path::Path};

use bench_recording::Flight;
use serde_json::Value;

use crate::{
    examples::Shell,
    logs::{self, writers::Ulog},
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
    let found = diagnosed(&["--model sim-*.ulg --test real-*.ulg"]);
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
    let (one, two, test) = (of("sim-1.ulg"), of("sim-2.ulg"), of("test.ulg"));
    fs::copy(&one, &test).unwrap();
    let words = refused(bench(["diagnose", &test, "--model", &one, &two]), 2);
    assert!(words.contains("no model of the nominal flights") && words.contains("at least 3"), "{words}");
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

    // What the autopilot's parameters tell.
    let mut more = Ulog::new();
    for (name, value) in [("VM_MASS", 1.25), ("CA_ROTOR0_PX", 0.3), ("CA_ROTOR0_PY", -0.4)] {
        more.parameter(name, value);
    }
    // Without the head of the second log and its flags.
    fs::write(&log, [logs::short(true), more.bytes().split_off(16 + 43)].concat()).unwrap();
    let draft = json(&bench(["rig", "from-log", &log, "-o", &out, "--force", "--json"]).assert().success());
    let told = |key: &str, value: f64| {
        let numbers = draft["numbers"].as_array().unwrap();
        let found = numbers.iter().find(|number| number["key"] == key).unwrap();
        let there: f64 = found["value"].as_str().unwrap().parse().unwrap();
        // Parameters are floats, right to 6e-8 of themselves.
        assert!(found["from"] == "told" && (there - value).abs() < 1e-6, "{found}");
    };
    told("airframe.mass_kg", 1.25);
    told("airframe.stabiliser.arm_m", 0.5);
    // ArduPilot's logs, too.
    let dataflash = scratch.name("short.bin");
    fs::write(&dataflash, logs::short_dataflash()).unwrap();
    bench(["rig", "from-log", &dataflash, "-o", &out, "--force"]).assert().success();
    bench(["check", &out]).assert().success();

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

/// Drafts of published flights of a Crazyflie, beside the rig that was identified from some of them, and what its maker says.
#[test]
#[ignore = "needs BENCH_DATA; tests/run runs it where that is set"]
fn bench_data_drafts_of_real_flights_are_near_what_is_known_of_them() {
    let data = std::env::var_os("BENCH_DATA").expect("BENCH_DATA names the data folder");
    let real = Path::new(&data).join("real");
    let scratch = Scratch::new();
    let known = bench_rig::Rig::load(root().join("rigs/crazyflie-2.toml")).unwrap();
    for (map, folder, begins) in [("crazypad", "crazypad/normal", "flight-"), ("nanobench", "nanobench", "B")]
    {
        let mut logs: Vec<_> =
            fs::read_dir(real.join(folder)).unwrap().map(|entry| entry.unwrap().path()).collect();
        let is_log = |path: &Path| {
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            let is_table = path.extension().is_some_and(|ending| ending == "csv");
            is_table && name.starts_with(begins) && !name.contains("fast")
        };
        logs.retain(|path| is_log(path));
        logs.sort();
        let out = scratch.name(&format!("{map}.toml"));
        bench(["rig", "from-log", "--map", map, "--mass-kg", "0.027", "-o", &out])
            .args(&logs)
            .assert()
            .success();
        let rig = bench_rig::Rig::load(&out).unwrap();
        let a = &rig.airframe;
        eprintln!("{map}: {} flights, {:?}, latency {:?}", logs.len(), a.thrust, rig.tracker.latency_s);
        // Coreless motors follow within 0.03 s to 0.1 s.
        assert!((0.03..0.12).contains(&rig.tracker.latency_s.value), "{map}: {rig:?}");
        // It lifts more than its weight, and no more than the 60 g of the maker's thrust stand.
        let full_n = a.thrust_n(65535.0);
        assert!((1.1 * a.weight_n()..0.6).contains(&full_n), "{map}: {full_n} N");
        if map == "crazypad" {
            let b = &known.airframe;
            let hover = |a: &bench_rig::Airframe| a.throttle_for(a.weight_n());
            let sigma = a.thrust.hover_sigma.unwrap();
            assert!((hover(a) - hover(b)).abs() < 2.0 * sigma, "{} and {}", hover(a), hover(b));
            assert!(
                (a.thrust.offset.value - b.thrust.offset.value).abs() < 2.0 * a.thrust.offset.sigma,
                "{rig:?}"
            );
            let [drafted, identified] = [rig.tracker.latency_s, known.tracker.latency_s];
            assert!((drafted.value - identified.value).abs() < 2.0 * drafted.sigma, "{drafted:?}");
        }
    }
}

/// `docs/your-flights.md`, command by command, on the published flights, and what the page says of them.
#[test]
#[ignore = "needs BENCH_DATA; tests/run runs it where that is set"]
fn bench_data_two_folders_of_real_flights_go_in_and_a_cause_comes_out() {
    let data = std::env::var_os("BENCH_DATA").expect("BENCH_DATA names the data folder");
    let real = Path::new(&data).join("real");
    let scratch = Scratch::new();
    let folder = scratch.path("page");
    fs::create_dir(&folder).unwrap();
    for condition in ["normal", "propeller-m3-cut-3.5mm"] {
        std::os::unix::fs::symlink(real.join("crazypad").join(condition), folder.join(condition)).unwrap();
    }
    fs::create_dir(folder.join("nominal")).unwrap();
    for log in ["B5_helix_medium_rep2", "B5_helix_medium_rep3", "B7_oval_medium_rep2", "B7_oval_medium_rep3"]
        .into_iter()
        .chain(["B8_star_slow_rep1", "B8_star_slow_rep2"])
    {
        let log = format!("{log}.csv");
        std::os::unix::fs::symlink(real.join("nanobench").join(&log), folder.join("nominal").join(&log))
            .unwrap();
    }
    let shell = Shell::in_folder(&scratch, &folder);
    let of = |map: &str| commands("your-flights.md").into_iter().find(|line| line.contains(map)).unwrap();
    let run = |line: &str| -> Value {
        let (code, said) = shell.run(&format!("{line} --json 2>progress.txt"));
        assert!(matches!(code, Some(0 | 1)), "{line}: {code:?}\n{said}");
        serde_json::from_str(&said).unwrap()
    };
    let cut = run(&of("--map crazypad"));
    // Whether it is surer than one in two is for the calibration: what leads is what was cut, or what looks the same in hovering flight.
    assert!(["effect", "inconclusive"].iter().any(|verdict| cut["verdict"] == *verdict), "{cut:#}");
    let alike = cut["candidates"].as_array().unwrap().iter().take(3).map(|candidate| &candidate["name"]);
    assert!(alike.clone().any(|name| name == "thrust-loss"), "{:?}", alike.collect::<Vec<_>>());
    let group = ["thrust-loss", "mass-change", "battery-load", "battery-discharge"];
    assert!(group.iter().any(|name| cut["leading"] == *name), "{}", cut["leading"]);
    let control = run(&of("--map nanobench"));
    let laws: Vec<&str> =
        control["laws"].as_array().unwrap().iter().map(|law| law["name"].as_str().unwrap()).collect();
    assert!(laws.contains(&"tilt-loss") && laws.iter().any(|law| law.starts_with("battery-")), "{laws:?}");
}
