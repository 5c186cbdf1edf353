use std::path::Path;

use crate::{
    RigError, Uncertain,
    keys::{self, Form},
    rig::read_text,
    visit::{self, Range, Reader, Visitor, Writer},
};

/// Where the camera stands, how it sees, and what it looks for: everything that turns its frames into metres.
///
/// Camera frame: the colour camera's, x right, y down, z ahead. The depth camera looks the same way from `-baseline_m`
/// on x. With an attitude of zero the camera looks along the world's +x with its upper edge up.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Calibration {
    /// Side of the square marker, m.
    pub marker_side_m: f64,
    /// Centre of the marker seen from the airframe's reference point (at rest on the origin), body axes, m. The marker
    /// stands upright across the body's x axis.
    pub marker_offset_m: [f64; 3],
    /// The colour camera's centre in the world, m.
    pub camera_position_m: [f64; 3],
    /// Heading (counter-clockwise from above), elevation (up is positive), roll (clockwise as the camera sees), rad.
    pub camera_attitude_rad: [f64; 3],
    /// Exposure to arrival, s, where the calibration measured it; must agree with `[tracker] latency_s`.
    pub latency_s: Option<f64>,
    /// True depth over the depth that the device's constants give, once the bias is taken off.
    pub depth_scale: Uncertain,
    /// True depth less the scaled one, m.
    pub depth_bias_m: Uncertain,
    /// Time between two rows of the rolling shutter, s.
    pub line_time_s: f64,
    /// The colour camera's lens.
    pub colour: Lens,
    /// The depth camera's lens and triangulation.
    pub depth: Depth,
}

/// A pinhole with radial (k) and tangential (p) distortion (Brown and Conrady, in the order of `OpenCV`).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Lens {
    /// Focal length along a row, pixels.
    pub fx_px: f64,
    /// Focal length along a column, pixels.
    pub fy_px: f64,
    /// Principal point's column; the centre of the first pixel is 0.
    pub cx_px: f64,
    /// Principal point's row.
    pub cy_px: f64,
    /// Radial distortion: of the second, fourth and sixth order.
    pub k: [f64; 3],
    /// Tangential distortion.
    pub p: [f64; 2],
}

/// The depth camera.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Depth {
    /// Its lens.
    pub lens: Lens,
    /// Distance from the colour camera, m.
    pub baseline_m: f64,
    /// Distance from emitter to depth camera, cm; one of the device's own constants, as are those below.
    pub emitter_distance_cm: f64,
    /// Distance of the reference plane, cm.
    pub reference_distance_cm: f64,
    /// Size of a pixel on the reference plane, cm.
    pub reference_pixel_cm: f64,
    /// Shift of the reference plane, pixels.
    pub const_shift: f64,
}

impl Lens {
    fn visit(&mut self, v: &mut impl Visitor) {
        let focal = Range::closed(50.0, 10_000.0);
        let coefficient = Range::closed(-10.0, 10.0);
        v.number("fx_px", "Focal length along a row.", focal, &mut self.fx_px);
        v.number("fy_px", "Focal length along a column.", focal, &mut self.fy_px);
        v.number(
            "cx_px",
            "Principal point's column; the centre of the first pixel is 0.",
            Range::closed(0.0, 640.0),
            &mut self.cx_px,
        );
        v.number("cy_px", "Principal point's row.", Range::closed(0.0, 480.0), &mut self.cy_px);
        v.triple(
            "k",
            "Radial distortion of the second, fourth and sixth order (Brown and Conrady).",
            coefficient,
            &mut self.k,
        );
        v.number("p1", "First coefficient of tangential distortion.", coefficient, &mut self.p[0]);
        v.number("p2", "Second coefficient of tangential distortion.", coefficient, &mut self.p[1]);
    }
}

impl Calibration {
    /// Reads a calibration file, the same keys as the table `[calibration]` of a rig.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, RigError> {
        let path = path.as_ref();
        let root = visit::parse(path, &read_text("calibration", path)?)?;
        let (mut calibration, mut problems) = (Self::default(), Vec::new());
        Reader::read(path, "", &root, &mut problems, |reader| calibration.visit(reader));
        if problems.is_empty() { Ok(calibration) } else { Err(RigError::Invalid(problems)) }
    }

    /// The calibration as a file of its own. [`Calibration::load`] gives the same calibration back.
    pub fn to_toml(&self) -> String {
        let mut writer = Writer::default();
        self.clone().visit(&mut writer);
        writer.out
    }

    /// Every key of a calibration file.
    pub fn keys() -> Vec<Form> {
        keys::collect(|collector| Self::default().visit(collector))
    }

    pub(crate) fn visit(&mut self, v: &mut impl Visitor) {
        let anywhere = Range::closed(-100.0, 100.0);
        let angle = Range::closed(-7.0, 7.0);
        v.number(
            "marker_side_m",
            "Side of the square marker.",
            Range::closed(0.005, 1.0),
            &mut self.marker_side_m,
        );
        v.triple(
            "marker_offset_m",
            "Centre of the marker seen from the airframe's reference point, body axes.",
            Range::closed(-1.0, 1.0),
            &mut self.marker_offset_m,
        );
        v.triple(
            "camera_position_m",
            "The colour camera's centre in the world.",
            anywhere,
            &mut self.camera_position_m,
        );
        v.triple(
            "camera_attitude_rad",
            "Heading (counter-clockwise from above), elevation (up is positive), roll \
             (clockwise as the camera sees).",
            angle,
            &mut self.camera_attitude_rad,
        );
        v.maybe(
            "latency_s",
            "Exposure to arrival, where the calibration measured it; must agree with the \
             rig's tracker.latency_s.",
            Range::closed(0.0, 1.0),
            &mut self.latency_s,
        );
        v.uncertain(
            "depth_scale",
            "True depth over the depth that the device's constants give, once the bias is \
             taken off.",
            Range::closed(0.5, 2.0),
            &mut self.depth_scale,
        );
        v.uncertain(
            "depth_bias_m",
            "True depth less the scaled one.",
            Range::closed(-1.0, 1.0),
            &mut self.depth_bias_m,
        );
        v.number(
            "line_time_s",
            "Time between two rows of the rolling shutter.",
            Range::closed(0.0, 0.001),
            &mut self.line_time_s,
        );
        v.table("colour", "The colour camera's lens.", |v| self.colour.visit(v));
        v.table("depth", "The depth camera's lens and triangulation.", |v| {
            let depth = &mut self.depth;
            depth.lens.visit(v);
            v.number(
                "baseline_m",
                "Distance of the depth camera from the colour camera.",
                Range::closed(0.0, 0.2),
                &mut depth.baseline_m,
            );
            v.number(
                "emitter_distance_cm",
                "Distance from emitter to depth camera, as the device states it.",
                Range::closed(1.0, 50.0),
                &mut depth.emitter_distance_cm,
            );
            v.number(
                "reference_distance_cm",
                "Distance of the reference plane, as the device states it.",
                Range::closed(10.0, 1000.0),
                &mut depth.reference_distance_cm,
            );
            v.number(
                "reference_pixel_cm",
                "Size of a pixel on the reference plane, as the device states it.",
                Range::closed(0.001, 10.0),
                &mut depth.reference_pixel_cm,
            );
            v.number(
                "const_shift",
                "Shift of the reference plane in pixels, as the device states it.",
                Range::closed(0.0, 1000.0),
                &mut depth.const_shift,
            );
        });
    }
}
