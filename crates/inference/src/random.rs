//! Fits of effects that are seen in the spread of measurements alone: they change the filter's noise, not its prediction.

use bench_filter::{Noise, Point, spread};
use bench_plant::effects::{LIBRARY, Spread};

use crate::{
    coordinate::{Free, effect_coordinates, every_choice},
    fit::{Fit, Problem},
};

/// Nearer than this, beside more noise, wrong places are its tails.
const TAIL_SIGMAS: f64 = 6.0; // numerical

/// Loss of likelihood a measurement, nats, between the best of the grid and the mode: half a step in the size of a noise.
const GRID_LOSS: f64 = 0.06; // numerical
/// Sweeps of the search over all coordinates, at most and at least.
const SWEEPS: usize = 6; // numerical
/// A sweep that gains less, nats, is the last.
const WORTH_A_SWEEP: f64 = 0.1; // numerical
const LEAST_SWEEPS: usize = 2; // numerical

/// Numbers that gain less under the noise found, nats, are where they should be.
const SETTLED_NATS: f64 = 1.0; // numerical
/// Rounds of noise and numbers.
const ROUNDS: usize = 3; // numerical

/// Adds a random effect to a fit: its noise, and the numbers that the fit without it may have bent to do its work, in
/// turn. `None` if no size of it is better than none.
pub fn fit_with(problem: &Problem<'_>, base: &Fit, effect: usize) -> Option<Fit> {
    let on_top = OnTop::new(problem, base, &[effect]);
    let (noise, start) = on_top.coarse(base, effect)?;
    Some(on_top.settle(base, noise, start))
}

/// Adds two random effects to a fit, from where each alone was found to fit best.
/// `None` if they are one.
pub fn fit_with_both(problem: &Problem<'_>, base: &Fit, alone: [&Fit; 2]) -> Option<Fit> {
    let [a, b] = alone.map(|fit| fit.point.effects[base.point.effects.len()].clone());
    let on_top = OnTop::new(problem, base, &[a.0, b.0]);
    let start = on_top.coordinates(a.1.iter().chain(&b.1));
    // Each alone may have left the other's work to the noise.
    let [a, b] = alone.map(|fit| fit.noise);
    let noise = Noise {
        turbulence: a.turbulence.min(b.turbulence),
        measurement_m: a.measurement_m.min(b.measurement_m),
        ..base.noise
    };
    Some(on_top.settle(base, noise, start)).filter(|fit| !only_tails(fit))
}

/// Shares of a random effect's size that it may have beside another whose work it did alone, as logarithms.
const BESIDE_ANOTHER_LN: [f64; 3] = [0.0, -0.3, -0.9]; // numerical

/// Adds two random effects to a fit where one alone leads and the other alone was not worth a fit: from the best of a grid over
/// the other and over the size of the first. `None` if that promises nothing over the first.
pub fn fit_beside(problem: &Problem<'_>, base: &Fit, first: &Fit, other: usize) -> Option<Fit> {
    let (first_effect, values) = first.point.effects[base.point.effects.len()].clone();
    let on_top = OnTop::new(problem, base, &[first_effect, other]);
    let (size, rest) = on_top.own.split_at(values.len());
    let alone: Vec<f64> = size.iter().zip(&values).map(|(f, value)| f.own(*value)).collect();
    let (value, start) = BESIDE_ANOTHER_LN
        .iter()
        .flat_map(|less| grid(rest).into_iter().map(move |values| (*less, values)))
        .map(|(less, values)| {
            let mut start = alone.clone();
            start[0] += less;
            start.extend(values);
            (on_top.objective(base, &first.noise, &start), start)
        })
        .min_by(|a, b| a.0.total_cmp(&b.0))?;
    worth(problem, value, first)
        .then(|| on_top.settle(base, first.noise, start))
        .filter(|fit| !only_tails(fit))
}

/// Whether wrong places lie so near that they are but the tails of more noise, which is never quite normal.
fn only_tails(fit: &Fit) -> bool {
    let values = |kind: Spread| {
        fit.point.effects.iter().find(|(effect, _)| spread(*effect) == Some(kind)).map(|(_, values)| values)
    };
    let (Some(noise), Some(outliers)) = (values(Spread::MeasurementNoise), values(Spread::WrongPlaces))
    else {
        return false;
    };
    outliers[1] < TAIL_SIGMAS * noise[0].hypot(fit.noise.measurement_m)
}

/// Whether a search from the best of so coarse a grid may catch up with a fit.
fn worth(problem: &Problem<'_>, value: f64, with: &Fit) -> bool {
    value <= with.objective + 15.0 + GRID_LOSS * problem.counted() as f64
}

/// Values of coordinates over their priors, one and a half deviations to either side.
fn grid(coordinates: &[Free]) -> Vec<Vec<f64>> {
    every_choice(coordinates.iter().map(|f| [-1.5, -0.5, 0.5, 1.5].map(|k| f.mean + k * f.sigma).to_vec())) // numerical
}

/// Random effects on top of a fit.
struct OnTop<'a> {
    problem: &'a Problem<'a>,
    effects: Vec<usize>,
    own: Vec<Free>,
}

impl<'a> OnTop<'a> {
    fn new(problem: &'a Problem<'a>, base: &Fit, effects: &[usize]) -> Self {
        let below = base.point.effects.len();
        let own = effects.iter().enumerate().flat_map(|(i, effect)| effect_coordinates(below + i, *effect));
        Self { problem, effects: effects.to_vec(), own: own.collect() }
    }

    /// The fit from a start: noise, and the numbers under it, in turn.
    fn settle(&self, base: &Fit, noise: Noise, start: Vec<f64>) -> Fit {
        let below = base.point.effects.len();
        let mut fit = self.descend(base, noise, start);
        for _ in 0..ROUNDS {
            let mut numbers = self.problem.refine(fit.point.clone(), fit.noise);
            if fit.objective - numbers.objective < SETTLED_NATS {
                break;
            }
            let on_top = numbers.point.effects.split_off(below);
            let start = self.coordinates(on_top.iter().flat_map(|(_, values)| values));
            fit = self.descend(&numbers, numbers.noise, start);
        }
        fit
    }

    /// Coordinates of values of the effects' parameters.
    fn coordinates<'v>(&self, values: impl Iterator<Item = &'v f64>) -> Vec<f64> {
        self.own.iter().zip(values).map(|(f, value)| f.own(*value)).collect()
    }

    fn point(&self, base: &Fit, own: &[f64]) -> Point {
        let mut point = base.point.clone();
        let mut values = self.own.iter().zip(own).map(|(f, x)| f.value(*x));
        for effect in &self.effects {
            let parameters = LIBRARY[*effect].parameters.len();
            point.effects.push((*effect, values.by_ref().take(parameters).collect()));
        }
        point
    }

    fn objective(&self, base: &Fit, noise: &Noise, own: &[f64]) -> f64 {
        self.problem.objective(&self.point(base, own), noise, &base.free) - self.ln_prior(own)
    }

    fn ln_prior(&self, own: &[f64]) -> f64 {
        self.own.iter().zip(own).map(|(f, x)| -0.5 * ((x - f.mean) / f.sigma).powi(2)).sum()
    }

    /// Noise and effect from which to search, if they promise anything.
    fn coarse(&self, base: &Fit, effect: usize) -> Option<(Noise, Vec<f64>)> {
        // The base's noise was bent to do the effect's work: from what was thought of it before.
        let usual = self.problem.noise;
        let noises = match spread(effect) {
            Some(Spread::Turbulence) => vec![Noise { turbulence: usual.turbulence, ..base.noise }],
            Some(Spread::LateFrames) => vec![base.noise],
            // Readings that are held look like air that is still, and then like a blow.
            Some(Spread::LostFrames) => {
                let before =
                    Noise { turbulence: usual.turbulence, measurement_m: usual.measurement_m, ..base.noise };
                vec![base.noise, before]
            }
            _ => vec![Noise { measurement_m: usual.measurement_m, ..base.noise }],
        };
        let (value, noise, start) = noises
            .into_iter()
            .flat_map(|noise| grid(&self.own).into_iter().map(move |values| (noise, values)))
            .map(|(noise, values)| (self.objective(base, &noise, &values), noise, values))
            .min_by(|a, b| a.0.total_cmp(&b.0))?;
        worth(self.problem, value, base).then_some((noise, start))
    }

    /// A search along each coordinate in turn, noise included; evidence from the curvature along each.
    fn descend(&self, base: &Fit, noise: Noise, start: Vec<f64>) -> Fit {
        let (usual, own) = (self.problem.noise, &self.own);
        // Coordinates: logarithms of process and tracker noise against their prior, then the effect's own.
        let mut x = vec![
            (noise.turbulence / usual.turbulence).ln(),
            (noise.measurement_m / usual.measurement_m).ln(),
        ];
        x.extend(start);
        let scaled = |x: &[f64]| Noise {
            turbulence: usual.turbulence * x[0].exp(),
            measurement_m: usual.measurement_m * x[1].exp(),
            ..base.noise
        };
        let at = |x: &[f64]| self.objective(base, &scaled(x), &x[2..]);
        let steps = [0.3, 0.06].into_iter().chain(own.iter().map(|f| 0.4 * f.sigma)).collect(); // numerical
        let (best, curvature) = descend(&at, &mut x, steps, base.objective);
        let sigmas: Vec<f64> =
            own.iter().zip(&curvature[2..]).map(|(f, c)| c.max(f.sigma.powi(-2)).sqrt().recip()).collect();
        let ln_width: f64 = own.iter().zip(&sigmas).map(|(f, sigma)| (sigma / f.sigma).ln()).sum();
        let ln_prior = self.ln_prior(&x[2..]);
        Fit {
            point: self.point(base, &x[2..]),
            noise: scaled(&x),
            random: own.iter().copied().zip(sigmas).collect(),
            random_ln: ln_prior + ln_width,
            objective: best + ln_prior,
            // The other coordinates' evidence is the base's: their curvature hardly changes with the noise.
            log_evidence: base.log_evidence + base.objective - best + ln_width,
            ..base.clone()
        }
    }
}

/// Searches along each coordinate in turn, by parabolas; the least value and the curvature along each. It ends early where
/// sweeps gain less than still lacks to what is there without.
fn descend(at: &dyn Fn(&[f64]) -> f64, x: &mut [f64], mut steps: Vec<f64>, without: f64) -> (f64, Vec<f64>) {
    let mut best = at(x);
    let mut curvature = vec![0.0; x.len()];
    for sweep in 1..=SWEEPS {
        let before = best;
        for i in 0..x.len() {
            let probe = |dx: f64| {
                let mut moved = x.to_vec();
                moved[i] += dx;
                at(&moved)
            };
            let h = steps[i];
            let (low, high) = (probe(-h), probe(h));
            let bend = low + high - 2.0 * best;
            curvature[i] = bend / (h * h);
            let dx = if bend > 1e-9 {
                (0.5 * h * (low - high) / bend).clamp(-3.0 * h, 3.0 * h) // numerical
            } else if low < high {
                -2.0 * h
            } else {
                2.0 * h
            };
            let moved = probe(dx);
            let (dx, value) = [(dx, moved), (-h, low), (h, high)]
                .into_iter()
                .min_by(|a, b| a.1.total_cmp(&b.1))
                .unwrap_or((0.0, best));
            if value < best {
                x[i] += dx;
                best = value;
            }
            steps[i] = (0.5 * h).max(dx.abs().min(h));
        }
        let hopeless = sweep >= LEAST_SWEEPS && before - best < best - without;
        if before - best < WORTH_A_SWEEP || hopeless {
            break;
        }
    }
    (best, curvature)
}
