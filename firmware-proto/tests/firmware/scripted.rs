//! The scripted board, built once with the system's compiler and run as a program.

use std::fmt::Write as _;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::OnceLock;

use firmware_proto::{Answer, BoardFrame, Decoder, HostFrame, MAX_WIRE_LEN};

fn program() -> &'static Path {
    static PROGRAM: OnceLock<std::path::PathBuf> = OnceLock::new();
    PROGRAM.get_or_init(|| {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
        let built = folder.join(format!("firmware-scripted-{}", std::process::id()));
        let build = Path::new(env!("CARGO_MANIFEST_DIR")).join("firmware/build");
        let output = Command::new(build).arg("scripted").arg(&built).output().expect("bash and cc are there");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        // One name for good: test processes that run at once replace each other's program with an equal one.
        let program = folder.join("firmware-scripted");
        std::fs::rename(built, &program).unwrap();
        program
    })
}

/// What the board did, and when by its own clock, us.
#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    Output { at_us: u64, channel: usize, microvolts: i32 },
    Sent { at_us: u64, bytes: Vec<u8> },
    Signal { at_us: u64, name: String },
}

pub struct Board {
    child: Child,
    orders: ChildStdin,
    answers: BufReader<ChildStdout>,
    decoder: Decoder<Answer>,
    sequence: u16,
    /// The board's clock.
    pub now_us: u64,
    /// What the outputs hold, uV.
    pub outputs: [i32; 4],
}

impl Board {
    pub fn new() -> Self {
        let mut child = Command::new(program()).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
        Self {
            orders: child.stdin.take().unwrap(),
            answers: BufReader::new(child.stdout.take().unwrap()),
            child,
            decoder: Decoder::new(),
            sequence: 0,
            now_us: 0,
            outputs: [0; 4],
        }
    }

    /// Carries out an order of the script and returns what the board did.
    pub fn order(&mut self, order: &str) -> Vec<Event> {
        self.orders.write_all(format!("{order}\n").as_bytes()).unwrap();
        let mut events = Vec::new();
        loop {
            let mut line = String::new();
            assert!(self.answers.read_line(&mut line).unwrap() > 0, "the board ended at {order:?}");
            let words: Vec<_> = line.split_whitespace().collect();
            let at_us = words[0].parse().unwrap();
            if words[1..] == ["."] {
                self.now_us = at_us;
                return events;
            }
            events.push(match words[1..] {
                ["dac", channel, microvolts] => {
                    let (channel, microvolts) = (channel.parse().unwrap(), microvolts.parse().unwrap());
                    self.outputs[channel] = microvolts;
                    Event::Output { at_us, channel, microvolts }
                }
                ["tx", hex] => {
                    let byte = |i| u8::from_str_radix(&hex[i..i + 2], 16).unwrap();
                    Event::Sent { at_us, bytes: (0..hex.len()).step_by(2).map(byte).collect() }
                }
                [name] => Event::Signal { at_us, name: name.to_owned() },
                _ => panic!("not understood: {line:?}"),
            });
        }
    }

    pub fn run_ms(&mut self, milliseconds: u64) -> Vec<Event> {
        self.order(&format!("run {}", milliseconds * 1000))
    }

    pub fn receive(&mut self, bytes: &[u8]) -> Vec<Event> {
        let mut order = "rx ".to_owned();
        for byte in bytes {
            let _ = write!(order, "{byte:02x}");
        }
        self.order(&order)
    }

    /// All answers among what the board did.
    pub fn answers(&mut self, events: &[Event]) -> Vec<BoardFrame> {
        let mut frames = Vec::new();
        for event in events {
            if let Event::Sent { bytes, .. } = event {
                frames.extend(bytes.iter().filter_map(|&byte| self.decoder.push(byte)).map(Result::unwrap));
            }
        }
        frames
    }

    /// Sends a command and returns its one answer.
    pub fn ask(&mut self, command: firmware_proto::Command) -> Answer {
        self.sequence += 1;
        let sent = HostFrame { sequence: self.sequence, body: command };
        let events = self.receive(&encoded(&sent));
        let answers = self.answers(&events);
        assert_eq!(answers.len(), 1, "{answers:?}");
        assert_eq!(answers[0].sequence, sent.sequence);
        answers[0].body
    }

    /// Sets voltages without a deadline.
    pub fn set(&mut self, voltages_uv: [i32; 4]) -> Answer {
        self.ask(firmware_proto::Command::SetVoltages { deadline_us: u64::MAX, voltages_uv })
    }
}

impl Drop for Board {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

pub fn encoded(frame: &HostFrame) -> Vec<u8> {
    let mut wire = [0; MAX_WIRE_LEN];
    let len = frame.encode(&mut wire).unwrap();
    wire[..len].to_vec()
}
