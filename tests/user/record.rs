use std::fs;

use crate::support::{Scratch, bench, json, refused, stdout, unclosed};

#[test]
fn info_says_what_was_recorded() {
    let scratch = Scratch::new();
    let out = scratch.fly("a.mcap", &["--seed", "5"]);
    let info = json(&bench(["info", &out, "--json"]).assert().success());
    assert_eq!(info["schema"], "bench.info/1");
    assert_eq!((&info["seed"], &info["mission"]), (&5.into(), &"climb-040".into()));
    let count = |name: &str| {
        let channels = info["channels"].as_array().unwrap();
        channels.iter().find(|c| c["name"] == name).and_then(|c| c["messages"].as_u64()).unwrap_or(0)
    };
    // One of each an iteration; the tracker at three frames an iteration, less what is lost or still on its way.
    let ticks = count("/loop/tick");
    assert!((220..=250).contains(&ticks), "{ticks}");
    assert_eq!([count("/control/command"), count("/dac/readback"), count("/control/state")], [ticks; 3]);
    assert!((2 * ticks..=3 * ticks).contains(&count("/tracker/position")));
    assert!(count("/plant/truth") > 4 * ticks);
    let words = stdout(&bench(["info", &out]).assert().success());
    assert!(words.contains("rig.toml") && words.contains("mission.toml"), "{words}");
}

#[test]
fn a_cut_recording_gives_back_its_beginning() {
    let scratch = Scratch::new();
    let whole = scratch.fly("whole.mcap", &[]);
    let bytes = fs::read(&whole).unwrap();
    fs::write(scratch.path("cut.mcap"), &bytes[..bytes.len() * 6 / 10]).unwrap();
    let cut = scratch.name("cut.mcap");

    unclosed(&cut);
    assert!(refused(bench(["diff", &whole, &cut]), 2).contains("bench recover"));
    let back = scratch.name("back.mcap");
    let report = json(&bench(["recover", &cut, "-o", &back, "--json"]).assert().code(3));
    let total = json(&bench(["info", &whole, "--json"]).assert().success())["messages"].as_u64().unwrap();
    let recovered = report["messages"].as_u64().unwrap();
    assert!(recovered > total / 3 && recovered < total, "{recovered} of {total}");
    assert_eq!(json(&bench(["info", &back, "--json"]).assert().success())["messages"], recovered);
    // What came back is the flight's beginning, so it can be compared with the whole.
    bench(["diff", &whole, &back, "--json"]).assert().code(vec![0, 1]);

    bench(["recover", &whole, "-o", &scratch.name("again.mcap")]).assert().success();
    let words = refused(bench(["recover", &cut, "-o", &cut, "--force"]), 2);
    assert!(!words.is_empty());
}

#[test]
fn tables_for_spreadsheets_and_data_tools() {
    let scratch = Scratch::new();
    let flight = scratch.fly("a.mcap", &["--export", &scratch.name("sheet.xlsx")]);
    assert!(fs::read(scratch.path("sheet.xlsx")).unwrap().starts_with(b"PK"), "an XLSX file is a zip");
    let table = scratch.name("a.csv");
    bench(["export", &flight, "-o", &table]).assert().success();
    let text = fs::read_to_string(&table).unwrap();
    let header = text.lines().next().unwrap();
    for column in ["time_s", "phase", "truth"] {
        assert!(header.contains(column), "{header}");
    }
    let columns = header.split(',').count();
    assert!(text.lines().all(|line| line.split(',').count() == columns));
    assert!(!text.contains("NaN") && !text.contains("inf"));
    bench(["export", &flight, "-o", &scratch.name("a.parquet")]).assert().success();
    assert!(fs::read(scratch.path("a.parquet")).unwrap().starts_with(b"PAR1"));
    refused(bench(["export", &flight, "-o", &scratch.name("a.doc")]), 2);
    refused(bench(["export", &flight, "-o", &scratch.name("b.csv"), "--channel", "/none"]), 2);
}

#[test]
fn what_is_no_recording_is_refused_in_words() {
    let scratch = Scratch::new();
    fs::write(scratch.path("empty.mcap"), "").unwrap();
    fs::write(scratch.path("text.mcap"), "time,z\n0,0\n").unwrap();
    for name in ["empty.mcap", "text.mcap", "absent.mcap"] {
        let (recording, table) = (scratch.name(name), scratch.name("out.csv"));
        for arguments in [vec!["info", &recording], vec!["export", &recording, "-o", &table]] {
            let words = refused(bench(arguments), 2);
            assert!(words.contains(name), "{words}");
        }
    }
}
