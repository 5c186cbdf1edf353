//! The marker is hidden, or the machine vision loses it, for a few frames at a time.

use bench_rig::Airframe;
use rand::RngExt;

use super::{Effect, EffectRng, EffectSpec, Frame, Parameter, Prior, Reading, Signature, Spread, Stage};

/// Frames are lost in bursts: a Markov chain with two states.
pub(super) static SPEC: EffectSpec = EffectSpec {
    name: "tracker-dropout",
    stage: Stage::Tracker,
    summary: "frames are lost in bursts",
    law: "P(seen to lost) = p/(b (1 - p)), P(lost to seen) = 1/b",
    source: "Gilbert, Capacity of a Burst-Noise Channel, Bell System Technical Journal 39(5), 1960",
    parameters: &[
        Parameter {
            key: "probability",
            unit: "1",
            meaning: "share p of all frames that is lost",
            min: 0.0,
            max: 0.95,
            prior: Prior::LogNormal { median: 0.03, sigma_ln: 1.0 },
            neutral: Some(0.0),
            default: None,
        },
        Parameter {
            key: "mean_burst_frames",
            unit: "frames",
            meaning: "mean length b of a burst",
            min: 1.0,
            max: 1000.0,
            prior: Prior::LogNormal { median: 4.0, sigma_ln: 0.7 },
            neutral: None,
            default: None,
        },
    ],
    signature: Signature { reading: Some(Reading::LostFrames), ..Signature::spread(Spread::LostFrames) },
    build,
};

fn build(values: &[f64], _: &Airframe, mut rng: EffectRng) -> Box<dyn Effect> {
    let (probability, mean_burst_frames) = (values[0], values[1]);
    Box::new(TrackerDropout {
        // At most one, since no burst is shorter than a frame and no more than half of all frames are lost.
        begins: probability / (mean_burst_frames * (1.0 - probability)),
        ends: mean_burst_frames.recip(),
        lost: rng.random::<f64>() < probability,
        rng,
    })
}

struct TrackerDropout {
    begins: f64,
    ends: f64,
    lost: bool,
    rng: EffectRng,
}

impl Effect for TrackerDropout {
    fn expose(&mut self, frame: &mut Frame) {
        frame.lost |= self.lost;
        let draw: f64 = self.rng.random();
        self.lost = if self.lost { draw >= self.ends } else { draw < self.begins };
    }
}

#[cfg(test)]
mod tests {
    use crate::effects::testing::{effect, frame};

    #[test]
    fn the_share_lost_and_the_length_of_bursts_are_as_asked_for() {
        let mut dropout = effect("tracker-dropout", &[0.2, 5.0]);
        let lost: Vec<bool> = (0..100_000)
            .map(|_| {
                let mut seen = frame();
                dropout.expose(&mut seen);
                seen.lost
            })
            .collect();
        let total = lost.iter().filter(|lost| **lost).count() as f64;
        let bursts = lost.windows(2).filter(|pair| !pair[0] && pair[1]).count() as f64;
        // About 4000 bursts of mean 5 and deviation 4.5: one sigma of the mean is 1.4 %, of the share about 2 %.
        assert!((total / bursts / 5.0 - 1.0).abs() < 0.07, "{}", total / bursts);
        assert!((total / 100_000.0 / 0.2 - 1.0).abs() < 0.1, "{total}");
    }
}
