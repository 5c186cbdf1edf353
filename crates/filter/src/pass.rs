//! One pass of the filter over the flights: innovations, and their sensitivities to parameters.

use bench_rig::Rig;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use crate::{
    law::{Coordinate, Law, Point, Reach},
    noise::Noise,
    pins::dragged,
    sight::{Scored, Sight},
    smooth::Knot,
    track::{Felt, Sighting, Track, held},
};

/// Something whose small change the innovations feel.
#[derive(Clone, Debug, PartialEq)]
pub enum Direction {
    /// A coordinate of the point, and the step by which its derivative is taken; the step's sign chooses the side.
    Coordinate(Coordinate, f64),
    /// An effect that the point lacks, by library index, at full size: a finite difference from the point.
    Added(usize, Vec<f64>),
    /// An acceleration of 1 m/s^2 that swings at a frequency, Hz, with a phase, rad, from take-off on.
    Wave(f64, f64),
    /// An acceleration of 1 m/s^2 all along.
    Steady,
    /// An acceleration of 1 m/s^2 upwards at one end of a play of the thrust, of such a width over the weight, downwards at the
    /// other, and in proportion between: at the upper end once the throttle has risen through it.
    Play(f64),
    /// A free offset of sightings.
    Seen(Seen),
    /// A free acceleration of 1 m/s^2 where a quantity is near a knot, falling linearly to its neighbours.
    Hat(Hat),
}

/// What a tracker may get wrong, per unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Seen {
    /// 1 m near an altitude.
    Altitude(Hat),
    /// 1 m at a thrust of twice the weight, none at the weight.
    Thrust,
    /// 1 m a second of flight.
    Time,
    /// Latency that grows by 1 s a second of flight.
    Latency,
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

/// How many quantities there are.
pub const AXES: usize = 8;

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
    /// Voltage of the battery, V; 0 where it was not measured.
    Voltage,
    /// Altitude as it was of late, through a lag, m.
    Past,
}

impl Axis {
    /// All of them.
    pub const ALL: [Self; AXES] = [
        Self::Altitude,
        Self::Speed,
        Self::ThrustToWeight,
        Self::ThrustChange,
        Self::Time,
        Self::Charge,
        Self::Voltage,
        Self::Past,
    ];
}

/// Time constant against which a change of thrust is taken, s.
const CHANGE_TIME_S: f64 = 0.3;
/// Time constant for which the air about an airframe may remember where it was, s.
const PAST_TIME_S: f64 = 2.0;

/// What the hats look at, besides the state.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Surroundings {
    ratio: f64,
    lagged_ratio: f64,
    elapsed_s: f64,
    charge_min: f64,
    voltage: f64,
    lagged_altitude_m: f64,
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
    /// Its share of the negative log-likelihood.
    pub nll: f64,
    /// Altitude, m; speed, m/s; thrust over weight; its change of late; time, s; charge, min; voltage, V;
    /// altitude of late, m.
    pub axes: [f64; AXES],
}

/// The outcome of a pass.
#[derive(Clone, Debug, Default)]
pub struct Pass {
    /// Negative log-likelihood.
    pub nll: f64,
    /// The same with other noise: `PROBES`. Only where there are directions.
    pub noise_nll: [f64; 4],
    /// Gradient of the log-likelihood.
    pub gradient: DVector<f64>,
    /// Fisher information.
    pub information: DMatrix<f64>,
    /// The same of each track.
    pub tracks: Vec<TrackPass>,
}

impl Pass {
    /// Every innovation that counts.
    pub fn innovations(&self) -> impl Iterator<Item = &Innovation> {
        self.tracks.iter().flat_map(|track| &track.innovations)
    }
}

/// One track's share of a pass.
#[derive(Clone, Debug, Default)]
pub struct TrackPass {
    /// Negative log-likelihood.
    pub nll: f64,
    /// The same with other noise.
    pub noise_nll: [f64; 4],
    /// Gradient of the log-likelihood.
    pub gradient: DVector<f64>,
    /// Fisher information.
    pub information: DMatrix<f64>,
    /// Every innovation that counts.
    pub innovations: Vec<Innovation>,
    /// Squared errors of predictions over each of the horizons from the filtered state, m^2, with their number.
    pub predictions: [(f64, u32); 3],
    /// What was known at each sighting; only where a trace was asked for.
    pub knots: Vec<Knot>,
}

/// Horizons of prediction, s.
pub const HORIZONS_S: [f64; 3] = [0.5, 1.0, 2.0];
/// Time between two starts of a prediction, s.
const FORK_EVERY_S: f64 = 1.0;
/// The filter gets so long to find the state before the first prediction, s.
const SETTLE_S: f64 = 1.5;
/// A sighting so much after a horizon still stands for it, s.
const HORIZON_SLACK_S: f64 = 0.12;

/// A prediction under way, linearised about the filter itself: it does not learn.
#[derive(Clone, Copy, Debug)]
struct Fork {
    begin_s: f64,
    /// Its state less the filter's.
    aside: State,
    /// Horizons that it has passed.
    passed: usize,
}

/// Logarithms of the factors by which the probes' noise differs: process noise down and up, tracker noise down and up.
pub const PROBES: [f64; 4] = [-0.25, 0.25, -0.05, 0.05];

/// The filter with other noise, linearised about the filter itself: what the likelihood would be.
#[derive(Clone, Copy, Debug)]
struct Probe {
    noise: Noise,
    p: Covariance,
    /// Its state less the filter's.
    aside: State,
    /// How probably the last sighting was of an older frame than its own.
    stale: f64,
}

impl Probe {
    fn around(noise: &Noise) -> [Self; 4] {
        let mut probes = [Self {
            noise: *noise,
            p: initial_covariance(noise),
            aside: [0.0; 4],
            stale: noise.stale_probability,
        }; 4];
        for (i, (probe, ln_factor)) in probes.iter_mut().zip(PROBES).enumerate() {
            if i < 2 {
                probe.noise.turbulence *= ln_factor.exp();
            } else {
                probe.noise.sighting_m *= ln_factor.exp();
            }
        }
        probes
    }
}

/// Differences over which the force's slopes are taken, m and m/s: small against the ground effect's 5 cm.
const DZ: f64 = 1e-4;
const DV: f64 = 1e-3;
/// Altitude, vertical speed, trim acceleration, turbulence.
pub type State = [f64; 4];
/// Covariance of a [`State`], row by row.
pub type Covariance = [[f64; 4]; 4];
/// For so long laws are held at what was there before the flight, s: they settle on it.
const AT_REST_S: f64 = 1e-6;
/// Longest integration step, s, and the longest near the ground, where the air changes within centimetres.
const STEP_S: f64 = 0.1001;
const NEAR_GROUND_STEP_S: f64 = 0.034;
/// Near the ground a step leads no further than this share of the ground effect's height, and is no shorter than this, s;
/// near is nearer than so many of its heights.
const STEP_OF_GROUND_EFFECT: f64 = 0.125;
const LEAST_STEP_S: f64 = 0.003;
const NEAR_HEIGHTS: f64 = 3.0;
/// Below this altitude the ground effect's kink makes the model uncertain, m.
pub const NEAR_GROUND_M: f64 = 0.07;
/// Spread of altitude when the airframe leaves the ground, m.
pub const LIFT_OFF_M: f64 = 0.001;

struct Twin {
    source: Source,
    sensitivity: State,
}

impl Twin {
    /// Moves what it remembers on over a step at an altitude and speed, beside a law.
    #[inline]
    fn move_on(&mut self, beside: &Law, h: f64, throttle: f64, [z, v]: [f64; 2], ratio: f64) {
        match &mut self.source {
            Source::Law(law, _, reach) => law.move_beside(beside, *reach, h, throttle, [z, v]),
            Source::Play(play) => play.drag(ratio),
            _ => {}
        }
    }
}

enum Source {
    /// The law a little aside, the reciprocal of how far, and from where on it differs.
    Law(Box<Law>, f64, Reach),
    Hat(Hat),
    /// Frequency, rad/s, and phase.
    Wave(f64, f64),
    Steady,
    Play(Play),
    Seen(Seen),
}

/// A play of the thrust, over the weight.
struct Play {
    width: f64,
    /// Where its middle is.
    middle: f64,
}

impl Play {
    /// Drags it along to a thrust.
    #[inline]
    fn drag(&mut self, ratio: f64) {
        self.middle = dragged(self.middle, ratio, self.width);
    }

    /// Where in it a thrust is, from -1 to 1.
    #[inline]
    fn place(&self, ratio: f64) -> f64 {
        2.0 * (ratio - self.middle) / self.width
    }
}

impl Source {
    /// Acceleration that it adds, per unit, at an altitude and speed where the law's is `force`.
    #[inline]
    fn push(&self, [z, v]: [f64; 2], force: f64, axes: &[f64; AXES]) -> f64 {
        match self {
            Self::Law(_, _, Reach::Sight) | Self::Seen(_) => 0.0,
            Self::Law(law, inverse_step, _) => (law.acceleration_m_s2(z, v) - force) * inverse_step,
            Self::Steady => 1.0,
            Self::Hat(hat) => hat.at(axes[hat.axis as usize]),
            Self::Play(play) => play.place(axes[Axis::ThrustToWeight as usize]),
            Self::Wave(rad_s, phase) => (rad_s * axes[Axis::Time as usize] + phase).sin(),
        }
    }
}

struct Filter {
    noise: Noise,
    law: Law,
    twins: Vec<Twin>,
    probes: Vec<Probe>,
    forks: Vec<Fork>,
    standing: bool,
    /// Whether the last sighting counted.
    counting: bool,
    /// When and where the airframe was last seen.
    last_seen: Option<(f64, f64)>,
    /// How probably the last sighting was of an older frame than its own.
    stale: f64,
    step_m: f64,
    frame_s: f64,
    /// Whether the airframe is carried, and where and when it was last seen so.
    carried: bool,
    carried_at: Option<(f64, f64)>,
    /// Where asked for: what was known at each sighting, and the transition since the last.
    knots: Option<(Vec<Knot>, Covariance)>,
    next_fork_s: f64,
    x: State,
    p: Covariance,
    around: Surroundings,
    ratio_per_unit: f64,
    offset: f64,
    /// Where the airframe is stopped from above, m.
    ceiling_m: f64,
    /// Height below which the ground bends a flight, m.
    ground_effect_m: f64,
    row: Vec<f64>,
    /// Lower triangle of the information, row by row.
    lower: Vec<f64>,
    pass: TrackPass,
}

/// Runs the filter over all tracks at a point.
pub fn run(tracks: &[Track], rig: &Rig, point: &Point, noise: &Noise, directions: &[Direction]) -> Pass {
    let flown: Vec<TrackPass> =
        tracks.par_iter().map(|track| fly_track(track, rig, point, noise, directions)).collect();
    // In the tracks' order, so that sums do not depend on who finished first.
    let n = directions.len();
    let mut pass = Pass { gradient: DVector::zeros(n), information: DMatrix::zeros(n, n), ..Pass::default() };
    for one in flown {
        pass.nll += one.nll;
        for (sum, x) in pass.noise_nll.iter_mut().zip(one.noise_nll) {
            *sum += x;
        }
        pass.gradient += &one.gradient;
        pass.information += &one.information;
        pass.tracks.push(one);
    }
    pass
}

/// One track's pass.
pub fn fly_track(
    track: &Track,
    rig: &Rig,
    point: &Point,
    noise: &Noise,
    directions: &[Direction],
) -> TrackPass {
    Filter::new(track, rig, point, noise, directions).fly(track, rig)
}

/// What the filter knew at each sighting of a track.
pub fn trace_track(track: &Track, rig: &Rig, point: &Point, noise: &Noise) -> Vec<Knot> {
    let mut filter = Filter::new(track, rig, point, noise, &[]);
    filter.knots = Some((Vec::new(), IDENTITY));
    filter.fly(track, rig).knots
}

const IDENTITY: Covariance =
    [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];

fn initial_covariance(noise: &Noise) -> Covariance {
    let mut p = [[0.0; 4]; 4];
    for (i, variance) in [1e-8, 1e-8, noise.trim.powi(2), noise.turbulence.powi(2)].into_iter().enumerate() {
        p[i][i] = variance;
    }
    p
}

impl Filter {
    fn new(track: &Track, rig: &Rig, point: &Point, noise: &Noise, directions: &[Direction]) -> Self {
        let noise = noise.times(track.ln_noise.exp());
        let twins = directions
            .iter()
            .map(|direction| {
                let source = match direction {
                    Direction::Coordinate(at, step) => {
                        let mut moved = point.clone();
                        *moved.get_mut(*at) += step;
                        let reach = Reach::of(*at, point, rig);
                        Source::Law(Box::new(Law::new(&moved, rig)), step.recip(), reach)
                    }
                    Direction::Added(effect, values) => {
                        let mut moved = point.clone();
                        moved.effects.push((*effect, values.clone()));
                        Source::Law(Box::new(Law::new(&moved, rig)), 1.0, Reach::of_effect(*effect))
                    }
                    Direction::Hat(hat) => Source::Hat(*hat),
                    Direction::Steady => Source::Steady,
                    Direction::Play(width) => Source::Play(Play { width: *width, middle: 0.0 }),
                    Direction::Seen(seen) => Source::Seen(*seen),
                    Direction::Wave(hz, phase_rad) => Source::Wave(std::f64::consts::TAU * hz, *phase_rad),
                };
                Twin { source, sensitivity: [0.0; 4] }
            })
            .collect();
        let n = directions.len();
        let law = Law::new(point, rig);
        let ceiling_m = stopping_m(&law, track, &noise);
        Self {
            law,
            ceiling_m,
            twins,
            x: [0.0; 4],
            around: Surroundings { ratio: 0.0, lagged_ratio: 1.0, ..Surroundings::default() },
            ratio_per_unit: rig.airframe.thrust.gain_n_per_unit.value / rig.airframe.weight_n(),
            offset: rig.airframe.thrust.offset.value,
            ground_effect_m: rig.airframe.ground_effect.height_m.value,
            p: initial_covariance(&noise),
            // Without directions only the likelihood is asked for.
            probes: if directions.is_empty() { Vec::new() } else { Probe::around(&noise).to_vec() },
            forks: Vec::new(),
            standing: true,
            counting: false,
            last_seen: None,
            stale: noise.stale_probability,
            step_m: rig.tracker.resolution_m.max(1e-4),
            frame_s: rig.tracker.frame_period_s,
            carried: false,
            carried_at: None,
            next_fork_s: track.begin_s + SETTLE_S,
            knots: None,
            noise,
            row: vec![0.0; n],
            lower: vec![0.0; n * (n + 1) / 2],
            pass: TrackPass { gradient: DVector::zeros(n), ..TrackPass::default() },
        }
    }

    fn fly(mut self, track: &Track, rig: &Rig) -> TrackPass {
        let mut now = track.begin_s;
        let mut input = track.inputs.partition_point(|input| input.time_s <= now).max(1) - 1;
        if let Some(before) = input.checked_sub(1) {
            // What lags comes from what was held at rest, not from the launch.
            let throttle = track.inputs[before].throttle;
            self.law.hold(AT_REST_S, throttle);
            self.law.advance(AT_REST_S, 0.0, 0.0);
            self.hold_twins(AT_REST_S, throttle);
        }
        let late = self.law.latency_s - rig.tracker.latency_s.value;
        // The smoother knows of sightings alone.
        let feels = self.noise.velocity_m_s.max(self.noise.acceleration_m_s2) > 0.0 && self.knots.is_none();
        let mut felt = if feels { track.felt.as_slice() } else { &[] };
        for sighting in &track.sightings {
            self.carried = sighting.carried;
            let at = sighting.exposed_s - late;
            while now < at {
                let edge = track.inputs.get(input + 1).map_or(f64::INFINITY, |next| next.time_s);
                let until = at.min(edge).min(felt.first().map_or(f64::INFINITY, |felt| felt.time_s.max(now)));
                let throttle = track.inputs[input].throttle;
                self.look_at_channels(track, now);
                while now < until {
                    let left = until - now;
                    let steps = (left / self.longest_step_s()).ceil();
                    self.step(left / steps, throttle);
                    now = if steps > 1.0 { now + left / steps } else { until };
                }
                if until == edge {
                    input += 1;
                }
                while let Some((first, rest)) = felt.split_first().filter(|(first, _)| first.time_s <= now) {
                    self.feel(first);
                    felt = rest;
                }
            }
            if self.carried {
                self.carry(sighting);
            } else {
                self.see(sighting, track.timing_s);
            }
        }
        let n = self.row.len();
        let mut information = DMatrix::zeros(n, n);
        for i in 0..n {
            for j in 0..=i {
                let value = self.lower[i * (i + 1) / 2 + j];
                information[(i, j)] = value;
                information[(j, i)] = value;
            }
        }
        let knots = self.knots.map(|(knots, _)| knots).unwrap_or_default();
        TrackPass { information, knots, ..self.pass }
    }

    /// How long the next step may be: fast through the ground effect, a flight is bent within a few hundredths of a second.
    fn longest_step_s(&self) -> f64 {
        let [z, v, ..] = self.x;
        if z - STEP_S * v.abs() > NEAR_HEIGHTS * self.ground_effect_m {
            return STEP_S;
        }
        let through_s = STEP_OF_GROUND_EFFECT * self.ground_effect_m / v.abs().max(f64::MIN_POSITIVE);
        through_s.clamp(LEAST_STEP_S, NEAR_GROUND_STEP_S)
    }

    fn step(&mut self, h: f64, throttle: f64) {
        let [z, v, b, w] = self.x;
        let w_time = self.noise.turbulence_time_s;
        self.look_around(h, throttle);
        self.law.hold(h, throttle);
        self.law.advance(h, z, v);
        let a0 = self.law.acceleration_m_s2(z, v);
        if self.carried {
            self.hold_twins(h, throttle);
            return;
        }
        if z <= 0.0 && v <= 0.0 && a0 + b + w <= 0.0 {
            // Standing: the effects' states still move on.
            self.hold_twins(h, throttle);
            for twin in &mut self.twins {
                twin.sensitivity[0] = 0.0;
                twin.sensitivity[1] = 0.0;
            }
            self.standing = true;
            return;
        }
        if self.standing {
            // What legs and floor do as it leaves is not known.
            self.standing = false;
            for p in std::iter::once(&mut self.p).chain(self.probes.iter_mut().map(|probe| &mut probe.p)) {
                p[0][0] += LIFT_OFF_M * LIFT_OFF_M;
                p[1][1] += self.noise.lift_off_m_s.powi(2);
            }
        }
        // Classical Runge-Kutta; what depends on the way there is taken in its middle.
        let a = a0 + b + w;
        let half = h / 2.0;
        let after = |dt: f64, speed: f64, a: f64| [(z + dt * speed).max(0.0), v + dt * a];
        let first = after(half, v, a);
        let a1 = self.law.acceleration_m_s2(first[0], first[1]) + b + w;
        let middle = after(half, first[1], a1);
        let force = self.law.acceleration_m_s2(middle[0], middle[1]);
        let a2 = force + b + w;
        let end = after(h, middle[1], a2);
        let a3 = self.law.acceleration_m_s2(end[0], end[1]) + b + w;
        let mut z1 = z + h * (v + h * (a + a1 + a2) / 6.0);
        let mut v1 = v + h * (a + 2.0 * (a1 + a2) + a3) / 6.0;
        let (az, av) = self.slopes(middle, force);
        let kept = if w_time > 0.0 { (-h / w_time).exp() } else { 0.0 };
        let push = h * h / 2.0;
        let lift = h * (1.0 + av * h / 2.0);
        let f = Transition {
            z: [1.0 + az * push, lift, push],
            v: [az * h, 1.0 + av * h + (az + av * av) * push, lift],
            kept,
        };
        let near = z < NEAR_GROUND_M;
        spread(&mut self.p, &f, h, near, &self.noise);
        for probe in &mut self.probes {
            spread(&mut probe.p, &f, h, near, &probe.noise);
            probe.aside = f.apply(probe.aside);
        }
        for fork in &mut self.forks {
            fork.aside = f.apply(fork.aside);
        }
        if let Some((_, since)) = &mut self.knots {
            for j in 0..4 {
                let moved = f.apply([since[0][j], since[1][j], since[2][j], since[3][j]]);
                for (row, value) in since.iter_mut().zip(moved) {
                    row[j] = value;
                }
            }
        }
        let axes = self.axes();
        for twin in &mut self.twins {
            twin.move_on(&self.law, h, throttle, [z, v], axes[Axis::ThrustToWeight as usize]);
            let push = twin.source.push(middle, force, &axes);
            twin.sensitivity = f.apply(twin.sensitivity);
            twin.sensitivity[0] += h * h / 2.0 * push;
            twin.sensitivity[1] += h * push;
        }
        if z1 <= 0.0 {
            z1 = 0.0;
            if v1 < 0.0 {
                v1 = 0.0;
                self.touch(|_| 0.0);
            }
        }
        if z1 >= self.ceiling_m {
            z1 = self.ceiling_m;
            v1 = v1.min(0.0);
            let own_m = self.law.ceiling_m;
            self.touch(|source| match source {
                Source::Law(law, inverse_step, _) if law.ceiling_m.is_finite() => {
                    (law.ceiling_m - own_m) * inverse_step
                }
                _ => 0.0,
            });
        }
        self.x = [z1, v1, b, w * kept];
    }

    /// Ground or ceiling leave nothing of how the airframe came there: all that is told against the state is stopped too, by what stops
    /// it, `aside_m` from here per unit.
    fn touch(&mut self, aside_m: impl Fn(&Source) -> f64) {
        stopped(&mut self.p);
        for probe in &mut self.probes {
            stopped(&mut probe.p);
            probe.aside[0] = 0.0;
            probe.aside[1] = 0.0;
        }
        // Where the one is stopped and the other not, they cannot be compared.
        self.forks.clear();
        if let Some((_, since)) = &mut self.knots {
            since[0] = [0.0; 4];
            since[1] = [0.0; 4];
        }
        for twin in &mut self.twins {
            twin.sensitivity[0] = aside_m(&twin.source);
            twin.sensitivity[1] = 0.0;
        }
    }

    fn look_at_channels(&mut self, track: &Track, now_s: f64) {
        if !track.tilt.is_empty() {
            let cosine = held(&track.tilt, now_s).unwrap_or(1.0);
            self.law.tilt_cos = cosine;
            for twin in &mut self.twins {
                if let Source::Law(law, ..) = &mut twin.source {
                    law.tilt_cos = cosine;
                }
            }
        }
        if !track.voltage.is_empty() {
            self.around.voltage = held(&track.voltage, now_s).unwrap_or(track.voltage[0].1);
        }
    }

    /// Moves the effects' states of the laws aside on, where the airframe does not follow them.
    fn hold_twins(&mut self, h: f64, throttle: f64) {
        let [z, v, ..] = self.x;
        for twin in &mut self.twins {
            twin.move_on(&self.law, h, throttle, [z, v], self.around.ratio);
        }
    }

    /// Takes the airframe to be where it is seen. What a flight keeps, its trim, is kept; the rest begins anew.
    fn carry(&mut self, sighting: &Sighting) {
        let z = self.law.view.altitude_m(sighting.z_m).max(0.0);
        let (factor, seen_m) = (self.law.view.slope(z), self.law.view.seen_m(z));
        let speed = self.carried_at.replace((sighting.exposed_s, z)).map_or(0.0, |(time_s, from)| {
            let since_s = sighting.exposed_s - time_s;
            if (1e-4..SPEED_WITHIN_S).contains(&since_s) { (z - from) / since_s } else { 0.0 }
        });
        let v = speed.clamp(-CARRIED_M_S, CARRIED_M_S);
        self.x = [z, v, self.x[2], 0.0];
        self.standing = false;
        begin_anew(&mut self.p, &self.noise);
        for probe in &mut self.probes {
            begin_anew(&mut probe.p, &probe.noise);
            probe.aside = [0.0, 0.0, probe.aside[2], 0.0];
        }
        self.forks.clear();
        self.next_fork_s = sighting.exposed_s + SETTLE_S;
        for twin in &mut self.twins {
            let sensitivity = match &twin.source {
                // Whatever is believed of tracker and latency, it was seen here.
                Source::Law(law, inverse_step, _) => {
                    let later_s = law.latency_s - self.law.latency_s;
                    let seen = law.view.seen_m(z) - seen_m;
                    (later_s * v - seen / factor) * inverse_step
                }
                Source::Hat(_) | Source::Wave(..) | Source::Steady | Source::Play(_) | Source::Seen(_) => 0.0,
            };
            twin.sensitivity = [sensitivity, 0.0, twin.sensitivity[2], 0.0];
        }
        if let Some((_, since)) = &mut self.knots {
            // Nothing that comes later tells of what was before.
            *since = [[0.0; 4]; 4];
        }
    }

    fn look_around(&mut self, h: f64, throttle: f64) {
        let around = &mut self.around;
        around.ratio = (self.ratio_per_unit * (throttle - self.offset)).max(0.0);
        around.lagged_ratio += (around.ratio - around.lagged_ratio) * settled(h / CHANGE_TIME_S);
        around.elapsed_s += h;
        around.charge_min += around.ratio * h / 60.0;
        around.lagged_altitude_m += (self.x[0] - around.lagged_altitude_m) * settled(h / PAST_TIME_S);
    }

    /// The quantities of [`Axis::ALL`].
    fn axes(&self) -> [f64; AXES] {
        let around = &self.around;
        let change = around.ratio - around.lagged_ratio;
        [
            self.x[0],
            self.x[1],
            around.ratio,
            change,
            around.elapsed_s,
            around.charge_min,
            around.voltage,
            around.lagged_altitude_m,
        ]
    }

    /// Holds a sighting against its prediction and learns from it.
    fn see(&mut self, sighting: &Sighting, timing_s: f64) {
        let [z, v, ..] = self.x;
        let (factor, predicted) = (self.law.view.slope(z), self.law.view.seen_m(z));
        let residual = sighting.z_m - predicted;
        let (last_s, last_m) = self.last_seen.unwrap_or((f64::MIN, f64::NAN));
        let seen = Sight {
            factor,
            speed_m_s: v,
            timing_s,
            repeats: last_m == sighting.z_m,
            flies: last_m > NEAR_GROUND_M,
            from_last_m: last_m - predicted,
            step_m: self.step_m,
            frame_s: self.frame_s,
            since_s: sighting.exposed_s - last_s,
        };
        for (twin, out) in self.twins.iter().zip(&mut self.row) {
            let shift = match &twin.source {
                Source::Law(law, inverse_step, _) => {
                    let later_s = law.latency_s - self.law.latency_s;
                    (law.view.seen_m(z) - predicted - later_s * v * factor) * inverse_step
                }
                Source::Hat(_) | Source::Wave(..) | Source::Steady | Source::Play(_) => 0.0,
                Source::Seen(Seen::Altitude(hat)) => hat.at(z),
                Source::Seen(Seen::Thrust) => self.around.ratio - 1.0,
                Source::Seen(Seen::Time) => self.around.elapsed_s,
                Source::Seen(Seen::Latency) => -v * factor * self.around.elapsed_s,
            };
            *out = factor * twin.sensitivity[0] + shift;
        }
        self.last_seen = Some((sighting.exposed_s, sighting.z_m));
        let scored = seen.score(&self.p, &self.noise, residual, self.stale);
        self.stale = scored.stale;
        self.counting = sighting.counts;
        if sighting.counts {
            self.tally(&scored);
            let axes = self.axes();
            self.pass.innovations.push(Innovation {
                exposed_s: sighting.exposed_s,
                residual_m: residual,
                variance_m2: scored.variance,
                nll: scored.nll,
                axes,
            });
        }
        for (probe, sum) in self.probes.iter_mut().zip(&mut self.pass.noise_nll) {
            let own = seen.score(&probe.p, &probe.noise, residual - factor * probe.aside[0], probe.stale);
            probe.stale = own.stale;
            if sighting.counts {
                *sum += own.nll;
            }
            let k = learn(&mut probe.p, factor, &own);
            // Against the base, which moves by its own gain below.
            for (x, k) in probe.aside.iter_mut().zip(k) {
                *x += k * own.residual;
            }
        }
        self.predict(sighting, residual, factor);
        let predicted = (self.x, self.p);
        let k = learn(&mut self.p, factor, &scored);
        self.moved(k, scored.residual);
        if sighting.counts && sighting.exposed_s >= self.next_fork_s {
            self.forks.push(Fork { begin_s: sighting.exposed_s, aside: [0.0; 4], passed: 0 });
            self.next_fork_s = sighting.exposed_s + FORK_EVERY_S;
        }
        if let Some((knots, since)) = &mut self.knots {
            knots.push(Knot {
                time_s: self.around.elapsed_s,
                seen_m: sighting.z_m,
                ratio: self.around.ratio,
                below_ceiling_m: self.ceiling_m - z,
                predicted,
                filtered: (self.x, self.p),
                transition: std::mem::replace(since, IDENTITY),
            });
        }
    }
}

impl Filter {
    /// Adds an innovation, whose slopes are in `row`, to likelihood, gradient and information.
    fn tally(&mut self, scored: &Scored) {
        self.pass.nll += scored.nll;
        let mut first = 0;
        for (i, slope) in self.row.iter().enumerate() {
            let weighted = scored.weight * slope / scored.variance;
            self.pass.gradient[i] += weighted * scored.residual;
            for (sum, other) in self.lower[first..=first + i].iter_mut().zip(&self.row) {
                *sum += weighted * other;
            }
            first += i + 1;
        }
    }

    /// Moves the state by a gain times a residual; all that is told against the state moves the other way.
    fn moved(&mut self, k: State, residual: f64) {
        for (x, k) in self.x.iter_mut().zip(k) {
            *x += k * residual;
        }
        let asides = self.probes.iter_mut().map(|probe| &mut probe.aside);
        for aside in asides.chain(self.forks.iter_mut().map(|fork| &mut fork.aside)) {
            for (x, k) in aside.iter_mut().zip(k) {
                *x -= k * residual;
            }
        }
        for (twin, out) in self.twins.iter_mut().zip(&self.row) {
            for (sensitivity, k) in twin.sensitivity.iter_mut().zip(k) {
                *sensitivity -= k * out;
            }
        }
        self.x[0] = self.x[0].min(self.ceiling_m).max(0.0);
    }

    /// Holds what was felt on board against its prediction and learns from it, where a sighting would count.
    fn feel(&mut self, felt: &Felt) {
        if self.standing || self.carried || !self.counting {
            return;
        }
        if let Some(velocity) = felt.velocity_m_s.filter(|_| self.noise.velocity_m_s > 0.0) {
            for (twin, out) in self.twins.iter().zip(&mut self.row) {
                *out = twin.sensitivity[1];
            }
            self.take(velocity - self.x[1], [0.0, 1.0, 0.0, 0.0], self.noise.velocity_m_s);
        }
        if let Some(acceleration) = felt.acceleration_m_s2.filter(|_| self.noise.acceleration_m_s2 > 0.0) {
            let [z, v, b, w] = self.x;
            let force = self.law.acceleration_m_s2(z, v);
            let (az, av) = self.slopes([z, v], force);
            let axes = self.axes();
            for (twin, out) in self.twins.iter().zip(&mut self.row) {
                let push = twin.source.push([z, v], force, &axes);
                let [dz, dv, db, dw] = twin.sensitivity;
                *out = push + az * dz + av * dv + db + dw;
            }
            self.take(acceleration - (force + b + w), [az, av, 1.0, 1.0], self.noise.acceleration_m_s2);
        }
    }

    /// Takes a measurement with slopes `h` by the state, and those by the directions in `row`.
    fn take(&mut self, residual: f64, h: State, sigma: f64) {
        let scored = Scored::bounded(residual, spread_of(&self.p, &h) + sigma * sigma);
        self.tally(&scored);
        for (probe, sum) in self.probes.iter_mut().zip(&mut self.pass.noise_nll) {
            let own = residual - h.iter().zip(&probe.aside).map(|(h, x)| h * x).sum::<f64>();
            let own = Scored::bounded(own, spread_of(&probe.p, &h) + sigma * sigma);
            *sum += own.nll;
            let k = learn_along(&mut probe.p, &h, &own);
            for (x, k) in probe.aside.iter_mut().zip(k) {
                *x += k * own.residual;
            }
        }
        let k = learn_along(&mut self.p, &h, &scored);
        self.moved(k, residual);
    }

    /// Slopes of the law's acceleration by altitude and speed where it is `force`.
    fn slopes(&self, [z, v]: [f64; 2], force: f64) -> (f64, f64) {
        let at = |z: f64, v: f64| self.law.acceleration_m_s2(z, v);
        ((at(z + DZ, v) - at(z - DZ, v)) / (2.0 * DZ), (at(z, v + DV) - force) / DV)
    }

    /// Holds a sighting against the predictions under way.
    fn predict(&mut self, sighting: &Sighting, residual: f64, factor: f64) {
        for fork in &mut self.forks {
            let ahead_s = sighting.exposed_s - fork.begin_s;
            while fork.passed < HORIZONS_S.len() && ahead_s >= HORIZONS_S[fork.passed] {
                if sighting.counts && ahead_s < HORIZONS_S[fork.passed] + HORIZON_SLACK_S {
                    let error = residual - factor * fork.aside[0];
                    let (sum, n) = &mut self.pass.predictions[fork.passed];
                    *sum += error * error;
                    *n += 1;
                }
                fork.passed += 1;
            }
        }
        self.forks.retain(|fork| fork.passed < HORIZONS_S.len());
    }
}

/// How the state moves over a step, linearised: trim and turbulence push alike, and the turbulence forgets.
struct Transition {
    z: [f64; 3],
    v: [f64; 3],
    kept: f64,
}

impl Transition {
    #[inline]
    fn apply(&self, [z, v, b, w]: State) -> State {
        let row = |f: &[f64; 3]| f[0] * z + f[1] * v + f[2] * (b + w);
        [row(&self.z), row(&self.v), b, w * self.kept]
    }
}

/// Moves a covariance over a step.
#[inline]
fn spread(p: &mut Covariance, f: &Transition, h: f64, near_ground: bool, noise: &Noise) {
    let row =
        |f: &[f64; 3]| [0, 1, 2, 3].map(|j| f[0] * p[0][j] + f[1] * p[1][j] + f[2] * (p[2][j] + p[3][j]));
    let (fz, fv) = (row(&f.z), row(&f.v));
    let kink = if near_ground { noise.near_ground } else { 0.0 };
    let q = noise.acceleration.powi(2) + kink.powi(2);
    let dot = |a: &[f64; 4], b: &[f64; 3]| a[0] * b[0] + a[1] * b[1] + (a[2] + a[3]) * b[2];
    let p00 = dot(&fz, &f.z) + q * h * h * h / 3.0;
    let p01 = dot(&fz, &f.v) + q * h * h / 2.0;
    let p11 = dot(&fv, &f.v) + q * h;
    let (p02, p12) = (fz[2], fv[2]);
    let (p03, p13, p23) = (fz[3] * f.kept, fv[3] * f.kept, p[2][3] * f.kept);
    let p22 = p[2][2] + noise.trim_walk.powi(2) * h;
    let p33 = p[3][3] * f.kept * f.kept + noise.turbulence.powi(2) * (1.0 - f.kept * f.kept);
    *p = [[p00, p01, p02, p03], [p01, p11, p12, p13], [p02, p12, p22, p23], [p03, p13, p23, p33]];
}

/// Seen so many sigma above a ceiling, twice in a row, an airframe was not stopped by it.
const ABOVE_SIGMAS: f64 = 3.0;
/// Spread of the vertical speed of an airframe that was carried, m/s.
const CARRIED_M_S: f64 = 0.7;
/// Its speed is taken from sightings so close, s.
const SPEED_WITHIN_S: f64 = 0.3;

/// How much of its way to a held target a first-order lag goes in a step, of `x` time constants: to a thousandth where `x` is a tenth,
/// without an exponential in every step.
#[inline]
fn settled(x: f64) -> f64 {
    x / (1.0 + 0.5 * x)
}

/// What is known of an airframe that is where it was seen.
fn begin_anew(p: &mut Covariance, noise: &Noise) {
    let trim = p[2][2];
    *p = [[0.0; 4]; 4];
    p[0][0] = noise.sighting_m.powi(2);
    p[1][1] = CARRIED_M_S.powi(2);
    p[2][2] = trim;
    p[3][3] = noise.turbulence.powi(2);
}

/// Where a law's ceiling stops the airframe, m: not where it was seen above.
fn stopping_m(law: &Law, track: &Track, noise: &Noise) -> f64 {
    let above_m = law.view.seen_m(law.ceiling_m) + ABOVE_SIGMAS * noise.sighting_m;
    if law.ceiling_m.is_finite() && track.highest_m() > above_m { f64::INFINITY } else { law.ceiling_m }
}

/// What touching ground or ceiling leaves of a covariance.
fn stopped(p: &mut Covariance) {
    p[0] = [1e-6, 0.0, 0.0, 0.0];
    p[1] = [0.0, 1e-3, 0.0, 0.0];
    for row in &mut p[2..] {
        row[0] = 0.0;
        row[1] = 0.0;
    }
}

/// Variance of a measurement with slopes `h` by the state.
fn spread_of(p: &Covariance, h: &State) -> f64 {
    let along = |row: &State| row.iter().zip(h).map(|(p, h)| p * h).sum::<f64>();
    p.iter().zip(h).map(|(row, h)| h * along(row)).sum()
}

/// Takes a measurement with slopes `h` by the state into a covariance; the gain.
fn learn_along(p: &mut Covariance, h: &State, scored: &Scored) -> State {
    let ph = p.map(|row| row.iter().zip(h).map(|(p, h)| p * h).sum::<f64>());
    let k = ph.map(|ph| ph / scored.variance * scored.weight);
    for (row, k) in p.iter_mut().zip(k) {
        for (p, ph) in row.iter_mut().zip(ph) {
            *p -= k * ph;
        }
    }
    k
}

/// Takes a sighting into a covariance; the gain.
#[inline]
fn learn(p: &mut Covariance, factor: f64, scored: &Scored) -> State {
    let k = [0, 1, 2, 3].map(|i| p[i][0] * factor / scored.variance * scored.weight);
    let top = p[0];
    for (row, k) in p.iter_mut().zip(k) {
        for (p, top) in row.iter_mut().zip(top) {
            *p -= k * factor * top;
        }
    }
    k
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use bench_plant::effects::index_of;

    use super::*;

    #[test]
    fn a_ceiling_does_not_stop_what_was_seen_above_it() {
        let rig = Rig::load(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs/virtual.toml")).unwrap();
        let mut point = Point::nominal(&rig).0;
        let noise = Noise::nominal(&rig);
        let seen = |altitudes: &[f64]| {
            let sighting = |z_m: &f64| Sighting {
                exposed_s: 0.0,
                believed_s: 0.0,
                z_m: *z_m,
                counts: true,
                carried: false,
            };
            Track { sightings: altitudes.iter().map(sighting).collect(), ..Track::default() }
        };
        let below = seen(&[0.3, 0.705, 0.705, 0.5]);
        assert_eq!(stopping_m(&Law::new(&point, &rig), &below, &noise), f64::INFINITY);
        point.effects = vec![(index_of("ceiling-effect").unwrap(), vec![0.1, 0.7, 0.05, 1.0])];
        let law = Law::new(&point, &rig);
        assert_eq!(stopping_m(&law, &below, &noise), 0.7, "half a centimetre above is within three sigma");
        assert_eq!(stopping_m(&law, &seen(&[0.5, 0.9, 0.5]), &noise), 0.7, "one sighting may be of anything");
        assert_eq!(stopping_m(&law, &seen(&[0.5, 0.9, 0.9, 0.5]), &noise), f64::INFINITY);
    }
}
