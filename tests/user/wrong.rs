//! Wrong invocations: each ends in one message that says what is wrong, where, and what to do; exit code 2, nothing written, and
//! less than a second of the processor's time.

use std::{
    fs,
    path::Path,
    process::{Command, Output},
};

use crate::support::{Scratch, bench, root};

/// The command, and what its message must hold: where it went wrong, and what to do.
type Wrong = (&'static str, [&'static str; 2]);

const WRONG: &[Wrong] = &[
    // What to fly.
    ("", ["Usage: bench", "Commands:"]),
    ("fly", ["unrecognized subcommand 'fly'", "--help"]),
    ("sim --fast", ["unexpected argument '--fast'", "--help"]),
    ("sim --seed -1", ["--seed", "--help"]),
    ("sim --record-views 5", ["--frames", "--help"]),
    ("sim --frames --record-views 0", ["--record-views", "from 0.01 to 30"]),
    ("sim --epoch yesterday", ["--epoch", "seconds since 1970"]),
    ("sim --mission loop", ["loop", "climb-040"]),
    ("sim --mission hopp", ["hopp", "did you mean hop"]),
    ("sim --mission broken-mission.toml", ["broken-mission.toml:4", "expected"]),
    ("sim --mission rig.toml", ["rig.toml is a rig", "--rig"]),
    ("sim --rig none.toml", ["none.toml", "bench rigs"]),
    ("sim --rig vitual", ["vitual", "did you mean virtual"]),
    ("sim --rig elsewhere/virtual.toml", ["elsewhere/virtual.toml", "Its name is virtual"]),
    ("sim --rig folder", ["folder is a folder", "name the file"]),
    ("sim --rig mission.toml", ["mission.toml is a mission", "--mission"]),
    ("sim --rig unknown-key.toml", ["unknown-key.toml:11: unknown key `loop.period_ms`", "did you mean"]),
    ("sim --rig wrong-type.toml", ["wrong-type.toml:11: `loop.period_s`", "expected a number"]),
    ("sim --rig out-of-range.toml", ["out-of-range.toml:11: `loop.period_s`", "expected a number"]),
    ("sim --rig no-airframe.toml", ["no-airframe.toml:3", "folder"]),
    ("sim --rig syntax.toml", ["syntax.toml:1", "expected"]),
    ("sim --rig unknown-effect.toml", ["unknown-effect.toml", "bench effects"]),
    ("sim --effect rotor-lak:time_constant_s=1", ["rotor-lak", "rotor-lag"]),
    ("sim --effect rotor-lag", ["rotor-lag", "time_constant_s"]),
    ("sim --effect rotor-lag:tau=1", ["`tau`", "time_constant_s"]),
    ("sim --effect rotor-lag:time_constant_s=99", ["time_constant_s", "expected"]),
    ("sim --effect rotor-lag:time_constant_s=fast", ["fast", "NAME:param=value"]),
    ("sim --effect rotor-lag:time_constant_s=nan", ["time_constant_s", "expected"]),
    ("sim --frames --mission hold-3d", ["hold-3d", "choose another mission"]),
    ("sim --frames --rig loopback", ["loopback", "bench calibrate"]),
    ("sim --views views", ["--frames", "--help"]),
    ("sim --realtime", ["--live", "--help"]),
    ("sim --listen 127.0.0.1:8081", ["--live", "--help"]),
    ("sim --live --listen 8080", ["127.0.0.1:8080", "--help"]),
    ("sim --live --listen 192.0.2.1:8080", ["192.0.2.1:8080", "--listen"]),
    ("hil --autostart --port /dev/null", ["--live", "--help"]),
    ("hil --rig loopback", ["port", "--port"]),
    ("hil --port /dev/null --rig virtual", ["virtual", "bench sim"]),
    (
        "hil --port /dev/null --effect loop-overrun:probability=0.1,mean_s=0.1",
        ["loop-overrun", "bench emulate psoc5"],
    ),
    // Where to write.
    ("sim -o flight.mcap", ["flight.mcap exists", "--force"]),
    ("sim -o folder", ["folder is a folder", "name a file"]),
    ("sim -o /proc/x.mcap", ["/proc/x.mcap", "cannot write"]),
    ("sim -o flight.mcap/x.mcap", ["flight.mcap/x.mcap", "not a folder"]),
    ("sim -o new.csv", ["new.csv", ".mcap"]),
    ("sim -o new.mcap --export new.doc", ["new.doc", ".csv, .xlsx, .parquet"]),
    ("sim -o new.mcap --export table.csv", ["table.csv exists", "--force"]),
    ("sim -o new.mcap --frames --views flight.mcap", ["flight.mcap is not a folder", "name one"]),
    ("tune --rig crazyflie-2 -o rig.toml", ["rig.toml exists", "--force"]),
    ("tune --rig crazyflie-2 -o new.toml --html /proc/x.html", ["/proc/x.html", "cannot write"]),
    ("tune --rig crazyflie-2 -o new.toml --html new.pdf", ["new.pdf", ".html"]),
    ("tune --rig crazyflie-2 -o new.toml --rms=-1", ["--rms", "above 0"]),
    ("laws virtual virtual-model -o rig.toml", ["rig.toml", ".md"]),
    ("laws virtual virtual-model --models 0", ["--models 0", "at least 1"]),
    ("paper -o folder", ["folder is not empty", "--force"]),
    ("rigs copy virtuel", ["virtuel", "bench rigs"]),
    ("rigs copy hop", ["hop", "missions/hop"]),
    // Recordings.
    ("info none.mcap", ["none.mcap", "cannot"]),
    ("diff flight.mcap", ["<B>", "--help"]),
    ("diff flight.mcap none.mcap", ["none.mcap", "cannot"]),
    ("diff flight.mcap text.mcap", ["text.mcap", "bench import"]),
    ("diff flight.mcap cut.mcap", ["cut.mcap", "bench recover"]),
    ("diff flight.mcap other.mcap --align best", ["best", "possible values"]),
    ("diff flight.mcap other.mcap --abs position_m.z", ["position_m.z", "FIELD=NUMBER"]),
    ("diff flight.mcap other.mcap --html /proc/x.html", ["/proc/x.html", "cannot write"]),
    ("diff flight.mcap other.mcap --html page.html", ["page.html exists", "--force"]),
    ("diff flight.mcap other.mcap --exact --ignore pixel.*", ["--exact", "--help"]),
    ("export flight.mcap -o flight.mcap", ["flight.mcap", ".csv, .xlsx, .parquet"]),
    ("export flight.mcap -o new.csv --channel /plant/none", ["/plant/none", "/plant/truth"]),
    ("export empty.mcap -o new.csv", ["empty.mcap", "empty"]),
    ("recover cut.mcap -o cut.mcap", ["cut.mcap is an input", "name another"]),
    ("import --map none log.csv -o new.mcap", ["none", "crazypad"]),
    ("import --map crazypad log.csv -o new.mcap", ["log.csv", "column"]),
    ("import --map foreign none.csv -o new.mcap", ["none.csv", "cannot"]),
    ("import --map foreign log.csv -o log.csv", ["log.csv", ".mcap"]),
    ("report", ["<RECORDINGS>", "--help"]),
    ("report none.mcap", ["none.mcap", "cannot"]),
    ("report flight.mcap -o page.html", ["page.html exists", "--force"]),
    ("report flight.mcap -o new.pdf", ["new.pdf", ".html"]),
    ("report text.mcap -o new.html", ["text.mcap", "bench import"]),
    ("report flight.mcap -o new.html --diff", ["--diff", "name two"]),
    ("report flight.mcap -o new.html --rig virtual", ["--rig", "--diagnose"]),
    ("report flight.mcap -o new.html --verify --rig crazyflie-2", ["flight.mcap", "leave --rig out"]),
    // What they are held against.
    ("diagnose", ["<FLIGHTS>", "--help"]),
    ("diagnose none.mcap", ["none.mcap", "cannot"]),
    ("diagnose flight.mcap --rig crazyflie-2", ["flight.mcap", "leave --rig out"]),
    ("diagnose flight.mcap loopback.mcap", ["different rigs", "diagnose them apart"]),
    ("diagnose flight.mcap --html page.txt", ["page.txt", ".html"]),
    ("diagnose flight.mcap --write-rig rig.toml", ["rig.toml exists", "--force"]),
    ("diagnose flight.mcap --above -1", ["--above", "--help"]),
    ("diagnose flight.mcap --without radio", ["radio", "possible values"]),
    ("diagnose flight.mcap --between none,gusts", ["--next-flight", "--help"]),
    ("diagnose flight.mcap --next-flight new.toml --between gusts", ["--between", "two hypotheses"]),
    ("diagnose flight.mcap --calibrate 3", ["--calibrate 3", "at least 50"]),
    ("verify flight.mcap --tolerance 0", ["--tolerance", "above 0"]),
    ("verify flight.mcap --inside 2", ["--inside", "0 to 1"]),
    ("verify flight.mcap --rig crazyflie-2", ["flight.mcap", "leave --rig out"]),
    ("identify flight flight.mcap -o rig.toml", ["rig.toml exists", "--force"]),
    ("identify thrust none.csv --rig virtual -o new.toml", ["none.csv", "cannot"]),
    ("identify thrust log.csv --rig virtual -o new.toml", ["log.csv", "throttle_v"]),
    ("track folder --rig virtual", ["INDEX.txt", "cannot"]),
    ("calibrate log.csv -o new.toml", ["log.csv", "folder"]),
    ("emulate balance --outliers 2", ["--outliers", "from 0 to 1"]),
    ("record-frames --mission hop", ["--output", "--help"]),
    ("blind seal --cases 1 -o sealed --key sealed/key.json", ["sealed/key.json", "name a place outside"]),
    ("blind open none --key none.json --answers none.json", ["none", "cannot"]),
];

/// Files that the invocations name.
fn fixtures(scratch: &Scratch) {
    scratch.fly("flight.mcap", &["--mission", "hop"]);
    scratch.fly("other.mcap", &["--mission", "hop", "--seed", "1"]);
    scratch.fly("loopback.mcap", &["--mission", "hop", "--rig", "loopback"]);
    let flight = fs::read(scratch.path("flight.mcap")).unwrap();
    let rig = fs::read_to_string(root().join("rigs/virtual.toml")).unwrap();
    let put = |name: &str, text: &str| fs::write(scratch.path(name), text).unwrap();
    fs::write(scratch.path("cut.mcap"), &flight[..flight.len() / 2]).unwrap();
    put("empty.mcap", "");
    put("text.mcap", "not a recording\n");
    put("table.csv", "kept\n");
    put("page.html", "kept\n");
    put("log.csv", "a,b\n1,2\n");
    fs::create_dir(scratch.path("folder")).unwrap();
    put("folder/file", "kept\n");
    let airframe = fs::read_to_string(root().join("rigs/airframes/hubsan-q4.toml")).unwrap();
    fs::create_dir(scratch.path("airframes")).unwrap();
    put("airframes/hubsan-q4.toml", &airframe);
    put("rig.toml", &rig);
    put("unknown-key.toml", &rig.replace("period_s = 0.1 ", "period_ms = 100 "));
    put("wrong-type.toml", &rig.replace("period_s = 0.1 ", "period_s = \"0.1\" "));
    put("out-of-range.toml", &rig.replace("period_s = 0.1 ", "period_s = -0.1 "));
    put("no-airframe.toml", &rig.replace("airframes/hubsan-q4.toml", "airframes/none.toml"));
    put("unknown-effect.toml", &(rig.clone() + "\n[[effect]]\nname = \"rotor-lak\"\n"));
    put("syntax.toml", "name = \n");
    let mission = fs::read_to_string(root().join("rigs/missions/hop.toml")).unwrap();
    put("mission.toml", &mission);
    put(
        "broken-mission.toml",
        "name = \"broken\"\ndescription = \"no such kind\"\n[[phase]]\nkind = \"loop\"\nduration_s = 1\n",
    );
}

/// Runs with a limit of one second of the processor's time, past which the system ends it: no clock on the wall.
fn run(scratch: &Scratch, command: &str) -> Output {
    Command::new("sh")
        .args(["-c", "ulimit -t 1; exec \"$0\" \"$@\"", env!("CARGO_BIN_EXE_bench")])
        .args(command.split_whitespace())
        .env("XDG_CACHE_HOME", scratch.path("cache"))
        .current_dir(scratch.path(""))
        .output()
        .unwrap()
}

/// Every file and folder below, with its bytes.
fn contents(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                found.push((path.display().to_string(), Vec::new()));
                folders.push(path);
            } else {
                found.push((path.display().to_string(), fs::read(&path).unwrap()));
            }
        }
    }
    found.sort();
    found
}

#[test]
fn sixty_wrong_invocations_say_what_is_wrong_and_what_to_do() {
    let scratch = Scratch::new();
    fixtures(&scratch);
    let mut before = contents(&scratch.path(""));
    let mut faults = Vec::new();
    for (command, [place, advice]) in WRONG {
        let output = run(&scratch, command);
        let words = String::from_utf8_lossy(&output.stderr).into_owned();
        let mut fault = |what: &str| faults.push(format!("bench {command}\n  {what}; it said:\n{words}"));
        if output.status.code() != Some(2) {
            fault(&format!("ended with {}", output.status));
        }
        if !output.stdout.is_empty() {
            fault("wrote to standard output");
        }
        if !command.is_empty() && words.lines().filter(|line| line.starts_with("error:")).count() != 1 {
            fault("is not one message");
        }
        for (what, expected) in [("where", place), ("what to do", advice)] {
            if !words.contains(expected) {
                fault(&format!("does not say {what} ({expected:?})"));
            }
        }
        let after = contents(&scratch.path(""));
        if after != before {
            fault("wrote something");
            before = after;
        }
    }
    assert!(faults.is_empty(), "{} of {}:\n\n{}", faults.len(), WRONG.len(), faults.join("\n"));
    assert!(WRONG.len() >= 60);
}

#[test]
fn the_limit_on_the_processors_time_would_be_noticed() {
    let scratch = Scratch::new();
    let endless = Command::new("sh").args(["-c", "ulimit -t 1; while :; do :; done"]).output().unwrap();
    assert_ne!(endless.status.code(), Some(2));
    // Nothing of the table is wrong for want of the program.
    bench(["--version"]).current_dir(scratch.path("")).assert().success();
}
