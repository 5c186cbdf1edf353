//! What a recording holds for viewers alone, in the schemas that Foxglove, Lichtblick and Rerun draw: made by the writer of what it
//! writes anyway, and never read back.

use bench_device::{PositionSample, Time};
use bench_rig::{Calibration, Lens, Rig};
use prost::Message;
use prost_types::Timestamp;

use crate::{
    Truth,
    channel::Schema,
    fields::Fields,
    proto::{descriptor_set, foxglove as pb},
};

/// The frame of reference of positions.
const WORLD: &str = "world";
/// The airframe's, at its reference point.
const AIRFRAME: &str = "airframe";
/// The colour camera's: x to the right in the image, y down, z into it.
pub(crate) const CAMERA: &str = "camera";
/// The depth camera's.
pub(crate) const DEPTH_CAMERA: &str = "depth_camera";

/// A channel that is written for viewers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum ViewerChannel {
    /// `/plant/pose`: the truth as `foxglove.PoseInFrame`.
    Pose,
    /// `/tracker/pose`: what the tracker found, the same way, where there is no truth.
    TrackedPose,
    /// `/tf`: where the airframe is, as `foxglove.FrameTransform`, by either of the two.
    Transform,
    /// `/tf_static`: where the cameras are, as `foxglove.FrameTransforms`, once.
    StaticTransforms,
    /// `/scene`: floor, ceiling, airframe and marker as `foxglove.SceneUpdate`, once.
    Scene,
    /// `/camera/calibration`: how the colour camera sees, as `foxglove.CameraCalibration`, once.
    Calibration,
    /// `/camera/full`: the view of all colours as `foxglove.CompressedImage`.
    Full,
    /// `/camera/red`: the red-filtered view.
    Red,
    /// `/camera/depth`: the view of depth in colours.
    Depth,
}

macro_rules! schema {
    ($message:literal) => {
        Schema { name: concat!("foxglove.", $message), descriptor_set: descriptor_set!($message) }
    };
}

impl ViewerChannel {
    /// All of them, in the order of their declaration.
    pub const ALL: [Self; 9] = [
        Self::Pose,
        Self::TrackedPose,
        Self::Transform,
        Self::StaticTransforms,
        Self::Scene,
        Self::Calibration,
        Self::Full,
        Self::Red,
        Self::Depth,
    ];

    /// The MCAP topic.
    pub const fn topic(self) -> &'static str {
        match self {
            Self::Pose => "/plant/pose",
            Self::TrackedPose => "/tracker/pose",
            Self::Transform => "/tf",
            Self::StaticTransforms => "/tf_static",
            Self::Scene => "/scene",
            Self::Calibration => "/camera/calibration",
            Self::Full => "/camera/full",
            Self::Red => "/camera/red",
            Self::Depth => "/camera/depth",
        }
    }

    /// Whether its one message holds for all of the flight.
    pub(crate) const fn is_static(self) -> bool {
        matches!(self, Self::StaticTransforms | Self::Scene | Self::Calibration)
    }

    /// The channel under whose number its schema is written.
    pub(crate) const fn schema_of(self) -> Self {
        match self {
            Self::TrackedPose => Self::Pose,
            Self::Red | Self::Depth => Self::Full,
            own => own,
        }
    }

    pub(crate) const fn schema(self) -> Schema {
        match self {
            Self::Pose | Self::TrackedPose => schema!("PoseInFrame"),
            Self::Transform => schema!("FrameTransform"),
            Self::StaticTransforms => schema!("FrameTransforms"),
            Self::Scene => schema!("SceneUpdate"),
            Self::Calibration => schema!("CameraCalibration"),
            Self::Full | Self::Red | Self::Depth => schema!("CompressedImage"),
        }
    }

    /// The frame of the camera that saw an image of this channel.
    const fn camera(self) -> &'static str {
        match self {
            Self::Depth => DEPTH_CAMERA,
            _ => CAMERA,
        }
    }
}

/// Position, m, and attitude (w, x, y, z) in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Placed {
    pub position_m: [f64; 3],
    pub attitude: [f64; 4],
}

impl From<&Truth> for Placed {
    fn from(truth: &Truth) -> Self {
        Self { position_m: truth.position_m, attitude: truth.attitude }
    }
}

impl From<&PositionSample> for Placed {
    /// A tracker sees no tilt.
    fn from(position: &PositionSample) -> Self {
        let half_rad = 0.5 * position.heading_rad.unwrap_or(0.0);
        Self { position_m: position.position_m, attitude: [half_rad.cos(), 0.0, 0.0, half_rad.sin()] }
    }
}

impl Placed {
    /// Appends `foxglove.PoseInFrame`; `stamp` is the log time.
    pub fn encode_pose(&self, stamp: Time, out: &mut Vec<u8>) {
        let mut fields = Fields { out, single: false };
        fields.timestamp(1, stamp);
        fields.text(2, WORLD);
        fields.message(3, |pose| self.encode_parts(1, pose));
    }

    /// Appends `foxglove.FrameTransform` of the airframe.
    pub fn encode_transform(&self, stamp: Time, out: &mut Vec<u8>) {
        let mut fields = Fields { out, single: false };
        fields.timestamp(1, stamp);
        fields.text(2, WORLD);
        fields.text(3, AIRFRAME);
        self.encode_parts(4, &mut fields);
    }

    fn encode_parts(&self, number: u8, fields: &mut Fields) {
        let [w, x, y, z] = self.attitude;
        fields.doubles(number, self.position_m);
        fields.doubles(number + 1, [x, y, z, w]);
    }
}

/// What stands still, and what the airframe looks like.
pub(crate) struct Room<'a> {
    rig: &'a Rig,
    stamp: Timestamp,
}

type Rgba = [f64; 4];

const FLOOR_COLOUR: Rgba = [0.55, 0.55, 0.58, 1.0];
const CEILING_COLOUR: Rgba = [0.9, 0.35, 0.2, 0.12];
const BODY_COLOUR: Rgba = [0.12, 0.12, 0.14, 1.0];
const ROTOR_COLOUR: Rgba = [0.25, 0.45, 0.8, 0.6];
const MARKER_COLOUR: Rgba = [0.9, 0.05, 0.05, 1.0];
/// How thick floor, ceiling and marker are drawn, m.
const SHEET_M: f64 = 0.002;
/// From rotor to rotor of the paper's quadcopter, and its mass: others are drawn larger by the cube root of theirs, as a rig does not
/// tell the size.
const SPAN_M: f64 = 0.045;
const SPAN_MASS_KG: f64 = 0.015;
/// Pixels of a Kinect's images.
const IMAGE_SIZE: [u32; 2] = [640, 480];
/// From the colour camera's frame (x right, y down, z ahead) to the world's if it looks along x; w, x, y, z.
const LOOKS_ALONG_X: [f64; 4] = [0.5, -0.5, 0.5, -0.5];

impl<'a> Room<'a> {
    /// `stamp` is the log time.
    pub fn new(rig: &'a Rig, stamp: Time) -> Self {
        Self { rig, stamp: timestamp(stamp) }
    }

    /// `foxglove.SceneUpdate`: the floor, the greatest altitude allowed as a ceiling, both as far as the rig lets the airframe go, and
    /// the airframe with its marker.
    pub fn scene(&self) -> Vec<u8> {
        let entities = vec![
            self.entity("floor", WORLD, vec![self.sheet(0.0, FLOOR_COLOUR)], Vec::new()),
            self.entity(
                "ceiling",
                WORLD,
                vec![self.sheet(self.rig.safety.ceiling_m, CEILING_COLOUR)],
                Vec::new(),
            ),
            self.airframe(),
        ];
        let entities = entities.into_iter().chain(self.rig.calibration.as_ref().map(|c| self.marker(c)));
        pb::SceneUpdate { entities: entities.collect() }.encode_to_vec()
    }

    /// `foxglove.FrameTransforms` of the cameras; `None` if the rig has no calibration.
    pub fn cameras(&self) -> Option<Vec<u8>> {
        let calibration = self.rig.calibration.as_ref()?;
        let [heading, elevation, roll] = calibration.camera_attitude_rad;
        let about = |axis: usize, angle_rad: f64| {
            let mut q = [(0.5 * angle_rad).cos(), 0.0, 0.0, 0.0];
            q[1 + axis] = (0.5 * angle_rad).sin();
            q
        };
        let attitude = [about(1, -elevation), about(0, roll), LOOKS_ALONG_X]
            .into_iter()
            .fold(about(2, heading), product);
        let transform = |parent: &str, child: &str, translation: [f64; 3], rotation| pb::FrameTransform {
            timestamp: Some(self.stamp),
            parent_frame_id: parent.to_owned(),
            child_frame_id: child.to_owned(),
            translation: Some(vector(translation)),
            rotation: Some(quaternion(rotation)),
        };
        let transforms = vec![
            transform(WORLD, CAMERA, calibration.camera_position_m, attitude),
            transform(CAMERA, DEPTH_CAMERA, [calibration.depth.baseline_m, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]),
        ];
        Some(pb::FrameTransforms { transforms }.encode_to_vec())
    }

    /// `foxglove.CameraCalibration` of the colour camera; `None` if the rig has no calibration.
    pub fn calibration(&self) -> Option<Vec<u8>> {
        let Lens { fx_px, fy_px, cx_px, cy_px, k, p } = self.rig.calibration.as_ref()?.colour;
        let [width, height] = IMAGE_SIZE;
        let calibration = pb::CameraCalibration {
            timestamp: Some(self.stamp),
            frame_id: CAMERA.to_owned(),
            width,
            height,
            distortion_model: "plumb_bob".to_owned(),
            d: vec![k[0], k[1], p[0], p[1], k[2]],
            k: vec![fx_px, 0.0, cx_px, 0.0, fy_px, cy_px, 0.0, 0.0, 1.0],
            r: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            p: vec![fx_px, 0.0, cx_px, 0.0, 0.0, fy_px, cy_px, 0.0, 0.0, 0.0, 1.0, 0.0],
        };
        Some(calibration.encode_to_vec())
    }

    /// As large as the rig lets the airframe go, its upper side at `z_m`.
    fn sheet(&self, z_m: f64, colour: Rgba) -> pb::CubePrimitive {
        let side_m = 2.0 * self.rig.safety.radius_m;
        cube([0.0, 0.0, z_m - 0.5 * SHEET_M], [side_m, side_m, SHEET_M], colour)
    }

    fn airframe(&self) -> pb::SceneEntity {
        let span_m = SPAN_M * (self.rig.airframe.mass_kg.value / SPAN_MASS_KG).cbrt();
        let body = cube([0.0; 3], [0.6 * span_m, 0.4 * span_m, 0.25 * span_m], BODY_COLOUR);
        let nose =
            cube([0.35 * span_m, 0.0, 0.0], [0.2 * span_m, 0.15 * span_m, 0.15 * span_m], ROTOR_COLOUR);
        let rotor = |(x, y): (f64, f64)| pb::CylinderPrimitive {
            pose: Some(pose([0.5 * x * span_m, 0.5 * y * span_m, 0.15 * span_m])),
            size: Some(vector([0.65 * span_m, 0.65 * span_m, 0.04 * span_m])),
            bottom_scale: 1.0,
            top_scale: 1.0,
            color: Some(colour(ROTOR_COLOUR)),
        };
        let rotors = [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)].map(rotor);
        self.entity(AIRFRAME, AIRFRAME, vec![body, nose], rotors.into())
    }

    /// It stands upright across the body's x axis.
    fn marker(&self, calibration: &Calibration) -> pb::SceneEntity {
        let side_m = calibration.marker_side_m;
        let marker = cube(calibration.marker_offset_m, [SHEET_M, side_m, side_m], MARKER_COLOUR);
        self.entity("marker", AIRFRAME, vec![marker], Vec::new())
    }

    fn entity(
        &self,
        id: &str,
        frame: &str,
        cubes: Vec<pb::CubePrimitive>,
        cylinders: Vec<pb::CylinderPrimitive>,
    ) -> pb::SceneEntity {
        pb::SceneEntity {
            timestamp: Some(self.stamp),
            frame_id: frame.to_owned(),
            id: id.to_owned(),
            frame_locked: true,
            cubes,
            cylinders,
        }
    }
}

/// `foxglove.CompressedImage` of a PNG; `stamp` is the exposure's log time.
pub(crate) fn encode_image(channel: ViewerChannel, stamp: Time, png: Vec<u8>, out: &mut Vec<u8>) {
    let image = pb::CompressedImage {
        timestamp: Some(timestamp(stamp)),
        frame_id: channel.camera().to_owned(),
        data: png,
        format: "png".to_owned(),
    };
    image.encode(out).expect("a vector takes any message");
}

fn timestamp(stamp: Time) -> Timestamp {
    const NANOS: u64 = 1_000_000_000;
    Timestamp { seconds: (stamp.nanos() / NANOS).cast_signed(), nanos: (stamp.nanos() % NANOS) as i32 }
}

fn vector([x, y, z]: [f64; 3]) -> pb::Vector3 {
    pb::Vector3 { x, y, z }
}

fn quaternion([w, x, y, z]: [f64; 4]) -> pb::Quaternion {
    pb::Quaternion { x, y, z, w }
}

/// The rotation `b`, then `a`.
fn product([aw, ax, ay, az]: [f64; 4], [bw, bx, by, bz]: [f64; 4]) -> [f64; 4] {
    [
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    ]
}

fn pose(position_m: [f64; 3]) -> pb::Pose {
    pb::Pose { position: Some(vector(position_m)), orientation: Some(quaternion([1.0, 0.0, 0.0, 0.0])) }
}

fn colour([r, g, b, a]: Rgba) -> pb::Color {
    pb::Color { r, g, b, a }
}

fn cube(centre_m: [f64; 3], size_m: [f64; 3], rgba: Rgba) -> pb::CubePrimitive {
    pb::CubePrimitive { pose: Some(pose(centre_m)), size: Some(vector(size_m)), color: Some(colour(rgba)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rig() -> Rig {
        Rig::load(concat!(env!("CARGO_MANIFEST_DIR"), "/../../rigs/virtual.toml")).unwrap()
    }

    /// A vector in the frame that a quaternion turns into the parent's.
    fn turned(q: pb::Quaternion, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let q = [q.w, q.x, q.y, q.z];
        let [_, x, y, z] = product(product(q, [0.0, x, y, z]), [q[0], -q[1], -q[2], -q[3]]);
        [x, y, z]
    }

    fn near(a: [f64; 3], b: [f64; 3]) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12)
    }

    #[test]
    fn poses_and_transforms_are_those_of_a_general_encoder() {
        let placed = Placed { position_m: [0.1, -0.2, 0.0], attitude: [0.9, 0.1, -0.2, 0.3] };
        let stamp = Time::from_nanos(1_700_000_000_000_000_123);
        let (mut pose, mut transform) = (Vec::new(), Vec::new());
        placed.encode_pose(stamp, &mut pose);
        placed.encode_transform(stamp, &mut transform);
        let expected = pb::PoseInFrame {
            timestamp: Some(timestamp(stamp)),
            frame_id: "world".to_owned(),
            pose: Some(pb::Pose {
                position: Some(vector(placed.position_m)),
                orientation: Some(quaternion(placed.attitude)),
            }),
        };
        assert_eq!(pose, expected.encode_to_vec());
        let expected = pb::FrameTransform {
            timestamp: Some(timestamp(stamp)),
            parent_frame_id: "world".to_owned(),
            child_frame_id: "airframe".to_owned(),
            translation: Some(vector(placed.position_m)),
            rotation: Some(quaternion(placed.attitude)),
        };
        assert_eq!(transform, expected.encode_to_vec());
    }

    #[test]
    fn the_camera_looks_where_the_calibration_says() {
        let mut rig = rig();
        let mut looks = |attitude_rad| {
            rig.calibration.as_mut().unwrap().camera_attitude_rad = attitude_rad;
            let cameras = Room::new(&rig, Time::ZERO).cameras().unwrap();
            pb::FrameTransforms::decode(&*cameras).unwrap().transforms[0].rotation.unwrap()
        };
        // Level: ahead is the world's x, right is -y, down is -z.
        let level = looks([0.0; 3]);
        assert!(near(turned(level, [0.0, 0.0, 1.0]), [1.0, 0.0, 0.0]));
        assert!(near(turned(level, [1.0, 0.0, 0.0]), [0.0, -1.0, 0.0]));
        assert!(near(turned(level, [0.0, 1.0, 0.0]), [0.0, 0.0, -1.0]));
        let (sin, cos) = 0.3_f64.sin_cos();
        assert!(near(turned(looks([0.3, 0.0, 0.0]), [0.0, 0.0, 1.0]), [cos, sin, 0.0]));
        assert!(near(turned(looks([0.0, 0.3, 0.0]), [0.0, 0.0, 1.0]), [cos, 0.0, sin]));
        // Rolled clockwise as the camera sees, its right hand sinks.
        assert!(near(turned(looks([0.0, 0.0, 0.3]), [1.0, 0.0, 0.0]), [0.0, -cos, -sin]));
    }

    #[test]
    fn the_scene_has_floor_ceiling_airframe_and_marker() {
        let rig = rig();
        let scene = pb::SceneUpdate::decode(&*Room::new(&rig, Time::ZERO).scene()).unwrap();
        let ids: Vec<_> =
            scene.entities.iter().map(|entity| (entity.id.as_str(), &*entity.frame_id)).collect();
        let expected =
            [("floor", "world"), ("ceiling", "world"), ("airframe", "airframe"), ("marker", "airframe")];
        assert_eq!(ids, expected);
        let top_m = |entity: &pb::SceneEntity| {
            let cube = &entity.cubes[0];
            cube.pose.unwrap().position.unwrap().z + 0.5 * cube.size.unwrap().z
        };
        assert!(top_m(&scene.entities[0]).abs() < 1e-12);
        assert!((top_m(&scene.entities[1]) - rig.safety.ceiling_m).abs() < 1e-12);
        // Without a calibration nobody knows marker and cameras.
        let blind = Rig { calibration: None, ..rig };
        let room = Room::new(&blind, Time::ZERO);
        assert_eq!(pb::SceneUpdate::decode(&*room.scene()).unwrap().entities.len(), 3);
        assert_eq!((room.cameras(), room.calibration()), (None, None));
    }

    #[test]
    fn the_calibration_projects_as_the_lens_does() {
        let rig = rig();
        let bytes = Room::new(&rig, Time::ZERO).calibration().unwrap();
        let seen = pb::CameraCalibration::decode(&*bytes).unwrap();
        let lens = rig.calibration.as_ref().unwrap().colour;
        assert_eq!(
            (seen.k[0], seen.k[2], seen.k[4], seen.k[5]),
            (lens.fx_px, lens.cx_px, lens.fy_px, lens.cy_px)
        );
        assert_eq!(seen.d, [lens.k[0], lens.k[1], lens.p[0], lens.p[1], lens.k[2]]);
        assert_eq!((seen.width, seen.height, seen.r.len(), seen.p.len()), (640, 480, 9, 12));
    }
}
