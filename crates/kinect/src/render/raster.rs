//! Convex outlines that move while they are exposed, to coverage and depth.

use nalgebra::{UnitQuaternion, Vector2, Vector3};

use crate::{
    camera::{Camera, Disparity},
    frame::{HEIGHT, WIDTH},
};

use super::Pose;

/// The middle of the image's rows, where exposures are timed.
const MIDDLE_ROW: f64 = (HEIGHT as f64 - 1.0) / 2.0;
/// Instants within an exposure, and lines within a row, at which coverage is taken; along a line it is exact.
const INSTANTS: usize = 6;
const LINES: usize = 4;
/// The most corners an outline has: the silhouette of a box has six.
const CORNERS: usize = 8;
/// Half the time over which motion in the image is taken as straight, s.
const STRAIGHT_S: f64 = 0.01;

/// When a row is exposed, against the middle one.
pub(super) fn row_time_s(row: usize, line_time_s: f64) -> f64 {
    (row as f64 - MIDDLE_ROW) * line_time_s
}

/// Columns and rows, the last ones excluded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Patch {
    pub x0: usize,
    pub y0: usize,
    pub x1: usize,
    pub y1: usize,
}

impl Patch {
    pub(super) fn empty() -> Self {
        Self { x0: WIDTH, y0: HEIGHT, x1: 0, y1: 0 }
    }

    pub(super) fn include(&mut self, x: usize, y: usize) {
        *self =
            Self { x0: self.x0.min(x), y0: self.y0.min(y), x1: self.x1.max(x + 1), y1: self.y1.max(y + 1) };
    }
}

/// A convex outline in both images: corners and their velocities, pixels and pixels a second.
pub(super) struct Moving {
    colour: Outline,
    depth: Outline,
    /// Depth of its middle, m, and how fast it grows, m/s.
    z_m: f64,
    z_m_s: f64,
    /// Inverse depth as a plane over the depth image's columns and rows about the middle's pixel, 1/m and 1/m a pixel.
    slope: [f64; 2],
}

struct Outline {
    count: usize,
    corner: [Vector2<f64>; CORNERS],
    velocity: [Vector2<f64>; CORNERS],
    middle: Vector2<f64>,
    middle_velocity: Vector2<f64>,
}

impl Moving {
    /// A flat outline through corners in body axes, in order around it. `None` when some of it is behind the camera.
    pub(super) fn new(camera: &Camera, pose: &Pose, corners: &[Vector3<f64>]) -> Option<Self> {
        let [before, after] = [-STRAIGHT_S, STRAIGHT_S].map(|time_s| placed(camera, pose, corners, time_s));
        let outline = |pixel: &dyn Fn(&Vector3<f64>) -> Option<Vector2<f64>>| {
            let ends = |points: &Points| -> Option<Points2> {
                let mut out = [Vector2::zeros(); CORNERS];
                for (out, point) in out.iter_mut().zip(points).take(corners.len()) {
                    *out = pixel(point)?;
                }
                Some(out)
            };
            Some(Outline::new(&ends(&before)?, &ends(&after)?, corners.len()))
        };
        let colour = outline(&|point| camera.colour_pixel(point))?;
        let depth = outline(&|point| camera.depth_pixel(point))?;
        let mean_z =
            |points: &Points| points[..corners.len()].iter().map(|p| p.z).sum::<f64>() / corners.len() as f64;
        let (z_before, z_after) = (mean_z(&before), mean_z(&after));
        let slope = if corners.len() == 4 { slope(&depth, &before, &after) } else { [0.0; 2] };
        Some(Self {
            colour,
            depth,
            z_m: 0.5 * (z_before + z_after),
            z_m_s: (z_after - z_before) / (2.0 * STRAIGHT_S),
            slope,
        })
    }

    /// The silhouette of a body with these corners, all at its middle's depth.
    pub(super) fn hull(camera: &Camera, pose: &Pose, corners: &[Vector3<f64>; CORNERS]) -> Option<Self> {
        let points = placed(camera, pose, corners, 0.0);
        let mut pixels = Vec::with_capacity(CORNERS);
        for (point, corner) in points.iter().zip(corners) {
            pixels.push((camera.colour_pixel(point)?, *corner));
        }
        pixels.sort_by(|(a, _), (b, _)| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
        // Andrew's monotone chain: half of the way around from the left, half back from the right.
        let mut around = half_way_around(pixels.iter());
        around.extend(half_way_around(pixels.iter().rev()));
        Self::new(camera, pose, &around).map(|hull| Self { slope: [0.0; 2], ..hull })
    }

    /// Depth of its middle, m.
    pub(super) fn depth_m(&self, time_s: f64) -> f64 {
        self.z_m + self.z_m_s * time_s
    }

    /// Raw disparity at a pixel of the depth image.
    pub(super) fn raw(&self, law: &Disparity, x: f64, y: f64, time_s: f64) -> f64 {
        let middle = self.depth.middle + self.depth.middle_velocity * time_s;
        let inverse =
            self.depth_m(time_s).recip() + self.slope[0] * (x - middle.x) + self.slope[1] * (y - middle.y);
        law.raw(inverse.recip())
    }

    /// The rows of the depth image that may show it.
    pub(super) fn depth_rows(&self, line_time_s: f64, lag_s: f64) -> std::ops::Range<usize> {
        let patch = self.depth.bounds(line_time_s, lag_s.abs() * 2.0);
        patch.y0..patch.y1.max(patch.y0)
    }

    /// The columns between which a row of the depth image shows it.
    pub(super) fn depth_span(&self, y: f64, time_s: f64) -> Option<(f64, f64)> {
        self.depth.span(y, time_s)
    }
}

type Points = [Vector3<f64>; CORNERS];
type Points2 = [Vector2<f64>; CORNERS];

/// Corners in the camera frame, a time after the pose.
fn placed(camera: &Camera, pose: &Pose, corners: &[Vector3<f64>], time_s: f64) -> Points {
    let attitude = pose.attitude * UnitQuaternion::from_scaled_axis(pose.body_rate_rad_s * time_s);
    let position_m = pose.position_m + pose.velocity_m_s * time_s;
    let mut points = [Vector3::zeros(); CORNERS];
    for (out, corner) in points.iter_mut().zip(corners) {
        *out = camera.to_camera(&(position_m + attitude * corner));
    }
    points
}

/// One side of the hull of sorted points, without its last one.
fn half_way_around<'a>(points: impl Iterator<Item = &'a (Vector2<f64>, Vector3<f64>)>) -> Vec<Vector3<f64>> {
    let mut side: Vec<(Vector2<f64>, Vector3<f64>)> = Vec::with_capacity(CORNERS);
    for point in points {
        while let [.., a, b] = side.as_slice()
            && !turns(a.0, b.0, point.0)
        {
            side.pop();
        }
        side.push(*point);
    }
    side.pop();
    side.into_iter().map(|(_, corner)| corner).collect()
}

fn turns(a: Vector2<f64>, b: Vector2<f64>, c: Vector2<f64>) -> bool {
    (b - a).perp(&(c - b)) > 0.0
}

/// Inverse depth of a plane is linear over the pixels of a pinhole; from the quadrilateral's diagonals.
fn slope(depth: &Outline, before: &Points, after: &Points) -> [f64; 2] {
    let inverse = |i: usize| 2.0 / (before[i].z + after[i].z);
    let (p, q) = (depth.corner[2] - depth.corner[0], depth.corner[3] - depth.corner[1]);
    let (a, b) = (inverse(2) - inverse(0), inverse(3) - inverse(1));
    let area = p.perp(&q);
    if area.abs() < 1e-6 {
        return [0.0; 2];
    }
    [(a * q.y - b * p.y) / area, (b * p.x - a * q.x) / area]
}

impl Outline {
    fn new(before: &Points2, after: &Points2, count: usize) -> Self {
        let mut outline = Self {
            count,
            corner: [Vector2::zeros(); CORNERS],
            velocity: [Vector2::zeros(); CORNERS],
            middle: Vector2::zeros(),
            middle_velocity: Vector2::zeros(),
        };
        for i in 0..count {
            outline.corner[i] = 0.5 * (before[i] + after[i]);
            outline.velocity[i] = (after[i] - before[i]) / (2.0 * STRAIGHT_S);
        }
        outline.middle = outline.corner[..count].iter().sum::<Vector2<f64>>() / count as f64;
        outline.middle_velocity = outline.velocity[..count].iter().sum::<Vector2<f64>>() / count as f64;
        outline
    }

    /// What it may cover within `spread_s` of the rows' times.
    fn bounds(&self, line_time_s: f64, spread_s: f64) -> Patch {
        let far_s = MIDDLE_ROW * line_time_s + 0.5 * spread_s;
        let (mut low, mut high) = (Vector2::repeat(f64::MAX), Vector2::repeat(f64::MIN));
        for (corner, velocity) in self.corner.iter().zip(&self.velocity).take(self.count) {
            for time_s in [-far_s, far_s] {
                let at = corner + velocity * time_s;
                low = low.inf(&at);
                high = high.sup(&at);
            }
        }
        // Two pixels more, for the lens's blur.
        Patch {
            x0: (low.x - 2.0).clamp(0.0, WIDTH as f64) as usize,
            y0: (low.y - 2.0).clamp(0.0, HEIGHT as f64) as usize,
            x1: (high.x + 4.0).clamp(0.0, WIDTH as f64) as usize,
            y1: (high.y + 4.0).clamp(0.0, HEIGHT as f64) as usize,
        }
    }

    /// The columns between which a line across the image meets it at a time.
    fn span(&self, y: f64, time_s: f64) -> Option<(f64, f64)> {
        let (mut from, mut to) = (f64::MAX, f64::MIN);
        let at = |i: usize| self.corner[i] + self.velocity[i] * time_s;
        let mut last = at(self.count - 1);
        for i in 0..self.count {
            let next = at(i);
            if (last.y <= y) != (next.y <= y) {
                let x = last.x + (next.x - last.x) * (y - last.y) / (next.y - last.y);
                from = from.min(x);
                to = to.max(x);
            }
            last = next;
        }
        (from < to).then_some((from, to))
    }
}

/// How much of each pixel of a patch an outline covers.
#[derive(Default)]
pub(super) struct Coverage {
    values: Vec<f32>,
    row: Vec<f32>,
}

impl Coverage {
    /// Exposes an outline, row by row, each in its time; then the lens's blur of 0.7 pixels. Returns what was touched.
    pub(super) fn fill(&mut self, outline: &Moving, line_time_s: f64, exposure_s: f64) -> Patch {
        let patch = outline.colour.bounds(line_time_s, exposure_s);
        if patch.x0 >= patch.x1 || patch.y0 >= patch.y1 {
            return Patch { x1: patch.x0, y1: patch.y0, ..patch };
        }
        let width = patch.x1 - patch.x0;
        self.values.clear();
        self.values.resize(width * (patch.y1 - patch.y0), 0.0);
        let weight = 1.0 / (INSTANTS * LINES) as f32;
        for (y, row) in (patch.y0..patch.y1).zip(self.values.chunks_exact_mut(width)) {
            let row_s = row_time_s(y, line_time_s);
            for instant in 0..INSTANTS {
                let share = (instant as f64 + 0.5) / INSTANTS as f64 - 0.5;
                for line in 0..LINES {
                    let at = y as f64 - 0.5 + (line as f64 + 0.5) / LINES as f64;
                    if let Some((from, to)) = outline.colour.span(at, row_s + share * exposure_s) {
                        // A pixel reaches half a column to either side of its centre.
                        let shift = 0.5 - patch.x0 as f64;
                        cover(row, (from + shift) as f32, (to + shift) as f32, weight);
                    }
                }
            }
        }
        self.blur(width);
        patch
    }

    pub(super) fn at(&self, patch: &Patch, x: usize, y: usize) -> f32 {
        self.values[(y - patch.y0) * (patch.x1 - patch.x0) + x - patch.x0]
    }

    fn blur(&mut self, width: usize) {
        self.row.resize(width, 0.0);
        let height = self.values.len() / width;
        for row in self.values.chunks_exact_mut(width) {
            self.row.copy_from_slice(row);
            for (out, around) in row.iter_mut().skip(1).zip(self.row.windows(3)) {
                *out = 0.25 * (around[0] + around[2]) + 0.5 * around[1];
            }
        }
        for x in 0..width {
            let mut above = self.values[x];
            for y in 1..height.saturating_sub(1) {
                let here = self.values[y * width + x];
                self.values[y * width + x] = 0.25 * (above + self.values[(y + 1) * width + x]) + 0.5 * here;
                above = here;
            }
        }
    }
}

/// Adds `weight` to the columns between two places, in part to those at the ends.
fn cover(row: &mut [f32], from: f32, to: f32, weight: f32) {
    let (from, to) = (from.max(0.0), to.min(row.len() as f32));
    if from >= to {
        return;
    }
    let (first, last) = (from as usize, (to as usize).min(row.len() - 1));
    if first == last {
        row[first] += weight * (to - from);
        return;
    }
    row[first] += weight * (first as f32 + 1.0 - from);
    for value in &mut row[first + 1..last] {
        *value += weight;
    }
    row[last] += weight * (to - last as f32);
}
