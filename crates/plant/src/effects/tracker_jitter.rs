//! Frames wait for a computer that is busy with other things.

use bench_rig::Airframe;
use rand_distr::{Distribution, Exp1};

use super::{Effect, EffectRng, EffectSpec, Frame, Parameter, Prior, Reading, Signature, Spread, Stage};

/// Each frame waits for an exponentially distributed time of its own.
pub(super) static SPEC: EffectSpec = EffectSpec {
    name: "tracker-jitter",
    stage: Stage::Tracker,
    summary: "frames wait for a random time, so latency varies (and grows by its mean)",
    law: "latency = latency_nominal + sigma E, E exponential with mean and deviation one",
    source: "Kleinrock, Queueing Systems, vol. 1, 1975: time spent in a queue with one server (M/M/1) is exponential",
    parameters: &[Parameter {
        key: "sigma_s",
        unit: "s",
        meaning: "standard deviation, and mean, of the wait",
        min: 0.0,
        max: 1.0,
        prior: Prior::LogNormal { median: 0.015, sigma_ln: 0.8 },
        neutral: Some(0.0),
        default: None,
    }],
    signature: Signature {
        // A wait is never negative: its mean adds to the latency.
        view: |values, view| view.latency_s += values[0],
        reading: Some(Reading::LateFrames),
        ..Signature::spread(Spread::LateFrames)
    },
    build,
};

fn build(values: &[f64], _: &Airframe, rng: EffectRng) -> Box<dyn Effect> {
    Box::new(TrackerJitter { sigma_s: values[0], rng })
}

/// A wait is never negative, so jitter cannot leave the mean latency alone: what a rig states as latency is that of an
/// idle computer.
struct TrackerJitter {
    sigma_s: f64,
    rng: EffectRng,
}

impl Effect for TrackerJitter {
    fn expose(&mut self, frame: &mut Frame) {
        let wait: f64 = Exp1.sample(&mut self.rng);
        frame.latency_s += self.sigma_s * wait;
    }
}

#[cfg(test)]
mod tests {
    use crate::effects::testing::{effect, frame, mean_and_deviation};

    #[test]
    fn waits_have_the_mean_and_deviation_asked_for_and_are_never_negative() {
        let mut jitter = effect("tracker-jitter", &[0.02]);
        let waits: Vec<f64> = (0..20_000)
            .map(|_| {
                let mut seen = frame();
                jitter.expose(&mut seen);
                seen.latency_s - frame().latency_s
            })
            .collect();
        let (mean, deviation) = mean_and_deviation(&waits);
        // One sigma of the mean of 20,000 is 0.7 %, of the deviation (kurtosis 9) 1 %; five of them.
        assert!((mean / 0.02 - 1.0).abs() < 0.035, "mean {mean}");
        assert!((deviation / 0.02 - 1.0).abs() < 0.05, "deviation {deviation}");
        assert!(waits.iter().all(|wait| *wait >= 0.0));
    }
}
