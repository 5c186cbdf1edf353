//! The tracker's calibration is off.

use bench_rig::Airframe;

use super::{Axis, Effect, EffectRng, EffectSpec, Frame, Parameter, Prior, RigNumber, Signature, Stage};

/// Positions are stretched about the origin, and altitude is offset.
pub(super) static SPEC: EffectSpec = EffectSpec {
    name: "tracker-scale",
    stage: Stage::Tracker,
    summary: "positions are scaled, and altitude is offset",
    law: "p = (1 + scale_error + bend z_true) p_true + (0, 0, bias)",
    source: "Khoshelham and Oude Elberink, Accuracy and Resolution of Kinect Depth Data for Indoor Mapping Applications, Sensors 12(2), 2012: linear calibration",
    parameters: &[
        Parameter {
            key: "scale_error",
            unit: "1",
            meaning: "scale of all three axes, less one",
            min: -0.5,
            max: 0.5,
            prior: Prior::Normal { mean: 0.0, sigma: 0.03 },
            neutral: Some(0.0),
            default: None,
        },
        Parameter {
            key: "bias_m",
            unit: "m",
            meaning: "offset of the altitude",
            min: -0.5,
            max: 0.5,
            prior: Prior::Normal { mean: 0.0, sigma: 0.01 },
            neutral: Some(0.0),
            default: None,
        },
        Parameter {
            key: "bend_per_m",
            unit: "1/m",
            meaning: "growth of the scale over altitude",
            min: -0.5,
            max: 0.5,
            prior: Prior::Normal { mean: 0.0, sigma: 0.02 },
            neutral: Some(0.0),
            default: Some(0.0),
        },
    ],
    signature: Signature {
        axes: &[Axis::Altitude],
        view: |values, view| {
            view.factor *= 1.0 + values[0];
            view.offset_m += values[1];
            view.bend_per_m += values[2];
        },
        adds_to: &[(RigNumber::Origin, 1)],
        ..Signature::LAW
    },
    build,
};

fn build(values: &[f64], _: &Airframe, _: EffectRng) -> Box<dyn Effect> {
    Box::new(TrackerScale { scale: 1.0 + values[0], bias_m: values[1], bend_per_m: values[2] })
}

struct TrackerScale {
    scale: f64,
    bias_m: f64,
    bend_per_m: f64,
}

impl Effect for TrackerScale {
    fn expose(&mut self, frame: &mut Frame) {
        frame.position_m *= self.scale + self.bend_per_m * frame.position_m.z;
        frame.position_m.z += self.bias_m;
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use crate::effects::{
        Frame,
        testing::{effect, frame},
    };

    #[test]
    fn all_axes_scale_and_only_altitude_is_offset() {
        let mut seen = Frame { position_m: Vector3::new(0.2, -0.4, 1.0), ..frame() };
        effect("tracker-scale", &[0.05, 0.01]).expose(&mut seen);
        assert!((seen.position_m - Vector3::new(0.21, -0.42, 1.06)).norm() < 1e-15);
    }

    #[test]
    fn the_scale_may_change_over_altitude() {
        let mut lens = effect("tracker-scale", &[0.0, 0.0, 0.1]);
        let mut frame = frame();
        lens.expose(&mut frame);
        assert!((frame.position_m.z - 0.5 * 1.05).abs() < 1e-12);
    }
}
