//! Rotors take time to change speed.

use bench_rig::Airframe;

use super::{
    Axis, Effect, EffectRng, EffectSpec, Parameter, Prior, Signature, Stage,
    lag::{SECOND_ORDER, TwoLags},
};

/// The rotor's speed follows the commanded one with a lag of first order or second; faster up than down, or not.
pub(super) static SPEC: EffectSpec = EffectSpec {
    name: "rotor-lag",
    stage: Stage::Propulsion,
    summary: "rotor speed follows its command with a lag",
    law: "T' = w^2, a tau^2 w'' + tau w' + w = sqrt(T); tau sqrt(r) while w falls, tau/sqrt(r) while it rises",
    source: "Mahony, Kumar, Corke, Multirotor Aerial Vehicles, IEEE Robotics and Automation Magazine 19(3), 2012: motor dynamics, thrust as speed squared; Furrer, Burri, Achtelik, Siegwart, RotorS, 2016: rotors that slow down more slowly than they speed up",
    parameters: &[
        Parameter {
            key: "time_constant_s",
            unit: "s",
            meaning: "time constant of rotor speed",
            min: 0.0,
            max: 2.0,
            prior: Prior::LogNormal { median: 0.05, sigma_ln: 0.9 },
            neutral: Some(0.0),
            default: None,
        },
        Parameter {
            key: "fall_ratio",
            unit: "1",
            meaning: "time constant of slowing down over that of speeding up",
            min: 0.1,
            max: 10.0,
            prior: Prior::LogNormal { median: 1.0, sigma_ln: 0.75 },
            neutral: None,
            default: Some(1.0),
        },
        SECOND_ORDER,
    ],
    signature: Signature {
        axes: &[Axis::ThrustChange],
        lag: true,
        confounded_with: &["tracker-latency", "actuator-lag"],
        ..Signature::LAW
    },
    build,
};

fn build(values: &[f64], _: &Airframe, _: EffectRng) -> Box<dyn Effect> {
    let [time_constant_s, fall_ratio, second_order] = [values[0], values[1], values[2]];
    Box::new(RotorLag {
        root_thrust: TwoLags::new(time_constant_s, second_order, 0.0),
        rise: fall_ratio.sqrt(),
        fall: fall_ratio.sqrt().recip(),
    })
}

struct RotorLag {
    /// Square root of thrust: proportional to rotor speed. The rotors stand still at first.
    root_thrust: TwoLags,
    /// Paces of speeding up and of slowing down.
    rise: f64,
    fall: f64,
}

impl Effect for RotorLag {
    fn propel(&mut self, dt_s: f64, free_thrust_n: &mut f64) {
        let root = free_thrust_n.sqrt();
        let pace = if self.root_thrust.is_above(root) { self.fall } else { self.rise };
        let short = self.root_thrust.advance(dt_s, root, pace);
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

    #[test]
    fn speeding_up_and_slowing_down_have_time_constants_of_their_own() {
        let mut lag = effect("rotor-lag", &[0.1, 4.0]);
        let mut after = |seconds: f64, commanded_n: f64| {
            let mut thrust_n = 0.0;
            for _ in 0..(seconds / 1e-4).round() as usize {
                thrust_n = commanded_n;
                lag.propel(1e-4, &mut thrust_n);
            }
            thrust_n
        };
        // 0.05 s up and 0.2 s down; values are means of the last 0.1 ms.
        let left = (-1.0_f64).exp();
        assert!((after(0.05, 0.16) - 0.16 * (1.0 - left).powi(2)).abs() < 0.16 * 2e-3);
        after(2.0, 0.16);
        assert!((after(0.2, 0.0) - 0.16 * left.powi(2)).abs() < 0.16 * 1e-3);
    }
}
