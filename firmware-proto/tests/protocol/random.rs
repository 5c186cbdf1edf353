//! Random frames with a liking for the values that go wrong.

use firmware_proto::{
    Answer, ArmState, BoardFrame, ChannelCalibration, Command, ErrorCode, Faults, FirmwareVersion, Frame,
    HostFrame,
};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// A generator of frames that travel in one direction.
pub type Generate<B> = fn(&mut ChaCha8Rng) -> Frame<B>;

pub fn host_frame(rng: &mut ChaCha8Rng) -> HostFrame {
    let body = match rng.random_range(0..8) {
        0 => Command::Hello,
        1 => Command::Arm,
        2 => Command::Disarm,
        3 => Command::Zero,
        4 => Command::Read,
        5 => Command::SelfTest { level_uv: int(rng) as i32 },
        _ => Command::SetVoltages { deadline_us: int(rng), voltages_uv: four(rng, |rng| int(rng) as i32) },
    };
    Frame { sequence: int(rng) as u16, body }
}

pub fn board_frame(rng: &mut ChaCha8Rng) -> BoardFrame {
    let body = match rng.random_range(0..7) {
        0 => Answer::Hello {
            firmware: FirmwareVersion { major: rng.random(), minor: rng.random(), patch: rng.random() },
            calibration: four(rng, |rng| ChannelCalibration {
                gain_ppm: int(rng) as u32,
                offset_uv: int(rng) as i32,
            }),
        },
        1 => Answer::SelfTestReport {
            device_time_us: int(rng),
            deviations_uv: four(rng, |rng| int(rng) as i32),
            passed: rng.random(),
        },
        2 => Answer::ErrorReport {
            device_time_us: int(rng),
            code: ErrorCode::ALL[rng.random_range(0..ErrorCode::ALL.len())],
        },
        3 => Answer::WrongVersion { board_version: rng.random(), host_version: rng.random() },
        _ => Answer::Readback {
            device_time_us: int(rng),
            voltages_uv: four(rng, |rng| int(rng) as i32),
            state: [ArmState::Disarmed, ArmState::Armed, ArmState::Tripped][rng.random_range(0..3)],
            faults: Faults::from_bits(rng.random_range(0..16)).expect("four bits are known"),
        },
    };
    Frame { sequence: int(rng) as u16, body }
}

fn four<T>(rng: &mut ChaCha8Rng, mut value: impl FnMut(&mut ChaCha8Rng) -> T) -> [T; 4] {
    std::array::from_fn(|_| value(rng))
}

/// Any integer, often one with many zero bytes or at the end of a range; callers cut it to their width.
fn int(rng: &mut ChaCha8Rng) -> u64 {
    let any: u64 = rng.random();
    match rng.random_range(0..5) {
        0 => 0,
        1 => u64::MAX,
        2 => 1 << (any % 64),
        3 => any % 4_000_000,
        _ => any,
    }
}
