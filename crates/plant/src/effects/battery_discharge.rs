//! Thrust fades as the battery empties.

use bench_rig::Airframe;

use super::{Axis, Effect, EffectRng, EffectSpec, Parameter, Prior, Signature, Stage, lag::mean_decay};

/// Thrust falls in proportion to the charge drawn.
pub(super) static SPEC: EffectSpec = EffectSpec {
    name: "battery-discharge",
    stage: Stage::Propulsion,
    summary: "thrust fades with the charge drawn",
    law: "T' = T (1 - L), dL/dq = k max(0, 1 + b q), dq/dt = T'/W (q in minutes of hover)",
    source: "Shepherd, Design of Primary and Secondary Cells II, Journal of the Electrochemical Society 112(7), 1965: the part of the discharge curve that is linear in charge",
    parameters: &[
        Parameter {
            key: "loss_per_hover_minute",
            unit: "1/min",
            meaning: "fraction of thrust lost per charge of one minute of hover",
            min: 0.0,
            max: 1.0,
            prior: Prior::LogNormal { median: 0.04, sigma_ln: 0.8 },
            neutral: Some(0.0),
            default: None,
        },
        Parameter {
            key: "bend_per_hover_minute",
            unit: "1/min",
            meaning: "growth of that loss with the charge drawn, relative",
            min: -5.0,
            max: 20.0,
            prior: Prior::Normal { mean: 0.0, sigma: 0.8 },
            neutral: None,
            default: Some(0.0),
        },
    ],
    signature: Signature {
        axes: &[Axis::Charge, Axis::Time, Axis::Voltage],
        fades: true,
        confounded_with: &["battery-load"],
        ..Signature::LAW
    },
    build,
};

fn build(values: &[f64], airframe: &Airframe, _: EffectRng) -> Box<dyn Effect> {
    let loss_per_newton_second = values[0] / (60.0 * airframe.weight_n());
    Box::new(BatteryDischarge {
        loss_per_newton_second,
        bend_per_newton_second: values[1] / (60.0 * airframe.weight_n()),
        drawn_newton_s: 0.0,
        kept: 1.0,
    })
}

struct BatteryDischarge {
    loss_per_newton_second: f64,
    bend_per_newton_second: f64,
    drawn_newton_s: f64,
    /// `1 - k q`: with thrust held it decays exponentially, as less thrust draws less charge; so it stays above zero.
    kept: f64,
}

impl Effect for BatteryDischarge {
    fn propel(&mut self, dt_s: f64, free_thrust_n: &mut f64) {
        let bend = (1.0 + self.bend_per_newton_second * self.drawn_newton_s).max(0.0);
        let decay = self.loss_per_newton_second * bend * *free_thrust_n * dt_s;
        *free_thrust_n *= self.kept * mean_decay(decay);
        self.drawn_newton_s += *free_thrust_n * dt_s;
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

    #[test]
    fn the_loss_may_grow_with_the_charge_drawn() {
        let weight_n = rig().airframe.weight_n();
        let lost_after_a_minute = |bend: f64| {
            let mut battery = effect("battery-discharge", &[0.04, bend]);
            let mut thrust_n = 0.0;
            for _ in 0..60_000 {
                thrust_n = weight_n;
                battery.propel(1e-3, &mut thrust_n);
            }
            1.0 - thrust_n / weight_n
        };
        // k (q + b q^2/2); the charge drawn is less than a minute of hover by some 2 %, as thrust fades.
        assert!((lost_after_a_minute(1.0) - 0.06).abs() < 0.06 * 0.05);
        assert!((lost_after_a_minute(-1.0) - 0.02).abs() < 0.02 * 0.05);
    }
}
