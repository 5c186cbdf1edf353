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
