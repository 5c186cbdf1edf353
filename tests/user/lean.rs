//! The program of README's first command, built without the parts that the first flight does without. `BENCH_LEAN` names it.

use std::{env, ffi::OsStr, fs};

use assert_cmd::Command;

use crate::support::{Scratch, bench, stdout};

fn lean<I: IntoIterator<Item = S>, S: AsRef<OsStr>>(scratch: &Scratch, arguments: I) -> Command {
    let mut command = Command::new(env::var_os("BENCH_LEAN").expect("BENCH_LEAN names a lean program"));
    command.current_dir(scratch.path("")).args(arguments);
    command
}

#[test]
#[ignore = "needs a program built without the default features, named by BENCH_LEAN"]
fn lean_flies_records_compares_and_diagnoses_as_the_whole_program_does() {
    let scratch = Scratch::new();
    let lag = ["--effect", "rotor-lag:time_constant_s=0.08"];
    lean(&scratch, ["sim", "-o", "plain.mcap"]).assert().success();
    lean(&scratch, ["sim", "-o", "lag.mcap"]).args(lag).assert().success();
    for (name, effects) in [("plain", &[][..]), ("lag", &lag[..])] {
        scratch.fly(&format!("whole-{name}.mcap"), effects);
        let [own, whole] =
            ["", "whole-"].map(|by| fs::read(scratch.path(&format!("{by}{name}.mcap"))).unwrap());
        assert!(own == whole, "{name}: both programs record the same bytes");
    }

    let compare = ["diff", "plain.mcap", "lag.mcap"];
    let own = lean(&scratch, compare).assert().code(1);
    assert_eq!(stdout(&own), stdout(&bench(compare).current_dir(scratch.path("")).assert().code(1)));
    let diagnose = ["diagnose", "lag.mcap"];
    let own = lean(&scratch, diagnose).assert().success();
    assert_eq!(stdout(&own), stdout(&bench(diagnose).current_dir(scratch.path("")).assert().success()));
    lean(&scratch, ["export", "plain.mcap", "-o", "plain.csv"]).assert().success();
    lean(&scratch, ["report", "plain.mcap", "-o", "plain.html"]).assert().success();
    let rigs = lean(&scratch, ["rigs"]).assert().success();
    assert_eq!(stdout(&rigs), stdout(&bench(["rigs"]).assert().success()));
}

/// What is asked of it, and the feature that brings it.
const LACKING: &[(&str, &str)] = &[
    ("blind seal", "studies"),
    ("calibrate --help", "lab"),
    ("check plain.mcap", "lab,studies"),
    ("devices", "lab"),
    ("emulate psoc5", "lab"),
    ("hil --port /dev/ttyACM0", "lab"),
    ("identify flight plain.mcap", "studies"),
    ("import log.ulg -o new.mcap", "exchange"),
    ("laws virtual virtual-model", "studies"),
    ("paper", "studies"),
    ("record-frames", "lab"),
    ("rig from-log log.ulg", "exchange"),
    ("runs", "lab"),
    ("schema rig", "lab,studies"),
    ("sweep run robustness", "studies"),
    ("test paper", "lab"),
    ("track frames", "lab"),
    ("tune", "studies"),
    ("sim --live -o new.mcap", "lab"),
    ("sim -o new.mcap --export new.xlsx", "exchange"),
    ("export plain.mcap -o new.parquet", "exchange"),
    ("diagnose log.ulg --rig virtual", "exchange"),
    ("diagnose plain.mcap --nominal log.ulg", "exchange"),
    ("diagnose plain.mcap --calibrate", "studies"),
];

#[test]
#[ignore = "needs a program built without the default features, named by BENCH_LEAN"]
fn lean_says_in_one_line_what_it_lacks_and_how_that_comes() {
    let scratch = Scratch::new();
    scratch.fly("plain.mcap", &[]);
    fs::write(scratch.path("log.ulg"), b"ULog\x01\x12\x35\x01\0\0\0\0\0\0\0\0").unwrap();
    for (asked, feature) in LACKING {
        let refused = lean(&scratch, asked.split(' ')).arg("--quiet").assert().code(2);
        let said = String::from_utf8_lossy(&refused.get_output().stderr).into_owned();
        assert_eq!(said.lines().count(), 1, "{asked}: {said}");
        assert!(
            said.ends_with(&format!("without --no-default-features, or with --features {feature}\n")),
            "{asked}: {said}"
        );
        assert!(stdout(&refused).is_empty(), "{asked}");
    }
    let mut left: Vec<_> =
        fs::read_dir(scratch.path("")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    left.sort();
    assert_eq!(left, ["log.ulg", "plain.mcap"], "nothing is written");
}

#[test]
#[ignore = "needs a program built without the default features, named by BENCH_LEAN"]
fn lean_lists_every_command_of_the_whole_program() {
    let names = |help: &str| -> Vec<String> {
        let commands = help.lines().skip_while(|line| *line != "Commands:").skip(1);
        let commands = commands.take_while(|line| !line.is_empty()).filter(|line| !line.starts_with("   "));
        commands.filter_map(|line| line.split_whitespace().next()).map(str::to_owned).collect()
    };
    let [own, whole] = [lean(&Scratch::new(), ["--help"]), bench(["--help"])]
        .map(|mut command| names(&stdout(&command.assert().success())));
    assert!(own.len() > 20, "{own:?}");
    assert_eq!(own, whole);
}
