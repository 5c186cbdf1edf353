//! Levenberg-Marquardt steps of a hypothesis to its posterior's mode, noise included, and the evidence there.

use bench_filter::{Noise, PROBES, Pass, Point, added, run};
use bench_statistics::ln_det;
use nalgebra::{DMatrix, DVector};

use crate::{
    coordinate::{Free, directions},
    fit::{Fit, MEASUREMENT_SIGMA_LN, Problem},
};

pub(crate) const MAX_PASSES: usize = 14; // numerical
const FIRST_DAMPING: f64 = 1e-3; // numerical
const MOST_DAMPING: f64 = 1e4; // numerical
/// A step that promises less, in nats, is not worth a pass.
pub(crate) const WORTH: f64 = 0.05; // numerical
/// No coordinate moves by more prior deviations at once.
const LONGEST_STEP: f64 = 2.0; // numerical

impl Problem<'_> {
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

    /// Newton steps of the logarithms of turbulence and tracker noise, and what they promise, from parabolas through the
    /// probes.
    fn noise_step(&self, noise: &Noise, pass: &Pass) -> (f64, f64, f64) {
        let usual = &self.noise;
        let own = [
            ((noise.turbulence / usual.turbulence).ln(), self.turbulence_sigma_ln(), 0.8), // numerical
            ((noise.measurement_m / usual.measurement_m).ln(), MEASUREMENT_SIGMA_LN, 0.3), // numerical
        ];
        let mut steps = [0.0; 2];
        let mut worth = 0.0;
        for (i, (at, sigma, longest)) in own.into_iter().enumerate() {
            let h = PROBES[2 * i + 1];
            let prior = |x: f64| 0.5 * ((at + x) / sigma).powi(2);
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
        noise.measurement_m *= here.noise_step.1.exp();
        self.passes += 1;
        // Two steps in five lead nowhere: derivatives, which cost ten times as much, are for the others.
        if problem.objective(&point, &noise, &self.free) < here.objective {
            self.here = problem.look(point, noise, &self.free);
            self.damping = (self.damping * 0.2).max(1e-6); // numerical
        } else {
            self.damping = (self.damping * 8.0).max(0.01); // numerical
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
        let inverse = self.hessian.clone().try_inverse().filter(|_| log_evidence.is_finite());
        // Flights that do not say how far a number is off leave it as vague as it was before.
        let covariance = inverse.unwrap_or_else(|| {
            DMatrix::from_diagonal(&DVector::from_iterator(free.len(), free.iter().map(|f| f.sigma.powi(2))))
        });
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

#[cfg(test)]
mod tests {
    use std::path::Path;

    use bench_filter::Coordinate;
    use bench_plant::effects::RigNumber;
    use bench_rig::Rig;

    use super::*;

    #[test]
    fn numbers_whose_posterior_has_no_width_keep_that_of_their_prior_and_have_no_evidence() {
        let free = |number: RigNumber, sigma: f64| Free {
            at: Coordinate::Nuisance(number),
            logarithmic: false,
            mean: 0.0,
            sigma,
            range: (-1.0, 1.0),
        };
        let rig = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs/virtual.toml");
        let rig = Rig::load(&rig).unwrap();
        let look = |hessian: DMatrix<f64>| Look {
            point: Point::nominal(&rig).0,
            noise: Noise::nominal(&rig),
            pass: Pass::default(),
            gradient: DVector::zeros(2),
            hessian,
            noise_step: (0.0, 0.0, 0.0),
            objective: 1.0,
        };
        let numbers = || vec![free(RigNumber::Mass, 0.5), free(RigNumber::Drag, 0.25)];
        for wrong in [[1.0, 1.0, 1.0, 1.0], [1.0, 2.0, 2.0, 1.0], [f64::NAN, 0.0, 0.0, 1.0]] {
            let fit = look(DMatrix::from_row_slice(2, 2, &wrong)).into_fit(numbers());
            assert!(fit.is_singular(), "{wrong:?}");
            assert_eq!(fit.covariance, DMatrix::from_row_slice(2, 2, &[0.25, 0.0, 0.0, 0.0625]), "{wrong:?}");
        }
        let fit = look(DMatrix::from_row_slice(2, 2, &[4.0, 0.0, 0.0, 16.0])).into_fit(numbers());
        assert!(!fit.is_singular());
        assert_eq!(fit.covariance, DMatrix::from_row_slice(2, 2, &[0.25, 0.0, 0.0, 0.0625]));
    }
}
