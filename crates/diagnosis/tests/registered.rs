//! An effect that somebody else writes, one file with one row, is simulated, fitted, named and reported as the bench's own.

#[path = "support/flown.rs"]
mod flown;
mod support;

use bench_diagnosis::{Calibration, Diagnosis, Verdict};
use bench_filter::Track;
use bench_inference::Problem;
use bench_plant::{
    effects::{
        Axis, Effect, EffectRng, EffectSpec, LIBRARY, Parameter, Prior, RegisterError, Signature, Stage,
        parse_effect,
    },
    nominal::Air,
};
use bench_rig::Airframe;
use flown::fly;
use nalgebra::Vector3;
use support::rig;

/// Length of the slack cable, m.
const SLACK_M: f64 = 0.1;

/// A cable to the ground that pulls once it is taut.
static TETHER: EffectSpec = tether("tether");
/// Another, which comes too late.
static LATE: EffectSpec = tether("late-tether");

const fn tether(name: &'static str) -> EffectSpec {
    EffectSpec {
        name,
        stage: Stage::Environment,
        summary: "an elastic cable to the ground pulls the airframe down",
        law: "F = -k max(0, z - 0.1 m)",
        source: "Hooke's law",
        parameters: &[Parameter {
            key: "stiffness_n_per_m",
            unit: "N/m",
            meaning: "stiffness of the cable",
            min: 0.0,
            max: 10.0,
            prior: Prior::LogNormal { median: 0.03, sigma_ln: 0.8 },
            neutral: Some(0.0),
            default: None,
        }],
        signature: Signature { axes: &[Axis::Altitude], ..Signature::LAW },
        build: |values: &[f64], _: &Airframe, _: EffectRng| Box::new(Tether { stiffness_n_per_m: values[0] }),
    }
}

struct Tether {
    stiffness_n_per_m: f64,
}

impl Effect for Tether {
    fn force(&self, air: &Air, force_n: &mut Vector3<f64>) {
        force_n.z -= self.stiffness_n_per_m * (air.height_m - SLACK_M).max(0.0);
    }
}

#[test]
fn a_registered_effect_is_flown_fitted_named_and_reported() {
    LIBRARY.register(&TETHER).unwrap();
    assert_eq!(LIBRARY.register(&TETHER), Err(RegisterError::Repeated { name: "tether" }));

    let nominal = rig();
    let mut real = nominal.clone();
    real.effects.push(parse_effect("tether:stiffness_n_per_m=0.05").unwrap());
    let tracks: Vec<Track> = ["hop", "climb-040", "steps", "low-hover"]
        .into_iter()
        .zip(1..)
        .map(|(mission, seed)| Track::from_flight(mission, &fly(&real, mission, seed), &nominal).unwrap())
        .collect();
    let said = Diagnosis::of(&Problem::new(&tracks, &nominal), &Calibration::built_in());

    assert_eq!(said.verdict, Verdict::Effect, "{:#?}", said.candidates);
    assert_eq!(said.effects, ["tether"]);
    let told = &said.candidates[0].parameters[0];
    assert_eq!((told.effect, told.name), ("tether", "stiffness_n_per_m"));
    assert!(told.low <= 0.05 && 0.05 <= told.high, "{told:?}");
    assert!(serde_json::to_string(&said.candidates).unwrap().contains("tether"));

    // Indices into the library are in use by now.
    assert_eq!(LIBRARY.register(&LATE), Err(RegisterError::InUse { name: "late-tether" }));
}
