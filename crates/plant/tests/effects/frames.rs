//! What the effects of tracker and loop do to frames and timing, through the lab.

use bench_device::{Clock, PositionSample, PositionSource, Time, VoltageOutput};
use bench_plant::lab::Lab;
use bench_rig::{Model, Rig};

use crate::bench::{entry, rig, spec, sticks};

/// An ideal tracker, so that what is seen is the effect's, with or without one.
fn ideal(effect: Option<(&str, &[f64])>) -> Rig {
    let mut rig = rig(Model::Vertical);
    rig.plant.step_s = 0.02;
    rig.plant.truth_period_s = 10.0;
    rig.tracker.noise_m = 0.0;
    rig.tracker.resolution_m = 0.0;
    rig.tracker.dropout_probability = 0.0;
    rig.effects.extend(effect.map(|(name, values)| entry(spec(name), values)));
    rig
}

/// The frames of a climb; effects of the tracker do not change it, as nobody steers.
fn climb(effect: Option<(&str, &[f64])>, duration_s: f64) -> Vec<PositionSample> {
    let rig = ideal(effect);
    let mut lab = Lab::new(&rig, 1).unwrap();
    lab.output.write(sticks(&rig, 1.02)).unwrap();
    lab.clock.wait_until(Time::from_seconds(duration_s)).unwrap();
    let frames: Vec<_> = std::iter::from_fn(|| lab.tracker.poll().unwrap()).collect();
    assert!(frames.len() > 10);
    frames
}

/// Pairs of a nominal frame and the same frame with an effect that loses none.
fn pairs(name: &str, values: &[f64], duration_s: f64) -> Vec<(PositionSample, PositionSample)> {
    climb(None, duration_s).into_iter().zip(climb(Some((name, values)), duration_s)).collect()
}

fn altitude_errors(pairs: &[(PositionSample, PositionSample)]) -> Vec<f64> {
    pairs.iter().map(|(nominal, seen)| seen.position_m[2] - nominal.position_m[2]).collect()
}

fn root_mean_square(values: &[f64]) -> f64 {
    (values.iter().map(|x| x * x).sum::<f64>() / values.len() as f64).sqrt()
}

#[test]
fn tracker_latency_delays_every_frame_and_the_computer_does_not_know() {
    for (nominal, late) in pairs("tracker-latency", &[0.05], 5.0) {
        // Times are whole nanoseconds.
        assert!((late.arrived_at.since_s(nominal.arrived_at) - 0.05).abs() < 2e-9);
        assert!((late.arrived_at.since_s(late.exposed_at) - 0.3).abs() < 2e-9);
        assert_eq!(late.position_m, nominal.position_m);
    }
}

#[test]
fn tracker_jitter_spreads_arrivals_but_keeps_their_order() {
    let pairs = pairs("tracker-jitter", &[0.005], 60.0);
    let waits: Vec<_> =
        pairs.iter().map(|(nominal, late)| late.arrived_at.since_s(nominal.arrived_at)).collect();
    assert!(waits.iter().all(|wait| *wait > -2e-9));
    assert!(pairs.windows(2).all(|pair| pair[0].1.arrived_at <= pair[1].1.arrived_at));
    // An exponential wait has a mean square of 2 sigma^2; 1800 of them know its root to 2.6 %. Four sigmas.
    assert!((root_mean_square(&waits) / (0.005 * 2.0_f64.sqrt()) - 1.0).abs() < 0.11);
}

#[test]
fn tracker_scale_stretches_altitude_and_offsets_it() {
    for (nominal, seen) in pairs("tracker-scale", &[0.04, -0.02], 5.0) {
        assert!((seen.position_m[2] - (1.04 * nominal.position_m[2] - 0.02)).abs() < 1e-12);
    }
}

#[test]
fn tracker_noise_adds_to_an_ideal_tracker() {
    let errors = altitude_errors(&pairs("tracker-noise", &[0.003], 60.0));
    // 1800 frames know the deviation to 1.7 %; four sigmas.
    assert!((root_mean_square(&errors) / 0.003 - 1.0).abs() < 0.07);
}

#[test]
fn tracker_outliers_spoil_some_frames_and_leave_the_others() {
    let errors = altitude_errors(&pairs("tracker-outliers", &[0.1, 0.5], 60.0));
    let wrong: Vec<_> = errors.iter().copied().filter(|error| *error != 0.0).collect();
    // 180 of 1800 with a deviation of 13; their deviation is known to 5 %. Four sigmas.
    assert!((wrong.len() as f64 - 180.0).abs() < 52.0, "{}", wrong.len());
    assert!((root_mean_square(&wrong) / 0.5 - 1.0).abs() < 0.21);
}

#[test]
fn tracker_dropout_loses_frames_in_runs_and_leaves_the_others() {
    let nominal = climb(None, 300.0);
    let seen = climb(Some(("tracker-dropout", &[0.2, 8.0])), 300.0);
    assert!(seen.iter().all(|frame| nominal.contains(frame)));
    // 9000 frames in about 225 bursts of 8: one sigma of the share lost is 0.017. Four sigmas.
    let lost = 1.0 - seen.len() as f64 / nominal.len() as f64;
    assert!((lost - 0.2).abs() < 0.07, "{lost}");
    let period_s = nominal[1].exposed_at.since_s(nominal[0].exposed_at);
    let gaps: Vec<_> = seen
        .windows(2)
        .map(|pair| (pair[1].exposed_at.since_s(pair[0].exposed_at) / period_s).round() - 1.0)
        .filter(|gap| *gap > 0.0)
        .collect();
    let mean = gaps.iter().sum::<f64>() / gaps.len() as f64;
    // Geometric lengths: a deviation of 7.5 over the root of 225 bursts is 0.5. Four sigmas.
    assert!((mean - 8.0).abs() < 2.0, "{mean}");
}

#[test]
fn loop_overrun_wakes_some_iterations_late() {
    let mut lab = Lab::new(&ideal(Some(("loop-overrun", &[0.3, 0.02]))), 1).unwrap();
    let lateness: Vec<_> = (1..=2000)
        .map(|tick| {
            let due = Time::from_seconds(f64::from(tick));
            lab.clock.wait_until(due).unwrap().since_s(due)
        })
        .collect();
    let late: Vec<_> = lateness.iter().copied().filter(|lateness| *lateness > 0.0).collect();
    // 600 of 2000 with a deviation of 20; an exponential's root mean square, known to 4.6 %. Four sigmas.
    assert!((late.len() as f64 - 600.0).abs() < 82.0, "{}", late.len());
    assert!((root_mean_square(&late) / (0.02 * 2.0_f64.sqrt()) - 1.0).abs() < 0.19);
}
