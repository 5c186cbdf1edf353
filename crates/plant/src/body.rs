//! What the forces move: the vertical model alone, or a rigid body with six degrees of freedom.
//!
//! Axes: world z up; body x forward, y left, z up. Pitch is positive nose down (rotation about body y), roll is
//! positive right side down (rotation about body x).

use bench_device::Sticks;
use bench_rig::{Airframe, GRAVITY_M_S2, Model};
use nalgebra::{Quaternion, SVector, UnitQuaternion, Vector2, Vector3};

use crate::{
    integrator::runge_kutta_4,
    nominal::{Air, Forces},
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
    commanded: Option<(Sticks, AttitudeCommand)>,
}

/// The on-board stabiliser's law, and the inertia that it moves.
#[derive(Clone, Copy, Debug, PartialEq)]
struct StabiliserLaw {
    inertia_kg_m2: Vector3<f64>,
    /// Reciprocals of the inertia, 1/(kg m^2).
    per_inertia: Vector3<f64>,
    /// Torque per inertia and sine of the tilt error, 1/s^2.
    tilt_gain_per_s2: f64,
    /// Torque per inertia and rate, 1/s.
    rate_gain_per_s: f64,
    yaw_gain_per_s: f64,
    arm_m: f64,
    centre: f64,
    tilt_rad_per_unit: f64,
    yaw_rate_rad_s_per_unit: f64,
}

/// What the sticks ask of the stabiliser over one step.
#[derive(Clone, Copy, Debug, PartialEq)]
struct AttitudeCommand {
    /// Where the body's z should point, in the frame of the present heading.
    z_direction: Vector3<f64>,
    yaw_rate_rad_s: f64,
}

/// Beyond this tilt the stabiliser no longer keeps the vertical thrust up: it would have to double its thrust.
const MIN_COMPENSATED_TILT_COS: f64 = 0.5;

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
        let x = runge_kutta_4(&Vector2::new(self.z_m, self.speed_m_s), dt_s, |x| {
            let air = Self { z_m: x[0], speed_m_s: x[1] }.air(forces.free_thrust_n);
            // Upward acceleration: `(thrust - drag)/m - g` (paper, section 3.2).
            Vector2::new(x[1], (forces.thrust_n(&air) + forces.drag_n(&air).z) * per_kg - GRAVITY_M_S2)
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

/// Position 0..3, velocity 3..6, quaternion w x y z 6..10, body rate 10..13.
type State = SVector<f64, 13>;

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
                inertia_kg_m2: Vector3::from(own.inertia_kg_m2),
                per_inertia: Vector3::from(own.inertia_kg_m2.map(f64::recip)),
                tilt_gain_per_s2: own.natural_frequency_rad_s.powi(2),
                rate_gain_per_s: 2.0 * own.damping_ratio * own.natural_frequency_rad_s,
                yaw_gain_per_s: own.yaw_time_constant_s.recip(),
                arm_m: own.arm_m,
                centre: sticks.centre,
                tilt_rad_per_unit: sticks.tilt_rad_per_unit,
                yaw_rate_rad_s_per_unit: sticks.yaw_rate_rad_s_per_unit,
            },
            commanded: None,
        }
    }

    fn step(&mut self, dt_s: f64, forces: &Forces<'_>, sticks: Sticks) {
        let command = match self.commanded {
            Some((of, command)) if of == sticks => command,
            _ => self.stabiliser.command(sticks),
        };
        self.commanded = Some((sticks, command));
        let per_kg = forces.mass_kg.recip();
        let x =
            runge_kutta_4(&self.pack(), dt_s, |x| derivative(x, forces, per_kg, &self.stabiliser, &command));
        self.position_m = x.fixed_rows::<3>(0).into();
        self.velocity_m_s = x.fixed_rows::<3>(3).into();
        self.attitude = UnitQuaternion::new_normalize(Quaternion::new(x[6], x[7], x[8], x[9]));
        self.body_rate_rad_s = x.fixed_rows::<3>(10).into();
        if self.position_m.z <= 0.0 && self.velocity_m_s.z <= 0.0 {
            self.stand();
        }
        stop_at(forces.effects.ceiling_m(), &mut self.position_m.z, &mut self.velocity_m_s.z);
    }

    /// Contact is inelastic and does not slip: the airframe stands level where it came down.
    fn stand(&mut self) {
        self.position_m.z = 0.0;
        self.velocity_m_s = Vector3::zeros();
        self.body_rate_rad_s = Vector3::zeros();
        self.attitude = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), heading_rad(&self.attitude));
    }

    fn pack(&self) -> State {
        let q = &self.attitude;
        let (p, v, r) = (&self.position_m, &self.velocity_m_s, &self.body_rate_rad_s);
        State::from([p.x, p.y, p.z, v.x, v.y, v.z, q.w, q.i, q.j, q.k, r.x, r.y, r.z])
    }
}

/// Rotation of the body's x about the world's z, rad.
pub fn heading_rad(attitude: &UnitQuaternion<f64>) -> f64 {
    let (w, i, j, k) = (attitude.w, attitude.i, attitude.j, attitude.k);
    (2.0 * (w * k + i * j)).atan2(1.0 - 2.0 * (j * j + k * k))
}

/// Newton and Euler for a rigid body; quaternion kinematics `q' = q (0, omega)/2`. `per_kg` is the mass's reciprocal.
fn derivative(
    x: &State,
    forces: &Forces<'_>,
    per_kg: f64,
    stabiliser: &StabiliserLaw,
    command: &AttitudeCommand,
) -> State {
    let velocity = Vector3::new(x[3], x[4], x[5]);
    let rate = Vector3::new(x[10], x[11], x[12]);
    let (w, i, j, k) = (x[6], x[7], x[8], x[9]);
    // The body's z in the world frame, from the quaternion.
    let body_z = Vector3::new(2.0 * (i * k + w * j), 2.0 * (j * k - w * i), 1.0 - 2.0 * (i * i + j * j));

    let air = air(x[2], velocity, body_z.z, forces.free_thrust_n);
    let thrust_n = forces.thrust_n(&air);
    // The nominal stabiliser keeps the vertical thrust the same at any sensible tilt (see the effect `tilt-loss`).
    let along_body_n = thrust_n / body_z.z.max(MIN_COMPENSATED_TILT_COS);
    let drag_n = forces.drag_n(&air);
    let lift_n = body_z * along_body_n;
    let acceleration = Vector3::new(
        (lift_n.x + drag_n.x) * per_kg,
        (lift_n.y + drag_n.y) * per_kg,
        (lift_n.z + drag_n.z) * per_kg - GRAVITY_M_S2,
    );

    let angular = stabiliser.angular_acceleration(x, &body_z, &rate, thrust_n, command);
    let q_dot = [
        -0.5 * (i * rate.x + j * rate.y + k * rate.z),
        0.5 * (w * rate.x + j * rate.z - k * rate.y),
        0.5 * (w * rate.y + k * rate.x - i * rate.z),
        0.5 * (w * rate.z + i * rate.y - j * rate.x),
    ];
    State::from([
        velocity.x,
        velocity.y,
        velocity.z,
        acceleration.x,
        acceleration.y,
        acceleration.z,
        q_dot[0],
        q_dot[1],
        q_dot[2],
        q_dot[3],
        angular.x,
        angular.y,
        angular.z,
    ])
}

impl StabiliserLaw {
    fn command(&self, sticks: Sticks) -> AttitudeCommand {
        let (sin_pitch, cos_pitch) = (self.tilt_rad_per_unit * (sticks.pitch - self.centre)).sin_cos();
        let (sin_roll, cos_roll) = (self.tilt_rad_per_unit * (sticks.roll - self.centre)).sin_cos();
        AttitudeCommand {
            z_direction: Vector3::new(sin_pitch * cos_roll, -sin_roll, cos_pitch * cos_roll),
            yaw_rate_rad_s: self.yaw_rate_rad_s_per_unit * (sticks.yaw - self.centre),
        }
    }

    /// Angular acceleration in the body frame, rad/s^2: the stabiliser's torque, limited by what the rotors can give by
    /// sharing the thrust unevenly, less the gyroscopic term.
    fn angular_acceleration(
        &self,
        x: &State,
        body_z: &Vector3<f64>,
        rate: &Vector3<f64>,
        thrust_n: f64,
        command: &AttitudeCommand,
    ) -> Vector3<f64> {
        let (w, i, j, k) = (x[6], x[7], x[8], x[9]);
        let body_x = Vector3::new(1.0 - 2.0 * (j * j + k * k), 2.0 * (i * j + w * k), 2.0 * (i * k - w * j));
        let body_y = body_z.cross(&body_x);
        // Cosine and sine of the heading; straight up or down there is none, and any will do.
        let per_horizontal = (body_x.x * body_x.x + body_x.y * body_x.y).sqrt().max(1e-9).recip();
        let (cos, sin) = (body_x.x * per_horizontal, body_x.y * per_horizontal);
        let wanted = &command.z_direction;
        let wanted_z =
            Vector3::new(cos * wanted.x - sin * wanted.y, sin * wanted.x + cos * wanted.y, wanted.z);
        // Rotating the body by this (small) vector brings its z to the wanted one: their cross product, in the body's frame.
        let error = Vector3::new(-body_y.dot(&wanted_z), body_x.dot(&wanted_z), 0.0);

        let inertia = &self.inertia_kg_m2;
        let torque_max = 0.5 * self.arm_m * thrust_n;
        let torque = Vector3::new(
            (inertia.x * (self.tilt_gain_per_s2 * error.x - self.rate_gain_per_s * rate.x))
                .clamp(-torque_max, torque_max),
            (inertia.y * (self.tilt_gain_per_s2 * error.y - self.rate_gain_per_s * rate.y))
                .clamp(-torque_max, torque_max),
            inertia.z * self.yaw_gain_per_s * (command.yaw_rate_rad_s - rate.z),
        );
        let gyroscopic = rate.cross(&inertia.component_mul(rate));
        (torque - gyroscopic).component_mul(&self.per_inertia)
    }
}
