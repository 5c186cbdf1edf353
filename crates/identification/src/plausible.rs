//! What is refused: flights and rigs of which no number could be believed.

use bench_filter::RigNumber;
use bench_filter::{Noise, Point, Track};
use bench_inference::{Fit, Problem};
use bench_rig::{GRAVITY_M_S2, Rig};

use crate::error::{Contradiction, IdentifyError};

/// Fewest flights that show how flights differ.
const LEAST_FLIGHTS: usize = 3;
/// Seen above this, it flies, m.
const AIRBORNE_M: f64 = 0.03;
/// So many times the rig's ceiling is no altitude.
const ABSURD_CEILINGS: f64 = 50.0;
/// Mean thrust over weight of a flight that is neither falling nor shot up lies between these.
const RATIOS: (f64, f64) = (0.4, 2.5);
/// Least variation of the throttle, % of the range from offset to hover.
const LEAST_VARIATION_PERCENT: f64 = 0.15;
/// The stretches that tell which way thrust goes lie above this, m.
const CLEAR_OF_GROUND_M: f64 = 0.1;
/// Thrust must fall with throttle by so many nats to be told.
const PLAINLY_NATS: f64 = 10.0;
/// A number so many tolerances away is none that the tolerance allows for.
const FAR_SIGMAS: f64 = 5.0;
/// What a model may leave: an acceleration of a fifth of gravity, measurements off by ten centimetres, one in ten wrong.
const MOST_TURBULENCE: f64 = 0.2 * GRAVITY_M_S2;
const MOST_MEASUREMENT_M: f64 = 0.1;
const MOST_OUTLIERS: f64 = 0.1;
/// What flights may keep, each for itself: beyond a tenth of gravity they are not of one airframe in one condition.
const MOST_TRIM: f64 = 0.1 * GRAVITY_M_S2;

/// Refuses altitudes that no flight of a rig reaches: those of another unit.
pub fn plausible_altitude(track: &Track, rig: &Rig) -> Result<(), IdentifyError> {
    let height_m = track.measurements.iter().map(|s| s.z_m.abs()).fold(0.0, f64::max);
    let ceiling_m = rig.safety.ceiling_m;
    if height_m > ABSURD_CEILINGS * ceiling_m {
        return Err(IdentifyError::Altitude { flight: track.name.clone(), height_m, ceiling_m });
    }
    Ok(())
}

/// Checks flights against the rig before anything is fitted.
pub fn before(tracks: &[Track], rig: &Rig) -> Result<(), IdentifyError> {
    if tracks.len() < LEAST_FLIGHTS {
        return Err(IdentifyError::TooFewFlights { usable: tracks.len(), least: LEAST_FLIGHTS });
    }
    let mut ratios = Vec::new();
    for track in tracks {
        plausible_altitude(track, rig)?;
        let height_m = track.measurements.iter().map(|s| s.z_m).fold(f64::MIN, f64::max);
        if height_m < AIRBORNE_M {
            return Err(IdentifyError::NeverAirborne { flight: track.name.clone(), height_m: AIRBORNE_M });
        }
        ratios.extend(airborne_throttles(track, AIRBORNE_M).map(|u| ratio(rig, u)));
    }
    let n = ratios.len().max(1) as f64;
    let mean = ratios.iter().sum::<f64>() / n;
    if !(RATIOS.0..RATIOS.1).contains(&mean) {
        let hint = match mean {
            x if (300.0..3000.0).contains(&x) => ", as if a number were too large by 1000",
            x if (0.0003..0.003).contains(&x) => ", as if a number were too small by 1000",
            _ => "",
        };
        return Err(IdentifyError::Thrust { ratio: mean, hint });
    }
    let percent = 100.0 * (ratios.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n).sqrt() / mean;
    if percent < LEAST_VARIATION_PERCENT {
        return Err(IdentifyError::ConstantThrottle { percent, least_percent: LEAST_VARIATION_PERCENT });
    }
    which_way(tracks, rig)
}

fn ratio(rig: &Rig, throttle: f64) -> f64 {
    let thrust = &rig.airframe.thrust;
    thrust.gain_n_per_unit.value * (throttle - thrust.offset.value) / rig.airframe.weight_n()
}

/// Throttle at each measurement above a height.
fn airborne_throttles(track: &Track, above_m: f64) -> impl Iterator<Item = f64> + '_ {
    let seen = track.measurements.iter().filter(move |s| s.counts && s.z_m > above_m);
    seen.filter_map(|s| {
        let after = track.inputs.partition_point(|input| input.time_s <= s.exposed_s);
        Some(track.inputs[after.checked_sub(1)?].throttle)
    })
}

/// Refuses flights in which thrust falls with the throttle: two laws that differ in the sign of the slope alone, both
/// through the weight at the mean throttle, each with as much freedom to be off.
fn which_way(tracks: &[Track], rig: &Rig) -> Result<(), IdentifyError> {
    let mut plain = rig.clone();
    plain.airframe.thrust.hover_sigma = None;
    let clear: Vec<Track> =
        tracks.iter().filter_map(|track| track.clone().above(CLEAR_OF_GROUND_M, &plain).ok()).collect();
    let throttles: Vec<f64> =
        clear.iter().flat_map(|track| airborne_throttles(track, CLEAR_OF_GROUND_M)).collect();
    if throttles.is_empty() {
        return Ok(());
    }
    let mean = throttles.iter().sum::<f64>() / throttles.len() as f64;
    let problem = Problem::new(&clear, &plain);
    let noise = Noise { turbulence: 0.3, trim: 1.0, trim_walk: 0.05, ..problem.noise };
    let likelihood = |way: f64| {
        let gain = way * plain.airframe.thrust.gain_n_per_unit.value;
        let mut point: Point = problem.nominal.clone();
        point.nuisances[RigNumber::ThrustGain] = gain;
        point.nuisances[RigNumber::ThrustOffset] = mean - plain.airframe.weight_n() / gain;
        problem.log_likelihood(&point, &noise)
    };
    let nats = likelihood(-1.0) - likelihood(1.0);
    if nats > PLAINLY_NATS { Err(IdentifyError::ThrustFalls { nats }) } else { Ok(()) }
}

/// Checks a fit against the rig's tolerances.
pub fn after(problem: &Problem<'_>, fit: &Fit) -> Result<(), IdentifyError> {
    let noise = &fit.noise;
    let plain = noise.turbulence < MOST_TURBULENCE
        && noise.measurement_m < MOST_MEASUREMENT_M
        && noise.outlier_probability < MOST_OUTLIERS;
    if !plain {
        return Err(IdentifyError::Unexplained {
            turbulence_m_s2: noise.turbulence,
            measurement_m: noise.measurement_m,
            outlier_percent: 100.0 * noise.outlier_probability,
        });
    }
    if noise.trim > MOST_TRIM {
        return Err(IdentifyError::Trim { trim_m_s2: noise.trim });
    }
    hover_was_flown(problem, fit)?;
    let names = Point::names(problem.rig);
    let far: Vec<Contradiction> = problem
        .uncertain()
        .map(|(number, sigma)| {
            let (nominal, fitted) = (problem.nominal.nuisances[number], fit.point.nuisances[number]);
            Contradiction { name: names[number], nominal, fitted, sigmas: (fitted - nominal) / sigma }
        })
        .filter(|number| number.sigmas.abs() > FAR_SIGMAS)
        .collect();
    if far.is_empty() { Ok(()) } else { Err(IdentifyError::Contradicts(far)) }
}

/// Refuses a throttle that carries the weight and was never near: over a flight thrust carries the weight on average, so it lies between
/// the lowest and the highest throttle in the air, whatever the law.
fn hover_was_flown(problem: &Problem<'_>, fit: &Fit) -> Result<(), IdentifyError> {
    let thrust = &problem.rig.airframe.thrust;
    let n = &fit.point.nuisances;
    let hover = if thrust.hover_sigma.is_some() {
        n[RigNumber::ThrustGain]
    } else {
        n[RigNumber::ThrustOffset] + n[RigNumber::Mass] * GRAVITY_M_S2 / n[RigNumber::ThrustGain]
    };
    let flown = problem.tracks.iter().flat_map(|track| airborne_throttles(track, AIRBORNE_M));
    let (low, high) = flown.fold((f64::MAX, f64::MIN), |(low, high), u| (low.min(u), high.max(u)));
    if low > high || (low..=high).contains(&hover) {
        return Ok(());
    }
    let unit = problem.rig.airframe.actuation.unit();
    Err(IdentifyError::HoverNeverFlown { hover, low, high, unit })
}
