//! Noise of tracker and air, as the flights show it.

use bench_filter::Noise;
use bench_inference::{Fit, Problem};

/// One of the noise's numbers: how to reach it, how far its logarithm may be from what was thought before, and in which
/// range it lies.
struct Part {
    of: fn(&mut Noise) -> &mut f64,
    sigma_ln: f64,
    range: (f64, f64),
}

const PARTS: [Part; 11] = [
    Part { of: |n| &mut n.acceleration, sigma_ln: 2.0, range: (1e-4, 10.0) },
    Part { of: |n| &mut n.jitter_s, sigma_ln: 1.0, range: (1e-5, 0.1) },
    Part { of: |n| &mut n.outlier_probability, sigma_ln: 1.0, range: (1e-5, 0.2) },
    Part { of: |n| &mut n.outlier_m, sigma_ln: 1.0, range: (1e-4, 1.0) },
    Part { of: |n| &mut n.measurement_m, sigma_ln: 1.0, range: (5e-5, 1.0) },
    Part { of: |n| &mut n.turbulence, sigma_ln: 2.0, range: (1e-3, 50.0) },
    Part { of: |n| &mut n.turbulence_time_s, sigma_ln: 0.8, range: (0.2, 6.0) },
    Part { of: |n| &mut n.trim, sigma_ln: 1.0, range: (1e-3, 20.0) },
    Part { of: |n| &mut n.trim_walk, sigma_ln: 1.0, range: (1e-4, 5.0) },
    Part { of: |n| &mut n.velocity_m_s, sigma_ln: 1.0, range: (1e-4, 10.0) },
    Part { of: |n| &mut n.acceleration_m_s2, sigma_ln: 1.0, range: (1e-3, 50.0) },
];

const SWEEPS: usize = 8;
const FIRST_STEP: f64 = 0.6;
/// A sweep that gains less, nats, is the last.
const WORTH: f64 = 0.2;

/// What is thought of the numbers that a rig need not give: hardly any.
const TIMING_S: f64 = 1e-3;
const OUTLIERS: f64 = 1e-3;
const OUTLIER_SIGMAS: f64 = 10.0;

/// Noise as the rig gives it, with a start for what it does not give.
pub fn thought(noise: &Noise) -> Noise {
    let or = |given: f64, usual: f64| if given > 0.0 { given } else { usual };
    Noise {
        jitter_s: or(noise.jitter_s, TIMING_S),
        outlier_probability: or(noise.outlier_probability, OUTLIERS),
        outlier_m: or(noise.outlier_m, OUTLIER_SIGMAS * noise.measurement_m),
        ..*noise
    }
}

/// The most likely noise at a fit, by a search along each of its numbers in turn with parabolas through three points.
pub fn most_likely(problem: &Problem<'_>, fit: &Fit, thought: &Noise) -> Noise {
    let mut noise = fit.noise;
    // What is felt on board is used only where the rig says how good it is.
    let parts: Vec<&Part> = PARTS.iter().filter(|part| *(part.of)(&mut thought.clone()) > 0.0).collect();
    let objective = |noise: &Noise| {
        let prior: f64 = parts
            .iter()
            .map(|part| {
                let ratio = *(part.of)(&mut noise.clone()) / *(part.of)(&mut thought.clone());
                0.5 * (ratio.ln() / part.sigma_ln).powi(2)
            })
            .sum();
        prior - problem.log_likelihood(&fit.point, noise)
    };
    let mut best = objective(&noise);
    let mut steps = vec![FIRST_STEP; parts.len()];
    for _ in 0..SWEEPS {
        let before = best;
        for (part, h) in parts.iter().zip(&mut steps) {
            let moved = |ln: f64| {
                let mut moved = noise;
                let x = (part.of)(&mut moved);
                *x = (*x * ln.exp()).clamp(part.range.0, part.range.1);
                moved
            };
            let (low, high) = (objective(&moved(-*h)), objective(&moved(*h)));
            let bend = low + high - 2.0 * best;
            let ln = if bend > 1e-9 {
                (0.5 * *h * (low - high) / bend).clamp(-2.0 * *h, 2.0 * *h)
            } else {
                2.0 * h.copysign(low - high)
            };
            let there = objective(&moved(ln));
            let found = [(there, ln), (low, -*h), (high, *h)]
                .into_iter()
                .min_by(|a, b| a.0.total_cmp(&b.0))
                .filter(|(value, _)| *value < best);
            if let Some((value, ln)) = found {
                noise = moved(ln);
                best = value;
            }
            *h = (0.4 * *h).max(ln.abs().min(*h));
        }
        if before - best < WORTH {
            break;
        }
    }
    noise
}
