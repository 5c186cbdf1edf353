//! What the live page costs the loop: a loop in real time whose tracker looks at frames, with two clients that read all there is and without any, in
//! turns within one flight. `tools/live` makes docs/results/live.md of it.
//!
//! `load --rate-hz 1000 --turns 6 --turn-s 5` prints one line of JSON. Times are in seconds. Its clients are processes of their own: the same
//! program with `--client URL`.

use std::{
    cell::Cell,
    fs,
    io::{BufRead, BufReader, Write as _},
    net::TcpStream,
    path::Path,
    process::{Child, ChildStdin, ChildStdout, Command, Stdio},
    sync::atomic::{AtomicU8, Ordering},
    time::Duration,
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

/// Turns are so long before they count, s: clients come and go.
const SETTLES_S: f64 = 1.0;
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

fn measure(rate_hz: f64, turns: usize, turn_s: f64) -> Value {
    let rigs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs");
    let mut rig = Rig::load(rigs.join("virtual.toml")).unwrap();
    rig.control_loop.period_s = 1.0 / rate_hz;
    rig.safety.overrun_streak = 10_000;
    let mut mission = Mission::load(rigs.join("missions/climb-040.toml")).unwrap();
    mission.phases.retain(|phase| matches!(phase.action, PhaseAction::Hold { .. }));
    mission.phases[0].duration_s = 2.0 * turns as f64 * turn_s;
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
    let mut clients = [Client::start(&live.url()), Client::start(&live.url())];
    live.stage(Stage::Flying);
    let path = std::env::temp_dir().join(format!("bench-live-{}.mcap", std::process::id()));
    let recorder = Recorder::create(&path, &Session::new(Mode::Hil), Options::REAL_TIME).unwrap();
    let mut sink = Tee::new(recorder, Some(watcher));

    // Who tells the clients to come and go is no part of the loop.
    let turn = AtomicU8::new(0);
    let mut seen = Vec::with_capacity((2.0 * turns as f64 * turn_s * rate_hz) as usize + 1000);
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
        let mut told = Vec::new();
        // Clients look in every second turn.
        let mut before = None;
        while !flies.is_finished() {
            let now = turn.load(Ordering::Relaxed);
            if before != Some(now) {
                let looks = now % 2 == 1;
                if before.is_some_and(|before| before % 2 == 1) {
                    told.push(end_of_turn(&mut clients));
                }
                if looks {
                    clients[0].say("on");
                    clients[1].say("on");
                    // CPU is counted from when they have settled.
                    std::thread::sleep(Duration::from_secs_f64(SETTLES_S));
                    CPU.set(cpu_s());
                    clients[0].say("count");
                    clients[1].say("count");
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
            .map(|i| of(2 * i + first))
            .map(|p| json!({ "p50": p.p50, "p99": p.p99, "max": p.max }))
            .collect::<Vec<_>>()
    };
    json!({
        "rate_hz": rate_hz, "turn_s": turn_s - SETTLES_S, "without": arm(0), "with": arm(1), "clients": told,
        "overruns": flown.summary.overruns, "ticks": flown.summary.ticks, "recorder_dropped": finished.dropped,
        "page_missed": missed.load(Ordering::Relaxed), "fifo": granted.no_priority.is_none(),
    })
}

thread_local! {
    static CPU: Cell<[f64; 2]> = const { Cell::new([0.0; 2]) };
}

fn end_of_turn(clients: &mut [Client; 2]) -> Value {
    let (from, to) = (CPU.get(), cpu_s());
    let counted: Vec<Value> = clients.iter_mut().map(Client::off).collect();
    json!({ "server_cpu_s": to[0] - from[0], "views_cpu_s": to[1] - from[1], "counted": counted })
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
    fn start(url: &str) -> Self {
        let mut process = Command::new(std::env::current_exe().unwrap())
            .args(["--client", url])
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
    fn off(&mut self) -> Value {
        self.say("off");
        let mut line = String::new();
        self.answers.read_line(&mut line).unwrap();
        serde_json::from_str(&line).unwrap()
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// The client: connects when told to, reads all, and says what it was.
fn client(url: &str) {
    let (host, token) = url.trim_start_matches("http://").split_once("/#").unwrap();
    let (told, order) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        std::io::stdin().lines().map_while(Result::ok).for_each(|line| _ = told.send(line));
    });
    while let Ok(line) = order.recv() {
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
        loop {
            match order.try_recv().as_deref() {
                Ok("count") => (views, batches, rows, bytes) = (0, 0, 0, 0),
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
        println!("{}", json!({ "views": views, "batches": batches, "rows": rows, "bytes": bytes }));
    }
}
