use std::fs;

use crate::support::{Scratch, bench, json, refused, stdout};

#[test]
fn the_same_flight_is_the_same() {
    let scratch = Scratch::new();
    let a = scratch.fly("a.mcap", &[]);
    let b = scratch.fly("b.mcap", &[]);
    let words = stdout(&bench(["diff", &a, &b]).assert().success());
    assert!(words.to_lowercase().contains("same"), "{words}");
}

#[test]
fn an_effect_makes_a_difference_and_a_floor_of_repeats_explains_noise() {
    let scratch = Scratch::new();
    let nominal: Vec<_> =
        (0..4).map(|seed| scratch.fly(&format!("n{seed}.mcap"), &["--seed", &seed.to_string()])).collect();
    // The effect may well miss the mission's criteria.
    let lag = scratch.name("lag.mcap");
    bench(["sim", "-o", &lag, "--seed", "9", "--effect", "thrust-loss:fraction=0.06"])
        .assert()
        .code(vec![0, 1]);
    let report = json(&bench(["diff", &nominal[0], &lag, "--json"]).assert().code(1));
    assert_eq!(report["schema"], "bench.diff/1");

    let page = scratch.name("diff.html");
    bench(["diff", &nominal[0], &lag, "--html", &page]).assert().code(1);
    let html = fs::read_to_string(&page).unwrap();
    assert!(html.contains("<svg") && !html.contains("http://") && !html.contains("https://"));

    let mut floor = vec!["diff", &nominal[2], &nominal[3], "--json", "--floor", &nominal[0], &nominal[1]];
    bench(&floor).assert().code(vec![0, 1]);
    floor[2] = &lag;
    bench(&floor).assert().code(1);
}

#[test]
fn what_cannot_be_compared_is_refused() {
    let scratch = Scratch::new();
    let a = scratch.fly("a.mcap", &[]);
    let words = refused(bench(["diff", &a, &scratch.name("absent.mcap")]), 2);
    assert!(words.contains("absent.mcap"), "{words}");
}
