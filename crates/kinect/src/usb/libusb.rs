//! Kinects on this machine's USB.

use std::{fmt, str::FromStr, sync::Arc, time::Duration};

use rusb::{Context, Device, DeviceHandle, UsbContext};

use super::{DriverError, Kinect, Model, Motor, Packets, Transport, TransportError, isochronous::Transfers};

const MICROSOFT: u16 = 0x045e;
const MOTOR: u16 = 0x02b0;
const PATIENCE: Duration = Duration::from_secs(1);
/// Vendor requests from and to the host.
const TO_DEVICE: u8 = 0x40;
const TO_HOST: u8 = 0xc0;

/// Which Kinect is meant.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Wanted {
    /// The only one, or the first of several.
    #[default]
    First,
    /// By its place in [`list`], from zero.
    Index(usize),
    /// By its camera's serial number.
    Serial(String),
}

impl FromStr for Wanted {
    type Err = String;

    /// A number of up to three digits is an index, anything else a serial number.
    fn from_str(text: &str) -> Result<Self, String> {
        match text.parse() {
            Ok(index) if text.len() <= 3 => Ok(Self::Index(index)),
            _ if text.is_empty() => Err("expected an index or a serial number".to_owned()),
            _ => Ok(Self::Serial(text.to_owned())),
        }
    }
}

impl fmt::Display for Wanted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::First => f.write_str("a Kinect"),
            Self::Index(index) => write!(f, "Kinect {index}"),
            Self::Serial(serial) => write!(f, "the Kinect with serial number {serial}"),
        }
    }
}

/// A Kinect that is plugged in.
#[derive(Clone, Debug, PartialEq)]
pub struct Listed {
    /// What it is; `None` when only its foot is there, which means that it lacks its power supply.
    pub model: Option<Model>,
    /// Where.
    pub bus: u8,
    /// Where on the bus.
    pub address: u8,
    /// Its camera's serial number, or why it cannot be asked.
    pub serial: Result<String, DriverError>,
    /// Whether its motor, accelerometer and lamp can be used.
    pub motor: bool,
}

/// A device of the USB and what it is.
struct Found {
    device: Device<Context>,
    product: u16,
    version: u16,
}

impl Found {
    fn model(&self) -> Option<Model> {
        Model::of(self.product, self.version)
    }

    fn name(&self, part: &str) -> String {
        format!(
            "the Kinect's {part} (bus {:03}, address {:03})",
            self.device.bus_number(),
            self.device.address()
        )
    }

    /// The hub that it hangs on. Camera and motor of a Kinect share one, which is in the Kinect.
    fn hub(&self) -> (u8, Vec<u8>) {
        let mut ports = self.device.port_numbers().unwrap_or_default();
        ports.pop();
        (self.device.bus_number(), ports)
    }

    fn open(&self, part: &str) -> Result<DeviceHandle<Context>, DriverError> {
        self.device.open().map_err(|error| self.cannot(part, error))
    }

    fn cannot(&self, part: &str, error: rusb::Error) -> DriverError {
        let device = self.name(part);
        match error {
            rusb::Error::Access => DriverError::NoAccess { device },
            rusb::Error::Busy => DriverError::Busy { device },
            rusb::Error::NoDevice => DriverError::Gone,
            error => DriverError::CannotOpen { device, detail: error.to_string() },
        }
    }

    fn serial(&self, handle: &DeviceHandle<Context>) -> Result<String, DriverError> {
        let ask = || handle.read_serial_number_string_ascii(&self.device.device_descriptor()?);
        ask().map_err(|error| self.cannot("camera", error))
    }

    /// Opens it for good: the kernel's own driver is sent away until it is closed again.
    fn claim(&self, part: &str, alternate: Option<u8>) -> Result<Libusb, DriverError> {
        let handle = self.open(part)?;
        let claim = || {
            // Where that is not supported there is no driver in the way.
            let _ = handle.set_auto_detach_kernel_driver(true);
            handle.claim_interface(0)?;
            alternate.map_or(Ok(()), |setting| handle.set_alternate_setting(0, setting))
        };
        claim().map_err(|error| self.cannot(part, error))?;
        Ok(Libusb { handle: Arc::new(handle), transfers: None })
    }
}

/// All of Microsoft's devices, in the order of bus and address.
fn look() -> Result<Vec<Found>, DriverError> {
    let no_usb = |error: rusb::Error| DriverError::NoUsb { detail: error.to_string() };
    // The global context of rusb panics where there is no USB.
    let context = Context::new().map_err(no_usb)?;
    let devices = context.devices().map_err(no_usb)?;
    let mut found: Vec<_> = devices
        .iter()
        .filter_map(|device| {
            let descriptor = device.device_descriptor().ok()?;
            let rusb::Version(major, minor, sub_minor) = descriptor.device_version();
            let version = u16::from(major / 10) << 12
                | u16::from(major % 10) << 8
                | u16::from(minor) << 4
                | u16::from(sub_minor);
            (descriptor.vendor_id() == MICROSOFT).then(|| Found {
                device,
                product: descriptor.product_id(),
                version,
            })
        })
        .collect();
    found.sort_by_key(|found| (found.device.bus_number(), found.device.address()));
    Ok(found)
}

/// The motor in the same Kinect as a camera.
fn motor_of<'a>(found: &'a [Found], camera: &Found) -> Option<&'a Found> {
    let usable = camera.model().is_some_and(|model| model.motor_limit().is_none());
    found.iter().find(|other| usable && other.product == MOTOR && other.hub() == camera.hub())
}

/// The Kinects on this machine's USB; cameras first, in the order of their indices.
pub fn list() -> Result<Vec<Listed>, DriverError> {
    let found = look()?;
    let cameras = found.iter().filter(|found| found.model().is_some());
    let mut listed: Vec<_> = cameras
        .clone()
        .map(|camera| Listed {
            model: camera.model(),
            bus: camera.device.bus_number(),
            address: camera.device.address(),
            serial: camera.open("camera").and_then(|handle| camera.serial(&handle)),
            motor: motor_of(&found, camera).is_some(),
        })
        .collect();
    let with_camera = |motor: &Found| cameras.clone().any(|camera| camera.hub() == motor.hub());
    listed.extend(found.iter().filter(|found| found.product == MOTOR && !with_camera(found)).map(|motor| {
        let bus = motor.device.bus_number();
        Listed {
            model: None,
            bus,
            address: motor.device.address(),
            serial: Err(DriverError::NoPower { bus }),
            motor: true,
        }
    }));
    Ok(listed)
}

/// Opens a Kinect: camera, and motor where it can be used.
pub fn open(wanted: &Wanted) -> Result<Kinect, DriverError> {
    let found = look()?;
    let cameras: Vec<_> = found.iter().filter(|found| found.model().is_some()).collect();
    let camera = match wanted {
        Wanted::First => cameras.first().copied(),
        Wanted::Index(index) => cameras.get(*index).copied(),
        Wanted::Serial(serial) => by_serial(&cameras, serial)?,
    };
    let Some((camera, model)) = camera.and_then(|camera| Some((camera, camera.model()?))) else {
        return Err(not_found(wanted, &found, cameras.len()));
    };
    let way = camera.claim("camera", model.alternate())?;
    let serial = camera.serial(&way.handle)?;
    // The camera is of use without.
    let motor = motor_of(&found, camera)
        .and_then(|motor| motor.claim("motor", None).ok())
        .map(|way| Motor::new(Box::new(way)));
    Kinect::new(Box::new(way), motor, model, serial)
}

/// The camera with a serial number. When it is not among those that can be asked, one that cannot is an error: it may be the one.
fn by_serial<'a>(cameras: &[&'a Found], wanted: &str) -> Result<Option<&'a Found>, DriverError> {
    let mut refused = None;
    for camera in cameras {
        match camera.open("camera").and_then(|handle| camera.serial(&handle)) {
            Ok(serial) if serial == wanted => return Ok(Some(camera)),
            Ok(_) => {}
            Err(error) => refused = Some(error),
        }
    }
    refused.map_or(Ok(None), Err)
}

fn not_found(wanted: &Wanted, found: &[Found], cameras: usize) -> DriverError {
    let foot = found.iter().find(|found| found.product == MOTOR);
    match (cameras, foot) {
        (0, Some(foot)) => DriverError::NoPower { bus: foot.device.bus_number() },
        (0, None) => DriverError::NotFound {
            wanted: format!("{wanted} is not on the USB"),
            there: "plug in its USB cable and its own power supply".to_owned(),
        },
        (count, _) => DriverError::NotFound {
            wanted: format!("{wanted} is not among the {count} on the USB"),
            there: "`bench devices` lists them".to_owned(),
        },
    }
}

/// libusb's way to a device.
struct Libusb {
    handle: Arc<DeviceHandle<Context>>,
    transfers: Option<Transfers>,
}

impl Transport for Libusb {
    fn write(&mut self, request: u8, value: u16, index: u16, data: &[u8]) -> Result<(), TransportError> {
        let written =
            self.handle.write_control(TO_DEVICE, request, value, index, data, PATIENCE).map_err(words)?;
        if written == data.len() {
            Ok(())
        } else {
            Err(TransportError::Other(format!("{written} of {} bytes went out", data.len())))
        }
    }

    fn read(
        &mut self,
        request: u8,
        value: u16,
        index: u16,
        buffer: &mut [u8],
    ) -> Result<usize, TransportError> {
        self.handle.read_control(TO_HOST, request, value, index, buffer, PATIENCE).map_err(words)
    }

    fn start(&mut self, packets: Box<dyn Packets>) -> Result<(), TransportError> {
        self.transfers = None;
        self.transfers = Some(Transfers::start(Arc::clone(&self.handle), packets)?);
        Ok(())
    }

    fn stop(&mut self) {
        self.transfers = None;
    }
}

impl Drop for Libusb {
    fn drop(&mut self) {
        // Before the handle goes.
        self.stop();
    }
}

fn words(error: rusb::Error) -> TransportError {
    match error {
        rusb::Error::NoDevice => TransportError::Gone,
        rusb::Error::Timeout => TransportError::TimedOut,
        rusb::Error::Pipe => TransportError::Refused,
        error => TransportError::Other(error.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_kinect_is_named_by_index_or_serial_number() {
        assert_eq!("1".parse(), Ok(Wanted::Index(1)));
        assert_eq!("0000000000000000".parse(), Ok(Wanted::Serial("0000000000000000".to_owned())));
        assert_eq!("A00362807917045A".parse(), Ok(Wanted::Serial("A00362807917045A".to_owned())));
        assert!("".parse::<Wanted>().is_err());
    }

    #[test]
    fn what_is_missing_is_said_with_what_to_do() {
        let words = not_found(&Wanted::First, &[], 0).to_string();
        assert!(words.contains("not on the USB") && words.contains("power supply"), "{words}");
        let words = not_found(&Wanted::Index(3), &[], 2).to_string();
        assert!(words.contains("Kinect 3") && words.contains("bench devices"), "{words}");
    }
}
