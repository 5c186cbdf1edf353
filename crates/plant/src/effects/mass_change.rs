//! Something was added to or taken off the airframe.

use bench_rig::Airframe;

use super::{Effect, EffectRng, EffectSpec, Parameter, Prior, Signature, Stage};

/// The mass differs from the nominal one.
pub(super) static SPEC: EffectSpec = EffectSpec {
    name: "mass-change",
    stage: Stage::Airframe,
    summary: "the airframe is heavier (or lighter) than it should be",
    law: "m' = (1 + fraction) m",
    source: "Mellinger, Lindsey, Shomin, Kumar, Design, modeling, estimation and control for aerial grasping and manipulation, IROS 2011: payload mass",
    parameters: &[Parameter {
        key: "fraction",
        unit: "1",
        meaning: "mass added over nominal mass",
        min: -0.5,
        max: 1.0,
        prior: Prior::Normal { mean: 0.0, sigma: 0.05 },
        neutral: Some(0.0),
        default: None,
    }],
    signature: Signature { confounded_with: &["thrust-loss"], ..Signature::LAW },
    build,
};

fn build(values: &[f64], _: &Airframe, _: EffectRng) -> Box<dyn Effect> {
    Box::new(MassChange { ratio: 1.0 + values[0] })
}

struct MassChange {
    ratio: f64,
}

impl Effect for MassChange {
    fn mass(&self, mass_kg: &mut f64) {
        *mass_kg *= self.ratio;
    }
}

#[cfg(test)]
mod tests {
    use crate::effects::testing::effect;

    #[test]
    fn a_tenth_more_makes_15_g_into_16_and_a_half() {
        let mut mass_kg = 0.015;
        effect("mass-change", &[0.1]).mass(&mut mass_kg);
        assert!((mass_kg - 0.0165).abs() < 1e-15);
    }
}
