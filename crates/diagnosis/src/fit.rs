//! Fits a hypothesis to the flights: parameters by their posterior's mode, evidence by Laplace's method.

use bench_plant::effects::{LIBRARY, Prior};
use bench_rig::Rig;
use nalgebra::{DMatrix, DVector};

use crate::{
    law::{Coordinate, Point},
    pass::{Direction, Noise, Pass, run},
    track::Track,
};

/// What all fits of one diagnosis share.
pub struct Problem<'a> {
    /// The flights.
    pub tracks: &'a [Track],
    /// The nominal model.
    pub rig: &'a Rig,
    /// The rig's numbers.
    pub nominal: Point,
    /// One sigma of each; zero for those taken as exact.
    pub sigma: [f64; 7],
    /// What is thought of the noise before any flight.
    pub noise: Noise,
}

/// A fitted hypothesis.
#[derive(Clone, Debug)]
pub struct Fit {
    /// The effects' library indices.
    pub effects: Vec<usize>,
    /// The mode.
    pub point: Point,
    /// The noise at the mode.
    pub noise: Noise,
    /// Free coordinates.
    pub free: Vec<Free>,
    /// Covariance of the free coordinates, each in its own scale (natural logarithm where the prior is log-normal).
    pub covariance: DMatrix<f64>,
    /// Natural logarithm of the evidence, but for a constant that all hypotheses share.
    pub log_evidence: f64,
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
    /// Slot, parameter, value and one sigma of each of the effects' parameters.
    pub fn effect_parameters(&self) -> impl Iterator<Item = (usize, usize, f64, f64)> + '_ {
        self.free.iter().enumerate().filter_map(|(i, f)| {
            let Coordinate::Effect { slot, parameter } = f.at else { return None };
            let value = self.point.get(f.at);
            let own_sigma = self.covariance[(i, i)].max(0.0).sqrt();
            Some((slot, parameter, value, own_sigma * f.slope(value).abs()))
        })
    }
}

impl Free {
    fn own(&self, value: f64) -> f64 {
        if self.logarithmic { value.max(1e-12).ln() } else { value }
    }

    fn value(&self, own: f64) -> f64 {
        let value = if self.logarithmic { own.exp() } else { own };
        value.clamp(self.range.0, self.range.1)
    }

    /// Step for the derivative, in units of the value.
    fn step(&self, value: f64) -> f64 {
        let step = if self.logarithmic { 0.03 * value } else { 0.03 * self.sigma };
        if value + step > self.range.1 { -step } else { step }
    }

    /// Derivative of the value by the own scale.
    fn slope(&self, value: f64) -> f64 {
        if self.logarithmic { value } else { 1.0 }
    }
}

/// Uncertainty of the noise's logarithm before any flight: tracker, then process.
const SIGHTING_SIGMA_LN: f64 = 0.1;
const ACCELERATION_SIGMA_LN: f64 = 0.5;
const MAX_ITERATIONS: usize = 12;

impl<'a> Problem<'a> {
    /// The problem of a rig and flights.
    pub fn new(tracks: &'a [Track], rig: &'a Rig) -> Self {
        let (nominal, sigma) = Point::nominal(rig);
        let rounding = rig.tracker.resolution_m / 12_f64.sqrt();
        let noise = Noise {
            acceleration: 0.02,
            trim_walk: 0.004,
            trim: 0.05,
            sighting_m: rig.tracker.noise_m.hypot(rounding).max(1e-4),
        };
        Self { tracks, rig, nominal, sigma, noise }
    }

    /// The null hypothesis: the rig's numbers within their tolerances, no effect.
    pub fn fit_null(&self) -> Fit {
        self.refine(self.nominal.clone(), self.noise)
    }

    /// Fits a hypothesis whose last effect is new to `base` (the fit without it), from several starts.
    pub fn fit_with(&self, base: &Fit, effect: usize) -> Fit {
        // The base's numbers may have been bent to do the new effect's work: also start from the rig's own.
        let fits = [base.point.nuisances, self.nominal.nuisances].into_iter().filter_map(|nuisances| {
            let (_, start) = starts(effect)
                .into_iter()
                .map(|values| {
                    let mut point = Point { nuisances, ..base.point.clone() };
                    point.effects.push((effect, values));
                    (self.objective(&point, &base.noise), point)
                })
                .min_by(|a, b| a.0.total_cmp(&b.0))?;
            Some(self.refine(start, base.noise))
        });
        // An effect has parameters, so there is a start.
        fits.max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence)).unwrap_or_else(|| base.clone())
    }

    /// Levenberg-Marquardt on the posterior, then the noise, until neither moves.
    fn refine(&self, mut point: Point, mut noise: Noise) -> Fit {
        let free = self.free(&point);
        let mut damping = 1e-3;
        let mut best = self.objective(&point, &noise);
        let mut pass = run(self.tracks, self.rig, &point, &noise, &self.directions(&point));
        for _ in 0..MAX_ITERATIONS {
            let (hessian, gradient) = normal_equations(&point, &free, &pass);
            let mut moved = false;
            for _ in 0..6 {
                let Some(step) = damped_step(&hessian, &gradient, damping) else { break };
                let mut trial = point.clone();
                for (f, dx) in free.iter().zip(step.iter()) {
                    let own = f.own(point.get(f.at)) + dx.clamp(-3.0 * f.sigma, 3.0 * f.sigma);
                    *trial.get_mut(f.at) = f.value(own);
                }
                let objective = self.objective(&trial, &noise);
                if objective < best {
                    moved = best - objective > 0.02;
                    (point, best) = (trial, objective);
                    damping = (damping * 0.2).max(1e-6);
                    break;
                }
                damping *= 6.0;
            }
            let adjusted = self.fit_noise(&point, noise);
            let objective = self.objective(&point, &adjusted);
            if objective < best {
                moved |= best - objective > 0.02;
                (noise, best) = (adjusted, objective);
            }
            pass = run(self.tracks, self.rig, &point, &noise, &self.directions(&point));
            if !moved {
                break;
            }
        }
        let (hessian, _) = normal_equations(&point, &free, &pass);
        let log_evidence = log_evidence(best, &free, &hessian);
        let covariance = hessian.try_inverse().unwrap_or_else(|| DMatrix::zeros(free.len(), free.len()));
        let effects = point.effects.iter().map(|(index, _)| *index).collect();
        Fit { effects, point, noise, free, covariance, log_evidence }
    }

    /// Negative log-posterior at a point, but for constants.
    fn objective(&self, point: &Point, noise: &Noise) -> f64 {
        let nll = run(self.tracks, self.rig, point, noise, &[]).nll;
        let prior: f64 = self
            .free(point)
            .iter()
            .map(|f| 0.5 * ((f.own(point.get(f.at)) - f.mean) / f.sigma).powi(2))
            .sum();
        let sighting = (noise.sighting_m / self.noise.sighting_m).ln() / SIGHTING_SIGMA_LN;
        let acceleration = (noise.acceleration / self.noise.acceleration).ln() / ACCELERATION_SIGMA_LN;
        nll + prior + 0.5 * (sighting * sighting + acceleration * acceleration)
    }

    /// The free coordinates of a point with steps for their derivatives.
    pub(crate) fn directions(&self, point: &Point) -> Vec<Direction> {
        self.free(point).iter().map(|f| Direction::Coordinate(f.at, f.step(point.get(f.at)))).collect()
    }

    /// A line search on the logarithm of each noise.
    fn fit_noise(&self, point: &Point, start: Noise) -> Noise {
        let mut noise = start;
        for which in 0..2 {
            let with = |ln_factor: f64| {
                let mut moved = noise;
                if which == 0 {
                    moved.acceleration *= ln_factor.exp();
                } else {
                    moved.sighting_m *= ln_factor.exp();
                }
                moved
            };
            // A parabola through three points is exact enough for a parameter that is only marginalised.
            let h = if which == 0 { 0.25 } else { 0.05 };
            let value = |x: f64| self.objective(point, &with(x));
            let (low, mid, high) = (value(-h), value(0.0), value(h));
            let curvature = low + high - 2.0 * mid;
            let step = if curvature > 1e-9 {
                0.5 * h * (low - high) / curvature
            } else if low < high {
                -h
            } else {
                h
            };
            let step = step.clamp(-4.0 * h, 4.0 * h);
            if value(step) < mid {
                noise = with(step);
            }
        }
        noise
    }

    /// The coordinates that are fitted: uncertain numbers of the rig, and all parameters of the point's effects.
    fn free(&self, point: &Point) -> Vec<Free> {
        let mut free = Vec::new();
        for (i, sigma) in self.sigma.into_iter().enumerate() {
            if sigma > 0.0 {
                let mean = self.nominal.nuisances[i];
                let low = if mean > 0.0 { 0.02 * mean } else { mean - 50.0 * sigma };
                free.push(Free {
                    at: Coordinate::Nuisance(i),
                    logarithmic: false,
                    mean,
                    sigma,
                    range: (low, mean.abs() * 10.0 + 50.0 * sigma),
                });
            }
        }
        for (slot, (effect, _)) in point.effects.iter().enumerate() {
            for (parameter, p) in LIBRARY[*effect].parameters.iter().enumerate() {
                let (logarithmic, mean, sigma) = match p.prior {
                    Prior::Normal { mean, sigma } => (false, mean, sigma),
                    Prior::LogNormal { median, sigma_ln } => (true, median.ln(), sigma_ln),
                };
                free.push(Free {
                    at: Coordinate::Effect { slot, parameter },
                    logarithmic,
                    mean,
                    sigma,
                    range: (p.min, p.max),
                });
            }
        }
        free
    }
}

/// Hessian and gradient of the log-posterior over the free coordinates, each in its own scale (Gauss-Newton).
fn normal_equations(point: &Point, free: &[Free], pass: &Pass) -> (DMatrix<f64>, DVector<f64>) {
    let n = free.len();
    let mut hessian = DMatrix::zeros(n, n);
    let mut gradient = DVector::zeros(n);
    for (i, fi) in free.iter().enumerate() {
        let slope = fi.slope(point.get(fi.at));
        let precision = fi.sigma.powi(-2);
        gradient[i] = pass.gradient[i] * slope - (fi.own(point.get(fi.at)) - fi.mean) * precision;
        for (j, fj) in free.iter().enumerate().take(i + 1) {
            let value = pass.information[(i, j)] * slope * fj.slope(point.get(fj.at));
            hessian[(i, j)] = value;
            hessian[(j, i)] = value;
        }
        hessian[(i, i)] += precision;
    }
    (hessian, gradient)
}

/// Adds what the priors of a fit's coordinates say to information and gradient over the coordinates' values.
pub(crate) fn add_prior(fit: &Fit, information: &mut DMatrix<f64>, gradient: &mut DVector<f64>) {
    for (i, f) in fit.free.iter().enumerate() {
        let value = fit.point.get(f.at);
        let per_value = f.slope(value).recip();
        information[(i, i)] += (per_value / f.sigma).powi(2);
        gradient[i] -= (f.own(value) - f.mean) / (f.sigma * f.sigma) * per_value;
    }
}

/// `ln Z = ln L + ln prior - 1/2 ln det H` at the mode, powers of 2 pi cancelling (`MacKay`, *Information Theory,
/// Inference, and Learning Algorithms*, chapter 27).
fn log_evidence(objective: f64, free: &[Free], hessian: &DMatrix<f64>) -> f64 {
    let ln_prior_widths: f64 = free.iter().map(|f| f.sigma.ln()).sum();
    let half_ln_det = hessian
        .clone()
        .cholesky()
        .map_or(f64::INFINITY, |c| c.l_dirty().diagonal().iter().map(|d| d.ln()).sum::<f64>());
    -objective - ln_prior_widths - half_ln_det
}

fn damped_step(hessian: &DMatrix<f64>, gradient: &DVector<f64>, damping: f64) -> Option<DVector<f64>> {
    let mut damped = hessian.clone();
    for i in 0..damped.nrows() {
        damped[(i, i)] *= 1.0 + damping;
    }
    Some(damped.cholesky()?.solve(gradient))
}

/// Values of an effect's parameters to start from: a grid over the prior.
fn starts(effect: usize) -> Vec<Vec<f64>> {
    let mut grid: Vec<Vec<f64>> = vec![Vec::new()];
    for p in LIBRARY[effect].parameters {
        let values: Vec<f64> = match p.prior {
            Prior::Normal { mean, sigma } => [-1.0, -0.3, 0.3, 1.0].map(|k| mean + k * sigma).to_vec(),
            Prior::LogNormal { median, sigma_ln } => {
                [-1.5, 0.0, 1.2].map(|k| median * (k * sigma_ln).exp()).to_vec()
            }
        };
        grid = grid
            .into_iter()
            .flat_map(|head| {
                values.iter().map(move |value| {
                    let mut next = head.clone();
                    next.push(value.clamp(p.min, p.max));
                    next
                })
            })
            .collect();
    }
    grid
}
