use crate::{DeviceError, Time};

/// The four channels of the hand controller, in the rig's actuation unit: volts on the paper's rig, a fraction of full
/// scale or PWM counts on others (`bench_rig::Actuation`).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sticks {
    /// Collective thrust.
    pub throttle: f64,
    /// Nose down is positive: accelerates towards the airframe's +x.
    pub pitch: f64,
    /// Right side down is positive: accelerates towards the airframe's -y.
    pub roll: f64,
    /// Turns to the left (counter-clockwise seen from above) when positive.
    pub yaw: f64,
}

impl Sticks {
    /// Throttle, pitch, roll, yaw.
    pub fn to_array(self) -> [f64; 4] {
        [self.throttle, self.pitch, self.roll, self.yaw]
    }

    /// From throttle, pitch, roll, yaw.
    pub fn from_array([throttle, pitch, roll, yaw]: [f64; 4]) -> Self {
        Self { throttle, pitch, roll, yaw }
    }

    /// Each channel through `f`.
    #[must_use]
    pub fn map(self, f: impl FnMut(f64) -> f64) -> Self {
        Self::from_array(self.to_array().map(f))
    }
}

/// What a voltage output's board reports of itself; all false is healthy.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Faults {
    /// No valid frame came in time and the board zeroed its outputs.
    pub watchdog: bool,
    /// A command was out of range and was clamped.
    pub clamped: bool,
    /// A readback differs from its command by more than the board's limit.
    pub mismatch: bool,
    /// The supply fell below the board's limit since the last report.
    pub brown_out: bool,
}

impl Faults {
    /// The flags as bits 0 to 3 in order of declaration, as recorded.
    pub fn bits(self) -> u32 {
        u32::from(self.watchdog)
            | u32::from(self.clamped) << 1
            | u32::from(self.mismatch) << 2
            | u32::from(self.brown_out) << 3
    }

    /// The inverse of [`Faults::bits`]; unknown bits are ignored.
    pub fn from_bits(bits: u32) -> Self {
        Self {
            watchdog: bits & 1 != 0,
            clamped: bits & 2 != 0,
            mismatch: bits & 4 != 0,
            brown_out: bits & 8 != 0,
        }
    }
}

/// The four outputs as measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Readback {
    /// When the board measured, by the board's own clock.
    pub device_time: Time,
    /// The measured outputs, in the rig's actuation unit.
    pub sticks: Sticks,
    /// What the board complains of.
    pub faults: Faults,
}

/// Four outputs that hold their last value (zero-order hold).
pub trait VoltageOutput {
    /// Sets the four outputs. Values outside the output's range are clamped by the output and flagged in the next
    /// readback; non-finite values are refused with [`DeviceError::BadCommand`] and leave the outputs as they were.
    fn write(&mut self, sticks: Sticks) -> Result<(), DeviceError>;

    /// Measures the four outputs as they are after the last write. `None`: no answer came in time, or the write was not
    /// carried out; the outputs hold what they held. That this lasts too long is an error.
    fn read_back(&mut self) -> Result<Option<Readback>, DeviceError>;
}
