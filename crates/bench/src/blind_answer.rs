//! What `bench diagnose` says, in the words of the blind check.

use std::path::{Path, PathBuf};

use anyhow::bail;
use bench_blind::{Answer, Interval, Told, Verdict};
use bench_diagnosis::{self as diagnosis, Calibration, Diagnosis};
use bench_inference::Problem;
use bench_rig::Rig;

use crate::commands::tracks::Selection;

/// Diagnoses one case: its rig and its recordings, as a user would.
pub fn diagnosed(rig: &Path, flights: &[PathBuf]) -> anyhow::Result<Answer> {
    let rig = Rig::load(rig)?;
    let (tracks, unusable) = Selection::default().tracks(flights, &rig, |_, _| ())?;
    if tracks.is_empty() {
        bail!("none of the flights can be diagnosed: {}", unusable.join("; "));
    }
    let mut answer = answer(&Diagnosis::of(&Problem::new(&tracks, &rig), &Calibration::built_in()));
    answer.note = (!unusable.is_empty()).then(|| unusable.join("; "));
    Ok(answer)
}

/// A diagnosis as an answer.
pub fn answer(diagnosis: &Diagnosis) -> Answer {
    let verdict = match diagnosis.verdict {
        diagnosis::Verdict::Effect => Verdict::Effect,
        diagnosis::Verdict::None => Verdict::None,
        diagnosis::Verdict::Unknown => Verdict::Unknown,
    };
    let candidates = &diagnosis.candidates;
    let told = candidates.iter().find(|candidate| candidate.effects == diagnosis.effects);
    let parameters = told.iter().flat_map(|candidate| &candidate.parameters);
    let gap_is_told = verdict != Verdict::None;
    Answer {
        effects: diagnosis.effects.iter().map(|&effect| effect.to_owned()).collect(),
        probabilities: candidates.iter().map(|c| (c.name.clone(), c.probability)).collect(),
        set: diagnosis.set.clone(),
        group: group(diagnosis),
        parameters: parameters
            .map(|p| Told {
                effect: p.effect.to_owned(),
                name: p.name.to_owned(),
                value: p.value,
                low: p.low,
                high: p.high,
            })
            .collect(),
        stage: diagnosis.place.stage.filter(|_| gap_is_told).map(str::to_owned),
        region: region(diagnosis).filter(|_| gap_is_told).map(str::to_owned),
        closure: diagnosis
            .gap
            .closure
            .filter(|_| verdict == Verdict::Effect && diagnosis.gap.held_out)
            .map(|closure| Interval { value: closure.value, low: closure.low, high: closure.high }),
        ..Answer::bare(verdict)
    }
}

/// Labels that the flights cannot tell from what is named: one of its effects in the place of which another stands.
fn group(diagnosis: &Diagnosis) -> Vec<String> {
    let mut labels: Vec<String> = diagnosis
        .group
        .iter()
        .map(|likeness| {
            let named = diagnosis.effects.iter();
            let swapped: Vec<&str> = named
                .map(|effect| if *effect == likeness.effect { likeness.like } else { *effect })
                .collect();
            swapped.join("+")
        })
        .collect();
    labels.sort();
    labels.dedup();
    labels
}

/// The axis with the strongest evidence.
fn region(diagnosis: &Diagnosis) -> Option<&'static str> {
    let regions = diagnosis.place.regions.iter().filter(|region| region.gain > diagnosis::PLAIN_NATS);
    let strongest = regions.max_by(|a, b| a.gain.total_cmp(&b.gain))?;
    Some(match strongest.axis {
        "vertical speed" => "speed",
        "thrust over weight" => "throttle",
        "change of thrust over weight" => "lagged-throttle",
        "time in flight" => "time",
        "charge drawn" => "charge",
        "altitude of late" => "altitude",
        same => same,
    })
}

#[cfg(test)]
mod tests {
    use bench_diagnosis::{Candidate, Likeness, ParameterValue, Place, RegionTold};

    use super::*;

    fn candidate(name: &str, effects: &[&'static str], probability: f64) -> Candidate {
        let parameters = effects
            .iter()
            .map(|&effect| ParameterValue {
                effect,
                name: "size",
                unit: "1",
                value: 0.2,
                low: 0.18,
                high: 0.23,
            })
            .collect();
        Candidate {
            effects: effects.to_vec(),
            indices: None,
            name: name.to_owned(),
            probability,
            evidence_gain: 0.0,
            grounds: None,
            parameters,
        }
    }

    fn region_told(axis: &'static str, gain: f64) -> RegionTold {
        RegionTold { axis, unit: "1", gain, at: vec![], acceleration_m_s2: vec![], sigma_m_s2: vec![] }
    }

    fn said(verdict: diagnosis::Verdict, effects: Vec<&'static str>) -> Diagnosis {
        Diagnosis {
            verdict,
            effects,
            confidence: 0.7,
            set: vec!["rotor-lag+gusts".to_owned(), "none".to_owned()],
            group: vec![Likeness { effect: "rotor-lag", like: "actuator-lag", cosine: 0.97 }],
            candidates: vec![
                candidate("rotor-lag+gusts", &["rotor-lag", "gusts"], 0.7),
                candidate("none", &[], 0.21),
                candidate("unknown", &[], 0.09),
            ],
            place: Place {
                stage: Some("propulsion"),
                regions: vec![
                    region_told("altitude", 4.0),
                    region_told("change of thrust over weight", 9.0),
                    region_told("time in flight", 2.0),
                ],
                ..Place::default()
            },
            ..Diagnosis::default()
        }
    }

    #[test]
    fn a_named_pair_keeps_probabilities_set_intervals_stage_and_axis() {
        let told = answer(&said(diagnosis::Verdict::Effect, vec!["rotor-lag", "gusts"]));
        told.check().unwrap();
        assert_eq!(told.label(), "gusts+rotor-lag");
        assert_eq!(told.probability("rotor-lag+gusts"), 0.7);
        assert_eq!(told.set, ["rotor-lag+gusts", "none"]);
        assert_eq!(told.region.as_deref(), Some("lagged-throttle"));
        assert_eq!(told.stage.as_deref(), Some("propulsion"));
        assert!(told.parameters[1].low == 0.18 && told.parameters[1].effect == "gusts");
        assert_eq!(told.group, ["actuator-lag+gusts"]);
    }

    #[test]
    fn none_names_neither_stage_nor_axis_nor_parameters() {
        let told = answer(&said(diagnosis::Verdict::None, vec![]));
        told.check().unwrap();
        assert_eq!((told.stage, told.region), (None, None));
        assert!(told.parameters.is_empty() && told.effects.is_empty());
    }
}
