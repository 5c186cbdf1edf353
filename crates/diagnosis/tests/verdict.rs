//! The verdict alone is that of the whole diagnosis.

#[path = "support/flown.rs"]
mod flown;
mod support;

use bench_diagnosis::{Analysis, Calibration, Diagnosis, Verdict};
use bench_filter::Track;
use bench_inference::Problem;
use bench_plant::effects::parse_effect;
use flown::fly;
use support::rig;

/// As learnt, believing evidence less, and expecting other causes.
fn calibrations() -> [Calibration; 3] {
    let built_in = Calibration::built_in();
    [
        Calibration { misfit_share: 0.015, doubt: 0.2, ..built_in.clone() },
        built_in.with_prior_none(0.5),
        built_in,
    ]
}

#[test]
fn the_verdict_alone_is_that_of_the_diagnosis() {
    let nominal = rig();
    // One of each kind, and pins that are believed as they were read.
    let cases: [&[&str]; 4] = [
        &[],
        &["rotor-lag:time_constant_s=0.1"],
        &["actuator-quantisation:step_fraction=0.05"],
        &["rotor-lag:time_constant_s=0.1", "actuator-quantisation:step_fraction=0.05"],
    ];
    for effects in cases {
        let mut real = nominal.clone();
        real.effects.extend(effects.iter().map(|text| parse_effect(text).unwrap()));
        let flights = ["hop", "steps"].into_iter().zip(1..);
        let tracks: Vec<Track> = flights
            .map(|(name, seed)| Track::from_flight(name, &fly(&real, name, seed), &nominal).unwrap())
            .collect();
        let problem = Problem::new(&tracks, &nominal);
        let mut leaders = Vec::new();
        for calibration in calibrations() {
            let diagnosis = Diagnosis::of(&problem, &calibration);
            let told = Analysis::of(&problem, &calibration).told();
            assert_eq!((told.verdict, &told.effects), (diagnosis.verdict, &diagnosis.effects));
            // What these flights cannot tell apart is one answer: its probability is that of all of it.
            let leading = diagnosis.candidates.iter().find(|candidate| candidate.name == diagnosis.leading);
            assert_eq!(told.probability, leading.unwrap().probability);
            let alternatives: f64 = diagnosis.alternatives.iter().map(|other| other.probability).sum();
            let left_out = diagnosis.confidence - told.probability - alternatives;
            // Alternatives of a probability of 1e-4 or less are not told.
            assert!((-1e-9..0.02).contains(&left_out), "{left_out}");
            // However it is told, it stays ahead, and all of it is one.
            let sum: f64 = diagnosis.candidates.iter().map(|candidate| candidate.probability).sum();
            assert!(sum > 0.98 && sum < 1.0 + 1e-9, "{sum}");
            leaders.push((told.verdict, told.effects, told.probability));
        }
        let [doubting, expecting_none, seen] = leaders.try_into().unwrap();
        assert_eq!((seen.0, &seen.1), (doubting.0, &doubting.1), "{effects:?}");
        assert_eq!((seen.0, &seen.1), (expecting_none.0, &expecting_none.1), "{effects:?}");
        if seen.0 == Verdict::Effect {
            assert!(
                doubting.2 < seen.2 && expecting_none.2 < seen.2,
                "{doubting:?} {expecting_none:?} {seen:?}"
            );
        } else {
            assert!(expecting_none.2 > seen.2, "{expecting_none:?} {seen:?}");
        }
    }
}
