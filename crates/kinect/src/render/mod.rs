//! What a Kinect would see of the virtual airframe: Bayer colour and raw depth, with the sensor's faults.
//!
//! Modelled: both cameras' lenses and the baseline between them; exposure time and rolling shutter, so that a moving
//! marker is smeared and sheared; light, shot and read noise, 8 bits; disparity noise that neighbours share, lateral jitter,
//! quantisation, holes, the shadow of the pattern's emitter, eight blind columns, limited range. Figures and sources are
//! with [`Settings`]. Not modelled: rotors, reflections, the pattern's smoothing over its window, haze of the lens.
//!
//! The airframe is a dark box with the marker standing above it. The marker is drawn over the box, which is right as long as
//! the camera sees it from less than 23 degrees below.

mod background;
mod noise;
mod raster;
pub mod scene;
mod source;

use bench_device::Time;
use bench_rig::Calibration;
use nalgebra::{UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::{
    camera::Camera,
    frame::{Frame, HEIGHT, NO_READING, PIXELS, TICKS_PER_S, WIDTH, filter, ticks_at},
};

use background::Background;
use raster::Moving;
pub use source::{Exposure, RenderedFrames};

/// The airframe at the middle of an exposure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// When the middle row of the colour image is in the middle of its exposure.
    pub time: Time,
    /// Reference point, world, m.
    pub position_m: Vector3<f64>,
    /// World, m/s.
    pub velocity_m_s: Vector3<f64>,
    /// Body to world.
    pub attitude: UnitQuaternion<f64>,
    /// Body, rad/s.
    pub body_rate_rad_s: Vector3<f64>,
}

impl Pose {
    /// Level and at rest, heading along x.
    pub fn at_rest(time: Time, position_m: Vector3<f64>) -> Self {
        Self {
            time,
            position_m,
            velocity_m_s: Vector3::zeros(),
            attitude: UnitQuaternion::identity(),
            body_rate_rad_s: Vector3::zeros(),
        }
    }
}

/// The sensor's faults and the light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Exposure of a row of the colour image, s. Fixed, as a colour tracker wants it.
    pub exposure_s: f64,
    /// The depth image's middle against the colour image's, s (the streams are within 2 ms of one another, `OpenKinect`).
    pub depth_lag_s: f64,
    /// Grey levels of a white surface that sends all light back.
    pub full_scale: f64,
    /// Noise without light, one sigma, grey levels.
    pub read_noise: f64,
    /// Variance that light adds, grey levels squared a grey level.
    pub shot_noise: f64,
    /// Noise of the disparity before rounding, one sigma, counts. Rounding adds 0.29. Neighbours share it (3 x 3).
    pub disparity_noise: f64,
    /// Jitter of where a disparity is taken from, one sigma, pixels (Nguyen, Izadi and Lovell, 3DIMPVT 2012).
    pub lateral_jitter_px: f64,
    /// Share of pixels without a reading, in patches of 5 x 5.
    pub holes: f64,
    /// Columns without a reading at the right edge.
    pub blind_columns: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            exposure_s: 0.010,
            depth_lag_s: 0.001,
            full_scale: 255.0,
            read_noise: 1.0,
            shot_noise: 0.05,
            disparity_noise: 0.4,
            lateral_jitter_px: 0.8,
            holes: 0.1,
            blind_columns: 8,
        }
    }
}

/// Grey levels are held in 64ths, noise in 512ths of them, disparity in 16ths of a count: all fit 16 bits.
const GREY: f32 = 64.0;
const COUNT: f32 = 16.0;
/// "No reading" among the disparities in 16ths.
const NONE: i16 = i16::MAX;
/// The disparities have a margin, so that a jittered place is always one of theirs.
const MARGIN: usize = 8;
const STRIDE: usize = WIDTH + 2 * MARGIN;
/// How many jitters are drawn.
const JITTERS: usize = 1 << 16;

/// Makes frames of one scene. The same seed and poses give the same frames.
pub struct Renderer {
    camera: Camera,
    settings: Settings,
    marker: [f32; 3],
    body: [f32; 3],
    /// Mean and deviation of each colour pixel, the airframe's patch put in a frame at a time.
    grey: Vec<i16>,
    deviation: Vec<u8>,
    /// Mean disparity of each pixel, likewise.
    disparity: Vec<i16>,
    clean: Clean,
    line: noise::Line,
    shared: Vec<i16>,
    holes: Vec<bool>,
    jitter: Vec<isize>,
    coverage: raster::Coverage,
    rng: ChaCha8Rng,
    deviations: Vec<u8>,
}

/// The images without an airframe, to put back after each frame.
struct Clean {
    grey: Vec<i16>,
    deviation: Vec<u8>,
    disparity: Vec<i16>,
    depth_m: Vec<f32>,
}

impl Renderer {
    /// A renderer for the camera of a calibration, taken as what the camera really is.
    pub fn new(calibration: &Calibration, scene: &scene::Scene, settings: Settings, seed: u64) -> Self {
        let camera = Camera::new(calibration);
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let background = Background::new(&camera, scene);
        let deviations: Vec<u8> = (0..256)
            .map(|grey| {
                let sigma = (settings.read_noise.powi(2) + settings.shot_noise * f64::from(grey)).sqrt();
                (16.0 * sigma).min(255.0).round() as u8
            })
            .collect();
        let full = settings.full_scale as f32;
        let grey: Vec<i16> =
            background.colour.iter().map(|share| ((share * full).min(255.0) * GREY) as i16).collect();
        let deviation: Vec<u8> =
            grey.iter().map(|grey| deviations[(f32::from(*grey) / GREY) as usize]).collect();
        let mut disparity = vec![NONE; STRIDE * (HEIGHT + 2 * MARGIN)];
        for (place, out) in disparity.iter_mut().enumerate() {
            let x = (place % STRIDE).saturating_sub(MARGIN).min(WIDTH - 1);
            let y = (place / STRIDE).saturating_sub(MARGIN).min(HEIGHT - 1);
            let z_m = f64::from(background.depth_m[y * WIDTH + x]);
            if z_m.is_finite() {
                *out = counts(camera.disparity().raw(z_m));
            }
        }
        let shared = noise::field(&mut rng, 1);
        let sigma = settings.disparity_noise as f32 * COUNT;
        let shared = shared.iter().map(|x| (x * sigma).round() as i16).collect();
        let patches = noise::field(&mut rng, 2);
        let edge = if settings.holes > 0.0 { noise::quantile(&patches, settings.holes) } else { f32::MIN };
        let mut offset = || {
            let far = MARGIN as f64 / 2.0;
            (noise::normal(&mut rng) * settings.lateral_jitter_px).clamp(-far, far).round() as isize
        };
        let jitter = (0..JITTERS + WIDTH).map(|_| offset() * STRIDE.cast_signed() + offset()).collect();
        let normal = camera.rotation() * Vector3::z();
        let lit = |albedo| scene.radiance(albedo, &normal).map(|share| share as f32 * full);
        Self {
            marker: lit(scene::RED),
            body: lit([0.06, 0.06, 0.07]),
            clean: Clean {
                grey: grey.clone(),
                deviation: deviation.clone(),
                disparity: disparity.clone(),
                depth_m: background.depth_m,
            },
            grey,
            deviation,
            disparity,
            line: noise::Line::new(&mut rng),
            shared,
            holes: patches.iter().map(|x| *x < edge).collect(),
            jitter,
            coverage: raster::Coverage::default(),
            rng,
            deviations,
            camera,
            settings,
        }
    }

    /// The frame of an exposure, into `frame`, which keeps its arrival time. Without a pose the room is empty.
    pub fn render(&mut self, time: Time, pose: Option<&Pose>, frame: &mut Frame) {
        let mut touched = Vec::new();
        if let Some(pose) = pose {
            let things = [self.body_at(pose), self.marker_at(pose)];
            for thing in things.iter().flatten() {
                touched.push((self.paint(thing), self.carve(thing)));
            }
        }
        self.expose_colour(&mut frame.colour);
        self.expose_depth(&mut frame.depth);
        frame.colour_valid.reset();
        frame.depth_valid.reset();
        frame.colour_ticks = ticks_at(time);
        let lag = (self.settings.depth_lag_s * TICKS_PER_S).round() as i32;
        frame.depth_ticks = frame.colour_ticks.wrapping_add_signed(lag);
        for (colour, depth) in touched {
            for row in colour.y0..colour.y1 {
                let range = row * WIDTH + colour.x0..row * WIDTH + colour.x1;
                self.grey[range.clone()].copy_from_slice(&self.clean.grey[range.clone()]);
                self.deviation[range.clone()].copy_from_slice(&self.clean.deviation[range]);
            }
            for row in depth.y0..depth.y1 {
                let begin = (row + MARGIN) * STRIDE + MARGIN;
                let range = begin + depth.x0..begin + depth.x1;
                self.disparity[range.clone()].copy_from_slice(&self.clean.disparity[range]);
            }
        }
    }

    fn marker_at(&self, pose: &Pose) -> Option<Thing> {
        let half = 0.5 * self.camera.marker_side_m;
        let corner = |y: f64, z: f64| self.camera.marker_offset_m + Vector3::new(0.0, y * half, z * half);
        let corners = [corner(-1.0, -1.0), corner(-1.0, 1.0), corner(1.0, 1.0), corner(1.0, -1.0)];
        Some(Thing { colour: self.marker, outline: Moving::new(&self.camera, pose, &corners)? })
    }

    /// A box of 7 cm x 7 cm x 1.5 cm on the reference point: a Hubsan Q4 without its rotors.
    fn body_at(&self, pose: &Pose) -> Option<Thing> {
        let corners = [0, 1, 2, 3, 4, 5, 6, 7].map(|bits: u8| {
            let side = |bit: u8| if bits >> bit & 1 == 1 { 1.0 } else { -1.0 };
            Vector3::new(0.035 * side(0), 0.035 * side(1), 0.0075 + 0.0075 * side(2))
        });
        Some(Thing { colour: self.body, outline: Moving::hull(&self.camera, pose, &corners)? })
    }

    /// Puts a thing into the means of the colour image; returns what was touched.
    fn paint(&mut self, thing: &Thing) -> raster::Patch {
        let patch = self.coverage.fill(&thing.outline, self.camera.line_time_s, self.settings.exposure_s);
        for y in patch.y0..patch.y1 {
            for x in patch.x0..patch.x1 {
                let share = self.coverage.at(&patch, x, y);
                if share > 0.0 {
                    let i = y * WIDTH + x;
                    let behind = f32::from(self.grey[i]) / GREY;
                    let grey = (behind + share * (thing.colour[filter(x, y)] - behind)).clamp(0.0, 255.0);
                    self.grey[i] = (grey * GREY) as i16;
                    self.deviation[i] = self.deviations[grey as usize];
                }
            }
        }
        patch
    }

    /// Puts a thing into the means of the depth image, with the shadow that it casts on what the emitter should have lit;
    /// returns what was touched.
    fn carve(&mut self, thing: &Thing) -> raster::Patch {
        let outline = &thing.outline;
        let lag_s = self.settings.depth_lag_s;
        let mut touched = raster::Patch::empty();
        let law = self.camera.disparity();
        // Emitter and depth camera are 7.5 cm apart; seen from behind, the emitter is to the right.
        let emitter_px_m = self.camera.depth_focal_px() * 0.075;
        for y in outline.depth_rows(self.camera.line_time_s, lag_s) {
            let time_s = lag_s + raster::row_time_s(y, self.camera.line_time_s);
            let Some((from, to)) = outline.depth_span(y as f64, time_s) else { continue };
            let (first, end) =
                ((from.ceil().max(0.0)) as usize, (to + 1.0).floor().clamp(0.0, WIDTH as f64) as usize);
            if first >= end {
                continue;
            }
            let row = &mut self.disparity[(y + MARGIN) * STRIDE + MARGIN..][..WIDTH];
            for (x, out) in row.iter_mut().enumerate().take(end).skip(first) {
                *out = counts(outline.raw(law, x as f64, y as f64, time_s));
            }
            let near_m = outline.depth_m(time_s);
            let mut x = first;
            while x > 0 {
                x -= 1;
                let behind_m = f64::from(self.clean.depth_m[y * WIDTH + x]);
                let reach = emitter_px_m * (1.0 / near_m - 1.0 / behind_m);
                if first as f64 - x as f64 > reach {
                    x += 1;
                    break;
                }
                row[x] = NONE;
            }
            touched.include(x, y);
            touched.include(end - 1, y);
        }
        touched
    }

    fn expose_colour(&mut self, colour: &mut [u8]) {
        for (y, out) in colour.chunks_exact_mut(WIDTH).enumerate() {
            let noise = self.line.from(self.rng.random(), WIDTH);
            let grey = &self.grey[y * WIDTH..][..WIDTH];
            let deviation = &self.deviation[y * WIDTH..][..WIDTH];
            for (((out, grey), deviation), noise) in out.iter_mut().zip(grey).zip(deviation).zip(noise) {
                let noise = i16::from(*noise) * i16::from(*deviation);
                *out = ((*grey + (noise >> 3) + 32) >> 6).clamp(0, 255) as u8;
            }
        }
    }

    fn expose_depth(&mut self, depth: &mut [u16]) {
        let at: [u32; 4] = self.rng.random();
        let at = at.map(|place| place as usize % noise::SIDE);
        let blind = WIDTH - self.settings.blind_columns.min(WIDTH);
        for (y, out) in depth.chunks_exact_mut(WIDTH).enumerate() {
            let jitter = &self.jitter[self.rng.random_range(0..JITTERS)..][..WIDTH];
            let shared = &self.shared[(y + at[0]) % noise::SIDE * noise::SIDE..][..noise::SIDE];
            let holes = &self.holes[(y + at[1]) % noise::SIDE * noise::SIDE..][..noise::SIDE];
            let begin = (y + MARGIN) * STRIDE + MARGIN;
            for (x, (out, jitter)) in out.iter_mut().zip(jitter).enumerate() {
                let mean = self.disparity[(begin + x).wrapping_add_signed(*jitter)];
                let noise = shared[(x + at[2]) % noise::SIDE];
                let hole = holes[(x + at[3]) % noise::SIDE];
                let raw = ((i32::from(mean) + i32::from(noise) + 8) >> 4).clamp(0, 2046) as u16;
                *out = if hole || mean == NONE { NO_READING } else { raw };
            }
            out[blind..].fill(NO_READING);
        }
    }
}

/// A thing that moves, in its colour.
struct Thing {
    colour: [f32; 3],
    outline: Moving,
}

/// A disparity in 16ths of a count; out of range is no reading.
fn counts(raw: f64) -> i16 {
    if (0.0..2046.0).contains(&raw) { (raw as f32 * COUNT).round() as i16 } else { NONE }
}

const _: () = assert!(PIXELS == WIDTH * HEIGHT && MARGIN * 2 < WIDTH);
