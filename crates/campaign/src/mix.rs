//! Sets of flights whose causes come in the mix of `docs/results/diagnosis.md`: what calibrations learn from.

mod causes;
mod numbers;

use bench_filter::Track;
use bench_plant::effects::EffectError;
use bench_recording::{Flight, Mode, Record, Session};
use bench_rig::{EffectEntry, Location, Mission, Model, Rig, Uncertain};
use bench_run::simulate;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

pub use self::causes::planned;
use self::numbers::{MIX, OrdinaryAir};

/// Number of the first set with causes, far from those of sets without.
pub const FIRST_WITH_CAUSES: u64 = 1 << 40;

/// The file of the mix, which decides what is drawn.
pub(crate) const TEXT: &str = include_str!("mix/mix.toml");

/// A set of flights of an airframe drawn from a rig's tolerances, with these causes, as the rig sees them. `set` is the seed of all that
/// is random. A flight that tells nothing is left out, as of real ones.
pub fn tracks(
    rig: &Rig,
    causes: &[EffectEntry],
    flown: &[Mission],
    set: u64,
) -> Result<Vec<Track>, EffectError> {
    let mut real = rig.clone();
    real.effects.extend(causes.iter().cloned());
    let real = drawn(&real, set);
    let mut tracks = Vec::new();
    for (index, mission) in flown.iter().enumerate() {
        let mut records: Vec<Record> = Vec::new();
        simulate(&real, mission, set * 1000 + index as u64, &mut records, |_| true)?;
        let flight = Flight::from_records(Session::new(Mode::Sim), records);
        tracks.extend(Track::from_flight(&mission.name, &flight, rig));
    }
    Ok(tracks)
}

/// An airframe within the rig's tolerances in ordinary air.
fn drawn(rig: &Rig, set: u64) -> Rig {
    let mut rng = ChaCha8Rng::seed_from_u64(set);
    let mut rig = rig.clone();
    // Vertical flights tell altitude alone, and that is what is diagnosed.
    rig.plant.model = Model::Vertical;
    let mut draw = |number: &mut Uncertain| {
        let sigmas: f64 = rng.sample(StandardNormal);
        number.value += number.sigma * sigmas.clamp(-MIX.most_deviations, MIX.most_deviations);
    };
    let a = &mut rig.airframe;
    draw(&mut a.mass_kg);
    draw(&mut a.thrust.gain_n_per_unit);
    draw(&mut a.thrust.offset);
    draw(&mut a.ground_effect.multiplier);
    draw(&mut a.ground_effect.height_m);
    draw(&mut a.drag_n_s_per_m);
    draw(&mut rig.tracker.latency_s);
    let OrdinaryAir { sigma_m_s, correlation_time_s: [shortest_s, longest_s] } = MIX.ordinary_air;
    let sigma_m_s = log_uniform(&mut rng, sigma_m_s);
    if rig.effects.iter().all(|effect| effect.name != "gusts") {
        rig.effects.push(EffectEntry {
            name: "gusts".to_owned(),
            parameters: vec![
                ("sigma_m_s".to_owned(), sigma_m_s, 0),
                (
                    "correlation_time_s".to_owned(),
                    shortest_s + (longest_s - shortest_s) * rng.random::<f64>(),
                    0,
                ),
            ],
            at: Location { file: "calibration".into(), line: 0 },
        });
    }
    rig
}

fn log_uniform(rng: &mut impl Rng, [low, high]: [f64; 2]) -> f64 {
    low * (high / low).powf(rng.random::<f64>())
}
