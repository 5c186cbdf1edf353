//! Kinect v1 frames: what they hold, how they come about, and what the tracker makes of them.
//!
//! - [`frame`]: one colour (Bayer) and one depth (11 bit) image with what was lost of them; [`FrameSource`], which a driver,
//!   a renderer and a recording implement; packing and time stamps.
//! - [`camera`]: pixels, disparity and metres, from a rig's calibration.
//! - [`render`]: what a Kinect would see of the virtual airframe.
//! - [`track`]: from a frame to the marker's position; [`TrackedFrames`] makes a position source of it.
//! - [`views`]: the paper's three views of a frame, as images.
//! - [`fakenect`]: recorded frames in libfreenect's folder format, both ways.
//! - [`calibrate`]: pose, depth scale and latency from frames of a marker at measured positions.
//!
//! The crate knows devices and rigs, not the plant: whoever flies hands the renderer a [`render::Pose`] an exposure.
//! Tracking a frame allocates nothing after the first.

pub mod calibrate;
pub mod camera;
mod error;
pub mod fakenect;
pub mod frame;
pub mod render;
mod source;
pub mod track;
#[cfg(feature = "usb")]
pub mod usb;
pub mod views;

pub use error::KinectError;
pub use frame::{Frame, FrameSource};
pub use source::TrackedFrames;

#[cfg(test)]
mod testing {
    use std::path::Path;

    use bench_rig::{Calibration, Rig};

    /// That of the virtual rig.
    pub(crate) fn calibration() -> Calibration {
        let rig = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs/virtual.toml");
        Rig::load(rig).unwrap().calibration.unwrap()
    }
}
