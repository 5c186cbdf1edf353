//! Climbing, blades meet the air at a smaller angle; descending, at a larger one.

use bench_rig::Rig;

use super::{Effect, EffectRng, EffectSpec, Parameter, Prior, Stage};
use crate::nominal::Air;

/// Thrust falls with climb speed, in proportion to rotor speed.
pub(super) static SPEC: EffectSpec = EffectSpec {
    name: "inflow-damping",
    stage: Stage::Airframe,
    summary: "thrust falls in climb and grows in descent",
    law: "T' = T - c W v_z sqrt(T/W)",
    source: "Bristeau, Martin, Salaün, Petit, The Role of Propeller Aerodynamics in the Model of a Quadrotor UAV, European Control Conference 2009: thrust with rotor speed times axial speed",
    parameters: &[Parameter {
        key: "coefficient_s_per_m",
        unit: "s/m",
        meaning: "fraction c of the hover thrust lost per climb speed",
        min: 0.0,
        max: 2.0,
        prior: Prior::LogNormal { median: 0.06, sigma_ln: 0.8 },
        neutral: Some(0.0),
    }],
    build,
};

fn build(values: &[f64], rig: &Rig, _: EffectRng) -> Box<dyn Effect> {
    let weight_n = rig.airframe.weight_n();
    Box::new(InflowDamping { damping_n_s_per_m: values[0] * weight_n, weight_n })
}

struct InflowDamping {
    damping_n_s_per_m: f64,
    weight_n: f64,
}

impl Effect for InflowDamping {
    fn thrust(&self, air: &Air, thrust_n: &mut f64) {
        let rotor_speed = (*thrust_n / self.weight_n).max(0.0).sqrt();
        *thrust_n -= self.damping_n_s_per_m * air.velocity_m_s.z * rotor_speed;
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
}
