//! The virtual lab as a Kinect sees it: joins the plant's exposures, the renderer and the tracker.

use std::{
    fmt::Write as _,
    path::{Path, PathBuf},
};

use anyhow::{anyhow, bail};
use bench_device::{PositionSource, TrackStatus};
use bench_kinect::{
    Frame, KinectError, TrackedFrames,
    render::{Exposure, Pose, RenderedFrames, Renderer, Settings, scene::Scene},
    track::{Sighting, Tracker},
    views::Views,
};
use bench_plant::lab::Exposures;
use bench_rig::{Calibration, Mission, PhaseAction, Rig};

/// Lies beside recorded frames: the rig by whose calibration they were made.
pub const RIG_BESIDE_FRAMES: &str = "rig.toml";

/// The calibration of a rig; an error that says how to get one.
pub fn calibration<'a>(rig: &'a Rig, file: &Path) -> anyhow::Result<&'a Calibration> {
    rig.calibration.as_ref().ok_or_else(|| {
        anyhow!(
            "{} has no calibration, so nobody knows what its camera sees; add a table [calibration] (as in \
             the built-in rig virtual) or `calibration = \"FILE\"` with a file made by `bench calibrate`",
            file.display()
        )
    })
}

/// What the camera of a room sees.
pub fn renderer(calibration: &Calibration, scene: &Scene, seed: u64) -> Renderer {
    Renderer::new(calibration, scene, Settings::default(), seed)
}

/// The tracker of one marker gives no heading, so nothing can hold it.
pub fn check_mission(mission: &Mission) -> anyhow::Result<()> {
    let turns = mission.phases.iter().any(|phase| match &phase.action {
        PhaseAction::Hold { heading_rad, .. } => {
            heading_rad.points().iter().any(|[_, heading]| *heading != 0.0)
        }
        _ => false,
    });
    if turns {
        bail!(
            "mission {} turns the heading, which a tracker of one marker does not see; fly it without frames, or choose \
             another mission",
            mission.name
        );
    }
    Ok(())
}

/// A position source that renders each exposure of the lab, in a room with red distractors, and tracks the marker in the frame; `watch` is shown each.
pub fn tracker<'a>(
    mut exposures: Exposures,
    calibration: &Calibration,
    rig: &Rig,
    seed: u64,
    watch: impl FnMut(&Frame, &Tracker, &Sighting) + 'a,
) -> impl PositionSource + 'a {
    let poll = move || {
        exposures.poll().map(|exposure| Exposure {
            pose: Pose {
                time: exposure.exposed_at,
                position_m: exposure.position_m,
                velocity_m_s: exposure.velocity_m_s,
                attitude: exposure.attitude,
                body_rate_rad_s: exposure.body_rate_rad_s,
            },
            arrives_at: exposure.arrives_at,
        })
    };
    let frames = RenderedFrames::new(renderer(calibration, &Scene::with_distractors(), seed), poll);
    TrackedFrames::new(frames, Tracker::new(calibration), rig.tracker.latency_s.value, watch)
}

/// Counts what becomes of frames, and draws every so many of them.
#[derive(Default)]
pub struct Watch {
    /// Frames.
    pub frames: u64,
    /// Of these, without the marker.
    pub lost: u64,
    /// With more than one thing that may be the marker.
    pub ambiguous: u64,
    /// Images written.
    pub images: u64,
    views: Option<(PathBuf, u64)>,
    failed: Option<KinectError>,
}

impl Watch {
    /// Draws the first of every `every` frames into `folder`, which is made.
    pub fn new(views: Option<&Path>, every: u64) -> anyhow::Result<Self> {
        if let Some(folder) = views {
            std::fs::create_dir_all(folder)
                .map_err(|error| anyhow!("cannot make the folder {}: {error}", folder.display()))?;
        }
        Ok(Self { views: views.map(|folder| (folder.to_owned(), every.max(1))), ..Self::default() })
    }

    /// Takes note of a frame.
    pub fn see(&mut self, frame: &Frame, tracker: &Tracker, sighting: &Sighting) {
        let number = self.frames;
        self.frames += 1;
        self.lost += u64::from(sighting.status == TrackStatus::Lost);
        self.ambiguous += u64::from(sighting.status == TrackStatus::Ambiguous);
        let Some((folder, every)) = &self.views else { return };
        if self.failed.is_none() && number.is_multiple_of(*every) {
            let saved = Views::new(frame, tracker, sighting)
                .and_then(|views| views.save(folder, &format!("frame-{number:06}")));
            match saved {
                Ok(paths) => self.images += paths.len() as u64,
                Err(error) => self.failed = Some(error),
            }
        }
    }

    /// Why the views are not all there, if they are not.
    pub fn failed(&self) -> Option<&KinectError> {
        self.failed.as_ref()
    }

    /// One line for a person.
    pub fn in_words(&self) -> String {
        let found = self.frames - self.lost;
        let share = 100.0 * found as f64 / self.frames.max(1) as f64;
        let mut words = format!("  marker in {found} of {} frames ({share:.1} %)", self.frames);
        // Writing to a String cannot fail.
        if self.ambiguous > 0 {
            let _ = write!(words, ", {} of them doubtful", self.ambiguous);
        }
        if let Some((folder, _)) = self.views.as_ref().filter(|_| self.images > 0) {
            let _ = write!(words, "; {} views in {}", self.images, folder.display());
        }
        words + "\n"
    }

    /// The same for a program.
    pub fn as_json(&self) -> serde_json::Value {
        serde_json::json!({
            "frames": self.frames,
            "found": self.frames - self.lost,
            "ambiguous": self.ambiguous,
            "images": self.images,
        })
    }
}
