//! From balance readings to a verified model, each command's output the next one's input, and the paper's figures.

use std::fs;

use crate::support::{Page, Scratch, bench, json, refused, stdout};

const THRUST: &str = "rigs/balance/hubsan-q4-thrust.csv";
const GROUND: &str = "rigs/balance/hubsan-q4-ground.csv";

#[test]
fn the_way_from_readings_to_a_verified_model() {
    let scratch = Scratch::new();
    let [thrust, ground, page] = ["thrust.toml", "ground.toml", "page.html"].map(|name| scratch.name(name));

    let identify = ["identify", "thrust", THRUST, "--rig", "rigs/virtual.toml", "-o", &thrust];
    let words = stdout(&bench(identify).args(["--html", &page]).assert().success());
    for told in ["thrust_hover", "battery half", "at rest, for the weight alone", "off the line by", "linear"]
    {
        assert!(words.contains(told), "{told}: {words}");
    }
    assert!(
        fs::read_to_string(&thrust)
            .unwrap()
            .starts_with("# thrust: gain and offset by `bench identify thrust`")
    );
    let html = Page::read(&page);
    assert_eq!(html.panels(), ["thrust, g", "reading \u{2212} line, g"]);

    // It is not replaced unasked.
    assert!(refused(bench(identify), 2).contains("--force"));

    let identify = ["identify", "ground-effect", GROUND, "--rig", &thrust, "-o", &ground];
    let report = json(&bench(identify).arg("--json").assert().success());
    assert_eq!(report["schema"], "bench.identification.ground-effect/1");
    assert_eq!(report["laws"][0]["law"], "linear", "{report:#}");

    // The rig flies, and what a balance tells holds nearly any hop.
    let hop = scratch.fly("hop.mcap", &["--mission", "hop"]);
    let verify = ["verify", "--rig", &ground, &hop];
    let report = json(&bench(verify).args(["--json", "--html", &page, "--force"]).assert().code(1));
    assert_eq!(report["schema"], "bench.verification/1");
    assert_eq!((&report["verdict"], &report["passed"]), (&"not-informative".into(), &false.into()));
    assert_eq!(report["widened_by"][0]["name"], "thrust_hover", "{}", report["widened_by"]);
    let shares: f64 =
        report["widened_by"].as_array().unwrap().iter().map(|s| s["share"].as_f64().unwrap()).sum();
    assert!((shares - 1.0).abs() < 1e-9, "{shares}");
    assert!(Page::read(&page).headline().starts_with("? Not informative"));
    let words = stdout(&bench(verify).assert().code(1));
    assert!(
        words.contains("TOO WIDE") && words.contains("what would narrow it: `bench identify flight`"),
        "{words}"
    );

    // A limit that is wide enough, or flights that tell more, and it predicts the hop.
    bench(verify).args(["--band", "5"]).assert().success();
    let flown = scratch.name("flown.toml");
    let flights = ["1", "2", "3"].map(|seed| scratch.fly(&format!("{seed}.mcap"), &["--seed", seed]));
    bench(["identify", "flight", "--rig", &ground, "-o", &flown]).args(&flights).assert().success();
    let verify = ["verify", "--rig", &flown, &hop];
    let report = json(&bench(verify).args(["--json", "--html", &page, "--force"]).assert().success());
    assert_eq!((&report["verdict"], &report["passed"]), (&"passed".into(), &true.into()));
    assert!(Page::read(&page).headline().contains("The model predicts these flights"));

    // A tolerance that nothing meets fails the check.
    let words = stdout(&bench(verify).args(["--trajectory", "0.0001"]).assert().code(1));
    assert!(words.contains("FAILED RMS distance from the trajectory"), "{words}");
}

#[test]
fn a_wrong_model_fails_verification() {
    let scratch = Scratch::new();
    // The tracker is later than the rig believes.
    let climb = scratch.fly("late.mcap", &["--effect", "tracker-latency:extra_s=0.25", "--mission", "steps"]);
    let words = stdout(&bench(["verify", &climb]).assert().code(1));
    assert!(words.contains("FAILED squared errors over expected"), "{words}");
}

#[test]
fn the_example_readings_are_what_their_first_line_says() {
    for (file, more) in [
        (THRUST, ["--effect", "battery-discharge:loss_per_hover_minute=0.01"].as_slice()),
        (GROUND, ["--ground-effect"].as_slice()),
    ] {
        let made = stdout(&bench(["emulate", "balance"]).args(more).assert().success());
        let kept = fs::read_to_string(crate::support::root().join(file)).unwrap();
        let rows = |text: &str| text.lines().skip(1).map(str::to_owned).collect::<Vec<_>>();
        assert_eq!(rows(&made), rows(&kept), "{file}");
        let command = kept.lines().next().unwrap();
        assert!(
            command.starts_with("# bench emulate balance") && more.iter().all(|word| command.contains(word))
        );
    }
}

#[test]
fn what_tells_nothing_is_refused_and_nothing_written() {
    let scratch = Scratch::new();
    let out = scratch.name("never.toml");
    let table = |name: &str, text: &str| {
        let path = scratch.name(name);
        fs::write(&path, text).unwrap();
        path
    };
    let kept = fs::read_to_string(crate::support::root().join(THRUST)).unwrap();
    let milligrams: Vec<String> = kept
        .lines()
        .map(|row| {
            let cells: Vec<&str> = row.split(',').collect();
            match cells.get(1).and_then(|cell| cell.parse::<f64>().ok()) {
                Some(g) => format!("{},{},{}", cells[0], 1000.0 * g, cells[2]),
                None => row.to_owned(),
            }
        })
        .collect();
    let milligrams = milligrams.join("\n");
    let falling = kept.replace("reading_g", "thrust_g");
    for (name, text, words) in [
        ("two.csv", "throttle_v,reading_g\n0,15\n1.9,0.1\n", "2 different throttles"),
        ("one.csv", "throttle_v,reading_g\n1.9,0.1\n1.9,0.1\n1.9,0.2\n1.9,0.1\n", "1 different throttles"),
        ("mg.csv", &milligrams, "1000 times too much"),
        ("falling.csv", &falling, "thrust falls as the throttle rises"),
        ("cell.csv", "throttle_v,reading_g\n0,15\n1.9,x\n", "cell.csv:3: column `reading_g` has \"x\""),
    ] {
        let table = table(name, text);
        let told =
            refused(bench(["identify", "thrust", &table, "--rig", "rigs/virtual.toml", "-o", &out]), 2);
        assert!(told.contains(words) && told.contains("nothing written"), "{words}: {told}");
    }
    let told =
        refused(bench(["identify", "ground-effect", THRUST, "--rig", "rigs/virtual.toml", "-o", &out]), 2);
    assert!(told.contains("no column `altitude_m`") && told.contains("nothing written"), "{told}");

    // A flight that never leaves the ground.
    let rest = scratch.name("rest.toml");
    let mission = "name = \"rest\"\ndescription = \"too little throttle\"\n[[phase]]\nkind = \"open\"\nthrust_to_weight = 0.5\nduration_s = 6.0\n";
    fs::write(&rest, mission).unwrap();
    let flight = scratch.fly("rest.mcap", &["--mission", &rest]);
    let page = scratch.name("never.html");
    let told = refused(bench(["verify", &flight, "--html", &page]), 2);
    assert!(told.contains("never seen above 0.03 m"), "{told}");
    assert!(!scratch.path("never.toml").exists() && !scratch.path("never.html").exists());
}

#[test]
fn the_papers_figures_are_made_and_its_statements_met() {
    let scratch = Scratch::new();
    let folder = scratch.name("paper");
    let report = json(&bench(["paper", "-o", &folder, "--json"]).assert().success());
    assert_eq!(report["schema"], "bench.paper/1");
    let statements = report["statements"].as_array().unwrap();
    for figure in ["4", "9", "10", "11", "15", "15, 16", "16"] {
        assert!(statements.iter().any(|one| one["figure"] == figure), "{figure}");
    }
    let svg = |name: &str| fs::read_to_string(scratch.path("paper").join(name)).unwrap();
    for number in [4, 9, 10, 11, 15, 16] {
        let drawn = svg(&format!("figure-{number}.svg"));
        assert!(drawn.starts_with("<svg xmlns=") && drawn.matches("<path").count() > 10, "{number}");
        assert!(!drawn.contains("NaN") && !drawn.contains("inf"), "{number}");
    }
    let page = Page::read(&scratch.path("paper").join("index.html").to_string_lossy());
    // Where flight and model lie over one another, their difference is drawn beneath, and the words say so.
    for (number, title) in [(15, "flight \u{2212} model, cm"), (16, "flight \u{2212} model, m/s")] {
        assert!(svg(&format!("figure-{number}.svg")).contains(title), "{number}");
        assert!(page.panels().iter().any(|panel| panel == title), "{:?}", page.panels());
        assert!(page.section(&format!("Figure {number}")).contains("at the same time"), "{number}");
    }
    assert!(page.headline().ends_with("statements of the paper are met"), "{}", page.headline());
    assert_eq!(page.plots().len(), 6);
    // The rig that it wrote is one.
    let rig = scratch.path("paper").join("rig.toml");
    scratch.fly("again.mcap", &["--rig", rig.to_str().unwrap(), "--mission", "rigs/missions/climb-040.toml"]);
}
