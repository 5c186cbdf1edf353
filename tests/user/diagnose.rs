use crate::support::{Scratch, bench, json, refused, stdout};

const VERTICAL: [&str; 2] = ["--model", "vertical"];

#[test]
fn flights_with_a_planted_effect_are_diagnosed_in_words_and_json() {
    let scratch = Scratch::new();
    let flights: Vec<String> = ["hop", "climb-040", "low-hover"]
        .iter()
        .map(|mission| {
            let out = scratch.name(&format!("{mission}.mcap"));
            let effect = "tracker-latency:extra_s=0.12";
            bench(["sim", "-o", &out, "--mission", mission, "--effect", effect])
                .args(VERTICAL)
                .assert()
                .code(vec![0, 1, 4]);
            out
        })
        .collect();
    let words = stdout(&bench(["diagnose"]).args(&flights).assert().success());
    assert!(words.starts_with("tracker-latency ("), "{words}");
    assert!(words.contains("RMS error of predictions"), "{words}");

    let report = json(&bench(["diagnose", "--json", "--fail-on-gap"]).args(&flights).assert().code(1));
    assert_eq!(report["schema"], "bench.diagnosis/1");
    assert_eq!(report["verdict"], "effect");
    let extra_s = report["candidates"][0]["parameters"][0]["value"].as_f64().unwrap();
    assert!((extra_s - 0.12).abs() < 0.02, "{extra_s}");
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
