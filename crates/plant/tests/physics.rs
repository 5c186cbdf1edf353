//! The plant against solutions known on paper.

use std::path::Path;

use bench_device::{Clock, PositionSource, Sticks, Time, VoltageOutput};
use bench_plant::{
    body::{Body, SixDegree},
    effects::{Effects, index_of},
    lab::Lab,
    nominal::{Forces, Nominal},
};
use bench_rig::{GRAVITY_M_S2, Model, Rig};
use nalgebra::{UnitQuaternion, Vector3};

fn rig(model: Model) -> Rig {
    let mut rig = Rig::load(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs/virtual.toml")).unwrap();
    rig.plant.model = model;
    rig
}

fn centred(rig: &Rig, throttle: f64) -> Sticks {
    let centre = rig.airframe.sticks.centre;
    Sticks { throttle, pitch: centre, roll: centre, yaw: centre }
}

/// Moves a body on under nominal forces with the sticks held.
fn fly(rig: &Rig, body: &mut Body, sticks: Sticks, duration_s: f64, dt_s: f64) {
    let nominal = Nominal::new(&rig.airframe);
    let effects = Effects::default();
    let free_thrust_n = nominal.free_thrust_n(sticks.throttle);
    let forces = Forces { nominal: &nominal, effects: &effects, free_thrust_n, mass_kg: nominal.mass_kg };
    for _ in 0..(duration_s / dt_s).round() as u64 {
        body.step(dt_s, &forces, sticks);
    }
}

fn at(z_m: f64, airframe: &bench_rig::Airframe) -> Body {
    let mut body = SixDegree::at_rest(airframe);
    body.position_m.z = z_m;
    Body::SixDegree(Box::new(body))
}

#[test]
fn free_fall_follows_the_solution_with_linear_drag() {
    // v = -v_t (1 - exp(-t/T)), z = z0 - v_t (t - T (1 - exp(-t/T))), T = m/Cf, v_t = g T: drag only, rotors off.
    let rig = rig(Model::SixDegree);
    let time_constant_s = rig.airframe.mass_kg.value / rig.airframe.drag_n_s_per_m.value;
    let terminal_m_s = GRAVITY_M_S2 * time_constant_s;
    let (t, z0) = (1.0_f64, 50.0);
    let gone = -(-t / time_constant_s).exp_m1();
    let mut body = at(z0, &rig.airframe);
    fly(&rig, &mut body, centred(&rig, 0.0), t, 0.001);
    // Order four at 1 ms on a time constant of 1.25 s: far below a nanometre.
    assert!((body.velocity_m_s().z + terminal_m_s * gone).abs() < 1e-9);
    assert!((body.position_m().z - (z0 - terminal_m_s * (t - time_constant_s * gone))).abs() < 1e-9);
}

#[test]
fn without_drag_energy_is_kept_and_a_free_body_keeps_its_angular_momentum() {
    let mut rig = rig(Model::SixDegree);
    rig.airframe.drag_n_s_per_m.value = 0.0;
    // No thrust means no torque: the stabiliser is off, and the yaw torque with it once its gain is negligible.
    rig.airframe.stabiliser.yaw_time_constant_s = 1e12;
    rig.airframe.stabiliser.inertia_kg_m2 = [4.0e-6, 6.0e-6, 9.0e-6];
    let inertia = Vector3::from(rig.airframe.stabiliser.inertia_kg_m2);
    let mut start = SixDegree::at_rest(&rig.airframe);
    start.position_m.z = 20.0;
    start.velocity_m_s = Vector3::new(0.7, -0.4, 3.0);
    start.body_rate_rad_s = Vector3::new(6.0, -2.0, 4.0);
    let momentum = start.attitude * inertia.component_mul(&start.body_rate_rad_s);
    let energy = |body: &SixDegree| {
        let spin = body.body_rate_rad_s;
        let mass_kg = rig.airframe.mass_kg.value;
        mass_kg * (0.5 * body.velocity_m_s.norm_squared() + GRAVITY_M_S2 * body.position_m.z)
            + 0.5 * spin.dot(&inertia.component_mul(&spin))
    };
    let before = energy(&start);
    let mut body = Body::SixDegree(Box::new(start));
    fly(&rig, &mut body, centred(&rig, 0.0), 1.0, 0.001);
    let Body::SixDegree(after) = &body else { unreachable!() };
    // Rotation at 7 rad/s in 1 ms steps: (0.007)^5 a step, 1000 steps, relative 1e-8.
    assert!((energy(after) / before - 1.0).abs() < 1e-8);
    let momentum_after = after.attitude * inertia.component_mul(&after.body_rate_rad_s);
    assert!((momentum_after - momentum).norm() / momentum.norm() < 1e-8);
}

#[test]
fn a_level_rigid_body_is_the_vertical_model() {
    let rig = rig(Model::SixDegree);
    let mut vertical = Body::at_rest(Model::Vertical, &rig.airframe);
    let mut six = Body::at_rest(Model::SixDegree, &rig.airframe);
    for throttle in [2.1, 1.87, 1.95, 1.6, 0.0, 2.0] {
        for body in [&mut vertical, &mut six] {
            fly(&rig, body, centred(&rig, throttle), 0.5, 0.001);
        }
        // The same operations on the same numbers: equal but for the order of two additions.
        assert!((vertical.position_m() - six.position_m()).norm() < 1e-12);
        assert!((vertical.velocity_m_s() - six.velocity_m_s()).norm() < 1e-12);
    }
    assert_eq!(six.attitude(), UnitQuaternion::identity());
}

#[test]
fn a_flight_through_smooth_air_converges_with_order_four() {
    // Above the ground effect the vertical model is linear, so the order shows without the kink at 5 cm.
    let rig = rig(Model::SixDegree);
    let climb = |dt_s: f64| {
        let mut body = at(1.0, &rig.airframe);
        fly(&rig, &mut body, centred(&rig, 2.1), 2.0, dt_s);
        body.position_m().z
    };
    let exact = climb(0.0005);
    let (coarse, fine) = ((climb(0.2) - exact).abs(), (climb(0.1) - exact).abs());
    let order = (coarse / fine).log2();
    assert!((order - 4.0).abs() < 0.2, "order {order}");
}

#[test]
fn a_stick_tilts_as_far_as_it_asks_and_keeps_the_height() {
    let rig = rig(Model::SixDegree);
    let hover = rig.airframe.throttle_for(rig.airframe.weight_n());
    let mut body = at(10.0, &rig.airframe);
    let mut sticks = centred(&rig, hover);
    sticks.pitch += 0.5;
    fly(&rig, &mut body, sticks, 2.0, 0.001);
    let tilt_rad = (body.attitude() * Vector3::z()).angle(&Vector3::z());
    // Eight time constants of the stabiliser: settled to e^-24 of the step, plus the law's sine for an angle.
    assert!((tilt_rad - 0.5 * rig.airframe.sticks.tilt_rad_per_unit).abs() < 1e-6, "{tilt_rad}");
    assert!(body.velocity_m_s().x > 0.5 && body.velocity_m_s().y.abs() < 1e-9);
    // Thrust is compensated for tilt; what is left is nothing.
    assert!((body.position_m().z - 10.0).abs() < 1e-9);
    let mut right = centred(&rig, hover);
    right.roll += 0.5;
    let mut body = at(10.0, &rig.airframe);
    fly(&rig, &mut body, right, 1.0, 0.001);
    assert!(body.velocity_m_s().y < -0.3, "right side down goes to -y");
}

#[test]
fn yaw_turns_at_the_rate_asked_for() {
    let rig = rig(Model::SixDegree);
    let mut sticks = centred(&rig, 1.9);
    sticks.yaw += 0.2;
    let mut body = at(10.0, &rig.airframe);
    fly(&rig, &mut body, sticks, 3.0, 0.001);
    let rate = rig.airframe.sticks.yaw_rate_rad_s_per_unit * 0.2;
    // Twenty time constants.
    assert!((body.body_rate_rad_s().z - rate).abs() < 1e-7);
}

#[test]
fn the_ground_stops_a_fall_and_lets_a_climb_go() {
    let rig = rig(Model::SixDegree);
    let mut body = at(0.3, &rig.airframe);
    fly(&rig, &mut body, centred(&rig, 1.0), 2.0, 0.001);
    assert_eq!(body.position_m().z, 0.0);
    assert_eq!(body.velocity_m_s(), Vector3::zeros());
    fly(&rig, &mut body, centred(&rig, 2.1), 0.5, 0.001);
    assert!(body.position_m().z > 0.05);
}

#[test]
fn the_tracker_shows_positions_late_at_its_own_rate_and_in_its_own_steps() {
    let mut rig = rig(Model::Vertical);
    rig.tracker.noise_m = 0.0;
    rig.tracker.dropout_probability = 0.0;
    let mut lab = Lab::new(&rig, 3).unwrap();
    lab.output.write(centred(&rig, 2.1)).unwrap();
    let mut truth = Vec::new();
    let mut samples = Vec::new();
    for tick in 0..=20 {
        let now = lab.clock.wait_until(Time::from_seconds(0.1 * f64::from(tick))).unwrap();
        lab.world.drain_truth(|state| truth.push(state));
        while let Some(sample) = lab.tracker.poll().unwrap() {
            assert!(sample.arrived_at <= now);
            samples.push(sample);
        }
    }
    // 2 s less 0.3 s of latency, at 30 Hz, the first exposure anywhere in a period.
    assert!((50..=51).contains(&samples.len()), "{}", samples.len());
    for sample in &samples {
        assert!((sample.arrived_at.since_s(sample.exposed_at) - 0.3).abs() < 1e-9);
        let after = truth.partition_point(|state| state.time < sample.exposed_at);
        let (a, b) = (&truth[after - 1], &truth[after]);
        let share = sample.exposed_at.since_s(a.time) / b.time.since_s(a.time);
        let z = a.position_m.z + share * (b.position_m.z - a.position_m.z);
        // Half a step of 5 mm, and what a straight line between two records 20 ms apart misses (a t^2/8 < 0.1 mm).
        assert!((sample.position_m[2] - z).abs() <= 0.0025 + 1e-4);
        let steps = sample.position_m[2] / 0.005;
        assert!((steps - steps.round()).abs() < 1e-9);
    }
}

#[test]
fn frames_are_lost_as_often_as_the_rig_says() {
    let mut rig = rig(Model::Vertical);
    rig.tracker.dropout_probability = 0.25;
    let mut lab = Lab::new(&rig, 5).unwrap();
    lab.clock.wait_until(Time::from_seconds(100.0)).unwrap();
    let mut received = 0;
    while lab.tracker.poll().unwrap().is_some() {
        received += 1;
    }
    // 2991 frames expected to have arrived, sigma of the binomial 24: four sigma.
    assert!((f64::from(received) - 2991.0 * 0.75).abs() < 4.0 * 24.0, "{received}");
}

#[test]
fn the_output_clamps_quantises_and_refuses_what_is_no_number() {
    let mut rig = rig(Model::Vertical);
    rig.output.readback_noise_fraction = 0.0;
    let mut lab = Lab::new(&rig, 1).unwrap();
    lab.output.write(centred(&rig, 1.9)).unwrap();
    let step = 3.3 / 255.0;
    let readback = lab.output.read_back().unwrap().unwrap();
    assert!((readback.sticks.throttle - 1.9).abs() <= step / 2.0 + 1e-12);
    assert!(!readback.faults.clamped);
    lab.output.write(centred(&rig, 9.0)).unwrap();
    let readback = lab.output.read_back().unwrap().unwrap();
    assert!((readback.sticks.throttle - 3.3).abs() < 1e-12);
    assert!(readback.faults.clamped);
    assert!(lab.output.write(centred(&rig, f64::NAN)).is_err());
    assert!((lab.output.read_back().unwrap().unwrap().sticks.throttle - 3.3).abs() < 1e-12);
}

#[test]
fn the_world_does_not_depend_on_how_often_it_is_looked_at() {
    let rig = rig(Model::SixDegree);
    let mut often = Lab::new(&rig, 7).unwrap();
    let mut seldom = Lab::new(&rig, 7).unwrap();
    for lab in [&mut often, &mut seldom] {
        lab.output.write(centred(&rig, 2.0)).unwrap();
    }
    for tick in 1..=100 {
        often.clock.wait_until(Time::from_seconds(0.01 * f64::from(tick))).unwrap();
    }
    seldom.clock.wait_until(Time::from_seconds(1.0)).unwrap();
    let (a, b) = (often.world.borrow().true_state(), seldom.world.borrow().true_state());
    // Different steps, the same flow: RK4's error and one kink at 5 cm.
    assert!((a.position_m - b.position_m).norm() < 1e-6);
}

#[test]
fn what_ails_the_output_shows_in_the_readback_and_what_comes_after_the_pin_does_not() {
    let mut rig = rig(Model::Vertical);
    rig.output.readback_noise_fraction = 0.0;
    let pinned = |effect: &str| {
        let mut rig = rig.clone();
        rig.effects = vec![bench_plant::effects::parse_effect(effect).unwrap()];
        let mut lab = Lab::new(&rig, 1).unwrap();
        lab.output.write(centred(&rig, 2.3)).unwrap();
        lab.clock.wait_until(Time::from_seconds(0.001)).unwrap();
        lab.output.read_back().unwrap().unwrap().sticks.throttle
    };
    let step = 3.3 / 255.0;
    // 1.15 W: 0.5 V + 1.15 x 1.4 V.
    assert!((pinned("actuator-saturation:high_thrust_to_weight=1.15") - 2.1096).abs() < step);
    assert!((pinned("actuator-quantisation:step_fraction=0.1") - 2.31).abs() < step);
    assert!((pinned("actuator-lag:time_constant_s=0.2") - 2.3).abs() < step);
}

#[test]
fn a_ceiling_stops_the_airframe_and_lets_it_go() {
    for model in [Model::Vertical, Model::SixDegree] {
        let mut rig = rig(model);
        rig.airframe.drag_n_s_per_m.value = 0.0;
        let nominal = Nominal::new(&rig.airframe);
        let mut effects = Effects::default();
        let ceiling = index_of("ceiling-effect").unwrap();
        effects.add(ceiling, &[1e-9, 1.0, 0.1, 1.0], &rig.airframe, 1);
        let mut body = Body::at_rest(model, &rig.airframe);
        let mut highest_m = 0.0_f64;
        // Thrust of 1.5 weights lifts it off and against the ceiling; half a weight lets it fall from rest there.
        for (ratio, duration_s) in [(1.5, 3.0), (0.5, 0.4)] {
            let throttle = rig.airframe.throttle_for(ratio * rig.airframe.weight_n());
            let sticks = centred(&rig, throttle);
            let forces = Forces {
                nominal: &nominal,
                effects: &effects,
                free_thrust_n: nominal.free_thrust_n(throttle),
                mass_kg: nominal.mass_kg,
            };
            for _ in 0..(duration_s / 0.001_f64).round() as u64 {
                body.step(0.001, &forces, sticks);
                highest_m = highest_m.max(body.position_m().z);
            }
            let fallen_m = if ratio < 1.0 { 0.5 * 0.5 * GRAVITY_M_S2 * 0.16 } else { 0.0 };
            assert!((body.position_m().z - (1.0 - fallen_m)).abs() < 1e-6, "{model:?} {ratio}");
        }
        assert_eq!(highest_m, 1.0);
    }
}
