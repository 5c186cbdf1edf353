//! What the forces move: the vertical model alone, or a rigid body with six degrees of freedom.
//!
//! Axes: world z up; body x forward, y left, z up. Pitch is positive nose down (rotation about body y), roll is
//! positive right side down (rotation about body x).

use bench_device::Sticks;
use bench_rig::{Airframe, GRAVITY_M_S2, Model};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use crate::{
    integrator::runge_kutta_4,
    nominal::{Air, Forces},
    rigid::{self, AttitudeCommand, Held, Stabiliser, State, settle},
};

/// The moving part of the plant.
#[derive(Clone, Debug)]
pub enum Body {
    /// Altitude and vertical speed.
    Vertical(Vertical),
    /// Position, velocity, attitude and body rates.
    SixDegree(Box<SixDegree>),
}

/// The paper's airframe: altitude and vertical speed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Vertical {
    /// Altitude, m.
    pub z_m: f64,
    /// Vertical speed, m/s.
    pub speed_m_s: f64,
}

/// A rigid body under the on-board stabiliser.
#[derive(Clone, Debug, PartialEq)]
pub struct SixDegree {
    /// World frame, m.
    pub position_m: Vector3<f64>,
    /// World frame, m/s.
    pub velocity_m_s: Vector3<f64>,
    /// Body to world.
    pub attitude: UnitQuaternion<f64>,
    /// Body frame, rad/s.
    pub body_rate_rad_s: Vector3<f64>,
    stabiliser: StabiliserLaw,
    /// The sticks of the last step and what they asked for; they mostly stay as they are for many steps.
    commanded: Option<(Sticks, AttitudeCommand<f64>)>,
}

/// The on-board stabiliser, and what sticks mean to it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct StabiliserLaw {
    own: Stabiliser<f64>,
    centre: f64,
    tilt_rad_per_unit: f64,
    yaw_rate_rad_s_per_unit: f64,
}

impl Body {
    /// At rest on the surface, at the origin, heading along x.
    pub fn at_rest(model: Model, airframe: &Airframe) -> Self {
        match model {
            Model::Vertical => Self::Vertical(Vertical::default()),
            Model::SixDegree => Self::SixDegree(Box::new(SixDegree::at_rest(airframe))),
        }
    }

    /// Moves on by `dt_s` under forces and sticks held over the step, then settles contact with ground and ceiling.
    #[inline]
    pub fn step(&mut self, dt_s: f64, forces: &Forces<'_>, sticks: Sticks) {
        match self {
            Self::Vertical(body) => body.step(dt_s, forces),
            Self::SixDegree(body) => body.step(dt_s, forces, sticks),
        }
    }

    /// What a force law may look at now.
    #[inline]
    pub fn air(&self, free_thrust_n: f64) -> Air {
        match self {
            Self::Vertical(body) => body.air(free_thrust_n),
            Self::SixDegree(body) => {
                air(body.position_m.z, body.velocity_m_s, tilt_cos(&body.attitude), free_thrust_n)
            }
        }
    }

    /// Position, world frame, m.
    pub fn position_m(&self) -> Vector3<f64> {
        match self {
            Self::Vertical(body) => Vector3::new(0.0, 0.0, body.z_m),
            Self::SixDegree(body) => body.position_m,
        }
    }

    /// Velocity, world frame, m/s.
    pub fn velocity_m_s(&self) -> Vector3<f64> {
        match self {
            Self::Vertical(body) => Vector3::new(0.0, 0.0, body.speed_m_s),
            Self::SixDegree(body) => body.velocity_m_s,
        }
    }

    /// Body to world.
    pub fn attitude(&self) -> UnitQuaternion<f64> {
        match self {
            Self::Vertical(_) => UnitQuaternion::identity(),
            Self::SixDegree(body) => body.attitude,
        }
    }

    /// Body frame, rad/s.
    pub fn body_rate_rad_s(&self) -> Vector3<f64> {
        match self {
            Self::Vertical(_) => Vector3::zeros(),
            Self::SixDegree(body) => body.body_rate_rad_s,
        }
    }
}

#[inline]
fn air(height_m: f64, velocity_m_s: Vector3<f64>, tilt_cos: f64, free_thrust_n: f64) -> Air {
    Air { height_m, velocity_m_s, tilt_cos, free_thrust_n }
}

#[inline]
fn tilt_cos(attitude: &UnitQuaternion<f64>) -> f64 {
    1.0 - 2.0 * (attitude.i * attitude.i + attitude.j * attitude.j)
}

impl Vertical {
    #[inline]
    fn air(self, free_thrust_n: f64) -> Air {
        air(self.z_m, Vector3::new(0.0, 0.0, self.speed_m_s), 1.0, free_thrust_n)
    }

    #[inline]
    fn step(&mut self, dt_s: f64, forces: &Forces<'_>) {
        let per_kg = forces.mass_kg.recip();
        let x = runge_kutta_4(&[self.z_m, self.speed_m_s], dt_s, &|x: &[f64; 2]| {
            let air = Self { z_m: x[0], speed_m_s: x[1] }.air(forces.free_thrust_n);
            // Upward acceleration: `(thrust - drag)/m - g` (paper, section 3.2).
            [x[1], (forces.thrust_n(&air) + forces.drag_n(&air).z) * per_kg - GRAVITY_M_S2]
        });
        *self = Self { z_m: x[0], speed_m_s: x[1] };
        if self.z_m <= 0.0 && self.speed_m_s <= 0.0 {
            *self = Self::default();
        }
        stop_at(forces.effects.ceiling_m(), &mut self.z_m, &mut self.speed_m_s);
    }
}

/// Contact with a ceiling is inelastic: the airframe stays below and may slide along.
#[inline]
fn stop_at(ceiling_m: f64, z_m: &mut f64, speed_m_s: &mut f64) {
    if *z_m >= ceiling_m {
        *z_m = ceiling_m;
        *speed_m_s = speed_m_s.min(0.0);
    }
}

impl SixDegree {
    /// At rest on the surface, at the origin, heading along x.
    pub fn at_rest(airframe: &Airframe) -> Self {
        let (own, sticks) = (&airframe.stabiliser, &airframe.sticks);
        Self {
            position_m: Vector3::zeros(),
            velocity_m_s: Vector3::zeros(),
            attitude: UnitQuaternion::identity(),
            body_rate_rad_s: Vector3::zeros(),
            stabiliser: StabiliserLaw {
                own: Stabiliser {
                    inertia_kg_m2: own.inertia_kg_m2,
                    per_inertia: own.inertia_kg_m2.map(f64::recip),
                    tilt_gain_per_s2: own.natural_frequency_rad_s.powi(2),
                    rate_gain_per_s: 2.0 * own.damping_ratio * own.natural_frequency_rad_s,
                    yaw_gain_per_s: own.yaw_time_constant_s.recip(),
                    arm_m: own.arm_m,
                },
                centre: sticks.centre,
                tilt_rad_per_unit: sticks.tilt_rad_per_unit,
                yaw_rate_rad_s_per_unit: sticks.yaw_rate_rad_s_per_unit,
            },
            commanded: None,
        }
    }

    fn step(&mut self, dt_s: f64, forces: &Forces<'_>, sticks: Sticks) {
        let command = self.command(sticks);
        let per_kg = forces.mass_kg.recip();
        let held = Held { forces, per_kg, stabiliser: &self.stabiliser.own, command: &command };
        let mut x = rigid::step(&self.state(), dt_s, &held);
        settle(&mut x);
        self.set_state(&x);
        stop_at(forces.effects.ceiling_m(), &mut self.position_m.z, &mut self.velocity_m_s.z);
    }

    /// What the sticks ask of the stabiliser.
    pub(crate) fn command(&mut self, sticks: Sticks) -> AttitudeCommand<f64> {
        let command = match self.commanded {
            Some((of, command)) if of == sticks => command,
            _ => self.stabiliser.command(sticks),
        };
        self.commanded = Some((sticks, command));
        command
    }

    /// Its stabiliser.
    pub(crate) fn stabiliser(&self) -> &Stabiliser<f64> {
        &self.stabiliser.own
    }

    /// Where it is, as its equations have it.
    pub(crate) fn state(&self) -> State<f64> {
        let q = &self.attitude;
        let (p, v, r) = (&self.position_m, &self.velocity_m_s, &self.body_rate_rad_s);
        [p.x, p.y, p.z, v.x, v.y, v.z, q.w, q.i, q.j, q.k, r.x, r.y, r.z]
    }

    /// Moves it to where its equations have brought it, the quaternion's length being one.
    pub(crate) fn set_state(&mut self, x: &State<f64>) {
        self.position_m = Vector3::new(x[0], x[1], x[2]);
        self.velocity_m_s = Vector3::new(x[3], x[4], x[5]);
        self.attitude = UnitQuaternion::new_unchecked(Quaternion::new(x[6], x[7], x[8], x[9]));
        self.body_rate_rad_s = Vector3::new(x[10], x[11], x[12]);
    }
}

/// An attitude, w x y z, of which the heading is kept.
pub(crate) fn levelled([w, i, j, k]: [f64; 4]) -> [f64; 4] {
    let attitude = UnitQuaternion::new_unchecked(Quaternion::new(w, i, j, k));
    let level = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), heading_rad(&attitude));
    [level.w, level.i, level.j, level.k]
}

/// Rotation of the body's x about the world's z, rad.
pub fn heading_rad(attitude: &UnitQuaternion<f64>) -> f64 {
    let (w, i, j, k) = (attitude.w, attitude.i, attitude.j, attitude.k);
    (2.0 * (w * k + i * j)).atan2(1.0 - 2.0 * (j * j + k * k))
}

impl StabiliserLaw {
    fn command(&self, sticks: Sticks) -> AttitudeCommand<f64> {
        let (sin_pitch, cos_pitch) = (self.tilt_rad_per_unit * (sticks.pitch - self.centre)).sin_cos();
        let (sin_roll, cos_roll) = (self.tilt_rad_per_unit * (sticks.roll - self.centre)).sin_cos();
        AttitudeCommand {
            z_direction: [sin_pitch * cos_roll, -sin_roll, cos_pitch * cos_roll],
            yaw_rate_rad_s: self.yaw_rate_rad_s_per_unit * (sticks.yaw - self.centre),
        }
    }
}
