//! The tracker is slower or faster than the rig says.

use bench_rig::Airframe;

use super::{Effect, EffectRng, EffectSpec, Frame, Parameter, Prior, Reading, RigNumber, Signature, Stage};

/// Each frame arrives later by a constant.
pub(super) static SPEC: EffectSpec = EffectSpec {
    name: "tracker-latency",
    stage: Stage::Tracker,
    summary: "frames arrive later (or earlier) than the nominal latency",
    law: "latency = max(0, latency_nominal + extra)",
    source: "Wright, Model-based development of MAV altitude control via ground-based equipment, section 2: pure delay of the tracking chain",
    parameters: &[Parameter {
        key: "extra_s",
        unit: "s",
        meaning: "latency beyond the nominal one",
        min: -0.2,
        max: 0.5,
        prior: Prior::Normal { mean: 0.0, sigma: 0.03 },
        neutral: Some(0.0),
        default: None,
    }],
    signature: Signature {
        view: |values, view| view.latency_s += values[0],
        reading: Some(Reading::Latency),
        adds_to: &[(RigNumber::Latency, 0)],
        lag: true,
        confounded_with: &["actuator-lag", "rotor-lag"],
        ..Signature::LAW
    },
    build,
};

fn build(values: &[f64], _: &Airframe, _: EffectRng) -> Box<dyn Effect> {
    Box::new(TrackerLatency { extra_s: values[0] })
}

struct TrackerLatency {
    extra_s: f64,
}

impl Effect for TrackerLatency {
    fn expose(&mut self, frame: &mut Frame) {
        frame.latency_s = (frame.latency_s + self.extra_s).max(0.0);
    }
}

#[cfg(test)]
mod tests {
    use crate::effects::{
        Frame,
        testing::{effect, frame},
    };

    #[test]
    fn latency_shifts_by_the_extra_but_never_below_zero() {
        let mut late = frame();
        effect("tracker-latency", &[0.05]).expose(&mut late);
        assert!((late.latency_s - 0.35).abs() < 1e-15);

        let mut instant = Frame { latency_s: 0.1, ..frame() };
        effect("tracker-latency", &[-0.2]).expose(&mut instant);
        assert_eq!(instant.latency_s, 0.0);
    }
}
