//! The posterior of a hypothesis about the flights, its parts, and what a fit of it holds.

use bench_filter::{
    Coordinate, Noise, Pass, Point, Prediction, Track, added, is_random, nll, nll_of_all, predict,
};
use bench_plant::effects::{LIBRARY, PerNumber, RigNumber};
use bench_rig::{EffectEntry, Location, Rig};
use bench_statistics::Sorted;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use crate::{
    coordinate::{CEILING, Free, LOWEST_CEILING, effect_coordinates},
    settle::{self, with_likeliest_time},
};

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
    /// Altitude that all but a few measurements are below, m.
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
    /// Its inverse; the priors' variances where it has none ([`Fit::is_singular`]).
    pub covariance: DMatrix<f64>,
    /// The negative log-posterior, but for constants.
    pub objective: f64,
    /// Natural logarithm of the evidence, but for a constant that all hypotheses share.
    pub log_evidence: f64,
    /// The last pass, at the mode, with the derivatives by the free coordinates.
    pub pass: Pass,
}

impl Fit {
    /// The effects' library indices.
    pub fn effects(&self) -> Vec<usize> {
        self.point.effect_indices()
    }

    /// The effects with their values, as a rig lists them.
    pub fn as_listed(&self) -> Vec<EffectEntry> {
        let entry = |(effect, values): &(usize, Vec<f64>)| {
            let spec = LIBRARY[*effect];
            EffectEntry {
                name: spec.name.to_owned(),
                parameters: spec
                    .parameters
                    .iter()
                    .zip(values)
                    .map(|(p, value)| (p.key.to_owned(), *value, 0))
                    .collect(),
                at: Location { file: "identified".into(), line: 0 },
            }
        };
        self.point.effects.iter().map(entry).collect()
    }

    /// Whether the Hessian is not positive definite: the flights then do not say how far the numbers are off, and the fit has no evidence.
    pub fn is_singular(&self) -> bool {
        !self.log_evidence.is_finite()
    }

    /// Noise with what the point's random effects add.
    pub fn full_noise(&self, problem: &Problem<'_>) -> Noise {
        added(&self.point, &self.noise, problem.rig)
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

    /// The mode without one of the flights, by one Newton step: without it, its share of the gradient is what is left.
    pub fn point_without(&self, track: usize) -> Point {
        let Some(pass) = self.pass.tracks.get(track) else { return self.point.clone() };
        let slopes =
            DVector::from_iterator(self.free.len(), self.free.iter().map(|f| f.slope(self.point.get(f.at))));
        if pass.gradient.len() != slopes.len() {
            return self.point.clone();
        }
        let mut hessian = self.hessian.clone();
        for i in 0..slopes.len() {
            for j in 0..slopes.len() {
                hessian[(i, j)] -= pass.information[(i, j)] * slopes[i] * slopes[j];
            }
        }
        let gradient = -pass.gradient.component_mul(&slopes);
        let Some(step) = hessian.cholesky().map(|h| h.solve(&gradient)) else { return self.point.clone() };
        let mut point = self.point.clone();
        for (f, dx) in self.free.iter().zip(step.iter()) {
            let limit = 2.0 * f.sigma;
            *point.get_mut(f.at) = f.value(f.own(point.get(f.at)) + dx.clamp(-limit, limit));
        }
        point
    }
}

/// Uncertainty of the logarithm of a measurement's noise before any flight.
pub(crate) const MEASUREMENT_SIGMA_LN: f64 = 0.05;
/// The same of the turbulence and of its correlation time, where the rig tells them without a spread: air is not the same every day.
const TOLD_TURBULENCE_SIGMA_LN: f64 = 0.25;
const TOLD_TURBULENCE_TIME_SIGMA_LN: f64 = 0.3;
/// The same where the rig tells nothing: from a third to three times the usual within three of these. Air that is twenty times as rough
/// must still be gusts.
const ANY_TURBULENCE_SIGMA_LN: f64 = 0.4;
const ANY_TURBULENCE_TIME_SIGMA_LN: f64 = 0.8;
/// Correlation times of turbulence that are tried, s.
pub(crate) const TURBULENCE_TIMES_S: [f64; 4] = [0.25, 0.7, 1.5, 3.0]; // numerical

/// Noise of flights is levelled on a grid of its logarithm, so often: once with numbers fitted to flights as they are, once
/// with numbers fitted to levelled ones.
const LEVEL_STEP: f64 = 0.1; // numerical
const LEVEL_STEPS: i32 = 25; // numerical
const LEVEL_ROUNDS: usize = 2; // numerical

/// One measurement in so many may be of anything; flights that were never seen higher than so much, m, have no ceiling to be looked for.
const LOST_ONE_IN: usize = 200;
const LEAST_TOP_M: f64 = 0.1;

/// Altitude that all but a few measurements are below, m.
fn top_m(tracks: &[Track]) -> f64 {
    let seen = tracks.iter().flat_map(|track| &track.measurements).map(|measurement| measurement.z_m);
    let top = Sorted::of(seen).trimmed_range(LOST_ONE_IN).map_or(0.0, |[_, high]| high);
    top.max(LEAST_TOP_M)
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

    /// How many measurements are held against predictions.
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

    /// The null hypothesis: the rig's numbers within their tolerances, no effect, and turbulence of the likeliest correlation time
    /// beside them, which all other hypotheses take over.
    pub fn fit_null(&self) -> Fit {
        let fit = self.refine(self.nominal.clone(), self.noise);
        let noise = with_likeliest_time(self, &fit, fit.noise, fit.objective);
        if noise == fit.noise { fit } else { self.refine(fit.point, noise) }
    }

    /// One sigma of the logarithm of the turbulence before any flight.
    pub(crate) fn turbulence_sigma_ln(&self) -> f64 {
        let air = &self.rig.disturbance;
        let told = air.turbulence_m_s2.map(|_| air.turbulence_spread_ln.unwrap_or(TOLD_TURBULENCE_SIGMA_LN));
        told.unwrap_or(ANY_TURBULENCE_SIGMA_LN)
    }

    /// The same of its correlation time.
    fn turbulence_time_sigma_ln(&self) -> f64 {
        let told = self.rig.disturbance.turbulence_time_s.is_some();
        if told { TOLD_TURBULENCE_TIME_SIGMA_LN } else { ANY_TURBULENCE_TIME_SIGMA_LN }
    }

    /// The flights as a point predicts them, nothing fitted, in their order.
    pub fn predict(&self, point: &Point, noise: &Noise) -> Vec<Prediction> {
        self.tracks.par_iter().map(|track| predict(track, self.rig, point, noise)).collect()
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

    pub(crate) fn prior(&self, point: &Point, noise: &Noise, free: &[Free]) -> f64 {
        let numbers: f64 =
            free.iter().map(|f| 0.5 * ((f.own(point.get(f.at)) - f.mean) / f.sigma).powi(2)).sum();
        let usual = &self.noise;
        let sigmas = [
            (noise.measurement_m / usual.measurement_m).ln() / MEASUREMENT_SIGMA_LN,
            (noise.turbulence / usual.turbulence).ln() / self.turbulence_sigma_ln(),
            (noise.turbulence_time_s / usual.turbulence_time_s).ln() / self.turbulence_time_sigma_ln(),
        ];
        numbers + 0.5 * sigmas.iter().map(|sigma| sigma * sigma).sum::<f64>() + settle::prior(self, noise)
    }

    /// The coordinates that are fitted. Of the effects' parameters these are the ones that bend
    /// the prediction: all of those before the given slot, of the others those that do not have their default.
    pub(crate) fn free(&self, point: &Point, plain_from: usize) -> Vec<Free> {
        let mut free = Vec::new();
        for (number, sigma) in self.uncertain() {
            let mean = self.nominal.nuisances[number];
            let low = if mean > 0.0 { 0.02 * mean } else { mean - 50.0 * sigma }; // numerical
            free.push(Free {
                at: Coordinate::Nuisance(number),
                logarithmic: false,
                mean,
                sigma,
                range: (low, mean.abs() * 10.0 + 50.0 * sigma), // numerical
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
