//! Which of the library's laws belong to the nominal model: those that make flights which were left out of the fit more probable.
//!
//! One law is added at a time, the best first; those that stand already are fitted along, and the rig's numbers and noise are
//! identified anew beside them. What a law gains is
//! the logarithm of the predictive likelihood of each flight, by a fit to the others (leave-one-out cross-validation; Stone,
//! *Cross-validatory choice and assessment of statistical predictions*, J. R. Statist. Soc. B 36, 1974).

use std::collections::BTreeMap;

use bench_filter::{Coordinate, PerNumber, Point, Track, added, nll};
use bench_inference::{Fit, Problem, with_one_law_more};
use bench_rig::Rig;
use rayon::prelude::*;
use serde::Serialize;

use crate::{
    blocks::hold_out,
    error::IdentifyError,
    flight::{FlightIdentification, identify_flights},
};

/// A law that was found to belong to the nominal model.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NominalLaw {
    /// The effect's name.
    pub name: String,
    /// Its parameters, by key.
    pub parameters: BTreeMap<String, f64>,
    /// What it adds to the log-likelihood of flights left out of the fit, nats, all together.
    pub held_out_gain: f64,
}

/// So many laws at most are added to a nominal model.
const MOST_LAWS: usize = 4;
/// A law must gain so many nats on flights left out, odds of 20 to 1, without the flight on which it gains the most.
const LEAST_GAIN_NATS: f64 = 3.0;
/// Uncertainty of the logarithm of the turbulence while laws are looked for: what was found without a law has taken it in.
const TURBULENCE_SPREAD_LN: f64 = 0.7;

/// Identifies a rig's numbers and the laws that belong to its nominal model, from flights that are known to be nominal, and the models
/// of those flights without a block of them.
pub fn identify_nominal(tracks: &[Track], rig: &Rig) -> Result<FlightIdentification, IdentifyError> {
    let mut found = identify_flights(tracks, rig)?;
    let mut laws: Vec<NominalLaw> = Vec::new();
    let mut model = None;
    let mut beside_laws = PerNumber::default();
    while laws.len() < MOST_LAWS {
        let Some((fit, held_out_gain)) = one_law_more(tracks, rig, &found, model.take()) else { break };
        let listed = fit.as_listed();
        let mut prior = rig.clone();
        prior.effects.extend(listed.iter().cloned());
        // A law with which flights contradict the rig is none that belongs to it.
        let Ok(with_law) = identify_flights(tracks, &prior) else { break };
        found = with_law;
        let gains = laws.iter().map(|law| law.held_out_gain).chain([held_out_gain]);
        laws = listed
            .into_iter()
            .zip(gains)
            .map(|(effect, held_out_gain)| NominalLaw {
                name: effect.name,
                parameters: effect.parameters.into_iter().map(|(key, value, _)| (key, value)).collect(),
                held_out_gain,
            })
            .collect();
        beside_laws = standard_errors(&fit);
        model = Some(fit.point);
    }
    let mut prior = rig.clone();
    prior.effects.clone_from(&found.rig.effects);
    hold_out(tracks, &prior, &beside_laws, &mut found);
    Ok(FlightIdentification { laws, ..found })
}

/// One sigma of each number, the laws' parameters being as uncertain as they are: in the rig they are exact.
fn standard_errors(fit: &Fit) -> PerNumber<f64> {
    let mut errors = PerNumber::default();
    for (i, free) in fit.free.iter().enumerate() {
        if let Coordinate::Nuisance(number) = free.at {
            errors[number] = fit.covariance[(i, i)].max(0.0).sqrt();
        }
    }
    errors
}

/// The law that gains the most on flights left out of the fit beside those of a model, all fitted together, and what it gains; `None`
/// where none gains.
fn one_law_more(
    tracks: &[Track],
    prior: &Rig,
    found: &FlightIdentification,
    model: Option<Point>,
) -> Option<(Fit, f64)> {
    // Numbers under the tolerances of before, for those found without the law may be bent by it; noise as found.
    let mut rig = prior.clone();
    rig.disturbance = found.rig.disturbance;
    rig.disturbance.turbulence_spread_ln = Some(TURBULENCE_SPREAD_LN);
    rig.tracker.noise_m = found.rig.tracker.noise_m;
    let problem = Problem::new(tracks, &rig);
    let levelled = problem.levelled();
    let problem = problem.with_tracks(levelled.as_deref().unwrap_or(tracks));
    let base = match model {
        None => problem.fit_null(),
        Some(point) => problem.refine(point, problem.noise),
    };
    let without = held_out(&problem, &base);
    let gains = |fit: &Fit| -> Vec<f64> {
        without.iter().zip(held_out(&problem, fit)).map(|(without, with)| without - with).collect()
    };
    with_one_law_more(&problem, &base)
        .into_iter()
        .filter(|fit| fit.log_evidence > base.log_evidence + LEAST_GAIN_NATS)
        .filter_map(|fit| {
            let gains = gains(&fit);
            let gain = gains.iter().sum::<f64>();
            let most = gains.iter().copied().fold(0.0, f64::max);
            (gain - most > LEAST_GAIN_NATS).then_some((fit, gain))
        })
        .max_by(|a, b| a.1.total_cmp(&b.1))
}

/// Negative log-likelihood of each flight by a fit to the others.
fn held_out(problem: &Problem<'_>, fit: &Fit) -> Vec<f64> {
    (0..problem.tracks.len())
        .into_par_iter()
        .map(|flight| {
            let point = fit.point_without(flight);
            let noise = added(&point, &fit.noise, problem.rig);
            nll(&problem.tracks[flight], problem.rig, &point, &noise)
        })
        .collect()
}
