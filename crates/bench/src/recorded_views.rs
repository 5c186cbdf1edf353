//! The three views of frames, recorded for viewers.

use bench_device::Time;
use bench_kinect::{
    Frame, KinectError,
    frame::{HEIGHT, WIDTH},
    track::{Sighting, Tracker},
    views::Views,
};
use bench_recording::{Images, View, ViewerChannel};

/// Frames come at a rate of their own: one that comes by this share of a period too early is taken all the same.
const EARLY_SHARE: f64 = 0.1;

/// Draws frames at a rate and hands them to the recorder.
pub struct RecordedViews {
    images: Images,
    period_s: f64,
    latency_s: f64,
    last: Option<Time>,
    failed: Option<KinectError>,
}

impl RecordedViews {
    /// At most `rate_hz` frames a second; `latency_s` is the time from exposure to arrival, s.
    pub fn new(images: Images, rate_hz: f64, latency_s: f64) -> Self {
        Self { images, period_s: 1.0 / rate_hz, latency_s, last: None, failed: None }
    }

    /// Takes a frame that the tracker has just looked at, if one is due. Views for which the recorder has no room are dropped.
    pub fn see(&mut self, frame: &Frame, tracker: &Tracker, sighting: &Sighting) {
        let arrived_at = frame.arrived_at;
        let due =
            self.last.is_none_or(|last| arrived_at.since_s(last) >= (1.0 - EARLY_SHARE) * self.period_s);
        if !due || self.failed.is_some() {
            return;
        }
        self.last = Some(arrived_at);
        let buffers = [(); 3].map(|()| self.images.buffer());
        match Views::draw(buffers, frame, tracker.camera(), tracker.candidates(), sighting) {
            Ok(Views { full, red, depth }) => {
                let views =
                    [(ViewerChannel::Full, full), (ViewerChannel::Red, red), (ViewerChannel::Depth, depth)];
                for (channel, image) in views {
                    let size = [WIDTH as u32, HEIGHT as u32];
                    let exposed_at = arrived_at.shifted(-self.latency_s);
                    self.images.give(View { channel, exposed_at, arrived_at, size, rgb: image.into_rgb() });
                }
            }
            Err(error) => self.failed = Some(error),
        }
    }

    /// Why the views are not all there, if they are not.
    pub fn failed(&self) -> Option<&KinectError> {
        self.failed.as_ref()
    }
}
