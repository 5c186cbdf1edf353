//! From pixels and disparity to metres and back.
//!
//! Camera frame: the colour camera's, x right, y down, z ahead, metres. Pixel (0, 0) is the centre of the first pixel.

use bench_rig::{Calibration, Depth, Lens};
use nalgebra::{Matrix3, Rotation3, Vector2, Vector3};

use crate::frame::NO_READING;

/// The two cameras of a Kinect and where they stand.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    colour: Lens,
    depth: Lens,
    baseline_m: f64,
    disparity: Disparity,
    /// Camera to world.
    rotation: Matrix3<f64>,
    position_m: Vector3<f64>,
    /// Time between two rows, s.
    pub line_time_s: f64,
    /// Side of the marker, m.
    pub marker_side_m: f64,
    /// Centre of the marker from the airframe's reference point, body axes, m.
    pub marker_offset_m: Vector3<f64>,
}

/// Raw disparity to depth: `z = scale a/(b - raw) + bias`, the closed form of the device's own arithmetic (libfreenect's
/// registration) with its constants.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disparity {
    a_m: f64,
    b: f64,
    scale: f64,
    bias_m: f64,
}

impl Disparity {
    /// From the device's constants and a calibrated scale and bias.
    pub fn new(depth: &Depth, scale: f64, bias_m: f64) -> Self {
        let shift = 4.0 * depth.emitter_distance_cm / depth.reference_pixel_cm;
        // Centimetres to metres.
        let a_m = 0.01 * depth.reference_distance_cm * shift;
        Self { a_m, b: shift + 4.0 * depth.const_shift + 1.5, scale, bias_m }
    }

    /// Depth along the camera's axis, m; `None` without a reading or beyond the law's pole.
    pub fn depth_m(&self, raw: f64) -> Option<f64> {
        let z_m = self.scale * self.a_m / (self.b - raw) + self.bias_m;
        (raw < f64::from(NO_READING) && raw < self.b && z_m > 0.0).then_some(z_m)
    }

    /// The raw disparity of a depth, not rounded.
    pub fn raw(&self, z_m: f64) -> f64 {
        self.b - self.a_m * self.scale / (z_m - self.bias_m)
    }

    /// Depth that a unit of raw disparity is worth at a depth, m.
    pub fn step_m(&self, z_m: f64) -> f64 {
        (z_m - self.bias_m).powi(2) / (self.scale * self.a_m)
    }
}

impl Camera {
    /// From a rig's calibration.
    pub fn new(calibration: &Calibration) -> Self {
        Self {
            colour: calibration.colour,
            depth: calibration.depth.lens,
            baseline_m: calibration.depth.baseline_m,
            disparity: Disparity::new(
                &calibration.depth,
                calibration.depth_scale.value,
                calibration.depth_bias_m.value,
            ),
            rotation: rotation(calibration.camera_attitude_rad),
            position_m: calibration.camera_position_m.into(),
            line_time_s: calibration.line_time_s,
            marker_side_m: calibration.marker_side_m,
            marker_offset_m: calibration.marker_offset_m.into(),
        }
    }

    /// Raw disparity to depth and back.
    pub fn disparity(&self) -> &Disparity {
        &self.disparity
    }

    /// A point of the camera frame, in the world.
    pub fn to_world(&self, point_m: &Vector3<f64>) -> Vector3<f64> {
        self.rotation * point_m + self.position_m
    }

    /// A point of the world, in the camera frame.
    pub fn to_camera(&self, point_m: &Vector3<f64>) -> Vector3<f64> {
        self.rotation.transpose() * (point_m - self.position_m)
    }

    /// A direction or covariance's frame: camera to world.
    pub fn rotation(&self) -> &Matrix3<f64> {
        &self.rotation
    }

    /// Where the colour image shows a point of the camera frame; `None` behind the camera.
    pub fn colour_pixel(&self, point_m: &Vector3<f64>) -> Option<Vector2<f64>> {
        project(&self.colour, point_m)
    }

    /// Where the depth image shows a point of the camera frame; `None` behind the camera.
    pub fn depth_pixel(&self, point_m: &Vector3<f64>) -> Option<Vector2<f64>> {
        project(&self.depth, &(point_m + Vector3::new(self.baseline_m, 0.0, 0.0)))
    }

    /// The point of the camera frame that a pixel of the colour image shows, at a depth.
    pub fn from_colour(&self, pixel: Vector2<f64>, z_m: f64) -> Vector3<f64> {
        undistort(&self.colour, pixel).push(1.0) * z_m
    }

    /// The direction (depth one) in which a pixel of the colour image looks.
    pub fn colour_ray(&self, pixel: Vector2<f64>) -> Vector3<f64> {
        undistort(&self.colour, pixel).push(1.0)
    }

    /// The direction (depth one) in which a pixel of the depth image looks, from the depth camera's centre.
    pub fn depth_ray(&self, pixel: Vector2<f64>) -> Vector3<f64> {
        undistort(&self.depth, pixel).push(1.0)
    }

    /// The depth camera's centre in the camera frame.
    pub fn depth_centre_m(&self) -> Vector3<f64> {
        Vector3::new(-self.baseline_m, 0.0, 0.0)
    }

    /// Mean focal length of the colour image, pixels.
    pub fn colour_focal_px(&self) -> f64 {
        (self.colour.fx_px * self.colour.fy_px).sqrt()
    }

    /// Mean focal length of the depth image, pixels.
    pub fn depth_focal_px(&self) -> f64 {
        (self.depth.fx_px * self.depth.fy_px).sqrt()
    }
}

/// Camera to world for heading, elevation and roll; all zero looks along the world's +x.
pub fn rotation([heading, elevation, roll]: [f64; 3]) -> Matrix3<f64> {
    let ahead = Matrix3::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0);
    Rotation3::from_euler_angles(roll, -elevation, heading).into_inner() * ahead
}

/// The inverse of [`rotation`]: heading, elevation, roll.
pub fn attitude_rad(rotation: &Matrix3<f64>) -> [f64; 3] {
    let ahead = Matrix3::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0);
    let (roll, pitch, heading) =
        Rotation3::from_matrix_unchecked(rotation * ahead.transpose()).euler_angles();
    [heading, -pitch, roll]
}

fn distort(lens: &Lens, u: f64, v: f64) -> (f64, f64) {
    let r2 = u * u + v * v;
    let radial = 1.0 + r2 * (lens.k[0] + r2 * (lens.k[1] + r2 * lens.k[2]));
    let [p1, p2] = lens.p;
    (
        u * radial + 2.0 * p1 * u * v + p2 * (r2 + 2.0 * u * u),
        v * radial + p1 * (r2 + 2.0 * v * v) + 2.0 * p2 * u * v,
    )
}

fn project(lens: &Lens, point_m: &Vector3<f64>) -> Option<Vector2<f64>> {
    if point_m.z <= 1e-6 {
        return None;
    }
    let (u, v) = distort(lens, point_m.x / point_m.z, point_m.y / point_m.z);
    Some(Vector2::new(lens.fx_px * u + lens.cx_px, lens.fy_px * v + lens.cy_px))
}

/// Undoes the distortion by fixed-point iteration, which converges wherever the lens is nearly a pinhole: within a thousandth
/// of a pixel over the whole image of a Kinect.
fn undistort(lens: &Lens, pixel: Vector2<f64>) -> Vector2<f64> {
    let target = ((pixel.x - lens.cx_px) / lens.fx_px, (pixel.y - lens.cy_px) / lens.fy_px);
    let (mut u, mut v) = target;
    for _ in 0..20 {
        let (du, dv) = distort(lens, u, v);
        let (eu, ev) = (target.0 - du, target.1 - dv);
        u += eu;
        v += ev;
        if eu.abs() + ev.abs() < 1e-9 {
            break;
        }
    }
    Vector2::new(u, v)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::calibration;

    #[test]
    fn depth_has_the_check_values_of_the_device() {
        let law = Disparity::new(&calibration().depth, 1.0, 0.0);
        // Computed by the device's own steps, to the millimetre.
        assert!((law.depth_m(800.0).unwrap() - 1.194).abs() < 5e-4);
        assert!((law.depth_m(1000.0).unwrap() - 3.864).abs() < 5e-4);
        for z_m in [0.5, 1.5, 4.0] {
            assert!((law.depth_m(law.raw(z_m)).unwrap() - z_m).abs() < 1e-12);
        }
        assert_eq!(law.depth_m(f64::from(NO_READING)), None);
        assert_eq!(law.depth_m(1500.0), None);
        // Khoshelham and Oude Elberink 2012: a step is 2.85e-3 z^2; these constants give 2.89e-3.
        assert!((law.step_m(1.5) / (2.85e-3 * 2.25) - 1.0).abs() < 0.03);
    }

    #[test]
    fn pixels_come_back_from_space_over_the_whole_image() {
        let camera = Camera::new(&calibration());
        for x in (0..640).step_by(53) {
            for y in (0..480).step_by(37) {
                let pixel = Vector2::new(f64::from(x), f64::from(y));
                let back = camera.colour_pixel(&camera.from_colour(pixel, 2.0)).unwrap();
                assert!((back - pixel).norm() < 1e-3, "{pixel} became {back}");
            }
        }
        assert_eq!(camera.colour_pixel(&Vector3::new(0.0, 0.0, -1.0)), None);
    }

    #[test]
    fn registration_shifts_by_what_the_device_tables_hold() {
        // 11.516 (1 - 1200/z_mm) pixels between depths, in depth pixels: the baseline of the calibration comes from it.
        let camera = Camera::new(&calibration());
        let column = |z_m: f64| camera.depth_pixel(&Vector3::new(0.0, 0.0, z_m)).unwrap().x;
        assert!((column(0.8) - column(2.4) - 11.516 * (1.2 / 0.8 - 1.2 / 2.4)).abs() < 0.05);
    }

    #[test]
    fn a_camera_at_rest_looks_along_x_and_its_attitude_turns_it() {
        let point = Vector3::new(0.1, 0.2, 1.0);
        let level = rotation([0.0; 3]) * point;
        assert!((level - Vector3::new(1.0, -0.1, -0.2)).norm() < 1e-12);
        let up = rotation([0.0, 0.3, 0.0]) * Vector3::z();
        assert!((up - Vector3::new(0.3_f64.cos(), 0.0, 0.3_f64.sin())).norm() < 1e-12);
        let left = rotation([0.3, 0.0, 0.0]) * Vector3::z();
        assert!((left - Vector3::new(0.3_f64.cos(), 0.3_f64.sin(), 0.0)).norm() < 1e-12);
        let angles = [0.4, -0.2, 0.1];
        let back = attitude_rad(&rotation(angles));
        assert!(angles.iter().zip(back).all(|(a, b)| (a - b).abs() < 1e-12), "{back:?}");
    }
}
