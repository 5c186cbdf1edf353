use std::fs;

use crate::support::{Page, Scratch, bench, json, refused, stdout};

#[test]
fn the_same_flight_is_the_same() {
    let scratch = Scratch::new();
    let a = scratch.fly("a.mcap", &[]);
    let b = scratch.fly("b.mcap", &[]);
    let words = stdout(&bench(["diff", &a, &b]).assert().success());
    assert!(words.to_lowercase().contains("same"), "{words}");
}

/// `bench diff` with a cache of the test's own.
fn diff(scratch: &Scratch, arguments: &[&str]) -> assert_cmd::Command {
    let mut command = bench(["diff"]);
    command.args(arguments).env("XDG_CACHE_HOME", scratch.path("cache"));
    command
}

#[test]
fn two_seeds_are_within_tolerance_an_effect_is_not_and_exactly_nothing_is() {
    let scratch = Scratch::new();
    let a = scratch.fly("a.mcap", &["--seed", "1"]);
    let b = scratch.fly("b.mcap", &["--seed", "2"]);
    // To the last digit.
    let fresh = stdout(&diff(&scratch, &[&a, &b, "--json"]).assert().success());
    assert_eq!(stdout(&diff(&scratch, &[&a, &b, "--json"]).assert().success()), fresh);
    let first = stdout(&diff(&scratch, &[&a, &b]).assert().success());
    assert!(first.starts_with("within tolerance"), "{first}");
    assert!(first.contains("derived from rig virtual") && first.contains("--exact"), "{first}");

    // The cache may be used, damaged or not be writable: nothing else comes out.
    let cache = scratch.path("cache/bench/repeats");
    let kept: Vec<_> = fs::read_dir(&cache).unwrap().map(|entry| entry.unwrap().path()).collect();
    assert_eq!(kept.len(), 1);
    assert_eq!(stdout(&diff(&scratch, &[&a, &b]).assert().success()), first);
    fs::write(&kept[0], "not JSON").unwrap();
    assert_eq!(stdout(&diff(&scratch, &[&a, &b]).assert().success()), first);
    fs::remove_dir_all(scratch.path("cache")).unwrap();
    fs::write(scratch.path("cache"), "no folder").unwrap();
    assert_eq!(stdout(&diff(&scratch, &[&a, &b]).assert().success()), first);
    fs::remove_file(scratch.path("cache")).unwrap();

    let report = json(&diff(&scratch, &[&a, &b, "--json", "--abs", "position_m.z=1e-6"]).assert().code(1));
    assert_eq!(report["derived"]["mission"], "climb-040");
    let origins: Vec<_> =
        report["fields"].as_array().unwrap().iter().map(|field| &field["tolerance"]["origin"]).collect();
    assert!(origins.contains(&&"repeats".into()) && origins.contains(&&"given".into()), "{origins:?}");

    let exact = stdout(&diff(&scratch, &[&a, &b, "--exact"]).assert().code(1));
    assert!(exact.starts_with("differ"), "{exact}");
    let again = scratch.fly("again.mcap", &["--seed", "1"]);
    assert!(stdout(&diff(&scratch, &[&a, &again, "--exact"]).assert().success()).starts_with("same"));
    assert!(refused(diff(&scratch, &[&a, &b, "--exact", "--abs", "position_m.z=1"]), 2).contains("--exact"));
}

#[test]
fn what_an_effect_changes_stands_first() {
    let scratch = Scratch::new();
    let a = scratch.fly("a.mcap", &["--seed", "1"]);
    for (effect, field) in [
        ("mass-change:fraction=0.1", "thrust_n"),
        ("battery-discharge:loss_per_hover_minute=0.05", "position_m.z"),
    ] {
        let b = scratch.name("b.mcap");
        // The effect may well miss the mission's criteria.
        bench(["sim", "-o", &b, "--force", "--seed", "2", "--effect", effect]).assert().code(vec![0, 1]);
        let report = json(&diff(&scratch, &[&a, &b, "--json"]).assert().code(1));
        let first = report["fields"].as_array().unwrap().iter().take(4);
        let first: Vec<_> = first.map(|field| field["field"].as_str().unwrap()).collect();
        assert!(first.contains(&field), "{effect}: {first:?}");
    }
}

#[test]
fn without_one_rig_the_built_in_tolerances_hold_and_that_is_told() {
    let scratch = Scratch::new();
    let a = scratch.fly("a.mcap", &[]);
    let b = scratch.fly("b.mcap", &["--rig", "rigs/loopback.toml"]);
    let words = stdout(&diff(&scratch, &[&a, &b]).assert().code(vec![0, 1]));
    assert!(words.contains("built-in ones") && words.contains("rigs attached differ"), "{words}");
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
    let page = Page::read(&page);
    assert_eq!(page.headline(), "\u{2717} Different");
    // What differs is told first, by its difference.
    assert_eq!(page.texts("main h2")[0], "Different");
    assert!(page.panels()[0].starts_with("B \u{2212} A"), "{:?}", page.panels());
    assert!(page.bytes < 500_000, "{} bytes", page.bytes);

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
