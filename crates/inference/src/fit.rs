//! Fits a hypothesis to the flights: parameters by their posterior's mode, evidence by Laplace's method.

use bench_filter::{
    Coordinate, Direction, Noise, PROBES, Pairs, Pass, Point, Prediction, Track, added, is_random, nll,
    nll_of_all, predict, run, run_for,
};
use bench_plant::effects::{LIBRARY, PerNumber, Prior, RigNumber};
use bench_rig::Rig;
use bench_statistics::{Sorted, evenly_in_log, ln_det, median_high};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use crate::settle;

/// What all fits of one diagnosis share.
#[derive(Clone)]
pub struct Problem<'a> {
    /// The flights.
    pub tracks: &'a [Track],
    /// The nominal model.
    pub rig: &'a Rig,
    /// The rig's numbers.
    pub nominal: Point,
    /// One sigma of each; zero for those taken as exact.
    pub sigma: PerNumber<f64>,
    /// What is thought of the noise before any flight.
    pub noise: Noise,
    /// Altitude that all but a few sightings are below, m.
    pub top_m: f64,
}

/// A fitted hypothesis.
#[derive(Clone, Debug)]
pub struct Fit {
    /// The mode, effects included.
    pub point: Point,
    /// Noise at the mode, without what the point's random effects add.
    pub noise: Noise,
    /// Free coordinates.
    pub free: Vec<Free>,
    /// Coordinates of random effects with one sigma of each in its own scale.
    pub random: Vec<(Free, f64)>,
    /// What those coordinates' priors and widths add to the log-evidence.
    pub random_ln: f64,
    /// Hessian of the negative log-posterior over the free coordinates, each in its own scale.
    pub hessian: DMatrix<f64>,
    /// Its inverse.
    pub covariance: DMatrix<f64>,
    /// The negative log-posterior, but for constants.
    pub objective: f64,
    /// Natural logarithm of the evidence, but for a constant that all hypotheses share.
    pub log_evidence: f64,
    /// The last pass, at the mode, with the derivatives by the free coordinates.
    pub pass: Pass,
}

/// A coordinate that is fitted, with its prior in its own scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Free {
    /// Which.
    pub at: Coordinate,
    /// Whether it is fitted as its natural logarithm.
    pub logarithmic: bool,
    /// Prior mean, in its own scale.
    pub mean: f64,
    /// Prior standard deviation, in its own scale.
    pub sigma: f64,
    /// Range of the value.
    range: (f64, f64),
}

impl Fit {
    /// The effects' library indices.
    pub fn effects(&self) -> Vec<usize> {
        self.point.effect_indices()
    }

    /// Noise with what the point's random effects add.
    pub fn full_noise(&self, problem: &Problem<'_>) -> Noise {
        added(&self.point, &self.noise, problem.rig)
    }

    /// What forms of laws, and numbers of the rig, that are out of the usual speak against the hypothesis, nats: sizes of effects are
    /// not among them, which may be any, nor numbers that an effect of the library moves.
    pub fn odd_nats(&self) -> f64 {
        let beyond = |f: &Free| {
            let sigmas2 = ((f.own(self.point.get(f.at)) - f.mean) / f.sigma).powi(2);
            match f.at {
                Coordinate::Nuisance(RigNumber::ThrustOffset | RigNumber::Drag) => {
                    0.5 * (sigmas2 - ODD_SIGMAS.powi(2)).max(0.0)
                }
                Coordinate::Effect { slot, parameter }
                    if self.point.parameter(slot, parameter).default.is_some() =>
                {
                    ODD_FORM_NATS * (sigmas2 - ODD_FORM_SIGMAS.powi(2)).max(0.0)
                }
                _ => 0.0,
            }
        };
        self.free.iter().map(beyond).sum()
    }

    /// Slot, parameter, value, and the ends of an interval of so many sigma in the own scale, of each of the effects'
    /// parameters that were fitted; sigma is widened by a factor, and a fraction of the value is added to it in squares,
    /// but for parameters that are themselves the form of a law, and of a ceiling's height a fraction of what flights did
    /// not reach.
    pub fn effect_parameters(
        &self,
        problem: &Problem<'_>,
        sigmas: f64,
        widened: f64,
        fraction: f64,
    ) -> impl Iterator<Item = (usize, usize, f64, [f64; 2])> + '_ {
        let fitted = self.free.iter().enumerate().map(|(i, f)| (f, self.covariance[(i, i)].max(0.0).sqrt()));
        let random = self.random.iter().map(|(f, sigma)| (f, *sigma));
        let top_m = problem.top_m;
        fitted.chain(random).filter_map(move |(f, sigma)| {
            let Coordinate::Effect { slot, parameter } = f.at else { return None };
            let value = self.point.get(f.at);
            let described = self.point.parameter(slot, parameter);
            let vague = if described.key == CEILING { (value - top_m).abs() } else { value };
            let form = if f.logarithmic { fraction * vague / value } else { fraction * vague };
            let shapes = described.default.is_some();
            let half = sigmas * if shapes { sigma } else { widened * sigma.hypot(form) };
            let own = f.own(value);
            Some((slot, parameter, value, [f.value(own - half), f.value(own + half)]))
        })
    }
}

impl Free {
    /// A value in the coordinate's own scale: its natural logarithm, where [`Free::logarithmic`] says so.
    pub fn own(&self, value: f64) -> f64 {
        if self.logarithmic { value.max(1e-12).ln() } else { value }
    }

    /// The value at a place of the coordinate's own scale, within the coordinate's range.
    pub fn value(&self, own: f64) -> f64 {
        let value = if self.logarithmic { own.exp() } else { own };
        value.clamp(self.range.0, self.range.1)
    }

    /// Step for the derivative, in units of the value.
    fn step(&self, value: f64) -> f64 {
        let step = if self.logarithmic { 0.03 * value } else { 0.03 * self.sigma };
        if value + step > self.range.1 { -step } else { step }
    }

    /// Derivative of the value by the own scale.
    pub fn slope(&self, value: f64) -> f64 {
        if self.logarithmic { value } else { 1.0 }
    }
}

/// Uncertainty of the noise's logarithm before any flight: tracker, then turbulence.
const SIGHTING_SIGMA_LN: f64 = 0.05;
/// Calm air is ordinary, strong wind is not.
const CALM_SIGMA_LN: f64 = 1.0;
const WINDY_FROM_LN: f64 = 0.5;
const WINDY_SIGMA_LN: f64 = 0.2;
/// Memories of turbulence that are tried, s.
pub(crate) const TURBULENCE_TIMES_S: [f64; 4] = [0.25, 0.7, 1.5, 3.0];
const TURBULENCE_TIME_SIGMA_LN: f64 = 0.8;

/// How far the logarithm of a turbulence over the usual lies from it, in sigmas.
fn turbulence_sigmas(ln_ratio: f64) -> f64 {
    if ln_ratio < 0.0 {
        ln_ratio / CALM_SIGMA_LN
    } else {
        (ln_ratio - WINDY_FROM_LN).max(0.0) / WINDY_SIGMA_LN
    }
}
pub(crate) const MAX_PASSES: usize = 14;
const FIRST_DAMPING: f64 = 1e-3;
const MOST_DAMPING: f64 = 1e4;
/// A step that promises less, in nats, is not worth a pass.
pub(crate) const WORTH: f64 = 0.05;
/// No coordinate moves by more prior deviations at once.
const LONGEST_STEP: f64 = 2.0;

/// Noise of flights is levelled on a grid of its logarithm, so often: once with numbers fitted to flights as they are, once
/// with numbers fitted to levelled ones.
const LEVEL_STEP: f64 = 0.1;
const LEVEL_STEPS: i32 = 25;
const LEVEL_ROUNDS: usize = 2;

/// Numbers of the rig further off are taken for bent by an effect.
const BENT_SIGMAS: f64 = 3.0;
/// Numbers further off with all effects in, for bent by one that is not known.
const ODD_SIGMAS: f64 = 3.1;
/// The same of forms of laws, and how much each further sigma squared counts: their priors are wide, and end.
const ODD_FORM_SIGMAS: f64 = 2.2;
const ODD_FORM_NATS: f64 = 6.0;

/// The parameter that is started where flights end, and from how many heights.
const CEILING: &str = "ceiling_m";
const CEILING_STARTS: usize = 16;
/// From this share of the flights' top to this: no surface is far below where an airframe was seen.
const LOWEST_CEILING: f64 = 0.75;
const HIGHEST_CEILING: f64 = 1.3;
/// One sighting in so many may be of anything; flights that were never seen higher than so much, m, have no ceiling to be looked for.
const LOST_ONE_IN: usize = 200;
const LEAST_TOP_M: f64 = 0.1;

/// The share from which a form that is a share of the whole is started besides.
const SMALL_SHARE: f64 = 0.2;

/// An airframe that is held against a ceiling is seen within so many sigma below where flights were seen highest.
const HELD_SIGMAS: f64 = 4.0;
/// Shares of its ordinary gain with which a ceiling is tried that stopped flights.
const AGAINST_CEILING: [f64; 3] = [0.03, 0.2, 1.0];

/// Altitude that all but a few sightings are below, m.
fn top_m(tracks: &[Track]) -> f64 {
    let seen = tracks.iter().flat_map(|track| &track.sightings).map(|sighting| sighting.z_m);
    let top = Sorted::of(seen).trimmed_range(LOST_ONE_IN).map_or(0.0, |[_, high]| high);
    top.max(LEAST_TOP_M)
}

fn has_ceiling(effect: usize) -> bool {
    LIBRARY[effect].parameters.iter().any(|p| p.key == CEILING)
}

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

impl<'a> Problem<'a> {
    /// The problem of a rig and flights.
    pub fn new(tracks: &'a [Track], rig: &'a Rig) -> Self {
        let (nominal, sigma) = Point::nominal(rig);
        let noise = Noise::nominal(rig);
        Self { tracks, rig, nominal, sigma, noise, top_m: top_m(tracks) }
    }

    /// The rig's numbers that are not exact, with one sigma of each.
    pub fn uncertain(&self) -> impl Iterator<Item = (RigNumber, f64)> {
        RigNumber::ALL.into_iter().zip(self.sigma.0).filter(|(_, sigma)| *sigma > 0.0)
    }

    /// How many sightings are held against predictions.
    pub fn counted(&self) -> usize {
        self.tracks.iter().map(Track::counted).sum()
    }

    /// The same problem of other flights.
    pub fn with_tracks<'b>(&self, tracks: &'b [Track]) -> Problem<'b>
    where
        'a: 'b,
    {
        Problem { tracks, ..self.clone() }
    }

    /// How much stronger each flight's noise is than the rig says, as natural logarithms, where the rig says that flights
    /// differ (`noise_spread_ln`): found at a fit, by the prior that this spread is.
    pub fn level(&self, fit: &Fit) -> Vec<f64> {
        let Some(spread) = self.rig.disturbance.noise_spread_ln else { return vec![0.0; self.tracks.len()] };
        let noise = fit.full_noise(self);
        self.tracks
            .par_iter()
            .map(|track| {
                let objective = |ln: f64| {
                    let track_noise = noise.times((ln - track.ln_noise).exp());
                    nll(track, self.rig, &fit.point, &track_noise) + 0.5 * (ln / spread).powi(2)
                };
                let steps = (-LEVEL_STEPS..=LEVEL_STEPS).map(|k| LEVEL_STEP * f64::from(k));
                steps
                    .map(|ln| (objective(ln), ln))
                    .min_by(|a, b| a.0.total_cmp(&b.0))
                    .map_or(0.0, |(_, ln)| ln)
            })
            .collect()
    }

    /// The flights with their noise levelled, where the rig says that it differs from flight to flight.
    pub fn levelled(&self) -> Option<Vec<Track>> {
        self.rig.disturbance.noise_spread_ln?;
        let mut tracks = self.tracks.to_vec();
        for _ in 0..LEVEL_ROUNDS {
            let problem = self.with_tracks(&tracks);
            let levels = problem.level(&problem.fit_null());
            for (track, ln) in tracks.iter_mut().zip(levels) {
                track.ln_noise = ln;
            }
        }
        Some(tracks)
    }

    /// The null hypothesis: the rig's numbers within their tolerances, no effect. It also finds for how long the
    /// turbulence of these flights remembers, unless the rig says so, which all other hypotheses take over.
    pub fn fit_null(&self) -> Fit {
        let fit = self.refine(self.nominal.clone(), self.noise);
        if self.rig.disturbance.turbulence_time_s.is_some() {
            return fit;
        }
        let with = |turbulence_time_s: f64| Noise { turbulence_time_s, ..fit.noise };
        let objective = |time_s: f64| {
            self.objective(&fit.point, &with(time_s), &fit.free)
                + 0.5 * ((time_s / self.noise.turbulence_time_s).ln() / TURBULENCE_TIME_SIGMA_LN).powi(2)
        };
        let best = TURBULENCE_TIMES_S
            .par_iter()
            .map(|time_s| (objective(*time_s), *time_s))
            .collect::<Vec<_>>()
            .into_iter()
            .min_by(|a, b| a.0.total_cmp(&b.0));
        match best {
            Some((_, time_s)) if time_s != fit.noise.turbulence_time_s => {
                self.refine(fit.point.clone(), with(time_s))
            }
            _ => fit,
        }
    }

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
                    vec![median, median * (1.2 * sigma_ln).exp()]
                }
                // A small part that reaches far is like no whole that reaches less far.
                (Prior::Normal { .. }, _) if p.default == Some(1.0) => vec![1.0, SMALL_SHARE],
                _ if p.default.is_some() => p.default.into_iter().collect(),
                (Prior::Normal { mean, sigma }, Some(_)) => vec![mean, mean + sigma, mean - sigma],
                (Prior::Normal { mean, sigma }, None) => vec![mean - sigma, mean, mean + sigma],
                (Prior::LogNormal { median, sigma_ln }, _) => {
                    [-1.2, 0.0, 1.2].map(|k| median * (k * sigma_ln).exp()).to_vec()
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
        let below_m = highest_m - HELD_SIGMAS * self.noise.sighting_m;
        let held_m: Vec<f64> = self
            .tracks
            .iter()
            .flat_map(|track| &track.sightings)
            .map(|sighting| sighting.z_m)
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

    /// The flights as a point predicts them, nothing fitted, in their order.
    pub fn predict(&self, point: &Point, noise: &Noise) -> Vec<Prediction> {
        self.tracks.par_iter().map(|track| predict(track, self.rig, point, noise)).collect()
    }

    /// Levenberg-Marquardt on the posterior, noise included, from a start.
    pub fn refine(&self, start: Point, noise: Noise) -> Fit {
        let mut descent = self.descent(start, noise, usize::MAX);
        descent.go(self, MAX_PASSES, WORTH);
        descent.into_fit()
    }

    /// A fit that has not begun. Effects from the given slot on keep their plainest form until it is unfolded.
    pub(crate) fn descent(&self, start: Point, noise: Noise, plain_from: usize) -> Descent {
        let free = self.free(&start, plain_from);
        let here = self.look(start, noise, &free);
        Descent { free, here, damping: FIRST_DAMPING, passes: 1 }
    }

    fn look(&self, point: Point, noise: Noise, free: &[Free]) -> Look {
        let full = added(&point, &noise, self.rig);
        let pass = run(self.tracks, self.rig, &point, &full, &directions(free, &point));
        let (hessian, gradient) = normal_equations(&point, free, &pass);
        let noise_step = self.noise_step(&noise, &pass);
        let objective = pass.nll + self.prior(&point, &noise, free);
        Look { point, noise, pass, hessian, gradient, noise_step, objective }
    }

    /// Log-likelihood of all flights, but for constants.
    pub fn log_likelihood(&self, point: &Point, noise: &Noise) -> f64 {
        -nll_of_all(self.tracks, self.rig, point, &added(point, noise, self.rig))
    }

    /// Negative log-posterior at a point, but for constants.
    pub fn objective(&self, point: &Point, noise: &Noise, free: &[Free]) -> f64 {
        let full = added(point, noise, self.rig);
        nll_of_all(self.tracks, self.rig, point, &full) + self.prior(point, noise, free)
    }

    fn prior(&self, point: &Point, noise: &Noise, free: &[Free]) -> f64 {
        let numbers: f64 =
            free.iter().map(|f| 0.5 * ((f.own(point.get(f.at)) - f.mean) / f.sigma).powi(2)).sum();
        let sighting = (noise.sighting_m / self.noise.sighting_m).ln() / SIGHTING_SIGMA_LN;
        let turbulence = turbulence_sigmas((noise.turbulence / self.noise.turbulence).ln());
        numbers + 0.5 * (sighting * sighting + turbulence * turbulence) + settle::prior(self, noise)
    }

    /// Newton steps of the logarithms of turbulence and tracker noise, and what they promise, from parabolas through the
    /// probes.
    fn noise_step(&self, noise: &Noise, pass: &Pass) -> (f64, f64, f64) {
        let own = [
            ((noise.turbulence / self.noise.turbulence).ln(), None, 0.8),
            ((noise.sighting_m / self.noise.sighting_m).ln(), Some(SIGHTING_SIGMA_LN), 0.3),
        ];
        let mut steps = [0.0; 2];
        let mut worth = 0.0;
        for (i, (at, sigma, longest)) in own.into_iter().enumerate() {
            let h = PROBES[2 * i + 1];
            let sigmas =
                |x: f64| sigma.map_or_else(|| turbulence_sigmas(at + x), |sigma: f64| (at + x) / sigma);
            let prior = |x: f64| 0.5 * sigmas(x).powi(2);
            let low = pass.noise_nll[2 * i] + prior(-h);
            let high = pass.noise_nll[2 * i + 1] + prior(h);
            let mid = pass.nll + prior(0.0);
            let (slope, curvature) = ((high - low) / (2.0 * h), (low + high - 2.0 * mid) / (h * h));
            let step = if curvature > 1e-9 { -slope / curvature } else { -slope.signum() * h };
            steps[i] = step.clamp(-longest, longest);
            worth += (-slope * steps[i] - 0.5 * curvature * steps[i] * steps[i]).max(0.0);
        }
        (steps[0], steps[1], worth)
    }

    /// The coordinates that are fitted: uncertain numbers of the rig, and parameters of the point's effects whose law moves
    /// the prediction: all of those before the given slot, of the others those that do not have their default.
    fn free(&self, point: &Point, plain_from: usize) -> Vec<Free> {
        let mut free = Vec::new();
        for (number, sigma) in self.uncertain() {
            let mean = self.nominal.nuisances[number];
            let low = if mean > 0.0 { 0.02 * mean } else { mean - 50.0 * sigma };
            free.push(Free {
                at: Coordinate::Nuisance(number),
                logarithmic: false,
                mean,
                sigma,
                range: (low, mean.abs() * 10.0 + 50.0 * sigma),
            });
        }
        for (slot, (effect, values)) in point.effects.iter().enumerate() {
            if !is_random(*effect) {
                let parameters = LIBRARY[*effect].parameters;
                let shaped = slot < plain_from;
                free.extend(
                    effect_coordinates(slot, *effect)
                        .zip(parameters.iter().zip(values))
                        .filter(|(_, (p, value))| shaped || p.default != Some(**value))
                        .map(|(f, (p, _))| match p.key {
                            CEILING => Free { range: (LOWEST_CEILING * self.top_m, f.range.1), ..f },
                            _ => f,
                        }),
                );
            }
        }
        free
    }
}

/// Free coordinates with steps for their derivatives.
pub fn directions(free: &[Free], point: &Point) -> Vec<Direction> {
    free.iter().map(|f| Direction::Coordinate(f.at, f.step(point.get(f.at)))).collect()
}

/// The coordinates of one effect.
pub(crate) fn effect_coordinates(slot: usize, effect: usize) -> impl Iterator<Item = Free> {
    LIBRARY[effect].parameters.iter().enumerate().map(move |(parameter, p)| {
        let (logarithmic, mean, sigma) = match p.prior {
            Prior::Normal { mean, sigma } => (false, mean, sigma),
            Prior::LogNormal { median, sigma_ln } => (true, median.ln(), sigma_ln),
        };
        let limits = LIBRARY[effect].signature.fitted_up_to;
        let most = limits.iter().find(|(key, _)| *key == p.key).map_or(p.max, |(_, most)| *most);
        Free { at: Coordinate::Effect { slot, parameter }, logarithmic, mean, sigma, range: (p.min, most) }
    })
}

/// A fit under way.
pub(crate) struct Descent {
    free: Vec<Free>,
    here: Look,
    damping: f64,
    passes: usize,
}

impl Descent {
    /// Goes on until a step promises less than so many nats, or so many passes are made in all.
    pub(crate) fn go(&mut self, problem: &Problem<'_>, most: usize, worth: f64) {
        while self.passes < most && self.step(problem, worth) {}
    }

    /// Frees the parameters that give effects another than their plainest form.
    pub(crate) fn unfold(&mut self, problem: &Problem<'_>) {
        let free = problem.free(&self.here.point, usize::MAX);
        if free.len() > self.free.len() {
            self.here = problem.look(self.here.point.clone(), self.here.noise, &free);
            self.free = free;
            self.passes += 1;
        }
    }

    /// The effects of the hypothesis.
    pub(crate) fn effects(&self) -> Vec<usize> {
        self.here.point.effect_indices()
    }

    /// The negative log-posterior here, but for constants.
    pub(crate) fn objective(&self) -> f64 {
        self.here.objective
    }

    /// Logarithm of the evidence here.
    pub(crate) fn log_evidence(&self) -> f64 {
        log_evidence(self.here.objective, &self.free, &self.here.hessian)
    }

    /// What the next step promises, nats: none where there is none.
    pub(crate) fn promise(&self) -> f64 {
        self.next().map_or(0.0, |(_, promise)| promise)
    }

    /// Whether it led nowhere of late: its last step was no good, or the next does not promise so many nats.
    pub(crate) fn stopped(&self, worth: f64) -> bool {
        self.damping > FIRST_DAMPING || self.promise() < worth
    }

    /// The next step of the coordinates, and what it, were it as long as it would, and that of the noise promise, nats.
    fn next(&self) -> Option<(DVector<f64>, f64)> {
        if self.damping > MOST_DAMPING {
            return None;
        }
        let (hessian, gradient) = within_ranges(&self.free, &self.here);
        let hessian = damped(&hessian, self.damping);
        let whole = hessian.clone().cholesky()?.solve(&gradient);
        let step = limited_step(&self.free, &hessian, &gradient)?;
        Some((step, 0.5 * gradient.dot(&whole) + self.here.noise_step.2))
    }

    /// One pass, where its step promises so many nats; whether it was made.
    fn step(&mut self, problem: &Problem<'_>, worth: f64) -> bool {
        let Some((step, _)) = self.next().filter(|(_, promise)| *promise >= worth) else { return false };
        let here = &mut self.here;
        let mut point = here.point.clone();
        for (f, dx) in self.free.iter().zip(step.iter()) {
            *point.get_mut(f.at) = f.value(f.own(point.get(f.at)) + dx);
        }
        let mut noise = here.noise;
        noise.turbulence *= here.noise_step.0.exp();
        noise.sighting_m *= here.noise_step.1.exp();
        self.passes += 1;
        // Two steps in five lead nowhere: derivatives, which cost ten times as much, are for the others.
        if problem.objective(&point, &noise, &self.free) < here.objective {
            self.here = problem.look(point, noise, &self.free);
            self.damping = (self.damping * 0.2).max(1e-6);
        } else {
            self.damping = (self.damping * 8.0).max(0.01);
            here.noise_step = (0.5 * here.noise_step.0, 0.5 * here.noise_step.1, 0.5 * here.noise_step.2);
        }
        true
    }

    pub(crate) fn into_fit(self) -> Fit {
        self.here.into_fit(self.free)
    }
}

/// Hessian and gradient of a point, in which coordinates that stand at an end of their range and would leave it are held.
fn within_ranges(free: &[Free], here: &Look) -> (DMatrix<f64>, DVector<f64>) {
    let (mut hessian, mut gradient) = (here.hessian.clone(), here.gradient.clone());
    for (i, f) in free.iter().enumerate() {
        let value = here.point.get(f.at);
        if value <= f.range.0 && gradient[i] < 0.0 || value >= f.range.1 && gradient[i] > 0.0 {
            hold(&mut hessian, &mut gradient, i, 0.0);
        }
    }
    (hessian, gradient)
}

/// A point of the posterior with its derivatives.
struct Look {
    point: Point,
    noise: Noise,
    pass: Pass,
    hessian: DMatrix<f64>,
    gradient: DVector<f64>,
    noise_step: (f64, f64, f64),
    objective: f64,
}

impl Look {
    fn into_fit(self, free: Vec<Free>) -> Fit {
        let log_evidence = log_evidence(self.objective, &free, &self.hessian);
        let covariance =
            self.hessian.clone().try_inverse().unwrap_or_else(|| DMatrix::zeros(free.len(), free.len()));
        Fit {
            point: self.point,
            noise: self.noise,
            free,
            random: Vec::new(),
            random_ln: 0.0,
            hessian: self.hessian,
            covariance,
            objective: self.objective,
            log_evidence,
            pass: self.pass,
        }
    }
}

/// Hessian and gradient of the log-posterior over the free coordinates, each in its own scale (Gauss-Newton).
fn normal_equations(point: &Point, free: &[Free], pass: &Pass) -> (DMatrix<f64>, DVector<f64>) {
    let slopes = DVector::from_iterator(free.len(), free.iter().map(|f| f.slope(point.get(f.at))));
    let mut hessian =
        DMatrix::from_fn(free.len(), free.len(), |i, j| pass.information[(i, j)] * slopes[i] * slopes[j]);
    let mut gradient = pass.gradient.component_mul(&slopes);
    for (i, f) in free.iter().enumerate() {
        let precision = f.sigma.powi(-2);
        hessian[(i, i)] += precision;
        gradient[i] -= (f.own(point.get(f.at)) - f.mean) * precision;
    }
    (hessian, gradient)
}

/// What the coordinates of a point, which a pass has first, leave of information and gradient of its other directions
/// (Schur complement); `None` where they are not determined.
pub fn project(free: &[Free], point: &Point, pass: &Pass) -> Option<(DMatrix<f64>, DVector<f64>)> {
    let fitted = free.len();
    let rest = pass.gradient.len() - fitted;
    let (own, own_gradient) = with_prior(free, point, pass);
    let own = own.cholesky()?;
    let cross = pass.information.view((fitted, 0), (rest, fitted));
    Some((
        pass.information.view((fitted, fitted), (rest, rest)) - cross * own.solve(&cross.transpose()),
        pass.gradient.rows(fitted, rest) - cross * own.solve(&own_gradient),
    ))
}

/// Information and gradient over the values of the coordinates of a point, which a pass has first, with their priors.
fn with_prior(free: &[Free], point: &Point, pass: &Pass) -> (DMatrix<f64>, DVector<f64>) {
    let n = free.len();
    let mut information = pass.information.view((0, 0), (n, n)).into_owned();
    let mut gradient = pass.gradient.rows(0, n).into_owned();
    for (i, f) in free.iter().enumerate() {
        let value = point.get(f.at);
        let per_value = f.slope(value).recip();
        information[(i, i)] += (per_value / f.sigma).powi(2);
        gradient[i] -= (f.own(value) - f.mean) / (f.sigma * f.sigma) * per_value;
    }
    (information, gradient)
}

/// `ln Z = ln L + ln prior - 1/2 ln det H` at the mode, powers of 2 pi cancelling (`MacKay`, *Information Theory,
/// Inference, and Learning Algorithms*, chapter 27).
fn log_evidence(objective: f64, free: &[Free], hessian: &DMatrix<f64>) -> f64 {
    let ln_prior_widths: f64 = free.iter().map(|f| f.sigma.ln()).sum();
    let half_ln_det = hessian.clone().cholesky().map_or(f64::INFINITY, |c| 0.5 * ln_det(&c));
    -objective - ln_prior_widths - half_ln_det
}

fn damped(hessian: &DMatrix<f64>, damping: f64) -> DMatrix<f64> {
    let mut damped = hessian.clone();
    for i in 0..damped.nrows() {
        damped[(i, i)] *= 1.0 + damping;
    }
    damped
}

/// The Newton step in which no coordinate moves by more than a few of its prior's deviations: the others move to
/// where they are best beside those that are held back, or what two of them do together would come apart.
pub fn limited_step(free: &[Free], hessian: &DMatrix<f64>, gradient: &DVector<f64>) -> Option<DVector<f64>> {
    let (mut hessian, mut gradient) = (hessian.clone(), gradient.clone());
    let mut held = vec![false; free.len()];
    loop {
        let step = hessian.clone().cholesky()?.solve(&gradient);
        let limit = |i: usize| LONGEST_STEP * free[i].sigma;
        let beyond: Vec<usize> =
            (0..free.len()).filter(|i| !held[*i] && step[*i].abs() > limit(*i)).collect();
        if beyond.is_empty() {
            return Some(step);
        }
        for i in beyond {
            held[i] = true;
            let at = step[i].clamp(-limit(i), limit(i));
            gradient -= hessian.column(i) * at;
            hold(&mut hessian, &mut gradient, i, at);
        }
    }
}

/// Makes one coordinate of a step what it is to be.
fn hold(hessian: &mut DMatrix<f64>, gradient: &mut DVector<f64>, i: usize, at: f64) {
    hessian.row_mut(i).fill(0.0);
    hessian.column_mut(i).fill(0.0);
    hessian[(i, i)] = 1.0;
    gradient[i] = at;
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
    let least = if has_ceiling(effect) { 0.05 } else { 0.2 };
    if either_sign { (-4.0, 4.0) } else { (least, 3.0) }
}

/// Every choice of one value from each list, the last list's changing first.
pub(crate) fn every_choice(lists: impl Iterator<Item = Vec<f64>>) -> Vec<Vec<f64>> {
    lists.fold(vec![Vec::new()], |heads, values| {
        let with = |head: &Vec<f64>, value: f64| [head.as_slice(), &[value]].concat();
        heads.iter().flat_map(|head| values.iter().map(move |value| with(head, *value))).collect()
    })
}
