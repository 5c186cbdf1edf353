use std::{fmt::Write as _, fs};

use crate::support::{Scratch, bench, json, refused};

/// A log of the shape of `rigs/import/foreign.toml`, with two bad rows.
fn log(scratch: &Scratch) -> String {
    let mut text = String::from("time_s,phase,throttle_cmd_v,throttle_readback_v,z_m\n");
    for k in 0..100 {
        let t = f64::from(k) * 0.1;
        let phase = if k < 10 { "idle" } else { "open" };
        writeln!(text, "{t:.4},{phase},1.9,1.9,{:.3}", 0.01 * f64::from(k)).unwrap();
    }
    text += "10.0,open,nan,1.9,0.5\n9.0,open,1.9,1.9,0.5\n";
    fs::write(scratch.path("log.csv"), text).unwrap();
    scratch.name("log.csv")
}

#[test]
fn a_log_becomes_a_recording_like_any_other() {
    let scratch = Scratch::new();
    let (log, out) = (log(&scratch), scratch.name("log.mcap"));
    let report = json(
        &bench(["import", "--map", "rigs/import/foreign.toml", &log, "-o", &out, "--json"])
            .assert()
            .success(),
    );
    assert_eq!(
        (&report["schema"], &report["rows"], &report["used"]),
        (&"bench.import/1".into(), &102.into(), &100.into())
    );
    assert_eq!(json(&bench(["info", &out, "--json"]).assert().success())["mode"], "import");
    bench(["diff", &out, &out]).assert().success();
    bench(["export", &out, "-o", &scratch.name("log.csv2.csv")]).assert().success();
    // An import is not replaced unasked.
    refused(bench(["import", "--map", "rigs/import/foreign.toml", &log, "-o", &out]), 2);
}

#[test]
fn a_log_that_does_not_fit_its_map_is_refused_and_leaves_nothing() {
    let scratch = Scratch::new();
    let out = scratch.name("x.mcap");
    fs::write(scratch.path("empty.csv"), "").unwrap();
    fs::write(scratch.path("other.csv"), "a,b\n1,2\n").unwrap();
    for name in ["empty.csv", "other.csv", "absent.csv"] {
        let words = refused(
            bench(["import", "--map", "rigs/import/foreign.toml", &scratch.name(name), "-o", &out]),
            2,
        );
        assert!(words.contains(name), "{words}");
        assert!(!scratch.path("x.mcap").exists());
    }
}
