//! Climbing, blades meet the air at a smaller angle; descending, at a larger one.

use bench_rig::Airframe;

use super::{Axis, Effect, EffectRng, EffectSpec, Parameter, Prior, Signature, Stage, lag::Lag};
use crate::nominal::Air;

/// Thrust falls with climb speed, in proportion to rotor speed.
pub(super) static SPEC: EffectSpec = EffectSpec {
    name: "inflow-damping",
    stage: Stage::Airframe,
    summary: "thrust falls in climb and grows in descent",
    law: "T' = T - c W w sqrt(T/W), dw/dt = (v_z - w)/tau",
    source: "Bristeau, Martin, Salaün, Petit, The Role of Propeller Aerodynamics in the Model of a Quadrotor UAV, European Control Conference 2009: thrust with rotor speed times axial speed",
    parameters: &[
        Parameter {
            key: "coefficient_s_per_m",
            unit: "s/m",
            meaning: "fraction c of the hover thrust lost per climb speed",
            min: 0.0,
            max: 2.0,
            prior: Prior::LogNormal { median: 0.06, sigma_ln: 0.8 },
            neutral: Some(0.0),
            default: None,
        },
        Parameter {
            key: "time_constant_s",
            unit: "s",
            meaning: "time that the inflow takes to follow the speed",
            min: 0.0,
            max: 2.0,
            prior: Prior::Normal { mean: 0.0, sigma: 0.1 },
            neutral: None,
            default: Some(0.0),
        },
    ],
    signature: Signature { axes: &[Axis::Speed], ..Signature::LAW },
    build,
};

fn build(values: &[f64], airframe: &Airframe, _: EffectRng) -> Box<dyn Effect> {
    let weight_n = airframe.weight_n();
    Box::new(InflowDamping {
        damping_n_s_per_m: values[0] * weight_n,
        weight_n,
        inflow: Lag::new(values[1], 0.0),
        behind_m_s: 0.0,
    })
}

struct InflowDamping {
    damping_n_s_per_m: f64,
    weight_n: f64,
    /// The speed that the inflow has noticed, m/s.
    inflow: Lag,
    /// That speed less the airframe's, mean over the present step.
    behind_m_s: f64,
}

impl Effect for InflowDamping {
    fn advance(&mut self, dt_s: f64, air: &Air) {
        self.behind_m_s = self.inflow.advance(dt_s, air.velocity_m_s.z).mean;
    }

    fn thrust(&self, air: &Air, thrust_n: &mut f64) {
        let rotor_speed = (*thrust_n / self.weight_n).max(0.0).sqrt();
        *thrust_n -= self.damping_n_s_per_m * (air.velocity_m_s.z + self.behind_m_s) * rotor_speed;
    }
}

#[cfg(test)]
mod tests {
    use crate::effects::testing::{air, effect, rig};

    #[test]
    fn a_climb_costs_thrust_with_speed_and_with_the_root_of_thrust() {
        let weight_n = rig().airframe.weight_n();
        let damping = effect("inflow-damping", &[0.1]);
        let change = |ratio: f64, speed_m_s: f64| {
            let mut thrust_n = ratio * weight_n;
            damping.thrust(&air(1.0, speed_m_s), &mut thrust_n);
            thrust_n / weight_n - ratio
        };
        assert!((change(1.0, 0.5) + 0.05).abs() < 1e-12);
        assert!((change(1.0, -0.5) - 0.05).abs() < 1e-12);
        assert!((change(0.25, 0.5) + 0.025).abs() < 1e-12);
    }

    #[test]
    fn the_inflow_may_follow_the_speed_later() {
        let mut damping = effect("inflow-damping", &[0.1, 0.2]);
        let weight_n = rig().airframe.weight_n();
        let mut lost = 0.0;
        for _ in 0..200 {
            damping.advance(1e-3, &air(1.0, 0.5));
            let mut thrust_n = weight_n;
            damping.thrust(&air(1.0, 0.5), &mut thrust_n);
            lost = 1.0 - thrust_n / weight_n;
        }
        // After one time constant; the value is the mean of the last of 200 steps.
        assert!((lost - 0.05 * (1.0 - (-1.0_f64).exp())).abs() < 0.05 * 5e-3);
    }
}
