//! Pressure drag, which the nominal linear drag lacks.

use bench_rig::Rig;
use nalgebra::Vector3;

use super::{Effect, EffectRng, EffectSpec, Parameter, Prior, Stage};
use crate::nominal::Air;

/// Drag with the square of speed, on top of the linear drag.
pub(super) static SPEC: EffectSpec = EffectSpec {
    name: "quadratic-drag",
    stage: Stage::Airframe,
    summary: "drag grows with the square of speed",
    law: "F = -k |v| v",
    source: "Hoerner, Fluid-Dynamic Drag, 1965, chapter 1: k = density x drag coefficient x area / 2",
    parameters: &[Parameter {
        key: "coefficient_n_s2_per_m2",
        unit: "N s^2/m^2",
        meaning: "coefficient k",
        min: 0.0,
        max: 1.0,
        prior: Prior::LogNormal { median: 0.008, sigma_ln: 1.0 },
        neutral: Some(0.0),
    }],
    build,
};

fn build(values: &[f64], _: &Rig, _: EffectRng) -> Box<dyn Effect> {
    Box::new(QuadraticDrag { coefficient: values[0] })
}

struct QuadraticDrag {
    coefficient: f64,
}

impl Effect for QuadraticDrag {
    fn force(&self, air: &Air, force_n: &mut Vector3<f64>) {
        *force_n -= air.velocity_m_s * (self.coefficient * air.velocity_m_s.norm());
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use crate::effects::testing::{air, effect};

    #[test]
    fn force_opposes_velocity_with_the_square_of_its_size() {
        let mut moving = air(1.0, 0.0);
        moving.velocity_m_s = Vector3::new(3.0, 0.0, -4.0);
        let mut force_n = Vector3::zeros();
        effect("quadratic-drag", &[0.01]).force(&moving, &mut force_n);
        // 0.01 x 5^2 = 0.25 N against the velocity.
        assert!((force_n - Vector3::new(-0.15, 0.0, 0.2)).norm() < 1e-15);
    }
}
