//! The red marker in a frame: from pixels to metres.
//!
//! ```text
//! Bayer quads -> red? -> runs -> blobs -> size, shape, depth -> continuity -> centroid at full resolution -> metres
//! ```
//! The paper takes the largest red object. In a room with a red cupboard that is the cupboard, so a blob must have the
//! marker's physical size, its proportions, be filled, and lie where the marker can have moved to. A red thing of 5 cm is a
//! marker to this tracker: where there are two, and no history tells them apart, it says [`TrackStatus::Ambiguous`].

mod blobs;
mod gates;
mod refine;

use bench_device::{Time, TrackStatus};
use bench_rig::Calibration;
use nalgebra::{Matrix3, Vector2, Vector3};

use crate::{
    camera::Camera,
    frame::{Frame, TICKS_PER_S},
};

use blobs::Finder;
pub use blobs::{Blob, red_row};
pub use gates::Rejection;
use gates::{Judged, judge};

/// Pixels within which the centroid is known, one sigma: measured on rendered frames, with some for a real lens.
const CENTROID_SIGMA_PX: f64 = 0.1;
/// Counts within which the disparity of the marker is known, one sigma: its noise is shared by neighbours.
const DISPARITY_SIGMA: f64 = 0.25;
/// The marker's side in the image is known to a pixel or so.
const SIZE_SIGMA_PX: f64 = 1.0;
/// The largest speed against the prediction, m/s, and how far off a frame may be besides, m.
const SURPRISE_M_S: f64 = 2.0;
const SURPRISE_M: f64 = 0.10;
/// How well the track foretells depth, m, and what it loses a second, m/s.
const TRACK_SIGMA_M: f64 = 0.01;
const TRACK_SIGMA_M_S: f64 = 0.5;
/// A marker that was not there before is believed in this many frames: what noise makes of a red thing does not last.
const BELIEVED_AFTER: u32 = 2;
/// After this long without the marker it may be anywhere, s.
const FORGET_S: f64 = 0.5;
/// Share of the prediction's error that corrects the velocity.
const VELOCITY_GAIN: f64 = 0.3;
/// Candidates that are kept for the views.
const MAX_CANDIDATES: usize = 64;

/// Where the depth of a position comes from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DepthFrom {
    /// The depth image.
    #[default]
    Disparity,
    /// The marker's size in the colour image, because the depth image has no reading there.
    Size,
}

/// What the tracker made of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sighting {
    /// Whether the marker was found; all else is meaningless when it was lost.
    pub status: TrackStatus,
    /// When the marker was exposed: that of the frame, moved to the marker's row.
    pub exposed_at: Time,
    /// Reference point of the airframe, taken as level, world, m.
    pub position_m: [f64; 3],
    /// Covariance of the position, m^2.
    pub covariance_m2: [[f64; 3]; 3],
    /// Centre of the marker in the colour image.
    pub pixel: [f64; 2],
    /// Side of the marker in the colour image, pixels.
    pub size_px: f64,
    /// Depth as the device's constants and the calibration give it, m.
    pub z_m: f64,
    /// Mean raw disparity of the marker, where it was read.
    pub raw: Option<f64>,
    /// Where the depth comes from.
    pub depth_from: DepthFrom,
}

/// A red blob that was looked at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// The blob.
    pub blob: Blob,
    /// Its depth, m, where known.
    pub z_m: Option<f64>,
    /// Why it is not the marker; `None` if it may be.
    pub rejection: Option<Rejection>,
    /// Whether it was taken.
    pub chosen: bool,
}

/// Finds the marker, frame after frame.
pub struct Tracker {
    camera: Camera,
    finder: Finder,
    candidates: Vec<Candidate>,
    judged: Vec<(usize, Judged)>,
    track: Option<Track>,
    samples: Vec<u16>,
}

/// Where the marker was, in the camera frame.
#[derive(Clone, Copy, Debug)]
struct Track {
    at: Time,
    marker_m: Vector3<f64>,
    velocity_m_s: Vector3<f64>,
    /// Whether the velocity is known at all.
    moving: bool,
    /// In how many frames it was seen.
    seen: u32,
}

impl Track {
    fn predicted(&self, at: Time) -> Vector3<f64> {
        self.marker_m + self.velocity_m_s * at.since_s(self.at)
    }
}

impl Tracker {
    /// A tracker that believes in a calibration.
    pub fn new(calibration: &Calibration) -> Self {
        Self {
            camera: Camera::new(calibration),
            finder: Finder::new(),
            candidates: Vec::with_capacity(MAX_CANDIDATES),
            judged: Vec::with_capacity(MAX_CANDIDATES),
            track: None,
            samples: Vec::with_capacity(gates::MAX_SAMPLES),
        }
    }

    /// The camera as calibrated.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// The red blobs of the last frame that were large enough to look at.
    pub fn candidates(&self) -> &[Candidate] {
        &self.candidates
    }

    /// Forgets where the marker was.
    pub fn forget(&mut self) {
        self.track = None;
    }

    /// Looks for the marker in a frame whose middle row was exposed at `at`.
    pub fn track(&mut self, frame: &Frame, at: Time) -> Sighting {
        self.track = self.track.filter(|track| (0.0..=FORGET_S).contains(&at.since_s(track.at)));
        self.look(frame);
        let Some((chosen, ambiguous)) = self.choose(at) else { return Sighting::default() };
        let (index, judged) = self.judged[chosen];
        self.candidates[index].chosen = true;
        let row_s = (judged.centre.y - 239.5) * self.camera.line_time_s;
        let exposed_at = at.shifted(row_s);
        let z_m = self.depth_now(frame, exposed_at, &judged);
        let marker_m = judged.ray * z_m;
        if self.follow(exposed_at, marker_m) < BELIEVED_AFTER {
            return Sighting::default();
        }
        Sighting {
            status: if ambiguous { TrackStatus::Ambiguous } else { TrackStatus::Found },
            exposed_at,
            position_m: (self.camera.to_world(&marker_m) - self.camera.marker_offset_m).into(),
            covariance_m2: self.covariance(z_m, &judged).into(),
            pixel: judged.centre.into(),
            size_px: judged.size_px,
            z_m,
            raw: judged.raw,
            depth_from: judged.depth_from,
        }
    }

    /// Finds and judges the red blobs.
    fn look(&mut self, frame: &Frame) {
        self.candidates.clear();
        self.judged.clear();
        for blob in self.finder.find(&frame.colour) {
            if blob.area < gates::MIN_QUADS || self.candidates.len() == MAX_CANDIDATES {
                continue;
            }
            let judgement = judge(blob, frame, &self.camera, &mut self.samples);
            let (z_m, rejection) = match &judgement {
                Ok(judged) => (Some(judged.z_m), None),
                Err(rejection) => (None, Some(*rejection)),
            };
            if let Ok(judged) = judgement {
                self.judged.push((self.candidates.len(), judged));
            }
            self.candidates.push(Candidate { blob: *blob, z_m, rejection, chosen: false });
        }
    }

    /// Which of the judged blobs is the marker, and whether another might be.
    fn choose(&mut self, at: Time) -> Option<(usize, bool)> {
        let Some(track) = self.track else {
            for (index, _) in self.judged.iter().filter(|(_, judged)| !judged.plain) {
                self.candidates[*index].rejection = Some(Rejection::Doubtful);
            }
            let plain = || (0..self.judged.len()).filter(|i| self.judged[*i].1.plain);
            let unlikeness = |i: &usize| self.judged[*i].1.unlikeness;
            let best = plain().min_by(|a, b| unlikeness(a).total_cmp(&unlikeness(b)))?;
            return Some((best, plain().count() > 1));
        };
        let reach_m = SURPRISE_M + SURPRISE_M_S * at.since_s(track.at);
        let predicted = track.predicted(at);
        let mut best: Option<(usize, f64)> = None;
        let mut within = 0;
        for (i, (index, judged)) in self.judged.iter().enumerate() {
            let away_m = (judged.ray * judged.z_m - predicted).norm();
            if away_m > reach_m {
                self.candidates[*index].rejection = Some(Rejection::Elsewhere);
                continue;
            }
            within += 1;
            if best.is_none_or(|(_, nearest_m)| away_m < nearest_m) {
                best = Some((i, away_m));
            }
        }
        best.map(|(i, _)| (i, within > 1))
    }

    /// The depth at the colour image's exposure, with what the track knows of it.
    fn depth_now(&self, frame: &Frame, at: Time, judged: &Judged) -> f64 {
        let Some(track) = self.track.filter(|track| track.moving) else { return judged.z_m };
        match judged.depth_from {
            DepthFrom::Disparity => {
                // The two images are not taken at the same time.
                let lag = frame.depth_ticks.wrapping_sub(frame.colour_ticks).cast_signed();
                let lag_s = f64::from(lag) / TICKS_PER_S;
                if lag_s.abs() < 0.02 { judged.z_m - track.velocity_m_s.z * lag_s } else { judged.z_m }
            }
            DepthFrom::Size => {
                // Two guesses, each by its weight.
                let size_m2 = (judged.z_m * SIZE_SIGMA_PX / judged.size_px).powi(2);
                let track_m2 = (TRACK_SIGMA_M + TRACK_SIGMA_M_S * at.since_s(track.at)).powi(2);
                (judged.z_m * track_m2 + track.predicted(at).z * size_m2) / (size_m2 + track_m2)
            }
        }
    }

    /// Goes on with the track, or begins one; returns in how many frames the marker was seen.
    fn follow(&mut self, at: Time, marker_m: Vector3<f64>) -> u32 {
        let seen = self.track.map_or(0, |track| track.seen).saturating_add(1);
        let (velocity_m_s, moving) = match self.track {
            Some(track) if at.since_s(track.at) > 1e-3 => {
                let dt_s = at.since_s(track.at);
                let error = (marker_m - track.predicted(at)) / dt_s;
                // The first difference is the best there is of the velocity.
                let gain = if track.moving { VELOCITY_GAIN } else { 1.0 };
                (track.velocity_m_s + error * gain, true)
            }
            _ => (Vector3::zeros(), false),
        };
        self.track = Some(Track { at, marker_m, velocity_m_s, moving, seen });
        seen
    }

    /// The centroid's error across the ray and the depth's error along it.
    fn covariance(&self, z_m: f64, judged: &Judged) -> Matrix3<f64> {
        let ray = judged.ray;
        let lateral_m = CENTROID_SIGMA_PX * z_m / self.camera.colour_focal_px();
        let depth_m = match judged.depth_from {
            DepthFrom::Disparity => DISPARITY_SIGMA * self.camera.disparity().step_m(z_m),
            DepthFrom::Size => z_m * SIZE_SIGMA_PX / judged.size_px,
        };
        let across = Matrix3::from_diagonal(&Vector3::new(lateral_m.powi(2), lateral_m.powi(2), 0.0));
        let local = across + ray * ray.transpose() * depth_m.powi(2);
        self.camera.rotation() * local * self.camera.rotation().transpose()
    }
}

/// A blob's centre as a vector.
fn centre_px(blob: &Blob) -> Vector2<f64> {
    blob.centre_px().into()
}
