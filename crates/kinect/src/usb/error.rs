use thiserror::Error;

use super::Model;

/// What can go wrong with a Kinect on the USB.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum DriverError {
    /// The USB itself cannot be used.
    #[error("the USB cannot be looked at: {detail} (is there a USB controller, and /dev/bus/usb?)")]
    NoUsb {
        /// What the USB library says.
        detail: String,
    },
    /// There is no such Kinect.
    #[error("{wanted}; {there}")]
    NotFound {
        /// What was looked for.
        wanted: String,
        /// What there is, and what to do.
        there: String,
    },
    /// Its other parts are there, but not the camera.
    #[error(
        "a Kinect is on the USB (bus {bus}), but not its camera: plug in the Kinect's own power supply; the USB alone feeds only \
         its motor"
    )]
    NoPower {
        /// The bus of the part that is there.
        bus: u8,
    },
    /// This user may not use the device.
    #[error(
        "{device} may not be used by this user; run `bench udev --install` as root, and plug the Kinect in again"
    )]
    NoAccess {
        /// Which part, and where.
        device: String,
    },
    /// Somebody else has it.
    #[error(
        "{device} is in use; end the program that has it open (freenect-glview, another bench), or unload the kernel's own \
         driver with `modprobe -r gspca_kinect`"
    )]
    Busy {
        /// Which part, and where.
        device: String,
    },
    /// It cannot be opened for another reason.
    #[error("{device} cannot be opened: {detail}; unplug it and its power supply, and plug them in again")]
    CannotOpen {
        /// Which part, and where.
        device: String,
        /// What the USB library says.
        detail: String,
    },
    /// No answer to a command.
    #[error("the Kinect does not answer ({command}); unplug it and its power supply, and plug them in again")]
    NoAnswer {
        /// Which command.
        command: &'static str,
    },
    /// An answer that makes no sense.
    #[error(
        "the Kinect's answer makes no sense ({command}: {detail}); unplug it and its power supply, and plug them in again; if that does \
         not help, try another cable or port"
    )]
    BadAnswer {
        /// Which command.
        command: &'static str,
        /// What is wrong with it.
        detail: String,
    },
    /// Transfers for the image streams are refused.
    #[error(
        "the USB does not carry the images: {detail}; a Kinect needs most of a USB 2 controller, so unplug cameras and disks from the \
         same controller, or use a port of another one"
    )]
    NoStream {
        /// What the USB library says.
        detail: String,
    },
    /// It was unplugged.
    #[error("the Kinect is gone; check its cable and its power supply")]
    Gone,
    /// This model's motor is out of reach.
    #[error("the motor and accelerometer of a {model} cannot be used: {why}")]
    NoMotor {
        /// Which model.
        model: Model,
        /// Why not.
        why: &'static str,
    },
    /// A setting that the device cannot have.
    #[error("{what} of {value} is out of range: {range}")]
    OutOfRange {
        /// Which setting.
        what: &'static str,
        /// What was asked for.
        value: f64,
        /// What it can be.
        range: &'static str,
    },
}
