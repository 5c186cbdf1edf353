use crate::{DeviceError, Time};

/// What the tracker made of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TrackStatus {
    /// The marker was found; the position is valid.
    Found,
    /// No marker in this frame; the position is not valid.
    #[default]
    Lost,
    /// More than one candidate; the position is that of the best one.
    Ambiguous,
}

/// One frame's worth of position, in the world frame: x and y horizontal, z up, origin on the take-off surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PositionSample {
    /// When the frame was exposed, *as the tracker believes*: arrival less the calibrated latency. A real latency that
    /// differs from the calibrated one is not visible here.
    pub exposed_at: Time,
    /// When the sample reached the loop.
    pub arrived_at: Time,
    /// x, y, z in metres.
    pub position_m: [f64; 3],
    /// Heading (rotation about z, counter-clockwise from +x) in radians, where the tracker gives one.
    pub heading_rad: Option<f64>,
    /// Centre of the marker in the image, pixels; zero where there is no image.
    pub pixel: [f64; 2],
    /// Side of the marker in the image, pixels; zero where there is no image.
    pub size_px: f64,
    /// Whether the position can be used.
    pub status: TrackStatus,
}

/// A stream of positions.
pub trait PositionSource {
    /// The next sample that has arrived and was not yet returned, oldest first; `None` when there is none. Never
    /// blocks. Frames that were dropped never show up.
    fn poll(&mut self) -> Result<Option<PositionSample>, DeviceError>;
}
