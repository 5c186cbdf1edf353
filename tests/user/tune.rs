use std::fs;

use crate::support::{Page, Scratch, bench, json, refused, root, stdout};

/// A tuning that takes seconds: too small to find much, enough to go all the way.
const SMALL: [&str; 8] = ["--models", "20", "--check", "20", "--scan", "2", "--refine", "1"];

#[test]
fn a_rig_is_tuned_written_with_its_comments_and_flown() {
    let scratch = Scratch::new();
    let (out, page) = (scratch.name("mine.toml"), scratch.name("tune.html"));
    let tune = ["tune", "--rig", "rigs/virtual-model.toml", "-o", &out];
    let words = stdout(&bench(tune).args(SMALL).args(["--html", &page]).assert().success());
    assert!(words.contains("altitude loop") && words.contains("lateral loop"), "{words}");
    assert!(words.contains("20 of 20 fresh airframes hold 0.4 m within 2 cm RMS"), "{words}");
    assert!(words.starts_with("All limits held; all 20 fresh airframes hold 0.4 m within 2 cm; "), "{words}");

    let text = fs::read_to_string(&out).unwrap();
    assert!(text.starts_with("# Gains tuned by `bench tune`: `--rig rigs/virtual-model.toml"), "{text}");
    assert!(text.contains("name = \"mine\"") && text.contains("# section 2: soft real time"), "{text}");
    // In another folder, so the airframe is named by its whole path.
    let mission = "rigs/missions/climb-040.toml";
    bench(["sim", "--rig", &out, "--mission", mission, "-o", &scratch.name("f.mcap")]).assert().success();
    let page = Page::read(&page);
    assert!(page.headline().contains("All limits held; all 20"), "{}", page.headline());
    assert!(page.section("The altitude loop").contains("held"));

    // It is not replaced unasked.
    let mut again = bench(tune);
    again.args(SMALL);
    assert!(refused(again, 2).contains("--force"));
    let report =
        json(&bench(tune).args(SMALL).args(["--force", "--json", "--loops", "altitude"]).assert().success());
    assert_eq!(report["schema"], "bench.tune/1");
    assert_eq!(report["loops"].as_array().unwrap().len(), 1);
    assert_eq!(report["loops"][0]["checked"]["of"], 20);
}

#[test]
fn a_limit_that_cannot_be_held_is_exit_code_1_and_nonsense_is_refused() {
    let scratch = Scratch::new();
    let out = scratch.name("mine.toml");
    let tune = ["tune", "--rig", "rigs/virtual.toml", "-o", &out, "--loops", "altitude"];
    let words = stdout(&bench(tune).args(SMALL).args(["--rms", "0.0001"]).assert().code(1));
    let verdict = words.lines().next().unwrap();
    let of_rms = [
        "Not good enough: altitude loop, RMS in hold, cm: ",
        ", the limit is 0.01",
        "only 0.0 % of 20 fresh",
    ];
    assert!(of_rms.iter().all(|part| verdict.contains(part)), "{words}");
    assert!(words.contains("broken"), "{words}");
    assert!(scratch.path("mine.toml").exists());
    fs::remove_file(&out).unwrap();

    let cases: [(&[&str], &str); 5] = [
        (&["--models", "3"], "20 at least"),
        (&["--altitude", "5"], "ceiling_m"),
        (&["--altitude", "nan"], "ceiling_m"),
        (&["--phase-margin=-3"], "above 0"),
        (&["--loops", "yaw"], "altitude, lateral"),
    ];
    for (arguments, expected) in cases {
        let mut command = bench(tune);
        command.args(arguments);
        let words = refused(command, 2);
        assert!(words.contains(expected), "{arguments:?}: {words}");
        assert!(!scratch.path("mine.toml").exists(), "{arguments:?} wrote a rig");
    }
}

#[test]
fn a_built_in_rig_is_written_whole() {
    let scratch = Scratch::new();
    let out = scratch.name("tuned.toml");
    let small = ["--models", "20", "--check", "20", "--scan", "1", "--refine", "1", "--loops", "altitude"];
    let tune = bench(["tune", "--rig", "crazyflie-2", "-o", &out]).args(small).assert().code(vec![0, 1]);
    assert!(!stdout(&tune).is_empty());
    bench(["sim", "--rig", &out, "-o", &scratch.name("f.mcap")]).assert().success();
}

#[test]
fn laws_are_compared_on_one_bench() {
    let scratch = Scratch::new();
    let page = scratch.name("laws.md");
    let laws = ["laws", "rigs/virtual.toml", "rigs/virtual-model.toml", "--models", "3"];
    let told = bench(laws).args(["--effects", "rotor-lag,updraft", "-o", &page, "--json"]).assert().success();
    let report = json(&told);
    assert_eq!(report["schema"], "bench.laws/1");
    assert_eq!(report["cases"].as_array().unwrap().len(), 3);
    assert_eq!(report["cases"][0]["achieved"][1]["hovered"]["count"], 3, "{report:#}");
    assert_eq!(report["cases"][0]["achieved"][0]["hovered"]["count"], 0);
    let text = fs::read_to_string(&page).unwrap();
    assert!(text.contains("| rotor-lag |") && text.contains("| virtual-model |"), "{text}");

    let other = bench(["laws", "rigs/virtual.toml", "rigs/foreign.toml", "--models", "1"]);
    assert!(refused(other, 2).contains("differ in more than name and [control]"));
    assert!(refused(bench(["laws", "rigs/virtual.toml", "--effects", "magic"]), 2).contains("magic"));
    assert!(refused(bench(["laws", "rigs/virtual.toml", "--models", "0"]), 2).contains("at least 1"));
}

#[test]
fn the_better_law_passes_every_mission_and_hovers_at_three_centimetres() {
    let scratch = Scratch::new();
    for mission in ["climb-040", "steps", "low-hover", "hold-3d", "ground-hover"] {
        for seed in ["0", "1"] {
            let out = scratch.name(&format!("{mission}-{seed}.mcap"));
            let sim =
                ["sim", "--rig", "rigs/virtual-model.toml", "--mission", mission, "--seed", seed, "-o", &out];
            bench(sim).assert().success();
        }
    }
    // The paper's law leaves the ground effect.
    let sim = ["sim", "--mission", "ground-hover", "-o", &scratch.name("linear.mcap")];
    bench(sim).assert().code(1);
}

#[test]
fn the_second_airframe_flies_the_papers_climb() {
    let scratch = Scratch::new();
    assert!(root().join("rigs/airframes/crazyflie-2.toml").exists());
    for seed in ["0", "1", "2"] {
        let out = scratch.name(&format!("crazyflie-{seed}.mcap"));
        let sim = ["sim", "--rig", "rigs/crazyflie-2.toml", "--seed", seed, "-o", &out, "--json"];
        let result = json(&bench(sim).assert().success());
        assert_eq!(result["airframe"], "crazyflie-2", "{result}");
    }
}
