//! Thrust fades as the battery empties.

use bench_rig::Rig;

use super::{Effect, EffectRng, EffectSpec, Parameter, Prior, Stage, lag::mean_decay};

/// Thrust falls in proportion to the charge drawn.
pub(super) static SPEC: EffectSpec = EffectSpec {
    name: "battery-discharge",
    stage: Stage::Propulsion,
    summary: "thrust fades with the charge drawn",
    law: "T' = T (1 - k q), dq/dt = T'/W (q in minutes of hover)",
    source: "Shepherd, Design of Primary and Secondary Cells II, Journal of the Electrochemical Society 112(7), 1965: the part of the discharge curve that is linear in charge",
    parameters: &[Parameter {
        key: "loss_per_hover_minute",
        unit: "1/min",
        meaning: "fraction of thrust lost per charge of one minute of hover",
        min: 0.0,
        max: 1.0,
        prior: Prior::LogNormal { median: 0.04, sigma_ln: 0.8 },
        neutral: Some(0.0),
    }],
    build,
};

fn build(values: &[f64], rig: &Rig, _: EffectRng) -> Box<dyn Effect> {
    let loss_per_newton_second = values[0] / (60.0 * rig.airframe.weight_n());
    Box::new(BatteryDischarge { loss_per_newton_second, kept: 1.0 })
}

struct BatteryDischarge {
    loss_per_newton_second: f64,
    /// `1 - k q`: with thrust held it decays exponentially, as less thrust draws less charge; so it stays above zero.
    kept: f64,
}

impl Effect for BatteryDischarge {
    fn propel(&mut self, dt_s: f64, free_thrust_n: &mut f64) {
        let decay = self.loss_per_newton_second * *free_thrust_n * dt_s;
        *free_thrust_n *= self.kept * mean_decay(decay);
        self.kept *= (-decay).exp();
    }
}

#[cfg(test)]
mod tests {
    use crate::effects::testing::{effect, rig};

    #[test]
    fn a_minute_at_the_hover_throttle_draws_what_the_loss_allows() {
        let weight_n = rig().airframe.weight_n();
        let mut battery = effect("battery-discharge", &[0.1]);
        let mut charge_min = 0.0;
        for _ in 0..600 {
            let mut thrust_n = weight_n;
            battery.propel(0.1, &mut thrust_n);
            charge_min += thrust_n / weight_n * 0.1 / 60.0;
        }
        // q' = 1 - 0.1 q over one minute: q = (1 - e^-0.1)/0.1, and thrust is down to e^-0.1.
        assert!((charge_min - (1.0 - (-0.1_f64).exp()) / 0.1).abs() < 1e-12);
        let mut thrust_n = weight_n;
        battery.propel(1e-6, &mut thrust_n);
        assert!((thrust_n / weight_n - (-0.1_f64).exp()).abs() < 1e-8);
    }
}
