//! Rotors take time to change speed.

use bench_rig::Rig;

use super::{Effect, EffectRng, EffectSpec, Parameter, Prior, Stage, lag::Lag};

/// The rotor's speed follows the commanded one with a first-order lag.
pub(super) static SPEC: EffectSpec = EffectSpec {
    name: "rotor-lag",
    stage: Stage::Propulsion,
    summary: "rotor speed follows its command with a first-order lag",
    law: "T' = w^2, dw/dt = (sqrt(T) - w)/tau",
    source: "Mahony, Kumar, Corke, Multirotor Aerial Vehicles, IEEE Robotics and Automation Magazine 19(3), 2012: motor dynamics, thrust as speed squared",
    parameters: &[Parameter {
        key: "time_constant_s",
        unit: "s",
        meaning: "time constant of rotor speed",
        min: 0.0,
        max: 2.0,
        prior: Prior::LogNormal { median: 0.05, sigma_ln: 0.9 },
        neutral: Some(0.0),
    }],
    build,
};

fn build(values: &[f64], _: &Rig, _: EffectRng) -> Box<dyn Effect> {
    Box::new(RotorLag { root_thrust: Lag::new(values[0], 0.0) })
}

struct RotorLag {
    /// Square root of thrust: proportional to rotor speed. The rotors stand still at first.
    root_thrust: Lag,
}

impl Effect for RotorLag {
    fn propel(&mut self, dt_s: f64, free_thrust_n: &mut f64) {
        let root = free_thrust_n.sqrt();
        let short = self.root_thrust.advance(dt_s, root);
        // Mean of (root + short)^2.
        *free_thrust_n += 2.0 * root * short.mean + short.mean_square;
    }
}

#[cfg(test)]
mod tests {
    use crate::effects::testing::effect;

    #[test]
    fn after_one_time_constant_speed_is_at_63_percent_and_thrust_at_its_square() {
        let mut lag = effect("rotor-lag", &[0.1]);
        let mut thrust_n = 0.0;
        for _ in 0..1000 {
            thrust_n = 0.16;
            lag.propel(1e-4, &mut thrust_n);
        }
        let speed_ratio = 1.0 - (-1.0_f64).exp();
        // The value is the mean of the last 0.1 ms step, a thousandth of the time constant.
        assert!((thrust_n - 0.16 * speed_ratio * speed_ratio).abs() < 0.16 * 1e-3);
    }
}
