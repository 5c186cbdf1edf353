//! Opening a Kinect, its settings, its streams.

use std::fmt;

use bench_device::{DeviceError, Time};

use crate::frame::{Frame, FrameSource};

use super::{
    Blocks, DriverError, Led, Motor, Statistics, Transport, TransportError,
    control::{Command, Control},
    frames::{Frames, Now, channel},
};

/// Registers.
mod register {
    pub const COLOUR_STREAM: u16 = 0x05;
    pub const DEPTH_STREAM: u16 = 0x06;
    pub const COLOUR_FORMAT: u16 = 0x0c;
    pub const COLOUR_RESOLUTION: u16 = 0x0d;
    pub const COLOUR_RATE: u16 = 0x0e;
    pub const DEPTH_FORMAT: u16 = 0x12;
    pub const DEPTH_RESOLUTION: u16 = 0x13;
    pub const DEPTH_RATE: u16 = 0x14;
    pub const DEPTH_FLIP: u16 = 0x17;
    pub const COLOUR_FLIP: u16 = 0x47;
    pub const PROJECTOR_CYCLE: u16 = 0x105;
}
pub(super) use register::{COLOUR_STREAM, DEPTH_STREAM};

/// The colour sensor's registers, and bits of the first.
const CMOS_SWITCHES: u16 = 0x106;
const AUTO_EXPOSURE: u16 = 1 << 14;
const AUTO_WHITE_BALANCE: u16 = 1 << 1;
const CMOS_SHUTTER: u16 = 0x09;
const CMOS_WRITE: u16 = 0x8000;
/// A unit of the shutter, s.
pub const SHUTTER_UNIT_S: f64 = 54.21e-6;

/// In this order; the streams' transfers wait already.
const START: [(u16, u16); 12] = [
    (register::PROJECTOR_CYCLE, 0),
    (register::DEPTH_STREAM, 0),
    // 11 bits, 640 x 480, 30 Hz.
    (register::DEPTH_FORMAT, 3),
    (register::DEPTH_RESOLUTION, 1),
    (register::DEPTH_RATE, 30),
    (register::DEPTH_STREAM, 2),
    (register::DEPTH_FLIP, 0),
    // Bayer, 640 x 480, 30 Hz.
    (register::COLOUR_FORMAT, 0),
    (register::COLOUR_RESOLUTION, 1),
    (register::COLOUR_RATE, 30),
    (register::COLOUR_STREAM, 1),
    (register::COLOUR_FLIP, 0),
];
const STOP: [(u16, u16); 2] = [(register::COLOUR_STREAM, 0), (register::DEPTH_STREAM, 0)];

/// What a Kinect v1 is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Model {
    /// Kinect for Xbox, first make: all works.
    Xbox1414,
    /// Kinect for Xbox, second make: its motor needs firmware that this driver does not load.
    Xbox1473,
    /// Kinect for Windows: likewise.
    Windows,
}

impl Model {
    /// The camera's USB product numbers, for Xbox and for Windows.
    pub const CAMERAS: [u16; 2] = [0x02ae, 0x02bf];

    /// From the camera's USB product and device numbers.
    pub fn of(product: u16, device: u16) -> Option<Self> {
        match (product, device) {
            (0x02ae, 0x010b) => Some(Self::Xbox1414),
            (0x02ae, _) => Some(Self::Xbox1473),
            (0x02bf, _) => Some(Self::Windows),
            _ => None,
        }
    }

    /// Why its motor cannot be used, where that is so.
    pub fn motor_limit(self) -> Option<&'static str> {
        (self != Self::Xbox1414).then_some(
            "in this model they hang on the audio device, which needs Microsoft's firmware loaded first; the camera works without",
        )
    }

    pub(super) fn fixed_bytes(self) -> usize {
        if self == Self::Xbox1414 { 322 } else { 334 }
    }

    /// The camera's interface 0 has its streams in an alternate setting.
    pub(super) fn alternate(self) -> Option<u8> {
        (self == Self::Windows).then_some(1)
    }
}

impl fmt::Display for Model {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Xbox1414 => "Kinect for Xbox, model 1414",
            Self::Xbox1473 => "Kinect for Xbox, model 1473",
            Self::Windows => "Kinect for Windows",
        })
    }
}

/// How the colour sensor exposes. A tracker of colour wants it fixed: what changes by itself, changes what is red.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Settings {
    /// Exposure of a row, s; `None`: the device's choice.
    pub exposure_s: Option<f64>,
    /// White balance as it stands, instead of the device's choice.
    pub hold_white_balance: bool,
}

impl Settings {
    /// The longest exposure, s: longer ones slow the frames down.
    pub const LONGEST_S: f64 = 0.033;

    fn shutter(self) -> Result<Option<u16>, DriverError> {
        let Some(exposure_s) = self.exposure_s else { return Ok(None) };
        // Also refuses NaN.
        if !(SHUTTER_UNIT_S..=Self::LONGEST_S).contains(&exposure_s) {
            let range = "0.000055 to 0.033 s";
            return Err(DriverError::OutOfRange {
                what: "an exposure, in seconds,",
                value: exposure_s,
                range,
            });
        }
        Ok(Some((exposure_s / SHUTTER_UNIT_S).round() as u16))
    }
}

/// An open Kinect. Dropping it closes it.
pub struct Kinect {
    transport: Box<dyn Transport>,
    control: Control,
    model: Model,
    serial: String,
    blocks: Blocks,
    motor: Option<Motor>,
}

impl Kinect {
    /// Over a way to its camera, and to its motor where there is one. Asks the camera for its constants.
    pub fn new(
        mut transport: Box<dyn Transport>,
        motor: Option<Motor>,
        model: Model,
        serial: String,
    ) -> Result<Self, DriverError> {
        let mut control = Control::default();
        let blocks = Blocks::read(&mut control, transport.as_mut(), model)?;
        Ok(Self { transport, control, model, serial, blocks, motor })
    }

    /// What it is.
    pub fn model(&self) -> Model {
        self.model
    }

    /// Its camera's serial number; all Kinects of model 1473 have the same.
    pub fn serial(&self) -> &str {
        &self.serial
    }

    /// Its own constants.
    pub fn blocks(&self) -> &Blocks {
        &self.blocks
    }

    /// Its foot; an error that says why it cannot be used.
    pub fn motor(&mut self) -> Result<&mut Motor, DriverError> {
        let why =
            self.model.motor_limit().unwrap_or("its motor was not found beside its camera, or is in use");
        self.motor.as_mut().ok_or(DriverError::NoMotor { model: self.model, why })
    }

    /// Starts both streams, for which the lamp is steady green; `now` is the host's clock, from which frames' arrival is told.
    pub fn stream(
        mut self,
        settings: Settings,
        now: impl Fn() -> Time + Send + Sync + 'static,
    ) -> Result<Streaming, DriverError> {
        // Before anything moves.
        let shutter = settings.shutter()?;
        let now: Now = std::sync::Arc::new(now);
        let (collector, frames) = channel(now);
        self.transport.start(Box::new(collector)).map_err(|error| match error {
            TransportError::Gone => DriverError::Gone,
            TransportError::TimedOut => DriverError::NoStream { detail: "no answer".to_owned() },
            TransportError::Refused => DriverError::NoStream { detail: "refused".to_owned() },
            TransportError::Other(detail) => DriverError::NoStream { detail },
        })?;
        // From here on, dropping stops.
        let mut streaming = Streaming { kinect: self, frames };
        streaming.kinect.shine(Led::Green);
        streaming.kinect.write(&START)?;
        streaming.kinect.expose(shutter, settings.hold_white_balance)?;
        Ok(streaming)
    }

    /// A lamp that does not shine hurts nobody.
    fn shine(&mut self, led: Led) {
        if let Some(motor) = &mut self.motor {
            let _ = motor.set_led(led);
        }
    }

    fn write(&mut self, registers: &[(u16, u16)]) -> Result<(), DriverError> {
        for (register, value) in registers {
            self.control.ask(self.transport.as_mut(), Command::WriteRegister, &[*register, *value])?;
        }
        Ok(())
    }

    fn expose(&mut self, shutter: Option<u16>, hold_white_balance: bool) -> Result<(), DriverError> {
        let switches = self.cmos(CMOS_SWITCHES, 0)?;
        let switch = |word: u16, bit: u16, on: bool| if on { word | bit } else { word & !bit };
        let wanted = switch(
            switch(switches, AUTO_EXPOSURE, shutter.is_none()),
            AUTO_WHITE_BALANCE,
            !hold_white_balance,
        );
        self.cmos(CMOS_SWITCHES | CMOS_WRITE, wanted)?;
        if let Some(shutter) = shutter {
            self.cmos(CMOS_SHUTTER | CMOS_WRITE, shutter)?;
        }
        Ok(())
    }

    /// The value of a register of the colour sensor.
    fn cmos(&mut self, register: u16, value: u16) -> Result<u16, DriverError> {
        let answer = self.control.ask(self.transport.as_mut(), Command::Cmos, &[1, register, value])?;
        let Some(word) = answer.get(4..6) else {
            let detail = format!("{} bytes, expected 6", answer.len());
            return Err(DriverError::BadAnswer { command: "colour sensor's register", detail });
        };
        Ok(u16::from_le_bytes([word[0], word[1]]))
    }
}

/// A Kinect whose streams run. Dropping it stops them and closes it.
pub struct Streaming {
    kinect: Kinect,
    frames: Frames,
}

impl Streaming {
    /// The Kinect.
    pub fn kinect(&mut self) -> &mut Kinect {
        &mut self.kinect
    }

    /// What became of the streams so far.
    pub fn statistics(&self) -> Statistics {
        self.frames.statistics()
    }
}

impl FrameSource for Streaming {
    fn poll_frame(&mut self) -> Result<Option<&Frame>, DeviceError> {
        self.frames.poll_frame()
    }
}

impl Drop for Streaming {
    fn drop(&mut self) {
        // One that does not listen stops when its transfers end.
        if !self.frames.is_gone() {
            let _ = self.kinect.write(&STOP);
            // As it was before it was opened.
            self.kinect.shine(Led::BlinkGreen);
        }
        self.kinect.transport.stop();
    }
}
