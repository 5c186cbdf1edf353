//! A loop in soft real time: every iteration starts a little late.

use crate::random::{Random, exponential, happens, uniform};

/// What holds the loop up.
#[derive(Clone, Debug)]
pub(crate) enum LoopFault {
    /// Waits with a long tail (Pareto distribution of shape 2.5, cut at ten times its mean).
    LongTail { probability: f64, mean_s: f64 },
    /// A collector of garbage that pauses the program every so many iterations.
    Collector { every: f64, pause_s: f64 },
}

impl LoopFault {
    /// Share of iterations that are held up, and for how long in the mean, s.
    pub(crate) fn rate(&self) -> (f64, f64) {
        match *self {
            Self::LongTail { probability, mean_s } => (probability, mean_s),
            Self::Collector { every, pause_s } => (1.0 / every, pause_s),
        }
    }
}

/// Mean of the lateness that every iteration has, s.
pub(crate) const LATENESS_S: f64 = 0.0015;

/// How late iteration `index` starts, s.
pub(crate) fn lateness_s(index: u64, fault: Option<&LoopFault>, random: &mut Random) -> f64 {
    let usual = 0.4 * LATENESS_S + 0.6 * LATENESS_S * exponential(random);
    let more = match fault {
        Some(LoopFault::LongTail { probability, mean_s }) if index > 0 && happens(random, *probability) => {
            const SHAPE: f64 = 2.5;
            let least_s = mean_s * (SHAPE - 1.0) / SHAPE;
            let tail = (1.0 - uniform(random, 0.0, 1.0)).max(1e-9).powf(-1.0 / SHAPE);
            (least_s * tail).min(10.0 * mean_s)
        }
        Some(LoopFault::Collector { every, pause_s }) if (index as f64 + 0.5) % every < 1.0 && index > 0 => {
            pause_s * uniform(random, 0.7, 1.3)
        }
        _ => 0.0,
    };
    usual + more
}
