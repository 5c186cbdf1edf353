//! `bench test` and `bench runs`: suites with every result, baselines, pairs of modes, a station's log, and a suite that is killed.

use std::{
    fs,
    io::{BufReader, Read as _, Write as _},
    path::Path,
    process::{Child, Command, Stdio},
    time::{Duration, Instant},
};

use serde_json::Value;
use serialport::SerialPort as _;

use crate::{
    hil::{Emulated, short_mission},
    support::{Page, Scratch, bench, json, refused, stdout},
};

/// A suite with a case for each result. What is flaky is so by its limit, which lies between the peaks of its repeats.
const ALL_RESULTS: &str = r#"
name = "all results"
description = "One case for each result."
port = "/dev/no-such-board"

[[case]]
name = "passes"
rig = "virtual"
mission = "climb-040"
tags = ["quick"]
requirements = ["R-1: it climbs", "R-2: <it> \"settles\" & stays"]

[[case]]
name = "fails"
rig = "virtual"
mission = "climb-040"
requirements = ["R-1: it climbs"]

[case.limits]
peak_max_m = 0.1

[[case]]
name = "errs"
rig = "loopback"
mission = "climb-040"
mode = "loopback"

[[case]]
name = "flaky"
rig = "virtual"
mission = "climb-040"
repeats = 4

[case.limits]
peak_max_m = PEAK
"#;

fn write(scratch: &Scratch, name: &str, text: &str) -> String {
    fs::write(scratch.path(name), text).unwrap();
    scratch.name(name)
}

fn read(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

/// The peaks of the repeats that the flaky case flies, in metres: the seeds are those of docs/suite.md.
fn peaks(scratch: &Scratch) -> Vec<f64> {
    let peak = |seed: u32| {
        let file = scratch.name(&format!("peak-{seed}.mcap"));
        let told = json(&bench(["sim", "--seed", &seed.to_string(), "-o", &file, "--json"]).assert());
        told["summary"]["peak_m"].as_f64().unwrap()
    };
    let mut peaks: Vec<f64> = [0, 1000, 2000, 3000].map(peak).to_vec();
    peaks.sort_by(f64::total_cmp);
    peaks
}

#[test]
fn every_result_is_told_in_every_report() {
    let scratch = Scratch::new();
    let peaks = peaks(&scratch);
    let between = f64::midpoint(peaks[1], peaks[2]);
    assert!(peaks[1] < peaks[2], "two of four peaks are to be below the limit: {peaks:?}");
    let suite = write(&scratch, "all.toml", &ALL_RESULTS.replace("PEAK", &between.to_string()));
    let (results, summary) = (scratch.name("results"), scratch.name("step.md"));
    fs::write(&summary, "before\n").unwrap();
    let assert = bench(["test", &suite, "-o", &results, "--json", "--meta", "operator=Ada & Bob"])
        .env("GITHUB_STEP_SUMMARY", &summary)
        .assert()
        .code(4);
    let report = json(&assert);
    let outcomes: Vec<_> =
        report["tests"].as_array().unwrap().iter().map(|test| test["outcome"].as_str().unwrap()).collect();
    assert_eq!(outcomes, ["passed", "failed", "error", "flaky"]);
    assert_eq!(report["tests"][3]["counts"]["passed"], 2);
    assert_eq!(report["tests"][3]["runs"].as_array().unwrap().len(), 4, "every flight is there");
    let reason = report["tests"][2]["runs"][0]["reason"].as_str().unwrap();
    assert!(reason.contains("/dev/no-such-board"), "{reason}");
    assert_eq!(read(&scratch.path("results/results.json")), report);

    let xml = fs::read_to_string(scratch.path("results/junit.xml")).unwrap();
    assert!(xml.contains("tests=\"4\" failures=\"2\" errors=\"1\""), "{xml}");
    assert!(xml.contains("type=\"flaky\" message=\"flaky: 2 of 4 passed"), "{xml}");
    assert!(xml.contains("R-2: &lt;it&gt; &quot;settles&quot; &amp; stays"), "{xml}");

    let markdown = fs::read_to_string(scratch.path("results/summary.md")).unwrap();
    assert!(
        markdown.contains("1 of 4 tests passed: 1 failed, 1 ended in an error, 1 is flaky"),
        "{markdown}"
    );
    assert!(markdown.contains("| R-1: it climbs |"), "{markdown}");
    assert_eq!(
        fs::read_to_string(&summary).unwrap(),
        format!("before\n{markdown}"),
        "the summary is added to"
    );

    let page = Page::read(&scratch.name("results/report.html"));
    assert!(page.headline().contains("1 of 4 tests passed"), "{}", page.headline());
    assert!(page.section("Requirements").contains("R-1: it climbs"));
    assert!(page.section("fails").contains("peak_max_m"));
    assert!(!page.plots().is_empty(), "flights are shown as bench report shows them");

    // The recording of each flight is there, whole, with what was known.
    for run in report["tests"].as_array().unwrap().iter().flat_map(|test| test["runs"].as_array().unwrap()) {
        let Some(file) = run["recording"]["file"].as_str() else { continue };
        let info =
            json(&bench(["info", &scratch.name(&format!("results/{file}")), "--json"]).assert().success());
        assert_eq!(info["extra"]["meta.operator"], "Ada & Bob");
    }

    // Nothing is replaced, and what is chosen is flown alone.
    assert!(refused(bench(["test", &suite, "-o", &results]), 2).contains("--resume"));
    let words =
        stdout(&bench(["test", &suite, "-o", &results, "--force", "--tag", "quick"]).assert().success());
    assert_eq!(words.lines().next(), Some("passed  passes"), "{words}");
    assert!(words.contains("The test passed"), "{words}");
}

#[test]
fn the_same_suite_gives_the_same_json_but_for_times() {
    let scratch = Scratch::new();
    let fly = |folder: &str| {
        let folder = scratch.name(folder);
        bench(["test", "paper", "-o", &folder, "--quiet"]).assert().success();
        let text = fs::read_to_string(Path::new(&folder).join("results.json")).unwrap();
        text.lines()
            .filter(|line| !line.contains("\"took_s\"") && !line.contains("\"started_unix_s\""))
            .collect::<Vec<_>>()
            .join("\n")
    };
    let first = fly("a");
    assert!(first.contains("\"sha256\""));
    assert!(first == fly("b"));
}

#[test]
fn all_that_is_wrong_with_a_suite_is_told_at_once_and_nothing_is_flown() {
    let scratch = Scratch::new();
    let suite = write(
        &scratch,
        "wrong.toml",
        r#"name = "wrong"
description = "Everything is wrong with it."
colour = "red"

[[case]]
name = "a"
rig = "virtula"
mission = "climb-040"

[case.limits]
peak_max = 0.5

[[case]]
name = "a"
rig = "loopback"
mission = "climb-040"
mode = ["loopback", "simm"]
effects = ["no-such-effect"]
compare = "baseline"

[[case.limit]]
field = "/tracker/position/position_m.z"
statistic = "max"
max = 0.5

[[case.limit]]
field = "position_m.z"
statistic = "max"
unit = "m"
max = 0.5

[[case.limit]]
field = "/control/command/sticks.throttle"
statistic = "mean"
unit = "V"
min = 2.0
max = 1.0

[[case]]
name = "nothing"
rig = "virtual"
mission = "hop"
mission_criteria = "ignore"
"#,
    );
    let results = scratch.path("results");
    let told = refused(bench(["test", &suite, "-o", results.to_str().unwrap()]), 2);
    let wanted = [
        ("wrong.toml:3", "colour"),
        ("wrong.toml:7", "did you mean virtual"),
        ("wrong.toml:11", "peak_max_m"),
        ("wrong.toml:14", "another case is called"),
        ("wrong.toml:17", "simm"),
        ("wrong.toml:17", "--port"),
        ("wrong.toml:18", "no-such-effect"),
        ("wrong.toml:19", "has no baseline"),
        ("wrong.toml:21", "unit = \"m\""),
        ("wrong.toml:27", "is /tracker/position/position_m.z"),
        ("wrong.toml:36", "is above"),
        ("wrong.toml:43", "nothing is left that could fail"),
    ];
    for (place, what) in wanted {
        assert!(
            told.lines().any(|line| line.contains(&format!("{place}: ")) && line.contains(what)),
            "{place}: {what} is not told:\n{told}"
        );
    }
    assert!(told.contains("nothing was flown") && !results.exists());
    // The same without flying, but for what only a flight needs.
    let checked = json(&bench(["check", &suite, "--json"]).assert().code(2));
    assert_eq!(checked["files"][0]["kind"], "suite");
    assert!(checked["files"][0]["problems"].as_array().unwrap().len() >= wanted.len() - 2);
}

const BASELINE: &str = r#"
name = "guarded"
description = "Held against recordings of before."

[[case]]
name = "climb"
rig = "RIG"
mission = "climb-040"
compare = "baseline"
"#;

#[test]
fn a_baseline_catches_one_hundredth_of_thrust_and_is_replaced_on_purpose_alone() {
    let scratch = Scratch::new();
    let suite = write(&scratch, "guarded.toml", &BASELINE.replace("RIG", "virtual"));
    let results = scratch.name("results");
    let test = |more: &[&str]| {
        let mut command = bench(["test", &suite, "-o", &results]);
        command.args(more);
        command
    };
    assert!(refused(test(&[]), 2).contains("--record-baselines"));
    let words = stdout(&test(&["--record-baselines"]).assert().success());
    assert!(words.starts_with("new           climb"), "{words}");
    test(&["--force"]).assert().success();
    // What is stored is thinned, and says so.
    let size = |file: &str| fs::metadata(scratch.path(file)).unwrap().len();
    let stored = scratch.name("guarded.baselines/climb.mcap");
    assert!(2 * size("guarded.baselines/climb.mcap") < size("results/recordings/climb_r1.mcap"));
    let info = json(&bench(["info", &stored, "--json"]).assert().success());
    assert_eq!(info["extra"]["thinned_to_s"], "0.05");
    let words = stdout(&test(&["--record-baselines", "--force"]).assert().success());
    assert!(words.starts_with("the same      climb"), "{words}");
    let less = ["--effect", "thrust-loss:fraction=0.01", "--force"];
    let words = stdout(&test(&less).assert().code(1));
    assert!(words.contains("FAILED  climb") && words.contains("against the baseline climb.mcap"), "{words}");
    let report = read(&scratch.path("results/results.json"));
    let fields = report["tests"][0]["runs"][0]["comparisons"][0]["differences"].as_array().unwrap();
    assert!(fields.iter().any(|field| field["field"].as_str().unwrap().contains("throttle")), "{fields:?}");

    // An update shows what changes, and needs --force.
    let baseline = fs::read(scratch.path("guarded.baselines/climb.mcap")).unwrap();
    let seen = |more: &[&str], code: i32| {
        fs::remove_dir_all(&results).unwrap();
        let flags = ["--record-baselines", "--effect", "thrust-loss:fraction=0.02"];
        stdout(&test(&[&flags[..], more].concat()).assert().code(code))
    };
    let words = seen(&[], 1);
    assert!(words.starts_with("kept          climb: ") && words.contains("thrust_n"), "{words}");
    assert_eq!(fs::read(scratch.path("guarded.baselines/climb.mcap")).unwrap(), baseline);
    assert!(seen(&["--force"], 0).starts_with("replaced      climb"));
    assert_ne!(fs::read(scratch.path("guarded.baselines/climb.mcap")).unwrap(), baseline);

    // The recording as it is, for who has the room; it catches no more and no less.
    fs::remove_dir_all(scratch.path("guarded.baselines")).unwrap();
    test(&["--record-baselines=whole", "--force"]).assert().success();
    let flown = fs::read(scratch.path("results/recordings/climb_r1.mcap")).unwrap();
    assert_eq!(fs::read(&stored).unwrap(), flown);
    test(&["--force"]).assert().success();
    test(&less).assert().code(1);

    // With another rig the recording stands for nothing.
    bench(["rigs", "copy", "virtual", "-o", &scratch.name("mine.toml")]).assert().success();
    let mine = fs::read_to_string(scratch.path("mine.toml")).unwrap();
    assert!(mine.contains("sigma = 0.005"));
    fs::write(scratch.path("mine.toml"), mine.replace("sigma = 0.005", "sigma = 0.006")).unwrap();
    fs::write(&suite, BASELINE.replace("RIG", "mine.toml")).unwrap();
    let words = refused(test(&["--force"]), 2);
    assert!(words.contains("guarded.toml:9: ") && words.contains("recorded with another rig"), "{words}");
    assert!(words.contains("tracker.latency_s"), "the key that differs is named: {words}");
    // A recording that was touched is not the baseline.
    fs::write(&suite, BASELINE.replace("RIG", "virtual")).unwrap();
    fs::write(scratch.path("guarded.baselines/climb.mcap"), "x").unwrap();
    assert!(refused(test(&["--force"]), 2).contains("SHA-256"));
}

/// A suite that flies the same case simulated and through a board.
fn through_a_board(scratch: &Scratch) -> String {
    short_mission(scratch);
    write(
        scratch,
        "board.toml",
        r#"
name = "board"
description = "The simulator and the board fly alike."
ask = ["operator"]

[[case]]
name = "short"
rig = "loopback"
mission = "short.toml"
mode = ["sim", "loopback"]
compare = "back-to-back"

[case.limits]
unanswered_max = 100
"#,
    )
}

#[test]
fn the_same_suite_flies_on_the_simulator_and_through_a_board() {
    let scratch = Scratch::new();
    let suite = through_a_board(&scratch);
    let board = Emulated::start(&scratch, &[]);
    let station = scratch.name("lab");
    let test = |more: &[&str]| {
        let mut command =
            bench(["test", &suite, "--port", &board.port, "--station", &station, "--json", "-o"]);
        command.args(more);
        command
    };
    assert!(refused(test(&[&scratch.name("unasked")]), 2).contains("--meta operator=..."));
    let report = json(&test(&[&scratch.name("results"), "--meta", "operator=Ada"]).assert().success());
    let second = &report["tests"][1];
    assert_eq!((&second["mode"], &second["outcome"]), (&"loopback".into(), &"passed".into()), "{second}");
    assert_eq!(second["runs"][0]["comparisons"][0]["with"], "short/sim");
    assert!(second["runs"][0]["figures"]["round_trip_p99"].as_f64().unwrap() > 0.0);

    // The log has both, and where their recordings are.
    let runs = json(&bench(["runs", "--station", &station, "--json"]).assert().success());
    assert_eq!(runs["count"], 2);
    for run in runs["runs"].as_array().unwrap() {
        assert_eq!((&run["outcome"], &run["meta"]["operator"]), (&"passed".into(), &"Ada".into()));
        let recording = format!("{station}/{}", run["recording"].as_str().unwrap());
        let info = json(&bench(["info", &recording, "--json"]).assert().success());
        assert_eq!(info["extra"]["meta.operator"], "Ada");
    }
    // Flown again, nothing is overwritten.
    json(&test(&[&scratch.name("again"), "--mode", "sim", "--meta", "operator=Bob"]).assert().success());
    let words = stdout(&bench(["runs", "--station", &station]).assert().success());
    assert!(words.ends_with("3 runs\n") && words.contains("board / short/loopback"), "{words}");
    let words = stdout(&bench(["runs", "--station", &station, "--meta", "operator=Bob"]).assert().success());
    assert!(words.ends_with("1 run\n"), "{words}");
    let trend = ["runs", "--station", &station, "--trend", "peak"];
    let words = stdout(&bench(trend).assert().success());
    assert!(words.starts_with("peak, m\n") && words.contains("week"), "{words}");
    json(&bench(trend).arg("--json").assert().success());
    let table = scratch.name("runs.csv");
    bench(["runs", "--station", &station, "--all", "--export", &table]).assert().success();
    let mut rows = csv::Reader::from_path(&table).unwrap();
    let head = rows.headers().unwrap().clone();
    assert!(
        head.iter().any(|name| name == "meta_operator") && head.iter().any(|name| name == "peak_m"),
        "{head:?}"
    );
    assert_eq!(rows.records().count(), 3);
}

/// A terminal, and who sits at it.
struct Terminal {
    keys: serialport::TTYPort,
    screen: BufReader<serialport::TTYPort>,
    /// The program's end.
    end: String,
    _open: serialport::TTYPort,
}

impl Terminal {
    fn new() -> Self {
        let (keys, open) = serialport::TTYPort::pair().unwrap();
        let mut screen = keys.try_clone_native().unwrap();
        screen.set_timeout(Duration::from_secs(60)).unwrap();
        Self { keys, screen: BufReader::new(screen), end: open.name().unwrap(), _open: open }
    }

    fn opened(&self) -> Stdio {
        fs::File::options().read(true).write(true).open(&self.end).unwrap().into()
    }

    /// Reads until these words are on the screen.
    fn wait_for(&mut self, words: &str) {
        let mut shown = Vec::new();
        while !String::from_utf8_lossy(&shown).ends_with(words) {
            let mut next = [0];
            self.screen.read_exact(&mut next).unwrap_or_else(|error| {
                panic!("{error} instead of {words:?} after {:?}", String::from_utf8_lossy(&shown))
            });
            shown.extend(next);
        }
    }

    fn type_in(&mut self, keys: &str) {
        self.keys.write_all(keys.as_bytes()).unwrap();
    }
}

#[test]
fn what_a_suite_must_know_is_asked_for_on_a_terminal() {
    let scratch = Scratch::new();
    let suite = write(
        &scratch,
        "asks.toml",
        "name = \"asks\"\ndescription = \"It asks.\"\nask = [\"operator\", \"battery\", \"room\"]\n\n[[case]]\n\
         name = \"hop\"\nrig = \"virtual\"\nmission = \"hop\"\n",
    );
    let mut terminal = Terminal::new();
    let mut process = Command::new(env!("CARGO_BIN_EXE_bench"))
        .args(["test", &suite, "-o", &scratch.name("results"), "--meta", "battery=3"])
        .stdin(terminal.opened())
        .stdout(Stdio::piped())
        .stderr(terminal.opened())
        .spawn()
        .unwrap();
    terminal.wait_for("operator: ");
    // An empty answer is none.
    terminal.type_in("\n");
    terminal.wait_for("operator: ");
    terminal.type_in("  Ada Lovelace \n");
    // What was given is not asked for.
    terminal.wait_for("room: ");
    terminal.type_in("2\n");
    terminal.wait_for("report.html");
    assert_eq!(process.wait().unwrap().code(), Some(0));
    let report = read(&scratch.path("results/results.json"));
    let known = serde_json::json!({ "battery": "3", "operator": "Ada Lovelace", "room": "2" });
    assert_eq!(report["meta"], known);
    let info = bench(["info", &scratch.name("results/recordings/hop_r1.mcap"), "--json"]).assert().success();
    assert_eq!(json(&info)["extra"]["meta.operator"], "Ada Lovelace");
}

#[test]
fn a_station_logs_single_simulations_and_keeps_their_recordings() {
    let scratch = Scratch::new();
    let station = scratch.name("lab");
    let sim = |more: &[&str]| {
        let mut command = bench(["sim", "--mission", "hop", "--meta", "operator=Ada"]);
        command.args(more);
        command
    };
    let wrong = ["--station", &station, "--export", &scratch.name("table.txt")];
    refused(sim(&wrong), 2);
    refused(sim(&["--station", &station, "-o", &scratch.name("hop.mcap")]), 2);
    sim(&["--station", &station]).assert().success();
    sim(&["--seed", "1"]).env("BENCH_STATION", &station).assert().success();
    let lag = "rotor-lag:time_constant_s=0.15";
    sim(&["--station", &station, "--frames", "--effect", lag]).assert().code(vec![0, 1]);
    // What is named goes where it is named.
    sim(&["-o", &scratch.name("hop.mcap")]).env("BENCH_STATION", &station).assert().success();
    let runs = json(&bench(["runs", "--station", &station, "--json"]).assert().success());
    assert_eq!(runs["count"], 3, "what is wrong with the command is no run");
    let runs = runs["runs"].as_array().unwrap();
    let of = |key: &str| runs.iter().map(|run| run[key].clone()).collect::<Vec<_>>();
    assert_eq!(of("mode"), ["frames", "sim", "sim"]);
    assert_eq!(of("effects"), [lag, "", ""]);
    assert_eq!(of("seed"), [0, 1, 0]);
    for run in runs {
        assert_eq!(
            (&run["suite"], &run["test"], &run["meta"]["operator"]),
            (&"sim".into(), &"hop".into(), &"Ada".into())
        );
        assert!(run["figures"]["peak"].as_f64() > Some(0.1), "{run}");
        let recording = format!("{station}/{}", run["recording"].as_str().unwrap());
        let info = json(&bench(["info", &recording, "--json"]).assert().success());
        assert_eq!((&info["seed"], &info["extra"]["meta.operator"]), (&run["seed"], &"Ada".into()));
    }
    assert_eq!((&runs[2]["outcome"], &runs[2]["reason"]), (&"passed".into(), &Value::Null));
}

#[test]
fn what_is_no_station_or_no_filter_is_refused() {
    let scratch = Scratch::new();
    let nowhere = scratch.name("nowhere");
    assert!(refused(bench(["runs", "--station", &nowhere]), 2).contains("holds no log"));
    assert!(refused(bench(["runs"]), 2).contains("--station"));
    let station = scratch.name("lab");
    let results = scratch.name("results");
    bench(["test", "paper", "--test", "hop/seed0", "--station", &station, "-o", &results]).assert().success();
    assert!(
        refused(bench(["runs", "--station", &station, "--since", "yesterday"]), 2).contains("2026-11-25")
    );
    assert!(refused(bench(["runs", "--station", &station, "--trend", "height"]), 2).contains("peak"));
    assert!(refused(bench(["test", "paper", "--test", "no-such", "-o", &results]), 2).contains("--list"));
}

/// Waits until a journal has so many lines, of which the first is its head.
fn flown(process: &mut Child, journal: &Path, lines: usize) {
    let limit = Instant::now() + Duration::from_secs(120);
    while fs::read_to_string(journal).map_or(0, |text| text.lines().count()) < lines {
        assert!(Instant::now() < limit, "no flight was entered");
        assert!(process.try_wait().unwrap().is_none(), "it ended too early");
        std::thread::yield_now();
    }
}

#[test]
fn a_suite_that_was_killed_goes_on_where_it_was() {
    let scratch = Scratch::new();
    let suite = write(
        &scratch,
        "long.toml",
        "name = \"long\"\ndescription = \"Many flights.\"\n\n[[case]]\nname = \"hold\"\nrig = \"virtual\"\n\
         mission = \"hold-3d\"\nseeds = { first = 0, count = 40 }\n",
    );
    let (results, journal) = (scratch.name("results"), scratch.path("results/journal.jsonl"));
    let test = ["test", &suite, "-o", &results];
    let mut process = Command::new(env!("CARGO_BIN_EXE_bench"))
        .args(test)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    flown(&mut process, &journal, 6);
    process.kill().unwrap();
    process.wait().unwrap();
    let before = fs::read_to_string(&journal).unwrap().matches('\n').count() - 1;
    // What a write that was cut leaves is no flight.
    let whole = fs::read_to_string(&journal).unwrap();
    fs::write(&journal, format!("{whole}{{\"test\":\"hold/se")).unwrap();
    // A recording that is not what it was is flown again.
    let first: Value = serde_json::from_str(whole.lines().nth(1).unwrap()).unwrap();
    let file = first["run"]["recording"]["file"].as_str().unwrap();
    fs::write(scratch.path(&format!("results/{file}")), "spoilt").unwrap();

    assert!(!scratch.path("results/results.json").exists());
    let assert = bench(test).args(["--resume", "--json"]).assert().success();
    let words = String::from_utf8(assert.get_output().stderr.clone()).unwrap();
    assert!(words.contains(&format!("{} flights flown before", before - 1)), "{before}: {words}");
    let resumed = json(&assert);
    let whole = json(&bench(["test", &suite, "-o", &scratch.name("whole"), "--json"]).assert().success());
    let flights = |report: &Value| {
        let tests = report["tests"].as_array().unwrap().clone();
        tests.iter().map(|test| test["runs"][0]["recording"].clone()).collect::<Vec<_>>()
    };
    assert_eq!(flights(&resumed), flights(&whole), "as if it had never been killed");

    // What decides the flights may not have changed.
    fs::write(&suite, fs::read_to_string(&suite).unwrap().replace("Many", "Other")).unwrap();
    assert!(
        refused(
            {
                let mut again = bench(test);
                again.arg("--resume");
                again
            },
            2
        )
        .contains("another suite")
    );
}

#[test]
fn a_suite_that_is_killed_in_a_flight_lands_it_and_keeps_what_was_recorded() {
    let scratch = Scratch::new();
    let suite = through_a_board(&scratch);
    let board = Emulated::start(&scratch, &[]);
    let (results, recording) =
        (scratch.name("results"), scratch.path("results/recordings/short_loopback_r1.mcap"));
    let test = ["test", &suite, "--port", &board.port, "-o", &results, "--meta", "operator=Ada"];
    let mut process = Command::new(env!("CARGO_BIN_EXE_bench"))
        .args(test)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let limit = Instant::now() + Duration::from_secs(60);
    while fs::metadata(&recording).map_or(0, |file| file.len()) < 10_000 {
        assert!(Instant::now() < limit && process.try_wait().unwrap().is_none(), "it was not in the air");
        std::thread::yield_now();
    }
    process.kill().unwrap();
    process.wait().unwrap();
    // The flight ends as on SIGTERM, and closes its recording.
    let info = || bench(["info", recording.to_str().unwrap(), "--json"]).output().unwrap();
    while !info().status.success() {
        assert!(Instant::now() < limit, "the flight went on: {:?}", info());
    }
    let cut = fs::read(&recording).unwrap();
    // Until the flight's process is gone, the port is taken.
    while !bench(test).args(["--resume", "--quiet"]).output().unwrap().status.success() {
        assert!(Instant::now() < limit, "the board stayed taken");
    }
    assert_eq!(fs::read(scratch.path("results/recordings/short_loopback_r1_cut1.mcap")).unwrap(), cut);
    let report = read(&scratch.path("results/results.json"));
    assert_eq!(report["counts"]["passed"], 2);
}

#[test]
fn an_interrupted_suite_tells_what_was_flown() {
    let scratch = Scratch::new();
    let suite = write(
        &scratch,
        "long.toml",
        "name = \"long\"\ndescription = \"Many flights.\"\n\n[[case]]\nname = \"hold\"\nrig = \"virtual\"\n\
         mission = \"hold-3d\"\nseeds = { first = 0, count = 150 }\n",
    );
    let results = scratch.name("results");
    let mut process = Command::new(env!("CARGO_BIN_EXE_bench"))
        .args(["test", &suite, "-o", &results])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    flown(&mut process, &scratch.path("results/journal.jsonl"), 3);
    let id = process.id().to_string();
    assert!(Command::new("kill").args(["-INT", &id]).status().unwrap().success());
    assert_eq!(process.wait().unwrap().code(), Some(4));
    let report = read(&scratch.path("results/results.json"));
    let count = |of: &str| report["counts"][of].as_u64().unwrap();
    assert!(count("passed") >= 2 && count("not_run") > 0, "{}", report["counts"]);
    assert_eq!(count("passed") + count("not_run"), 150);
    let xml = fs::read_to_string(scratch.path("results/junit.xml")).unwrap();
    assert!(xml.contains("<skipped message=\"the suite was stopped before\""));
    // It goes on as after a crash.
    bench(["test", &suite, "-o", &results, "--resume", "--quiet"]).assert().success();
}

#[test]
#[ignore = "needs Python's junitparser: tests/run"]
fn python_reads_junit_back() {
    let scratch = Scratch::new();
    let suite = write(&scratch, "all.toml", &ALL_RESULTS.replace("PEAK", "0.001"));
    let results = scratch.name("results");
    bench(["test", &suite, "-o", &results]).assert().code(4);
    let script = "
import sys
from junitparser import JUnitXml, Failure, Error
xml = JUnitXml.fromfile(sys.argv[1])
assert (xml.tests, xml.failures, xml.errors) == (4, 2, 1), (xml.tests, xml.failures, xml.errors)
found = {case.name: case for suite in xml for case in suite}
assert set(found) == {'passes', 'fails', 'errs', 'flaky'}, found
assert found['passes'].is_passed and not found['fails'].is_passed
assert isinstance(found['fails'].result[0], Failure) and 'peak_max_m' in found['fails'].result[0].message
assert isinstance(found['errs'].result[0], Error)
requirements = [p.value for suite in xml for p in suite.properties() if p.name == 'requirement']
assert 'R-2: <it> \"settles\" & stays' in requirements, requirements
";
    let python = std::env::var("BENCH_PYTHON").expect("BENCH_PYTHON is set by tests/run");
    let status =
        Command::new(python).args(["-c", script, &scratch.name("results/junit.xml")]).status().unwrap();
    assert!(status.success());
}
