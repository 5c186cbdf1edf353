//! What each effect does to a flight, against the same law integrated on paper.
//!
//! Where only thrust matters the rig's drag is taken off, so that speed is the integral of thrust over mass less g. The
//! hooks give means over a step, so speed is then exact at any step but for rounding: 1e-9 m/s.

use bench_plant::body::{Body, SixDegree};
use bench_rig::{GRAVITY_M_S2 as G, Model, Rig};
use nalgebra::{UnitQuaternion, Vector3};

use crate::bench::{Flight, entry, rig, rig_with, spec, sticks, typical};

const EXACT_M_S: f64 = 1e-9;

fn without_drag(name: &str, values: &[f64]) -> Rig {
    let mut rig = rig_with(name, values);
    rig.airframe.drag_n_s_per_m.value = 0.0;
    rig
}

/// Vertical speed after holding a throttle from rest in the free air.
fn speed_after(rig: &Rig, thrust_to_weight: f64, duration_s: f64, dt_s: f64) -> f64 {
    let mut flight = Flight::airborne(rig, 100.0, 0.0);
    flight.hold(duration_s, dt_s, sticks(rig, thrust_to_weight));
    flight.speed_m_s()
}

/// Vertical speed over g and time, from rest in the free air: how far mean thrust over weight is from one.
fn mean_excess(rig: &Rig, thrust_to_weight: f64) -> f64 {
    speed_after(rig, thrust_to_weight, 0.2, 0.01) / (G * 0.2)
}

/// What is left of one after `x` time constants, integrated: `x - (1 - e^-x)`.
fn lagged(x: f64) -> f64 {
    x + (-x).exp_m1()
}

/// Upward acceleration at a height and speed, at the hover throttle, over a step too short to change either.
fn acceleration(rig: &Rig, height_m: f64, speed_m_s: f64) -> f64 {
    let mut flight = Flight::airborne(rig, height_m, speed_m_s);
    flight.step(1e-7, sticks(rig, 1.0));
    (flight.speed_m_s() - speed_m_s) / 1e-7
}

#[test]
fn actuator_lag_delays_a_climb_by_its_time_constant() {
    let rig = without_drag("actuator-lag", &[0.2]);
    let mut flight = Flight::airborne(&rig, 10.0, 0.0);
    flight.hold(0.1, 0.01, sticks(&rig, 1.0));
    assert!(flight.speed_m_s().abs() < EXACT_M_S);
    flight.hold(0.5, 0.01, sticks(&rig, 1.1));
    assert!((flight.speed_m_s() - 0.1 * G * 0.2 * lagged(2.5)).abs() < EXACT_M_S);
}

#[test]
fn actuator_saturation_limits_the_climb() {
    let rig = without_drag("actuator-saturation", &[1.1]);
    assert!((mean_excess(&rig, 1.5) - 0.1).abs() < EXACT_M_S);
    assert!((mean_excess(&rig, 1.05) - 0.05).abs() < EXACT_M_S);
}

#[test]
fn actuator_quantisation_turns_one_throttle_into_its_neighbour() {
    let rig = without_drag("actuator-quantisation", &[0.1]);
    // Steps of 0.33 V: hover at 1.8996 V becomes 1.98 V.
    let heard = rig.airframe.thrust_n(1.98) / rig.airframe.weight_n();
    assert!((mean_excess(&rig, 1.0) - (heard - 1.0)).abs() < EXACT_M_S);
}

#[test]
fn actuator_backlash_swallows_half_its_width() {
    let rig = without_drag("actuator-backlash", &[0.1]);
    let hover = sticks(&rig, 1.0);
    let mut flight = Flight::airborne(&rig, 10.0, 0.0);
    flight.step(0.01, hover);
    for (raised_v, heard_v) in [(0.1, 0.0), (0.165, 0.0), (0.2, 0.035)] {
        let before = flight.speed_m_s();
        let mut raised = hover;
        raised.throttle += raised_v;
        flight.hold(0.1, 0.01, raised);
        let expected = heard_v * rig.airframe.thrust.gain_n_per_unit.value / rig.airframe.mass_kg.value * 0.1;
        assert!((flight.speed_m_s() - before - expected).abs() < EXACT_M_S, "{raised_v} V");
    }
}

#[test]
fn rotor_lag_lets_the_airframe_sink_while_the_rotors_spin_up() {
    let rig = without_drag("rotor-lag", &[0.1]);
    // Thrust over weight is (1 - e^-x)^2; one less that is 2 e^-x - e^-2x.
    let x: f64 = 4.0;
    let sunk = 0.1 * G * (2.0 * (1.0 - (-x).exp()) - 0.5 * (1.0 - (-2.0 * x).exp()));
    assert!((speed_after(&rig, 1.0, 0.4, 0.02) + sunk).abs() < EXACT_M_S);
}

#[test]
fn thrust_curve_bends_climb_and_sink_but_not_hover() {
    let rig = without_drag("thrust-curve", &[0.5]);
    for (asked, given) in [(0.8, 0.72), (1.0, 1.0), (1.2, 1.32)] {
        assert!((mean_excess(&rig, asked) - (given - 1.0)).abs() < EXACT_M_S);
    }
}

#[test]
fn thrust_loss_makes_the_hover_throttle_sink() {
    assert!((mean_excess(&without_drag("thrust-loss", &[0.1]), 1.0) + 0.1).abs() < EXACT_M_S);
    assert!((mean_excess(&without_drag("thrust-loss", &[-0.1]), 1.0) - 0.1).abs() < EXACT_M_S);
}

#[test]
fn battery_discharge_turns_a_climb_into_a_sink() {
    let rig = without_drag("battery-discharge", &[0.6]);
    // At 1.5 weights asked for, thrust is 1.5 e^-x after x = 0.6 x 1.5 minutes; it crosses one at x = ln 1.5.
    let (minutes, crossing_s) = (1.0, 60.0 * 1.5_f64.ln() / 0.9);
    let expected = G * 60.0 * ((1.0 - (-0.9_f64 * minutes).exp()) / 0.6 - minutes);
    // 600 steps at up to 60 m/s.
    assert!((speed_after(&rig, 1.5, 60.0, 0.1) - expected).abs() < 600.0 * EXACT_M_S);
    let mut flight = Flight::airborne(&rig, 10.0, 0.0);
    flight.hold(crossing_s, crossing_s / 100.0, sticks(&rig, 1.5));
    flight.step(1e-6, sticks(&rig, 1.5));
    assert!((flight.free_thrust_n / rig.airframe.weight_n() - 1.0).abs() < 1e-8);
}

#[test]
fn battery_load_makes_the_hover_throttle_sink_after_a_while() {
    let rig = without_drag("battery-load", &[0.08, 0.5]);
    assert!((speed_after(&rig, 1.0, 1.0, 0.05) + G * 0.08 * 0.5 * lagged(2.0)).abs() < EXACT_M_S);
}

#[test]
fn ground_effect_shape_lifts_where_the_nominal_effect_has_ended() {
    let nominal = rig(Model::Vertical);
    let rig = rig_with("ground-effect-shape", &[2.0, 2.0]);
    assert!(acceleration(&nominal, 0.05, 0.0).abs() < 1e-5);
    // The square of a line to 20 cm.
    let expected = 0.3 * G * 0.75 * 0.75;
    // The step of 0.1 us leaves 16 digits less 7.
    assert!((acceleration(&rig, 0.05, 0.0) - expected).abs() < 1e-5);
}

#[test]
fn ground_effect_dynamic_takes_the_cushion_along() {
    let launch = |rig: &Rig| {
        let mut flight = Flight::new(rig);
        flight.hold(0.5, 0.001, sticks(rig, 1.0));
        flight.speed_m_s()
    };
    let mut nominal = rig(Model::Vertical);
    nominal.airframe.drag_n_s_per_m.value = 0.0;
    let slow = launch(&without_drag("ground-effect-dynamic", &[5.0]));
    // Extra thrust stays between 0.3 weights and 0.3 fading with 5 s; the nominal launch gets 0.15 weights x 5 cm.
    assert!(slow < 0.3 * G * 0.5 && slow > 0.3 * G * 5.0 * -(-0.1_f64).exp_m1(), "{slow}");
    assert!((launch(&nominal) - (0.3 * G * 0.05_f64).sqrt()).abs() < 1e-3);
}

#[test]
fn ceiling_effect_pulls_up_near_the_ceiling() {
    let rig = rig_with("ceiling-effect", &[0.4, 1.0, 0.1]);
    assert!((acceleration(&rig, 0.9, 0.0) - 0.4 * G * (-1.0_f64).exp()).abs() < 1e-5);
    assert!(acceleration(&rig, 0.3, 0.0).abs() < 0.4 * G * 1e-3);
}

#[test]
fn gusts_shake_a_hover_as_much_as_theory_says() {
    let (sigma, correlation_s) = (0.3, 0.5);
    let rig = rig_with("gusts", &[sigma, correlation_s]);
    let mut flight = Flight::airborne(&rig, 1000.0, 0.0);
    let hover = sticks(&rig, 1.0);
    let (mut sum, count) = (0.0, 100_000);
    for _ in 0..count {
        flight.step(0.04, hover);
        sum += flight.speed_m_s().powi(2);
    }
    // v' = b (w - v) with b = Cf/m: the variance of v is sigma^2 b tau/(1 + b tau).
    let b_tau = rig.airframe.drag_n_s_per_m.value / rig.airframe.mass_kg.value * correlation_s;
    let expected = sigma * sigma * b_tau / (1.0 + b_tau);
    // 4000 s over twice 1.75 s of correlation: 1100 values, of which one sigma of the variance is 4 %; four of them.
    assert!((sum / f64::from(count) / expected - 1.0).abs() < 0.17);
}

#[test]
fn updraft_carries_a_hover_along() {
    let rig = rig_with("updraft", &[0.3]);
    // v' = Cf/m (w - v).
    let rate = rig.airframe.drag_n_s_per_m.value / rig.airframe.mass_kg.value;
    assert!((speed_after(&rig, 1.0, 2.0, 0.01) + 0.3 * (-rate * 2.0).exp_m1()).abs() < EXACT_M_S);
}

#[test]
fn mass_change_makes_the_hover_throttle_sink() {
    let rig = without_drag("mass-change", &[0.1]);
    assert!((mean_excess(&rig, 1.0) - (1.0 / 1.1 - 1.0)).abs() < EXACT_M_S);
}

#[test]
fn quadratic_drag_sets_the_speed_of_a_long_fall() {
    let rig = rig_with("quadratic-drag", &[0.01]);
    // W = Cf v + k v^2.
    let (weight_n, cf, k) = (rig.airframe.weight_n(), rig.airframe.drag_n_s_per_m.value, 0.01);
    let terminal = (-cf + (cf * cf + 4.0 * k * weight_n).sqrt()) / (2.0 * k);
    let mut flight = Flight::airborne(&rig, 1000.0, 0.0);
    flight.hold(20.0, 0.01, sticks(&rig, 0.0));
    assert!((flight.speed_m_s() + terminal).abs() < 1e-9);
}

#[test]
fn descent_thrust_loss_makes_a_descent_faster_and_leaves_a_climb() {
    let rig = without_drag("descent-thrust-loss", &[0.2, 0.5]);
    let lost = 0.2 * (1.0 - (-1.0_f64).exp());
    assert!((acceleration(&rig, 1.0, -0.5) + lost * G).abs() < 1e-5);
    assert!(acceleration(&rig, 1.0, 0.5).abs() < 1e-5);
}

#[test]
fn inflow_damping_stops_a_climb() {
    let rig = without_drag("inflow-damping", &[0.2]);
    let mut flight = Flight::airborne(&rig, 1.0, 0.5);
    flight.hold(1.0, 0.01, sticks(&rig, 1.0));
    // At the hover throttle v' = -c g v.
    assert!((flight.speed_m_s() - 0.5 * (-0.2 * G).exp()).abs() < 1e-6);
}

#[test]
fn tilt_loss_lets_a_tilted_airframe_sink() {
    let mut rig = without_drag("tilt-loss", &[1.0]);
    rig.plant.model = Model::SixDegree;
    let tilt_rad = 0.3;
    let mut body = SixDegree::at_rest(&rig.airframe);
    body.position_m.z = 10.0;
    body.attitude = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), tilt_rad);
    let mut tilted = sticks(&rig, 1.0);
    tilted.pitch += tilt_rad / rig.airframe.sticks.tilt_rad_per_unit;
    let mut flight = Flight::new(&rig);
    flight.body = Body::SixDegree(Box::new(body));
    flight.hold(1.0, 0.01, tilted);
    assert!((flight.speed_m_s() + (1.0 - tilt_rad.cos()) * G).abs() < 1e-6);
    // Thrust along the body's axis is one weight, and its horizontal part the sine.
    assert!((flight.body.velocity_m_s().x - tilt_rad.sin() * G).abs() < 1e-6);
}

#[test]
fn effects_of_a_rig_act_in_the_librarys_order_whatever_the_files() {
    let height = |names: [&str; 2]| {
        let mut rig = rig(Model::Vertical);
        for name in names {
            rig.effects.push(entry(spec(name), &typical(spec(name))));
        }
        let mut flight = Flight::new(&rig);
        flight.hold(1.0, 0.01, sticks(&rig, 1.3));
        flight.height_m()
    };
    assert_eq!(height(["battery-load", "rotor-lag"]), height(["rotor-lag", "battery-load"]));
}
