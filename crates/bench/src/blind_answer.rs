//! What `bench diagnose` says, in the words of the blind check.

use std::path::Path;

use anyhow::bail;
use bench_blind::{Answer, Told, Verdict};
use bench_diagnosis::{self as diagnosis, Diagnosis, Problem, Track};
use bench_recording::Flight;
use bench_rig::Rig;

/// Of a normal number, 90 % lies within this many deviations.
const DEVIATIONS_90: f64 = 1.645;
/// The set of labels holds at least this probability.
const SET_MASS: f64 = 0.9;
/// From this evidence on an axis is named, nats; the same as on the screen of `bench diagnose`.
const REGION_NATS: f64 = 3.0;

/// Diagnoses one case: its rig and its recordings, as a user would.
pub fn diagnosed(rig: &Path, flights: &[impl AsRef<Path>]) -> anyhow::Result<Answer> {
    let rig = Rig::load(rig)?;
    let (mut tracks, mut unusable) = (Vec::new(), Vec::new());
    for path in flights {
        let path = path.as_ref();
        match Track::from_flight(&path.display().to_string(), &Flight::load(path)?, &rig) {
            Ok(track) => tracks.push(track),
            Err(error) => unusable.push(error.to_string()),
        }
    }
    if tracks.is_empty() {
        bail!("none of the flights can be diagnosed: {}", unusable.join("; "));
    }
    let mut answer = answer(&Diagnosis::of(&Problem::new(&tracks, &rig)));
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
        set: credible(candidates),
        parameters: parameters
            .filter(|p| p.value.is_finite() && p.std.is_finite())
            .map(|p| Told {
                effect: p.effect.to_owned(),
                name: p.name.to_owned(),
                value: p.value,
                low: p.value - DEVIATIONS_90 * p.std,
                high: p.value + DEVIATIONS_90 * p.std,
            })
            .collect(),
        stage: diagnosis.place.stage.filter(|_| gap_is_told).map(str::to_owned),
        region: region(diagnosis).filter(|_| gap_is_told).map(str::to_owned),
        // No group, and no closure: answers want one from flights left out of the fit, with its interval.
        ..Answer::bare(verdict)
    }
}

/// The most probable labels that hold [`SET_MASS`] together.
fn credible(candidates: &[diagnosis::Candidate]) -> Vec<String> {
    let mut sorted: Vec<_> = candidates.iter().collect();
    sorted.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    let mut mass = 0.0;
    let mut set = Vec::new();
    for candidate in sorted {
        if mass >= SET_MASS {
            break;
        }
        mass += candidate.probability;
        set.push(candidate.name.clone());
    }
    set
}

/// The axis with the strongest evidence.
fn region(diagnosis: &Diagnosis) -> Option<&'static str> {
    let regions = diagnosis.place.regions.iter().filter(|region| region.gain > REGION_NATS);
    let strongest = regions.max_by(|a, b| a.gain.total_cmp(&b.gain))?;
    Some(match strongest.axis {
        "vertical speed" => "speed",
        "thrust over weight" => "throttle",
        "change of thrust over weight" => "lagged-throttle",
        "time in flight" => "time",
        "charge drawn" => "charge",
        same => same,
    })
}

#[cfg(test)]
mod tests {
    use bench_diagnosis::{Candidate, Gap, KStep, ParameterValue, Place, RegionTold};

    use super::*;

    fn candidate(name: &str, effects: &[&'static str], probability: f64) -> Candidate {
        let parameters = effects
            .iter()
            .map(|&effect| ParameterValue { effect, name: "size", unit: "1", value: 0.2, std: 0.01 })
            .collect();
        Candidate {
            effects: effects.to_vec(),
            name: name.to_owned(),
            probability,
            evidence_gain: 0.0,
            parameters,
        }
    }

    fn region_told(axis: &'static str, gain: f64) -> RegionTold {
        RegionTold { axis, unit: "1", gain, at: vec![], acceleration_m_s2: vec![], sigma_m_s2: vec![] }
    }

    fn said(verdict: diagnosis::Verdict, effects: Vec<&'static str>) -> Diagnosis {
        let none = [None; 3];
        Diagnosis {
            schema: "bench.diagnosis/1",
            verdict,
            effects,
            confidence: 0.7,
            calibrated: false,
            candidates: vec![
                candidate("rotor-lag+gusts", &["rotor-lag", "gusts"], 0.7),
                candidate("none", &[], 0.21),
                candidate("unknown", &[], 0.09),
            ],
            numbers: vec![],
            gap: Gap {
                metric: "",
                nominal: 0.0,
                parameters_only: 0.0,
                with_effect: 0.0,
                floor: 0.0,
                closure: None,
                held_out: false,
                k_step_m: KStep { nominal: none, parameters_only: none, with_effect: none },
            },
            place: Place {
                stage: Some("propulsion"),
                regions: vec![
                    region_told("altitude", 4.0),
                    region_told("change of thrust over weight", 9.0),
                    region_told("time in flight", 2.0),
                ],
                unexplained: 0.0,
            },
            flights: vec![],
            warnings: vec![],
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
        // 1.645 deviations of 0.01 to either side.
        assert!((told.parameters[1].low - 0.18355).abs() < 1e-12 && told.parameters[1].effect == "gusts");
    }

    #[test]
    fn none_names_neither_stage_nor_axis_nor_parameters() {
        let told = answer(&said(diagnosis::Verdict::None, vec![]));
        told.check().unwrap();
        assert_eq!((told.stage, told.region), (None, None));
        assert!(told.parameters.is_empty() && told.effects.is_empty());
    }
}
