//! Descending, rotors sink into their own wake: the way into the vortex ring state.

use bench_rig::Airframe;

use super::{Axis, Effect, EffectRng, EffectSpec, Parameter, Prior, Signature, Stage, power};
use crate::nominal::Air;

/// Thrust is lost in descent, smoothly from none at rest to a fraction beyond a speed.
pub(super) static SPEC: EffectSpec = EffectSpec {
    name: "descent-thrust-loss",
    stage: Stage::Airframe,
    summary: "thrust is lost in descent, in the rotors' own wake",
    law: "T' = T (1 - fraction (1 - exp(-d^p)) exp(-q d)), d = max(0, -v_z - onset)/speed",
    source: "Johnson, Model for Vortex Ring State Influence on Rotorcraft Flight Dynamics, NASA/TP-2005-213477, 2005; here its onset alone, as one smooth step in descent speed",
    parameters: &[
        Parameter {
            key: "fraction",
            unit: "1",
            meaning: "fraction of thrust lost in fast descent",
            min: 0.0,
            max: 0.9,
            prior: Prior::LogNormal { median: 0.15, sigma_ln: 0.7 },
            neutral: Some(0.0),
            default: None,
        },
        Parameter {
            key: "speed_m_s",
            unit: "m/s",
            meaning: "descent speed, beyond the onset, at which 63 % of that is lost",
            min: 0.02,
            max: 50.0,
            prior: Prior::LogNormal { median: 0.8, sigma_ln: 0.7 },
            neutral: None,
            default: None,
        },
        Parameter {
            key: "exponent",
            unit: "1",
            meaning: "power of speed with which it begins",
            min: 0.5,
            max: 8.0,
            prior: Prior::LogNormal { median: 2.0, sigma_ln: 0.35 },
            neutral: None,
            default: Some(2.0),
        },
        Parameter {
            key: "recovery",
            unit: "1",
            meaning: "how soon it is over, faster still",
            min: 0.0,
            max: 4.0,
            prior: Prior::Normal { mean: 0.0, sigma: 0.8 },
            neutral: None,
            default: Some(0.0),
        },
        Parameter {
            key: "onset_m_s",
            unit: "m/s",
            meaning: "descent speed below which nothing is lost",
            min: 0.0,
            max: 20.0,
            prior: Prior::Normal { mean: 0.0, sigma: 0.12 },
            neutral: None,
            default: Some(0.0),
        },
    ],
    signature: Signature { axes: &[Axis::Speed], ..Signature::LAW },
    build,
};

fn build(values: &[f64], _: &Airframe, _: EffectRng) -> Box<dyn Effect> {
    Box::new(DescentThrustLoss {
        fraction: values[0],
        speed_m_s: values[1],
        exponent: values[2],
        recovery: values[3],
        onset_m_s: values[4],
    })
}

struct DescentThrustLoss {
    fraction: f64,
    speed_m_s: f64,
    exponent: f64,
    recovery: f64,
    onset_m_s: f64,
}

impl Effect for DescentThrustLoss {
    fn thrust(&self, air: &Air, thrust_n: &mut f64) {
        let descent = (-air.velocity_m_s.z - self.onset_m_s).max(0.0) / self.speed_m_s;
        if descent > 0.0 {
            let lost = self.fraction * -(-power(descent, self.exponent)).exp_m1();
            let still = if self.recovery == 0.0 { 1.0 } else { (-self.recovery * descent).exp() };
            *thrust_n *= 1.0 - lost * still;
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::effects::testing::{air, effect};

    #[test]
    fn nothing_is_lost_in_climb_63_percent_at_the_speed_and_all_beyond() {
        let loss = effect("descent-thrust-loss", &[0.2, 0.5]);
        let lost_at = |speed_m_s| {
            let mut thrust_n = 1.0;
            loss.thrust(&air(1.0, speed_m_s), &mut thrust_n);
            1.0 - thrust_n
        };
        assert_eq!(lost_at(1.0), 0.0);
        assert_eq!(lost_at(0.0), 0.0);
        assert!((lost_at(-0.5) - 0.2 * (1.0 - (-1.0_f64).exp())).abs() < 1e-12);
        assert!((lost_at(-3.0) - 0.2).abs() < 1e-12);
    }

    #[test]
    fn nothing_may_be_lost_below_an_onset() {
        let loss = effect("descent-thrust-loss", &[0.2, 0.5, 1.0, 0.0, 0.1]);
        let lost_at = |speed_m_s| {
            let mut thrust_n = 1.0;
            loss.thrust(&air(1.0, speed_m_s), &mut thrust_n);
            1.0 - thrust_n
        };
        assert_eq!(lost_at(-0.1), 0.0);
        assert!((lost_at(-0.6) - 0.2 * (1.0 - (-1.0_f64).exp())).abs() < 1e-12);
    }

    #[test]
    fn the_loss_may_begin_with_another_power_and_be_over_in_fast_descent() {
        let loss = effect("descent-thrust-loss", &[0.2, 0.5, 1.0, 0.5]);
        let mut thrust_n = 1.0;
        loss.thrust(&air(1.0, -1.0), &mut thrust_n);
        let expected = 0.2 * (1.0 - (-2.0_f64).exp()) * (-1.0_f64).exp();
        assert!((1.0 - thrust_n - expected).abs() < 1e-12);
    }
}
