//! The Kinect v1 on the USB.
//!
//! ```text
//!  libusb's events -> isochronous (unsafe, all of it) -> Packets -> assembly -> pairing, time -> Streaming: a FrameSource
//!  Kinect: commands -> control -> Transport -> libusb
//! ```
//! All but [`open`] and [`list`] works over the trait [`Transport`], so that a device within the process ([`emulator`]) does as well as
//! one on the USB. A Kinect is opened, its own constants are read; [`Kinect::stream`] starts both streams. What is lost on the way is marked
//! in the frames' masks; what contradicts itself is given up ([`Statistics`]).

pub mod assembly;
mod blocks;
pub mod clock;
pub mod control;
mod driver;
pub mod emulator;
mod error;
mod frames;
mod isochronous;
mod libusb;
mod motor;
pub mod packet;
mod transport;

pub use blocks::Blocks;
pub use driver::{Kinect, Model, SHUTTER_UNIT_S, Settings, Streaming};
pub use error::DriverError;
pub use frames::{DEVICE, SILENCE_S, Statistics};
pub use libusb::{Listed, Wanted, list, open};
pub use motor::{Attitude, Led, Motor};
pub use packet::Stream;
pub use transport::{Packets, Transport, TransportError};
