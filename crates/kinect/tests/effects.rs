//! The library's effects on the tracker act on the frames, so what they do to positions is measured, not assumed.

use std::path::Path;

use bench_device::{Clock, PositionSample, PositionSource, Sticks, Time, TrackStatus, VoltageOutput};
use bench_kinect::{
    TrackedFrames,
    render::{Exposure, Pose, RenderedFrames, Renderer, Settings, scene::Scene},
    track::Tracker,
};
use bench_plant::{
    effects::parse_effect,
    lab::{Lab, TrueState},
};
use bench_rig::Rig;
use nalgebra::Vector3;

const SECONDS: f64 = 3.0;

/// Three seconds of a slow climb at a fixed throttle, with effects: what the tracker told and what was true.
fn fly(effect: Option<&str>) -> (Vec<PositionSample>, Vec<TrueState>) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs/virtual.toml");
    let mut rig = Rig::load(path).unwrap();
    rig.tracker.dropout_probability = 0.0;
    rig.effects.extend(effect.map(|text| parse_effect(text).unwrap()));
    let calibration = rig.calibration.clone().unwrap();
    let Lab { mut clock, mut output, world, .. } = Lab::new(&rig, 4).unwrap();
    let mut exposures = world.clone().into_exposures();
    let poll = move || {
        exposures.poll().map(|exposure| Exposure {
            pose: Pose {
                time: exposure.exposed_at,
                position_m: exposure.position_m,
                velocity_m_s: exposure.velocity_m_s,
                attitude: exposure.attitude,
                body_rate_rad_s: exposure.body_rate_rad_s,
            },
            arrives_at: exposure.arrives_at,
        })
    };
    let renderer = Renderer::new(&calibration, &Scene::bare(), Settings::default(), 4);
    let frames = RenderedFrames::new(renderer, poll);
    let mut tracker =
        TrackedFrames::new(frames, Tracker::new(&calibration), rig.tracker.latency_s.value, |_, _, _| {});
    let throttle = rig.airframe.throttle_for(1.015 * rig.airframe.weight_n());
    output.write(Sticks { throttle, ..rig.airframe.sticks.at_rest() }).unwrap();
    let (mut samples, mut truth) = (Vec::new(), Vec::new());
    for tick in 1..=(SECONDS * 20.0) as u32 {
        clock.wait_until(Time::from_seconds(f64::from(tick) * 0.05)).unwrap();
        while let Some(sample) = tracker.poll().unwrap() {
            samples.push(sample);
        }
        world.drain_truth(|state| truth.push(state));
    }
    (samples, truth)
}

fn altitude_m(truth: &[TrueState], time_s: f64) -> f64 {
    let after = truth.partition_point(|state| state.time.seconds() < time_s).clamp(1, truth.len() - 1);
    let (a, b) = (&truth[after - 1], &truth[after]);
    let share = (time_s - a.time.seconds()) / b.time.since_s(a.time);
    a.position_m.z + (b.position_m.z - a.position_m.z) * share
}

/// Tracked less true altitude at the time that the tracker states.
fn errors_m(samples: &[PositionSample], truth: &[TrueState]) -> Vec<f64> {
    samples
        .iter()
        .filter(|sample| sample.status == TrackStatus::Found)
        .map(|sample| sample.position_m[2] - altitude_m(truth, sample.exposed_at.seconds()))
        .collect()
}

fn mean_and_sigma(values: &[f64]) -> (f64, f64) {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    (mean, (values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt())
}

fn lost(samples: &[PositionSample]) -> usize {
    // The first frame is never believed.
    samples[1..].iter().filter(|sample| sample.status == TrackStatus::Lost).count()
}

#[test]
fn effects_on_the_tracker_show_in_what_is_tracked() {
    let (samples, truth) = fly(None);
    let (plain_mean, plain_sigma) = mean_and_sigma(&errors_m(&samples, &truth));
    let frames = samples.len();
    // Three seconds less the latency, at 30 a second.
    assert!((79..=82).contains(&frames) && lost(&samples) == 0, "{frames}");
    assert!(plain_mean.abs() < 0.001 && plain_sigma < 0.001, "{plain_mean} {plain_sigma}");
    let top = altitude_m(&truth, SECONDS - 0.3);
    assert!(top > 0.3, "a flight that does not climb shows nothing: {top}");

    // Later by 0.1 s: told as if exposed later, so it lags the truth by 0.1 s of climb.
    let (samples, truth) = fly(Some("tracker-latency:extra_s=0.1"));
    let late: Vec<f64> = samples
        .iter()
        .filter(|sample| sample.status == TrackStatus::Found)
        .map(|sample| sample.position_m[2] - altitude_m(&truth, sample.exposed_at.seconds() - 0.1))
        .collect();
    assert!(mean_and_sigma(&late).1 < 0.001 && mean_and_sigma(&late).0.abs() < 0.001);
    assert!(mean_and_sigma(&errors_m(&samples, &truth)).0 < -0.005);

    let (samples, truth) = fly(Some("tracker-jitter:sigma_s=0.04"));
    assert!(mean_and_sigma(&errors_m(&samples, &truth)).1 > 3.0 * plain_sigma);

    // One axis stands for the three: altitude reads 4 % and 2 cm more.
    let (samples, truth) = fly(Some("tracker-scale:scale_error=0.04,bias_m=0.02"));
    for sample in samples.iter().filter(|sample| sample.status == TrackStatus::Found) {
        let expected = 1.04 * altitude_m(&truth, sample.exposed_at.seconds()) + 0.02;
        assert!((sample.position_m[2] - expected).abs() < 0.004, "{} for {expected}", sample.position_m[2]);
    }

    let (samples, truth) = fly(Some("tracker-noise:sigma_m=0.01"));
    let (_, sigma) = mean_and_sigma(&errors_m(&samples, &truth));
    // 80 draws: the deviation is known to 8 %. Three of those.
    assert!((sigma / 0.01 - 1.0).abs() < 0.25, "{sigma}");

    // Frames that are lost never arrive.
    let (samples, _) = fly(Some("tracker-dropout:probability=0.3,mean_burst_frames=3"));
    assert!(samples.len() < frames - 10 && samples.len() > frames / 3, "{}", samples.len());

    // A wrong place is out of the marker's reach: the frame counts as lost.
    let (samples, truth) = fly(Some("tracker-outliers:probability=0.15,sigma_m=0.4"));
    assert!((5..30).contains(&lost(&samples)), "{}", lost(&samples));
    let errors = errors_m(&samples, &truth);
    let near = errors.iter().filter(|error| error.abs() < 0.005).count();
    assert!(near * 20 > errors.len() * 17, "{near} of {}", errors.len());
    assert!(Vector3::from(samples[frames / 2].position_m).norm().is_finite());
}
