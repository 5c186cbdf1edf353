//! Steps a second of many airframes, in lanes and one by one, on so many threads: one line of JSON. For `tools/sweep`.
//!
//! Usage: `batch lanes|alone AIRFRAMES STEPS THREADS RIG.toml`

use std::{env, path::Path, process::exit, thread, time::Instant};

use bench_device::Sticks;
use bench_plant::{
    batch::{Batch, WIDTH},
    body::{Body, SixDegree},
    effects::Effects,
    nominal::{Forces, Nominal},
};
use bench_rig::Rig;

/// Steps between two looks at a batch: those of an iteration of a loop at 10 Hz.
const STEPS_AT_ONCE: u64 = 100;
const STEP_S: f64 = 0.001;

fn main() {
    let words: Vec<String> = env::args().skip(1).collect();
    let [how, airframes, steps, threads, rig] = words.as_slice() else {
        eprintln!("usage: batch lanes|alone AIRFRAMES STEPS THREADS RIG.toml");
        exit(2);
    };
    let number = |text: &String| text.parse::<u64>().unwrap_or_else(|_| panic!("{text} is no number"));
    let (airframes, steps, threads) = (number(airframes), number(steps), number(threads));
    let rig = Rig::load(Path::new(rig)).unwrap_or_else(|error| panic!("{error}"));
    let share = airframes / threads;
    let began = Instant::now();
    let height_m: f64 = thread::scope(|scope| {
        let run = || if how == "lanes" { lanes(&rig, share, steps) } else { alone(&rig, share, steps) };
        let threads: Vec<_> = (0..threads).map(|_| scope.spawn(run)).collect();
        threads.into_iter().map(|thread| thread.join().expect("a thread failed")).sum()
    });
    let wall_s = began.elapsed().as_secs_f64();
    let done = share * threads * steps;
    println!(
        "{{\"steps\": {done}, \"wall_s\": {wall_s}, \"mean_height_m\": {}}}",
        height_m / (share * threads) as f64
    );
}

/// A little above hover with every stick off its centre, differently for each.
fn sticks(airframe: u64) -> Sticks {
    let off = 0.05 * (airframe % 7) as f64;
    Sticks { throttle: 1.95, pitch: 1.5 + off, roll: 1.6 - off, yaw: 1.7 }
}

fn start(rig: &Rig) -> SixDegree {
    let mut body = SixDegree::at_rest(&rig.airframe);
    body.position_m.z = 1.0;
    body
}

fn lanes(rig: &Rig, airframes: u64, steps: u64) -> f64 {
    let nominal = Nominal::new(&rig.airframe);
    let mut bodies: Vec<SixDegree> = (0..airframes).map(|_| start(rig)).collect();
    let mut batches: Vec<Batch> = Vec::new();
    for (place, body) in bodies.iter_mut().enumerate() {
        let (lane, sticks) = (place % WIDTH, sticks(place as u64));
        if lane == 0 {
            batches.push(Batch::new());
        }
        let batch = &mut batches[place / WIDTH];
        batch.enter(lane, body, &nominal, nominal.mass_kg);
        batch.set_step(lane, STEP_S);
        batch.hold(lane, nominal.free_thrust_n(sticks.throttle), body, sticks);
    }
    for _ in 0..steps / STEPS_AT_ONCE {
        for batch in &mut batches {
            batch.step(STEPS_AT_ONCE);
        }
    }
    for (place, body) in bodies.iter_mut().enumerate() {
        batches[place / WIDTH].tell(place % WIDTH, body);
    }
    bodies.iter().map(|body| body.position_m.z).sum()
}

fn alone(rig: &Rig, airframes: u64, steps: u64) -> f64 {
    let (nominal, effects) = (Nominal::new(&rig.airframe), Effects::default());
    let mut bodies: Vec<Body> = (0..airframes).map(|_| Body::SixDegree(Box::new(start(rig)))).collect();
    for _ in 0..steps / STEPS_AT_ONCE {
        for (place, body) in bodies.iter_mut().enumerate() {
            let sticks = sticks(place as u64);
            let forces = Forces {
                nominal: &nominal,
                effects: &effects,
                free_thrust_n: nominal.free_thrust_n(sticks.throttle),
                mass_kg: nominal.mass_kg,
            };
            for _ in 0..STEPS_AT_ONCE {
                body.step(STEP_S, &forces, sticks);
            }
        }
    }
    bodies.iter().map(|body| body.position_m().z).sum()
}
