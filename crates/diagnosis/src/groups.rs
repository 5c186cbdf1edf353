//! Which effects these flights cannot tell apart: their expected responses point the same way once the rig's tolerances
//! have explained what they can.

use bench_filter::{Direction, is_random, run};
use bench_inference::{Fit, Problem, directions, project};
use bench_plant::effects::LIBRARY;

/// Cosine beyond which two effects count as one.
const SAME: f64 = 0.8;
/// The same of lags and delays: a lag of the pins, of the rotors, of the measurements differ by where they begin and by their
/// order, and those of an airframe are of any order. A pure delay of the pins is one of the measurements.
const SAME_LAG: f64 = 0.25;

/// Cosine beyond which these two count as one.
pub fn same(a: usize, b: usize) -> f64 {
    if [a, b].iter().all(|effect| LIBRARY[*effect].signature.lag) { SAME_LAG } else { SAME }
}

/// Cosines of a fitted effect's response with those of other effects, highest first: the law's finite difference at the
/// fitted values against the others' at sizes and shapes over their priors.
pub fn cosines(
    problem: &Problem<'_>,
    null: &Fit,
    fitted: &(usize, Vec<f64>),
    others: &[usize],
) -> Vec<(usize, f64)> {
    if is_random(fitted.0) {
        return Vec::new();
    }
    let mut directions = directions(&null.free, &null.point);
    directions.push(Direction::Added(fitted.0, fitted.1.clone()));
    let mut owners = Vec::new();
    for other in others.iter().filter(|other| **other != fitted.0 && !is_random(**other)) {
        for values in problem.start_values(*other) {
            directions.push(Direction::Added(*other, values));
            owners.push(*other);
        }
    }
    let noise = null.full_noise(problem);
    let pass = run(problem.tracks, problem.rig, &null.point, &noise, &directions);
    let Some((left, _)) = project(&null.free, &null.point, &pass) else { return Vec::new() };
    let mut best: Vec<(usize, f64)> = Vec::new();
    for (i, owner) in owners.into_iter().enumerate() {
        let scale = (left[(0, 0)] * left[(i + 1, i + 1)]).sqrt();
        if scale.is_nan() || scale < 1e-9 {
            continue;
        }
        let cosine = (left[(0, i + 1)] / scale).abs();
        match best.iter_mut().find(|(effect, _)| *effect == owner) {
            Some((_, most)) => *most = most.max(cosine),
            None => best.push((owner, cosine)),
        }
    }
    best.sort_by(|a, b| b.1.total_cmp(&a.1));
    best
}
