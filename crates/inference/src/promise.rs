//! Where to start fitting an effect on top of a fit, and what that promises.

use bench_filter::{Coordinate, Direction, Pairs, Point, Track, run_for};
use bench_plant::effects::{LIBRARY, Prior};
use bench_statistics::{FAR_SIGMAS, evenly_in_log, median_high};

use crate::{
    coordinate::{CEILING, LOWEST_CEILING, directions, every_choice, with_prior},
    fit::{Fit, Problem},
};

/// Numbers of the rig further off are taken for bent by an effect.
const BENT_SIGMAS: f64 = 3.0;
/// From how many heights a ceiling is started, up to this share of the flights' top.
const CEILING_STARTS: usize = 16; // numerical
const HIGHEST_CEILING: f64 = 1.3;

/// The share from which a form that is a share of the whole is started besides.
const SMALL_SHARE: f64 = 0.2;

/// Shares of its ordinary gain with which a ceiling is tried that stopped flights.
const AGAINST_CEILING: [f64; 3] = [0.03, 0.2, 1.0]; // numerical

/// A straight line is followed so far at most.
const STRAIGHT_SIGMAS: f64 = 1.0;

/// What a start promises, by linear extrapolation from a fit without it.
#[derive(Clone, Debug)]
pub struct Promise {
    /// The effect's library index.
    pub effect: usize,
    /// Gain of log-posterior, nats, the prior of the effect left out.
    pub gain: f64,
    /// Where to start.
    pub start: Point,
    /// Other starts, of other sizes or shapes, with what they promise, most first.
    pub others: Vec<(f64, Point)>,
}

/// Adds a start to the promises: of each effect the best leads.
fn add_start(promises: &mut Vec<Promise>, effect: usize, gain: f64, start: Point) {
    match promises.iter_mut().find(|other| other.effect == effect) {
        Some(promise) if promise.gain < gain => {
            let lesser = (promise.gain, std::mem::replace(&mut promise.start, start));
            promise.gain = gain;
            promise.others.push(lesser);
        }
        Some(promise) => promise.others.push((gain, start)),
        None => promises.push(Promise { effect, gain, start, others: Vec::new() }),
    }
}

impl Problem<'_> {
    /// Where to start fitting each of the effects on top of a fit, and what that promises, most first: a finite
    /// difference of its law at several sizes and shapes, projected on what else can move. The fit's numbers may have
    /// been bent to do the effect's work, too far for a straight line back: so also from the rig's own numbers.
    pub fn promises(&self, base: &Fit, effects: &[usize], most: usize) -> Vec<Promise> {
        let own_numbers = Point { nuisances: self.nominal.nuisances, ..base.point.clone() };
        let ranked = |point: &Point, most: usize| {
            let mut promises = self.promises_at(base, point, effects);
            promises.sort_by(|a, b| b.gain.total_cmp(&a.gain));
            promises.truncate(most);
            promises
        };
        let mut promises = ranked(&base.point, most);
        // Where the numbers are bent far, a straight line from the rig's own promises nothing to be compared.
        let bent = base.free.iter().any(|f| match f.at {
            Coordinate::Nuisance(i) => (base.point.nuisances[i] - f.mean).abs() > BENT_SIGMAS * f.sigma,
            Coordinate::Effect { .. } => false,
        });
        let most = if bent {
            most
        } else if base.point.effects.is_empty() {
            most / 3
        } else {
            0
        };
        if most > 0 {
            promises.extend(ranked(&own_numbers, most));
        }
        promises
    }

    /// Values of an effect's parameters to start from: sizes of either sign at one sigma, alone and together, others over
    /// their prior; the plainest form, and of a form that is a delay also one sigma of it, as what acts at once may have no
    /// size at which it is like what acts late; of one that is the ratio of one way to the other, also another ratio, as what rectifies
    /// is like nothing that does not, and of one that is a share of the whole, a small share; a ceiling from many heights about where
    /// flights end, for it is narrow.
    pub fn start_values(&self, effect: usize) -> Vec<Vec<f64>> {
        let under_ceiling = has_ceiling(effect);
        let mut grid = every_choice(LIBRARY[effect].parameters.iter().map(|p| {
            let values: Vec<f64> = match (p.prior, p.neutral) {
                // Its gain acts in proportion, and is stretched as the flights promise.
                (Prior::LogNormal { median, .. }, Some(_)) if under_ceiling => vec![median],
                _ if p.key == CEILING => self.ceilings_m(),
                (Prior::Normal { mean, sigma }, _) if p.default.is_some() && p.unit == "s" => {
                    vec![mean, mean + sigma]
                }
                (Prior::LogNormal { median, sigma_ln }, _) if p.default == Some(1.0) && !under_ceiling => {
                    vec![median, median * (1.2 * sigma_ln).exp()] // numerical
                }
                // A small part that reaches far is like no whole that reaches less far.
                (Prior::Normal { .. }, _) if p.default == Some(1.0) => vec![1.0, SMALL_SHARE],
                _ if p.default.is_some() => p.default.into_iter().collect(),
                (Prior::Normal { mean, sigma }, Some(_)) => vec![mean, mean + sigma, mean - sigma],
                (Prior::Normal { mean, sigma }, None) => vec![mean - sigma, mean, mean + sigma],
                (Prior::LogNormal { median, sigma_ln }, _) => {
                    [-1.2, 0.0, 1.2].map(|k| median * (k * sigma_ln).exp()).to_vec() // numerical
                }
            };
            values.into_iter().map(|value| value.clamp(p.min, p.max)).collect()
        }));
        // Not where the effect vanishes.
        grid.retain(|values| {
            let parameters = LIBRARY[effect].parameters.iter().zip(values);
            parameters.clone().any(|(p, value)| p.neutral.is_some_and(|n| n != *value))
        });
        grid
    }

    /// A point with a ceiling that stopped the flights where they were seen highest, or where they were held, for several shapes of
    /// its gain.
    fn against_ceiling(&self, point: &Point, effect: usize) -> Vec<Point> {
        let highest_m = self.tracks.iter().map(Track::highest_m).fold(self.top_m, f64::max);
        let below_m = highest_m - FAR_SIGMAS * self.noise.measurement_m;
        let held_m: Vec<f64> = self
            .tracks
            .iter()
            .flat_map(|track| &track.measurements)
            .map(|measurement| measurement.z_m)
            .filter(|z_m| *z_m > below_m)
            .collect();
        let held_m = median_high(held_m).unwrap_or(highest_m);
        let grid = every_choice(LIBRARY[effect].parameters.iter().map(|p| {
            let values = match p.prior {
                _ if p.key == CEILING => vec![highest_m, held_m],
                _ if p.default.is_some() => p.default.into_iter().collect(),
                // Flights that are pushed against it hard were gained hardly anything before.
                Prior::LogNormal { median, .. } if p.neutral.is_some() => {
                    AGAINST_CEILING.map(|share| share * median).to_vec()
                }
                prior => vec![prior.typical()],
            };
            values.into_iter().map(|value| value.clamp(p.min, p.max)).collect()
        }));
        let with =
            |values| Point { effects: [&point.effects[..], &[(effect, values)]].concat(), ..point.clone() };
        grid.into_iter().map(with).collect()
    }

    /// Heights from which a ceiling is looked for, m, even in the logarithm.
    fn ceilings_m(&self) -> Vec<f64> {
        evenly_in_log(LOWEST_CEILING * self.top_m, HIGHEST_CEILING * self.top_m, CEILING_STARTS).collect()
    }

    fn promises_at(&self, base: &Fit, point: &Point, effects: &[usize]) -> Vec<Promise> {
        let free = &base.free;
        let mut directions = directions(free, point);
        let fitted = directions.len();
        let mut starts = Vec::new();
        for effect in effects {
            for values in self.start_values(*effect) {
                directions.push(Direction::Added(*effect, values.clone()));
                starts.push((*effect, values));
            }
        }
        let noise = base.full_noise(self);
        let pairs = Pairs::Arrow { head: fitted, block: 1 };
        let pass = run_for(self.tracks, self.rig, point, &noise, &directions, pairs);
        let objective = pass.nll + self.prior(point, &base.noise, free);
        let (own, own_gradient) = with_prior(free, point, &pass);
        let Some(own) = own.cholesky() else { return Vec::new() };
        let alone = own.solve(&own_gradient);
        // What the numbers alone still gain from here.
        let numbers_gain = 0.5 * own_gradient.dot(&alone);
        let mut best: Vec<Promise> = Vec::new();
        for (i, (effect, values)) in starts.into_iter().enumerate() {
            let at = fitted + i;
            let cross = pass.information.view((at, 0), (1, fitted)).transpose();
            let moved = own.solve(&cross);
            let information = pass.information[(at, at)] - cross.dot(&moved);
            let gradient = pass.gradient[at] - moved.dot(&own_gradient);
            if information.partial_cmp(&1e-9) != Some(std::cmp::Ordering::Greater) {
                continue;
            }
            let (low, high) = amplitudes(effect);
            let amplitude = (gradient / information).clamp(low, high);
            let gain = amplitude * gradient - 0.5 * amplitude * amplitude * information
                + numbers_gain
                + base.objective
                - objective;
            let mut start = point.clone();
            for ((f, shift), alone) in free.iter().zip(moved.iter()).zip(alone.iter()) {
                let limit = STRAIGHT_SIGMAS * f.sigma / f.slope(point.get(f.at)).recip().abs();
                let value = start.get(f.at) + (alone - amplitude * shift).clamp(-limit, limit);
                *start.get_mut(f.at) = f.value(f.own(value));
            }
            let scaled = LIBRARY[effect].parameters.iter().zip(values).map(|(p, value)| match p.neutral {
                _ if p.default.is_some() => value,
                Some(neutral) => (neutral + amplitude * (value - neutral)).clamp(p.min, p.max),
                None => value,
            });
            start.effects.push((effect, scaled.collect()));
            add_start(&mut best, effect, gain, start);
        }
        for effect in effects.iter().filter(|effect| has_ceiling(**effect)) {
            for start in self.against_ceiling(point, *effect) {
                // No straight line leads there: what stops a flight does so altogether.
                let gain = base.objective - self.objective(&start, &base.noise, free);
                add_start(&mut best, *effect, gain, start);
            }
        }
        for promise in &mut best {
            promise.others.sort_by(|a, b| b.0.total_cmp(&a.0));
        }
        best
    }
}

fn has_ceiling(effect: usize) -> bool {
    LIBRARY[effect].parameters.iter().any(|p| p.key == CEILING)
}

/// How far a start may be stretched when its effect is taken as linear in its sizes: to the other side where sizes have
/// either sign.
fn amplitudes(effect: usize) -> (f64, f64) {
    let either_sign = LIBRARY[effect]
        .parameters
        .iter()
        .filter(|p| p.neutral.is_some())
        .all(|p| matches!(p.prior, Prior::Normal { .. }));
    // Of a ceiling little is seen where it is a step.
    let least = if has_ceiling(effect) { 0.05 } else { 0.2 }; // numerical
    if either_sign { (-4.0, 4.0) } else { (least, 3.0) } // numerical
}
