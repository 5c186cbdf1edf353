//! A steady draught: a heater, a fan, the room.

use bench_rig::Airframe;
use nalgebra::Vector3;

use super::{Axis, Effect, EffectRng, EffectSpec, Parameter, Prior, Signature, Stage};
use crate::nominal::Air;

/// So much stronger, as a logarithm, a draught is nowhere than at the take-off surface: a room ends.
const MOST_LN: f64 = 3.0;

/// A steady vertical wind acts through the nominal drag.
pub(super) static SPEC: EffectSpec = EffectSpec {
    name: "updraft",
    stage: Stage::Environment,
    summary: "a steady vertical wind acts through the drag",
    law: "F_z = Cf speed exp(min(growth z, 3))",
    source: "Beard and McLain, Small Unmanned Aircraft: Theory and Practice, 2012, chapter 4: drag on the velocity through the air",
    parameters: &[
        Parameter {
            key: "speed_m_s",
            unit: "m/s",
            meaning: "vertical speed of the air, up, at the take-off surface",
            min: -20.0,
            max: 20.0,
            prior: Prior::Normal { mean: 0.0, sigma: 0.3 },
            neutral: Some(0.0),
            default: None,
        },
        Parameter {
            key: "growth_per_m",
            unit: "1/m",
            meaning: "rate at which it grows with altitude, or fades",
            min: -2.0,
            max: 2.0,
            prior: Prior::Normal { mean: 0.0, sigma: 0.7 },
            neutral: None,
            default: Some(0.0),
        },
    ],
    signature: Signature { axes: &[Axis::Altitude], ..Signature::LAW },
    build,
};

fn build(values: &[f64], airframe: &Airframe, _: EffectRng) -> Box<dyn Effect> {
    Box::new(Updraft { force_n: values[0] * airframe.drag_n_s_per_m.value, growth_per_m: values[1] })
}

struct Updraft {
    force_n: f64,
    growth_per_m: f64,
}

impl Effect for Updraft {
    fn force(&self, air: &Air, force_n: &mut Vector3<f64>) {
        let of_surface = match self.growth_per_m {
            0.0 => 1.0,
            growth_per_m => (growth_per_m * air.height_m.max(0.0)).min(MOST_LN).exp(),
        };
        force_n.z += self.force_n * of_surface;
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use crate::effects::testing::{air, effect};

    #[test]
    fn the_force_is_nominal_drag_times_wind_upwards() {
        let mut force_n = Vector3::zeros();
        effect("updraft", &[0.5]).force(&air(1.0, 0.0), &mut force_n);
        // 0.012 N s/m of drag.
        assert!((force_n - Vector3::new(0.0, 0.0, 0.006)).norm() < 1e-15);
    }

    #[test]
    fn the_wind_may_fade_with_altitude() {
        let mut force_n = Vector3::zeros();
        effect("updraft", &[0.5, -2.0]).force(&air(1.0, 0.0), &mut force_n);
        assert!((force_n.z - 0.006 * (-2.0_f64).exp()).abs() < 1e-15);
    }
}
