//! Whether flights are of one condition: what each by itself says of the leading hypothesis' parameters and of the rig's numbers.
//!
//! Near the fit to all, a flight's log-likelihood is a parabola with gradient `g` and information `F`: by itself it would have a
//! number of the rig at `x + g/F`, with the variance `T/F`, `T` being by how much measurements are less independent than the filter thinks. A parameter of an
//! effect may be far from that of all, where no parabola holds: it is tried over a grid, all else held. Cochran's `Q` (The
//! combination of estimates from different experiments, Biometrics 10, 1954) holds the spread of these against that variance and
//! what may differ in one condition.

use bench_filter::{Coordinate, Point};
use bench_inference::{Fit, Free, Problem};
use bench_plant::effects::RigNumber;
use rayon::prelude::*;
use serde::Serialize;
use statrs::distribution::{ChiSquared, ContinuousCDF};

use crate::diagnose::FORM_SIGMA;

/// Measurements are not as independent as the filter thinks: variances of what a flight says are so many times as large.
const DEPENDENCE: f64 = 2.8;
/// Share of sets of flights of one condition that would be told apart, were the parabolas exact.
const LEVEL: f64 = 1e-3;

/// A parameter is tried over so many steps either way, each of so much: of its logarithm, or of its value.
const STEPS: i32 = 8; // numerical
const STEP: f64 = 0.25; // numerical

/// Flights that are not of one condition.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Disagreement {
    /// The effect whose parameter it is; absent for a number of the rig.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub effect: Option<&'static str>,
    /// The parameter, or the rig's number, of which flights say different things most plainly.
    pub name: &'static str,
    /// Probability that flights of one condition would differ as much in any of what was tried, 0 to 1.
    pub p: f64,
    /// Below this it counts.
    pub level: f64,
    /// Among how many parameters and numbers it was chosen.
    pub tried: u32,
    /// The two groups that differ most, that of the first flight first.
    pub groups: [Agreeing; 2],
}

/// Flights that say the same.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Agreeing {
    /// Which, counted from one in the order in which they were used.
    pub numbers: Vec<usize>,
    /// Their names.
    pub flights: Vec<String>,
    /// What they say, in the unit of the parameter or the number, all else held as all flights have it: a rough figure.
    pub value: f64,
    /// One sigma.
    pub sigma: f64,
}

/// What one flight says of a coordinate, in its own scale.
#[derive(Clone, Copy, Debug)]
struct Says {
    flight: usize,
    /// How far it would move the coordinate.
    by: f64,
    variance: f64,
    /// What the flight gains by that.
    nats: f64,
}

/// A coordinate of a fit, and what each flight says of it.
struct Tried<'a> {
    fit: &'a Fit,
    at: usize,
    says: Vec<Says>,
}

impl Tried<'_> {
    fn is_of_effect(&self) -> bool {
        matches!(self.fit.free[self.at].at, Coordinate::Effect { .. })
    }
}

/// What flights disagree about most plainly, if they do: of the best fit, or of a simpler one that explains as much as what the best
/// adds to it once flights may differ. A second law may be nothing but the difference between flights. Nor may what is left without
/// a name, nats, be more than that difference explains: under a law that is wrong, each mission bends the numbers its own way.
pub fn disagreement(
    problem: &Problem<'_>,
    best: &Fit,
    simpler: &[&Fit],
    nameless: f64,
) -> Option<Disagreement> {
    let mut tried: Vec<Tried<'_>> = Vec::new();
    let mut all = 0;
    for fit in [best].iter().chain(simpler) {
        let added = best.log_evidence - fit.log_evidence + nameless;
        for (at, f) in fit.free.iter().enumerate() {
            let Some(ordinary) = ordinary_spread(fit, f) else { continue };
            let says = says(problem, fit, at, ordinary);
            if says.len() > 1 {
                all += 1;
                if says.iter().map(|s| s.nats).sum::<f64>() >= added {
                    tried.push(Tried { fit, at, says });
                }
            }
        }
    }
    let (one, p) = tried
        .iter()
        // Bonferroni: the least of several.
        .map(|one| (one, (chance(&one.says) * f64::from(all)).min(1.0)))
        .filter(|(_, p)| *p < LEVEL)
        // What differs in one thing bends all: a law's own parameter is told before a number that it bends.
        .min_by(|a, b| b.0.is_of_effect().cmp(&a.0.is_of_effect()).then(a.1.total_cmp(&b.1)))?;
    let (fit, f) = (one.fit, &one.fit.free[one.at]);
    let groups = two_groups(&one.says).map(|group| agreeing(problem, fit, f, &group));
    let (effect, name) = match f.at {
        Coordinate::Nuisance(i) => (None, Point::names(problem.rig)[i]),
        Coordinate::Effect { slot, parameter } => {
            let spec = &bench_plant::effects::LIBRARY[fit.point.effects[slot].0];
            (Some(spec.name), spec.parameters[parameter].key)
        }
    };
    Some(Disagreement { effect, name, p, level: LEVEL, tried: all, groups })
}

/// One sigma by which a coordinate may differ between flights of one condition, in its own scale: a number of the rig within its
/// tolerance, a parameter by what another form of its law makes of it under other missions. `None` for what is not asked: the
/// tracker's origin and forms of laws.
fn ordinary_spread(fit: &Fit, f: &Free) -> Option<f64> {
    match f.at {
        Coordinate::Nuisance(RigNumber::Origin) => None,
        Coordinate::Nuisance(_) => Some(f.sigma),
        Coordinate::Effect { slot, parameter } => {
            let shapes = fit.point.parameter(slot, parameter).default.is_some();
            let value = if f.logarithmic { 1.0 } else { fit.point.get(f.at).abs() };
            (!shapes).then_some(FORM_SIGMA * value)
        }
    }
}

fn says(problem: &Problem<'_>, fit: &Fit, i: usize, ordinary: f64) -> Vec<Says> {
    let f = &fit.free[i];
    let of_flight = |flight: usize| {
        let (by, information) = match f.at {
            Coordinate::Nuisance(_) => {
                let pass = fit.pass.tracks.get(flight)?;
                let information = *pass.information.get((i, i))?;
                (pass.gradient.get(i)? / information, information)
            }
            Coordinate::Effect { .. } => profile(problem, fit, f, flight)?,
        };
        let variance = DEPENDENCE / information + ordinary * ordinary;
        (information > 0.0 && by.is_finite() && variance.is_finite()).then_some(Says {
            flight,
            by,
            variance,
            nats: 0.5 * by * by * information,
        })
    };
    (0..problem.tracks.len()).into_par_iter().filter_map(of_flight).collect()
}

/// How far one flight would move a coordinate, all else held, and its information there, in its own scale.
fn profile(problem: &Problem<'_>, fit: &Fit, f: &Free, flight: usize) -> Option<(f64, f64)> {
    let value = fit.point.get(f.at);
    let h = if f.logarithmic { STEP } else { STEP * value.abs() };
    let noise = fit.full_noise(problem);
    let nll = |k: i32| {
        let mut point = fit.point.clone();
        *point.get_mut(f.at) = f.value(f.own(value) + f64::from(k) * h);
        bench_filter::nll(&problem.tracks[flight], problem.rig, &point, &noise)
    };
    let tried: Vec<f64> = (-STEPS..=STEPS).map(nll).collect();
    let best = (0..tried.len()).min_by(|a, b| tried[*a].total_cmp(&tried[*b]))?;
    let at = (best as f64 - f64::from(STEPS)) * h;
    if best == 0 || best + 1 == tried.len() {
        // Beyond what is tried: no less informed than a parabola from there to the fit to all.
        return Some((at, 2.0 * (tried[STEPS as usize] - tried[best]) / (at * at)));
    }
    let (low, high) = (tried[best - 1], tried[best + 1]);
    let bend = low + high - 2.0 * tried[best];
    Some((at + 0.5 * h * (low - high) / bend, bend / (h * h)))
}

fn mean(says: &[Says]) -> (f64, f64) {
    let precision: f64 = says.iter().map(|s| s.variance.recip()).sum();
    (says.iter().map(|s| s.by / s.variance).sum::<f64>() / precision, precision.recip())
}

/// Squares about the mean over variances.
fn spread(says: &[Says]) -> f64 {
    let (mean, _) = mean(says);
    says.iter().map(|s| (s.by - mean).powi(2) / s.variance).sum()
}

/// Probability that flights of one condition would differ as much.
fn chance(says: &[Says]) -> f64 {
    ChiSquared::new((says.len() - 1) as f64).map_or(1.0, |chi_squared| chi_squared.sf(spread(says)))
}

/// The two groups that leave the least spread within (Fisher, On grouping for maximum homogeneity, Journal of the American
/// Statistical Association 53, 1958), each in the order of the flights.
fn two_groups(says: &[Says]) -> [Vec<Says>; 2] {
    let mut sorted = says.to_vec();
    sorted.sort_by(|a, b| a.by.total_cmp(&b.by));
    let within = |cut: usize| spread(&sorted[..cut]) + spread(&sorted[cut..]);
    let cut = (1..sorted.len()).min_by(|a, b| within(*a).total_cmp(&within(*b))).unwrap_or(1);
    let high = sorted.split_off(cut);
    let mut groups = [sorted, high];
    for group in &mut groups {
        group.sort_by_key(|s| s.flight);
    }
    groups.sort_by_key(|group| group[0].flight);
    groups
}

fn agreeing(problem: &Problem<'_>, fit: &Fit, f: &Free, group: &[Says]) -> Agreeing {
    let (by, variance) = mean(group);
    let value = f.value(f.own(fit.point.get(f.at)) + by);
    Agreeing {
        numbers: group.iter().map(|s| s.flight + 1).collect(),
        flights: group.iter().map(|s| problem.tracks[s.flight].name.clone()).collect(),
        value,
        sigma: f.slope(value).abs() * variance.sqrt(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flights(by: &[f64], sigma: f64) -> Vec<Says> {
        by.iter()
            .enumerate()
            .map(|(flight, by)| Says { flight, by: *by, variance: sigma * sigma, nats: 0.0 })
            .collect()
    }

    #[test]
    fn a_spread_as_wide_as_its_sigma_is_no_news_and_one_of_five_sigma_is() {
        let by = [-1.0, 0.4, 1.1, -0.6, 0.1];
        assert!(chance(&flights(&by, 0.8)) > 0.3);
        assert!(chance(&flights(&by, 0.2)) < LEVEL);
        // The chi-squared of one degree of freedom at 3.84.
        let two = flights(&[-1.0, 1.0], 2.0 / (2.0 * 3.841_459_f64).sqrt());
        assert!((chance(&two) - 0.05).abs() < 1e-6, "{}", chance(&two));
    }

    #[test]
    fn the_groups_are_those_that_differ_and_keep_the_order_of_the_flights() {
        let says = flights(&[1.0, -1.1, 0.9, -0.9, 1.05], 0.1);
        let groups = two_groups(&says).map(|group| group.iter().map(|s| s.flight).collect::<Vec<_>>());
        assert_eq!(groups, [vec![0, 2, 4], vec![1, 3]]);
    }
}
