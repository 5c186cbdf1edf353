use bench_device::{DeviceError, Time};

use crate::frame::{Frame, FrameSource};

use super::{Pose, Renderer};

/// An exposure whose frame has arrived.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure {
    /// The airframe in the middle of the exposure.
    pub pose: Pose,
    /// When the frame is on the host.
    pub arrives_at: Time,
}

/// Frames of exposures, rendered when they are asked for.
pub struct RenderedFrames<E> {
    renderer: Renderer,
    exposures: E,
    frame: Frame,
}

impl<E: FnMut() -> Option<Exposure>> RenderedFrames<E> {
    /// `exposures` gives the next exposure whose frame has arrived, if there is one.
    pub fn new(renderer: Renderer, exposures: E) -> Self {
        Self { renderer, exposures, frame: Frame::default() }
    }
}

impl<E: FnMut() -> Option<Exposure>> FrameSource for RenderedFrames<E> {
    fn poll_frame(&mut self) -> Result<Option<&Frame>, DeviceError> {
        let Some(exposure) = (self.exposures)() else { return Ok(None) };
        self.renderer.render(exposure.pose.time, Some(&exposure.pose), &mut self.frame);
        self.frame.arrived_at = exposure.arrives_at;
        Ok(Some(&self.frame))
    }
}
