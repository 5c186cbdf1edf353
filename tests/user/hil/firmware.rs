//! The C firmware on a Cortex-M3 under qemu, its line a pty. What its outputs did, and when by its own clock, is in a trace.

use std::{
    fs,
    io::{BufRead, BufReader, Read, Write},
    process::{Command, Stdio},
    time::Duration,
};

use firmware_proto::{Answer, BoardFrame, Decoder, ErrorCode};
use serialport::TTYPort;

use super::{Flight, Process, short_mission, wait_for};
use crate::support::{Scratch, bench, json};

struct Board {
    _process: Process,
    port: String,
    trace: std::path::PathBuf,
}

impl Board {
    fn start(scratch: &Scratch) -> Self {
        let firmware = std::env::var_os("BENCH_FIRMWARE")
            .expect("BENCH_FIRMWARE names the firmware for lm3s (tests/run)");
        let trace = scratch.path("trace");
        // A board does not wait for what else the computer does: without a priority of its own, the emulated one misses frames on a
        // busy computer, and flights are stopped as they should be.
        let urgent = ["chrt", "--fifo", "50"];
        let [chrt, options @ ..] = urgent;
        let allowed = Command::new(chrt).args(options).arg("true").stderr(Stdio::null()).status();
        let words = if allowed.is_ok_and(|status| status.success()) { &urgent[..] } else { &[] };
        let mut words = words.iter().chain(&["qemu-system-arm"]);
        let mut child = Command::new(words.next().unwrap())
            .args(words)
            .args(["-M", "lm3s6965evb", "-display", "none", "-monitor", "none", "-serial", "pty", "-serial"])
            .arg(format!("file:{}", trace.display()))
            .arg("-kernel")
            .arg(firmware)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("qemu-system-arm is on the path (tests/run)");
        // "char device redirected to /dev/pts/3 (label serial0)"
        let mut said = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut said).unwrap();
        let port = said.split_whitespace().find(|word| word.starts_with("/dev/")).expect(&said).to_owned();
        Self { _process: Process(child), port, trace }
    }

    fn trace(&self) -> Vec<Traced> {
        let text = fs::read_to_string(&self.trace).unwrap_or_default();
        // The last line may be half written.
        let whole = text.rfind('\n').map_or("", |end| &text[..end]);
        whole.lines().map(Traced::read).collect()
    }

    fn fly(&self, scratch: &Scratch, mission: &str) -> serde_json::Value {
        let out = scratch.name("flown.mcap");
        json(
            &bench(["hil", "--port", &self.port, "--mission", mission, "-o", &out, "--force", "--json"])
                .assert()
                .success(),
        )
    }
}

/// A line of the trace.
#[derive(Debug)]
enum Traced {
    Output { at_us: u64, channel: usize, microvolts: i64 },
    Event { at_us: u64, name: String },
}

impl Traced {
    fn read(line: &str) -> Self {
        let words: Vec<_> = line.split(' ').collect();
        let at_us = words[0].parse().unwrap();
        match words[1..] {
            ["dac", channel, microvolts] => Self::Output {
                at_us,
                channel: channel.parse().unwrap(),
                microvolts: microvolts.parse().unwrap(),
            },
            [name] => Self::Event { at_us, name: name.to_owned() },
            _ => panic!("not understood: {line:?}"),
        }
    }
}

fn applied(trace: &[Traced]) -> usize {
    trace.iter().filter(|traced| matches!(traced, Traced::Event { name, .. } if name == "applied")).count()
}

#[test]
#[ignore = "needs qemu-system-arm and the firmware: tests/run"]
fn firmware_flies_a_whole_mission_and_ends_at_zero() {
    let scratch = Scratch::new();
    let board = Board::start(&scratch);
    let report = board.fly(&scratch, "climb-040");
    assert_eq!((&report["ending"], &report["passed"]), (&"complete".into(), &true.into()));
    // The loop's errors as firmware/boards/loop/loop.c has them.
    let gains = [0.985, 1.012, 0.995, 1.02];
    for (channel, gain) in report["calibration"].as_array().unwrap().iter().zip(gains) {
        assert!((channel["gain"].as_f64().unwrap() - gain).abs() < 0.001, "{channel}");
    }
    let trace = board.trace();
    let mut outputs = [0; 4];
    for traced in &trace {
        if let Traced::Output { channel, microvolts, .. } = *traced {
            outputs[channel] = microvolts;
        }
    }
    assert_eq!(outputs, [0; 4]);
    // 22 s at ten a second, less what a busy machine loses.
    assert!(applied(&trace) > 150, "{}", applied(&trace));
}

#[test]
#[ignore = "needs qemu-system-arm and the firmware: tests/run"]
fn firmware_zeroes_its_outputs_within_300_ms_of_the_last_frame_of_a_host_that_was_killed() {
    let scratch = Scratch::new();
    let mission = short_mission(&scratch);
    let board = Board::start(&scratch);
    let recording = scratch.name("killed.mcap");
    let mut flight = Flight::start(&scratch, &board.port, &recording, &["--mission", &mission]);
    // In the middle of the flight: 20 of 40 iterations.
    wait_for("twenty frames", || applied(&board.trace()) >= 20);
    flight.process.0.kill().unwrap();
    flight.process.0.wait().unwrap();
    let tripped = |trace: &[Traced]| {
        trace.iter().any(|traced| matches!(traced, Traced::Event { name, .. } if name == "tripped"))
    };
    wait_for("the watchdog", || tripped(&board.trace()));

    let (mut outputs, mut last_us, mut zero_us) = ([0; 4], 0, 0);
    for traced in &board.trace() {
        match traced {
            Traced::Event { at_us, name } if name == "applied" => last_us = *at_us,
            Traced::Event { .. } => {}
            Traced::Output { at_us, channel, microvolts } => {
                outputs[*channel] = *microvolts;
                zero_us = *at_us;
            }
        }
    }
    assert_eq!(outputs, [0; 4]);
    let silent_us = zero_us - last_us;
    assert!((200_000..=300_000).contains(&silent_us), "at zero {silent_us} us after the last frame");
    // Tripped, it lets the next host in.
    board.fly(&scratch, &mission);
}

#[test]
#[ignore = "needs qemu-system-arm and the firmware: tests/run"]
fn firmware_answers_garbage_half_frames_and_other_versions_and_flies_on() {
    let scratch = Scratch::new();
    let mission = short_mission(&scratch);
    let board = Board::start(&scratch);
    {
        let builder = serialport::new(&board.port, 115_200).timeout(Duration::from_millis(100));
        let mut port = TTYPort::open(&builder).unwrap();
        let mut decoder = Decoder::<Answer>::new();
        let mut ask = |bytes: &[u8]| {
            port.write_all(bytes).unwrap();
            let mut answer = None;
            wait_for("an answer", || {
                let mut read = [0; 256];
                let count = port.read(&mut read).unwrap_or(0);
                answer = answer.or(read[..count].iter().find_map(|&byte| decoder.push(byte)));
                answer.is_some()
            });
            answer.unwrap().unwrap()
        };
        let refused =
            |frame: BoardFrame, code| matches!(frame.body, Answer::ErrorReport { code: c, .. } if c == code);
        assert!(refused(ask(&[&[b'#'; 300][..], &[0]].concat()), ErrorCode::OverLong));
        assert!(refused(ask(&[4, 1, 1, 1, 0]), ErrorCode::Truncated));
        // docs/protocol.md: hello, with a bit of its checksum flipped; then in version 2.
        assert!(refused(ask(&[0x04, 0x01, 0x01, 0x01, 0x05, 0xE3, 0x0F, 0x21, 0x81, 0x00]), ErrorCode::Crc));
        let foreign = ask(&[0x04, 0x02, 0x01, 0x01, 0x05, 0xE1, 0x4C, 0x94, 0x93, 0x00]);
        assert!(
            matches!(foreign.body, Answer::WrongVersion { board_version: 1, host_version: 2 }),
            "{foreign:?}"
        );
        // Half a frame is left in the board's receiver.
        port.write_all(&[0x04, 0x01, 0x01]).unwrap();
    }
    board.fly(&scratch, &mission);
}
