//! Every example of the help, the documentation and the README, run as it stands in a folder of its own, with its exit code checked.
//! Examples that take long are in the test named `slow_`, which is marked `ignored`: tests/run runs it with an optimised program, which
//! `BENCH_PROGRAM` names.

use std::{
    collections::BTreeSet,
    fs,
    os::unix::fs::PermissionsExt as _,
    path::{Path, PathBuf},
    process::Command,
};

use crate::support::{Scratch, bench, root, stdout};

/// Examples that no test can run, by a part of them, and why.
const NOT_RUN: &[(&str, &str)] = &[
    ("/dev/ttyACM0", "needs a board; tests/user/hil flies emulated ones"),
    ("--port /tmp/psoc5", "flies for 20 s of real time; tests/user/hil/pty.rs flies it"),
    ("bench emulate psoc5", "runs until it is stopped; tests/user/hil/pty.rs uses it"),
    ("--live", "waits for START in a browser; tests/browser and tests/user/live.rs press it"),
    ("--foxglove", "needs a program built with a server for Foxglove; tests/user/foxglove.rs is its viewer"),
    ("sudo bench udev --install", "changes the system; tests/user/packaging.rs installs into another folder"),
    ("--kinect 0", "needs a Kinect; tests/user/hil/usb.rs has an emulated one"),
    ("--map crazypad --above", "needs published flights; tests/user/own_logs.rs runs it where they are"),
    ("--map nanobench --rig", "needs published flights; tests/user/own_logs.rs runs it where they are"),
    (
        "--model sim-*.ulg --test real-*.ulg",
        "needs logs of whole flights; tests/user/own_logs.rs flies them and runs it",
    ),
    (
        "/shared/",
        "needs a folder that several machines share; tests/user/sweep.rs runs shards, tests/slurm a cluster",
    ),
    ("sweep replay", "names a run of the reader's own; tests/user/sweep.rs replays one"),
    ("kubectl", "needs a cluster"),
    ("duckdb", "needs another program; tests/user/sweep.py uses its library"),
    ("hil.mcap", "is recorded by the example before, which needs a board"),
];

/// Examples that take long, by a part of them.
const SLOW: &[&str] = &[
    "bench diagnose",
    "--diagnose",
    "bench blind",
    "bench sweep run robustness",
    "bench tune",
    "bench laws",
    "bench paper",
    "bench identify flight",
    "--frames",
    "bench record-frames",
    "bench track",
    "bench calibrate",
    // They go on with what the ones above make.
    "my-quad-tuned.toml",
    "--mission next.toml",
    "--rig my-quad.toml hop-*.mcap --html verify.html",
];

/// What is put in place of a part of examples that would take many minutes, so that they take seconds.
const SHORTENED: &[(&str, &str)] = &[
    ("--cases 300", "--cases 2"),
    ("--cases 60", "--cases 2"),
    ("bench blind power", "bench blind power --draws 1 --effect gusts"),
    ("bench tune", "bench tune --models 40 --scan 30 --refine 15 --check 200"),
    ("--calibrate ", "--calibrate 50 "),
    ("bench laws", "bench laws --models 4"),
];

/// Examples that end with another exit code than 0, by a part of them, and why.
const ENDS_WITH: &[(&str, i32, &str)] = &[
    ("--floor lab-1.mcap", 0, "they differ by no more than such flights do"),
    ("bench diff recordings/virtual_climb-040_seed0.mcap lag.mcap", 1, "a lag makes a difference"),
    (
        "bench diff recordings/virtual_climb-040_seed0.mcap tired.mcap",
        1,
        "a tired battery makes a difference",
    ),
    ("hop-*.mcap --tolerance 0.03", 1, "the tolerances of that copy are too wide for hops to tell anything"),
    ("bench recover cut.mcap", 3, "the end was lost"),
    ("-o what-if/", 1, "the suite notices what was added"),
];

/// What an example needs, by a part of it, and the commands that make it.
const FIXTURES: &[(&str, &str)] = &[
    ("my-quad.toml", "bench rigs copy virtual -o my-quad.toml"),
    ("my-rig.toml", "bench rigs copy virtual -o my-rig.toml"),
    ("draft.toml", "bench rigs copy airframes/hubsan-q4 -o draft.toml"),
    ("my-quad-2.toml", "bench rigs copy virtual -o my-quad-2.toml"),
    ("with-thrust.toml", "bench rigs copy virtual -o with-thrust.toml"),
    ("flight.mcap", "bench sim -o flight.mcap"),
    ("flight.csv", "bench sim -o flown.mcap && bench export flown.mcap -o flight.csv"),
    ("lab.mcap", "bench sim --seed 1 -o lab.mcap"),
    ("sim.mcap", "bench sim -o sim.mcap"),
    ("reference.mcap", "bench sim --seed 1 -o reference.mcap"),
    ("sim-again.mcap", "bench sim -o sim-again.mcap"),
    ("lab-1.mcap", "for s in 1 2 3; do bench sim --seed $s -o lab-$s.mcap; done"),
    ("flight-*.mcap", FLIGHTS_WITH_A_LAG),
    ("flight-1.mcap", FLIGHTS_WITH_A_LAG),
    ("log-*.mcap", "for s in 1 2; do bench sim --seed $s -o log-$s.mcap; done"),
    ("other-*.mcap", "for s in 4 5; do bench sim --seed $s -o other-$s.mcap; done"),
    (
        "good/*.mcap",
        "mkdir -p good bad && for s in 1 2 3 4; do bench sim --model vertical --seed $s -o good/$s.mcap; bench sim --model vertical --effect rotor-lag:time_constant_s=0.12 --seed 9$s -o bad/$s.mcap; done",
    ),
    ("nominal-*.mcap", "for s in 1 2 3; do bench sim --model vertical --seed $s -o nominal-$s.mcap; done"),
    ("nominal-*.ulg", "for s in 1 2 3; do cp log.ulg nominal-$s.ulg; done"),
    ("launch-*.mcap", "for s in 1 2 3; do bench sim --model vertical --seed $s -o launch-$s.mcap; done"),
    ("cf-*.mcap", "for s in 1 2 3; do bench sim --rig crazyflie-2 --seed $s -o cf-$s.mcap; done"),
    ("hop-*.mcap", "for s in 1 2; do bench sim --mission hop --seed $s -o hop-$s.mcap; done"),
    ("recordings/virtual_climb-040_seed0.mcap", "bench sim"),
    ("cut.mcap", "bench sim -o whole-flight.mcap && head -c 60000 whole-flight.mcap > cut.mcap"),
    ("readings.csv", "bench emulate balance -o readings.csv"),
    ("ground.csv", "bench emulate balance --ground-effect -o ground.csv"),
    ("frames/", "bench record-frames --mission hop --seconds 2 -o frames/"),
    ("flight/", "bench record-frames --mission steps --from-s 5 --seconds 3 -o flight/"),
    ("calibrate places.csv", "test -d p0 || bench record-frames --positions places.csv --bare --frames 7"),
    ("lab/", "bench test paper --station lab/ --meta operator=Ada --meta battery=3 -o of-the-lab/"),
    (
        "swept/",
        "bench rigs copy sweeps/robustness -o copied.toml && sed -i 's/count = .*}/count = 1 }/' copied.toml && bench sweep run copied.toml -o swept/",
    ),
    ("sealed/", "bench blind seal --cases 2 -o sealed/ --key key.json"),
];

const FLIGHTS_WITH_A_LAG: &str =
    "for s in 1 2 3; do bench sim --effect rotor-lag:time_constant_s=0.12 --seed $s -o flight-$s.mcap; done";

/// Files that examples read, by a part of the example.
const FILES: &[(&str, &str)] = &[
    ("log.csv", LOG),
    ("my-map.toml", MAP),
    ("places.csv", PLACES),
    ("hover.toml", HOVER),
    ("my-plan.toml", PLAN),
];

const PLAN: &str = "name = \"mine\"\ndescription = \"A few flights.\"\nrigs = \"virtual-model\"\nmissions = \"hop\"\n\
                    seeds = { first = 0, count = 8 }\nruns_per_part = 1\n";

const HOVER: &str = "name = \"hover\"\ndescription = \"The airframe hovers.\"\n\n[[case]]\nname = \"climb\"\n\
                     rig = \"virtual\"\nmission = \"climb-040\"\ncompare = \"baseline\"\n";

/// Logs that are no text.
const LOGS: &[(&str, MakeLog)] =
    &[("log.ulg", || crate::logs::short(true)), ("log.bin", crate::logs::short_dataflash)];
type MakeLog = fn() -> Vec<u8>;

const LOG: &str = "time_s,x_m,y_m,z_m,vz_m_s,az_g,roll_deg,thrust_command,motor_pwm,battery_v
0.00,0,0,0.0,0,0,0,0,0,4.0
0.01,0,0,0.1,0,0,0,30000,31000,3.9
0.02,0,0,0.2,0,0,0,30000,31000,3.9
";
const MAP: &str = "name = \"mine\"
[time]
column = \"time_s\"
unit = \"s\"
[position]
latency_s = 0
z = { column = \"z_m\", unit = \"m\" }
";
const PLACES: &str = "folder,x_m,y_m,z_m
p0,-0.9,-0.2,0.4
p1,-0.8,0.2,0.8
p2,-0.2,0.4,0.3
p3,0.0,-0.5,0.9
p4,0.5,0.5,1.0
p5,0.6,-0.4,0.3
p6,0.9,0.0,0.6
";

/// Examples that stand together and may go on with what those before them made.
#[derive(Clone)]
struct Block {
    from: String,
    lines: Vec<String>,
}

/// Words that explain an example in the help stand behind it after some spaces.
fn without_explanation(line: &str) -> &str {
    let line = line.trim();
    line.split_once("   ").map_or(line, |(example, _)| example)
}

/// The help of a command and of all below it.
fn help(path: &[String], blocks: &mut Vec<Block>) {
    let text = stdout(&bench(path).arg("--help").assert().success());
    let mut lines = text.lines().skip_while(|line| !matches!(line.trim(), "Examples:" | "Example:")).skip(1);
    let examples: Vec<String> = lines
        .by_ref()
        .take_while(|line| line.starts_with("  "))
        .map(|line| without_explanation(line).to_owned())
        .collect();
    if !examples.is_empty() {
        blocks.push(Block { from: format!("bench {} --help", path.join(" ")), lines: examples });
    }
    let commands = text.lines().skip_while(|line| *line != "Commands:").skip(1);
    for line in commands.take_while(|line| line.starts_with("  ")) {
        // What goes on from the line above is further in.
        let name = line.strip_prefix("  ").filter(|rest| !rest.starts_with(' '));
        let Some(name) = name.and_then(|rest| rest.split_whitespace().next()) else { continue };
        if name != "help" {
            help(&[path, &[name.to_owned()]].concat(), blocks);
        }
    }
}

fn of_help() -> Vec<Block> {
    let mut blocks = Vec::new();
    help(&[], &mut blocks);
    blocks
}

/// The console blocks of a page.
fn of_page(page: &Path) -> Vec<Block> {
    let text = fs::read_to_string(page).unwrap();
    let mut blocks = Vec::new();
    for part in text.split("```console\n").skip(1) {
        let code = part.split("```").next().unwrap_or_default();
        let lines: Vec<String> =
            code.lines().filter(|line| line.starts_with("bench ")).map(str::to_owned).collect();
        if !lines.is_empty() {
            blocks.push(Block { from: page.display().to_string(), lines });
        }
    }
    blocks
}

fn of_docs() -> Vec<Block> {
    let mut pages: Vec<PathBuf> = fs::read_dir(root().join("docs"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|ending| ending == "md"))
        // `own_logs` runs it, on logs that it flies.
        .filter(|path| path.file_name().is_some_and(|name| name != "your-own-logs.md"))
        .collect();
    pages.sort();
    pages.iter().flat_map(|page| of_page(page)).collect()
}

fn of_readme() -> Vec<Block> {
    of_page(&root().join("README.md"))
}

fn is_run(line: &str) -> bool {
    NOT_RUN.iter().all(|(part, _)| !line.contains(part))
}

fn is_slow(line: &str) -> bool {
    SLOW.iter().any(|part| line.contains(part))
}

/// A shell in a folder that finds `bench`, and stand-ins for a browser, for jq and for man.
pub struct Shell<'a> {
    folder: &'a Path,
    path: String,
}

impl<'a> Shell<'a> {
    pub fn in_folder(scratch: &'a Scratch, folder: &'a Path) -> Self {
        let tools = scratch.path("tools");
        fs::create_dir_all(&tools).unwrap();
        for name in ["xdg-open", "jq", "man"] {
            let tool = tools.join(name);
            fs::write(&tool, "#!/bin/sh\ntest -t 0 || cat > /dev/null\n").unwrap();
            fs::set_permissions(&tool, fs::Permissions::from_mode(0o755)).unwrap();
        }
        // Folders that a home with these shells has.
        for home in [".local/share/bash-completion/completions", ".zfunc", ".config/fish/completions"] {
            fs::create_dir_all(folder.join(home)).unwrap();
        }
        let program = std::env::var_os("BENCH_PROGRAM").unwrap_or_else(|| env!("CARGO_BIN_EXE_bench").into());
        std::os::unix::fs::symlink(root().join(program), tools.join("bench")).unwrap();
        let path = std::env::var("PATH").unwrap_or_default();
        Self { folder, path: format!("{}:{path}", tools.display()) }
    }

    /// Exit code and what was said.
    pub fn run(&self, line: &str) -> (Option<i32>, String) {
        let output = Command::new("bash")
            .args(["-o", "pipefail", "-c", line])
            .current_dir(self.folder)
            .env("PATH", &self.path)
            // What an example writes into the home folder stays in this one.
            .env("HOME", self.folder)
            .env_remove("XDG_CACHE_HOME")
            .env_remove("XDG_DATA_HOME")
            .stdin(std::process::Stdio::null())
            .output()
            .unwrap();
        let said = [output.stdout, output.stderr].map(|text| String::from_utf8_lossy(&text).into_owned());
        (output.status.code(), said.concat())
    }
}

/// Makes what a line reads and what neither is there nor made by a line before.
fn set_up(shell: &Shell<'_>, line: &str, faults: &mut Vec<String>) {
    let reads = |part: &str| {
        // What stands behind -o is made by the example itself.
        line.match_indices(part).any(|(at, _)| {
            let before = line[..at].trim_end();
            let whole_word = !before.is_empty() && line[..at].ends_with([' ', '=']);
            (whole_word || part.contains(' ')) && !before.ends_with("-o") && !before.ends_with("--csv")
        })
    };
    for (part, text) in FILES {
        let file = shell.folder.join(part);
        if reads(part) && !file.exists() {
            fs::write(file, text).unwrap();
        }
    }
    for (part, make) in LOGS {
        if reads(part) {
            fs::write(shell.folder.join(part), make()).unwrap();
        }
    }
    for (part, make) in FIXTURES {
        let is_there = match part.split_once('*') {
            Some((start, _)) => fs::read_dir(shell.folder)
                .unwrap()
                .any(|entry| entry.unwrap().file_name().to_string_lossy().starts_with(start)),
            None => shell.folder.join(part).exists(),
        };
        if reads(part) && !is_there {
            let (code, said) = shell.run(make);
            // Flights may miss their mission's criteria; they are recorded all the same.
            if !matches!(code, Some(0 | 1)) {
                faults.push(format!("to set up {part}: {make}: {code:?}\n{said}"));
            }
        }
    }
}

fn shortened(line: &str) -> String {
    SHORTENED.iter().fold(line.to_owned(), |line, (part, shorter)| line.replace(part, shorter))
}

/// Runs blocks, each in a folder of its own: the lines that `wanted` picks, in their order.
fn run<'a>(blocks: impl IntoIterator<Item = &'a Block>, wanted: impl Fn(&str) -> bool) {
    let mut faults = Vec::new();
    let mut ran = 0;
    for block in blocks {
        let scratch = Scratch::new();
        let folder = scratch.path("empty");
        fs::create_dir(&folder).unwrap();
        let shell = Shell::in_folder(&scratch, &folder);
        for line in block.lines.iter().filter(|line| is_run(line) && wanted(line)) {
            set_up(&shell, line, &mut faults);
            let expected =
                ENDS_WITH.iter().find(|(part, ..)| line.contains(part)).map_or(0, |(_, code, _)| *code);
            let began = std::time::Instant::now();
            let (code, said) = shell.run(&shortened(line));
            ran += 1;
            eprintln!("{}: {line}: {code:?}, {:.1} s", block.from, began.elapsed().as_secs_f64());
            if code != Some(expected) || said.contains("panicked") {
                faults.push(format!("{}: {line}: {code:?}, expected {expected}\n{said}", block.from));
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n\n"));
    assert!(ran > 0, "nothing was run");
}

#[test]
fn examples_of_the_help_run_in_an_empty_folder() {
    run(&of_help(), |line| !is_slow(line));
}

#[test]
fn examples_of_the_documentation_run_in_an_empty_folder() {
    run(&of_docs(), |line| !is_slow(line));
}

#[test]
fn examples_of_the_readme_run_in_an_empty_folder() {
    run(&of_readme(), |line| !is_slow(line));
}

#[test]
#[ignore = "takes minutes; tests/run runs it"]
fn slow_examples_run_in_an_empty_folder() {
    let all = [of_help(), of_docs(), of_readme()].concat();
    // What stands before a long example may make what it reads.
    run(all.iter().filter(|block| block.lines.iter().any(|line| is_run(line) && is_slow(line))), |_| true);
}

#[test]
fn every_command_has_examples_and_no_exception_is_stale() {
    let all = [of_help(), of_docs(), of_readme()].concat();
    let lines: Vec<&str> = all.iter().flat_map(|block| &block.lines).map(String::as_str).collect();
    let named = NOT_RUN
        .iter()
        .map(|(part, _)| *part)
        .chain(SLOW.iter().copied())
        .chain(SHORTENED.iter().map(|(part, _)| *part))
        .chain(ENDS_WITH.iter().map(|(part, ..)| *part))
        .chain(FIXTURES.iter().chain(FILES).map(|(part, _)| *part));
    for part in named {
        assert!(
            lines.iter().any(|line| line.contains(part)),
            "no example has {part:?} any more: take it out"
        );
    }
    let words: BTreeSet<&str> = lines.iter().filter_map(|line| line.split_whitespace().nth(1)).collect();
    let commands = stdout(&bench(["help"]).assert().success());
    let commands = commands.lines().skip_while(|line| *line != "Commands:").skip(1);
    for line in commands.take_while(|line| line.starts_with("  ")) {
        let Some(name) = line.strip_prefix("  ").filter(|rest| !rest.starts_with(' ')) else { continue };
        let name = name.split_whitespace().next().unwrap();
        assert!(name == "help" || words.contains(name), "no example flies `bench {name}`");
    }
}
