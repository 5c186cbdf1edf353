//! What stands in the room: flat surfaces, lit by a lamp.

use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A flat thing in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// One corner of its rectangle, world, m.
    pub corner_m: Vector3<f64>,
    /// From that corner to the next, m.
    pub across_m: Vector3<f64>,
    /// From that corner to the other neighbour, at a right angle to `across_m`, m.
    pub up_m: Vector3<f64>,
    /// What part of the rectangle it fills.
    pub shape: Shape,
    /// Share of red, green and blue light that it sends back.
    pub albedo: [f64; 3],
    /// Side of a checker's squares, m, every other of which is a tenth darker; 0: plain.
    pub checker_m: f64,
}

/// What part of its rectangle a surface fills.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// All of it.
    Rectangle,
    /// The ellipse within it.
    Disc,
    /// The outer half, by radius, of that ellipse.
    Ring,
    /// Two bars along the first edges, each a quarter wide.
    Corner,
}

/// Surfaces and light.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// What stands there; nearer ones hide farther ones.
    pub surfaces: Vec<Surface>,
    /// Towards the lamp, of length one.
    pub to_lamp: Vector3<f64>,
    /// Light that comes from everywhere, as a share of what saturates a white surface.
    pub ambient: f64,
    /// Light of the lamp, likewise.
    pub lamp: f64,
}

/// Red things' albedo: a matt primary red.
pub const RED: [f64; 3] = [0.75, 0.10, 0.10];

impl Scene {
    /// Floor and back wall of a room, without anything red. The camera of the virtual rig looks along +x from x = -1.8 m.
    pub fn bare() -> Self {
        let surface = |corner: [f64; 3], across: [f64; 3], up: [f64; 3], albedo, checker_m| Surface {
            corner_m: corner.into(),
            across_m: across.into(),
            up_m: up.into(),
            shape: Shape::Rectangle,
            albedo,
            checker_m,
        };
        Self {
            surfaces: vec![
                surface([1.7, 4.0, -1.0], [0.0, -8.0, 0.0], [0.0, 0.0, 5.0], [0.62, 0.60, 0.55], 0.25),
                surface([-3.0, 4.0, 0.0], [0.0, -8.0, 0.0], [4.7, 0.0, 0.0], [0.40, 0.36, 0.30], 0.10),
                surface([1.2, 1.4, 0.0], [0.0, -0.7, 0.0], [0.0, 0.0, 0.55], [0.25, 0.30, 0.42], 0.0),
            ],
            to_lamp: Vector3::new(-0.35, 0.2, 0.9).normalize(),
            ambient: 0.45,
            lamp: 0.45,
        }
    }

    /// The same with red things that are not the marker: a cupboard door that fills thousands of pixels, a mug, the spine of a
    /// book, a small lamp, a cable's loop.
    pub fn with_distractors() -> Self {
        let mut scene = Self::bare();
        let mut add = |centre: [f64; 3], across_m: f64, up_m: f64, shape| {
            scene.surfaces.push(Surface::facing(centre, across_m, up_m, shape, RED));
        };
        add([1.68, -0.95, 0.75], 0.75, 0.70, Shape::Rectangle);
        add([1.15, 1.1, 0.60], 0.09, 0.11, Shape::Disc);
        add([1.65, 0.55, 1.10], 0.025, 0.24, Shape::Rectangle);
        add([1.6, 0.1, 1.5], 0.014, 0.014, Shape::Disc);
        add([1.5, -0.45, 0.25], 0.20, 0.16, Shape::Ring);
        scene
    }

    /// A bare room with `count` red things of random place, turn, size and shape between the camera of the virtual rig and
    /// its wall, none of which is as large as the marker and as compact: they are smaller than half of it, at least 1.8 times as
    /// large, three times as long as wide, or have a hole or a notch.
    pub fn cluttered(seed: u64, count: usize) -> Self {
        let mut scene = Self::bare();
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        for _ in 0..count {
            let x = rng.random_range(-0.9..1.6);
            let half_width = 0.5 * (x + 1.8);
            let centre = [x, rng.random_range(-half_width..half_width), rng.random_range(0.1..1.4)];
            let side = |rng: &mut ChaCha8Rng, from: f64, to: f64| rng.random_range(from..to);
            let (across_m, up_m, shape) = match rng.random_range(0..6_u32) {
                0 => (side(&mut rng, 0.005, 0.024), side(&mut rng, 0.005, 0.024), Shape::Rectangle),
                1 => (side(&mut rng, 0.09, 0.5), side(&mut rng, 0.09, 0.5), Shape::Rectangle),
                2 => (side(&mut rng, 0.09, 0.4), side(&mut rng, 0.09, 0.4), Shape::Disc),
                3 => {
                    let long = side(&mut rng, 0.04, 0.4);
                    let short = long / side(&mut rng, 3.0, 10.0);
                    if rng.random() {
                        (long, short, Shape::Rectangle)
                    } else {
                        (short, long, Shape::Rectangle)
                    }
                }
                4 => (side(&mut rng, 0.06, 0.3), side(&mut rng, 0.06, 0.3), Shape::Ring),
                _ => (side(&mut rng, 0.06, 0.3), side(&mut rng, 0.06, 0.3), Shape::Corner),
            };
            let red = side(&mut rng, 0.45, 0.85);
            let other = red * side(&mut rng, 0.08, 0.45);
            scene.surfaces.push(Surface::facing(centre, across_m, up_m, shape, [red, other, other * 0.9]));
        }
        scene
    }

    /// Share of full scale that a surface sends to a camera, by colour.
    pub(crate) fn radiance(&self, albedo: [f64; 3], normal: &Vector3<f64>) -> [f64; 3] {
        let light = self.ambient + self.lamp * normal.dot(&self.to_lamp).abs();
        albedo.map(|share| share * light)
    }
}

impl Surface {
    /// Upright and across the world's x, with its middle at `centre_m`.
    pub fn facing(centre_m: [f64; 3], across_m: f64, up_m: f64, shape: Shape, albedo: [f64; 3]) -> Self {
        let (across_m, up_m) = (Vector3::new(0.0, -across_m, 0.0), Vector3::new(0.0, 0.0, up_m));
        let corner_m = Vector3::from(centre_m) - 0.5 * (across_m + up_m);
        Self { corner_m, across_m, up_m, shape, albedo, checker_m: 0.0 }
    }

    /// Its direction, of length one.
    pub(crate) fn normal(&self) -> Vector3<f64> {
        self.across_m.cross(&self.up_m).normalize()
    }
}

impl Shape {
    /// Whether it holds a point given as shares of the two edges.
    pub(crate) fn holds(self, across: f32, up: f32) -> bool {
        if !((0.0..=1.0).contains(&across) && (0.0..=1.0).contains(&up)) {
            return false;
        }
        let radius = || 2.0 * (across - 0.5).hypot(up - 0.5);
        match self {
            Self::Rectangle => true,
            Self::Disc => radius() <= 1.0,
            Self::Ring => (0.5..=1.0).contains(&radius()),
            Self::Corner => across <= 0.25 || up <= 0.25,
        }
    }
}
