use std::fs;

use crate::support::{Scratch, bench, json, refused, stdout};

/// A seal of four short cases.
fn sealed(scratch: &Scratch) {
    let mission = scratch.path("hop.toml");
    fs::write(
        &mission,
        "name = \"hop\"\ndescription = \"short\"\n[[phase]]\nkind = \"open\"\nthrust_to_weight = 0.98\nduration_s = 2.0\n",
    )
    .unwrap();
    let (mission, out, key) = (scratch.name("hop.toml"), scratch.name("cases"), scratch.name("key.json"));
    let seal =
        ["blind", "seal", "--cases", "4", "--seed", "3", "--missions", &mission, "-o", &out, "--key", &key];
    let words = stdout(&bench(seal).assert().success());
    assert!(words.contains("4 cases"), "{words}");
}

/// Answers by a tool that always says none, its hash not yet in them.
fn says_none(scratch: &Scratch) {
    let seal: serde_json::Value =
        serde_json::from_slice(&fs::read(scratch.path("cases/seal.json")).unwrap()).unwrap();
    let cases: serde_json::Map<_, _> = (1..=3)
        .map(|i| {
            (
                format!("case-00{i}"),
                serde_json::json!({ "verdict": "none", "probabilities": { "none": 0.7 } }),
            )
        })
        .collect();
    let answers = serde_json::json!({
        "schema": "bench.answers/1", "tool": "always none", "seal": seal["key_sha256"], "sha256": "0".repeat(64), "cases": cases,
    });
    fs::write(scratch.path("answers.json"), answers.to_string()).unwrap();
}

#[test]
fn cases_are_sealed_answered_by_any_tool_and_opened() {
    let scratch = Scratch::new();
    sealed(&scratch);
    says_none(&scratch);
    let [cases, key, answers, page] =
        ["cases", "key.json", "answers.json", "score.html"].map(|name| scratch.name(name));
    let open = ["blind", "open", &cases, "--key", &key, "--answers", &answers];

    let words = refused(bench(open), 2);
    assert!(words.contains("changed after they were hashed"), "{words}");
    let hash = stdout(&bench(["blind", "stamp", &answers]).assert().success());
    let score = json(&bench(open).args(["--json", "--html", &page]).assert().success());
    assert_eq!(score["schema"], "bench.blind/1");
    assert_eq!(score["answers_sha256"], hash.trim());
    assert_eq!(score["missing"], serde_json::json!(["case-004"]));
    // A family of each kind but pairs; only `none` is right.
    assert_eq!(score["top_1"]["all"]["count"], 1);
    assert!(fs::read_to_string(&page).unwrap().contains("<svg"));
    let words = stdout(&bench(open).assert().success());
    assert!(words.contains("case-004") && words.contains("without an answer"), "{words}");

    fs::write(&key, fs::read_to_string(&key).unwrap().replace("virtual", "virtues")).unwrap();
    let words = refused(bench(open), 2);
    assert!(words.contains("does not match the seal"), "{words}");
}

#[test]
fn a_seal_that_would_give_itself_away_is_refused() {
    let scratch = Scratch::new();
    let (out, key) = (scratch.name("cases"), scratch.name("cases/key.json"));
    let words = refused(bench(["blind", "seal", "--cases", "1", "-o", &out, "--key", &key]), 2);
    assert!(words.contains("key.json"), "{words}");
    let words = refused(bench(["blind", "seal", "--cases", "0", "-o", &out, "--key", &scratch.name("k")]), 2);
    assert!(words.contains("1 to 9999"), "{words}");
}
