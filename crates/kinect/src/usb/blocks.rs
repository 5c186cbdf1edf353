//! What the factory measured of a device and wrote into it.

use bench_rig::Depth;

use super::{
    DriverError, Model, Transport,
    control::{Command, Control},
};

/// Algorithm parameters by number.
const CONST_SHIFT: u16 = 0x00;
const REGISTRATION: u16 = 0x40;
const PADDING: u16 = 0x41;

/// Where the sensor's geometry lies in the fixed parameters.
const GEOMETRY: usize = 94;
/// Numbers of the registration's polynomial.
const POLYNOMIAL: usize = 29;

/// A device's own constants.
#[derive(Clone, Debug, PartialEq)]
pub struct Blocks {
    /// Distance from emitter to depth camera, cm.
    pub emitter_distance_cm: f64,
    /// Distance from colour to depth camera, cm.
    pub colour_distance_cm: f64,
    /// Distance of the reference plane, cm.
    pub reference_distance_cm: f64,
    /// Size of a pixel on the reference plane, cm.
    pub reference_pixel_cm: f64,
    /// Shift of the reference plane, pixels.
    pub const_shift: f64,
    /// First, last and cropped lines of the depth image.
    pub padding: [u16; 3],
    /// The device's own registration of depth to colour, as it stands there; the tracker registers by the calibrated lenses instead.
    pub registration: [i32; POLYNOMIAL],
}

impl Blocks {
    /// Those of a device whose depth camera is `depth`; its registration is left flat.
    pub fn of(depth: &Depth) -> Self {
        Self {
            emitter_distance_cm: depth.emitter_distance_cm,
            colour_distance_cm: 100.0 * depth.baseline_m,
            reference_distance_cm: depth.reference_distance_cm,
            reference_pixel_cm: depth.reference_pixel_cm,
            const_shift: depth.const_shift,
            padding: [8, 0, 8],
            registration: [0; POLYNOMIAL],
        }
    }

    /// Asks a device.
    pub(super) fn read(
        control: &mut Control,
        transport: &mut dyn Transport,
        model: Model,
    ) -> Result<Self, DriverError> {
        let padding = parameters(control, transport, PADDING, 6)?;
        let fixed = control.ask(transport, Command::FixedParameters, &[0; 5])?;
        let fixed = block(&fixed, "fixed parameters", model.fixed_bytes())?;
        let registration = parameters(control, transport, REGISTRATION, POLYNOMIAL * 4)?;
        let shift = parameters(control, transport, CONST_SHIFT, 2)?;
        let word = |bytes: &[u8], i: usize| u16::from_le_bytes([bytes[2 * i], bytes[2 * i + 1]]);
        let four = |bytes: &[u8], at: usize| [bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]];
        let geometry = |i: usize| f64::from(f32::from_le_bytes(four(fixed, GEOMETRY - 2 + 4 * i)));
        let blocks = Self {
            emitter_distance_cm: geometry(0),
            colour_distance_cm: geometry(1),
            reference_distance_cm: geometry(2),
            reference_pixel_cm: geometry(3),
            const_shift: f64::from(word(&shift, 0)),
            padding: [0, 1, 2].map(|i| word(&padding, i)),
            registration: std::array::from_fn(|i| i32::from_le_bytes(four(&registration, 4 * i))),
        };
        blocks.check()?;
        Ok(blocks)
    }

    /// Whether depths can be computed from them at all.
    fn check(&self) -> Result<(), DriverError> {
        let lengths = [self.emitter_distance_cm, self.reference_distance_cm, self.reference_pixel_cm];
        if lengths.iter().all(|length| length.is_finite() && *length > 0.0) {
            return Ok(());
        }
        Err(DriverError::BadAnswer {
            command: "fixed parameters",
            detail: format!("it says that its geometry is {lengths:?} cm"),
        })
    }

    /// The constants of a calibration's depth camera that differ from the device's, as key, the calibration's value and the device's.
    pub fn differences(&self, depth: &Depth) -> Vec<(&'static str, f64, f64)> {
        [
            ("emitter_distance_cm", depth.emitter_distance_cm, self.emitter_distance_cm),
            ("reference_distance_cm", depth.reference_distance_cm, self.reference_distance_cm),
            ("reference_pixel_cm", depth.reference_pixel_cm, self.reference_pixel_cm),
            ("const_shift", depth.const_shift, self.const_shift),
        ]
        .into_iter()
        // The device has single precision.
        .filter(|(_, calibrated, device)| (calibrated - device).abs() > 1e-6 * device.abs())
        .collect()
    }

    /// A calibration's depth camera with the device's constants.
    #[must_use]
    pub fn applied(&self, depth: &Depth) -> Depth {
        Depth {
            emitter_distance_cm: self.emitter_distance_cm,
            reference_distance_cm: self.reference_distance_cm,
            reference_pixel_cm: self.reference_pixel_cm,
            const_shift: self.const_shift,
            ..*depth
        }
    }

    /// A device's answer to a request for a block; nothing for one that it does not have.
    pub(super) fn answer(&self, command: u16, payload: &[u16], model: Model) -> Option<Vec<u8>> {
        let mut answer = vec![0, 0];
        if command == Command::FixedParameters as u16 {
            answer.resize(model.fixed_bytes(), 0);
            let geometry = [
                self.emitter_distance_cm,
                self.colour_distance_cm,
                self.reference_distance_cm,
                self.reference_pixel_cm,
            ];
            for (bytes, value) in answer[GEOMETRY..].chunks_exact_mut(4).zip(geometry) {
                bytes.copy_from_slice(&(value as f32).to_le_bytes());
            }
            return Some(answer);
        }
        match *payload.first()? {
            PADDING => answer.extend(self.padding.iter().flat_map(|word| word.to_le_bytes())),
            REGISTRATION => answer.extend(self.registration.iter().flat_map(|word| word.to_le_bytes())),
            CONST_SHIFT => answer.extend((self.const_shift as u16).to_le_bytes()),
            _ => return None,
        }
        Some(answer)
    }
}

fn parameters(
    control: &mut Control,
    transport: &mut dyn Transport,
    which: u16,
    length: usize,
) -> Result<Vec<u8>, DriverError> {
    // Number, format, resolution (640 x 480), frames a second, offset.
    let answer = control.ask(transport, Command::AlgorithmParameters, &[which, 0, 1, 30, 0])?;
    Ok(block(&answer, "algorithm parameters", length + 2)?.to_vec())
}

/// A block without the status that it begins with. What is longer than expected is cut.
fn block<'a>(answer: &'a [u8], command: &'static str, length: usize) -> Result<&'a [u8], DriverError> {
    match answer.split_first_chunk() {
        Some((&[0, 0], _)) if answer.len() >= length => Ok(&answer[2..length]),
        Some((status, _)) => {
            let (found, status) = (answer.len(), u16::from_le_bytes(*status));
            let detail = format!("{found} bytes with status {status}, expected {length} with status 0");
            Err(DriverError::BadAnswer { command, detail })
        }
        None => Err(DriverError::BadAnswer { command, detail: "an empty block".to_owned() }),
    }
}
