//! Whether a red blob can be the marker.

use nalgebra::{Vector2, Vector3};

use crate::{
    camera::Camera,
    frame::{Frame, HEIGHT, NO_READING, WIDTH},
};

use super::{
    Blob, DepthFrom, centre_px,
    refine::{Refined, refine},
};

/// Blobs of fewer quads are not looked at: the marker has 9 at 4 m.
pub(super) const MIN_QUADS: u64 = 5;
/// The most rows of the depth image that are read for a blob.
const MAX_ROWS: usize = 16;
/// The most disparities that are read for a blob: whole rows.
pub(super) const MAX_SAMPLES: usize = MAX_ROWS * WIDTH;
/// Where the device reads depth, m.
const NEAREST_M: f64 = 0.5;
const FARTHEST_M: f64 = 4.5;
/// Share of the blob's area that must have a reading of one surface.
const ENOUGH: f64 = 0.25;
/// Counts over which the readings of the marker spread: four sigmas of noise and rounding, and its tilt.
const SURFACE_COUNTS: u16 = 4;
/// Before the size is known to a fraction of a pixel: long and short side of the whole quads against the marker's, and by how
/// many pixels a side may be off besides. Motion blur makes it longer, a turn of the airframe narrower.
const LONG: std::ops::RangeInclusive<f64> = 0.7..=1.9;
const SHORT: std::ops::RangeInclusive<f64> = 0.5..=1.3;
const SIDE_SLACK_PX: f64 = 1.5;
const MAX_ASPECT: f64 = 2.3;
// The limits below hold what rendered flights show (0.8 to 3 m, up to 2 m/s, turned by up to 0.4 rad) with room for a turn of
// 0.8 rad; in those flights the extremes of 5,000 frames are 0.87 and 1.10, 0.80 and 1.37, 0.91.
/// The side at full resolution against the marker's at its distance.
const SIDE: std::ops::RangeInclusive<f64> = 0.75..=1.18;
/// Area of the red quads against the area at full resolution: what is ragged or joins its neighbours has another.
const AREA: std::ops::RangeInclusive<f64> = 0.7..=1.5;
/// The same for a marker that was not there before.
const SIDE_AT_FIRST: std::ops::RangeInclusive<f64> = 0.82..=1.15;
const AREA_AT_FIRST: std::ops::RangeInclusive<f64> = 0.78..=1.4;
/// Share of the rectangle with the same moments that is red.
const MIN_FILL: f64 = 0.86;
/// Counts about the median within which the mean disparity is taken: two sigmas of noise and rounding; and how far, in shares
/// of the marker's side, a turned marker reaches before or behind its middle.
const NEAR_MEDIAN: u16 = 1;
const TURNED: f64 = 0.25;

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
    /// It has no depth, or is not quite like the marker, and was not there before.
    Doubtful,
    /// It is not where the marker can have moved to.
    Elsewhere,
}

/// A blob that may be the marker.
#[derive(Clone, Copy, Debug)]
pub(super) struct Judged {
    pub z_m: f64,
    pub depth_from: DepthFrom,
    pub raw: Option<f64>,
    /// Side of the marker in the colour image, pixels.
    pub size_px: f64,
    /// Its centre there, and the direction (depth one) in which that lies.
    pub centre: Vector2<f64>,
    pub ray: Vector3<f64>,
    /// How much the size is off, as a ratio's logarithm.
    pub unlikeness: f64,
    /// Whether it is taken for the marker where there was none before. Nothing but the depth image tells how large a red thing
    /// is when it is first seen.
    pub plain: bool,
}

pub(super) fn judge(
    blob: &Blob,
    frame: &Frame,
    camera: &Camera,
    samples: &mut Vec<u16>,
) -> Result<Judged, Rejection> {
    let ([long_px, short_px], fill) = blob.sides_px();
    let focal_px = camera.colour_focal_px();
    let side_m = camera.marker_side_m;
    // At half a metre it is as large as it gets.
    if long_px > LONG.end() * focal_px * side_m / NEAREST_M {
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
    let ray = camera.colour_ray(centre_px(blob));
    let raw = registered_raw(frame, camera, &ray, size_px, samples);
    let z_m = match raw {
        Some(raw) => camera.disparity().depth_m(raw).ok_or(Rejection::Doubtful)?,
        None => focal_px * side_m / size_px,
    };
    // What a pixel is worth at its distance.
    let px_m = z_m / focal_px;
    let slack_m = SIDE_SLACK_PX * px_m;
    let (long_m, short_m) = (long_px * px_m, short_px * px_m);
    if long_m > LONG.end() * side_m + slack_m
        || long_m < LONG.start() * side_m - slack_m
        || short_m > SHORT.end() * side_m + slack_m
        || short_m < SHORT.start() * side_m - slack_m
    {
        return Err(Rejection::Size);
    }
    // Now that few are left: size and place to a fraction of a pixel.
    let Refined { centre, side_px } = refine(&frame.colour, blob).ok_or(Rejection::Fill)?;
    let z_m = if raw.is_some() { z_m } else { focal_px * side_m / side_px };
    let ratio = side_px * z_m / focal_px / side_m;
    if !SIDE.contains(&ratio) {
        return Err(Rejection::Size);
    }
    let area = 4.0 * blob.area as f64 / side_px.powi(2);
    if !AREA.contains(&area) {
        return Err(Rejection::Fill);
    }
    let ray = camera.colour_ray(centre);
    Ok(Judged {
        z_m,
        depth_from: if raw.is_some() { DepthFrom::Disparity } else { DepthFrom::Size },
        raw,
        size_px: side_px,
        centre,
        ray,
        unlikeness: ratio.ln().abs(),
        plain: raw.is_some() && SIDE_AT_FIRST.contains(&ratio) && AREA_AT_FIRST.contains(&area),
    })
}

/// Whether pixels that were lost touch the blob.
fn torn(blob: &Blob, frame: &Frame) -> bool {
    !frame.colour_valid.is_whole()
        && (2 * blob.y0 - 1..=2 * blob.y1)
            .any(|y| (2 * blob.x0 - 1..=2 * blob.x1).any(|x| !frame.colour_valid.received(y * WIDTH + x)))
}

/// Mean raw disparity of what the colour camera sees along a ray, by registration: a depth pixel belongs to the ray if its own
/// depth puts it there, and of several surfaces the nearest hides the others. `None` when there are too few readings.
fn registered_raw(
    frame: &Frame,
    camera: &Camera,
    ray: &Vector3<f64>,
    size_px: f64,
    samples: &mut Vec<u16>,
) -> Option<f64> {
    // Seven tenths of the side: the border belongs to what is behind as much as to the marker.
    let reach = (0.35 * size_px * camera.depth_focal_px() / camera.colour_focal_px()).max(1.0);
    // The place in the depth image is linear in the inverse depth.
    let (near, far) = (camera.depth_pixel(&(ray * NEAREST_M))?, camera.depth_pixel(&(ray * FARTHEST_M))?);
    let per_inverse = (near.x - far.x) / (NEAREST_M.recip() - FARTHEST_M.recip());
    let at_infinity = far.x - per_inverse / FARTHEST_M;
    let bounds = |from: f64, to: f64, size: usize| {
        let from = (from + 0.5).floor().clamp(0.0, size as f64) as usize;
        from..((to + 0.5).floor() + 1.0).clamp(from as f64, size as f64) as usize
    };
    let rows = bounds(far.y - reach, far.y + reach, HEIGHT);
    let columns = bounds(far.x.min(near.x) - reach, far.x.max(near.x) + reach, WIDTH);
    let step = rows.len().div_ceil(MAX_ROWS).max(1);
    samples.clear();
    let read = rows.clone().step_by(step).len();
    for row in rows.step_by(step) {
        for pixel in row * WIDTH + columns.start..row * WIDTH + columns.end {
            let raw = frame.depth[pixel];
            if raw >= NO_READING || !frame.depth_valid.received(pixel) {
                continue;
            }
            let Some(z_m) = camera.disparity().depth_m(f64::from(raw)) else { continue };
            let away = (pixel % WIDTH) as f64 - (at_infinity + per_inverse / z_m);
            if away.abs() <= reach {
                samples.push(raw);
            }
        }
    }
    samples.sort_unstable();
    let enough = ((read as f64 * (2.0 * reach).max(1.0) * ENOUGH) as usize).max(3);
    // The first stretch of the sorted readings that is dense enough is the nearest surface.
    let turned = |raw: u16| {
        let step_m = camera.disparity().depth_m(f64::from(raw)).map(|z_m| camera.disparity().step_m(z_m));
        step_m.map_or(0, |step_m| (TURNED * camera.marker_side_m / step_m) as u16)
    };
    let spread = |raw: u16| SURFACE_COUNTS + 2 * turned(raw);
    let begin = (0..samples.len().checked_sub(enough - 1)?)
        .find(|i| samples[i + enough - 1] - samples[*i] <= spread(samples[*i]))?;
    let end = samples.partition_point(|raw| *raw <= samples[begin] + spread(samples[begin]));
    let median = samples[begin + (end - begin) / 2];
    let reach = NEAR_MEDIAN + turned(median);
    let near = median.saturating_sub(reach)..=median + reach;
    let (sum, count) = samples
        .iter()
        .filter(|raw| near.contains(raw))
        .fold((0_u64, 0_u64), |(sum, count), raw| (sum + u64::from(*raw), count + 1));
    Some(sum as f64 / count as f64)
}
