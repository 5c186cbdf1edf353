//! The emulated board does what the firmware does: both are given the same commands, and answer the same.

use std::{
    fmt::Write as _,
    io::{BufRead, BufReader, Write},
    path::Path,
    process::{Command, Stdio},
};

use bench_dac::emulator::Board;
use firmware_proto::{Answer, BoardFrame, Command as Order, Decoder, HostFrame, MAX_WIRE_LEN};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// The firmware on its scripted board (`firmware-proto/firmware/boards/scripted`).
struct Firmware {
    child: std::process::Child,
    answers: BufReader<std::process::ChildStdout>,
    now_us: u64,
}

impl Firmware {
    fn start() -> Self {
        let firmware = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../firmware-proto/firmware");
        let program = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("firmware-{}", std::process::id()));
        let built = Command::new(firmware.join("build")).arg("scripted").arg(&program).output().unwrap();
        assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
        let mut child = Command::new(&program).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
        std::fs::remove_file(program).unwrap();
        let answers = BufReader::new(child.stdout.take().unwrap());
        Self { child, answers, now_us: 0 }
    }

    /// Carries out a line of the script; returns the answers sent meanwhile.
    fn order(&mut self, line: &str) -> Vec<BoardFrame> {
        writeln!(self.child.stdin.as_mut().unwrap(), "{line}").unwrap();
        let (mut frames, mut decoder) = (Vec::new(), Decoder::<Answer>::new());
        loop {
            let mut said = String::new();
            assert!(self.answers.read_line(&mut said).unwrap() > 0, "the firmware ended at {line:?}");
            match said.split_whitespace().collect::<Vec<_>>()[..] {
                [at_us, "."] => {
                    self.now_us = at_us.parse().unwrap();
                    return frames;
                }
                [_, "tx", hex] => {
                    let byte = |i| u8::from_str_radix(&hex[i..i + 2], 16).unwrap();
                    let bytes = (0..hex.len()).step_by(2).map(byte);
                    frames.extend(bytes.filter_map(|byte| decoder.push(byte)).map(Result::unwrap));
                }
                _ => {}
            }
        }
    }

    fn ask(&mut self, frame: &HostFrame) -> BoardFrame {
        let mut wire = [0; MAX_WIRE_LEN];
        let len = frame.encode(&mut wire).unwrap();
        let mut order = "rx ".to_owned();
        for byte in &wire[..len] {
            let _ = write!(order, "{byte:02x}");
        }
        let answers = self.order(&order);
        assert_eq!(answers.len(), 1);
        answers[0]
    }
}

impl Drop for Firmware {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// An answer without its time stamp, and its voltages beside.
fn parts(answer: Answer) -> (Answer, [i32; 4]) {
    match answer {
        Answer::Readback { voltages_uv, state, faults, .. } => {
            (Answer::Readback { device_time_us: 0, voltages_uv: [0; 4], state, faults }, voltages_uv)
        }
        Answer::SelfTestReport { deviations_uv, passed, .. } => {
            (Answer::SelfTestReport { device_time_us: 0, deviations_uv: [0; 4], passed }, deviations_uv)
        }
        Answer::ErrorReport { code, .. } => (Answer::ErrorReport { device_time_us: 0, code }, [0; 4]),
        other => (other, [0; 4]),
    }
}

#[test]
fn the_emulated_board_answers_as_the_firmware_does() {
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    let (mut firmware, mut emulated) = (Firmware::start(), Board::new(1, 0.0, 0.0));
    let mut refusals = 0;
    for sequence in 1..3000 {
        let body = match rng.random_range(0..12) {
            0 => Order::Hello,
            1 => Order::Arm,
            2 => Order::Disarm,
            3 => Order::Zero,
            4 => Order::Read,
            5 => Order::SelfTest { level_uv: rng.random_range(-100_000..4_000_000) },
            _ => Order::SetVoltages {
                deadline_us: if rng.random_range(0..8) == 0 { 0 } else { u64::MAX },
                voltages_uv: std::array::from_fn(|_| rng.random_range(-500_000..4_000_000)),
            },
        };
        let frame = HostFrame { sequence, body };
        let now_us = firmware.now_us;
        let (theirs, (ours, _)) = (firmware.ask(&frame), emulated.carry_out(now_us, &frame));
        let ((theirs, their_uv), (ours, our_uv)) = (parts(theirs.body), parts(ours.body));
        assert_eq!(theirs, ours, "at {now_us} us, to {body:?}");
        refusals += u32::from(matches!(ours, Answer::ErrorReport { .. }));
        // Both measure with 0.5 mV of noise of their own, and round to the microvolt.
        for (theirs, ours) in their_uv.into_iter().zip(our_uv) {
            assert!(theirs.abs_diff(ours) <= 1002, "to {body:?}: {their_uv:?} {our_uv:?}");
        }
        // Mostly in time, now and then beyond the watchdog, and never near it.
        let pause_ms = [1, 20, 400][rng.random_range(0..10_usize) / 4];
        firmware.order(&format!("run {}", pause_ms * 1000));
        emulated.pass(firmware.now_us);
    }
    assert!(refusals > 100, "{refusals}");
}
