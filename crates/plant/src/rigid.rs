//! The rigid body's equations, for one airframe or for several in lanes.
//!
//! Whoever changes the order of operations here changes every recording: sums and products are written as they are computed.

use bench_rig::GRAVITY_M_S2;

use crate::{
    body::levelled,
    integrator::{Motion, runge_kutta_4},
    lanes::Real,
};

/// Position 0..3 and velocity 3..6 in the world frame, attitude as a quaternion w x y z 6..10, body rate 10..13.
pub(crate) type State<T> = [T; 13];

/// The on-board stabiliser's law, and the inertia that it moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Stabiliser<T> {
    pub(crate) inertia_kg_m2: [T; 3],
    /// Reciprocals of the inertia, 1/(kg m^2).
    pub(crate) per_inertia: [T; 3],
    /// Torque per inertia and sine of the tilt error, 1/s^2.
    pub(crate) tilt_gain_per_s2: T,
    /// Torque per inertia and rate, 1/s.
    pub(crate) rate_gain_per_s: T,
    pub(crate) yaw_gain_per_s: T,
    pub(crate) arm_m: T,
}

/// What the sticks ask of the stabiliser over one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct AttitudeCommand<T> {
    /// Where the body's z should point, in the frame of the present heading.
    pub(crate) z_direction: [T; 3],
    pub(crate) yaw_rate_rad_s: T,
}

/// The forces on an airframe at one instant.
pub(crate) trait ForceLaw<T> {
    /// Vertical thrust of all rotors, ground effect included, N.
    fn thrust_n(&self, at: &Instant<T>) -> T;

    /// Forces except thrust and weight, world frame, N.
    fn drag_n(&self, at: &Instant<T>) -> [T; 3];
}

/// What forces depend on.
#[derive(Clone, Copy)]
pub(crate) struct Instant<T> {
    pub(crate) height_m: T,
    /// World frame.
    pub(crate) velocity_m_s: [T; 3],
    pub(crate) tilt_cos: T,
}

/// All that moves an airframe over one step.
pub(crate) struct Held<'a, T, F> {
    pub(crate) forces: &'a F,
    /// The mass's reciprocal.
    pub(crate) per_kg: T,
    pub(crate) stabiliser: &'a Stabiliser<T>,
    pub(crate) command: &'a AttitudeCommand<T>,
}

/// Beyond this tilt the stabiliser no longer keeps the vertical thrust up: it would have to double its thrust.
const MIN_COMPENSATED_TILT_COS: f64 = 0.5;

/// The state after a step in free flight.
#[inline(always)]
pub(crate) fn step<T: Real, F: ForceLaw<T>>(x: &State<T>, dt_s: T, held: &Held<'_, T, F>) -> State<T> {
    let mut x = runge_kutta_4(x, dt_s, held);
    let (w, i, j, k) = (x[6], x[7], x[8], x[9]);
    let norm = ((i * i + k * k) + (j * j + w * w)).sqrt();
    for part in &mut x[6..10] {
        *part = *part / norm;
    }
    x
}

impl<T: Real, F: ForceLaw<T>> Motion<T, 13> for Held<'_, T, F> {
    /// Newton and Euler for a rigid body; quaternion kinematics `q' = q (0, omega)/2`.
    #[inline(always)]
    fn derivative(&self, x: &State<T>) -> State<T> {
        let velocity = [x[3], x[4], x[5]];
        let rate = [x[10], x[11], x[12]];
        let (w, i, j, k) = (x[6], x[7], x[8], x[9]);
        let one = w.constant(1.0);
        // The body's z in the world frame, from the quaternion.
        let body_z = [(i * k + w * j) * 2.0, (j * k - w * i) * 2.0, one - (i * i + j * j) * 2.0];

        let instant = Instant { height_m: x[2], velocity_m_s: velocity, tilt_cos: body_z[2] };
        let thrust_n = self.forces.thrust_n(&instant);
        // The nominal stabiliser keeps the vertical thrust the same at any sensible tilt (see the effect `tilt-loss`).
        let along_body_n = thrust_n / body_z[2].at_least(one.constant(MIN_COMPENSATED_TILT_COS));
        let drag_n = self.forces.drag_n(&instant);
        let angular = self.stabiliser.angular_acceleration(x, &body_z, thrust_n, self.command);
        [
            velocity[0],
            velocity[1],
            velocity[2],
            (body_z[0] * along_body_n + drag_n[0]) * self.per_kg,
            (body_z[1] * along_body_n + drag_n[1]) * self.per_kg,
            (body_z[2] * along_body_n + drag_n[2]) * self.per_kg - one.constant(GRAVITY_M_S2),
            (i * rate[0] + j * rate[1] + k * rate[2]) * -0.5,
            (w * rate[0] + j * rate[2] - k * rate[1]) * 0.5,
            (w * rate[1] + k * rate[0] - i * rate[2]) * 0.5,
            (w * rate[2] + i * rate[1] - j * rate[0]) * 0.5,
            angular[0],
            angular[1],
            angular[2],
        ]
    }
}

impl<T: Real> Stabiliser<T> {
    /// Angular acceleration in the body frame, rad/s^2: the stabiliser's torque, limited by what the rotors can give by
    /// sharing the thrust unevenly, less the gyroscopic term.
    #[inline(always)]
    fn angular_acceleration(
        &self,
        x: &State<T>,
        body_z: &[T; 3],
        thrust_n: T,
        command: &AttitudeCommand<T>,
    ) -> [T; 3] {
        let (w, i, j, k) = (x[6], x[7], x[8], x[9]);
        let rate = [x[10], x[11], x[12]];
        let body_x = [w.constant(1.0) - (j * j + k * k) * 2.0, (i * j + w * k) * 2.0, (i * k - w * j) * 2.0];
        let body_y = cross(body_z, &body_x);
        // Cosine and sine of the heading; straight up or down there is none, and any will do.
        let horizontal = (body_x[0] * body_x[0] + body_x[1] * body_x[1]).sqrt();
        let per_horizontal = horizontal.at_least(w.constant(1e-9)).recip();
        let (cos, sin) = (body_x[0] * per_horizontal, body_x[1] * per_horizontal);
        let wanted = &command.z_direction;
        let wanted_z = [cos * wanted[0] - sin * wanted[1], sin * wanted[0] + cos * wanted[1], wanted[2]];
        // Rotating the body by this (small) vector brings its z to the wanted one: their cross product, in the body's frame.
        let error = [-dot(&body_y, &wanted_z), dot(&body_x, &wanted_z)];

        let inertia = &self.inertia_kg_m2;
        let torque_max = self.arm_m * 0.5 * thrust_n;
        let torque = [
            self.tilting(0, error[0], rate[0]).within(-torque_max, torque_max),
            self.tilting(1, error[1], rate[1]).within(-torque_max, torque_max),
            inertia[2] * self.yaw_gain_per_s * (command.yaw_rate_rad_s - rate[2]),
        ];
        let momentum = [inertia[0] * rate[0], inertia[1] * rate[1], inertia[2] * rate[2]];
        let gyroscopic = cross(&rate, &momentum);
        [
            (torque[0] - gyroscopic[0]) * self.per_inertia[0],
            (torque[1] - gyroscopic[1]) * self.per_inertia[1],
            (torque[2] - gyroscopic[2]) * self.per_inertia[2],
        ]
    }

    /// The torque about a horizontal axis of the body that brings a tilt error to nothing, N m.
    #[inline(always)]
    fn tilting(&self, axis: usize, error: T, rate: T) -> T {
        self.inertia_kg_m2[axis] * (self.tilt_gain_per_s2 * error - self.rate_gain_per_s * rate)
    }
}

#[inline(always)]
fn cross<T: Real>(a: &[T; 3], b: &[T; 3]) -> [T; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline(always)]
fn dot<T: Real>(a: &[T; 3], b: &[T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Contact with the ground is inelastic and does not slip: the airframe stands level where it came down. Returns whether there
/// was any.
pub(crate) fn settle(x: &mut State<f64>) -> bool {
    let is_down = x[2] <= 0.0 && x[5] <= 0.0;
    if is_down {
        x[2..6].fill(0.0);
        x[10..13].fill(0.0);
        let attitude = [x[6], x[7], x[8], x[9]];
        // Most stand as they stood before they took off, and what follows takes as long as a step.
        if attitude.map(f64::to_bits) != [1.0, 0.0, 0.0, 0.0].map(f64::to_bits) {
            x[6..10].copy_from_slice(&levelled(attitude));
        }
    }
    is_down
}
