//! The motor, accelerometer and lamp in a Kinect's foot: a USB device of its own.

use super::{DriverError, Transport};

const TILT: u8 = 0x31;
const LED: u8 = 0x06;
const STATE: u8 = 0x32;
/// How far the motor goes either way, degrees.
const MOST_DEG: f64 = 31.0;
/// Accelerometer counts a g.
const COUNTS_PER_G: f64 = 819.0;

/// The lamp at a Kinect's front.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Led {
    /// Dark.
    Off = 0,
    /// Green.
    Green = 1,
    /// Red.
    Red = 2,
    /// Yellow.
    Yellow = 3,
    /// Green, blinking.
    BlinkGreen = 4,
    /// Red and yellow in turn.
    BlinkRedYellow = 6,
}

/// How a Kinect stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Attitude {
    /// Acceleration along the camera's x, y, z, m/s^2: at rest and level it shows 1 g on y.
    pub acceleration_m_s2: [f64; 3],
    /// What the motor has tilted the head by, degrees, up is positive; `None` while it moves.
    pub tilt_deg: Option<f64>,
    /// Whether the head is at the end of its way.
    pub at_limit: bool,
}

/// The foot of a model 1414.
pub struct Motor {
    transport: Box<dyn Transport>,
}

impl Motor {
    /// Over a way to the motor's device.
    pub fn new(transport: Box<dyn Transport>) -> Self {
        Self { transport }
    }

    /// Sets the lamp.
    pub fn set_led(&mut self, led: Led) -> Result<(), DriverError> {
        self.transport.write(LED, led as u16, 0, &[]).map_err(|error| error.of("lamp"))
    }

    /// Tilts the head, degrees from level, up is positive. It takes seconds, and wears the motor.
    pub fn tilt(&mut self, deg: f64) -> Result<(), DriverError> {
        // Also refuses NaN.
        if !(-MOST_DEG..=MOST_DEG).contains(&deg) {
            return Err(DriverError::OutOfRange { what: "a tilt", value: deg, range: "-31 to 31 degrees" });
        }
        let halves = (2.0 * deg).round() as i16;
        self.transport.write(TILT, halves.cast_unsigned(), 0, &[]).map_err(|error| error.of("tilt"))
    }

    /// Asks how it stands.
    pub fn attitude(&mut self) -> Result<Attitude, DriverError> {
        let mut state = [0; 10];
        let length =
            self.transport.read(STATE, 0, 0, &mut state).map_err(|error| error.of("accelerometer"))?;
        if length != state.len() {
            let detail = format!("{length} bytes, expected {}", state.len());
            return Err(DriverError::BadAnswer { command: "accelerometer", detail });
        }
        Ok(parse(&state))
    }
}

fn parse(state: &[u8; 10]) -> Attitude {
    let axis = |at: usize| f64::from(i16::from_be_bytes([state[at], state[at + 1]])) / COUNTS_PER_G;
    // -128 is what the device says while it moves.
    let moves = state[9] == 4 || state[8] == 0x80;
    Attitude {
        acceleration_m_s2: [axis(2), axis(4), axis(6)].map(|g| g * bench_rig::GRAVITY_M_S2),
        tilt_deg: (!moves).then(|| f64::from(state[8].cast_signed()) / 2.0),
        at_limit: state[9] == 1,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_state_is_read_as_the_device_writes_it() {
        // Level, tilted down by 5 degrees, stopped.
        let attitude = parse(&[0, 0, 0, 0, 0x03, 0x33, 0xff, 0xff, 0xf6, 0]);
        assert!(
            (attitude.acceleration_m_s2[1] - 9.806_65).abs() < 1e-9 && attitude.acceleration_m_s2[2] < 0.0
        );
        assert_eq!((attitude.tilt_deg, attitude.at_limit), (Some(-5.0), false));
        assert_eq!(parse(&[0, 0, 0, 0, 0, 0, 0, 0, 0x80, 4]).tilt_deg, None);
        assert!(parse(&[0, 0, 0, 0, 0, 0, 0, 0, 62, 1]).at_limit);
    }
}
