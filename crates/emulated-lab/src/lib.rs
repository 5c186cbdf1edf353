//! A lab without hardware, for tests: an emulated Kinect and an emulated PSoC5 on the USB of a user-mode kernel. What joins them is a
//! virtual airframe, outside of the process that controls it: the board's pins move it, the camera sees it.
//!
//! ```text
//!  bench hil --- /dev/ttyACM0 (cdc_acm) --- the board's firmware, a Linux program ---- pins
//!      |                                                                                 v
//!      '------- libusb, isochronous ------- emulated Kinect <--- rendered frames --- virtual airframe
//! ```
//! The binary `emulated-lab` is the first process of that kernel ([`bench_usb_lab::guest`]); the file `lab.toml` in its work folder says
//! what there is ([`Settings`]). On port 0 is the Kinect's camera, on port 1 its motor, on port 2 the board. Without a flight the camera
//! shows [`Reel`]: the same frames over and over, which tell by their time stamps which they are.
//!
//! The binary `kinect-client` streams through the driver and compares with those.

mod camera;
mod flight;
mod reel;
mod settings;
mod shutter;

pub use camera::{CameraDevice, FootDevice};
pub use flight::{Flight, Pins};
pub use reel::{PERIOD_TICKS, Reel};
pub use settings::{Faults, Settings};
pub use shutter::Shutter;
