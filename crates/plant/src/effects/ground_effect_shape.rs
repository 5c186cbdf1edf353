//! The ground effect reaches further, or fades without an edge.

use bench_rig::Airframe;

use super::{Axis, Effect, EffectRng, EffectSpec, Parameter, Prior, Signature, Stage};
use crate::nominal::{Air, Nominal};

/// The nominal straight line to a height becomes a power of one: from a line to another height to an exponential.
pub(super) static SPEC: EffectSpec = EffectSpec {
    name: "ground-effect-shape",
    stage: Stage::Environment,
    summary: "the ground effect reaches to another height, or fades without an edge",
    law: "extra' = (1 - share) extra + share (multiplier - 1) max(0, 1 - z/(s n height))^n: a line for n = 1, exp(-z/(s height)) for n without bound",
    source: "He, Kou, Calaf, Leang, In-Ground-Effect Modeling and Nonlinear-Disturbance Observer for Multirotor Unmanned Aerial Vehicle Control, ASME Journal of Dynamic Systems, Measurement, and Control 141(7), 2019: exponential model, the limit of this family; Sanchez-Cuevas, Heredia, Ollero, Characterization of the Aerodynamic Ground Effect and Its Influence in Multirotor Control, International Journal of Aerospace Engineering, 2017: what the airframe's body adds reaches further than each rotor's own, so that two shapes act together",
    parameters: &[
        Parameter {
            key: "stretch",
            unit: "1",
            meaning: "reach s of the ground effect over the nominal",
            min: 0.1,
            max: 10.0,
            prior: Prior::LogNormal { median: 1.0, sigma_ln: 0.5 },
            neutral: Some(1.0),
            default: None,
        },
        Parameter {
            key: "exponent",
            unit: "1",
            meaning: "exponent n of the fall with height",
            min: 0.3,
            max: 50.0,
            prior: Prior::LogNormal { median: 2.0, sigma_ln: 0.8 },
            neutral: Some(1.0),
            default: None,
        },
        Parameter {
            key: "share",
            unit: "1",
            meaning: "share of the ground effect that has this shape; the rest has the nominal one",
            min: 0.0,
            max: 2.0,
            prior: Prior::Normal { mean: 1.0, sigma: 0.5 },
            neutral: None,
            default: Some(1.0),
        },
    ],
    signature: Signature { axes: &[Axis::Altitude], ..Signature::LAW },
    build,
};

fn build(values: &[f64], airframe: &Airframe, _: EffectRng) -> Box<dyn Effect> {
    let nominal = Nominal::new(airframe);
    let [stretch, exponent, share] = [values[0], values[1], values[2]];
    Box::new(GroundEffectShape {
        fall_per_m: (airframe.ground_effect.height_m.value * stretch * exponent).recip(),
        exponent,
        share,
        nominal,
    })
}

struct GroundEffectShape {
    nominal: Nominal,
    fall_per_m: f64,
    exponent: f64,
    share: f64,
}

impl Effect for GroundEffectShape {
    fn ground_effect(&self, air: &Air, ground_effect: &mut f64) {
        let depth = (1.0 - air.height_m.max(0.0) * self.fall_per_m).max(0.0);
        let shaped = self.nominal.ground_effect_gain * depth.powf(self.exponent);
        // As a difference, so that what other effects made of the nominal law stays.
        *ground_effect += self.share * (shaped - self.nominal.ground_effect(air.height_m));
    }
}

#[cfg(test)]
mod tests {
    use crate::{
        effects::testing::{air, effect, rig},
        nominal::Nominal,
    };

    fn extra(values: &[f64], height_m: f64) -> f64 {
        let mut extra = Nominal::new(&rig().airframe).ground_effect(height_m);
        effect("ground-effect-shape", values).ground_effect(&air(height_m, 0.0), &mut extra);
        extra
    }

    #[test]
    fn it_goes_from_a_longer_line_to_an_exponential() {
        // Multiplier 1.3 to 5 cm. Twice as far on a line: 0.3, 0.3/2, 0 at 0, 5, 10 cm.
        for (height_m, expected) in [(0.0, 0.3), (0.05, 0.15), (0.1, 0.0)] {
            assert!((extra(&[2.0, 1.0], height_m) - expected).abs() < 1e-12);
        }
        // The square of a line to 10 cm, falling as steeply at the ground as the nominal: 0.3 (1/2)^2 at 5 cm.
        assert!((extra(&[1.0, 2.0], 0.05) - 0.075).abs() < 1e-12);
        // Half of it to 10 cm, half the nominal line to 5 cm.
        assert!((extra(&[2.0, 1.0, 0.5], 0.05) - 0.075).abs() < 1e-12);
        // (1 - x/50)^50 is e^-x to x^2/100: 1 % at 5 cm.
        assert!((extra(&[1.0, 50.0], 0.05) / (0.3 * (-1.0_f64).exp()) - 1.0).abs() < 0.011);
    }
}
