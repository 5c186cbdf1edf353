//! How far off a rig predicts, held against what its tolerances and noise allow: beyond that by far, it is not this airframe's.

use bench_filter::{Coordinate, HORIZONS_S, Point, predict};
use bench_inference::{Fit, Problem};
use bench_plant::effects::LIBRARY;
use bench_statistics::FAR_SIGMAS;
use rayon::prelude::*;
use serde::Serialize;

/// Which of the horizons is told.
const HORIZON: usize = 1; // numerical
/// An error so many times what is allowed is far outside: the library's effects at three sigma of their priors reach six. An offset of
/// the throttle that is 70 tolerances off reaches nine.
const FAR: f64 = 7.0;
/// A number of the rig further off than so many tolerances is another one.
const MOST_TOLERANCES: f64 = 10.0;

/// How far off predictions are, and may be.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Ahead {
    /// So far ahead, s.
    pub horizon_s: f64,
    /// RMS error of the rig as it is, m.
    pub error_m: f64,
    /// One sigma of what the rig's tolerances and noise allow, m.
    pub allowed_m: f64,
    /// What is left with the best hypothesis, m.
    pub best_m: f64,
    /// Whether the error is far outside what is allowed and neither the rig's numbers nor an effect of the library, as far as
    /// either may reasonably be off, explain it: no verdict is worth telling.
    pub beyond: bool,
    /// How far the best hypothesis' parameters and numbers lie from where they were thought to be, in deviations: those that are
    /// too far, furthest first.
    pub off: Vec<Off>,
}

/// A number that would have to be another one.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Off {
    /// The effect whose parameter it is; absent for a number of the rig.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub effect: Option<&'static str>,
    /// The number.
    pub name: &'static str,
    /// The rig's, or the effect's most ordinary, value.
    pub nominal: f64,
    /// What these flights would want.
    pub fitted: f64,
    /// How many deviations lie between.
    pub sigmas: f64,
}

/// How far off predictions of a rig are; `None` where flights are too short for one.
pub fn ahead(problem: &Problem<'_>, best: &Fit) -> Option<Ahead> {
    let noise = best.full_noise(problem);
    let squares = |point: &Point| {
        let flown: Vec<(f64, u32)> = problem
            .tracks
            .par_iter()
            .map(|track| predict(track, problem.rig, point, &noise).k_step[HORIZON])
            .collect();
        let count: u32 = flown.iter().map(|(_, n)| n).sum();
        (flown.iter().map(|(sum, _)| sum).sum::<f64>() / f64::from(count), count)
    };
    let (nominal, count) = squares(&problem.nominal);
    if count == 0 {
        return None;
    }
    let (at_best, _) = squares(&best.point);
    // Where the model fits, errors are linear in the numbers: half the second difference of the mean square is what a
    // tolerance adds to it.
    let tolerances: f64 = problem
        .uncertain()
        .map(|(number, sigma)| {
            let moved = |way: f64| {
                let mut point = best.point.clone();
                point.nuisances[number] += way * sigma;
                squares(&point).0
            };
            (0.5 * (moved(1.0) + moved(-1.0)) - at_best).max(0.0)
        })
        .sum();
    let allowed_m = (tolerances + noise_m2(problem)).sqrt();
    let off = off(problem, best);
    let far = |m2: f64| m2.sqrt() > FAR * allowed_m || !m2.is_finite();
    Some(Ahead {
        horizon_s: HORIZONS_S[HORIZON],
        error_m: nominal.sqrt(),
        allowed_m,
        best_m: at_best.sqrt(),
        beyond: far(nominal) && (far(at_best) || !off.is_empty()),
        off,
    })
}

/// Variance that the rig's noise alone gives a prediction, no less than it does, m^2: what a flight keeps and the turbulence are
/// taken to last, and the filter to have learnt nothing of them.
fn noise_m2(problem: &Problem<'_>) -> f64 {
    let (n, t) = (&problem.noise, HORIZONS_S[HORIZON]);
    let pushed = 0.5 * t * t;
    n.measurement_m.powi(2)
        + n.acceleration.powi(2) * t.powi(3) / 3.0 // unit
        + (n.trim.powi(2) + n.turbulence.powi(2)) * pushed * pushed
}

/// What a fit has moved further than it may reasonably be off.
fn off(problem: &Problem<'_>, fit: &Fit) -> Vec<Off> {
    let names = Point::names(problem.rig);
    let mut all: Vec<Off> = fit
        .free
        .iter()
        .filter_map(|f| {
            let fitted = fit.point.get(f.at);
            let sigmas = (f.own(fitted) - f.mean) / f.sigma;
            let nominal = if f.logarithmic { f.mean.exp() } else { f.mean };
            match f.at {
                Coordinate::Nuisance(i) => (sigmas.abs() > MOST_TOLERANCES).then_some(Off {
                    effect: None,
                    name: names[i],
                    nominal,
                    fitted,
                    sigmas,
                }),
                Coordinate::Effect { slot, parameter } => {
                    let spec = LIBRARY[fit.point.effects[slot].0];
                    let p = spec.parameters[parameter];
                    let size = p.neutral.is_some() && sigmas.abs() > FAR_SIGMAS;
                    size.then_some(Off { effect: Some(spec.name), name: p.key, nominal, fitted, sigmas })
                }
            }
        })
        .collect();
    all.sort_by(|a, b| b.sigmas.abs().total_cmp(&a.sigmas.abs()));
    all
}
