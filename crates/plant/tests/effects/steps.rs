//! A law means the same at any step.

use bench_device::Sticks;
use bench_plant::{
    effects::{Effects, LIBRARY},
    nominal::Air,
};
use bench_rig::Model;
use nalgebra::Vector3;

use crate::bench::{Flight, entry, rig, sticks, typical};

/// Means over 0.1 s spans of what actuator and propulsion make of inputs held over each span, in steps of `dt_s`.
fn means_of_spans(library_index: usize, dt_s: f64) -> Vec<f64> {
    let spec = LIBRARY[library_index];
    let rig = rig(Model::Vertical);
    let weight_n = rig.airframe.weight_n();
    let mut effects = Effects::default();
    effects.add(library_index, &typical(spec), &rig.airframe, 1);
    let steps = (0.1_f64 / dt_s).round() as u32;
    let mut means = Vec::new();
    for ratio in [0.5, 1.2, 1.2, 0.3, 1.0] {
        let mut sum = [0.0; 5];
        for _ in 0..steps {
            let mut heard = Sticks { pitch: 1.0 + ratio, ..sticks(&rig, ratio) };
            let mut thrust_n = ratio * weight_n;
            for effect in &mut effects.actuator {
                effect.drive(&mut heard);
                effect.actuate(dt_s, &mut heard);
            }
            for effect in &mut effects.propulsion {
                effect.propel(dt_s, &mut thrust_n);
            }
            let [throttle, pitch, roll, yaw] = heard.to_array();
            for (sum, value) in sum.iter_mut().zip([throttle, pitch, roll, yaw, thrust_n]) {
                *sum += value;
            }
        }
        means.extend(sum.map(|sum| sum / f64::from(steps)));
    }
    means
}

#[test]
fn with_inputs_held_one_long_step_is_exactly_a_thousand_short_ones() {
    for (index, spec) in LIBRARY.iter().enumerate() {
        let (long, short) = (means_of_spans(index, 0.1), means_of_spans(index, 1e-4));
        for (long, short) in long.iter().zip(&short) {
            // Rounding of a thousand additions.
            assert!((long - short).abs() < 1e-11, "{}: {long} and {short}", spec.name);
        }
    }
}

/// Largest difference in height between flights in steps of 20 ms and of 0.5 ms, over a climb out of the ground effect and
/// a descent, all before touching the ground.
fn largest_difference_m(library_index: usize) -> f64 {
    let spec = LIBRARY[library_index];
    let mut rig = rig(Model::Vertical);
    rig.effects.push(entry(spec, &typical(spec)));
    let (mut coarse, mut fine) = (Flight::new(&rig), Flight::new(&rig));
    let mut largest = 0.0_f64;
    for ratio in [1.25, 1.25, 1.25, 1.0, 0.8, 0.8, 0.8, 1.1, 0.9, 0.9, 1.1] {
        coarse.hold(0.1, 0.02, sticks(&rig, ratio));
        fine.hold(0.1, 0.0005, sticks(&rig, ratio));
        largest = largest.max((coarse.height_m() - fine.height_m()).abs());
    }
    assert!(fine.height_m() > 0.1, "{}", spec.name);
    largest
}

#[test]
fn a_flight_in_steps_of_20_ms_is_that_in_steps_of_half_a_millisecond() {
    for (index, spec) in LIBRARY.iter().enumerate() {
        if spec.name == "gusts" {
            // Random: other steps, other draws. Its unit tests compare the statistics.
            continue;
        }
        // With thrust taken at its mean over each step, speed is exact at the ends and height off by dt^2/12 times the
        // change of acceleration: 0.4 mm for the 12 m/s^2 of a launch; the kink at 5 cm costs about as much again.
        let difference_m = largest_difference_m(index);
        assert!(difference_m < 1e-3, "{}: {difference_m} m", spec.name);
    }
}

/// Integral of what the lagging ground effect is ahead of the static one, while the airframe accelerates upwards from the
/// ground at 1 m/s^2; means over steps by Simpson's rule, as the body's integrator takes them.
fn integral_ahead(dt_s: f64) -> f64 {
    let index = LIBRARY.iter().position(|spec| spec.name == "ground-effect-dynamic").unwrap();
    let mut effects = Effects::default();
    effects.add(index, &[0.1, 1.0, 0.0], &rig(Model::Vertical).airframe, 1);
    let air_at = |t: f64| Air {
        height_m: 0.5 * t * t,
        velocity_m_s: Vector3::new(0.0, 0.0, t),
        tilt_cos: 1.0,
        free_thrust_n: 0.15,
    };
    let mut integral = 0.0;
    for step in 0..(0.3_f64 / dt_s).round() as u32 {
        let start_s = f64::from(step) * dt_s;
        effects.air[0].advance(dt_s, &air_at(start_s));
        for (share, weight) in [(0.0, 1.0), (0.5, 4.0), (1.0, 1.0)] {
            let mut ahead = 0.0;
            effects.air[0].ground_effect(&air_at(start_s + share * dt_s), &mut ahead);
            integral += ahead * weight * dt_s / 6.0;
        }
    }
    integral
}

#[test]
fn the_dynamic_ground_effect_converges_with_order_two_at_least() {
    // The static value falls by 0.3 over 5 cm, so by 6 t a second: d' = -d/tau + 6 t, for 0.3 s or 4.5 cm.
    let (tau, t): (f64, f64) = (0.1, 0.3);
    let exact = 6.0 * tau * (0.5 * t * t - tau * (t + tau * (-t / tau).exp_m1()));
    let (coarse, fine) = ((integral_ahead(0.02) - exact).abs(), (integral_ahead(0.01) - exact).abs());
    let order = (coarse / fine).log2();
    assert!(order > 1.8 && coarse < 0.01 * exact, "order {order}: {coarse} and {fine} of {exact}");
}
