use crate::support::{Scratch, bench, json, refused, stdout};

fn flights(scratch: &Scratch, count: u64) -> Vec<String> {
    (0..count)
        .map(|seed| {
            let out = scratch.name(&format!("nominal-{seed}.mcap"));
            let seed = seed.to_string();
            bench(["sim", "-o", &out, "--seed", &seed, "--model", "vertical"]).assert().success();
            out
        })
        .collect()
}

#[test]
fn a_rig_is_identified_written_and_used() {
    let scratch = Scratch::new();
    let flights = flights(&scratch, 3);
    let out = scratch.name("identified.toml");
    let identify = ["identify", "flight", "--rig", "rigs/virtual.toml", "-o", &out];
    let words = stdout(&bench(identify).args(&flights).assert().success());
    assert!(words.contains("thrust_hover") && words.contains("not told, left"), "{words}");
    let text = std::fs::read_to_string(&out).unwrap();
    assert!(
        text.starts_with("# identified: identified by `bench identify flight` from 3 flights")
            && text.contains("hover_sigma_v"),
        "{text}"
    );

    // It is a rig: it flies, and the flights show no gap against it.
    let mission = "rigs/missions/climb-040.toml";
    let flown = scratch.fly("again.mcap", &["--rig", &out, "--model", "vertical", "--mission", mission]);
    assert!(std::fs::metadata(flown).unwrap().len() > 0);
    let report = json(&bench(["diagnose", "--json", "--rig", &out]).args(&flights).assert().success());
    assert_eq!(report["verdict"], "none", "{report:#}");

    // It is not replaced unasked.
    let mut again = bench(identify);
    again.args(&flights);
    assert!(refused(again, 2).contains("--force"));
    let report = json(&bench(identify).args(&flights).args(["--force", "--json"]).assert().success());
    assert_eq!(report["schema"], "bench.identification/1");
}

#[test]
fn nothing_is_written_where_nothing_is_identified() {
    let scratch = Scratch::new();
    let flights = flights(&scratch, 2);
    let out = scratch.name("never.toml");
    let mut few = bench(["identify", "flight", "--rig", "rigs/virtual.toml", "-o", &out]);
    few.args(&flights);
    let words = refused(few, 2);
    assert!(words.contains("at least 3 are needed") && words.contains("nothing written"), "{words}");
    assert!(!scratch.path("never.toml").exists());
}

#[test]
fn one_flight_given_three_times_is_one_flight() {
    let scratch = Scratch::new();
    let flight = &flights(&scratch, 1)[0];
    let copy = scratch.name("copy.mcap");
    std::fs::copy(flight, &copy).unwrap();
    let out = scratch.name("never.toml");
    let words = refused(
        bench(["identify", "flight", "--rig", "rigs/virtual.toml", "-o", &out, flight, flight, &copy]),
        2,
    );
    assert!(
        words.contains("1 of the flights can be used; at least 3 are needed")
            && words.matches("counted once").count() == 2,
        "{words}"
    );
    assert!(!scratch.path("never.toml").exists());
}

/// Flights of two missions, with an effect or without.
fn flown(scratch: &Scratch, name: &str, first_seed: u64, effect: &[&str]) -> Vec<String> {
    ["steps", "climb-040"]
        .into_iter()
        .zip(first_seed..)
        .map(|(mission, seed)| {
            let seed = seed.to_string();
            let options = ["--model", "vertical", "--mission", mission, "--seed", &seed];
            scratch.fly(&format!("{name}-{seed}.mcap"), &[options.as_slice(), effect].concat())
        })
        .collect()
}

#[test]
fn flights_that_were_fine_are_the_model_that_others_are_held_against() {
    let scratch = Scratch::new();
    let good = [flown(&scratch, "good", 1, &[]), flown(&scratch, "good", 11, &[])].concat();
    let bad = flown(&scratch, "bad", 21, &["--effect", "rotor-lag:time_constant_s=0.2"]);
    let diagnose = |test: &[String]| {
        let mut command = bench(["diagnose", "--json", "--nominal"]);
        command.args(&good).arg("--test").args(test);
        json(&command.assert().success())
    };
    let found = diagnose(&bad);
    assert_eq!(found["verdict"], "effect", "{found:#}");
    assert!(found["leading"].as_str().unwrap().contains("-lag"), "{}", found["leading"]);
    assert_eq!(found["model"]["flights"].as_array().unwrap().len(), 4);
    assert_eq!(found["model"]["control"].as_array().unwrap().len(), 4);
    let more = flown(&scratch, "more", 31, &[]);
    assert_eq!(diagnose(&more)["verdict"], "none");

    // Nominal flights alone are the control, which must be possible.
    let mut control = bench(["diagnose", "--nominal"]);
    let words = stdout(&control.args(&good).assert().success());
    assert!(words.contains("nominal against nominal: `none` in 4 of 4"), "{words}");
    let mut both = bench(["diagnose", "--nominal"]);
    both.args(&good).arg("--test").args(&good[..1]);
    assert!(refused(both, 2).contains("among the nominal flights"));
    let mut few = bench(["diagnose", "--nominal"]);
    few.args(&good[..3]);
    let words = refused(few, 2);
    assert!(words.contains("3 nominal flights") && words.contains("four or more"), "{words}");
}

#[test]
fn a_model_that_does_not_hold_for_its_own_flights_is_handed_out_to_who_insists() {
    let scratch = Scratch::new();
    let drag = ["--effect", "quadratic-drag:coefficient_n_s2_per_m2=0.06"];
    let mixed = [flown(&scratch, "fine", 1, &[]), flown(&scratch, "draggy", 11, &drag)].concat();
    let out = scratch.name("mixed.toml");
    let identify = |more: &[&str]| {
        let mut command = bench(["identify", "flight", "--rig", "virtual", "-o", &out]);
        command.args(&mixed).args(more);
        command
    };
    let words = refused(identify(&[]), 1);
    assert!(words.contains("mixed.toml is not written") && words.contains("--force"), "{words}");
    assert!(!scratch.path("mixed.toml").exists());
    let words = stdout(&identify(&["--force"]).assert().success());
    assert!(words.contains("draggy-11.mcap: quadratic-drag"), "{words}");
    // What is wrong with the model goes with it.
    let text = std::fs::read_to_string(scratch.path("mixed.toml")).unwrap();
    assert!(text.contains("[[held_out]]") && text.contains("hypothesis = \"quadratic-drag\""), "{text}");
}
