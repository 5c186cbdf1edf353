//! The tracker's calibration is off.

use bench_rig::Rig;

use super::{Effect, EffectRng, EffectSpec, Frame, Parameter, Prior, Stage};

/// Positions are stretched about the origin, and altitude is offset.
pub(super) static SPEC: EffectSpec = EffectSpec {
    name: "tracker-scale",
    stage: Stage::Tracker,
    summary: "positions are scaled, and altitude is offset",
    law: "p = (1 + scale_error) p_true + (0, 0, bias)",
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
        },
        Parameter {
            key: "bias_m",
            unit: "m",
            meaning: "offset of the altitude",
            min: -0.5,
            max: 0.5,
            prior: Prior::Normal { mean: 0.0, sigma: 0.01 },
            neutral: Some(0.0),
        },
    ],
    build,
};

fn build(values: &[f64], _: &Rig, _: EffectRng) -> Box<dyn Effect> {
    Box::new(TrackerScale { scale: 1.0 + values[0], bias_m: values[1] })
}

struct TrackerScale {
    scale: f64,
    bias_m: f64,
}

impl Effect for TrackerScale {
    fn expose(&mut self, frame: &mut Frame) {
        frame.position_m *= self.scale;
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
}
