//! Several rigid bodies that are moved on together, as many at once as the processor has lanes for.
//!
//! Each is moved as [`Body::step`](crate::body::Body::step) moves it, to the last bit: with which others an airframe shares a
//! batch, and on what processor, changes nothing. Forces are the nominal ones; an effect on the air has no lanes.

use bench_device::Sticks;
use pulp::{Arch, Simd, WithSimd};

use crate::{
    body::SixDegree,
    lanes::{Lanes, Real},
    nominal::{Nominal, drag_n, ground_effect, vertical_thrust_n},
    rigid::{AttitudeCommand, ForceLaw, Held, Instant, Stabiliser, State, settle, step},
};

/// How many airframes a batch has room for: lanes of doubles in the widest registers there are.
pub const WIDTH: usize = 8;

/// One number of each airframe.
type Row = [f64; WIDTH];

/// At rest, level, and well above the ground, which would have to be looked at.
const NOBODY: State<f64> = [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];

/// Airframes, a lane each. A lane that nobody entered stands still.
pub struct Batch {
    arch: Arch,
    rows: Rows,
}

struct Rows {
    state: State<Row>,
    dt_s: Row,
    per_kg: Row,
    free_thrust_n: Row,
    ground_effect_gain: Row,
    ground_effect_height_m: Row,
    drag_n_s_per_m: Row,
    stabiliser: Stabiliser<Row>,
    command: AttitudeCommand<Row>,
}

impl Default for Batch {
    fn default() -> Self {
        Self::new()
    }
}

impl Batch {
    /// Nobody in it.
    pub fn new() -> Self {
        let (zero, one) = ([0.0; WIDTH], [1.0; WIDTH]);
        let rows = Rows {
            state: NOBODY.map(|value| [value; WIDTH]),
            dt_s: zero,
            per_kg: one,
            free_thrust_n: zero,
            ground_effect_gain: zero,
            ground_effect_height_m: one,
            drag_n_s_per_m: zero,
            stabiliser: Stabiliser {
                inertia_kg_m2: [one; 3],
                per_inertia: [one; 3],
                tilt_gain_per_s2: zero,
                rate_gain_per_s: zero,
                yaw_gain_per_s: zero,
                arm_m: zero,
            },
            command: AttitudeCommand { z_direction: [zero, zero, one], yaw_rate_rad_s: zero },
        };
        Self { arch: Arch::new(), rows }
    }

    /// Puts an airframe in a lane, with its mass, kg. It stands still until it is told how long a step is.
    pub fn enter(&mut self, lane: usize, body: &SixDegree, nominal: &Nominal, mass_kg: f64) {
        self.put(lane, body);
        let rows = &mut self.rows;
        rows.dt_s[lane] = 0.0;
        rows.per_kg[lane] = mass_kg.recip();
        rows.ground_effect_gain[lane] = nominal.ground_effect_gain;
        rows.ground_effect_height_m[lane] = nominal.ground_effect_height_m;
        rows.drag_n_s_per_m[lane] = nominal.drag_n_s_per_m;
        rows.stabiliser.set(lane, body.stabiliser());
    }

    /// Moves the airframe of a lane to where a body is.
    pub fn put(&mut self, lane: usize, body: &SixDegree) {
        for (row, value) in self.rows.state.iter_mut().zip(body.state()) {
            row[lane] = value;
        }
    }

    /// The length of a lane's steps from now on. In steps of no length nothing moves, but rounding may still change the last bit
    /// of an attitude.
    pub fn set_step(&mut self, lane: usize, dt_s: f64) {
        self.rows.dt_s[lane] = dt_s;
    }

    /// What a lane's steps hold from now on: thrust out of the ground effect, N, and what the sticks ask of `body`.
    pub fn hold(&mut self, lane: usize, free_thrust_n: f64, body: &mut SixDegree, sticks: Sticks) {
        self.rows.free_thrust_n[lane] = free_thrust_n;
        self.rows.command.set(lane, &body.command(sticks));
    }

    /// Moves all on by so many steps.
    pub fn step(&mut self, steps: u64) {
        self.arch.dispatch(Steps { rows: &mut self.rows, steps });
    }

    /// Makes a lane one that nobody entered.
    pub fn leave(&mut self, lane: usize) {
        for (row, value) in self.rows.state.iter_mut().zip(NOBODY) {
            row[lane] = value;
        }
        self.rows.dt_s[lane] = 0.0;
    }

    /// Where the airframe of a lane is, told to its body.
    pub fn tell(&self, lane: usize, body: &mut SixDegree) {
        body.set_state(&self.rows.state.map(|row| row[lane]));
    }
}

/// Forces without effects on the air.
struct Calm<T> {
    free_thrust_n: T,
    ground_effect_gain: T,
    ground_effect_height_m: T,
    drag_n_s_per_m: T,
}

impl<T: Real> ForceLaw<T> for Calm<T> {
    #[inline(always)]
    fn thrust_n(&self, at: &Instant<T>) -> T {
        let gain = ground_effect(self.ground_effect_gain, self.ground_effect_height_m, at.height_m);
        vertical_thrust_n(self.free_thrust_n, gain).at_least(gain.constant(0.0))
    }

    #[inline(always)]
    fn drag_n(&self, at: &Instant<T>) -> [T; 3] {
        drag_n(self.drag_n_s_per_m, &at.velocity_m_s)
    }
}

struct Steps<'a> {
    rows: &'a mut Rows,
    steps: u64,
}

impl WithSimd for Steps<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for place in 0..WIDTH / S::F64_LANES {
            move_lanes(simd, self.rows, place, self.steps);
        }
    }
}

/// Moves the lanes on that stand at one place of the rows.
#[inline(always)]
fn move_lanes<S: Simd>(simd: S, rows: &mut Rows, place: usize, steps: u64) {
    let of = |row: &Row| Lanes::load(simd, row, place);
    let forces = Calm {
        free_thrust_n: of(&rows.free_thrust_n),
        ground_effect_gain: of(&rows.ground_effect_gain),
        ground_effect_height_m: of(&rows.ground_effect_height_m),
        drag_n_s_per_m: of(&rows.drag_n_s_per_m),
    };
    let (stabiliser, command) = (rows.stabiliser.map(of), rows.command.map(of));
    let held = Held { forces: &forces, per_kg: of(&rows.per_kg), stabiliser: &stabiliser, command: &command };
    let dt_s = of(&rows.dt_s);
    let mut x = load(simd, &rows.state, place);
    for _ in 0..steps {
        x = step(&x, dt_s, &held);
        if x[2].any_at_most(0.0) {
            // Rare enough, and different enough from lane to lane, to be done one by one.
            for (row, lanes) in rows.state.iter_mut().zip(x) {
                lanes.store(row, place);
            }
            for lane in place * S::F64_LANES..(place + 1) * S::F64_LANES {
                settle_lane(&mut rows.state, lane);
            }
            x = load(simd, &rows.state, place);
        }
    }
    for (row, lanes) in rows.state.iter_mut().zip(x) {
        lanes.store(row, place);
    }
}

#[inline(always)]
fn load<S: Simd>(simd: S, state: &State<Row>, place: usize) -> State<Lanes<S>> {
    let mut x = [Lanes::load(simd, &state[0], place); 13];
    for (lanes, row) in x.iter_mut().zip(state) {
        *lanes = Lanes::load(simd, row, place);
    }
    x
}

fn settle_lane(state: &mut State<Row>, lane: usize) {
    let mut x = state.map(|row| row[lane]);
    if settle(&mut x) {
        for (row, value) in state.iter_mut().zip(x) {
            row[lane] = value;
        }
    }
}

impl Stabiliser<Row> {
    fn set(&mut self, lane: usize, own: &Stabiliser<f64>) {
        for axis in 0..3 {
            self.inertia_kg_m2[axis][lane] = own.inertia_kg_m2[axis];
            self.per_inertia[axis][lane] = own.per_inertia[axis];
        }
        self.tilt_gain_per_s2[lane] = own.tilt_gain_per_s2;
        self.rate_gain_per_s[lane] = own.rate_gain_per_s;
        self.yaw_gain_per_s[lane] = own.yaw_gain_per_s;
        self.arm_m[lane] = own.arm_m;
    }

    #[inline(always)]
    fn map<T>(&self, of: impl Fn(&Row) -> T) -> Stabiliser<T> {
        Stabiliser {
            inertia_kg_m2: self.inertia_kg_m2.each_ref().map(&of),
            per_inertia: self.per_inertia.each_ref().map(&of),
            tilt_gain_per_s2: of(&self.tilt_gain_per_s2),
            rate_gain_per_s: of(&self.rate_gain_per_s),
            yaw_gain_per_s: of(&self.yaw_gain_per_s),
            arm_m: of(&self.arm_m),
        }
    }
}

impl AttitudeCommand<Row> {
    fn set(&mut self, lane: usize, own: &AttitudeCommand<f64>) {
        for axis in 0..3 {
            self.z_direction[axis][lane] = own.z_direction[axis];
        }
        self.yaw_rate_rad_s[lane] = own.yaw_rate_rad_s;
    }

    #[inline(always)]
    fn map<T>(&self, of: impl Fn(&Row) -> T) -> AttitudeCommand<T> {
        AttitudeCommand {
            z_direction: self.z_direction.each_ref().map(&of),
            yaw_rate_rad_s: of(&self.yaw_rate_rad_s),
        }
    }
}
