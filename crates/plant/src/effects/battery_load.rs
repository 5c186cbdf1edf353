//! The battery's voltage sags under load and recovers.

use bench_rig::Airframe;

use super::{Axis, Effect, EffectRng, EffectSpec, Parameter, Prior, Signature, Stage, lag::Lag};

/// Thrust falls with the current drawn of late.
pub(super) static SPEC: EffectSpec = EffectSpec {
    name: "battery-load",
    stage: Stage::Propulsion,
    summary: "thrust sags with the load on the battery, and recovers",
    law: "T' = max(0, T (1 - sag (p P + (1 - p) s))), P = (T/W)^1.5, ds/dt = (P - s)/tau",
    source: "Chen and Rincón-Mora, Accurate Electrical Battery Model Capable of Predicting Runtime and I-V Performance, IEEE Transactions on Energy Conversion 21(2), 2006: resistance with a first-order transient; power of a rotor as thrust to 1.5 (momentum theory)",
    parameters: &[
        Parameter {
            key: "sag",
            unit: "1",
            meaning: "fraction of thrust lost in steady hover",
            min: 0.0,
            max: 0.5,
            prior: Prior::LogNormal { median: 0.05, sigma_ln: 0.8 },
            neutral: Some(0.0),
            default: None,
        },
        Parameter {
            key: "time_constant_s",
            unit: "s",
            meaning: "time constant of sag and recovery",
            min: 0.0,
            max: 60.0,
            prior: Prior::LogNormal { median: 1.0, sigma_ln: 1.0 },
            neutral: None,
            default: None,
        },
        Parameter {
            key: "prompt_share",
            unit: "1",
            meaning: "share of the sag that comes and goes at once",
            min: 0.0,
            max: 1.0,
            prior: Prior::Normal { mean: 0.0, sigma: 0.4 },
            neutral: None,
            default: Some(0.0),
        },
    ],
    signature: Signature {
        axes: &[Axis::ThrustToWeight, Axis::ThrustChange, Axis::Voltage],
        // A sag that takes longer to recover is one of charge.
        fitted_up_to: &[("time_constant_s", 4.0)],
        confounded_with: &["battery-discharge"],
        ..Signature::LAW
    },
    build,
};

fn build(values: &[f64], airframe: &Airframe, _: EffectRng) -> Box<dyn Effect> {
    Box::new(BatteryLoad {
        sag: values[0],
        weight_n: airframe.weight_n(),
        load: Lag::new(values[1], 0.0),
        prompt_share: values[2],
    })
}

struct BatteryLoad {
    sag: f64,
    prompt_share: f64,
    weight_n: f64,
    /// Electrical power over that in hover, as the battery's chemistry has noticed it. Rested at first.
    load: Lag,
}

impl Effect for BatteryLoad {
    fn propel(&mut self, dt_s: f64, free_thrust_n: &mut f64) {
        let power = (*free_thrust_n / self.weight_n).powf(1.5);
        let late = power + self.load.advance(dt_s, power).mean;
        let load = late + self.prompt_share * (power - late);
        *free_thrust_n = (*free_thrust_n * (1.0 - self.sag * load)).max(0.0);
    }
}

#[cfg(test)]
mod tests {
    use crate::effects::testing::{effect, rig};

    #[test]
    fn sag_builds_up_with_its_time_constant_and_grows_with_thrust_to_one_and_a_half() {
        let weight_n = rig().airframe.weight_n();
        let mut battery = effect("battery-load", &[0.05, 2.0]);
        let mut after = |seconds: f64, ratio: f64| {
            let mut thrust_n = 0.0;
            for _ in 0..(seconds / 1e-3).round() as usize {
                thrust_n = ratio * weight_n;
                battery.propel(1e-3, &mut thrust_n);
            }
            1.0 - thrust_n / (ratio * weight_n)
        };
        // The value is the mean of the last 1 ms step, 1/2000 of the time constant.
        assert!((after(2.0, 1.0) - 0.05 * (1.0 - (-1.0_f64).exp())).abs() < 0.05 * 1e-3);
        assert!((after(60.0, 1.44) - 0.05 * 1.728).abs() < 1e-9);
    }

    #[test]
    fn the_prompt_share_of_the_sag_comes_at_once() {
        let mut battery = effect("battery-load", &[0.05, 2.0, 0.4]);
        let weight_n = rig().airframe.weight_n();
        let mut thrust_n = weight_n;
        battery.propel(1e-6, &mut thrust_n);
        assert!((1.0 - thrust_n / weight_n - 0.4 * 0.05).abs() < 1e-6);
    }
}
