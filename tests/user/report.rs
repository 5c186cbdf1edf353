//! `bench report`: what stands in the page, read as a browser reads it, and how large it is.

use std::fs;

use crate::support::{Page, Scratch, bench, refused, stdout};

#[test]
fn a_flight_is_told_from_its_verdict_to_its_rig() {
    let scratch = Scratch::new();
    let flight = scratch.fly("flight.mcap", &[]);
    let file = scratch.name("report.html");
    bench(["report", &flight, "-o", &file]).assert().success();
    let page = Page::read(&file);
    assert_eq!(page.headline(), "\u{2713} The flight met all 5 criteria");
    let criteria = page.section("Criteria");
    assert!(
        criteria.contains("Highest altitude at least. peak_min_m") && criteria.contains("passed"),
        "{criteria}"
    );
    let panels = page.panels();
    for panel in
        ["altitude, m", "seen \u{2212} wanted, cm", "off the truth, cm", "throttle, V", "thrust over weight"]
    {
        assert!(panels.iter().any(|title| title == panel), "{panel}: {panels:?}");
    }
    let phases = &page.plots()[0]["spans"];
    let phases: Vec<_> =
        phases.as_array().unwrap().iter().map(|span| span["name"].as_str().unwrap()).collect();
    assert_eq!(phases[..3], ["idle", "launch", "hold"]);
    assert!(page.section("Timing").contains("0 overran"));
    assert!(page.section("Events").contains("phase launch"));
    let settings = page.section("Rig, mission and channels");
    assert!(settings.contains("frame_period_s") && settings.contains("thrust_to_weight"), "{settings}");
    assert!(settings.contains("/tracker/position"));
    // Every entry of the contents goes somewhere.
    let links = page.attributes("nav a", "href");
    assert!(links.len() > 5, "{links:?}");
    for id in links {
        assert_eq!(page.texts(&id).len(), 1, "{id}");
    }
    assert!(page.section("Make it again").contains("bench report"));

    let words = refused(bench(["report", &flight, "-o", &file]), 2);
    assert!(words.contains("--force"), "{words}");
}

#[test]
fn a_missed_criterion_stands_first_and_is_no_error_of_the_command() {
    let scratch = Scratch::new();
    let flight = scratch.name("heavy.mcap");
    bench(["sim", "-o", &flight, "--effect", "thrust-loss:fraction=0.2"]).assert().code(1);
    let file = scratch.name("report.html");
    bench(["report", &flight, "-o", &file]).assert().success();
    let page = Page::read(&file);
    assert!(page.headline().starts_with("\u{2717} The flight missed"), "{:?}", page.headline());
    assert!(page.section("Criteria").contains("failed"));
    assert!(page.texts("header.verdict")[0].contains("thrust-loss:fraction=0.2"));
}

#[test]
fn several_flights_have_an_overview_and_their_difference() {
    let scratch = Scratch::new();
    let a = scratch.fly("a.mcap", &["--seed", "1"]);
    let b = scratch.name("b <i>.mcap");
    bench(["sim", "-o", &b, "--effect", "thrust-loss:fraction=0.06"]).assert().code(vec![0, 1]);
    let file = scratch.name("both.html");
    bench(["report", &a, &b, "--diff", "-o", &file])
        .env("XDG_CACHE_HOME", scratch.path("cache"))
        .assert()
        .success();
    let page = Page::read(&file);
    let overview = page.section("Overview");
    assert!(overview.contains("a.mcap") && overview.contains("b <i>.mcap"), "{overview}");
    let difference = page.section("Difference: a.mcap and b <i>.mcap");
    assert!(
        difference.contains("beyond tolerance") && difference.contains("/control/state/integral_n"),
        "{difference}"
    );
    assert!(page.panels().iter().any(|title| title == "B \u{2212} A, N"), "{:?}", page.panels());
}

#[test]
fn open_loop_flights_are_held_against_their_model() {
    let scratch = Scratch::new();
    let hop = scratch.fly("hop.mcap", &["--mission", "hop"]);
    let file = scratch.name("model.html");
    bench(["report", &hop, "--verify", "-o", &file]).assert().success();
    let page = Page::read(&file);
    assert!(
        page.section("Verification").contains("mean width of the band"),
        "{}",
        page.section("Verification")
    );
    assert!(page.section("Trajectories").contains("hop.mcap"));
}

#[test]
fn a_cut_recording_is_shown_as_far_as_it_is_whole() {
    let scratch = Scratch::new();
    let flight = scratch.fly("flight.mcap", &[]);
    let whole = fs::read(&flight).unwrap();
    let cut = scratch.name("cut.mcap");
    fs::write(&cut, &whole[..whole.len() * 3 / 4]).unwrap();
    let file = scratch.name("report.html");
    let assert = bench(["report", &cut, "-o", &file]).assert().code(3);
    let words = String::from_utf8(assert.get_output().stderr.clone()).unwrap();
    assert!(words.contains("cut.mcap was not closed") && words.contains("bench recover"), "{words}");
    let page = Page::read(&file);
    assert!(page.texts(".warn")[0].contains("cut.mcap was not closed"), "{:?}", page.texts(".warn"));
    assert!(page.panels().contains(&"altitude, m".to_owned()));
}

#[test]
fn what_a_cut_recording_does_not_allow_is_left_out_and_the_page_says_why() {
    let scratch = Scratch::new();
    let hop = scratch.fly("hop.mcap", &["--mission", "hop"]);
    let whole = fs::read(&hop).unwrap();
    let cut = scratch.name("cut.mcap");
    fs::write(&cut, &whole[..whole.len() * 3 / 4]).unwrap();
    let file = scratch.name("report.html");
    let parts = [
        ("--diff", "Difference: hop.mcap and cut.mcap", "diff"),
        ("--diagnose", "Diagnosis", "diagnose"),
        ("--verify", "Verification", "verify"),
    ];
    let flags = parts.map(|(flag, ..)| flag);
    let assert = bench(["report", &hop, &cut, "-o", &file]).args(flags).assert().code(3);
    let words = String::from_utf8(assert.get_output().stderr.clone()).unwrap();
    let page = Page::read(&file);
    for (flag, title, command) in parts {
        // What the command itself says of it.
        let alone = refused(bench([command, &hop, &cut]), 2);
        let why = alone.trim().strip_prefix("error: ").unwrap();
        assert!(why.contains("cut.mcap was not closed") && why.contains("bench recover"), "{why}");
        assert!(words.contains(&format!("warning: {flag}: {why}")), "{flag}: {words}");
        let section = page.section(title);
        // A command in the sentence is set as one.
        let why = why.replace('`', "");
        assert!(section.contains("Left out") && section.contains(&why), "{title}: {section}");
    }
    // The flights themselves are there, and what is wrong with something else is an error still.
    assert!(page.section("Overview").contains("cut.mcap"));
    let log = scratch.name("log.html");
    let wrong = refused(bench(["report", &hop, "--verify", "--rig", "no-such-rig", "-o", &log]), 2);
    assert!(wrong.contains("no-such-rig"), "{wrong}");
    assert!(!scratch.path("log.html").exists());
}

/// An imported log has neither a rig nor a loop.
#[test]
fn what_was_not_recorded_leaves_no_trace() {
    let scratch = Scratch::new();
    let log = scratch.name("log.csv");
    fs::write(&log, "time_s,z_m\n0,0\n0.1,0.05\n0.2,0.1\n").unwrap();
    let map = scratch.name("map.toml");
    let text = "name = \"mine\"\n[time]\ncolumn = \"time_s\"\nunit = \"s\"\n[position]\nlatency_s = 0\nz = { column = \"z_m\", unit = \"m\" }\n";
    fs::write(&map, text).unwrap();
    let (recording, file) = (scratch.name("log.mcap"), scratch.name("log.html"));
    bench(["import", "--map", &map, &log, "-o", &recording]).assert().success();
    bench(["report", &recording, "-o", &file]).assert().success();
    let page = Page::read(&file);
    assert!(page.headline().ends_with("without criteria"));
    assert!(!page.panels().iter().any(|title| title.contains("throttle") || title.contains("wanted")));
    // The map is told as a file, not among the particulars.
    assert!(
        !page.texts("header dl")[0].contains("column =") && page.texts("pre").concat().contains("column =")
    );
    assert!(page.section("Rig, mission and channels").contains("No rig is attached"));
}

/// As large as flights get: ten minutes at 100 Hz.
#[test]
fn the_page_of_ten_minutes_at_100_hz_is_below_5_mb() {
    let scratch = Scratch::new();
    let rig = scratch.name("rig.toml");
    bench(["rigs", "copy", "crazyflie-2", "-o", &rig]).assert().success();
    let text =
        fs::read_to_string(&rig).unwrap().replace("flight_time_max_s = 300.0", "flight_time_max_s = 700.0");
    fs::write(&rig, text).unwrap();
    let mission = "name = \"long\"\ndescription = \"Ten minutes of hover.\"\n\
        [[phase]]\nkind = \"idle\"\nduration_s = 1\n\
        [[phase]]\nkind = \"launch\"\nduration_s = 0.7\nthrust_to_weight = 1.1\n\
        [[phase]]\nkind = \"hold\"\nduration_s = 600\naltitude_m = 0.4\n\
        [criteria]\npeak_min_m = 0.3\n";
    fs::write(scratch.path("long.toml"), mission).unwrap();
    let flight = scratch.name("long.mcap");
    bench(["sim", "--rig", &rig, "--mission", &scratch.name("long.toml"), "-o", &flight]).assert().success();
    let info = stdout(&bench(["info", &flight, "--json"]).assert().success());
    let info: serde_json::Value = serde_json::from_str(&info).unwrap();
    assert!(info["duration_s"].as_f64().unwrap() >= 600.0, "{info}");
    let file = scratch.name("long.html");
    bench(["report", &flight, "-o", &file]).assert().success();
    let page = Page::read(&file);
    assert!(page.bytes < 5_000_000, "{} bytes", page.bytes);
    // As fine as a screen shows, all the same.
    let points = |plot: &serde_json::Value| plot["tables"][0].as_array().unwrap().len();
    assert!(page.plots().iter().map(points).max().unwrap() >= 2_000);
}
