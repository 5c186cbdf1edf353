//! Noise that a few flights hardly tell, and many do. What is usual makes room for physics of another form; of many flights so
//! much room is itself a gap, and laws are named that only make it smaller (a scale, which all noise shrinks with).

use bench_filter::Noise;
use bench_rig::Disturbance;

use crate::fit::{Fit, Problem, TURBULENCE_TIMES_S};

/// One of the noise's numbers that may be less than is usual.
struct Part {
    of: fn(&mut Noise) -> &mut f64,
    /// Whether the rig says how large it is.
    told: fn(&Disturbance) -> bool,
}

const PARTS: [Part; 5] = [
    Part { of: |noise| &mut noise.acceleration, told: |air| air.white_m_s2_per_root_hz.is_some() },
    Part { of: |noise| &mut noise.trim, told: |air| air.trim_m_s2.is_some() },
    Part { of: |noise| &mut noise.trim_walk, told: |air| air.trim_walk_m_s2_per_root_s.is_some() },
    Part { of: |noise| &mut noise.near_ground, told: |_| false },
    Part { of: |noise| &mut noise.lift_off_m_s, told: |_| false },
];

/// Uncertainty of the logarithm of each part before any flight, and the least that it may be of what is usual.
const SIGMA_LN: f64 = 0.5;
const LEAST: f64 = 0.125; // numerical
/// A part is moved for more than so many nats.
const WORTH_NATS: f64 = 1.0; // numerical
const MOST_ROUNDS: usize = 8; // numerical

fn open_parts(problem: &Problem<'_>) -> impl Iterator<Item = &'static Part> {
    PARTS.iter().filter(|part| !(part.told)(&problem.rig.disturbance))
}

/// Negative logarithm of the prior of noise whose parts are less than is usual; 0 where none is.
pub fn prior(problem: &Problem<'_>, noise: &Noise) -> f64 {
    open_parts(problem)
        .map(|part| (*(part.of)(&mut noise.clone()) / *(part.of)(&mut problem.noise.clone())).ln())
        .map(|ln| 0.5 * (ln / SIGMA_LN).powi(2))
        .sum()
}

/// Lessens the noise of a fit where the flights show that it is less than is usual, and fits anew.
pub fn settle(problem: &Problem<'_>, mut fit: Fit) -> Fit {
    for _ in 0..MOST_ROUNDS {
        let noise = settled(problem, &fit);
        if noise == fit.noise {
            break;
        }
        fit = problem.refine(fit.point, noise);
    }
    fit
}

/// Memories beside the one at hand that are tried too, for many flights show it more finely than the few that are tried first: gusts of
/// the right one would else gain by it.
const NEARBY_TIMES: [f64; 2] = [0.8, 1.25]; // numerical
/// Powers of the ratio of correlation times by which turbulence is less.
const OF_SHORTER: [f64; 3] = [0.0, 0.25, 0.5]; // numerical

/// The noise of a fit, each open part halved or doubled where that is likelier, and its turbulence of the likeliest memory: an
/// effect that the null lacks is a slow turbulence there.
fn settled(problem: &Problem<'_>, fit: &Fit) -> Noise {
    let mut noise = fit.noise;
    let mut best = fit.objective;
    for part in open_parts(problem) {
        let usual = *(part.of)(&mut problem.noise.clone());
        for factor in [0.5, 2.0] {
            let mut other = noise;
            let value = (part.of)(&mut other);
            *value = (*value * factor).clamp(LEAST * usual, usual);
            if other == noise {
                continue;
            }
            let objective = problem.objective(&fit.point, &other, &fit.free);
            if objective < best - WORTH_NATS {
                (noise, best) = (other, objective);
                break;
            }
        }
    }
    with_likeliest_time(problem, fit, noise, best)
}

/// Noise whose turbulence has the likeliest correlation time beside a fit, from noise of a given objective.
pub fn with_likeliest_time(problem: &Problem<'_>, fit: &Fit, from: Noise, objective: f64) -> Noise {
    let (mut noise, mut best) = (from, objective);
    let nearby = NEARBY_TIMES.map(|factor| factor * from.turbulence_time_s);
    for turbulence_time_s in TURBULENCE_TIMES_S.into_iter().chain(nearby) {
        // Of a shorter correlation time it is also less: what it does within moments stays alike.
        for power in OF_SHORTER {
            let factor = (turbulence_time_s / from.turbulence_time_s).powf(power);
            let other = Noise { turbulence_time_s, turbulence: from.turbulence * factor, ..from };
            let objective = problem.objective(&fit.point, &other, &fit.free);
            if objective < best - WORTH_NATS {
                (noise, best) = (other, objective);
            }
        }
    }
    noise
}
