//! Pressure drag, which the nominal linear drag lacks.

use bench_rig::Airframe;
use nalgebra::Vector3;

use super::{Axis, Effect, EffectRng, EffectSpec, Parameter, Prior, Signature, Stage, power};
use crate::nominal::Air;

/// Drag with the square of speed, on top of the linear drag.
pub(super) static SPEC: EffectSpec = EffectSpec {
    name: "quadratic-drag",
    stage: Stage::Airframe,
    summary: "drag grows with the square of speed, or about so",
    law: "F = -k |v|^(p - 1) v, v in m/s",
    source: "Hoerner, Fluid-Dynamic Drag, 1965, chapter 1: k = density x drag coefficient x area / 2",
    parameters: &[
        Parameter {
            key: "coefficient_n_s2_per_m2",
            unit: "N s^2/m^2",
            meaning: "coefficient k",
            min: 0.0,
            max: 1.0,
            prior: Prior::LogNormal { median: 0.008, sigma_ln: 1.0 },
            neutral: Some(0.0),
            default: None,
        },
        Parameter {
            key: "exponent",
            unit: "1",
            meaning: "power of speed",
            min: 1.0,
            max: 4.0,
            prior: Prior::LogNormal { median: 2.0, sigma_ln: 0.2 },
            neutral: None,
            default: Some(2.0),
        },
    ],
    signature: Signature { axes: &[Axis::Speed], ..Signature::LAW },
    build,
};

fn build(values: &[f64], _: &Airframe, _: EffectRng) -> Box<dyn Effect> {
    Box::new(QuadraticDrag { coefficient: values[0], exponent: values[1] })
}

struct QuadraticDrag {
    coefficient: f64,
    exponent: f64,
}

impl Effect for QuadraticDrag {
    fn force(&self, air: &Air, force_n: &mut Vector3<f64>) {
        let speed_m_s = air.velocity_m_s.norm();
        // At rest the power of a power below two is no number.
        if speed_m_s > 0.0 {
            *force_n -= air.velocity_m_s * (self.coefficient * power(speed_m_s, self.exponent - 1.0));
        }
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

    #[test]
    fn drag_may_go_with_another_power_of_speed_and_rests_with_the_airframe() {
        let drag = effect("quadratic-drag", &[0.01, 1.5]);
        let at = |speed_m_s| {
            let mut force_n = Vector3::zeros();
            drag.force(&air(1.0, speed_m_s), &mut force_n);
            force_n.z
        };
        assert!((at(-4.0) - 0.08).abs() < 1e-12);
        assert_eq!(at(0.0), 0.0);
    }
}
