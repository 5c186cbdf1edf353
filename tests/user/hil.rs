//! `bench hil`, `bench emulate` and `bench devices`. Three tiers: a pty, anywhere; the C firmware under qemu (`firmware_`); a real kernel's
//! `/dev/ttyACM0`, alone or with a Kinect and a virtual airframe (`usb_`). The last two are marked `ignored`: tests/run sets up what they need.

mod firmware;
mod lab;
mod pty;
mod usb;

use std::{
    fs,
    io::{BufRead, BufReader},
    path::PathBuf,
    process::{Child, Command, Stdio},
    time::{Duration, Instant},
};

use crate::support::{Scratch, root};

/// A mission of seven seconds: what is to be seen of a flight is seen, and tests in real time stay short.
const SHORT: &str = r#"
name = "short"
description = "Launch, hold 0.4 m for a moment, land."

[criteria]
peak_min_m = 0.3

[[phase]]
kind = "idle"
duration_s = 0.5

[[phase]]
kind = "launch"
thrust_to_weight = 1.08
duration_s = 0.7

[[phase]]
kind = "hold"
altitude_m = 0.4
duration_s = 2.5

[[phase]]
kind = "land"
descent_m_s = 0.3
cut_below_m = 0.06
duration_s = 6.0
"#;

pub fn short_mission(scratch: &Scratch) -> String {
    fs::write(scratch.path("short.toml"), SHORT).unwrap();
    scratch.name("short.toml")
}

/// The loopback rig with a line replaced, as a file.
fn rig_with(scratch: &Scratch, old: &str, new: &str) -> String {
    let rig = fs::read_to_string(root().join("rigs/loopback.toml")).unwrap();
    assert!(rig.contains(old), "{old:?} is gone from the rig");
    let airframe = root().join("rigs/airframes/hubsan-q4.toml");
    let rig = rig.replace("airframes/hubsan-q4.toml", airframe.to_str().unwrap()).replace(old, new);
    fs::write(scratch.path("rig.toml"), rig).unwrap();
    scratch.name("rig.toml")
}

/// A process that ends with its test.
struct Process(Child);

impl Process {
    fn signal(&self, name: &str) {
        let id = self.0.id().to_string();
        assert!(Command::new("kill").args([format!("-{name}"), id]).status().unwrap().success());
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// `bench emulate psoc5` and the port that it says.
pub struct Emulated {
    _process: Process,
    pub port: String,
}

impl Emulated {
    pub fn start(scratch: &Scratch, arguments: &[&str]) -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_bench"))
            .args(["emulate", "psoc5", "--link", &scratch.name("psoc5")])
            .args(arguments)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut port = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut port).unwrap();
        Self { _process: Process(child), port: port.trim().to_owned() }
    }
}

/// `bench hil` under way, its words in a file.
struct Flight {
    process: Process,
    words: PathBuf,
}

impl Flight {
    fn start(scratch: &Scratch, port: &str, recording: &str, arguments: &[&str]) -> Self {
        let words = scratch.path("words");
        let out = fs::File::create(&words).unwrap();
        let child = Command::new(env!("CARGO_BIN_EXE_bench"))
            .current_dir(root())
            .args(["hil", "--port", port, "-o", recording])
            .args(arguments)
            .stdout(out.try_clone().unwrap())
            .stderr(out)
            .spawn()
            .unwrap();
        Self { process: Process(child), words }
    }

    fn ended(&mut self) -> bool {
        self.process.0.try_wait().unwrap().is_some()
    }

    /// Exit code and words.
    fn end(mut self) -> (Option<i32>, String) {
        let code = self.process.0.wait().unwrap().code();
        (code, fs::read_to_string(&self.words).unwrap())
    }
}

/// Waits for something that another process is to bring about.
fn wait_for(what: &str, mut holds: impl FnMut() -> bool) {
    let until = Instant::now() + Duration::from_secs(60);
    while !holds() {
        assert!(Instant::now() < until, "waited a minute for {what}");
        std::thread::sleep(Duration::from_millis(20));
    }
}
