use std::fs;

use bench_blind::{Answer, Answers, Seal, Unfinished, Verdict};

use crate::support::{Page, Scratch, bench, json, refused, stdout};

/// A seal of four short cases.
fn sealed(scratch: &Scratch) {
    seal_of(scratch, "kind = \"open\"\nthrust_to_weight = 0.98\nduration_s = 2.0\n");
}

/// A seal of four cases of one phase.
fn seal_of(scratch: &Scratch, phase: &str) {
    let mission = scratch.path("hop.toml");
    fs::write(&mission, format!("name = \"hop\"\ndescription = \"short\"\n[[phase]]\n{phase}")).unwrap();
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
    let page = Page::read(&page);
    assert!(page.headline().contains("sealed cases named rightly"), "{}", page.headline());
    assert_eq!(page.plots().len(), 2);
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

#[test]
fn sealed_cases_are_diagnosed_without_the_key_and_scored() {
    let scratch = Scratch::new();
    sealed(&scratch);
    let [cases, key, answers, kept] =
        ["cases", "key.json", "answers.json", "key-elsewhere.json"].map(|name| scratch.name(name));
    fs::rename(&key, &kept).unwrap();
    let answer = ["blind", "answer", &cases, "-o", &answers];
    let done = json(&bench(answer).arg("--json").assert().success());
    assert_eq!(done["schema"], "bench.answered/1");
    assert_eq!((&done["cases"], &done["resumed"]), (&4.into(), &0.into()));
    assert_eq!(done["failed"], serde_json::json!([]));
    assert!(!scratch.path("answers.json.unfinished").exists());
    let open = ["blind", "open", &cases, "--key", &kept, "--answers", &answers, "--json"];
    let score = json(&bench(open).assert().success());
    assert_eq!(score["answers_sha256"], done["sha256"]);
    assert_eq!(score["missing"], serde_json::json!([]));
    assert!(score["log_score"]["value"].as_f64().is_some());

    // What was answered is not replaced unasked.
    let words = refused(bench(answer), 2);
    assert!(words.contains("--force"), "{words}");
    let words = stdout(&bench(answer).arg("--force").assert().success());
    assert!(words.contains(done["sha256"].as_str().unwrap()), "the same again: {words}");
}

#[test]
fn an_interrupted_run_keeps_what_it_answered() {
    let scratch = Scratch::new();
    sealed(&scratch);
    let [cases, answers] = ["cases", "answers.json"].map(|name| scratch.name(name));
    let seal = Seal::load(&scratch.path("cases")).unwrap();
    let left_behind = |program: &str| {
        let tool = format!("bench diagnose {}", env!("CARGO_PKG_VERSION"));
        let path = scratch.path("answers.json");
        let mut unfinished = Unfinished::begin_or_resume(&path, &tool, program, &seal.key_sha256).unwrap();
        let note = Some("kept".to_owned());
        unfinished.keep("case-002", Answer { note, ..Answer::bare(Verdict::Unknown) }).unwrap();
    };
    // Another build's answers are not mixed with this one's.
    left_behind(&"0".repeat(64));
    let words = refused(bench(["blind", "answer", &cases, "-o", &answers]), 2);
    assert!(words.contains("another run") && words.contains("remove it"), "{words}");
    fs::remove_file(scratch.path("answers.json.unfinished")).unwrap();

    left_behind(&bench_blind::sha256_of_file(env!("CARGO_BIN_EXE_bench").as_ref()).unwrap());
    let done = json(&bench(["blind", "answer", &cases, "-o", &answers, "--json"]).assert().success());
    assert_eq!((&done["cases"], &done["resumed"]), (&4.into(), &1.into()));
    let answers = Answers::load(&scratch.path("answers.json")).unwrap();
    assert_eq!(answers.cases.len(), 4);
    assert_eq!(answers.cases["case-002"].note.as_deref(), Some("kept"));
}

#[test]
fn cases_that_cannot_be_diagnosed_are_answered_failed_with_the_reason() {
    let scratch = Scratch::new();
    seal_of(&scratch, "kind = \"idle\"\nduration_s = 2.0\n");
    let [cases, key, answers] = ["cases", "key.json", "answers.json"].map(|name| scratch.name(name));
    let answer = bench(["blind", "answer", &cases, "-o", &answers]).assert().success();
    assert!(stdout(&answer).contains("4 failed"));
    let words = String::from_utf8(answer.get_output().stderr.clone()).unwrap();
    assert!(words.contains("case-003 failed") && words.contains("never flew"), "{words}");
    let open = ["blind", "open", &cases, "--key", &key, "--answers", &answers, "--json"];
    let score = json(&bench(open).assert().success());
    assert_eq!(score["failed"].as_array().unwrap().len(), 4);
    assert_eq!(score["top_1"]["all"]["count"], 0);
}

#[test]
fn what_is_no_seal_or_was_changed_is_not_answered() {
    let scratch = Scratch::new();
    let [cases, answers] = ["cases", "answers.json"].map(|name| scratch.name(name));
    let words = refused(bench(["blind", "answer", &cases, "-o", &answers]), 2);
    assert!(words.contains("seal.json"), "{words}");
    sealed(&scratch);
    fs::remove_file(scratch.path("cases/case-004/flight-1.mcap")).unwrap();
    let words = refused(bench(["blind", "answer", &cases, "-o", &answers]), 2);
    assert!(words.contains("case-004/flight-1.mcap is gone"), "{words}");
    assert!(!scratch.path("answers.json").exists());
}

#[test]
fn what_flights_can_show_is_told_in_words_and_json() {
    let scratch = Scratch::new();
    let mission = scratch.path("steps.toml");
    fs::write(
        &mission,
        "name = \"steps\"\ndescription = \"short\"\n[[phase]]\nkind = \"launch\"\nthrust_to_weight = 1.12\nduration_s = 0.8\n\
         [[phase]]\nkind = \"hold\"\naltitude_m = [[0.0, 0.3], [3.0, 0.3], [3.0, 0.6]]\nduration_s = 6.0\n",
    )
    .unwrap();
    let mission = scratch.name("steps.toml");
    let power = ["blind", "power", "--missions", &mission, "--draws", "1", "--effect", "tracker-latency"];
    let told = json(&bench(power).arg("--json").assert().success());
    assert_eq!(told["schema"], "bench.blind-power/1");
    assert_eq!(told["missions"], serde_json::json!(["steps"]));
    assert_eq!(told["forms"].as_array().unwrap().len(), 2);
    let words = stdout(&bench(power).assert().success());
    assert!(words.contains("late-frames") && words.contains("1 steps") && words.contains("none"), "{words}");
    let words = refused(bench(["blind", "power", "--effect", "rotor-leg"]), 2);
    assert!(words.contains("rotor-leg") && words.contains("rotor-lag"), "{words}");
}
