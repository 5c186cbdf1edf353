//! Frames and streams as the text of the golden files.

use std::fmt::Write;

use firmware_proto::{
    Answer, ArmState, BoardFrame, Body, Command, Decoder, ErrorCode, Faults, Frame, FrameError, HostFrame,
    MAX_WIRE_LEN,
};

/// What the board's clock reads in golden answers, microseconds.
const DEVICE_TIME_US: u64 = 1_000_000;

/// A direction of the protocol, as the golden files name and write it.
pub trait Direction: Body + Sized {
    const SENDER: &'static str;

    fn describe(frame: &Frame<Self>) -> String;

    /// The line for the answer to a rejected frame, where there is one.
    fn answer(error: FrameError) -> Option<String>;
}

impl Direction for Command {
    const SENDER: &'static str = "host";

    fn describe(frame: &HostFrame) -> String {
        let sequence = frame.sequence;
        match frame.body {
            Command::Hello => format!("hello sequence={sequence}"),
            Command::Arm => format!("arm sequence={sequence}"),
            Command::Disarm => format!("disarm sequence={sequence}"),
            Command::Zero => format!("zero sequence={sequence}"),
            Command::Read => format!("read sequence={sequence}"),
            Command::SetVoltages { deadline_us, voltages_uv } => format!(
                "set_voltages sequence={sequence} deadline_us={deadline_us} voltages_uv={}",
                list(voltages_uv)
            ),
            Command::SelfTest { level_uv } => format!("self_test sequence={sequence} level_uv={level_uv}"),
        }
    }

    fn answer(error: FrameError) -> Option<String> {
        BoardFrame::refusing(error, DEVICE_TIME_US)
            .map(|frame| format!("answer {}\n", Answer::describe(&frame)))
    }
}

impl Direction for Answer {
    const SENDER: &'static str = "board";

    fn describe(frame: &BoardFrame) -> String {
        let sequence = frame.sequence;
        match frame.body {
            Answer::Hello { firmware: version, calibration } => format!(
                "hello sequence={sequence} firmware={}.{}.{} calibration={}",
                version.major,
                version.minor,
                version.patch,
                list(calibration.map(|channel| format!("{}:{}", channel.gain_ppm, channel.offset_uv)))
            ),
            Answer::Readback { device_time_us, voltages_uv, state, faults } => format!(
                "readback sequence={sequence} device_time_us={device_time_us} voltages_uv={} state={} faults={}",
                list(voltages_uv),
                state_name(state),
                fault_names(faults)
            ),
            Answer::SelfTestReport { device_time_us, deviations_uv, passed } => format!(
                "self_test_report sequence={sequence} device_time_us={device_time_us} deviations_uv={} passed={}",
                list(deviations_uv),
                if passed { "yes" } else { "no" }
            ),
            Answer::ErrorReport { device_time_us, code } => format!(
                "error_report sequence={sequence} device_time_us={device_time_us} code={}",
                error_name(code)
            ),
            Answer::WrongVersion { board_version, host_version } => format!(
                "wrong_version sequence={sequence} board_version={board_version} host_version={host_version}"
            ),
        }
    }

    fn answer(_error: FrameError) -> Option<String> {
        None
    }
}

/// What the decoder makes of a stream, as records; each frame with its encoding when `with_bytes`.
pub fn transcript<B: Direction>(stream: &[u8], with_bytes: bool) -> String {
    let mut decoder = Decoder::<B>::new();
    let mut text = String::new();
    for event in stream.iter().filter_map(|&byte| decoder.push(byte)) {
        match event {
            Ok(frame) => {
                writeln!(text, "{} {}", B::SENDER, B::describe(&frame)).unwrap();
                if with_bytes {
                    writeln!(text, "  {}", hex(&encoded(&frame))).unwrap();
                }
            }
            Err(error) => {
                writeln!(text, "{} rejected {}", B::SENDER, reason(error)).unwrap();
                text.extend(B::answer(error));
            }
        }
    }
    text
}

/// The frame's bytes on the wire.
pub fn encoded<B: Body>(frame: &Frame<B>) -> Vec<u8> {
    let mut wire = [0; MAX_WIRE_LEN];
    let len = frame.encode(&mut wire).expect("no frame is longer than the longest");
    wire[..len].to_vec()
}

pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02X}")).collect::<Vec<_>>().join(" ")
}

fn list<T: ToString>(four: [T; 4]) -> String {
    four.map(|value| value.to_string()).join(",")
}

fn reason(error: FrameError) -> String {
    match error {
        FrameError::OverLong => "over_long".into(),
        FrameError::Stuffing => "stuffing".into(),
        FrameError::Truncated { .. } => "truncated".into(),
        FrameError::Crc { .. } => "crc".into(),
        FrameError::Version { sequence, received } => {
            format!("version sequence={sequence} received={received}")
        }
        FrameError::UnknownType { sequence, .. } => format!("unknown_type sequence={sequence}"),
        FrameError::Length { sequence, .. } => format!("length sequence={sequence}"),
        FrameError::Value { sequence, .. } => format!("value sequence={sequence}"),
        other => panic!("{other} has no name in the golden files"),
    }
}

fn state_name(state: ArmState) -> &'static str {
    match state {
        ArmState::Disarmed => "disarmed",
        ArmState::Armed => "armed",
        ArmState::Tripped => "tripped",
    }
}

fn fault_names(faults: Faults) -> String {
    let named = [
        (faults.watchdog, "watchdog"),
        (faults.clamped, "clamped"),
        (faults.mismatch, "mismatch"),
        (faults.brown_out, "brown_out"),
    ];
    let present: Vec<_> = named.into_iter().filter_map(|(present, name)| present.then_some(name)).collect();
    if present.is_empty() { "none".into() } else { present.join("+") }
}

fn error_name(code: ErrorCode) -> &'static str {
    match code {
        ErrorCode::OverLong => "over_long",
        ErrorCode::Stuffing => "stuffing",
        ErrorCode::Truncated => "truncated",
        ErrorCode::Crc => "crc",
        ErrorCode::UnknownType => "unknown_type",
        ErrorCode::Length => "length",
        ErrorCode::Value => "value",
        ErrorCode::NotArmed => "not_armed",
        ErrorCode::Late => "late",
        ErrorCode::Tripped => "tripped",
        ErrorCode::NotReady => "not_ready",
        ErrorCode::Armed => "armed",
    }
}
