//! Iterations that are late in turn: every so many of them, however little, as something else that runs at its own rate makes them.

use std::{iter::Sum, ops::Add};

/// Iterations of a cycle that are late.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cycle {
    /// Every so many.
    pub length: usize,
    /// How much later those start than the others, s.
    pub later_s: f64,
    /// Gain of log-likelihood over lateness without order, less what the choice of length and phase is worth, nats.
    pub gain: f64,
}

/// The longest cycle that is looked for, and how often it must come in a flight of mean length.
const LONGEST: usize = 100; // numerical
const LEAST_TURNS: usize = 4;

/// Iterations of one phase of a cycle: sums of their ranks and of their lateness, s, and how many they are.
#[derive(Clone, Copy, Default)]
struct Phase {
    ranks: f64,
    late_s: f64,
    n: f64,
}

impl Add for Phase {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self { ranks: self.ranks + other.ranks, late_s: self.late_s + other.late_s, n: self.n + other.n }
    }
}

impl Sum for Phase {
    fn sum<I: Iterator<Item = Self>>(phases: I) -> Self {
        phases.fold(Self::default(), Add::add)
    }
}

/// The likeliest cycle in the lateness of iterations, flight by flight, s; `None` where none is likelier than no order. Ranks are compared,
/// as the sums of Wilcoxon's test, so that a few that are very late make no cycle.
pub fn cycle(flights: &[&[f64]]) -> Option<Cycle> {
    let flights: Vec<Vec<Phase>> = ranked(flights);
    let every: Vec<Phase> = flights.concat();
    let all: Phase = every.iter().copied().sum();
    let variance = every.iter().map(|one| one.ranks * one.ranks).sum::<f64>() / all.n;
    let most = LONGEST.min(every.len() / flights.len().max(1) / LEAST_TURNS);
    if variance <= 0.0 || most < 2 {
        return None;
    }
    let tried = ((most - 1) as f64).ln();
    let gain = |phase: &Phase| {
        if phase.ranks > 0.0 { 0.5 * phase.ranks * phase.ranks / (phase.n * variance) } else { 0.0 }
    };
    let latest = |phases: &[Phase]| {
        let best = phases.iter().copied().max_by(|a, b| gain(a).total_cmp(&gain(b))).unwrap_or_default();
        (gain(&best) - (phases.len() as f64).ln(), best)
    };
    (2..=most)
        .map(|length| {
            let phases = |flight: &Vec<Phase>| -> Vec<Phase> {
                (0..length).map(|phase| flight.iter().copied().skip(phase).step_by(length).sum()).collect()
            };
            let own: Vec<Vec<Phase>> = flights.iter().map(phases).collect();
            // The cycle begins with each flight, or goes on between them.
            let each: Vec<(f64, Phase)> = own.iter().map(|phases| latest(phases)).collect();
            let apart = (each.iter().map(|(gain, _)| gain).sum(), each.iter().map(|(_, phase)| *phase).sum());
            let shared: Vec<Phase> =
                (0..length).map(|phase| own.iter().map(|phases| phases[phase]).sum()).collect();
            let together = latest(&shared);
            let (gain, late) = if together.0 > apart.0 { together } else { apart };
            let later_s = late.late_s / late.n - (all.late_s - late.late_s) / (all.n - late.n).max(1.0);
            Cycle { length, later_s, gain: gain - tried }
        })
        .max_by(|a, b| a.gain.total_cmp(&b.gain))
        .filter(|best| best.gain > 0.0)
}

/// Each iteration with its rank among all, from minus to plus a half, those that are equal sharing theirs.
fn ranked(flights: &[&[f64]]) -> Vec<Vec<Phase>> {
    let mut sorted = flights.concat();
    sorted.sort_by(f64::total_cmp);
    let ranked = |late_s: &f64| {
        let (below, upto) =
            (sorted.partition_point(|other| other < late_s), sorted.partition_point(|other| other <= late_s));
        Phase { ranks: 0.5 * (below + upto) as f64 / sorted.len() as f64 - 0.5, late_s: *late_s, n: 1.0 }
    };
    flights.iter().map(|flight| flight.iter().map(ranked).collect()).collect()
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    use super::cycle;

    /// Lateness of 230 iterations, s, half-normal by 1.5 ms and counted in milliseconds, every so many of them later.
    fn flight(rng: &mut ChaCha8Rng, every: usize, from: usize, later_s: f64) -> Vec<f64> {
        (0..230)
            .map(|i| {
                let normal: f64 = StandardNormal.sample(rng);
                let late_s = 1.5e-3 * normal.abs() + if i % every == from { later_s } else { 0.0 };
                1e-3 * (1e3 * late_s).ceil()
            })
            .collect()
    }

    fn set(seed: u64, every: usize, later_s: f64, phase: impl Fn(usize) -> usize) -> Vec<Vec<f64>> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        (0..9).map(|number| flight(&mut rng, every, phase(number) % every, later_s)).collect()
    }

    #[test]
    fn a_cycle_of_little_lateness_is_found_with_its_length_and_size() {
        for (every, phase) in
            [(17, (|_| 11) as fn(usize) -> usize), (6, |flight| 5 * flight), (40, |flight| 7 * flight)]
        {
            let flights = set(1, every, 4.6e-3, phase);
            let found = cycle(&flights.iter().map(Vec::as_slice).collect::<Vec<_>>()).unwrap();
            assert_eq!(found.length, every);
            // Some 50 late ones or more, of 1 ms each.
            assert!((found.later_s - 4.6e-3).abs() < 0.5e-3, "{found:?}");
            assert!(found.gain > 20.0, "{found:?}");
        }
    }

    #[test]
    fn lateness_without_order_has_no_cycle() {
        let gains = (0..40).map(|seed| {
            let flights = set(seed, 1, 0.0, |_| 0);
            cycle(&flights.iter().map(Vec::as_slice).collect::<Vec<_>>()).map_or(0.0, |found| found.gain)
        });
        // What the choice is worth is taken off: by chance a gain of 8 nats comes once in thousands.
        assert!(gains.clone().all(|gain| gain < 8.0), "{:?}", gains.collect::<Vec<_>>());
    }
}
