//! One pass of the filter over the flights: innovations, and their sensitivities to parameters.

use bench_rig::Rig;
use nalgebra::{DMatrix, DVector};

use crate::{
    law::{Coordinate, Law, Point},
    track::{Sighting, Track},
};

/// What disturbs the model, and what blurs the tracker.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// White acceleration, m/s^2 per root Hz.
    pub acceleration: f64,
    /// Random walk of the trim acceleration, m/s^2 per root s.
    pub trim_walk: f64,
    /// Prior of the trim acceleration of a flight, m/s^2.
    pub trim: f64,
    /// One sigma of a sighting, rounding included, m.
    pub sighting_m: f64,
}

/// Something whose small change the innovations feel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Direction {
    /// A coordinate of the point, and the step by which its derivative is taken; the step's sign chooses the side.
    Coordinate(Coordinate, f64),
    /// A free acceleration of 1 m/s^2 where a quantity is near a knot, falling linearly to its neighbours.
    Hat(Hat),
}

/// One hat function of a quantity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hat {
    /// Which quantity.
    pub axis: Axis,
    /// The knot before, the knot itself, the knot after. Equal neighbours: the first or last knot, whose hat goes on.
    pub knots: [f64; 3],
}

impl Hat {
    #[inline]
    fn at(&self, x: f64) -> f64 {
        let [before, at, after] = self.knots;
        if x < at {
            if before == at { 1.0 } else { ((x - before) / (at - before)).max(0.0) }
        } else if after == at {
            1.0
        } else {
            ((after - x) / (after - at)).max(0.0)
        }
    }
}

/// A quantity over which a free acceleration may vary.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    /// Altitude, m.
    Altitude,
    /// Vertical speed, m/s.
    Speed,
    /// Nominal thrust out of the ground effect over nominal weight.
    ThrustToWeight,
    /// Change of that ratio against what it was of late, through a lag.
    ThrustChange,
    /// Time since the throttle first left its rest, s.
    Time,
    /// Integral of the thrust-to-weight ratio, minutes.
    Charge,
}

impl Axis {
    /// All of them.
    pub const ALL: [Self; 6] =
        [Self::Altitude, Self::Speed, Self::ThrustToWeight, Self::ThrustChange, Self::Time, Self::Charge];
}

/// Time constant against which a change of thrust is taken, s.
const CHANGE_TIME_S: f64 = 0.3;

/// What the hats look at, besides the state.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Surroundings {
    ratio: f64,
    lagged_ratio: f64,
    elapsed_s: f64,
    charge_min: f64,
}

/// One sighting held against its prediction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Innovation {
    /// Exposure as the tracker believes, s.
    pub exposed_s: f64,
    /// Seen less predicted, m.
    pub residual_m: f64,
    /// Predicted variance, m^2.
    pub variance_m2: f64,
    /// The quantities of [`Axis::ALL`], in its order.
    pub axes: [f64; 6],
}

/// The outcome of a pass.
#[derive(Clone, Debug, Default)]
pub struct Pass {
    /// Negative log-likelihood.
    pub nll: f64,
    /// Every innovation that counts.
    pub innovations: Vec<Innovation>,
    /// Gradient of the log-likelihood.
    pub gradient: DVector<f64>,
    /// Fisher information.
    pub information: DMatrix<f64>,
}

/// Differences over which the force's slopes are taken, m and m/s: small against the ground effect's 5 cm.
const DZ: f64 = 1e-4;
const DV: f64 = 1e-3;
/// Longest integration step, s.
const STEP_S: f64 = 0.025;
/// Below this altitude the ground effect's kink makes the model uncertain, m.
const NEAR_GROUND_M: f64 = 0.07;
/// Process noise there, as a factor of its density.
const NEAR_GROUND_FACTOR: f64 = 3.0;
/// Innovations beyond this many sigma count linearly.
const HUBER: f64 = 4.0;

struct Twin {
    source: Source,
    sensitivity: [f64; 3],
}

enum Source {
    /// The law a little aside, and the reciprocal of how far.
    Law(Box<Law>, f64),
    Hat(Hat),
}

struct Filter<'a> {
    noise: &'a Noise,
    law: Law,
    twins: Vec<Twin>,
    x: [f64; 3],
    p: [[f64; 3]; 3],
    around: Surroundings,
    ratio_per_unit: f64,
    offset: f64,
}

/// Runs the filter over all tracks at a point.
pub fn run(tracks: &[Track], rig: &Rig, point: &Point, noise: &Noise, directions: &[Direction]) -> Pass {
    let n = directions.len();
    let mut pass = Pass { gradient: DVector::zeros(n), information: DMatrix::zeros(n, n), ..Pass::default() };
    let mut row = vec![0.0; n];
    for track in tracks {
        let twins = directions
            .iter()
            .map(|direction| {
                let source = match *direction {
                    Direction::Coordinate(at, step) => {
                        let mut moved = point.clone();
                        *moved.get_mut(at) += step;
                        Source::Law(Box::new(Law::new(&moved, rig)), step.recip())
                    }
                    Direction::Hat(hat) => Source::Hat(hat),
                };
                Twin { source, sensitivity: [0.0; 3] }
            })
            .collect();
        let mut filter = Filter {
            noise,
            law: Law::new(point, rig),
            twins,
            x: [0.0; 3],
            around: Surroundings { ratio: 0.0, lagged_ratio: 1.0, ..Surroundings::default() },
            ratio_per_unit: rig.airframe.thrust.gain_n_per_unit.value / rig.airframe.weight_n(),
            offset: rig.airframe.thrust.offset.value,
            p: [[1e-8, 0.0, 0.0], [0.0, 1e-8, 0.0], [0.0, 0.0, noise.trim * noise.trim]],
        };
        filter.fly(track, rig, &mut pass, &mut row);
    }
    pass
}

impl Filter<'_> {
    fn fly(&mut self, track: &Track, rig: &Rig, pass: &mut Pass, row: &mut [f64]) {
        let mut now = track.begin_s;
        let mut input = track.inputs.partition_point(|input| input.time_s <= now).max(1) - 1;
        let late = self.law.latency_s - rig.tracker.latency_s.value;
        for sighting in &track.sightings {
            let at = sighting.exposed_s - late;
            while now < at {
                let edge = track.inputs.get(input + 1).map_or(f64::INFINITY, |next| next.time_s);
                let until = at.min(edge);
                let throttle = track.inputs[input].throttle;
                let steps = ((until - now) / STEP_S).ceil().max(1.0);
                let h = (until - now) / steps;
                if h > 0.0 {
                    for _ in 0..steps as usize {
                        self.step(h, throttle);
                    }
                }
                now = until;
                if until == edge {
                    input += 1;
                }
            }
            let blind = sighting.exposed_s >= track.blind_from_s;
            self.see(sighting, track.timing_s, blind, pass, row);
        }
    }

    fn step(&mut self, h: f64, throttle: f64) {
        let [z, v, b] = self.x;
        self.look_around(h, throttle);
        self.law.hold(h, throttle);
        self.law.advance(h, z, v);
        let a0 = self.law.acceleration_m_s2(z, v);
        if z <= 0.0 && v <= 0.0 && a0 + b <= 0.0 {
            // Standing: the effects' states still move on.
            for twin in &mut self.twins {
                if let Source::Law(law, _) = &mut twin.source {
                    law.hold(h, throttle);
                    law.advance(h, z, v);
                }
                twin.sensitivity[0] = 0.0;
                twin.sensitivity[1] = 0.0;
            }
            return;
        }
        let az = (self.law.acceleration_m_s2(z + DZ, v) - self.law.acceleration_m_s2(z - DZ, v)) / (2.0 * DZ);
        let av = (self.law.acceleration_m_s2(z, v + DV) - a0) / DV;
        let a = a0 + b;
        let jerk = az * v + av * a;
        let mut z1 = z + h * (v + h * (a / 2.0 + h * jerk / 6.0));
        let mut v1 = v + h * (a + h * jerk / 2.0);
        let f = [
            [1.0 + az * h * h / 2.0, h * (1.0 + av * h / 2.0), h * h / 2.0],
            [az * h, 1.0 + av * h + (az + av * av) * h * h / 2.0, h * (1.0 + av * h / 2.0)],
        ];
        self.spread(&f, h, z);
        let axes = self.axes();
        for twin in &mut self.twins {
            let push = match &mut twin.source {
                Source::Law(law, inverse_step) => {
                    law.hold(h, throttle);
                    law.advance(h, z, v);
                    (law.acceleration_m_s2(z, v) - a0) * *inverse_step
                }
                Source::Hat(hat) => hat.at(axes[hat.axis as usize]),
            };
            let [sz, sv, sb] = twin.sensitivity;
            twin.sensitivity[0] = f[0][0] * sz + f[0][1] * sv + f[0][2] * sb + h * h / 2.0 * push;
            twin.sensitivity[1] = f[1][0] * sz + f[1][1] * sv + f[1][2] * sb + h * push;
        }
        if z1 <= 0.0 {
            z1 = 0.0;
            if v1 < 0.0 {
                v1 = 0.0;
                self.p[0] = [1e-6, 0.0, 0.0];
                self.p[1] = [0.0, 1e-3, 0.0];
                self.p[2][0] = 0.0;
                self.p[2][1] = 0.0;
                for twin in &mut self.twins {
                    twin.sensitivity[0] = 0.0;
                    twin.sensitivity[1] = 0.0;
                }
            }
        }
        self.x = [z1, v1, b];
    }

    fn look_around(&mut self, h: f64, throttle: f64) {
        let around = &mut self.around;
        around.ratio = (self.ratio_per_unit * (throttle - self.offset)).max(0.0);
        around.lagged_ratio += (around.ratio - around.lagged_ratio) * -(-h / CHANGE_TIME_S).exp_m1();
        around.elapsed_s += h;
        around.charge_min += around.ratio * h / 60.0;
    }

    /// The quantities of [`Axis::ALL`].
    fn axes(&self) -> [f64; 6] {
        let around = &self.around;
        let change = around.ratio - around.lagged_ratio;
        [self.x[0], self.x[1], around.ratio, change, around.elapsed_s, around.charge_min]
    }

    fn spread(&mut self, f: &[[f64; 3]; 2], h: f64, z: f64) {
        let p = &self.p;
        let mut fp = [[0.0; 3]; 2];
        for (i, fi) in f.iter().enumerate() {
            for j in 0..3 {
                fp[i][j] = fi[0] * p[0][j] + fi[1] * p[1][j] + fi[2] * p[2][j];
            }
        }
        let near = if z < NEAR_GROUND_M { NEAR_GROUND_FACTOR } else { 1.0 };
        let q = (self.noise.acceleration * near).powi(2);
        let p00 = fp[0][0] * f[0][0] + fp[0][1] * f[0][1] + fp[0][2] * f[0][2] + q * h * h * h / 3.0;
        let p01 = fp[0][0] * f[1][0] + fp[0][1] * f[1][1] + fp[0][2] * f[1][2] + q * h * h / 2.0;
        let p11 = fp[1][0] * f[1][0] + fp[1][1] * f[1][1] + fp[1][2] * f[1][2] + q * h;
        let p22 = p[2][2] + self.noise.trim_walk.powi(2) * h;
        self.p = [[p00, p01, fp[0][2]], [p01, p11, fp[1][2]], [fp[0][2], fp[1][2], p22]];
    }

    /// Holds a sighting against its prediction and, unless `blind`, learns from it.
    fn see(&mut self, sighting: &Sighting, timing_s: f64, blind: bool, pass: &mut Pass, row: &mut [f64]) {
        let [z, v, _] = self.x;
        let (factor, offset) = self.law.scale;
        let predicted = factor * z + offset;
        let residual = sighting.z_m - predicted;
        let timing = factor * v * timing_s;
        let r = self.noise.sighting_m.powi(2) + timing * timing;
        let s = factor * factor * self.p[0][0] + r;
        for (twin, out) in self.twins.iter().zip(row.iter_mut()) {
            let seen = match &twin.source {
                Source::Law(law, inverse_step) => {
                    let later_s = law.latency_s - self.law.latency_s;
                    (law.scale.0 * z + law.scale.1 - predicted - later_s * v * factor) * inverse_step
                }
                Source::Hat(_) => 0.0,
            };
            *out = factor * twin.sensitivity[0] + seen;
        }
        let sigma = s.sqrt();
        let weight = (HUBER * sigma / residual.abs()).min(1.0);
        if sighting.counts {
            let u = residual.abs() / sigma;
            let rho = if u <= HUBER { 0.5 * u * u } else { HUBER * u - 0.5 * HUBER * HUBER };
            pass.nll += rho + sigma.ln();
            for (i, slope) in row.iter().enumerate() {
                let weighted = weight * slope / s;
                pass.gradient[i] += weighted * residual;
                // The lower triangle is all that is read.
                for (j, other) in row[..=i].iter().enumerate() {
                    pass.information[(i, j)] += weighted * other;
                }
            }
            let axes = self.axes();
            pass.innovations.push(Innovation {
                exposed_s: sighting.exposed_s,
                residual_m: residual,
                variance_m2: s,
                axes,
            });
        }
        if blind {
            return;
        }
        let k = [0, 1, 2].map(|i| self.p[i][0] * factor / s * weight);
        let top = self.p[0];
        for ((x, k), row) in self.x.iter_mut().zip(k).zip(&mut self.p) {
            *x += k * residual;
            for (p, top) in row.iter_mut().zip(top) {
                *p -= k * factor * top;
            }
        }
        for (twin, out) in self.twins.iter_mut().zip(row.iter()) {
            for (sensitivity, k) in twin.sensitivity.iter_mut().zip(k) {
                *sensitivity -= k * out;
            }
        }
        if self.x[0] < 0.0 {
            self.x[0] = 0.0;
        }
    }
}
