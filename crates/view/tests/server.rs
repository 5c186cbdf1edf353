//! The live page's server as browsers and the loop meet it.

use std::{
    io::{Read, Write},
    net::TcpStream,
    path::Path,
    time::{Duration, Instant},
};

use bench_device::{PositionSample, Time, TrackStatus};
use bench_kinect::{
    Frame,
    track::{Sighting, Tracker},
};
use bench_recording::{Record, Tick, Truth};
use bench_rig::{ControlState, Mission, Phase, Rig};
use bench_view::{About, Ask, Controls, Live, Outcome, Stage};
use rtrb::{Producer, RingBuffer};
use serde_json::{Value, json};
use tungstenite::{ClientRequestBuilder, Message, WebSocket, http::Uri};

/// How long a busy machine may take.
const PATIENCE: Duration = Duration::from_secs(60);

struct Served {
    live: Live,
    controls: Controls,
    records: Producer<Record>,
    host: String,
    token: String,
    rig: Rig,
}

fn serve() -> Served {
    let rigs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs");
    let rig = Rig::load(rigs.join("virtual.toml")).unwrap();
    let about = About {
        mode: "hil",
        rig: rig.clone(),
        mission: Mission::load(rigs.join("missions/climb-040.toml")).unwrap(),
        real_time: true,
        views: true,
        truth: true,
    };
    let (records, consumer) = RingBuffer::new(16_384);
    let listen = "127.0.0.1:0".parse().unwrap();
    let (live, controls) = Live::start(listen, about, consumer, std::sync::Arc::default()).unwrap();
    let url = live.url();
    let (host, token) = url.trim_start_matches("http://").split_once("/#").unwrap();
    let (host, token) = (host.to_owned(), token.to_owned());
    Served { live, controls, records, host, token, rig }
}

type Socket = WebSocket<TcpStream>;

impl Served {
    /// A connection with these headers; `None` when it is refused.
    fn dial(&self, host: &str, origin: Option<&str>) -> Option<Socket> {
        Self::upgrade(TcpStream::connect(&self.host).unwrap(), host, origin)
    }

    fn upgrade(stream: TcpStream, host: &str, origin: Option<&str>) -> Option<Socket> {
        let uri: Uri = format!("ws://{host}/live").parse().unwrap();
        let mut request = ClientRequestBuilder::new(uri);
        if let Some(origin) = origin {
            request = request.with_header("Origin", origin);
        }
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        tungstenite::client(request, stream).ok().map(|(socket, _)| socket)
    }

    /// A browser that knows the token.
    fn browser(&self) -> Socket {
        self.let_in(self.dial(&self.host, Some(&format!("http://{}", self.host))).unwrap())
    }

    /// The same with little room for what it has not read.
    fn slow_browser(&self) -> Socket {
        let socket = socket2::Socket::new(socket2::Domain::IPV4, socket2::Type::STREAM, None).unwrap();
        socket.set_recv_buffer_size(4096).unwrap();
        socket.connect(&self.host.parse::<std::net::SocketAddr>().unwrap().into()).unwrap();
        self.let_in(Self::upgrade(socket.into(), &self.host, Some(&format!("http://{}", self.host))).unwrap())
    }

    fn let_in(&self, mut socket: Socket) -> Socket {
        say(&mut socket, &json!({ "token": self.token }));
        assert_eq!(hear(&mut socket, "welcome")["about"]["mission"], "climb-040");
        socket
    }

    /// Hands records over as a loop does: what finds no room is dropped.
    fn push(&mut self, record: impl Into<Record>) -> bool {
        self.records.push(record.into()).is_ok()
    }
}

fn say(socket: &mut Socket, value: &Value) {
    socket.send(Message::text(value.to_string())).unwrap();
}

/// The next message of a kind.
fn hear(socket: &mut Socket, kind: &str) -> Value {
    hear_until(socket, kind, |_| true)
}

fn hear_until(socket: &mut Socket, kind: &str, wanted: impl Fn(&Value) -> bool) -> Value {
    loop {
        let Message::Text(text) = socket.read().unwrap() else { continue };
        let value: Value = serde_json::from_str(&text).unwrap();
        if value["type"] == kind && wanted(&value) {
            return value;
        }
    }
}

fn asks(socket: &mut Socket, command: &Value) -> (bool, String) {
    say(socket, command);
    let answer = hear(socket, "answer");
    (answer["done"].as_bool().unwrap(), answer["words"].as_str().unwrap().to_owned())
}

/// The code with which a socket is closed.
fn closed_with(socket: &mut Socket) -> u16 {
    loop {
        if let Message::Close(Some(frame)) = socket.read().unwrap() {
            return frame.code.into();
        }
    }
}

fn position(time_s: f64) -> Record {
    let at = Time::from_seconds(time_s);
    let position_m = [0.0, 0.0, time_s];
    PositionSample {
        exposed_at: at,
        arrived_at: at,
        position_m,
        status: TrackStatus::Found,
        ..PositionSample::default()
    }
    .into()
}

#[test]
fn only_the_page_itself_with_the_token_is_let_in() {
    let served = serve();
    let own = format!("http://{}", served.host);
    let port = served.host.rsplit(':').next().unwrap();
    assert!(served.dial(&served.host, None).is_none(), "no origin");
    for origin in [
        "http://evil.example",
        "null",
        "https://127.0.0.1",
        &format!("http://localhost:{port}"),
        &format!("{own}.evil.example"),
    ] {
        assert!(served.dial(&served.host, Some(origin)).is_none(), "{origin}");
    }
    // A name that was turned to this machine, as origin and host alike.
    let rebound = format!("evil.example:{port}");
    assert!(served.dial(&rebound, Some(&format!("http://{rebound}"))).is_none());
    let localhost = format!("localhost:{port}");
    assert!(served.dial(&localhost, Some(&format!("http://{localhost}"))).is_some());

    let wrong = "0".repeat(32);
    for hello in [
        json!({ "token": wrong }),
        json!({ "token": "" }),
        json!({}),
        json!({ "command": "stop" }),
        json!("x".repeat(900)),
    ] {
        let mut socket = served.dial(&served.host, Some(&own)).unwrap();
        say(&mut socket, &hello);
        assert_eq!(closed_with(&mut socket), 4401, "{hello}");
    }
    served.browser();
}

#[test]
fn the_page_may_fetch_from_nowhere_else_and_is_shown_in_no_other() {
    let served = serve();
    let get = |host: &str, path: &str| {
        let mut stream = TcpStream::connect(&served.host).unwrap();
        write!(stream, "GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n").unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        answer
    };
    let page = get(&served.host, "/");
    let policy =
        page.lines().find(|line| line.to_lowercase().starts_with("content-security-policy:")).unwrap();
    for rule in ["default-src 'none'", "script-src 'self'", "frame-ancestors 'none'", "form-action 'none'"] {
        assert!(policy.contains(rule), "{policy}");
    }
    assert!(
        page.starts_with("HTTP/1.1 200") && page.contains("id=\"stop\"") && !page.contains(&served.token)
    );
    // All that it asks for is there, and of this server.
    let links = page.split(" src=\"").skip(1).chain(page.split("\"stylesheet\" href=\"").skip(1));
    let asked: Vec<&str> = links.filter_map(|rest| rest.split('"').next()).collect();
    assert_eq!(asked.len(), 7);
    for path in asked {
        assert!(path.starts_with('/') && get(&served.host, path).starts_with("HTTP/1.1 200"), "{path}");
    }
    assert!(get("evil.example:80", "/").starts_with("HTTP/1.1 421"));
    assert!(get(&served.host, "/other").starts_with("HTTP/1.1 404"));
}

#[test]
fn one_commands_all_stop_and_stop_is_never_one_too_many() {
    let mut served = serve();
    let [mut first, mut second] = [served.browser(), served.browser()];
    served.live.stage(Stage::Flying);
    let altitude = |altitude_m: f64| json!({ "command": "altitude", "altitude_m": altitude_m });
    assert!(!asks(&mut second, &altitude(0.6)).0);
    assert!(asks(&mut first, &altitude(0.6)).0);
    assert_eq!(served.controls.next_ask(), Some(Ask::Altitude(0.6)));
    assert!(!asks(&mut first, &altitude(5.0)).0);
    for wrong in ["", "stop", "{}", "{\"command\":\"fly\"}"] {
        second.send(Message::text(wrong)).unwrap();
        assert_eq!(hear(&mut second, "answer")["done"], false, "{wrong}");
    }
    assert!(!asks(&mut second, &json!({ "command": "land" })).0);
    assert_eq!(
        asks(&mut first, &json!({ "command": "land" })),
        (true, "LAND: on to the mission's landing".to_owned())
    );
    assert_eq!(served.controls.next_ask(), Some(Ask::Land));
    // Far more than the rate allows, and then STOP from the one who was cut off.
    let answers: Vec<_> = (0..30).map(|_| asks(&mut second, &altitude(0.5)).1).collect();
    assert!(answers.last().unwrap().contains("too many commands"), "{answers:?}");
    assert!(asks(&mut second, &json!({ "command": "stop" })).0);
    assert_eq!(served.controls.next_ask(), Some(Ask::Stop));
    drop(first);
    hear_until(&mut second, "state", |state| state["operator"].is_null());
}

#[test]
fn land_is_answered_by_what_the_loop_says_that_it_does() {
    let mut served = serve();
    let mut browser = served.browser();
    served.live.stage(Stage::Flying);
    let state = ControlState { phase: Phase::Land, ..ControlState::default() };
    assert!(served.push(Record::ControlState(state)));
    hear_until(&mut browser, "batch", |batch| batch["control"].is_array());
    assert_eq!(asks(&mut browser, &json!({ "command": "land" })), (true, "it is landing already".to_owned()));
    assert_eq!(served.controls.next_ask(), None);
    // More than the rate allows.
    let answers: Vec<_> = (0..30).map(|_| asks(&mut browser, &json!({ "command": "land" })).1).collect();
    assert!(answers.last().unwrap().contains("too many commands"), "{answers:?}");
}

#[test]
fn who_comes_late_is_told_all_and_all_hear_the_end() {
    let mut served = serve();
    let mut early = served.browser();
    for i in 0..300 {
        assert!(served.push(position(f64::from(i) / 30.0)));
    }
    hear_until(&mut early, "batch", |batch| {
        batch["position"].as_array().is_some_and(|rows| rows.iter().any(|row| row[3].as_f64() > Some(9.9)))
    });
    let mut late = served.browser();
    let history = hear(&mut late, "history");
    let told: usize = history["batches"]
        .as_array()
        .unwrap()
        .iter()
        .map(|batch| batch["position"].as_array().unwrap().len())
        .sum();
    assert_eq!(told, 300);
    // What came last is told before the end.
    served.push(Truth { time: Time::from_seconds(11.0), position_m: [0.0, 0.0, 0.7], ..Truth::default() });
    let closing = std::thread::spawn(move || {
        served.live.close(Outcome { passed: true, headline: "Flown".to_owned(), words: String::new() });
    });
    for browser in [&mut early, &mut late] {
        assert_eq!(hear(browser, "batch")["truth"][0][3], 0.7);
        assert_eq!(hear_until(browser, "state", |state| state["stage"] == "closed")["headline"], "Flown");
        assert_eq!(closed_with(browser), 4000);
    }
    closing.join().unwrap();
}

#[test]
fn a_browser_that_stops_reading_holds_up_neither_the_loop_nor_others_and_can_still_stop() {
    let mut served = serve();
    let calibration = served.rig.calibration.clone().unwrap();
    let mut frames = served.live.frames(&calibration).unwrap();
    let mut stalled = served.slow_browser();
    let mut reading = served.browser();
    served.live.stage(Stage::Flying);
    let (frame, tracker) = (Frame::default(), Tracker::new(&calibration));
    let mut sent = 0_u64;
    // More batches than wait for a browser, and than its socket holds.
    for round in 0..200 {
        for _ in 0..500 {
            sent += 1;
            let scheduled = Time::from_seconds(sent as f64 * 0.01);
            let tick = Tick { index: sent, scheduled, started: scheduled, ..Tick::default() };
            assert!(served.push(tick), "the hub fell behind, which no browser may bring about");
        }
        frames.see(&frame, &tracker, &Sighting::default());
        // The other one hears all of it.
        hear_until(&mut reading, "batch", |batch| batch["totals"]["ticks"] == sent);
        if round == 20 {
            // From one who reads nothing, STOP is heard all the same.
            assert!(!served.controls.stopped());
            say(&mut stalled, &json!({ "command": "stop" }));
            wait_for(|| served.controls.stopped());
        }
    }
    // It was told that it missed batches, or was let go.
    let missed = std::iter::from_fn(|| stalled.read().ok())
        .filter_map(|message| message.into_text().ok())
        .find_map(|text| {
            let value: Value = serde_json::from_str(&text).unwrap_or_default();
            (value["type"] == "lagged" || value["totals"]["ticks"] == sent).then_some(value)
        });
    assert!(missed.is_none_or(|told| told["type"] == "lagged"));
}

fn wait_for(mut holds: impl FnMut() -> bool) {
    let until = Instant::now() + PATIENCE;
    while !holds() {
        assert!(Instant::now() < until, "waited for a minute");
        std::thread::sleep(Duration::from_millis(5));
    }
}
