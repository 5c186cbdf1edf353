//! Whether a red blob can be the marker.

use nalgebra::Vector3;

use crate::{
    camera::Camera,
    frame::{Frame, HEIGHT, NO_READING, WIDTH},
};

use super::{Blob, DepthFrom, centre_px};

/// Blobs of fewer quads are not looked at: the marker has 9 at 4 m.
pub(super) const MIN_QUADS: u64 = 5;
/// The most depth pixels that are read of a blob.
pub(super) const MAX_SAMPLES: usize = 1024;
/// Long and short side against the marker's: motion blur makes it longer, a turn of the airframe narrower.
const LONG: std::ops::RangeInclusive<f64> = 0.72..=1.45;
const SHORT: std::ops::RangeInclusive<f64> = 0.45..=1.3;
/// Whole quads: a side is known to this, pixels.
const SIDE_SLACK_PX: f64 = 1.5;
/// Blur of a marker that moves at 3 m/s for 10 ms: its way, m.
const BLUR_M: f64 = 0.03;
/// Share of the rectangle with the same moments; small blobs are ragged.
const MIN_FILL: f64 = 0.85;
const MAX_ASPECT: f64 = 2.3;
/// Counts about the median within which the mean disparity is taken: two sigmas of noise and rounding.
const NEAR_MEDIAN: u16 = 1;

/// Why a red blob is not the marker.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rejection {
    /// It is larger or smaller than the marker, at any distance or at its own.
    Size,
    /// It is longer than wide.
    Aspect,
    /// It has holes, notches or arms.
    Fill,
    /// It reaches the edge of the image, or pixels that were lost.
    Cut,
    /// It has no depth, and was not there before.
    NoDepth,
    /// It is not where the marker can have moved to.
    Elsewhere,
}

/// A blob that may be the marker.
#[derive(Clone, Copy, Debug)]
pub(super) struct Judged {
    pub z_m: f64,
    pub depth_from: DepthFrom,
    pub raw: Option<f64>,
    pub size_px: f64,
    /// Camera frame.
    pub marker_m: Vector3<f64>,
    /// How much the size is off, as a ratio's logarithm.
    pub unlikeness: f64,
}

pub(super) fn judge(
    blob: &Blob,
    frame: &Frame,
    camera: &Camera,
    scratch: &mut Vec<u16>,
) -> Result<Judged, Rejection> {
    let ([long_px, short_px], fill) = blob.sides_px();
    let focal_px = camera.colour_focal_px();
    let side_m = camera.marker_side_m;
    // At half a metre it is as large as it gets.
    let largest_px = focal_px * (side_m + BLUR_M) / 0.5;
    if long_px > largest_px * 1.2 {
        return Err(Rejection::Size);
    }
    if long_px > MAX_ASPECT * short_px + SIDE_SLACK_PX {
        return Err(Rejection::Aspect);
    }
    if fill < MIN_FILL {
        return Err(Rejection::Fill);
    }
    if blob.x0 == 0 || blob.y0 == 0 || 2 * blob.x1 >= WIDTH || 2 * blob.y1 >= HEIGHT || torn(blob, frame) {
        return Err(Rejection::Cut);
    }
    let size_px = (long_px * short_px).sqrt();
    let by_size_m = focal_px * side_m / size_px;
    let centre = centre_px(blob);
    let ray = camera.colour_ray(centre);
    let (z_m, raw) = match depth(frame, camera, &ray, by_size_m, size_px, scratch) {
        Some((z_m, raw)) => (z_m, Some(raw)),
        None => (by_size_m, None),
    };
    // What a pixel is worth at its distance.
    let px_m = z_m / focal_px;
    let slack_m = SIDE_SLACK_PX * px_m;
    let (long_m, short_m) = (long_px * px_m, short_px * px_m);
    if long_m > LONG.end() * side_m + BLUR_M.min(slack_m + 0.012)
        || long_m < LONG.start() * side_m - slack_m
        || short_m > SHORT.end() * side_m + slack_m
        || short_m < SHORT.start() * side_m - slack_m
    {
        return Err(Rejection::Size);
    }
    Ok(Judged {
        z_m,
        depth_from: if raw.is_some() { DepthFrom::Disparity } else { DepthFrom::Size },
        raw,
        size_px,
        marker_m: ray * z_m,
        unlikeness: (size_px * px_m / side_m).ln().abs(),
    })
}

/// Whether pixels that were lost touch the blob.
fn torn(blob: &Blob, frame: &Frame) -> bool {
    !frame.colour_valid.is_whole()
        && (2 * blob.y0 - 1..2 * blob.y1 + 1)
            .any(|y| (2 * blob.x0 - 1..2 * blob.x1 + 1).any(|x| !frame.colour_valid.received(y * WIDTH + x)))
}

/// Depth [m] and mean raw disparity of what a ray meets. The depth image sees it from elsewhere, by a shift that depends on
/// the depth that is asked for: from the size's guess it settles in three rounds.
fn depth(
    frame: &Frame,
    camera: &Camera,
    ray: &Vector3<f64>,
    guess_m: f64,
    size_px: f64,
    samples: &mut Vec<u16>,
) -> Option<(f64, f64)> {
    // Seven tenths of the side: the border belongs to what is behind as much as to the marker.
    let reach = 0.35 * size_px * camera.depth_focal_px() / camera.colour_focal_px();
    let mut z_m = guess_m;
    for _ in 0..3 {
        let middle = camera.depth_pixel(&(ray * z_m))?;
        let median = sample(frame, [middle.x, middle.y], reach.max(1.0), samples)?;
        let settled = camera.disparity().depth_m(f64::from(median))?;
        let moved = camera.depth_pixel(&(ray * settled))?.x - middle.x;
        z_m = settled;
        if moved.abs() < 0.3 {
            break;
        }
    }
    let middle = camera.depth_pixel(&(ray * z_m))?;
    let median = sample(frame, [middle.x, middle.y], reach.max(1.0), samples)?;
    let near = median.saturating_sub(NEAR_MEDIAN)..=median + NEAR_MEDIAN;
    let (sum, count) = samples
        .iter()
        .filter(|raw| near.contains(raw))
        .fold((0_u64, 0_u64), |(sum, count), raw| (sum + u64::from(*raw), count + 1));
    let raw = sum as f64 / count as f64;
    Some((camera.disparity().depth_m(raw)?, raw))
}

/// Reads the disparities around a place into `samples` and returns their median; `None` when fewer than a quarter have one.
fn sample(frame: &Frame, [x, y]: [f64; 2], reach: f64, samples: &mut Vec<u16>) -> Option<u16> {
    let bounds = |middle: f64, size: usize| {
        let from = (middle - reach + 0.5).floor().clamp(0.0, size as f64) as usize;
        from..((middle + reach + 0.5).floor() + 1.0).clamp(from as f64, size as f64) as usize
    };
    let (columns, rows) = (bounds(x, WIDTH), bounds(y, HEIGHT));
    let step = (columns.len() * rows.len()).div_ceil(MAX_SAMPLES).max(1);
    samples.clear();
    let mut looked_at = 0;
    for row in rows.step_by(step) {
        for column in columns.clone() {
            let pixel = row * WIDTH + column;
            let raw = frame.depth[pixel];
            looked_at += 1;
            if raw < NO_READING && frame.depth_valid.received(pixel) {
                samples.push(raw);
            }
        }
    }
    if samples.len() < 3 || samples.len() * 4 < looked_at {
        return None;
    }
    let half = samples.len() / 2;
    Some(*samples.select_nth_unstable(half).1)
}
