//! The live page during a simulated flight.

use std::{
    fs,
    io::{BufRead, BufReader},
    path::Path,
    process::{Child, ChildStderr, Command, Stdio},
};

use bench_recording::Flight;
use bench_rig::Phase;

use crate::chromium::{Chromium, Tab};

const WIDE: [u32; 2] = [1500, 1150];

/// `bench sim --live`, and where its page is.
struct Bench {
    process: Child,
    words: std::io::Lines<BufReader<ChildStderr>>,
    url: String,
    recording: std::path::PathBuf,
    _folder: tempfile::TempDir,
}

impl Bench {
    fn start(arguments: &[&str]) -> Self {
        Self::command("sim", arguments)
    }

    fn command(command: &str, arguments: &[&str]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let recording = folder.path().join("live.mcap");
        let mut process = Command::new(env!("CARGO_BIN_EXE_bench"))
            .current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("../.."))
            .args([command, "--live", "--listen", "127.0.0.1:0", "-o"])
            .arg(&recording)
            .args(arguments)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut words = BufReader::new(process.stderr.take().unwrap()).lines();
        let url = words
            .by_ref()
            .map_while(Result::ok)
            .find_map(|line| line.strip_prefix("live page: ").map(str::to_owned));
        Self { process, words, url: url.expect("the address is told"), recording, _folder: folder }
    }

    /// Its exit code, once it has ended by itself.
    fn end(&mut self) -> Option<i32> {
        self.words.by_ref().for_each(drop);
        self.process.wait().unwrap().code()
    }

    fn flight(&self) -> Flight {
        Flight::load(&self.recording).unwrap()
    }
}

impl Drop for Bench {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// No error in the console, and nothing fetched from anywhere else.
fn is_clean(browser: &mut Chromium, tab: &Tab, url: &str) {
    assert_eq!(browser.errors(tab), Vec::<String>::new());
    let host = url.trim_start_matches("http://").split('/').next().unwrap();
    let requests = browser.requests(tab);
    assert!(requests.len() >= 8, "{requests:?}");
    let own = |request: &String| {
        request.starts_with(&format!("http://{host}/")) || request == &format!("ws://{host}/live")
    };
    let foreign: Vec<_> =
        requests.iter().filter(|request| !own(request) && !request.starts_with("data:")).collect();
    assert!(foreign.is_empty(), "{foreign:?}");
}

const STAGE: &str = "live.state.stage";

#[test]
#[ignore = "needs Chromium; tests/run sets it up"]
fn browser_flies_by_frames_changes_the_altitude_and_stops() {
    let mut bench = Bench::start(&["--realtime", "--frames"]);
    let mut browser = Chromium::start();
    let operator = browser.open(&bench.url, WIDE);
    browser.wait(
        &operator,
        "START to be offered",
        "live.state.stage === 'waiting' && !document.getElementById('start').disabled",
    );
    browser.screenshot(&operator, "live-waiting");
    let second = browser.open(&bench.url, [420, 900]);
    browser.wait(&second, "the second to be let in", "live.state.clients === 2 && live.client === 2");
    assert_eq!(browser.value(&second, "document.getElementById('start').disabled"), true);
    // Whoever tries all the same is refused by the bench, not by the page alone.
    browser.value(&second, "send({ command: 'start' })");
    let refused = "document.getElementById('answer').textContent.includes('only who has the command')";
    browser.wait(&second, "the second to be refused", refused);

    browser.value(&operator, "document.getElementById('altitude').value = '0.5'");
    browser.click(&operator, "start");
    browser.wait(
        &operator,
        "the flight to begin",
        "live.state.stage === 'flying' && traces.table.last('estimated.z') !== null",
    );
    browser.wait(&operator, "views", "live.viewed > 5");
    // In the red-filtered view what is not red is grey: the marker is what is left, framed in green as the chosen one.
    let marker = "(() => { const d = document.getElementById('red').getContext('2d').getImageData(0, 0, 640, 480).data; \
         let red = 0, green = 0; for (let i = 0; i < d.length; i += 4) { if (d[i] > 90 && d[i] > 1.6 * d[i + 1] && d[i] > 1.6 * d[i + 2]) red++; \
         if (d[i + 1] > 150 && d[i] < 120 && d[i + 2] < 140) green++; } return red > 30 && green > 20; })()";
    browser.wait(&operator, "the marker in the red-filtered view", marker);
    let drawn = "(id => { const d = document.getElementById(id).getContext('2d').getImageData(0, 0, 640, 480).data; let n = 0; \
         for (let i = 0; i < d.length; i += 4) if (d[i] + d[i + 1] + d[i + 2] > 60) n++; return n > 30000; })";
    for view in ["full", "depth"] {
        browser.wait(&operator, view, &format!("{drawn}('{view}')"));
    }
    browser.wait(
        &operator,
        "the hold",
        "PHASES[traces.table.last('phase')] === 'hold' && traces.table.last('wanted.z') === 0.5",
    );
    browser.wait(
        &operator,
        "traces of what was seen and of what was so",
        "traces.table.last('measured.z') > 0.2 && traces.table.last('truth.z') > 0.2",
    );
    let before = browser.value(&operator, "traces.table.time.length").as_u64().unwrap();
    browser.wait(&operator, "the traces to move", &format!("traces.table.time.length > {before} + 100"));

    // The second sees the same, and does not command.
    browser.wait(&second, "the second to see", "traces.table.last('measured.z') > 0.2 && live.viewed > 5");
    browser.screenshot(&second, "live-phone");
    browser.value(&operator, "document.getElementById('altitude').value = '0.8'");
    browser.click(&operator, "fly-at");
    browser.wait(&operator, "the set-point to change", "traces.table.last('wanted.z') === 0.8");
    browser.wait(&operator, "the change to be flown", "traces.table.last('truth.z') > 0.7");
    browser.screenshot(&operator, "live-flying");
    browser.dark(&operator, true);
    browser.value(&operator, "new Promise((done) => setTimeout(done, 300))");
    browser.screenshot(&operator, "live-flying-dark");
    browser.dark(&operator, false);

    // Anybody may stop, with the space bar too.
    browser.press_space(&second);
    browser.wait(&operator, "the stop", "live.state.stage === 'landed'");
    browser.wait(
        &operator,
        "what it came to",
        "document.getElementById('headline').textContent.startsWith('Stopped: STOP was pressed')",
    );
    browser.screenshot(&operator, "live-stopped");
    is_clean(&mut browser, &operator, &bench.url);
    is_clean(&mut browser, &second, &bench.url);
    browser.click(&operator, "end");
    browser.wait(
        &operator,
        "the page to tell the end",
        "live.ended && !document.getElementById('banner').hidden",
    );
    assert_eq!(bench.end(), Some(4));

    let flight = bench.flight();
    let told = |start: &str| flight.events.iter().find(|event| event.text.starts_with(start));
    assert!(told("asked to hold 0.800 m").is_some(), "{:?}", flight.events);
    let stopped = told("stopped: STOP was pressed on the live page").unwrap().time;
    // The iteration in which it was pressed had written already; the next one rests.
    let after: Vec<_> = flight.commands.iter().filter(|command| command.time > stopped).collect();
    assert!(after.len() > 3 && after[0].time.since_s(stopped) < 0.101, "{after:?}");
    let rest = after[after.len() - 1].sticks;
    assert!(after.iter().all(|command| command.sticks == rest), "{after:?}");
    assert!(flight.commands.iter().all(|command| command.sticks.throttle >= rest.throttle));
    assert!(flight.states.iter().any(|state| state.phase == Phase::Abort));
}

#[test]
#[ignore = "needs Chromium; tests/run sets it up"]
fn browser_has_a_flight_land_by_its_key() {
    let mut bench = Bench::start(&["--realtime"]);
    let mut browser = Chromium::start();
    let operator = browser.open(&bench.url, [1280, 900]);
    let watcher = browser.open(&bench.url, [390, 844]);
    browser.wait(&watcher, "the second to be let in", "live.state.clients === 2 && live.client === 2");
    let disabled = "document.getElementById('land').disabled";
    assert_eq!(browser.value(&operator, disabled), true, "nothing flies");
    browser.click(&operator, "start");
    let holds = "PHASES[traces.table.last('phase')] === 'hold' && traces.table.last('estimated.z') > 0.3";
    browser.wait(&operator, "the hold", holds);
    browser.wait(&watcher, "the hold to be seen", holds);
    assert_eq!(
        [browser.value(&operator, disabled), browser.value(&watcher, disabled)],
        [serde_json::Value::from(false), serde_json::Value::from(true)]
    );
    // STOP and LAND are in reach wherever the page stands, and beside one another.
    let beside = "(() => { const [land, stop] = ['land', 'stop'].map((id) => document.getElementById(id).getBoundingClientRect()); \
         return land.right <= stop.left && land.top === stop.top && land.left >= 0 && stop.right <= innerWidth; })()";
    for (tab, name) in [(&operator, "live-land-1280"), (&watcher, "live-land-390")] {
        browser.screenshot(tab, name);
        assert_eq!(browser.value(tab, beside), true, "{name}");
    }
    // Whoever has not the command is refused by the bench.
    browser.press(&watcher, ["l", "KeyL"], 76);
    let refused = "document.getElementById('answer').textContent.includes('only who has the command')";
    browser.wait(&watcher, "the second to be refused", refused);
    browser.value(&operator, "document.getElementById('altitude').focus()");
    browser.press(&operator, ["l", "KeyL"], 76);
    let lands = "PHASES[traces.table.last('phase')] === 'land'";
    browser.wait(&operator, "the landing", lands);
    assert_eq!(browser.value(&operator, "document.getElementById('altitude').value.includes('l')"), false);
    browser.click(&operator, "land");
    let kindly = "document.getElementById('answer').textContent === 'it is landing already'";
    browser.wait(&operator, "a second press to be answered", kindly);
    browser.wait(&operator, "the end of the flight", "live.state.stage === 'landed'");
    assert_eq!(browser.value(&operator, "document.getElementById('land').disabled"), true);
    is_clean(&mut browser, &operator, &bench.url);
    browser.click(&operator, "end");
    browser.wait(&operator, "the end", "live.ended");
    // Its criteria are for a longer hold.
    assert!(matches!(bench.end(), Some(0 | 1)));
    let flight = bench.flight();
    assert!(flight.events.iter().any(|event| event.text.as_str() == "asked to land"), "{:?}", flight.events);
    assert!(flight.states.iter().all(|state| state.phase != Phase::Abort));
}

#[test]
#[ignore = "needs Chromium; tests/run sets it up"]
fn browser_lands_tells_the_result_and_shows_the_whole_flight_to_who_comes_late() {
    let mut bench = Bench::start(&[]);
    let mut browser = Chromium::start();
    let operator = browser.open(&bench.url, WIDE);
    browser.click(&operator, "start");
    browser.wait(
        &operator,
        "the landing",
        "live.state.stage === 'landed' && traces.table.time.length > 2000",
    );
    assert_eq!(
        browser.value(&operator, "document.getElementById('headline').textContent"),
        "Flown, and all criteria met"
    );
    let late = browser.open(&bench.url, [800, 1000]);
    browser.wait(
        &late,
        "the flight to be told again",
        "traces && traces.table.time.length > 2000 && traces.table.last('truth.z') !== null",
    );
    browser.screenshot(&operator, "live-landed");
    // Handed over, the command is taken by another, who ends the bench.
    browser.click(&operator, "release");
    browser.click(&late, "take");
    browser.click(&late, "end");
    browser.wait(&operator, "the end", "live.ended");
    is_clean(&mut browser, &operator, &bench.url);
    assert_eq!(bench.end(), Some(0));
    assert!(fs::metadata(&bench.recording).unwrap().len() > 10_000);
}

#[test]
#[ignore = "needs Chromium; tests/run sets it up"]
fn browser_without_the_token_or_from_elsewhere_is_refused_and_a_connection_that_is_gone_is_told() {
    let mut bench = Bench::start(&[]);
    let mut browser = Chromium::start();
    let wrong = bench.url.split('#').next().unwrap().to_owned() + "#00000000000000000000000000000000";
    let without = browser.open(&wrong, WIDE);
    browser.wait(
        &without,
        "the refusal",
        "live.ended && document.getElementById('banner').textContent.includes('not that of the bench')",
    );
    assert_eq!(browser.value(&without, "live.client"), serde_json::Value::Null);

    // A page of another origin that knows the address, and even the token.
    let port = bench.url.split(['/', ':', '#']).nth(4).unwrap();
    let foreign = browser.open("data:text/html,<title>elsewhere</title>", WIDE);
    let attempt = format!(
        "new Promise((done) => {{ const s = new WebSocket('ws://127.0.0.1:{port}/live'); s.onopen = () => done('open'); s.onerror = () => done('refused'); }})"
    );
    assert_eq!(browser.value(&foreign, &attempt), "refused");

    let operator = browser.open(&bench.url, WIDE);
    browser.wait(&operator, "START to be offered", &format!("{STAGE} === 'waiting'"));
    bench.process.kill().unwrap();
    bench.process.wait().unwrap();
    browser.wait(
        &operator,
        "the loss to be told",
        "document.getElementById('banner').textContent.includes('connection to the bench is gone')",
    );
    browser.screenshot(&operator, "live-gone");
}

/// `bench emulate psoc5`, which ends with its test.
struct Board(Child);

impl Drop for Board {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
#[ignore = "needs Chromium; tests/run sets it up"]
fn browser_shows_the_time_that_a_loop_through_a_board_keeps() {
    // A board does not wait for a browser that draws: where it may, its stand-in comes before it.
    let emulate = Command::new("nice")
        .args(["-n", "-15", env!("CARGO_BIN_EXE_bench"), "emulate", "psoc5"])
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut board = Board(emulate);
    let mut port = String::new();
    BufReader::new(board.0.stdout.take().unwrap()).read_line(&mut port).unwrap();
    let mut bench = Bench::command("hil", &["--port", port.trim()]);
    let mut browser = Chromium::start();
    let operator = browser.open(&bench.url, WIDE);
    browser.wait(&operator, "the checks to be told", "document.querySelectorAll('#checked li').length >= 2");
    browser.click(&operator, "start");
    let timed = "traces.table.last('took') > 0 && traces.table.last('lateness') !== null && traces.table.last('read.throttle') > 1";
    browser.wait(&operator, "the loop's time and the outputs read back", timed);
    browser.wait(
        &operator,
        "the hold",
        "traces.table.last('wanted.z') === 0.4 && traces.table.time.length > 500",
    );
    browser.screenshot(&operator, "live-hil");
    browser.click(&operator, "stop");
    browser.wait(
        &operator,
        "what it came to",
        "document.getElementById('words').textContent.includes('outputs seen at zero')",
    );
    is_clean(&mut browser, &operator, &bench.url);
    browser.click(&operator, "end");
    browser.wait(&operator, "the end", "live.ended");
    assert_eq!(bench.end(), Some(4));
}
