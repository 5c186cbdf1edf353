use crate::CHANNELS;
use crate::cursor::{Reader, Writer};
use crate::frame::layout::Layout;
use crate::frame::{Body, Frame};

/// A frame from the host to the board.
pub type HostFrame = Frame<Command>;

/// What the host asks of the board. Voltages are in microvolts, times in microseconds of the board's clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Who are you? Answered by [`crate::Answer::Hello`].
    Hello,
    /// Lets the outputs leave zero from now on, and starts the watchdog. Answered by a readback, or refused.
    Arm,
    /// Outputs to zero at once, and back to the disarmed state with the latched faults cleared. Always answered by a
    /// readback.
    Disarm,
    /// Outputs to zero at once; the arm state stays as it is. Always answered by a readback.
    Zero,
    /// Measures the outputs as they are. Always answered by a readback; does not feed the watchdog.
    Read,
    /// Sets the outputs. Answered by a readback taken after they were set, or refused: when not armed, or too late.
    SetVoltages {
        /// The board applies the voltages only while its clock reads this or less.
        deadline_us: u64,
        /// Throttle, pitch, roll, yaw. Beyond the board's range they are clamped and the answer flags it.
        voltages_uv: [i32; CHANNELS],
    },
    /// Drives one output after the other to a level and measures it. Answered by a report; refused unless disarmed.
    SelfTest {
        /// The level; 0 leaves the outputs at zero, for benches where something that can fly hangs on them.
        level_uv: i32,
    },
}

const HELLO: u8 = 0x01;
const ARM: u8 = 0x02;
const DISARM: u8 = 0x03;
const ZERO: u8 = 0x04;
const READ: u8 = 0x05;
const SET_VOLTAGES: u8 = 0x06;
const SELF_TEST: u8 = 0x07;

impl Body for Command {}

impl Layout for Command {
    fn code(&self) -> u8 {
        match self {
            Self::Hello => HELLO,
            Self::Arm => ARM,
            Self::Disarm => DISARM,
            Self::Zero => ZERO,
            Self::Read => READ,
            Self::SetVoltages { .. } => SET_VOLTAGES,
            Self::SelfTest { .. } => SELF_TEST,
        }
    }

    fn is_in_every_version(_code: u8) -> bool {
        false
    }

    fn payload_len(code: u8) -> Option<usize> {
        match code {
            HELLO | ARM | DISARM | ZERO | READ => Some(0),
            SET_VOLTAGES => Some(24),
            SELF_TEST => Some(4),
            _ => None,
        }
    }

    fn write(&self, payload: &mut Writer) {
        match self {
            Self::Hello | Self::Arm | Self::Disarm | Self::Zero | Self::Read => {}
            Self::SetVoltages { deadline_us, voltages_uv } => {
                payload.put(&deadline_us.to_le_bytes());
                payload.put_i32s(voltages_uv);
            }
            Self::SelfTest { level_uv } => payload.put_i32s(&[*level_uv]),
        }
    }

    fn read(_version: u8, code: u8, payload: &mut Reader<'_>) -> Option<Self> {
        Some(match code {
            HELLO => Self::Hello,
            ARM => Self::Arm,
            DISARM => Self::Disarm,
            ZERO => Self::Zero,
            READ => Self::Read,
            SET_VOLTAGES => Self::SetVoltages { deadline_us: payload.u64()?, voltages_uv: payload.i32s()? },
            SELF_TEST => Self::SelfTest { level_uv: payload.i32()? },
            _ => return None,
        })
    }
}
