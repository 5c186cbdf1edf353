//! `--live`: flights that are started, changed and stopped over the page's own connection. What a browser makes of it is in tests/browser.

use std::net::TcpStream;

use bench_recording::Flight;
use bench_rig::Phase;
use serde_json::{Value, json};
use tungstenite::{ClientRequestBuilder, Message, WebSocket};

use crate::{
    hil::{Emulated, short_mission},
    support::{Scratch, Serving, bench, json as printed, refused},
};

/// `bench` with a live page.
struct Bench(Serving);

impl Bench {
    fn start(arguments: &[&str]) -> Self {
        let live = ["--live", "--listen", "127.0.0.1:0", "--json"];
        Self(Serving::start(&[arguments, &live].concat(), "live page: "))
    }

    fn browser(&self) -> Browser {
        let (host, token) = self.0.address.trim_start_matches("http://").split_once("/#").unwrap();
        let request = ClientRequestBuilder::new(format!("ws://{host}/live").parse().unwrap())
            .with_header("Origin", format!("http://{host}"));
        let mut browser = Browser(Serving::connect(host, request));
        browser.say(&json!({ "token": token }));
        browser
    }

    /// Exit code, and what was printed.
    fn end(self) -> (Option<i32>, Value) {
        let (code, printed) = self.0.end();
        (code, serde_json::from_slice(&printed).unwrap())
    }
}

/// A short mission with a live page on an emulated board, which goes with its value, and what it will record.
fn on_loopback(scratch: &Scratch) -> (Emulated, String, Bench) {
    let mission = short_mission(scratch);
    let board = Emulated::start(scratch, &[]);
    let recording = scratch.name("hil.mcap");
    let bench = Bench::start(&["hil", "--port", &board.port, "--mission", &mission, "-o", &recording]);
    (board, recording, bench)
}

struct Browser(WebSocket<TcpStream>);

impl Browser {
    fn say(&mut self, value: &Value) {
        self.0.send(Message::text(value.to_string())).unwrap();
    }

    fn hear(&mut self, wanted: impl Fn(&Value) -> bool) -> Value {
        loop {
            let Message::Text(text) = self.0.read().unwrap() else { continue };
            let value = serde_json::from_str(&text).unwrap();
            if wanted(&value) {
                return value;
            }
        }
    }

    fn stage(&mut self, stage: &str) -> Value {
        self.hear(|value| value["stage"] == stage)
    }
}

#[test]
fn a_loopback_flight_is_started_changed_and_stopped_from_the_page() {
    let scratch = Scratch::new();
    let (_board, recording, bench) = on_loopback(&scratch);
    let mut browser = bench.browser();
    let waiting = browser.stage("waiting");
    assert!(
        waiting["checked"][1].as_str().unwrap().starts_with("loop from outputs to inputs, measured"),
        "{waiting}"
    );
    // One who reads nothing costs the recording nothing.
    let stalled = bench.browser();
    browser.say(&json!({ "command": "start", "altitude_m": 0.5, "flight_time_s": 20.0 }));
    browser.stage("flying");
    browser
        .hear(|value| value["control"].as_array().is_some_and(|rows| rows.iter().any(|row| row[4] == 0.5)));
    browser.say(&json!({ "command": "altitude", "altitude_m": 0.7 }));
    browser
        .hear(|value| value["control"].as_array().is_some_and(|rows| rows.iter().any(|row| row[4] == 0.7)));
    browser.say(&json!({ "command": "stop" }));
    let landed = browser.stage("landed");
    assert_eq!(landed["headline"], "Stopped: STOP was pressed on the live page");
    let words = landed["words"].as_str().unwrap();
    assert!(words.contains("outputs seen at zero"));
    assert!(!words.contains('\u{1b}'), "a terminal's colours are not for a page: {words:?}");
    browser.say(&json!({ "command": "end" }));
    let (code, report) = bench.end();
    drop(stalled);
    assert_eq!(
        (code, &report["ending"], &report["outputs_at_zero"]["confirmed"]),
        (Some(4), &"stopped".into(), &true.into())
    );

    let info = printed(&bench_info(&recording));
    assert_eq!(info["mode"], "hil");
    let flight = Flight::load(&recording).unwrap();
    assert!(flight.mission_toml().unwrap().contains("altitude_m = 0.5"));
    assert_eq!(flight.session.extra["mission_changes"], "altitude 0.5 m; flight time 20 s");
    // Every iteration is in the recording.
    assert_eq!(flight.ticks.len() as u64, report["summary"]["ticks"].as_u64().unwrap());
    let told =
        |text: &str| flight.events.iter().find(|event| event.text.starts_with(text)).map(|event| event.time);
    assert!(told("armed").is_some() && told("asked to hold 0.700 m").is_some());
    let stopped = told("stopped: STOP was pressed").unwrap();
    let rest = flight.commands[0].sticks;
    let pressed_in = flight.ticks.iter().position(|tick| tick.started == stopped).unwrap();
    assert_ne!(flight.commands[pressed_in].sticks, rest);
    assert!(flight.commands[pressed_in + 1..].iter().all(|command| command.sticks == rest));
}

#[test]
fn a_flight_lands_when_the_page_asks_for_it() {
    let scratch = Scratch::new();
    let (_board, recording, bench) = on_loopback(&scratch);
    let mut browser = bench.browser();
    browser.stage("waiting");
    // A hold that would go on for two minutes.
    browser.say(&json!({ "command": "start", "flight_time_s": 120.0 }));
    browser.hear(|value| {
        value["control"]
            .as_array()
            .is_some_and(|rows| rows.iter().any(|row| row[4] == 0.4 && row[7].as_f64() > Some(0.3)))
    });
    for words in ["LAND: on to the mission's landing", "it is landing already"] {
        browser.say(&json!({ "command": "land" }));
        let answer = browser.hear(|value| value["type"] == "answer");
        assert_eq!((&answer["done"], &answer["words"]), (&true.into(), &words.into()));
    }
    assert_eq!(browser.stage("landed")["headline"], "Flown, and all criteria met");
    browser.say(&json!({ "command": "end" }));
    let (code, report) = bench.end();
    assert_eq!((code, &report["ending"]), (Some(0), &"complete".into()), "{report}");

    let flight = Flight::load(&recording).unwrap();
    let asked = flight.events.iter().find(|event| event.text.starts_with("asked to land")).unwrap().time;
    let after: Vec<_> = flight.states.iter().filter(|state| state.time > asked).collect();
    assert!(after.iter().all(|state| matches!(state.phase, Phase::Land | Phase::Idle)), "{after:?}");
    assert_eq!(after[0].phase, Phase::Land);
    assert!(flight.ticks.last().unwrap().started.seconds() < 60.0);
}

fn bench_info(recording: &str) -> assert_cmd::assert::Assert {
    bench(["info", recording, "--json"]).assert().success()
}

#[test]
fn a_marker_that_is_not_seen_is_told_on_the_page_which_waits_for_another_start() {
    let scratch = Scratch::new();
    let mission = short_mission(&scratch);
    let board = Emulated::start(&scratch, &[]);
    let recording = scratch.path("hil.mcap");
    // Of this seed the first burst of lost frames lasts for longer than the marker is waited for.
    let lost = ["--effect", "tracker-dropout:probability=0.95,mean_burst_frames=1000", "--seed", "1"];
    let flight = ["hil", "--port", &board.port, "--mission", &mission, "-o", recording.to_str().unwrap()];
    let watched = Bench::start(&[&flight[..], &lost].concat());
    let mut browser = watched.browser();
    assert_eq!(browser.stage("waiting")["warning"], Value::Null);
    for _ in 0..2 {
        browser.say(&json!({ "command": "start" }));
        browser.stage("starting");
        let again = browser.stage("waiting");
        let warning = again["warning"].as_str().unwrap_or_default();
        assert!(
            warning.starts_with("Not armed: the tracker has not seen the marker for 3 s")
                && warning.contains("START again"),
            "{again}"
        );
        assert!(again["checked"].as_array().is_some_and(|lines| lines.len() == 2), "{again}");
    }
    // Nothing was flown, and nothing stays that looks like a flight.
    assert!(!recording.exists());
    browser.say(&json!({ "command": "end" }));
    assert_eq!(browser.stage("closed")["headline"], "Not flown: the operator ended the bench");
    assert_eq!(watched.0.end().0, Some(4));
    // With nobody to press START again it ends, as without a page.
    let alone = [&flight[..], &lost, &["--live", "--autostart", "--listen", "127.0.0.1:0"]].concat();
    for arguments in [[&flight[..], &lost].concat(), alone] {
        let words = refused(bench(&arguments), 4);
        assert!(words.contains("not armed: the tracker has not seen the marker"), "{words}");
        std::fs::remove_file(&recording).unwrap();
    }
}

#[test]
fn without_a_change_a_watched_simulation_is_recorded_to_the_same_bytes() {
    let scratch = Scratch::new();
    let (plain, watched) = (scratch.fly("plain.mcap", &[]), scratch.name("watched.mcap"));
    let bench = Bench::start(&["sim", "-o", &watched]);
    let mut browser = bench.browser();
    browser.stage("waiting");
    browser.say(&json!({ "command": "start" }));
    browser.stage("landed");
    browser.say(&json!({ "command": "end" }));
    assert_eq!(bench.end().0, Some(0));
    assert_eq!(std::fs::read(plain).unwrap(), std::fs::read(watched).unwrap());
    // With --autostart nobody is waited for, before or after.
    let again = scratch.name("again.mcap");
    let (code, report) = Bench::start(&["sim", "--autostart", "-o", &again]).end();
    assert_eq!((code, &report["passed"]), (Some(0), &true.into()));
}

#[test]
fn ctrl_c_before_start_flies_nothing() {
    let scratch = Scratch::new();
    let recording = scratch.path("never.mcap");
    let bench = Bench::start(&["sim", "-o", recording.to_str().unwrap()]);
    let mut browser = bench.browser();
    browser.stage("waiting");
    bench.0.interrupt();
    assert_eq!(browser.stage("closed")["headline"], "Not flown: Ctrl-C");
    assert_eq!(bench.0.end().0, Some(4));
    assert!(!recording.exists());
}

#[test]
fn a_port_that_is_taken_is_told_with_what_to_do() {
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let scratch = Scratch::new();
    let words = refused(bench(["sim", "--live", "--listen", &address, "-o", &scratch.name("a.mcap")]), 2);
    assert!(
        words.contains(&address) && words.contains("--listen 127.0.0.1:8081") && words.contains("in use"),
        "{words}"
    );
}
