//! What a diagnosis' calibration learns from simulated sets of flights.

use bench_diagnosis::{Calibration, Verdict, alarm_margin};
use bench_inference::Problem;
use bench_rig::{EffectEntry, Mission, Rig};
use rayon::prelude::*;

use crate::{CampaignError, mix::tracks};

/// Fewest sets that show a tail of false alarms.
pub const LEAST_SETS: usize = 50;

/// Flies nominal flights within the rig's tolerances and sees how near each set comes to a false alarm: that moves the weight of
/// `none`. What is done is told after each set.
pub fn learn(
    rig: &Rig,
    flown: &[Mission],
    sets: usize,
    done: &(dyn Fn() + Sync),
) -> Result<Calibration, CampaignError> {
    if sets < LEAST_SETS {
        return Err(CampaignError::TooFewSets { sets });
    }
    let built_in = Calibration::built_in();
    let margins = (0..sets as u64)
        .into_par_iter()
        .map(|set| {
            let tracks = tracks(rig, &[], flown, set)?;
            if tracks.is_empty() {
                return Err(CampaignError::NothingToDiagnose);
            }
            let margin = alarm_margin(&Problem::new(&tracks, rig), &built_in);
            done();
            Ok(margin)
        })
        .collect::<Result<Vec<f64>, CampaignError>>()?;
    Ok(built_in.with_margins(margins, format!("calibrated for rig {}", rig.name)))
}

/// Whether a verdict names exactly the causes.
pub(crate) fn is_right(verdict: Verdict, named: &[&str], causes: &[EffectEntry]) -> bool {
    verdict != Verdict::Unknown
        && named.len() == causes.len()
        && causes.iter().all(|cause| named.contains(&cause.name.as_str()))
}
