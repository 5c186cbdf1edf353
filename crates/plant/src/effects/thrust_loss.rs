//! A worn or cut propeller, a weak motor; or a fresh one, when the loss is negative.

use bench_rig::Airframe;

use super::{Axis, Effect, EffectRng, EffectSpec, Parameter, Prior, Signature, Stage};

/// A constant fraction of the thrust is missing.
pub(super) static SPEC: EffectSpec = EffectSpec {
    name: "thrust-loss",
    stage: Stage::Propulsion,
    summary: "a constant fraction of the thrust is missing",
    law: "T' = (1 - fraction) T",
    source: "Zhang and Jiang, Bibliographical review on reconfigurable fault-tolerant control systems, Annual Reviews in Control 32(2), 2008: loss of effectiveness",
    parameters: &[Parameter {
        key: "fraction",
        unit: "1",
        meaning: "fraction of thrust lost; gained when negative",
        min: -0.5,
        max: 0.9,
        prior: Prior::Normal { mean: 0.0, sigma: 0.06 },
        neutral: Some(0.0),
        default: None,
    }],
    signature: Signature {
        axes: &[Axis::ThrustToWeight],
        confounded_with: &["mass-change"],
        ..Signature::LAW
    },
    build,
};

fn build(values: &[f64], _: &Airframe, _: EffectRng) -> Box<dyn Effect> {
    Box::new(ThrustLoss { kept: 1.0 - values[0] })
}

struct ThrustLoss {
    kept: f64,
}

impl Effect for ThrustLoss {
    fn propel(&mut self, _: f64, free_thrust_n: &mut f64) {
        *free_thrust_n *= self.kept;
    }
}

#[cfg(test)]
mod tests {
    use crate::effects::testing::effect;

    #[test]
    fn thrust_is_short_by_the_fraction() {
        let mut thrust_n = 0.2;
        effect("thrust-loss", &[0.05]).propel(1e-3, &mut thrust_n);
        assert!((thrust_n - 0.19).abs() < 1e-15);
    }
}
