//! Profiles between launch and landing, and the search among them.

use bench_recording::Flight;
use bench_rig::{Chirp, Mission, PhaseAction, PhasePlan, Profile, Rig};
use rand::{Rng, RngExt as _, SeedableRng, seq::IndexedRandom as _};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::arena::{Arena, Drop, Gain};

/// How high set-points go, as a share of what may be used: the loop overshoots.
const HIGHEST_SETPOINT: f64 = 0.8;
/// Rounds of local search, and neighbours flown in each.
const ROUNDS: usize = 8;
const NEIGHBOURS: usize = 6;

/// A candidate: what is flown between launch and landing.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Shape {
    /// Closed loop on altitudes.
    Hold {
        /// Altitudes one after another, m.
        levels_m: Vec<f64>,
        /// Each level's share of the time; any unit.
        shares: Vec<f64>,
        /// Straight lines from level to level instead of steps.
        ramps: bool,
        /// Amplitude, m, and frequencies.
        chirp: Option<Chirp>,
    },
    /// Open loop inside the ground effect.
    Hop {
        /// Thrust-to-weight ratios one after another, each for an equal time.
        ratios: Vec<f64>,
        /// Amplitude and frequencies.
        chirp: Option<Chirp>,
    },
}

const LAUNCH_THRUST_TO_WEIGHT: f64 = 1.12;
const LAUNCH_S: f64 = 0.8;
/// A hold shorter than this shows nothing, s.
const SHORTEST_HOLD_S: f64 = 4.0;
const LAND_DESCENT_M_S: f64 = 0.2;
const LAND_FROM_M: f64 = 0.3;
/// What a landing from there takes, with the settling, s.
pub(super) const LAND_S: f64 = 3.0;
/// Lowest set-point, m.
pub(super) const LOWEST_M: f64 = 0.03;
/// Knots of a profile.
const KNOTS: std::ops::RangeInclusive<usize> = 1..=10;
const RATIOS: std::ops::RangeInclusive<f64> = 0.85..=1.0;
const CHIRP_HZ: std::ops::RangeInclusive<f64> = 0.05..=1.5;

fn rounded(x: f64, step: f64) -> f64 {
    let per_unit = step.recip().round();
    (x * per_unit).round() / per_unit
}

impl Shape {
    fn steps(levels_m: &[f64]) -> Self {
        let shares = vec![1.0; levels_m.len()];
        Self::Hold { levels_m: levels_m.to_vec(), shares, ramps: false, chirp: None }
    }

    fn ramps(levels_m: &[f64]) -> Self {
        let shares = vec![1.0; levels_m.len()];
        Self::Hold { levels_m: levels_m.to_vec(), shares, ramps: true, chirp: None }
    }

    fn with(mut self, amplitude: f64, from_hz: f64, to_hz: f64) -> Self {
        let (Self::Hold { chirp, .. } | Self::Hop { chirp, .. }) = &mut self;
        *chirp = Some(Chirp { amplitude, from_hz, to_hz });
        self
    }

    pub(super) fn in_words(&self) -> String {
        let swept = |chirp: &Option<Chirp>, unit: &str| {
            chirp.map_or(String::new(), |c| {
                format!(", a sine of {}{unit} swept from {} to {} Hz on top", c.amplitude, c.from_hz, c.to_hz)
            })
        };
        let list = |values: &[f64]| values.iter().map(f64::to_string).collect::<Vec<_>>().join(", ");
        match self {
            Self::Hold { levels_m, ramps, chirp, .. } => {
                let how = match (levels_m.len(), ramps) {
                    (1, _) => "hold at",
                    (_, true) => "ramps between",
                    (_, false) => "steps between",
                };
                format!("{how} {} m{}", list(levels_m), swept(chirp, " m"))
            }
            Self::Hop { ratios, chirp } => {
                format!("hops at thrust-to-weight {}{}", list(ratios), swept(chirp, ""))
            }
        }
    }
}

/// What a search found.
pub(super) struct Found {
    pub(super) best: Option<(Shape, Gain)>,
    pub(super) tried: usize,
}

impl<F: Fn(&Rig, &Rig, &Mission) -> Option<Flight> + Sync> Arena<'_, F> {
    /// The best of a structured family, then of what lies around it. It draws from a fixed seed.
    pub(super) fn search(&self) -> Found {
        let score = |shapes: Vec<Shape>| -> Vec<(Shape, Gain)> {
            shapes
                .into_par_iter()
                .filter_map(|shape| Some((self.gain(&self.mission(&shape), Drop::Low)?, shape)))
                .map(|(gain, shape)| (shape, gain))
                .collect()
        };
        let family = self.family();
        let mut tried = family.len();
        let mut found = score(family);
        let sort = |found: &mut Vec<(Shape, Gain)>| {
            found.sort_by(|a, b| b.1.rank.total_cmp(&a.1.rank));
            found.truncate(3);
        };
        sort(&mut found);
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        for _ in 0..ROUNDS {
            let mut around: Vec<Shape> = Vec::new();
            for i in 0..NEIGHBOURS {
                // Mostly about the best.
                let Some((parent, _)) = found.get([0, 1, 0, 2][i % 4]).or(found.first()) else { break };
                around.push(self.neighbour(parent, &mut rng));
            }
            tried += around.len();
            found.extend(score(around));
            sort(&mut found);
        }
        Found { best: found.into_iter().next(), tried }
    }

    /// Profiles of all kinds: dwells low and high, steps, ramps, drops, swept sines, hops.
    fn family(&self) -> Vec<Shape> {
        let top = rounded(HIGHEST_SETPOINT * self.highest_m, 0.05);
        let at = |share: f64| self.level(share * top);
        let low = self.level(self.lowest_m);
        let ground = self.level(1.4 * self.problem.rig.airframe.ground_effect.height_m.value);
        let swings =
            |a: f64, b: f64, n: usize| (0..n).map(|i| if i % 2 == 0 { a } else { b }).collect::<Vec<_>>();
        let hop = |ratios: &[f64]| Shape::Hop { ratios: ratios.to_vec(), chirp: None };
        let mut family = vec![
            Shape::steps(&[at(0.25)]),
            Shape::steps(&[at(0.5)]),
            Shape::steps(&[at(1.0)]),
            Shape::steps(&[at(0.2), ground]),
            Shape::steps(&[at(0.2), low]),
            Shape::steps(&[at(0.2), ground, low, ground, low, ground]),
            Shape::steps(&[at(0.2), at(0.4), at(0.6), at(0.8), at(1.0), at(0.5)]),
            Shape::ramps(&[at(0.2), low, at(0.2), low, at(0.2)]),
        ];
        for n in [4, 6, 8] {
            family.push(Shape::steps(&swings(at(1.0), at(0.2), n)));
            family.push(Shape::ramps(&swings(at(1.0), at(0.2), n)));
            family.push(Shape::steps(&swings(at(0.6), at(0.3), n)));
        }
        for (share, amplitude, from_hz, to_hz) in
            [(0.4, 0.12, 0.1, 0.6), (0.5, 0.3, 0.05, 0.3), (0.3, 0.08, 0.3, 1.2), (0.12, 0.05, 0.1, 0.6)]
        {
            family.push(Shape::steps(&[at(share)]).with(amplitude, from_hz, to_hz));
        }
        for ratio in [0.9, 0.94, 0.98] {
            family.push(hop(&[ratio]));
        }
        family.push(hop(&[0.98, 0.92, 0.97, 0.9, 0.95, 0.88]));
        family.push(hop(&[0.95]).with(0.03, 0.2, 1.2));
        family
    }

    fn level(&self, z_m: f64) -> f64 {
        // A ceiling below the lowest level leaves no candidate inside the envelope.
        rounded(z_m.min(HIGHEST_SETPOINT * self.highest_m).max(self.lowest_m), 0.01)
    }

    /// A profile with one thing or two changed.
    fn neighbour(&self, shape: &Shape, rng: &mut impl Rng) -> Shape {
        let mut shape = shape.clone();
        for _ in 0..rng.random_range(1..=2) {
            match &mut shape {
                Shape::Hold { levels_m, shares, ramps, chirp } => match rng.random_range(0..8) {
                    0..=2 => {
                        let i = rng.random_range(0..levels_m.len());
                        levels_m[i] = self.any_level(rng);
                    }
                    3 => {
                        let i = rng.random_range(0..shares.len());
                        shares[i] = *[0.5, 1.0, 2.0].choose(rng).unwrap_or(&1.0);
                    }
                    4 if levels_m.len() < *KNOTS.end() => {
                        let i = rng.random_range(0..=levels_m.len());
                        levels_m.insert(i, self.any_level(rng));
                        shares.insert(i, 1.0);
                    }
                    5 if levels_m.len() > *KNOTS.start() => {
                        let i = rng.random_range(0..levels_m.len());
                        levels_m.remove(i);
                        shares.remove(i);
                    }
                    6 => *ramps = !*ramps,
                    _ => *chirp = some_chirp(rng, 0.3 * self.highest_m),
                },
                Shape::Hop { ratios, chirp } => match rng.random_range(0..5) {
                    0 if ratios.len() < *KNOTS.end() => ratios.push(rounded(rng.random_range(RATIOS), 0.01)),
                    1 if ratios.len() > 1 => _ = ratios.pop(),
                    2 => *chirp = some_chirp(rng, 0.06),
                    _ => {
                        let i = rng.random_range(0..ratios.len());
                        ratios[i] = rounded(rng.random_range(RATIOS), 0.01);
                    }
                },
            }
        }
        shape
    }

    /// Low and high are equally likely, on a scale of ratios.
    fn any_level(&self, rng: &mut impl Rng) -> f64 {
        let ends = [self.lowest_m.ln(), (HIGHEST_SETPOINT * self.highest_m).max(1.01 * self.lowest_m).ln()];
        self.level(rng.random_range(ends[0]..ends[1]).exp())
    }

    /// The mission of a profile.
    pub(super) fn mission(&self, shape: &Shape) -> Mission {
        let phase = |action: PhaseAction, duration_s: f64| PhasePlan { action, duration_s };
        let constant = Profile::constant;
        let mut phases = vec![phase(PhaseAction::Idle, 1.0)];
        match shape {
            Shape::Hold { levels_m, shares, ramps, chirp } => {
                // From high up, the landing takes as long as it takes.
                let top_m = levels_m.last().copied().unwrap_or(0.0) + chirp.map_or(0.0, |c| c.amplitude);
                let down_s = LAND_S + (top_m - LAND_FROM_M).max(0.0) / LAND_DESCENT_M_S;
                let land_s = down_s.ceil() + 2.0;
                let longest_s = self.problem.rig.safety.flight_time_max_s - land_s;
                let hold_s = (self.time_s.min(longest_s) - LAUNCH_S).max(SHORTEST_HOLD_S);
                let hold_s = (10.0 * hold_s).floor() / 10.0;
                let launch = PhaseAction::Launch { thrust_to_weight: constant(LAUNCH_THRUST_TO_WEIGHT) };
                phases.push(phase(launch, LAUNCH_S));
                let hold = PhaseAction::Hold {
                    altitude_m: profile(levels_m, shares, *ramps, hold_s),
                    x_m: constant(0.0),
                    y_m: constant(0.0),
                    heading_rad: constant(0.0),
                    chirp: *chirp,
                };
                phases.push(phase(hold, hold_s));
                let land = PhaseAction::Land { descent_m_s: LAND_DESCENT_M_S, cut_below_m: 0.06 };
                phases.push(phase(land, land_s));
            }
            Shape::Hop { ratios, chirp } => {
                let open_s = (10.0 * self.time_s).floor() / 10.0;
                let thrust_to_weight = profile(ratios, &vec![1.0; ratios.len()], false, open_s);
                phases.push(phase(PhaseAction::Open { thrust_to_weight, chirp: *chirp }, open_s));
            }
        }
        Mission { name: "candidate".to_owned(), phases, ..Mission::default() }
    }
}

/// Values one after another over a time, as steps or as straight lines.
fn profile(values: &[f64], shares: &[f64], ramps: bool, duration_s: f64) -> Profile {
    let total: f64 = shares.iter().sum();
    let mut points = Vec::with_capacity(2 * values.len());
    let mut from_s = 0.0;
    for (value, share) in values.iter().zip(shares) {
        let to_s = rounded(from_s + share / total * duration_s, 0.1);
        points.push([from_s, *value]);
        if !ramps {
            points.push([to_s, *value]);
        }
        from_s = to_s;
    }
    if values.len() == 1 {
        return Profile::constant(values[0]);
    }
    if !ramps {
        points.pop();
    }
    Profile::from_points(points).unwrap_or_default()
}

fn some_chirp(rng: &mut impl Rng, most: f64) -> Option<Chirp> {
    if rng.random_range(0..4) == 0 {
        return None;
    }
    let mut hz = || rounded(rng.random_range(CHIRP_HZ.start().ln()..CHIRP_HZ.end().ln()).exp(), 0.05);
    let (from_hz, to_hz) = (hz(), hz());
    Some(Chirp { amplitude: rounded(rng.random_range(0.1..1.0) * most, 0.01).max(0.01), from_hz, to_hz })
}
