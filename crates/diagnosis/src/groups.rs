//! Which effects these flights cannot tell apart: their expected responses point the same way once the rig's tolerances
//! have explained what they can.

use nalgebra::DMatrix;

use crate::{
    fit::{Fit, Problem, start_values},
    pass::{Direction, run},
    random::is_random,
};

/// Cosine beyond which two effects count as one.
pub const SAME: f64 = 0.8;

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
    let mut directions = problem.directions(&null.point);
    let numbers = directions.len();
    directions.push(Direction::Added(fitted.0, fitted.1.clone()));
    let mut owners = Vec::new();
    for other in others.iter().filter(|other| **other != fitted.0 && !is_random(**other)) {
        for values in start_values(*other) {
            directions.push(Direction::Added(*other, values));
            owners.push(*other);
        }
    }
    let noise = null.full_noise(problem);
    let pass = run(problem.tracks, problem.rig, &null.point, &noise, &directions);
    let mut own = pass.information.view((0, 0), (numbers, numbers)).into_owned();
    for (i, f) in null.free.iter().enumerate() {
        let per_value = f.slope(null.point.get(f.at)).recip();
        own[(i, i)] += (per_value / f.sigma).powi(2);
    }
    let Some(own) = own.cholesky() else { return Vec::new() };
    let n = directions.len() - numbers;
    let cross = pass.information.view((0, numbers), (numbers, n)).into_owned();
    let left: DMatrix<f64> = pass.information.view((numbers, numbers), (n, n)).into_owned()
        - cross.transpose() * own.solve(&cross);
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
