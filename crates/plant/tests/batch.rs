//! Airframes in lanes against airframes alone.

use std::path::Path;

use bench_device::{Clock, PositionSource, Sticks, Time, VoltageOutput};
use bench_plant::{
    batch::{Batch, WIDTH},
    body::{Body, SixDegree},
    effects::{EffectSpec, Effects, LIBRARY, Stage, parse_effect},
    lab::{Lab, Lockstep},
    nominal::{Forces, Nominal},
};
use bench_rig::{Model, Rig};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn rig(name: &str) -> Rig {
    let mut rig = Rig::load(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs").join(name)).unwrap();
    rig.plant.model = Model::SixDegree;
    rig
}

/// All of a body's numbers, to the last bit but the sign of a zero, which no law looks at.
fn bits(body: &SixDegree) -> [u64; 13] {
    let (p, v, q, r) = (body.position_m, body.velocity_m_s, body.attitude, body.body_rate_rad_s);
    [p.x, p.y, p.z, v.x, v.y, v.z, q.w, q.i, q.j, q.k, r.x, r.y, r.z].map(|x| (x + 0.0).to_bits())
}

/// Anywhere from the ground up, in any attitude, at speeds and rates beyond what flies.
fn anywhere(rng: &mut ChaCha8Rng, rig: &Rig) -> SixDegree {
    let mut body = SixDegree::at_rest(&rig.airframe);
    let mut vector = |most: f64| Vector3::from_fn(|_, _| rng.random_range(-most..most));
    (body.velocity_m_s, body.body_rate_rad_s) = (vector(3.0), vector(20.0));
    body.position_m = vector(1.0);
    // Some on the ground, some within its effect, some above.
    body.position_m.z = rng.random_range(-0.02_f64..0.2).max(0.0);
    let q = Quaternion::from(nalgebra::Vector4::from_fn(|_, _| rng.random_range(-1.0..1.0)));
    // A third stands level.
    if rng.random_range(0..3) > 0 {
        body.attitude = UnitQuaternion::new_normalize(q);
    }
    body
}

fn sticks(rng: &mut ChaCha8Rng, rig: &Rig) -> Sticks {
    let range = &rig.airframe.sticks;
    let mut any = || rng.random_range(range.min..range.max);
    Sticks { throttle: any(), pitch: any(), roll: any(), yaw: any() }
}

#[test]
fn a_lane_holds_what_the_airframe_alone_would_to_the_last_bit() {
    // Rounding is the tolerance that lanes would be allowed; that operations and their order are the same leaves none of it.
    let rigs = [rig("virtual.toml"), rig("crazyflie-2.toml")];
    let effects = Effects::default();
    let mut rng = ChaCha8Rng::seed_from_u64(32);
    let (mut grounded, mut moved) = (0, 0);
    for _ in 0..200 {
        let mut batch = Batch::new();
        let mut alone = Vec::new();
        // One lane is nobody's.
        for lane in 1..WIDTH {
            let rig = &rigs[lane % 2];
            let nominal = Nominal::new(&rig.airframe);
            let mass_kg = nominal.mass_kg * rng.random_range(0.8..1.2);
            let mut body = anywhere(&mut rng, rig);
            let (sticks, dt_s) = (sticks(&mut rng, rig), rng.random_range(1e-4..5e-3));
            let free_thrust_n = nominal.free_thrust_n(sticks.throttle);
            batch.enter(lane, &body, &nominal, mass_kg);
            batch.set_step(lane, dt_s);
            batch.hold(lane, free_thrust_n, &mut body, sticks);
            let mut expected = Body::SixDegree(Box::new(body.clone()));
            let forces = Forces { nominal: &nominal, effects: &effects, free_thrust_n, mass_kg };
            for _ in 0..50 {
                expected.step(dt_s, &forces, sticks);
            }
            alone.push((lane, body, expected));
        }
        batch.step(20);
        batch.step(30);
        for (lane, mut body, expected) in alone {
            let before = bits(&body);
            batch.tell(lane, &mut body);
            let Body::SixDegree(expected) = expected else { unreachable!() };
            assert_eq!(bits(&body), bits(&expected), "lane {lane}: {body:?} is not {expected:?}");
            grounded += usize::from(body.position_m.z == 0.0);
            moved += usize::from(bits(&body) != before);
        }
    }
    // Both ways through a step were taken.
    assert!(grounded > 50 && moved > 1000, "{grounded} on the ground, {moved} moved");
}

/// What a world shows while its sticks are moved every tick: positions, the truth, and when it woke up.
#[derive(Debug, Default, PartialEq)]
struct Seen {
    positions: Vec<String>,
    truth: Vec<String>,
    woke: Vec<Time>,
}

impl Seen {
    fn look(&mut self, lab: &mut Lab, woke: Time) {
        while let Some(sample) = lab.tracker.poll().unwrap() {
            self.positions.push(format!("{sample:?}"));
        }
        lab.world.drain_truth(|state| self.truth.push(format!("{state:?}")));
        self.woke.push(woke);
    }
}

const TICKS: u32 = 40;

fn scheduled(tick: u32) -> Time {
    Time::from_seconds(0.1 * f64::from(tick))
}

/// Up, about, and down again.
fn command(rig: &Rig, seed: u64, tick: u32) -> Sticks {
    let hover = rig.airframe.throttle_for(rig.airframe.weight_n());
    let mut rng = ChaCha8Rng::seed_from_u64(seed * 1000 + u64::from(tick));
    let mut sticks = sticks(&mut rng, rig);
    sticks.throttle = hover * if tick < TICKS / 2 { 1.1 } else { 0.8 };
    sticks
}

#[test]
fn worlds_in_lockstep_show_what_each_shows_alone() {
    let plain = rig("virtual.toml");
    // Each effect of the library on a rig of its own, and the rig without any.
    let mut rigs = vec![plain.clone()];
    for spec in LIBRARY.iter() {
        let mut rig = plain.clone();
        rig.effects.push(parse_effect(&spec.example()).unwrap());
        rigs.push(rig);
    }
    let alone: Vec<Seen> = rigs
        .iter()
        .zip(0..)
        .map(|(rig, seed)| {
            let (mut lab, mut seen) = (Lab::new(rig, seed).unwrap(), Seen::default());
            for tick in 0..TICKS {
                let woke = lab.clock.wait_until(scheduled(tick)).unwrap();
                seen.look(&mut lab, woke);
                lab.output.write(command(rig, seed, tick)).unwrap();
            }
            seen
        })
        .collect();
    assert!(alone[0].truth.len() > 190 && alone[0].positions.len() > 100);

    let mut shared = Vec::new();
    let mut waiting = rigs.iter().zip(0_u64..);
    loop {
        // One lane stays free in the first round, and more in the last.
        let mut lockstep = Lockstep::new();
        let mut lanes: Vec<(usize, &Rig, u64, Lab, Seen)> = Vec::new();
        while lanes.len() + 1 < WIDTH {
            let Some((rig, seed)) = waiting.next() else { break };
            let (lab, lane) = (Lab::new(rig, seed).unwrap(), lanes.len() + 1);
            if lockstep.enter(lane, &lab.world) {
                lanes.push((lane, rig, seed, lab, Seen::default()));
            }
        }
        if lanes.is_empty() {
            break;
        }
        for tick in 0..TICKS {
            let mut wake = [Time::ZERO; WIDTH];
            for (lane, _, _, lab, _) in &mut lanes {
                wake[*lane] = lab.clock.wake(scheduled(tick));
            }
            lockstep.advance(&wake);
            for (lane, rig, seed, lab, seen) in &mut lanes {
                seen.look(lab, wake[*lane]);
                lab.output.write(command(rig, *seed, tick)).unwrap();
            }
        }
        for (_, _, seed, _, seen) in lanes {
            assert!(seen == alone[seed as usize], "{:?}", rigs[seed as usize].effects);
            shared.push(seed);
        }
    }
    // Effects on the air have no lanes; all others have.
    let in_lanes = |spec: &&&EffectSpec| !matches!(spec.stage, Stage::Environment | Stage::Airframe);
    assert_eq!(shared.len(), 1 + LIBRARY.iter().filter(in_lanes).count());
}

#[test]
fn a_vertical_airframe_has_no_lane() {
    let mut rig = rig("virtual.toml");
    rig.plant.model = Model::Vertical;
    assert!(!Lockstep::new().enter(0, &Lab::new(&rig, 0).unwrap().world));
}
