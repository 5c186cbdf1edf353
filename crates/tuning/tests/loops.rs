//! The loop's response and its margins, held against theory and against flights.

use std::{f64::consts::TAU, path::Path};

use bench_recording::Record;
use bench_rig::{Mission, PhaseAction, PhasePlan, Rig};
use bench_run::simulate;
use bench_tuning::Response;
use nalgebra::{Complex, Matrix2, Vector2};

fn rig(name: &str) -> Rig {
    Rig::load(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs").join(name)).unwrap()
}

/// The vertical model between samples: state (z, v) under a held acceleration with drag, over `h` seconds.
fn held(drag_per_s: f64, h: f64) -> (Matrix2<f64>, Vector2<f64>) {
    let decay = (-drag_per_s * h).exp();
    let s = (1.0 - decay) / drag_per_s;
    (Matrix2::new(1.0, s, 0.0, decay), Vector2::new((h - s) / drag_per_s, s))
}

/// From the acceleration asked for at the iterations to the altitude seen `age_s` before them (modified z-transform).
fn seen(drag_per_s: f64, period_s: f64, age_s: f64, z: Complex<f64>) -> Complex<f64> {
    let whole = (age_s / period_s).floor();
    let rest_s = period_s - (age_s - whole * period_s);
    let (full, gamma) = held(drag_per_s, period_s);
    let (part, part_gamma) = held(drag_per_s, rest_s);
    let resolvent = (Matrix2::identity() * z - full.map(Complex::from)).try_inverse().unwrap();
    let state = resolvent * gamma.map(Complex::from);
    let at = part.map(Complex::from) * state + part_gamma.map(Complex::from);
    at[0] * z.powi(-(whole as i32) - 1)
}

/// Weights of the least-squares slope over frames at these ages.
fn slope(ages_s: &[f64]) -> Vec<f64> {
    let mean = ages_s.iter().sum::<f64>() / ages_s.len() as f64;
    let squares: f64 = ages_s.iter().map(|age| (age - mean).powi(2)).sum();
    ages_s.iter().map(|age| (mean - age) / squares).collect()
}

#[test]
fn the_response_of_the_papers_law_is_its_transfer_function() {
    let rig = rig("virtual.toml");
    let (control, period_s, frame_s) = (&rig.control, rig.control_loop.period_s, rig.tracker.frame_period_s);
    // The phase of the frames within an iteration is drawn with the lab's seed.
    let idle = PhasePlan { action: PhaseAction::Idle, duration_s: 2.0 };
    let mission = Mission { phases: vec![idle], ..Mission::default() };
    let mut quiet = rig.clone();
    quiet.tracker.dropout_probability = 0.0;
    let mut records: Vec<Record> = Vec::new();
    simulate(&quiet, &mission, 0, &mut records, |_| true).unwrap();
    let now_s = 2.0;
    let newest_s = records
        .iter()
        .filter_map(|record| match record {
            Record::Position(sample) if sample.arrived_at.seconds() <= now_s => {
                Some(sample.exposed_at.seconds())
            }
            _ => None,
        })
        .fold(0.0, f64::max);

    let ages: Vec<f64> = (0..13).map(|j| now_s - newest_s + f64::from(j) * frame_s).collect();
    // Windows of 0.2 s hold seven frames each and share one.
    let (recent, before) = (slope(&ages[..7]), slope(&ages[6..]));
    let apart_s = 6.0 * frame_s;
    let drag_per_s = rig.airframe.drag_n_s_per_m.value / rig.airframe.mass_kg.value;
    let expected = |hz: f64| {
        let z = Complex::from_polar(1.0, TAU * hz * period_s);
        let at: Vec<Complex<f64>> = ages.iter().map(|age| seen(drag_per_s, period_s, *age, z)).collect();
        let sum = |weights: &[f64], at: &[Complex<f64>]| {
            weights.iter().zip(at).map(|(weight, at)| at * *weight).sum::<Complex<f64>>()
        };
        let (v, v_before) = (sum(&recent, &at[..7]), sum(&before, &at[6..]));
        let velocity = v + (v - v_before) / apart_s * control.extrapolation_s;
        let position = at[0] + v * control.extrapolation_s;
        let error = position * control.position_gain_per_s + velocity;
        error * (z / (z - 1.0) * (control.integral_gain_per_s2 * period_s) + control.speed_gain_per_s)
    };
    let response = Response::of_altitude(&rig, 0.4, 0.0).expect("the paper's law is stable");
    assert!(response.frequency_hz.len() > 40);
    for (hz, [re, im]) in response.frequency_hz.iter().zip(&response.gain) {
        let (found, expected) = (Complex::new(*re, *im), expected(*hz));
        // The lab's instants are whole nanoseconds and its integration is of fourth order; the rest is arithmetic.
        assert!((found / expected - 1.0).norm() < 2e-3, "{hz} Hz: {found} instead of {expected}");
    }
}

#[test]
fn the_loop_is_lost_where_the_delay_margin_says() {
    let rig = rig("virtual-model.toml");
    let margins = |extra_s: f64| Response::of_altitude(&rig, 0.4, extra_s).map(|response| response.margins());
    let margin_s = margins(0.0).unwrap().delay_s.unwrap();
    // A delay used up is a delay less; frequencies are 8 % apart, which blurs the crossing.
    let half = margins(0.5 * margin_s).unwrap().delay_s.unwrap();
    assert!((half / margin_s - 0.5).abs() < 0.05, "{half} of {margin_s}");
    assert!(margins(0.85 * margin_s).is_some());
    assert!(margins(1.2 * margin_s).is_none());
}

#[test]
fn a_loop_that_is_not_stable_has_no_response() {
    let mut wild = rig("virtual.toml");
    wild.control.speed_gain_per_s = 8.0;
    assert_eq!(Response::of_altitude(&wild, 0.4, 0.0), None);
    let lateral = Response::of_lateral(&rig("virtual.toml"), 0.4, 0.0).unwrap().margins();
    assert!(lateral.delay_s.unwrap() > 0.3, "{lateral:?}");
}
