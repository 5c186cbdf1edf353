//! Evidence by Laplace's method against quadrature, and nested evidences against the Savage-Dickey density ratio (Dickey,
//! *Annals of Mathematical Statistics* 42, 1971).

#[path = "../../diagnosis/tests/support/flown.rs"]
mod flown;
#[path = "../../diagnosis/tests/support/mod.rs"]
mod support;

use bench_filter::{Noise, PerNumber, Point, RigNumber, Track};
use bench_inference::{Fit, Free, Problem};
use bench_plant::effects::{LIBRARY, index_of, parse_effect};
use bench_rig::Rig;
use flown::fly;
use nalgebra::{DMatrix, DVector};
use support::rig;

/// What Laplace's method may be off by, nats: a few hundredths for laws that are nearly linear over their posterior, of which
/// 0.02 a coordinate is the sensitivities' own error (`crates/filter/tests/sensitivity.rs`). Decisions begin at two nats.
const ALLOWED_NATS: f64 = 0.1;
/// Quadrature: points either way of the mode, and deviations between them. The trapezoidal rule errs by less than 1e-6 of a
/// Gaussian's integral at steps of half a deviation.
const POINTS: i32 = 12;
const STEP: f64 = 0.5;

/// A climb and a hover, flown by a rig with an effect.
fn tracks(effect: &str) -> Vec<Track> {
    let mut real = rig();
    real.effects.push(parse_effect(effect).unwrap());
    [("climb-040", 1), ("low-hover", 2)]
        .map(|(name, seed)| Track::from_flight(name, &fly(&real, name, seed), &rig()).unwrap())
        .into()
}

/// A problem in which these numbers of the rig alone are uncertain.
fn problem<'a>(tracks: &'a [Track], rig: &'a Rig, uncertain: &[RigNumber]) -> Problem<'a> {
    let all = Problem::new(tracks, rig);
    let mut sigma = PerNumber::default();
    for number in uncertain {
        sigma[*number] = all.sigma[*number];
    }
    Problem { sigma, ..all }
}

/// The objective about a fit's mode, over its coordinates in their own scales.
struct Posterior<'a> {
    problem: &'a Problem<'a>,
    point: Point,
    noise: Noise,
    free: Vec<Free>,
    mode: DVector<f64>,
}

impl<'a> Posterior<'a> {
    fn of(problem: &'a Problem<'a>, fit: &Fit) -> Self {
        let mode = fit.free.iter().map(|f| f.own(fit.point.get(f.at))).collect::<Vec<_>>();
        Self {
            problem,
            point: fit.point.clone(),
            noise: fit.noise,
            free: fit.free.clone(),
            mode: DVector::from_vec(mode),
        }
    }

    fn at(&self, own: &DVector<f64>) -> f64 {
        let mut point = self.point.clone();
        for (f, x) in self.free.iter().zip(own) {
            *point.get_mut(f.at) = f.value(*x);
        }
        self.problem.objective(&point, &self.noise, &self.free)
    }

    /// Lower triangle by which deviations of a standard normal become those of the posterior, about: from second differences
    /// over a hundredth of the priors.
    fn spread(&self) -> DMatrix<f64> {
        let n = self.free.len();
        let h: Vec<f64> = self.free.iter().map(|f| 0.01 * f.sigma).collect();
        let moved = |i: usize, a: f64, j: usize, b: f64| {
            let mut x = self.mode.clone();
            x[i] += a * h[i];
            x[j] += b * h[j];
            self.at(&x)
        };
        let hessian = DMatrix::from_fn(n, n, |i, j| {
            (moved(i, 1.0, j, 1.0) - moved(i, 1.0, j, -1.0) - moved(i, -1.0, j, 1.0)
                + moved(i, -1.0, j, -1.0))
                / (4.0 * h[i] * h[j])
        });
        let covariance = hessian.try_inverse().expect("the posterior has a width");
        covariance.cholesky().expect("the mode is a minimum").l()
    }

    /// Logarithm of the integral of the likelihood over the priors.
    fn ln_integral(&self) -> f64 {
        let n = self.free.len();
        let spread = self.spread();
        let least = self.at(&self.mode);
        let mut sum = 0.0;
        let per_axis = (2 * POINTS + 1) as usize;
        for cell in 0..per_axis.pow(n as u32) {
            let deviations = DVector::from_fn(n, |i, _| {
                let at = cell / per_axis.pow(i as u32) % per_axis;
                STEP * (at as f64 - f64::from(POINTS))
            });
            sum += (least - self.at(&(&self.mode + &spread * deviations))).exp();
        }
        let cell = spread.determinant() * (0..n).map(|_| STEP).product::<f64>();
        let priors: f64 = self.free.iter().map(|f| f.sigma.ln() + 0.5 * std::f64::consts::TAU.ln()).sum();
        sum.ln() + cell.ln() - least - priors
    }
}

/// The fit of an effect from a size on, in its plainest form to begin with.
fn with_effect(problem: &Problem<'_>, effect: &str, size: f64) -> Fit {
    let index = index_of(effect).unwrap();
    let values = LIBRARY[index].parameters.iter().map(|p| p.default.unwrap_or(size));
    let mut point = problem.nominal.clone();
    point.effects.push((index, values.collect()));
    problem.refine(point, problem.noise)
}

#[test]
fn evidence_over_one_and_two_numbers_of_the_rig_is_what_quadrature_gives() {
    use RigNumber::{Drag, GroundEffectHeight, GroundEffectMultiplier, Latency, Mass, ThrustGain};
    let (rig, tracks) = (rig(), tracks("mass-change:fraction=0.01"));
    for uncertain in [
        &[Latency][..],
        &[Drag],
        &[GroundEffectHeight],
        &[Mass, ThrustGain],
        &[GroundEffectMultiplier, GroundEffectHeight],
    ] {
        let problem = problem(&tracks, &rig, uncertain);
        let fit = problem.refine(problem.nominal.clone(), problem.noise);
        let exact = Posterior::of(&problem, &fit).ln_integral();
        assert!(
            (fit.log_evidence - exact).abs() < ALLOWED_NATS,
            "{uncertain:?}: {} and {exact}",
            fit.log_evidence
        );
    }
}

#[test]
fn evidence_for_an_effect_is_the_savage_dickey_ratio() {
    // The prior's density over the posterior's where the effect vanishes, other numbers integrated out. The effects are small:
    // a large one that is left out is partly taken for noise, whose level each fit finds for itself.
    let rig = rig();
    for (effect, planted, start, uncertain) in [
        ("tracker-latency", "tracker-latency:extra_s=0.005", 0.005, &[][..]),
        ("mass-change", "mass-change:fraction=0.004", 0.004, &[]),
        ("mass-change", "mass-change:fraction=0.004", 0.004, &[RigNumber::ThrustOffset]),
        ("tracker-latency", "tracker-latency:extra_s=0.01", 0.01, &[RigNumber::Latency]),
    ] {
        let tracks = tracks(planted);
        let problem = problem(&tracks, &rig, uncertain);
        let fit = with_effect(&problem, effect, start);
        let null = problem.refine(problem.nominal.clone(), problem.noise);
        let said = fit.log_evidence - null.log_evidence;

        let whole = Posterior::of(&problem, &fit);
        // Where the effect vanishes, under the noise of the model that has it.
        let vanished = Posterior { noise: fit.noise, ..Posterior::of(&problem, &null) };
        let ratio = whole.ln_integral() - vanished.ln_integral();
        assert!((said - ratio).abs() < ALLOWED_NATS, "{effect} beside {uncertain:?}: {said} and {ratio}");
    }
}

#[test]
fn evidence_does_not_depend_on_the_order_of_flights() {
    let (rig, tracks) = (rig(), tracks("updraft:speed_m_s=0.1"));
    let turned: Vec<Track> = tracks.iter().rev().cloned().collect();
    let evidence = |tracks: &[Track]| {
        let problem = Problem::new(tracks, &rig);
        [problem.fit_null(), with_effect(&problem, "updraft", 0.1)].map(|fit| fit.log_evidence)
    };
    for (one, other) in evidence(&tracks).into_iter().zip(evidence(&turned)) {
        // Sums of some thousand terms in another order, and steps of the descent that end where little is to be gained.
        assert!((one - other).abs() < 1e-6 * one.abs(), "{one} and {other}");
    }
}
