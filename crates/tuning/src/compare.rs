//! Laws held against one another: the same airframes, effects and noise under each.

use bench_plant::effects::{LIBRARY, Prior};
use bench_rig::{Mission, Model, Phase, PhaseAction, PhasePlan, Profile, Rig};
use bench_statistics::{Share, root_mean_square};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use rayon::prelude::*;
use serde::Serialize;

use crate::{
    draw::{Models, add_to_drawn},
    error::TuneError,
    flight::{Traced, fly_traced, lifted, quick},
    statistics::percentile,
};

/// What counts as held and landed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Goals {
    /// Altitude that is held, m.
    pub high_m: f64,
    /// RMS error that counts as holding it, m.
    pub high_rms_m: f64,
    /// Height within the ground effect that is hovered at, m.
    pub low_m: f64,
    /// RMS error that counts as hovering there, without a touch of the ground, m.
    pub low_rms_m: f64,
    /// Speed of a touch-down that is soft, m/s.
    pub touch_down_m_s: f64,
}

impl Goals {
    /// 2 cm at 0.4 m, 1 cm at 3 cm, and landings below 0.3 m/s.
    pub const PAPER: Self =
        Self { high_m: 0.4, high_rms_m: 0.02, low_m: 0.03, low_rms_m: 0.01, touch_down_m_s: 0.3 };
}

/// Laws compared. As JSON it is `bench.laws/1` (docs/control.md).
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// `bench.laws/1`.
    pub schema: &'static str,
    /// Names of the rigs whose laws these are.
    pub laws: Vec<String>,
    /// Airframes drawn for each case.
    pub models: usize,
    /// Seed of everything random.
    pub seed: u64,
    /// What counts.
    pub goals: Goals,
    /// The rig's tolerances alone first, then with each effect of the library.
    pub cases: Vec<Case>,
}

/// The laws in one condition.
#[derive(Clone, Debug, Serialize)]
pub struct Case {
    /// The effect, its size drawn from its prior; `None`: the rig's tolerances alone.
    pub effect: Option<&'static str>,
    /// In the order of the laws.
    pub achieved: Vec<Achieved>,
}

/// What one law achieved in one condition.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Achieved {
    /// Airframes held at the high altitude.
    pub held: Share,
    /// Median of the RMS error there, m; infinite where the flight did not last.
    pub held_rms_m: f64,
    /// Airframes that hovered within the ground effect.
    pub hovered: Share,
    /// Median of the RMS error there, m.
    pub hovered_rms_m: f64,
    /// Airframes that came down softly from the high altitude.
    pub landed: Share,
    /// Median of the speed at which they touched down, m/s.
    pub touch_down_m_s: f64,
    /// Its 95th percentile.
    pub touch_down_p95_m_s: f64,
}

/// One airframe's flights; infinite where one did not get so far.
#[derive(Clone, Copy)]
struct Flights {
    high_rms_m: f64,
    low_rms_m: f64,
    touch_down_m_s: f64,
}

const STEADY_S: f64 = 10.0;

/// Flies `models` airframes in each condition under each rig's law. The rigs must differ in nothing but name and `[control]`.
/// `effects` are names of the library, flown after the tolerances alone; `progress` gets the cases done and their number.
pub fn compare(
    rigs: &[Rig],
    goals: Goals,
    effects: &[&str],
    models: usize,
    seed: u64,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Comparison, TuneError> {
    let Some(first) = rigs.first() else { return Err(TuneError::TooFewLaws) };
    for rig in rigs {
        let as_first = Rig { name: first.name.clone(), control: first.control, ..rig.clone() };
        if as_first != *first {
            return Err(TuneError::OtherBench { first: first.name.clone(), other: rig.name.clone() });
        }
        bench_plant::effects::Effects::from_rig(rig, 0)?;
    }
    let mut conditions = vec![None];
    for name in effects {
        let index = LIBRARY.iter().position(|spec| spec.name == *name);
        conditions.push(Some(index.ok_or_else(|| TuneError::UnknownEffect { name: (*name).to_owned() })?));
    }
    let mut cases = Vec::new();
    for (done, effect) in conditions.iter().copied().enumerate() {
        progress(done, conditions.len());
        let flown: Vec<Vec<Flights>> = (0..models as u64)
            .into_par_iter()
            .map(|model| {
                let (mut plant, flight_seed) = Models::new(first, seed).draw(model);
                if let Some(effect) = effect {
                    add_drawn(&mut plant, effect, seed, model);
                }
                rigs.iter().map(|rig| fly(&plant, rig, goals, flight_seed)).collect()
            })
            .collect();
        let achieved = (0..rigs.len())
            .map(|law| Achieved::of(&flown.iter().map(|laws| laws[law]).collect::<Vec<_>>(), goals))
            .collect();
        cases.push(Case { effect: effect.map(|effect| LIBRARY[effect].name), achieved });
    }
    Ok(Comparison {
        schema: "bench.laws/1",
        laws: rigs.iter().map(|rig| rig.name.clone()).collect(),
        models,
        seed,
        goals,
        cases,
    })
}

impl Achieved {
    fn of(flights: &[Flights], goals: Goals) -> Self {
        let of = |figure: fn(&Flights) -> f64| flights.iter().map(figure);
        Self {
            held: Share::clopper_pearson(of(|f| f.high_rms_m).map(|x| x <= goals.high_rms_m)),
            held_rms_m: percentile(of(|f| f.high_rms_m), 0.5),
            hovered: Share::clopper_pearson(of(|f| f.low_rms_m).map(|x| x <= goals.low_rms_m)),
            hovered_rms_m: percentile(of(|f| f.low_rms_m), 0.5),
            landed: Share::clopper_pearson(of(|f| f.touch_down_m_s).map(|x| x < goals.touch_down_m_s)),
            touch_down_m_s: percentile(of(|f| f.touch_down_m_s), 0.5),
            touch_down_p95_m_s: percentile(of(|f| f.touch_down_m_s), 0.95),
        }
    }
}

/// The effect with parameters drawn from their priors, unless the rig has it already.
fn add_drawn(plant: &mut Rig, effect: usize, seed: u64, model: u64) {
    let spec = LIBRARY[effect];
    let mut rng = ChaCha8Rng::seed_from_u64(seed ^ (effect as u64 + 1) << 32);
    rng.set_stream(model);
    let values: Vec<(&str, f64)> = spec
        .parameters
        .iter()
        .map(|parameter| {
            let normal: f64 = rng.sample(StandardNormal);
            let drawn = match parameter.prior {
                Prior::Normal { mean, sigma } => mean + sigma * normal,
                Prior::LogNormal { median, sigma_ln } => median * (sigma_ln * normal).exp(),
            };
            (parameter.key, drawn.clamp(parameter.min, parameter.max))
        })
        .collect();
    add_to_drawn(plant, spec.name, &values);
}

fn fly(plant: &Rig, rig: &Rig, goals: Goals, seed: u64) -> Flights {
    let mut plant = quick(plant.clone(), Model::SixDegree);
    // Fine enough for the speed of a touch-down: 0.01 m/s at a third of g.
    plant.plant.truth_period_s = plant.plant.step_s;
    let flown = |mission: &Mission| fly_traced(&plant, rig, mission, seed).ok();
    let lost = f64::INFINITY;
    let high = flown(&high(goals));
    let low = flown(&low(goals));
    Flights {
        high_rms_m: high.as_ref().and_then(|f| steady_rms_m(f, goals.high_m)).unwrap_or(lost),
        touch_down_m_s: high.as_ref().and_then(touch_down_m_s).unwrap_or(lost),
        low_rms_m: low.as_ref().and_then(|f| steady_rms_m(f, goals.low_m)).unwrap_or(lost),
    }
}

fn hold(altitude_m: Profile) -> PhaseAction {
    let nothing = || Profile::constant(0.0);
    PhaseAction::Hold { altitude_m, x_m: nothing(), y_m: nothing(), heading_rad: nothing(), chirp: None }
}

fn landing() -> PhasePlan {
    PhasePlan { action: PhaseAction::Land { descent_m_s: 0.15, cut_below_m: 0.06 }, duration_s: 8.0 }
}

/// Launch, hold, land.
fn high(goals: Goals) -> Mission {
    let mut phases = lifted(hold(Profile::constant(goals.high_m)), 8.0 + STEADY_S);
    phases.push(landing());
    Mission { name: "high".to_owned(), phases, ..Mission::default() }
}

/// Launch, down into the ground effect, hover there.
fn low(goals: Goals) -> Mission {
    let from_m = goals.low_m + 0.17;
    // Times rise and are finite.
    let down =
        Profile::from_points(vec![[0.0, from_m], [6.0, from_m], [10.0, goals.low_m]]).unwrap_or_default();
    let mut phases = lifted(hold(down), 16.0 + STEADY_S);
    phases.push(landing());
    Mission { name: "low".to_owned(), phases, ..Mission::default() }
}

/// RMS of the true altitude over the last seconds before the landing; `None` where it touched the ground or was stopped.
fn steady_rms_m(flight: &Traced, altitude_m: f64) -> Option<f64> {
    let end = flight.began(Phase::Land)?;
    let heights = || flight.truth_between(end, [-STEADY_S, 0.0]).map(|(_, [.., z], _)| *z);
    if heights().any(|z| z <= 0.0) {
        return None;
    }
    root_mean_square(heights().map(|z| z - altitude_m))
}

/// The fastest contact with the ground of the landing; `None` where it did not stand in the end.
fn touch_down_m_s(flight: &Traced) -> Option<f64> {
    let begin = flight.began(Phase::Land)?;
    let landing: Vec<_> = flight.truth_between(begin, [0.0, f64::INFINITY]).collect();
    let stands = landing.last().is_some_and(|(_, [.., z], _)| *z <= 0.0);
    let contacts =
        landing.windows(2).filter(|pair| pair[0].1[2] > 0.0 && pair[1].1[2] <= 0.0).map(|pair| -pair[0].2);
    if stands { contacts.reduce(f64::max) } else { None }
}
