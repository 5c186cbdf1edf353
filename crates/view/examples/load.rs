//! What the live page costs the loop: a loop in real time whose tracker looks at frames, with nobody who looks, with two clients that read all there
//! is, and with two browsers that show it, in turns within one flight. `tools/live` makes docs/results/live.md of it.
//!
//! `load --rate-hz 1000 --turns 6 --turn-s 5` prints one line of JSON. Times are in seconds. Its clients are processes of their own: the same
//! program with `--client URL`, or with `--browser URL`, which drives a headless Chromium.

#[path = "../../../tests/browser/chromium.rs"]
#[allow(dead_code, reason = "the tests do more with a browser")]
mod chromium;

use std::{
    cell::Cell,
    fs,
    io::{BufRead, BufReader, Write as _},
    net::TcpStream,
    path::Path,
    process::{Child, ChildStdin, ChildStdout, Command, Stdio},
    sync::{
        atomic::{AtomicU8, Ordering},
        mpsc::Receiver,
    },
    time::{Duration, Instant},
};

use bench_device::{Clock as _, DeviceError, Faults, Readback, Sticks, Time, VoltageOutput};
use bench_kinect::{
    Frame, FrameSource, TrackedFrames,
    render::{Pose, Renderer, Settings, scene::Scene},
    track::{Sighting, Tracker},
};
use bench_recording::{Mode, Options, Recorder, Session, WhenFull};
use bench_rig::{Mission, PhaseAction, Rig};
use bench_run::{Directive, Ending, Granted, Percentiles, Tee, WallClock, Watcher, fly_guarded};
use bench_view::{About, Live, Stage};
use serde_json::{Value, json};
use tungstenite::{ClientRequestBuilder, Message, WebSocket};

use chromium::Chromium;

/// Turns are so long before they count, s: clients come and go, and a browser loads the page.
const SETTLES_S: f64 = 2.0;
/// Nobody looks, two clients, two browsers.
const ARMS: usize = 3;
const FRAME_S: f64 = 1.0 / 30.0;

fn main() {
    let arguments: Vec<_> = std::env::args().collect();
    let value = |name: &str| {
        arguments.iter().position(|argument| argument == name).and_then(|at| arguments.get(at + 1))
    };
    if let Some(url) = value("--client") {
        client(url);
        return;
    }
    if let Some(url) = value("--browser") {
        browser(url);
        return;
    }
    let number =
        |name: &str, otherwise: f64| value(name).map_or(otherwise, |text| text.parse().expect("a number"));
    let measured =
        measure(number("--rate-hz", 100.0), number("--turns", 6.0) as usize, number("--turn-s", 5.0));
    println!("{measured}");
}

/// An output that reads back what was written.
struct Mirror(Sticks);

impl VoltageOutput for Mirror {
    fn write(&mut self, sticks: Sticks) -> Result<(), DeviceError> {
        self.0 = sticks;
        Ok(())
    }

    fn read_back(&mut self) -> Result<Option<Readback>, DeviceError> {
        Ok(Some(Readback { device_time: Time::ZERO, sticks: self.0, faults: Faults::default() }))
    }
}

/// Frames that were rendered before, one every thirtieth of a second.
struct Replay {
    frames: Vec<Frame>,
    clock: WallClock,
    next: usize,
}

impl FrameSource for Replay {
    fn poll_frame(&mut self) -> Result<Option<&Frame>, DeviceError> {
        let due = Time::from_seconds(self.next as f64 * FRAME_S);
        if self.clock.now() < due {
            return Ok(None);
        }
        let count = self.frames.len();
        let frame = &mut self.frames[self.next % count];
        self.next += 1;
        frame.arrived_at = due;
        Ok(Some(frame))
    }
}

/// A second of a marker that hovers.
fn rendered(rig: &Rig) -> Vec<Frame> {
    let calibration = rig.calibration.as_ref().expect("the rig has a calibration");
    let mut renderer = Renderer::new(calibration, &Scene::with_distractors(), Settings::default(), 1);
    let render = |number: u32| {
        let time = Time::from_seconds(1.0 + f64::from(number) * FRAME_S);
        let mut frame = Frame::default();
        let pose = Pose::at_rest(time, [0.0, 0.0, 0.4].into());
        renderer.render(time, Some(&pose), &mut frame);
        frame
    };
    (0..30).map(render).collect()
}

/// The virtual rig at another rate of its loop, and a hold of so many seconds.
fn flown_by(rate_hz: f64, hold_s: f64) -> (Rig, Mission) {
    let rigs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs");
    let mut rig = Rig::load(rigs.join("virtual.toml")).unwrap();
    rig.control_loop.period_s = 1.0 / rate_hz;
    rig.safety.overrun_streak = 10_000;
    let mut mission = Mission::load(rigs.join("missions/climb-040.toml")).unwrap();
    mission.phases.retain(|phase| matches!(phase.action, PhaseAction::Hold { .. }));
    mission.phases[0].duration_s = hold_s;
    (rig, mission)
}

fn measure(rate_hz: f64, turns: usize, turn_s: f64) -> Value {
    let (rig, mission) = flown_by(rate_hz, (ARMS * turns) as f64 * turn_s);
    let calibration = rig.calibration.clone().unwrap();
    let frames = rendered(&rig);

    let about = About {
        mode: "hil",
        rig: rig.clone(),
        mission: mission.clone(),
        real_time: true,
        views: true,
        truth: false,
    };
    let (watcher, records, missed) = Watcher::new(16_384, WhenFull::Drop);
    let (live, _controls) =
        Live::start("127.0.0.1:0".parse().unwrap(), about, records, missed.clone()).unwrap();
    let mut shown = live.frames(&calibration).unwrap();
    let mut parties = ["--client", "--browser"].map(|kind| [0, 1].map(|_| Client::start(kind, &live.url())));
    live.stage(Stage::Flying);
    let path = std::env::temp_dir().join(format!("bench-live-{}.mcap", std::process::id()));
    let recorder = Recorder::create(&path, &Session::new(Mode::Hil), Options::REAL_TIME).unwrap();
    let mut sink = Tee::new(recorder, Some(watcher));

    // Who tells the clients to come and go is no part of the loop.
    let turn = AtomicU8::new(0);
    let mut seen = Vec::with_capacity(((ARMS * turns) as f64 * turn_s * rate_hz) as usize + 1000);
    let (flown, granted, told) = std::thread::scope(|scope| {
        let flies = scope.spawn(|| {
            let granted = Granted::ask();
            let clock = WallClock::start();
            let look =
                |frame: &Frame, tracker: &Tracker, sighting: &Sighting| shown.see(frame, tracker, sighting);
            let mut tracker =
                TrackedFrames::new(Replay { frames, clock, next: 0 }, Tracker::new(&calibration), 0.3, look);
            let mut output = Mirror(Sticks::default());
            let mut clock = clock;
            let flown = fly_guarded(
                (&mut clock, &mut output, &mut tracker),
                &rig,
                &mission,
                &mut sink,
                |progress, _| {
                    let which = (progress.now.seconds() / turn_s) as u8;
                    turn.store(which, Ordering::Relaxed);
                    let settled = progress.now.seconds() - f64::from(which) * turn_s > SETTLES_S;
                    if settled && seen.len() < seen.capacity() {
                        seen.push((which, progress.lateness_s));
                    }
                    Directive::GoOn
                },
            );
            (flown, granted)
        });
        let mut told = [Vec::new(), Vec::new()];
        // In turns: nobody looks, the clients, the browsers.
        let party = |turn: u8| (usize::from(turn) % ARMS).checked_sub(1);
        let mut before = None;
        loop {
            let is_over = flies.is_finished();
            let now = turn.load(Ordering::Relaxed);
            if before != Some(now) || is_over {
                if let Some(party) = before.and_then(party) {
                    told[party].push(end_of_turn(&mut parties[party]));
                }
                if is_over {
                    break;
                }
                if let Some(party) = party(now) {
                    parties[party].iter_mut().for_each(|client| client.say("on"));
                    // CPU is counted from when they have settled.
                    std::thread::sleep(Duration::from_secs_f64(SETTLES_S));
                    BEGAN.set(Some((Instant::now(), cpu_s())));
                    parties[party].iter_mut().for_each(|client| client.say("count"));
                }
                before = Some(now);
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        let (flown, granted) = flies.join().unwrap();
        (flown, granted, told)
    });
    assert_eq!(flown.ending, Ending::Complete);
    let finished = sink.into_inner().finish().unwrap();
    let _ = fs::remove_file(path);
    let of = |which: usize| {
        Percentiles::of(
            seen.iter().filter(|(turn, _)| usize::from(*turn) == which).map(|(_, s)| *s).collect(),
        )
    };
    let arm = |first: usize| {
        (0..turns)
            .map(|i| of(ARMS * i + first))
            .map(|p| json!({ "p50": p.p50, "p99": p.p99, "max": p.max }))
            .collect::<Vec<_>>()
    };
    json!({
        "rate_hz": rate_hz, "turn_s": turn_s - SETTLES_S, "without": arm(0), "clients": arm(1), "browsers": arm(2),
        "by_clients": told[0], "by_browsers": told[1],
        "overruns": flown.summary.overruns, "ticks": flown.summary.ticks, "recorder_dropped": finished.dropped,
        "page_missed": missed.load(Ordering::Relaxed), "fifo": granted.no_priority.is_none(),
    })
}

thread_local! {
    /// What had been used by when a turn began to count.
    static BEGAN: Cell<Option<(Instant, [f64; 2])>> = const { Cell::new(None) };
}

fn end_of_turn(clients: &mut [Client; 2]) -> Value {
    let (began, from) = BEGAN.take().expect("a turn counts from some instant on");
    let (s, to) = (began.elapsed().as_secs_f64(), cpu_s());
    for client in clients.iter_mut() {
        client.say("off");
    }
    let counted: Vec<Value> = clients.iter_mut().map(Client::told).collect();
    json!({ "s": s, "server_cpu_s": to[0] - from[0], "views_cpu_s": to[1] - from[1], "counted": counted })
}

/// Processor time of the threads "live" and "views", s.
fn cpu_s() -> [f64; 2] {
    let of = |name: &str| {
        let tasks = fs::read_dir("/proc/self/task").unwrap().map_while(Result::ok);
        let stats = tasks.filter_map(|task| fs::read_to_string(task.path().join("stat")).ok());
        stats
            .filter_map(|stat| {
                let (head, tail) = stat.rsplit_once(") ")?;
                let fields: Vec<&str> = tail.split(' ').collect();
                // utime and stime, in hundredths of a second on Linux.
                let ticks: f64 = [11, 12].iter().filter_map(|at| fields.get(*at)?.parse::<f64>().ok()).sum();
                head.ends_with(&format!("({name}")).then_some(ticks / 100.0)
            })
            .sum()
    };
    [of("live"), of("views")]
}

/// A client's process.
struct Client {
    process: Child,
    orders: ChildStdin,
    answers: BufReader<ChildStdout>,
}

impl Client {
    fn start(kind: &str, url: &str) -> Self {
        let mut process = Command::new(std::env::current_exe().unwrap())
            .args([kind, url])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let (orders, answers) =
            (process.stdin.take().unwrap(), BufReader::new(process.stdout.take().unwrap()));
        Self { process, orders, answers }
    }

    fn say(&mut self, order: &str) {
        writeln!(self.orders, "{order}").unwrap();
    }

    /// What it has read since it counts.
    fn told(&mut self) -> Value {
        let mut line = String::new();
        self.answers.read_line(&mut line).unwrap();
        serde_json::from_str(&line).unwrap()
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        // It ends its browser first.
        let _ = writeln!(self.orders, "end");
        let _ = self.process.wait();
    }
}

/// Orders from standard input, as they come.
fn orders() -> Receiver<String> {
    let (told, order) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        std::io::stdin().lines().map_while(Result::ok).for_each(|line| _ = told.send(line));
    });
    order
}

/// What the page has got and drawn. Its functions are replaced by ones that count first.
const COUNTED: &str = "(() => { const n = window.counted = { began: performance.now(), batches: 0, rows: 0, drawn: 0, viewed: live.viewed }; \
     const [taken, drawn] = [take, traces.draw]; \
     take = (batch) => { n.batches += 1; n.rows += batch.tick?.length ?? 0; taken(batch); }; \
     traces.draw = function (...how) { n.drawn += 1; drawn.apply(this, how); }; })()";
const TOLD: &str = "({ ...counted, s: (performance.now() - counted.began) / 1000, views: live.viewed - counted.viewed, bytes: null, \
     shown: ['full', 'red', 'depth'].every((id) => document.getElementById(id).offsetParent !== null) })";

/// The browser: opens the page when told to, and says what the page got and drew.
fn browser(url: &str) {
    let order = orders();
    let mut chromium = Chromium::start();
    let mut tab = None;
    for line in order {
        match (line.as_str(), &tab) {
            ("on", _) => tab = Some(chromium.open_unheard(url, [1500, 1150])),
            ("count", Some(tab)) => {
                chromium.wait(tab, "the flight to be shown", "traces && live.viewed > 0");
                chromium.value(tab, COUNTED);
            }
            ("off", Some(shown)) => {
                let told = chromium.value(shown, TOLD);
                assert_eq!(told["shown"], true, "the three views are on the page: {told}");
                println!("{told}");
                chromium.close(shown);
                tab = None;
            }
            _ => break,
        }
    }
}

/// The client: connects when told to, reads all, and says what it was.
fn client(url: &str) {
    let (host, token) = url.trim_start_matches("http://").split_once("/#").unwrap();
    let order = orders();
    while let Ok(line) = order.recv() {
        if line == "end" {
            break;
        }
        if line != "on" {
            continue;
        }
        let request = ClientRequestBuilder::new(format!("ws://{host}/live").parse().unwrap())
            .with_header("Origin", format!("http://{host}"));
        let stream = TcpStream::connect(host).unwrap();
        stream.set_nodelay(true).unwrap();
        let mut socket: WebSocket<TcpStream> = tungstenite::client(request, stream).unwrap().0;
        socket.send(Message::text(json!({ "token": token }).to_string())).unwrap();
        let (mut views, mut batches, mut rows, mut bytes) = (0_u64, 0_u64, 0_u64, 0_usize);
        let mut began = Instant::now();
        loop {
            match order.try_recv().as_deref() {
                Ok("count") => (views, batches, rows, bytes, began) = (0, 0, 0, 0, Instant::now()),
                Ok("off") => break,
                _ => {}
            }
            let message = socket.read().unwrap();
            bytes += message.len();
            match message {
                Message::Binary(_) => {
                    views += 1;
                    socket.send(Message::text(r#"{"command":"seen"}"#)).unwrap();
                }
                Message::Text(text) => {
                    let value: Value = serde_json::from_str(&text).unwrap();
                    batches += u64::from(value["type"] == "batch");
                    rows += value["tick"].as_array().map_or(0, Vec::len) as u64;
                }
                _ => {}
            }
        }
        let s = began.elapsed().as_secs_f64();
        println!("{}", json!({ "s": s, "views": views, "batches": batches, "rows": rows, "bytes": bytes }));
    }
}
