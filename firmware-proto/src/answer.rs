use crate::cursor::{Reader, Writer};
use crate::frame::layout::Layout;
use crate::frame::{Body, Frame};
use crate::{CHANNELS, FrameError, PROTOCOL_VERSION};

/// A frame from the board to the host.
pub type BoardFrame = Frame<Answer>;

/// What the board answers. Voltages are in microvolts, times in microseconds of the board's clock since its reset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answer {
    /// Who the board is. Its protocol version is the one this frame could be read in.
    Hello {
        /// Version of the firmware.
        firmware: FirmwareVersion,
        /// Calibration of throttle, pitch, roll, yaw.
        calibration: [ChannelCalibration; CHANNELS],
    },
    /// The outputs as measured and the board's state, after the command was carried out.
    Readback {
        /// When the first channel was sampled.
        device_time_us: u64,
        /// Throttle, pitch, roll, yaw, not corrected by the calibration.
        voltages_uv: [i32; CHANNELS],
        /// Whether the outputs may leave zero.
        state: ArmState,
        /// What the board complains of.
        faults: Faults,
    },
    /// Result of a self-test; the outputs are at zero again.
    SelfTestReport {
        /// When the test ended.
        device_time_us: u64,
        /// Measured less expected voltage at the test level: throttle, pitch, roll, yaw.
        deviations_uv: [i32; CHANNELS],
        /// Whether all deviations were within the board's limit and the supply in its range.
        passed: bool,
    },
    /// The command was not carried out.
    ErrorReport {
        /// When it was refused.
        device_time_us: u64,
        /// Why.
        code: ErrorCode,
    },
    /// The command was of another protocol version. The one frame whose layout is the same in all versions.
    WrongVersion {
        /// Protocol version that the board speaks.
        board_version: u8,
        /// Protocol version that it was spoken to in.
        host_version: u8,
    },
}

/// Version of the board's firmware.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct FirmwareVersion {
    /// Changes when behaviour does.
    pub major: u8,
    /// Changes with additions.
    pub minor: u8,
    /// Changes with repairs.
    pub patch: u8,
}

/// One channel's loop from output to input, as the board's memory has it: voltage read = gain x voltage set + offset.
/// The board does not apply it; the host does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ChannelCalibration {
    /// Gain, parts per million: 1,000,000 for a perfect channel.
    pub gain_ppm: u32,
    /// Offset, microvolts: 0 for a perfect channel.
    pub offset_uv: i32,
}

impl ChannelCalibration {
    /// A perfect channel, and one that was never calibrated.
    pub const IDENTITY: Self = Self { gain_ppm: 1_000_000, offset_uv: 0 };
}

/// Whether the outputs may leave zero.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum ArmState {
    /// Outputs are held at zero. The state after a reset.
    Disarmed = 0,
    /// Outputs follow the host.
    Armed = 1,
    /// Outputs are held at zero after a watchdog time-out or a brown-out; left by [`crate::Command::Disarm`] only.
    Tripped = 2,
}

/// What the board complains of; all false is healthy.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Faults {
    /// The watchdog zeroed the outputs. Latched until disarmed.
    pub watchdog: bool,
    /// The voltages now set were out of range and are clamped.
    pub clamped: bool,
    /// A voltage read differs from the one expected by more than the board's limit.
    pub mismatch: bool,
    /// The supply fell below the board's limit, or a reset came from that. Latched until disarmed.
    pub brown_out: bool,
}

/// Why a command was not carried out. Codes up to 7 are decoder errors ([`FrameError`]).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum ErrorCode {
    /// [`FrameError::OverLong`].
    OverLong = 1,
    /// [`FrameError::Stuffing`].
    Stuffing = 2,
    /// [`FrameError::Truncated`].
    Truncated = 3,
    /// [`FrameError::Crc`].
    Crc = 4,
    /// [`FrameError::UnknownType`].
    UnknownType = 5,
    /// [`FrameError::Length`].
    Length = 6,
    /// [`FrameError::Value`].
    Value = 7,
    /// Voltages to a board that was not armed: arm first.
    NotArmed = 16,
    /// The deadline had passed: the link or the host stalled.
    Late = 17,
    /// Anything that needs the outputs after a trip: disarm, then arm again.
    Tripped = 18,
    /// Arming while a fault stands or an output does not read zero: see the readback.
    NotReady = 19,
    /// A self-test while armed: disarm first.
    Armed = 20,
}

impl BoardFrame {
    /// The board's answer to what its decoder rejected. `None` for a frame of the board's own repertoire: a line that
    /// echoes must not make the board answer itself for ever.
    pub fn refusing(error: FrameError, device_time_us: u64) -> Option<Self> {
        let code = match error {
            FrameError::OverLong => ErrorCode::OverLong,
            FrameError::Stuffing => ErrorCode::Stuffing,
            FrameError::Truncated { .. } => ErrorCode::Truncated,
            FrameError::Crc { .. } => ErrorCode::Crc,
            FrameError::UnknownType { code, .. } if code >= FIRST_ANSWER => return None,
            FrameError::UnknownType { .. } => ErrorCode::UnknownType,
            FrameError::Length { .. } => ErrorCode::Length,
            FrameError::Value { .. } => ErrorCode::Value,
            FrameError::Version { sequence, received } => {
                let body = Answer::WrongVersion { board_version: PROTOCOL_VERSION, host_version: received };
                return Some(Self { sequence, body });
            }
        };
        Some(Self { sequence: error.sequence(), body: Answer::ErrorReport { device_time_us, code } })
    }
}

/// Types from here on are answers.
const FIRST_ANSWER: u8 = 0x80;
const HELLO: u8 = 0x81;
const READBACK: u8 = 0x82;
const SELF_TEST_REPORT: u8 = 0x83;
const ERROR_REPORT: u8 = 0x84;
const WRONG_VERSION: u8 = 0xFF;

impl Body for Answer {}

impl Layout for Answer {
    fn version(&self) -> u8 {
        match self {
            Self::WrongVersion { board_version, .. } => *board_version,
            _ => PROTOCOL_VERSION,
        }
    }

    fn code(&self) -> u8 {
        match self {
            Self::Hello { .. } => HELLO,
            Self::Readback { .. } => READBACK,
            Self::SelfTestReport { .. } => SELF_TEST_REPORT,
            Self::ErrorReport { .. } => ERROR_REPORT,
            Self::WrongVersion { .. } => WRONG_VERSION,
        }
    }

    fn is_in_every_version(code: u8) -> bool {
        code == WRONG_VERSION
    }

    fn payload_len(code: u8) -> Option<usize> {
        match code {
            HELLO => Some(35),
            READBACK => Some(26),
            SELF_TEST_REPORT => Some(25),
            ERROR_REPORT => Some(9),
            WRONG_VERSION => Some(1),
            _ => None,
        }
    }

    fn write(&self, payload: &mut Writer) {
        match self {
            Self::Hello { firmware, calibration } => {
                payload.put(&[firmware.major, firmware.minor, firmware.patch]);
                for channel in calibration {
                    payload.put(&channel.gain_ppm.to_le_bytes());
                    payload.put(&channel.offset_uv.to_le_bytes());
                }
            }
            Self::Readback { device_time_us, voltages_uv, state, faults } => {
                payload.put(&device_time_us.to_le_bytes());
                payload.put_i32s(voltages_uv);
                payload.put(&[*state as u8, faults.bits()]);
            }
            Self::SelfTestReport { device_time_us, deviations_uv, passed } => {
                payload.put(&device_time_us.to_le_bytes());
                payload.put_i32s(deviations_uv);
                payload.put(&[u8::from(*passed)]);
            }
            Self::ErrorReport { device_time_us, code } => {
                payload.put(&device_time_us.to_le_bytes());
                payload.put(&[*code as u8]);
            }
            Self::WrongVersion { host_version, .. } => payload.put(&[*host_version]),
        }
    }

    fn read(version: u8, code: u8, payload: &mut Reader<'_>) -> Option<Self> {
        Some(match code {
            HELLO => Self::Hello {
                firmware: FirmwareVersion::read(payload)?,
                calibration: read_calibration(payload)?,
            },
            READBACK => Self::Readback {
                device_time_us: payload.u64()?,
                voltages_uv: payload.i32s()?,
                state: ArmState::from_code(payload.u8()?)?,
                faults: Faults::from_bits(payload.u8()?)?,
            },
            SELF_TEST_REPORT => Self::SelfTestReport {
                device_time_us: payload.u64()?,
                deviations_uv: payload.i32s()?,
                passed: match payload.u8()? {
                    0 => false,
                    1 => true,
                    _ => return None,
                },
            },
            ERROR_REPORT => Self::ErrorReport {
                device_time_us: payload.u64()?,
                code: ErrorCode::from_code(payload.u8()?)?,
            },
            WRONG_VERSION => Self::WrongVersion { board_version: version, host_version: payload.u8()? },
            _ => return None,
        })
    }
}

fn read_calibration(payload: &mut Reader<'_>) -> Option<[ChannelCalibration; CHANNELS]> {
    let mut calibration = [ChannelCalibration::IDENTITY; CHANNELS];
    for channel in &mut calibration {
        *channel = ChannelCalibration { gain_ppm: payload.u32()?, offset_uv: payload.i32()? };
    }
    Some(calibration)
}

impl FirmwareVersion {
    fn read(payload: &mut Reader<'_>) -> Option<Self> {
        Some(Self { major: payload.u8()?, minor: payload.u8()?, patch: payload.u8()? })
    }
}

impl ArmState {
    fn from_code(code: u8) -> Option<Self> {
        [Self::Disarmed, Self::Armed, Self::Tripped].into_iter().find(|state| *state as u8 == code)
    }
}

impl Faults {
    /// The flags as bits 0 to 3 in order of declaration.
    pub fn bits(self) -> u8 {
        u8::from(self.watchdog)
            | u8::from(self.clamped) << 1
            | u8::from(self.mismatch) << 2
            | u8::from(self.brown_out) << 3
    }

    /// The inverse of [`Faults::bits`]; `None` when a bit is set that means nothing.
    pub fn from_bits(bits: u8) -> Option<Self> {
        (bits < 1 << 4).then_some(Self {
            watchdog: bits & 1 != 0,
            clamped: bits & 2 != 0,
            mismatch: bits & 4 != 0,
            brown_out: bits & 8 != 0,
        })
    }
}

impl ErrorCode {
    /// Every code there is.
    pub const ALL: [Self; 12] = [
        Self::OverLong,
        Self::Stuffing,
        Self::Truncated,
        Self::Crc,
        Self::UnknownType,
        Self::Length,
        Self::Value,
        Self::NotArmed,
        Self::Late,
        Self::Tripped,
        Self::NotReady,
        Self::Armed,
    ];

    fn from_code(code: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|known| *known as u8 == code)
    }
}
