//! The disturbance that the nominal law leaves, smoothed: to look at, not to regress on, for it is autocorrelated and
//! drawn towards zero.

use bench_filter::{backward, knots};
use bench_inference::{Fit, Problem};
use serde::Serialize;

/// One flight as seen and as smoothed.
#[derive(Clone, Debug, Serialize)]
pub struct Trace {
    /// Its name.
    pub name: String,
    /// From take-off on, s.
    pub time_s: Vec<f64>,
    /// As seen, m.
    pub seen_m: Vec<f64>,
    /// As smoothed, m.
    pub smoothed_m: Vec<f64>,
    /// Acceleration that the re-fitted rig does not explain, m/s^2.
    pub disturbance_m_s2: Vec<f64>,
    /// One sigma of it, m/s^2.
    pub sigma_m_s2: Vec<f64>,
    /// Thrust commanded over weight.
    pub thrust_to_weight: Vec<f64>,
}

/// At most so many points a trace.
const POINTS: usize = 400;

/// Smooths every flight on top of a fit.
pub fn traces(problem: &Problem<'_>, fit: &Fit) -> Vec<Trace> {
    let noise = fit.full_noise(problem);
    problem
        .tracks
        .iter()
        .map(|track| {
            let knots = knots(track, problem.rig, &fit.point, &noise);
            let smoothed = backward(&knots);
            let every = knots.len().div_ceil(POINTS).max(1);
            let mut trace = Trace {
                name: track.name.clone(),
                time_s: Vec::new(),
                seen_m: Vec::new(),
                smoothed_m: Vec::new(),
                disturbance_m_s2: Vec::new(),
                sigma_m_s2: Vec::new(),
                thrust_to_weight: Vec::new(),
            };
            for (knot, (x, p)) in knots.iter().zip(&smoothed).step_by(every) {
                trace.time_s.push(knot.time_s);
                trace.seen_m.push(knot.seen_m);
                trace.smoothed_m.push(x[0]);
                trace.disturbance_m_s2.push(x[2] + x[3]);
                trace.sigma_m_s2.push((p[2][2] + p[3][3] + 2.0 * p[2][3]).max(0.0).sqrt());
                trace.thrust_to_weight.push(knot.ratio);
            }
            trace
        })
        .collect()
}
