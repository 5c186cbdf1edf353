//! Frames on their way to the page: copied by who flies, drawn and encoded elsewhere.

use std::{
    sync::{Arc, atomic::Ordering},
    thread::{self, Thread},
    time::{Duration, Instant},
};

use axum::body::Bytes;
use bench_kinect::{
    Frame,
    camera::Camera,
    frame::{HEIGHT, WIDTH},
    track::{Candidate, Sighting, Tracker},
    views::{Image, Views},
};
use bench_rig::Calibration;
use jpeg_encoder::{ColorType, Encoder, EncodingError, SamplingFactor};
use rtrb::{Consumer, Producer, RingBuffer};

use crate::{ViewError, server::Shared};

/// Frames that are passed around: one is drawn, one waits, one is filled.
const FRAMES: usize = 3;
/// The tracker looks at no more of them.
const CANDIDATES: usize = 64;
/// Views are drawn no more often.
const APART: Duration = Duration::from_millis(30);
/// Of 100: edges of the frames around the candidates stay sharp.
const QUALITY: u8 = 80;

/// A frame with what the tracker made of it.
struct Seen {
    frame: Frame,
    candidates: Vec<Candidate>,
    sighting: Sighting,
}

/// Who flies shows frames here. Neither allocates nor locks; a frame that finds no buffer is not shown, and none is while nobody looks.
pub struct Frames {
    spare: Consumer<Seen>,
    seen: Producer<Seen>,
    shared: Arc<Shared>,
    /// Last, so that the thread finds the queue abandoned when it is woken for the end.
    wakes: Wakes,
}

/// Wakes the thread that draws, at the end too.
struct Wakes(Thread);

impl Drop for Wakes {
    fn drop(&mut self) {
        self.0.unpark();
    }
}

impl Frames {
    pub(crate) fn start(calibration: &Calibration, shared: Arc<Shared>) -> Result<Self, ViewError> {
        let (mut spares, spare) = RingBuffer::new(FRAMES);
        let (seen, frames) = RingBuffer::new(FRAMES);
        for _ in 0..FRAMES {
            let candidates = Vec::with_capacity(CANDIDATES);
            // The queue holds as many.
            let _ = spares.push(Seen { frame: Frame::default(), candidates, sighting: Sighting::default() });
        }
        let camera = Camera::new(calibration);
        let buffers = [const { Vec::new() }; 3];
        let draws = Draws { frames, spares, camera, buffers, shared: Arc::clone(&shared) };
        let thread = thread::Builder::new()
            .name("views".to_owned())
            .spawn(move || draws.run())
            .map_err(|source| ViewError::Thread { thread: "views", source })?;
        Ok(Self { spare, seen, shared, wakes: Wakes(thread.thread().clone()) })
    }

    /// Shows a frame that the tracker has just looked at.
    pub fn see(&mut self, frame: &Frame, tracker: &Tracker, sighting: &Sighting) {
        if self.shared.looking.load(Ordering::Relaxed) == 0 {
            return;
        }
        let Ok(mut seen) = self.spare.pop() else { return };
        seen.frame.copy_from(frame);
        seen.candidates.clear();
        seen.candidates.extend(tracker.candidates().iter().take(CANDIDATES));
        seen.sighting = *sighting;
        // There is room for all frames that there are.
        let _ = self.seen.push(seen);
        self.wakes.0.unpark();
    }
}

/// The thread that draws.
struct Draws {
    frames: Consumer<Seen>,
    spares: Producer<Seen>,
    camera: Camera,
    /// Of the views drawn last, to draw the next ones into.
    buffers: [Vec<u8>; 3],
    shared: Arc<Shared>,
}

impl Draws {
    fn run(mut self) {
        let mut drawn: Option<Instant> = None;
        loop {
            let Some(seen) = self.newest() else {
                if self.frames.is_abandoned() {
                    return;
                }
                thread::park();
                continue;
            };
            let views = Views::draw(
                std::mem::take(&mut self.buffers),
                &seen.frame,
                &self.camera,
                &seen.candidates,
                &seen.sighting,
            );
            let time_s = seen.frame.arrived_at.seconds();
            // There is room for all frames that there are.
            let _ = self.spares.push(seen);
            // A frame of ours has its size, and an image of that size can be encoded.
            if let Ok(views) = views {
                if let Ok(message) = message(&views, time_s) {
                    self.shared.views.send_replace(Some(message));
                }
                self.buffers = [views.full, views.red, views.depth].map(Image::into_rgb);
            }
            let now = Instant::now();
            let until = drawn.map_or(now, |drawn| drawn + APART);
            thread::sleep(until.saturating_duration_since(now));
            drawn = Some(Instant::now());
        }
    }

    /// The newest frame; those before it go back.
    fn newest(&mut self) -> Option<Seen> {
        let mut newest = self.frames.pop().ok()?;
        while let Ok(newer) = self.frames.pop() {
            let _ = self.spares.push(std::mem::replace(&mut newest, newer));
        }
        Some(newest)
    }
}

/// Time in s (f64), then for full, red and depth the length (u32) and the JPEG; little-endian.
fn message(views: &Views, time_s: f64) -> Result<Bytes, EncodingError> {
    let mut out = Vec::with_capacity(256 * 1024);
    out.extend(time_s.to_le_bytes());
    for image in [&views.full, &views.red, &views.depth] {
        encode(image, &mut out)?;
    }
    Ok(out.into())
}

fn encode(image: &Image, out: &mut Vec<u8>) -> Result<(), EncodingError> {
    let at = out.len();
    out.extend([0; 4]);
    let mut encoder = Encoder::new(&mut *out, QUALITY);
    // The thin frames around the candidates keep their colours.
    encoder.set_sampling_factor(SamplingFactor::F_1_1);
    encoder.encode(image.rgb(), WIDTH as u16, HEIGHT as u16, ColorType::Rgb)?;
    let length = (out.len() - at - 4) as u32;
    out[at..at + 4].copy_from_slice(&length.to_le_bytes());
    Ok(())
}
