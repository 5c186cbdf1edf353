//! The two images of what does not move, made once.

use nalgebra::{Matrix3, Vector2, Vector3};

use crate::{
    camera::Camera,
    frame::{HEIGHT, PIXELS, WIDTH, filter},
};

use super::scene::{Scene, Surface};

/// Nearest and farthest reading, m (the sensor's stated range, with some beyond).
const RANGE_M: std::ops::RangeInclusive<f64> = 0.5..=4.5;

/// What the cameras see without airframe and noise.
pub(super) struct Background {
    /// Share of full scale behind each pixel's own filter.
    pub colour: Vec<f32>,
    /// Depth, m; infinite without a reading.
    pub depth_m: Vec<f32>,
}

impl Background {
    pub(super) fn new(camera: &Camera, scene: &Scene) -> Self {
        let mut colour = vec![0.0; PIXELS];
        let mut depth_m = vec![f32::INFINITY; PIXELS];
        let to_camera: Matrix3<f64> = camera.rotation().transpose();
        let colour_rays = Rays::new(|pixel| camera.colour_ray(pixel));
        let depth_rays = Rays::new(|pixel| camera.depth_ray(pixel));
        let mut nearest = vec![f32::INFINITY; PIXELS];
        for surface in &scene.surfaces {
            let lit = scene.radiance(surface.albedo, &surface.normal()).map(|share| share as f32);
            let seen = Seen::new(surface, camera, &to_camera, Vector3::zeros());
            let area = seen.bounds(|point| camera.colour_pixel(point));
            seen.hit(&colour_rays, &area, |x, y, z_m, shade| {
                let i = y * WIDTH + x;
                if z_m < nearest[i] {
                    nearest[i] = z_m;
                    colour[i] = lit[filter(x, y)] * shade;
                }
            });
            let seen = Seen::new(surface, camera, &to_camera, camera.depth_centre_m());
            let area = seen.bounds(|point| camera.depth_pixel(&(point + camera.depth_centre_m())));
            seen.hit(&depth_rays, &area, |x, y, z_m, _| {
                let i = y * WIDTH + x;
                depth_m[i] = depth_m[i].min(z_m);
            });
        }
        for z_m in &mut depth_m {
            if !RANGE_M.contains(&f64::from(*z_m)) {
                *z_m = f32::INFINITY;
            }
        }
        Self { colour, depth_m }
    }
}

/// Directions of all pixels, from a grid of exact ones.
struct Rays {
    grid: Vec<[f32; 2]>,
}

/// Pixels between two points of the grid.
const CELL: usize = 8;
const GRID_WIDTH: usize = WIDTH / CELL + 1;
const GRID_HEIGHT: usize = HEIGHT / CELL + 1;

impl Rays {
    fn new(ray: impl Fn(Vector2<f64>) -> Vector3<f64>) -> Self {
        let exact = |i: usize| {
            let pixel = Vector2::new((i % GRID_WIDTH * CELL) as f64, (i / GRID_WIDTH * CELL) as f64);
            let direction = ray(pixel);
            [direction.x as f32, direction.y as f32]
        };
        Self { grid: (0..GRID_WIDTH * GRID_HEIGHT).map(exact).collect() }
    }

    /// Between the four points of the grid around a pixel: the distortion bends less than 0.02 pixels over a cell.
    fn at(&self, x: usize, y: usize) -> [f32; 2] {
        let (column, row) = (x / CELL, y / CELL);
        let (a, b) = ((x % CELL) as f32 / CELL as f32, (y % CELL) as f32 / CELL as f32);
        let corner = |dx: usize, dy: usize| self.grid[(row + dy) * GRID_WIDTH + column + dx];
        let mix = |axis: usize| {
            (corner(0, 0)[axis] * (1.0 - a) + corner(1, 0)[axis] * a) * (1.0 - b)
                + (corner(0, 1)[axis] * (1.0 - a) + corner(1, 1)[axis] * a) * b
        };
        [mix(0), mix(1)]
    }
}

/// A surface as one of the cameras meets it: its plane in that camera's frame.
struct Seen {
    corner: Vector3<f64>,
    across: Vector3<f64>,
    up: Vector3<f64>,
    surface: Surface,
}

/// First and last column and row of an area, the last ones excluded.
type Area = [usize; 4];

impl Seen {
    fn new(surface: &Surface, camera: &Camera, to_camera: &Matrix3<f64>, centre_m: Vector3<f64>) -> Self {
        Self {
            corner: camera.to_camera(&surface.corner_m) - centre_m,
            across: to_camera * surface.across_m,
            up: to_camera * surface.up_m,
            surface: *surface,
        }
    }

    /// The pixels that may show it: all, when some of it is beside or behind the camera.
    fn bounds(&self, pixel: impl Fn(&Vector3<f64>) -> Option<Vector2<f64>>) -> Area {
        let mut area = [WIDTH, HEIGHT, 0, 0];
        for (a, b) in [(0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0)] {
            let corner = self.corner + self.across * a + self.up * b;
            // A wide angle is where the lens model bends back.
            if corner.z <= 0.1 || corner.x.abs() > corner.z * 0.8 || corner.y.abs() > corner.z * 0.6 {
                return [0, 0, WIDTH, HEIGHT];
            }
            let Some(at) = pixel(&corner) else { return [0, 0, WIDTH, HEIGHT] };
            // Edges bow under distortion by a few pixels at most.
            area[0] = area[0].min((at.x - 6.0).max(0.0) as usize);
            area[1] = area[1].min((at.y - 6.0).max(0.0) as usize);
            area[2] = area[2].max((at.x + 7.0).clamp(0.0, WIDTH as f64) as usize);
            area[3] = area[3].max((at.y + 7.0).clamp(0.0, HEIGHT as f64) as usize);
        }
        area
    }

    /// Calls `found` with column, row, depth [m] and shade for each pixel of the area that meets the surface.
    fn hit(&self, rays: &Rays, area: &Area, mut found: impl FnMut(usize, usize, f32, f32)) {
        let normal = self.across.cross(&self.up);
        let numerator = normal.dot(&self.corner) as f32;
        let per_length = |edge: &Vector3<f64>| (edge / edge.norm_squared()).map(|x| x as f32);
        let (across, up) = (per_length(&self.across), per_length(&self.up));
        let (normal, corner) = (normal.map(|x| x as f32), self.corner.map(|x| x as f32));
        let squares = |share: f32, edge: &Vector3<f64>| {
            (share * edge.norm() as f32 / self.surface.checker_m as f32).floor() as i32
        };
        for y in area[1]..area[3] {
            for x in area[0]..area[2] {
                let [u, v] = rays.at(x, y);
                let z_m = numerator / (normal.x * u + normal.y * v + normal.z);
                if !(z_m > 0.0 && z_m.is_finite()) {
                    continue;
                }
                let (dx, dy, dz) = (u * z_m - corner.x, v * z_m - corner.y, z_m - corner.z);
                let a = across.x * dx + across.y * dy + across.z * dz;
                let b = up.x * dx + up.y * dy + up.z * dz;
                if !self.surface.shape.holds(a, b) {
                    continue;
                }
                let dark = self.surface.checker_m > 0.0
                    && (squares(a, &self.across) + squares(b, &self.up)) % 2 != 0;
                found(x, y, z_m, if dark { 0.9 } else { 1.0 });
            }
        }
    }
}
