//! How wrong the model is after half a second, one and two: for people, in metres.

use crate::{
    fit::Problem,
    law::Point,
    pass::{Noise, run},
    track::Track,
};

/// Horizons of prediction, s.
pub const HORIZONS_S: [f64; 3] = [0.5, 1.0, 2.0];
/// Time between two starts of a prediction, s.
const EVERY_S: f64 = 1.0;
/// The filter gets so long to find the state before the first prediction, s.
const SETTLE_S: f64 = 1.5;

/// RMS altitude error of predictions from the filtered state with the recorded throttle, m, at each of [`HORIZONS_S`];
/// `None` where no flight is long enough.
pub fn prediction_errors_m(problem: &Problem<'_>, point: &Point, noise: &Noise) -> [Option<f64>; 3] {
    let mut sums = [(0.0, 0_u32); 3];
    for track in problem.tracks {
        let mut start = track.begin_s + SETTLE_S;
        while start + HORIZONS_S[0] < track.end_s {
            add_prediction(problem, track, start, point, noise, &mut sums);
            start += EVERY_S;
        }
    }
    sums.map(|(sum, count)| (count > 0).then(|| (sum / f64::from(count)).sqrt()))
}

fn add_prediction(
    problem: &Problem<'_>,
    track: &Track,
    start_s: f64,
    point: &Point,
    noise: &Noise,
    sums: &mut [(f64, u32); 3],
) {
    let end_s = start_s + HORIZONS_S[2] + 0.1;
    let mut ahead = track.clone();
    ahead.sightings.retain(|sighting| sighting.exposed_s <= end_s);
    ahead.blind_from_s = start_s;
    let pass = run(&[ahead], problem.rig, point, noise, &[]);
    let after = pass.innovations.iter().filter(|innovation| innovation.exposed_s > start_s);
    for (horizon_s, sum) in HORIZONS_S.into_iter().zip(sums) {
        // The sighting nearest to the horizon, if there is one within a tenth of a second.
        let nearest = after.clone().min_by(|a, b| {
            let off =
                |innovation: &crate::pass::Innovation| (innovation.exposed_s - start_s - horizon_s).abs();
            off(a).total_cmp(&off(b))
        });
        if let Some(found) = nearest.filter(|found| (found.exposed_s - start_s - horizon_s).abs() < 0.1) {
            sum.0 += found.residual_m * found.residual_m;
            sum.1 += 1;
        }
    }
}
