use bench_device::{DeviceError, PositionSample, PositionSource, TrackStatus};

use crate::{
    frame::{Frame, FrameSource},
    track::{Sighting, Tracker},
};

/// A position source made of frames and a tracker.
///
/// `exposed_at` of a sample is arrival less the calibrated latency, moved to the marker's row. A frame without the marker gives
/// a sample whose status is lost.
pub struct TrackedFrames<S, W> {
    frames: S,
    tracker: Tracker,
    latency_s: f64,
    watch: W,
}

impl<S: FrameSource, W: FnMut(&Frame, &Tracker, &Sighting)> TrackedFrames<S, W> {
    /// `latency_s` is the calibrated time from exposure to arrival, s; `watch` is shown each frame once it is tracked.
    pub fn new(frames: S, tracker: Tracker, latency_s: f64, watch: W) -> Self {
        Self { frames, tracker, latency_s, watch }
    }

    /// Where the frames come from.
    pub fn frames(&self) -> &S {
        &self.frames
    }
}

impl<S: FrameSource, W: FnMut(&Frame, &Tracker, &Sighting)> PositionSource for TrackedFrames<S, W> {
    fn poll(&mut self) -> Result<Option<PositionSample>, DeviceError> {
        let Some(frame) = self.frames.poll_frame()? else { return Ok(None) };
        let arrived_at = frame.arrived_at;
        let exposed_at = arrived_at.shifted(-self.latency_s);
        let sighting = self.tracker.track(frame, exposed_at);
        (self.watch)(frame, &self.tracker, &sighting);
        Ok(Some(if sighting.status == TrackStatus::Lost {
            PositionSample { exposed_at, arrived_at, ..PositionSample::default() }
        } else {
            PositionSample {
                exposed_at: sighting.exposed_at,
                arrived_at,
                position_m: sighting.position_m,
                heading_rad: None,
                pixel: sighting.pixel,
                size_px: sighting.size_px,
                status: sighting.status,
            }
        }))
    }
}
