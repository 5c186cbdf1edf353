//! A model held against open-loop flights (paper, section 3.5, figure 11): nothing is fitted.

use bench_filter::RigNumber;
use bench_filter::{HORIZONS_S, Hold, LIFT_OFF_M, Law, Measurement, NEAR_GROUND_M, Noise, Point, Track};
use bench_inference::{Consistency, Problem};
use bench_rig::Rig;
use bench_statistics::Sorted;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use rayon::prelude::*;
use serde::Serialize;

use crate::{error::IdentifyError, plausible::plausible_altitude};

/// A flight and until when its throttle was not closed over the altitude, s of its track; `None`: all of it.
#[derive(Clone, Debug)]
pub struct OpenLoop {
    /// The flight.
    pub track: Track,
    /// When a loop took over.
    pub until_s: Option<f64>,
}

/// What a model must achieve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// Greatest RMS error of altitude predicted one second ahead, m.
    pub ahead_m: f64,
    /// Greatest RMS distance between a flight and the trajectory predicted from its throttle alone, m, if asked for.
    pub trajectory_m: Option<f64>,
    /// Least share of measurements within the band of 95 %.
    pub inside: f64,
    /// Greatest mean of squared errors over expected ones, of predictions from measurement to measurement; 1 for a right model.
    pub consistency: f64,
    /// Greatest mean width of the band of 95 %, m; `None`: [`RANGES`] of what each flight spans in altitude.
    pub band_m: Option<f64>,
}

impl Default for Tolerance {
    fn default() -> Self {
        Self { ahead_m: 0.02, trajectory_m: None, inside: 0.8, consistency: 2.0, band_m: None }
    }
}

/// A band as wide as all that a flight spans in altitude holds both that it never left the ground and that it went twice as high: it
/// tells nothing.
pub const RANGES: f64 = 1.0;

/// What a verification comes to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum VerifyVerdict {
    /// All checks were met.
    Passed,
    /// A flight is none that the model predicts.
    Failed,
    /// The flights are within a band that nearly any flight would be within.
    NotInformative,
}

/// How a model predicts flights. As JSON it is `bench.verification/1` (docs/model-development.md).
#[derive(Clone, Debug, Serialize)]
pub struct Verification {
    /// `bench.verification/1`.
    pub schema: &'static str,
    /// What it comes to.
    pub verdict: VerifyVerdict,
    /// Whether all checks passed.
    pub passed: bool,
    /// Each check.
    pub checks: Vec<VerifyCheck>,
    /// What makes the bands as wide as they are, largest share first.
    pub widened_by: Vec<Share>,
    /// What would narrow them, in words, most first; empty where they are narrow enough.
    pub narrowed_by: Vec<String>,
    /// Flight by flight.
    pub flights: Vec<FlightVerified>,
    /// What could not be used.
    pub warnings: Vec<String>,
}

/// One limit and what was reached.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct VerifyCheck {
    /// What is checked, with its unit.
    pub name: &'static str,
    /// The worst flight, where it is of single flights.
    pub flight: Option<String>,
    /// What was reached.
    pub value: f64,
    /// The limit.
    pub limit: f64,
    /// Whether the value must not be below the limit, rather than not above.
    pub at_least: bool,
    /// Whether it was met.
    pub passed: bool,
}

/// A share of the variance of trajectories from the throttle alone.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Share {
    /// The number of the rig whose tolerance it is, or [`DISTURBANCE`].
    pub name: &'static str,
    /// 0 to 1.
    pub share: f64,
}

/// The share of what acts besides the model: trim, turbulence, lift-off, the tracker's noise.
pub const DISTURBANCE: &str = "disturbance";
/// A tolerance of which less than this share comes is not worth narrowing.
const WORTH_NARROWING: f64 = 0.1;

/// One flight against the model.
#[derive(Clone, Debug, Serialize)]
pub struct FlightVerified {
    /// Its name.
    pub name: String,
    /// RMS errors of altitude predicted 0.5, 1 and 2 s ahead from what was seen before, m; `null` where it is too short.
    pub k_step_m: [Option<f64>; 3],
    /// How often each was predicted.
    pub k_step_count: [u32; 3],
    /// Whether errors of predictions are as large as the model says, and white.
    pub consistency: Consistency,
    /// RMS distance from the trajectory predicted from the throttle alone, m.
    pub trajectory_rms_m: f64,
    /// Share of measurements within the band of 95 %.
    pub inside: f64,
    /// Mean width of that band, m.
    pub band_m: f64,
    /// What the flight spans in altitude, m.
    pub range_m: f64,
    /// Highest altitude: seen, predicted, and the ends of 95 % of predictions, m.
    pub peak_m: [f64; 4],
    /// The trajectories.
    pub trajectory: Trajectory,
}

/// What was seen and what the throttle alone predicts, at each measurement.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Trajectory {
    /// From the first throttle that turns the rotors, s.
    pub time_s: Vec<f64>,
    /// As seen, m.
    pub seen_m: Vec<f64>,
    /// The rig's numbers, calm air, m.
    pub nominal_m: Vec<f64>,
    /// Ends of 95 % of trajectories within the tolerances in ordinary air, as the tracker would see them, m.
    pub band_95_m: Vec<[f64; 2]>,
    /// The same of 50 %.
    pub band_50_m: Vec<[f64; 2]>,
}

/// Trajectories that a band is made of.
const DRAWS: u64 = 400;
/// The same with the rig's numbers as they are, to see what the disturbances alone do.
const CALM_DRAWS: u64 = 100;
/// Longest step, s.
const STEP_S: f64 = 0.005;
/// Never seen higher, it has not flown, m.
const AIRBORNE_M: f64 = 0.03;
/// Fewest measurements of an open loop.
const LEAST_MEASUREMENTS: usize = 20;

/// Holds a model against flights.
pub fn verify(flights: &[OpenLoop], rig: &Rig, tolerance: &Tolerance) -> Result<Verification, IdentifyError> {
    let tracks: Vec<Track> = flights.iter().map(|flight| flight.track.clone()).collect();
    let problem = Problem::new(&tracks, rig);
    let predictions = problem.predict(&problem.nominal, &problem.noise);
    let mut verified = Vec::new();
    let mut variances = [0.0; 9];
    for (flight, predicted) in flights.iter().zip(&predictions) {
        let refused =
            |reason: String| IdentifyError::NotVerifiable { flight: flight.track.name.clone(), reason };
        let highest = flight.track.measurements.iter().map(|s| s.z_m).fold(f64::MIN, f64::max);
        if highest < AIRBORNE_M {
            return Err(IdentifyError::NeverAirborne {
                flight: flight.track.name.clone(),
                height_m: AIRBORNE_M,
            });
        }
        plausible_altitude(&flight.track, rig)?;
        let seen = open_measurements(flight);
        if seen.len() < LEAST_MEASUREMENTS {
            return Err(refused(format!(
                "only {} measurements before a closed loop took over or it came down; {LEAST_MEASUREMENTS} are needed: fly a mission of `open` phases, such as hop",
                seen.len()
            )));
        }
        let (trajectory, peaks) = trajectories(&flight.track, &seen, &problem);
        let n = seen.len() as f64;
        let squares: f64 =
            seen.iter().zip(&trajectory.nominal_m).map(|(seen, z)| (seen.z_m - z).powi(2)).sum();
        let inside = seen
            .iter()
            .zip(&trajectory.band_95_m)
            .filter(|(seen, [low, high])| (*low..=*high).contains(&seen.z_m))
            .count();
        let peak = |values: &[f64]| values.iter().copied().fold(f64::MIN, f64::max);
        let lowest = trajectory.seen_m.iter().copied().fold(f64::MAX, f64::min);
        for (sum, variance) in variances.iter_mut().zip(variances_of(&flight.track, &seen, &problem)) {
            *sum += variance;
        }
        verified.push(FlightVerified {
            name: flight.track.name.clone(),
            k_step_m: predicted.k_step.map(|(sum, n)| (n > 0).then(|| (sum / f64::from(n)).sqrt())),
            k_step_count: predicted.k_step.map(|(_, n)| n),
            consistency: Consistency::of(&predicted.innovations),
            trajectory_rms_m: (squares / n).sqrt(),
            inside: inside as f64 / n,
            band_m: trajectory.band_95_m.iter().map(|[low, high]| high - low).sum::<f64>() / n,
            range_m: peak(&trajectory.seen_m) - lowest,
            peak_m: [peak(&trajectory.seen_m), peak(&trajectory.nominal_m), peaks[0], peaks[1]],
            trajectory,
        });
    }
    let checks = checks(&verified, tolerance)?;
    let band = band_check(&verified, tolerance);
    let verdict = match (checks.iter().all(|check| check.passed), band.passed) {
        (true, true) => VerifyVerdict::Passed,
        (true, false) => VerifyVerdict::NotInformative,
        (false, _) => VerifyVerdict::Failed,
    };
    let widened_by = shares(&variances, rig);
    Ok(Verification {
        schema: "bench.verification/1",
        verdict,
        passed: verdict == VerifyVerdict::Passed,
        narrowed_by: if band.passed { Vec::new() } else { narrowed_by(&widened_by) },
        widened_by,
        checks: [checks, vec![band]].concat(),
        flights: verified,
        warnings: Vec::new(),
    })
}

fn checks(flights: &[FlightVerified], tolerance: &Tolerance) -> Result<Vec<VerifyCheck>, IdentifyError> {
    let worst = |of: &dyn Fn(&FlightVerified) -> Option<f64>| {
        flights
            .iter()
            .filter_map(|flight| Some((of(flight)?, flight.name.clone())))
            .max_by(|a, b| a.0.total_cmp(&b.0))
    };
    let Some((ahead, flight)) = worst(&|flight| flight.k_step_m[1]) else {
        return Err(IdentifyError::NotVerifiable {
            flight: flights.first().map_or_else(String::new, |flight| flight.name.clone()),
            reason: format!(
                "too short for a prediction {} s ahead: nothing of 2.5 s in the air",
                HORIZONS_S[1]
            ),
        });
    };
    let mut checks = vec![VerifyCheck {
        name: "RMS error predicted 1 s ahead, m",
        flight: Some(flight),
        value: ahead,
        limit: tolerance.ahead_m,
        at_least: false,
        passed: ahead <= tolerance.ahead_m,
    }];
    if let (Some(limit), Some((value, flight))) =
        (tolerance.trajectory_m, worst(&|flight| Some(flight.trajectory_rms_m)))
    {
        checks.push(VerifyCheck {
            name: "RMS distance from the trajectory, m",
            flight: Some(flight),
            value,
            limit,
            at_least: false,
            passed: value <= limit,
        });
    }
    if let Some((value, flight)) = worst(&|flight| Some(flight.consistency.mean_nis)) {
        checks.push(VerifyCheck {
            name: "squared errors over expected, measurement to measurement",
            flight: Some(flight),
            value,
            limit: tolerance.consistency,
            at_least: false,
            passed: value <= tolerance.consistency,
        });
    }
    let measurements: usize = flights.iter().map(|flight| flight.trajectory.seen_m.len()).sum();
    let inside: f64 =
        flights.iter().map(|flight| flight.inside * flight.trajectory.seen_m.len() as f64).sum();
    let inside = inside / measurements.max(1) as f64;
    checks.push(VerifyCheck {
        name: "share of measurements in the band of 95 %",
        flight: None,
        value: inside,
        limit: tolerance.inside,
        at_least: true,
        passed: inside >= tolerance.inside,
    });
    Ok(checks)
}

/// Whether the bands are narrow enough for a flight within them to tell anything.
fn band_check(flights: &[FlightVerified], tolerance: &Tolerance) -> VerifyCheck {
    let limit = |flight: &FlightVerified| tolerance.band_m.unwrap_or(RANGES * flight.range_m);
    let worst = flights.iter().max_by(|a, b| (a.band_m / limit(a)).total_cmp(&(b.band_m / limit(b))));
    let (flight, value, limit) =
        worst.map_or((None, 0.0, 0.0), |flight| (Some(flight.name.clone()), flight.band_m, limit(flight)));
    VerifyCheck {
        name: "mean width of the band of 95 %, m",
        flight,
        value,
        limit,
        at_least: false,
        passed: value <= limit,
    }
}

/// What of the variance over a flight comes from each of the rig's numbers, in their order, and last from all else, m^2: to first
/// order, and of trajectories with the rig's own numbers.
fn variances_of(track: &Track, seen: &[Measurement], problem: &Problem<'_>) -> [f64; 9] {
    let mut out = [0.0; 9];
    for (number, sigma) in problem.uncertain() {
        let moved = |way: f64| {
            let mut point = problem.nominal.clone();
            point.nuisances[number] += way * sigma;
            fly(track, seen, problem, &point, None)
        };
        let variance = moved(1.0).iter().zip(moved(-1.0)).map(|(a, b)| (0.5 * (a - b)).powi(2)).sum::<f64>();
        out[number as usize] = variance;
    }
    let drawn: Vec<Vec<f64>> = (0..CALM_DRAWS)
        .into_par_iter()
        .map(|draw| {
            let mut rng = ChaCha8Rng::seed_from_u64(DRAWS + draw);
            fly(track, seen, problem, &problem.nominal, Some(&mut rng))
        })
        .collect();
    let n = drawn.len() as f64;
    out[8] = (0..seen.len())
        .map(|k| {
            let mean = drawn.iter().map(|z| z[k]).sum::<f64>() / n;
            drawn.iter().map(|z| (z[k] - mean).powi(2)).sum::<f64>() / n
        })
        .sum();
    out
}

fn shares(variances: &[f64; 9], rig: &Rig) -> Vec<Share> {
    let total: f64 = variances.iter().sum();
    let names = Point::names(rig).0.into_iter().chain([DISTURBANCE]);
    let mut shares: Vec<Share> = names
        .zip(variances)
        .filter(|(_, variance)| **variance > 0.0)
        .map(|(name, variance)| Share { name, share: variance / total })
        .collect();
    shares.sort_by(|a, b| b.share.total_cmp(&a.share));
    shares
}

fn narrowed_by(widened_by: &[Share]) -> Vec<String> {
    let mut out: Vec<String> = Vec::new();
    for share in widened_by.iter().filter(|share| share.share >= WORTH_NARROWING) {
        let how = match share.name {
            "mass_kg" => "a finer balance for the mass",
            "thrust_gain" | "thrust_offset" => {
                "`bench identify thrust` from readings of a balance, then `bench identify flight`, which tells the throttle that hovers"
            }
            "ground_effect_multiplier" | "ground_effect_height_m" => "`bench identify ground-effect`",
            DISTURBANCE => {
                "`bench identify flight`, which measures what acts besides the model, and shorter hops"
            }
            _ => "`bench identify flight`",
        };
        if !out.iter().any(|known| known == how) {
            out.push(how.to_owned());
        }
    }
    out
}

/// The measurements from the first throttle on, until a loop takes over or the airframe comes down.
fn open_measurements(flight: &OpenLoop) -> Vec<Measurement> {
    let until_s = flight.until_s.unwrap_or(f64::INFINITY);
    flight
        .track
        .measurements
        .iter()
        .filter(|s| s.exposed_s >= flight.track.begin_s)
        .take_while(|s| s.counts && s.exposed_s <= until_s)
        .copied()
        .collect()
}

/// The nominal trajectory, the bands, and the ends of 95 % of peaks.
fn trajectories(track: &Track, seen: &[Measurement], problem: &Problem<'_>) -> (Trajectory, [f64; 2]) {
    let calm = fly(track, seen, problem, &problem.nominal, None);
    let drawn: Vec<Vec<f64>> = (0..DRAWS)
        .into_par_iter()
        .map(|draw| {
            let mut rng = ChaCha8Rng::seed_from_u64(draw);
            let point = drawn_point(problem, &mut rng);
            fly(track, seen, problem, &point, Some(&mut rng))
        })
        .collect();
    let mut out = Trajectory { nominal_m: calm, ..Trajectory::default() };
    for (i, measurement) in seen.iter().enumerate() {
        let at = Sorted::of(drawn.iter().map(|z| z[i]));
        let band = |low, high| [low, high].map(|share| at.interpolated(share).unwrap_or(f64::NAN));
        out.time_s.push(measurement.exposed_s - track.begin_s);
        out.seen_m.push(measurement.z_m);
        out.band_95_m.push(band(0.025, 0.975));
        out.band_50_m.push(band(0.25, 0.75));
    }
    let peaks = Sorted::of(drawn.iter().map(|z| z.iter().copied().fold(f64::MIN, f64::max)));
    (out, [0.025, 0.975].map(|share| peaks.interpolated(share).unwrap_or(f64::NAN)))
}

/// Numbers within the rig's tolerances.
fn drawn_point(problem: &Problem<'_>, rng: &mut ChaCha8Rng) -> Point {
    let mut point = problem.nominal.clone();
    for (value, sigma) in point.nuisances.0.iter_mut().zip(problem.sigma.0) {
        let normal: f64 = rng.sample(StandardNormal);
        *value += sigma * normal;
    }
    let (n, nominal) = (&mut point.nuisances, &problem.nominal.nuisances);
    // As far as a number makes sense.
    n[RigNumber::Mass] = n[RigNumber::Mass].max(0.1 * nominal[RigNumber::Mass]);
    n[RigNumber::ThrustGain] = n[RigNumber::ThrustGain].max(0.1 * nominal[RigNumber::ThrustGain]);
    n[RigNumber::GroundEffectMultiplier] = n[RigNumber::GroundEffectMultiplier].max(1.0);
    n[RigNumber::GroundEffectHeight] = n[RigNumber::GroundEffectHeight].max(1e-3);
    n[RigNumber::Drag] = n[RigNumber::Drag].max(0.0);
    n[RigNumber::Latency] = n[RigNumber::Latency].max(0.0);
    debug_assert!(n[RigNumber::Origin].is_finite());
    point
}

/// What acts on one trajectory besides the model.
struct Air<'a> {
    noise: Noise,
    rng: &'a mut ChaCha8Rng,
    trim: f64,
    turbulence: f64,
    left: bool,
}

impl<'a> Air<'a> {
    fn new(noise: Noise, rng: &'a mut ChaCha8Rng) -> Self {
        let mut out = Self { noise, rng, trim: 0.0, turbulence: 0.0, left: false };
        out.trim = noise.trim * out.normal();
        out.turbulence = noise.turbulence * out.normal();
        out
    }

    fn normal(&mut self) -> f64 {
        self.rng.sample(StandardNormal)
    }

    /// Acceleration over the next step, m/s^2.
    fn advance(&mut self, h: f64, z_m: f64) -> f64 {
        let noise = self.noise;
        let kept = if noise.turbulence_time_s > 0.0 { (-h / noise.turbulence_time_s).exp() } else { 0.0 };
        self.trim += noise.trim_walk * h.sqrt() * self.normal();
        self.turbulence =
            kept * self.turbulence + noise.turbulence * (1.0 - kept * kept).sqrt() * self.normal();
        let near = if z_m < NEAR_GROUND_M { noise.near_ground } else { 0.0 };
        self.trim + self.turbulence + noise.acceleration.hypot(near) / h.sqrt() * self.normal()
    }
}

/// Altitudes at the measurements that the throttle alone gives, m: of calm air and a perfect tracker, or with what disturbs.
fn fly(
    track: &Track,
    seen: &[Measurement],
    problem: &Problem<'_>,
    point: &Point,
    rng: Option<&mut ChaCha8Rng>,
) -> Vec<f64> {
    let mut law = Law::new(point, problem.rig);
    let mut air = rng.map(|rng| Air::new(problem.noise, rng));
    let late = law.view.latency_s - problem.rig.tracker.latency_s.value;
    let view = law.view;
    let (mut z, mut v) = (0.0_f64, 0.0_f64);
    let mut now = track.begin_s;
    let mut input = track.inputs.partition_point(|input| input.time_s <= now).max(1) - 1;
    let mut out = Vec::with_capacity(seen.len());
    for measurement in seen {
        let at = measurement.exposed_s - late;
        while now < at {
            let edge = track.inputs.get(input + 1).map_or(f64::INFINITY, |next| next.time_s);
            let until = at.min(edge);
            let steps = ((until - now) / STEP_S).ceil().max(1.0);
            let h = (until - now) / steps;
            if h > 0.0 {
                for _ in 0..steps as usize {
                    (z, v) = step(&mut law, h, track.inputs[input].throttle, (z, v), &mut air);
                }
            }
            now = until;
            if until == edge {
                input += 1;
            }
        }
        let blur = air.as_mut().map_or(0.0, |air| air.noise.measurement_m * air.normal());
        out.push(view.seen_m(z) + blur);
    }
    out
}

/// The midpoint rule over a step, and contact with ground and ceiling.
fn step(law: &mut Law, h: f64, throttle: f64, (z, v): (f64, f64), air: &mut Option<Air<'_>>) -> (f64, f64) {
    law.hold(&[Hold { h, throttle }]);
    law.advance(h, z, v);
    let push = air.as_mut().map_or(0.0, |air| air.advance(h, z));
    let first = law.acceleration_m_s2(z, v) + push;
    if z <= 0.0 && v <= 0.0 && first <= 0.0 {
        return (0.0, 0.0);
    }
    let (mut z, mut v) = (z, v);
    if let Some(air) = air.as_mut().filter(|air| !air.left) {
        // What legs and floor do as it leaves is in no model.
        air.left = true;
        z += (LIFT_OFF_M * air.normal()).max(0.0);
        v += air.noise.lift_off_m_s * air.normal();
    }
    let middle = law.acceleration_m_s2(z + 0.5 * h * v, v + 0.5 * h * first) + push;
    let (z1, v1) = (z + h * (v + 0.5 * h * first), v + h * middle);
    if z1 <= 0.0 {
        (0.0, v1.max(0.0))
    } else if z1 >= law.ceiling_m {
        (law.ceiling_m, v1.min(0.0))
    } else {
        (z1, v1)
    }
}
