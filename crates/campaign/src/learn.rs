//! What a diagnosis' calibration learns from simulated sets of flights.

use bench_diagnosis::{Analysis, Calibration, Outcome, Verdict, alarm_margin};
use bench_inference::Problem;
use bench_rig::{EffectEntry, Mission, Rig};
use rayon::prelude::*;

use crate::{
    CampaignError,
    mix::{FIRST_WITH_CAUSES, planned, tracks},
};

/// Fewest sets that show a tail of false alarms.
pub const LEAST_SETS: usize = 50;
/// Sets with causes for each nominal one.
const WITH_CAUSES: usize = 3;

/// How far learning is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Learning {
    /// So many sets are to be flown.
    Begun(usize),
    /// One more set is done.
    Step,
    /// The nominal ones are done; those with causes follow.
    WithCauses,
}

/// Flies nominal flights within the rig's tolerances and sees how near each set comes to a false alarm, then flights with causes
/// of the library and sees how often each kind of verdict is right.
pub fn learn(
    rig: &Rig,
    flown: &[Mission],
    sets: usize,
    tell: &(dyn Fn(Learning) + Sync),
) -> Result<Calibration, CampaignError> {
    if sets < LEAST_SETS {
        return Err(CampaignError::TooFewSets { sets });
    }
    tell(Learning::Begun((1 + WITH_CAUSES) * sets));
    let built_in = Calibration::built_in();
    let margins = (0..sets as u64)
        .into_par_iter()
        .map(|set| {
            let tracks = tracks(rig, &[], flown, set)?;
            if tracks.is_empty() {
                return Err(CampaignError::NothingToDiagnose);
            }
            let margin = alarm_margin(&Problem::new(&tracks, rig), &built_in);
            tell(Learning::Step);
            Ok(margin)
        })
        .collect::<Result<Vec<f64>, CampaignError>>()?;
    let learnt = built_in.with_margins(margins, format!("calibrated for rig {}", rig.name));
    tell(Learning::WithCauses);
    let untold = learnt.untold();
    let outcomes = planned(rig, WITH_CAUSES * sets)
        .into_par_iter()
        .enumerate()
        .map(|(case, causes)| {
            let tracks = tracks(rig, &causes, flown, FIRST_WITH_CAUSES + case as u64)?;
            // A case of which there is no flight tells nothing.
            let outcome = (!tracks.is_empty()).then(|| {
                let told = Analysis::of(&Problem::new(&tracks, rig), &untold).told();
                let right = is_right(told.verdict, &told.effects, &causes);
                Outcome { told, right }
            });
            tell(Learning::Step);
            Ok(outcome)
        })
        .collect::<Result<Vec<Option<Outcome>>, CampaignError>>()?;
    let outcomes: Vec<Outcome> = outcomes.into_iter().flatten().collect();
    if outcomes.is_empty() {
        return Err(CampaignError::NothingToDiagnose);
    }
    Ok(learnt.with_outcomes(&outcomes))
}

/// Whether a verdict names exactly the causes.
pub(crate) fn is_right(verdict: Verdict, named: &[&str], causes: &[EffectEntry]) -> bool {
    verdict != Verdict::Unknown
        && named.len() == causes.len()
        && causes.iter().all(|cause| named.contains(&cause.name.as_str()))
}
