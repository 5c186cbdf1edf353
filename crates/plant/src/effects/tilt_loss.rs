//! The on-board stabiliser does not make up for tilt.

use bench_rig::Airframe;

use super::{Effect, EffectRng, EffectSpec, Parameter, Prior, Shows, Signature, Stage};
use crate::nominal::Air;

/// Vertical thrust is lost in tilt.
pub(super) static SPEC: EffectSpec = EffectSpec {
    name: "tilt-loss",
    stage: Stage::Airframe,
    summary: "tilted, the airframe loses vertical thrust",
    law: "T' = T (1 - fraction (1 - cos(tilt)))",
    source: "Mahony, Kumar, Corke, Multirotor Aerial Vehicles, IEEE Robotics and Automation Magazine 19(3), 2012: thrust along the body axis",
    parameters: &[Parameter {
        key: "fraction",
        unit: "1",
        meaning: "share of the loss that is not made up for; 1: no tilt compensation at all",
        min: 0.0,
        max: 2.0,
        prior: Prior::LogNormal { median: 0.7, sigma_ln: 0.5 },
        neutral: Some(0.0),
        default: None,
    }],
    signature: Signature { shows: Shows::LawWhenTilted, ..Signature::LAW },
    build,
};

fn build(values: &[f64], _: &Airframe, _: EffectRng) -> Box<dyn Effect> {
    Box::new(TiltLoss { fraction: values[0] })
}

struct TiltLoss {
    fraction: f64,
}

impl Effect for TiltLoss {
    fn thrust(&self, air: &Air, thrust_n: &mut f64) {
        *thrust_n *= 1.0 - self.fraction * (1.0 - air.tilt_cos);
    }
}

#[cfg(test)]
mod tests {
    use crate::effects::testing::{air, effect};

    #[test]
    fn without_compensation_vertical_thrust_is_the_cosine_of_the_tilt() {
        let mut tilted = air(1.0, 0.0);
        tilted.tilt_cos = 0.8;
        for (fraction, kept) in [(0.0, 1.0), (0.5, 0.9), (1.0, 0.8)] {
            let mut thrust_n = 1.0;
            effect("tilt-loss", &[fraction]).thrust(&tilted, &mut thrust_n);
            assert!((thrust_n - kept).abs() < 1e-15);
        }
    }
}
