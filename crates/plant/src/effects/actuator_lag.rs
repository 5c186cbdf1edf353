//! Between the output's pin and the motors' command: input filter, hand controller, radio.

use bench_device::Sticks;
use bench_rig::Airframe;

use super::{
    Axis, Effect, EffectRng, EffectSpec, Parameter, Prior, Reading, Signature, Stage,
    lag::{SECOND_ORDER, TwoLags},
};

/// All four sticks pass a lag, of first order or second.
pub(super) static SPEC: EffectSpec = EffectSpec {
    name: "actuator-lag",
    stage: Stage::Actuator,
    summary: "the motors hear the sticks through a lag",
    law: "a tau^2 u'' + tau u' + u = pin",
    source: "Stevens, Lewis, Johnson, Aircraft Control and Simulation, 3rd ed., 2015: actuators as first-order lags",
    parameters: &[
        Parameter {
            key: "time_constant_s",
            unit: "s",
            meaning: "time constant of all four sticks",
            min: 0.0,
            max: 2.0,
            prior: Prior::LogNormal { median: 0.05, sigma_ln: 0.9 },
            neutral: Some(0.0),
            default: None,
        },
        SECOND_ORDER,
    ],
    signature: Signature {
        axes: &[Axis::ThrustChange],
        reading: Some(Reading::PinLag),
        lag: true,
        confounded_with: &["tracker-latency", "rotor-lag"],
        ..Signature::LAW
    },
    build,
};

fn build(values: &[f64], _: &Airframe, _: EffectRng) -> Box<dyn Effect> {
    Box::new(ActuatorLag { time_constant_s: values[0], second_order: values[1], lags: None })
}

struct ActuatorLag {
    time_constant_s: f64,
    second_order: f64,
    /// Settled on the first input: the hand controller was on before the flight began.
    lags: Option<[TwoLags; 4]>,
}

impl Effect for ActuatorLag {
    fn actuate(&mut self, dt_s: f64, sticks: &mut Sticks) {
        let mut values = sticks.to_array();
        let (time_constant_s, second_order) = (self.time_constant_s, self.second_order);
        let lags = self
            .lags
            .get_or_insert_with(|| values.map(|value| TwoLags::new(time_constant_s, second_order, value)));
        for (value, lag) in values.iter_mut().zip(lags) {
            *value += lag.advance(dt_s, *value, 1.0).mean;
        }
        *sticks = Sticks::from_array(values);
    }
}

#[cfg(test)]
mod tests {
    use bench_device::Sticks;

    use crate::effects::testing::effect;

    #[test]
    fn after_a_step_all_sticks_go_63_percent_of_the_way_in_one_time_constant() {
        let mut lag = effect("actuator-lag", &[0.1]);
        let mut heard = Sticks::from_array([1.0, 2.0, 2.0, 2.0]);
        lag.actuate(0.1, &mut heard);
        assert_eq!(heard, Sticks::from_array([1.0, 2.0, 2.0, 2.0]));
        for _ in 0..1000 {
            heard = Sticks::from_array([2.0, 1.0, 2.0, 3.0]);
            lag.actuate(1e-4, &mut heard);
        }
        // The value is the mean of the last 0.1 ms step, a thousandth of the time constant.
        let left = (-1.0_f64).exp();
        for (value, expected) in heard.to_array().into_iter().zip([2.0 - left, 1.0 + left, 2.0, 3.0 - left]) {
            assert!((value - expected).abs() < 1e-3, "{value}, not {expected}");
        }
    }

    #[test]
    fn of_second_order_it_may_be_two_lags_in_series() {
        let mut lag = effect("actuator-lag", &[0.1, 0.24]);
        let mut throttle = 0.0;
        lag.actuate(1e-4, &mut Sticks::default());
        for _ in 0..1000 {
            let mut sticks = Sticks { throttle: 1.0, ..Sticks::default() };
            lag.actuate(1e-4, &mut sticks);
            throttle = sticks.throttle;
        }
        // 60 and 40 ms in series, after 100 ms.
        let (a, b): (f64, f64) = (0.06, 0.04);
        let expected = 1.0 - (a * (-0.1 / a).exp() - b * (-0.1 / b).exp()) / (a - b);
        assert!((throttle - expected).abs() < 1e-3);
    }
}
