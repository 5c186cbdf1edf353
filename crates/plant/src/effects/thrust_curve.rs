//! Thrust is not linear in throttle.

use bench_rig::Airframe;

use super::{Axis, Effect, EffectRng, EffectSpec, Parameter, Prior, Signature, Stage};

/// Thrust bends about the hover point.
pub(super) static SPEC: EffectSpec = EffectSpec {
    name: "thrust-curve",
    stage: Stage::Propulsion,
    summary: "thrust bends with throttle, about the hover point",
    law: "T' = max(0, T (1 + c x + d x^2)), x = (T - W)/W",
    source: "Förster, System Identification of the Crazyflie 2.0 Nano Quadrocopter, ETH Zurich, 2015: thrust as a polynomial of second degree in the command",
    parameters: &[
        Parameter {
            key: "curvature",
            unit: "1",
            meaning: "curvature c: relative gain of thrust at twice the hover thrust",
            min: -1.0,
            max: 2.0,
            prior: Prior::Normal { mean: 0.0, sigma: 0.2 },
            neutral: Some(0.0),
            default: None,
        },
        Parameter {
            key: "cubic",
            unit: "1",
            meaning: "coefficient d of the cubic part",
            min: -1.0,
            max: 1.0,
            prior: Prior::Normal { mean: 0.0, sigma: 0.1 },
            neutral: Some(0.0),
            default: Some(0.0),
        },
    ],
    signature: Signature { axes: &[Axis::ThrustToWeight], ..Signature::LAW },
    build,
};

fn build(values: &[f64], airframe: &Airframe, _: EffectRng) -> Box<dyn Effect> {
    Box::new(ThrustCurve { curvature: values[0], cubic: values[1], weight_n: airframe.weight_n() })
}

struct ThrustCurve {
    curvature: f64,
    cubic: f64,
    weight_n: f64,
}

impl Effect for ThrustCurve {
    fn propel(&mut self, _: f64, free_thrust_n: &mut f64) {
        let beyond_hover = (*free_thrust_n - self.weight_n) / self.weight_n;
        *free_thrust_n =
            (*free_thrust_n * (1.0 + (self.curvature + self.cubic * beyond_hover) * beyond_hover)).max(0.0);
    }
}

#[cfg(test)]
mod tests {
    use crate::effects::testing::{effect, rig};

    #[test]
    fn hover_stays_and_a_curvature_of_one_is_a_parabola() {
        let weight_n = rig().airframe.weight_n();
        let mut curve = effect("thrust-curve", &[1.0]);
        for ratio in [0.0, 0.5, 1.0, 1.5] {
            let mut thrust_n = ratio * weight_n;
            curve.propel(1e-3, &mut thrust_n);
            assert!((thrust_n / weight_n - ratio * ratio).abs() < 1e-12);
        }
    }

    #[test]
    fn the_curve_may_bend_back() {
        let mut curve = effect("thrust-curve", &[0.2, -0.1]);
        let weight_n = rig().airframe.weight_n();
        let mut thrust_n = 1.5 * weight_n;
        curve.propel(0.01, &mut thrust_n);
        assert!((thrust_n / weight_n - 1.5 * (1.0 + 0.1 - 0.025)).abs() < 1e-12);
    }
}
