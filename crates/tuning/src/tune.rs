//! The search for gains.

use argmin::{
    core::{CostFunction, Error, Executor},
    solver::neldermead::NelderMead,
};
use bench_rig::{Control, Model, Rig};
use bench_statistics::Share;
use rand::{SeedableRng, seq::SliceRandom};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::Serialize;
use std::{
    cell::RefCell,
    sync::atomic::{AtomicUsize, Ordering},
};

use crate::{
    draw::{Models, add_latency},
    error::TuneError,
    figures::Figures,
    flight::{Axis, Task, fly_traced, quick},
    gains::{self, Gain},
    margins::{Margins, Response},
    statistics::percentile,
    verdict::{Judged, judge},
};

/// What gains must hold to, at the 95th percentile of the models.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Limits {
    /// RMS error in hold, m: what the check on fresh models counts.
    pub rms_m: f64,
    /// Overshoot of a step, as a share of it.
    pub overshoot: f64,
    /// Settling time of a step, s.
    pub settling_s: f64,
    /// RMS of what is asked for in hold about its mean, over the weight (altitude) or gravity (lateral).
    pub activity: f64,
    /// Gain margin at least, dB, of the nominal model.
    pub gain_db: f64,
    /// Phase margin at least, degrees, of the nominal model.
    pub phase_deg: f64,
    /// By how much the delay must be able to grow, s, of the nominal model.
    pub delay_s: f64,
}

/// How much is tried.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Effort {
    /// Models that gains are tuned on.
    pub models: usize,
    /// Fresh models that they are checked on.
    pub checked: usize,
    /// Gains tried all over their ranges.
    pub scanned: usize,
    /// Gains tried about the best of them.
    pub refined: usize,
    /// Seed of everything random.
    pub seed: u64,
}

impl Effort {
    /// A minute or two of two cores.
    pub const USUAL: Self = Self { models: 100, checked: 600, scanned: 60, refined: 40, seed: 1 };
}

/// Which loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum LoopKind {
    /// Throttle for altitude, with the predictor's numbers.
    Altitude,
    /// Pitch and roll for place.
    Lateral,
}

impl LoopKind {
    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Altitude => "altitude",
            Self::Lateral => "lateral",
        }
    }

    /// The usual limits. The delay must be able to grow by three quarters of what it is.
    pub fn usual_limits(self, rig: &Rig) -> Limits {
        let rms_m = match self {
            Self::Altitude => 0.02,
            Self::Lateral => 0.03,
        };
        Limits {
            rms_m,
            overshoot: 0.3,
            settling_s: 6.0,
            activity: 0.02,
            gain_db: 4.5,
            phase_deg: 35.0,
            delay_s: 0.75 * gains::delay_s(rig),
        }
    }

    const fn axis(self) -> Axis {
        match self {
            Self::Altitude => Axis::Z,
            Self::Lateral => Axis::X,
        }
    }

    fn gains(self, rig: &Rig) -> Vec<Gain> {
        match self {
            Self::Altitude => gains::of_altitude(rig),
            Self::Lateral => gains::of_lateral(rig),
        }
    }

    fn response(self, rig: &Rig, task: &Task) -> Option<Response> {
        match self {
            Self::Altitude => Response::of_altitude(rig, task.altitude_m, 0.0),
            Self::Lateral => Response::of_lateral(rig, task.altitude_m, 0.0),
        }
    }
}

/// One set of gains, flown.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Trial {
    /// Values in the order of [`Tuned::keys`].
    pub gains: Vec<f64>,
    /// 95th percentiles over the models; infinite where more than one in twenty did not get through.
    pub p95: Figures,
    /// Median over the models.
    pub median: Figures,
    /// Models that got through.
    pub flown: Share,
    /// Margins of the nominal loop; `None` where it is not stable.
    pub margins: Option<Margins>,
    /// Whether all limits are held on the models tuned on.
    pub admissible: bool,
    /// What is minimised.
    #[serde(skip)]
    cost: f64,
}

/// Holding on as the sightings come later than the rig says.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Grown {
    /// Latency beyond the rig's, s.
    pub extra_s: f64,
    /// Models within the limit of RMS.
    pub within: Share,
    /// 95th percentile of the RMS error, m.
    pub rms_p95_m: f64,
}

/// One loop's gains, found.
#[derive(Clone, Debug, Serialize)]
pub struct Tuned {
    /// Which loop.
    pub of: LoopKind,
    /// Keys in a rig's `[control]`.
    pub keys: Vec<&'static str>,
    /// The rig's gains.
    pub before: Trial,
    /// The gains found.
    pub after: Trial,
    /// On models that no gain was tuned on: those within the limit of RMS, with the gains found.
    pub checked: Share,
    /// The same with the rig's gains.
    pub checked_before: Share,
    /// 95th percentile of the RMS error of those, m: before, after.
    pub checked_rms_p95_m: [f64; 2],
    /// The loop's response before, where stable.
    pub response_before: Option<Response>,
    /// The loop's response after.
    pub response_after: Option<Response>,
    /// Every limit, and how the gains found stand to it on those.
    pub judged: Vec<Judged>,
    /// With the gains found, as the latency grows.
    pub grown: Vec<Grown>,
    /// All that was tried on all of the models.
    pub tried: Vec<Trial>,
    /// What was held to.
    pub limits: Limits,
}

/// Gains for a rig. As JSON it is `bench.tune/1` (docs/tune.md).
#[derive(Clone, Debug, Serialize)]
pub struct Tuning {
    /// `bench.tune/1`.
    pub schema: &'static str,
    /// What was flown, m.
    pub altitude_m: f64,
    /// How much was tried.
    pub effort: Effort,
    /// The loops, in the order in which they were tuned.
    pub loops: Vec<Tuned>,
    /// The rig's control with the gains found.
    #[serde(skip)]
    pub control: Control,
}

/// Where a tuning is.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    /// Which loop.
    pub of: LoopKind,
    /// What is done.
    pub what: &'static str,
    /// Of what there are so many.
    pub unit: &'static str,
    /// How much of it.
    pub done: usize,
    /// Of how much.
    pub all: usize,
    /// How much of the whole tuning, by the number of flights, from 0 to 1.
    pub share: f64,
}

/// Hears where a tuning is.
pub type Progress<'a> = &'a (dyn Fn(Step) + Sync);

/// Percentile that limits go by.
pub(crate) const SHARE: f64 = 0.95;
/// The search stays so far inside of every limit. The best gains lie at a limit, the 95th percentile of other airframes a
/// little to either side of that of the airframes tuned on.
const INSIDE: f64 = 0.03;
/// A limit broken by a tenth costs as much as the RMS at its limit.
const BROKEN: f64 = 10.0;
/// Figures within their limits count so much against the RMS.
const SMALL: f64 = 0.2;
/// The cost of a loop that does not fly, or that is not stable.
const LOST: f64 = 1e3;
/// Models of a scan, as a share of all, and at least.
const SCAN_SHARE: f64 = 0.2;
const SCAN_LEAST: usize = 24;
/// First steps of the refinement, as shares of the ranges' logarithms.
const SIMPLEX: f64 = 0.1;
/// So often the refinement begins anew.
const RESTARTS: usize = 3;
/// Best gains of the scan that are flown on all models.
const FINALISTS: usize = 5;
/// A simplex whose costs differ by less than this has found its place.
const SETTLED: f64 = 2e-3;
/// A refinement that lowers the cost by a smaller share was the last.
const WORTH: f64 = 5e-3;
/// Sets of gains that a step of the simplex tries.
const PER_STEP: f64 = 1.6;
/// Latencies beyond the rig's that are looked at, s.
const GROWTH_S: [f64; 9] = [0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5];
/// Fresh models begin so far from the seed.
const FRESH: u64 = 0x5eed_f4e5;

/// Tunes the altitude loop and then, where the rig flies sideways, the lateral one.
pub fn tune(
    rig: &Rig,
    task: &Task,
    limits: &dyn Fn(LoopKind) -> Limits,
    loops: &[LoopKind],
    effort: Effort,
    progress: Progress<'_>,
) -> Result<Tuning, TuneError> {
    if effort.models < 20 || effort.checked < 20 {
        return Err(TuneError::TooFewModels { models: effort.models.min(effort.checked) });
    }
    let mut rig = rig.clone();
    let mut tuned = Vec::new();
    for (index, of) in loops.iter().enumerate() {
        let part = [index, loops.len()];
        let search = Search::new(&rig, *of, task, limits(*of), effort, progress, part)?;
        let found = search.run()?;
        for (gain, value) in search.gains.iter().zip(&found.after.gains) {
            gain.set(&mut rig.control, *value);
        }
        tuned.push(found);
    }
    Ok(Tuning {
        schema: "bench.tune/1",
        altitude_m: task.altitude_m,
        effort,
        loops: tuned,
        control: rig.control,
    })
}

/// Flies a rig's gains on so many airframes drawn from its tolerances with a seed, with sightings later by `extra_s` than
/// drawn; `None` for those that did not get through.
pub fn fly_models(
    rig: &Rig,
    of: LoopKind,
    task: &Task,
    seed: u64,
    extra_s: f64,
    count: usize,
) -> Vec<Option<Figures>> {
    let models = Models::new(rig, seed);
    let mission = task.mission(of.axis());
    let model = match of {
        LoopKind::Altitude => Model::Vertical,
        LoopKind::Lateral => Model::SixDegree,
    };
    (0..count as u64)
        .into_par_iter()
        .map(|index| {
            let (plant, seed) = models.draw(index);
            let mut plant = quick(plant, model);
            add_latency(&mut plant, extra_s);
            // A rig whose own effects make no sense flies nothing.
            let flight = fly_traced(&plant, rig, &mission, seed).ok()?;
            match of {
                LoopKind::Altitude => Figures::of_altitude(&flight, rig, task),
                LoopKind::Lateral => Figures::of_lateral(&flight, rig, task),
            }
        })
        .collect()
}

struct Search<'a> {
    rig: &'a Rig,
    of: LoopKind,
    task: Task,
    limits: Limits,
    effort: Effort,
    gains: Vec<Gain>,
    progress: Progress<'a>,
    /// Which loop of how many.
    part: [usize; 2],
}

/// What a search does one after another.
#[derive(Clone, Copy)]
enum Stage {
    Own,
    Scan,
    Finalists,
    Refine,
    Fresh,
    Grown,
}

impl Stage {
    const ALL: [Self; 6] = [Self::Own, Self::Scan, Self::Finalists, Self::Refine, Self::Fresh, Self::Grown];

    const fn in_words(self) -> (&'static str, &'static str) {
        match self {
            Self::Own => ("the rig's own gains", "sets of gains"),
            Self::Scan => ("scan", "sets of gains"),
            Self::Finalists => ("the best of the scan", "sets of gains"),
            Self::Refine => ("about the best", "sets of gains"),
            Self::Fresh => ("fresh airframes", "sets of gains"),
            Self::Grown => ("growing latency", "latencies"),
        }
    }
}

impl<'a> Search<'a> {
    fn new(
        rig: &'a Rig,
        of: LoopKind,
        task: &Task,
        limits: Limits,
        effort: Effort,
        progress: Progress<'a>,
        part: [usize; 2],
    ) -> Result<Self, TuneError> {
        let sticks = &rig.airframe.sticks;
        if of == LoopKind::Lateral && sticks.tilt_rad_per_unit == 0.0 {
            return Err(TuneError::NoLateral { airframe: rig.airframe.name.clone() });
        }
        bench_plant::effects::Effects::from_rig(rig, 0)?;
        let ground_m = rig.airframe.ground_effect.height_m.value;
        let fits = task.altitude_m > 0.0 && task.altitude_m + task.step_m < rig.safety.ceiling_m;
        if !fits {
            return Err(TuneError::Altitude {
                altitude_m: task.altitude_m,
                step_m: task.step_m,
                ground_m,
                ceiling_m: rig.safety.ceiling_m,
            });
        }
        Ok(Self { gains: of.gains(rig), rig, of, task: *task, limits, effort, progress, part })
    }

    /// How many models a scan flies.
    fn scan_models(&self) -> usize {
        let models = self.effort.models;
        ((models as f64 * SCAN_SHARE) as usize).max(SCAN_LEAST).min(models)
    }

    /// Flights of a stage, as far as they can be told before.
    fn flights(&self, stage: Stage) -> f64 {
        let Effort { models, checked, scanned, refined, .. } = self.effort;
        let [models, checked, scanned, refined] = [models, checked, scanned, refined].map(|n| n as f64);
        match stage {
            Stage::Own => models,
            Stage::Scan => scanned * self.scan_models() as f64,
            Stage::Finalists => FINALISTS as f64 * models,
            Stage::Refine => PER_STEP * refined * models,
            Stage::Fresh => 2.0 * checked,
            Stage::Grown => GROWTH_S.len() as f64 * models,
        }
    }

    fn tell(&self, stage: Stage, done: usize, all: usize) {
        let all_flights: f64 = Stage::ALL.into_iter().map(|stage| self.flights(stage)).sum();
        let before: f64 = Stage::ALL.into_iter().take(stage as usize).map(|stage| self.flights(stage)).sum();
        let of_stage = done as f64 / all.max(1) as f64;
        let of_loop = (before + of_stage.min(1.0) * self.flights(stage)) / all_flights;
        let [index, loops] = self.part;
        let (what, unit) = stage.in_words();
        let share = (index as f64 + of_loop) / loops as f64;
        (self.progress)(Step { of: self.of, what, unit, done, all, share });
    }

    fn run(&self) -> Result<Tuned, TuneError> {
        let all = self.effort.models;
        let own: Vec<f64> = self.gains.iter().map(|gain| gain.get(&self.rig.control)).collect();
        self.tell(Stage::Own, 0, 1);
        let before = self.trial(&own, all);
        let scanned = self.scan();
        let finalists = &scanned[..scanned.len().min(FINALISTS)];
        let mut tried: Vec<Trial> = finalists
            .iter()
            .enumerate()
            .map(|(i, trial)| {
                self.tell(Stage::Finalists, i, finalists.len());
                self.trial(&trial.gains, all)
            })
            .collect();
        tried.push(before.clone());
        // A simplex folds up against a limit; another about the best goes on along it.
        for restart in 0..RESTARTS {
            let (start, cost) = (best(&tried).gains.clone(), best(&tried).cost);
            tried.extend(self.refine(&start, restart));
            if cost - best(&tried).cost < WORTH * cost {
                break;
            }
        }
        // Gains that are no better than the rig's are not worth a change.
        let after = best(&tried).clone();
        if after.cost >= LOST {
            return Err(TuneError::NothingFlies { of: self.of.name(), tried: scanned.len() + tried.len() });
        }
        self.tell(Stage::Fresh, 0, 2);
        let fresh = self.effort.seed.wrapping_add(FRESH);
        let checked = |flown: &[Option<Figures>]| {
            let rms: Vec<f64> = flown.iter().map(|f| f.map_or(f64::INFINITY, |f| f.rms_m)).collect();
            (Share::clopper_pearson(rms.iter().map(|rms| *rms <= self.limits.rms_m)), percentile(rms, SHARE))
        };
        let fresh_before = self.fly(&own, fresh, 0.0, self.effort.checked);
        self.tell(Stage::Fresh, 1, 2);
        let fresh_after = self.fly(&after.gains, fresh, 0.0, self.effort.checked);
        let (checked_before, rms_before) = checked(&fresh_before);
        let (checked_after, rms_after) = checked(&fresh_after);
        let judged =
            judge(self.of, &self.limits, [&fresh_before, &fresh_after], [before.margins, after.margins]);
        let grown = GROWTH_S
            .iter()
            .enumerate()
            .map(|(i, extra_s)| {
                self.tell(Stage::Grown, i, GROWTH_S.len());
                let (within, rms_p95_m) = checked(&self.fly(&after.gains, fresh, *extra_s, all));
                Grown { extra_s: *extra_s, within, rms_p95_m }
            })
            .collect();
        Ok(Tuned {
            of: self.of,
            keys: self.gains.iter().map(|gain| gain.key).collect(),
            response_before: self.of.response(&self.with(&own), &self.task),
            response_after: self.of.response(&self.with(&after.gains), &self.task),
            before,
            after,
            checked: checked_after,
            checked_before,
            checked_rms_p95_m: [rms_before, rms_after],
            judged,
            grown,
            tried,
            limits: self.limits,
        })
    }

    /// Gains all over their ranges, a Latin hypercube of them, on some of the models; the best first.
    fn scan(&self) -> Vec<Trial> {
        let count = self.effort.scanned;
        let models = self.scan_models();
        let mut rng = ChaCha8Rng::seed_from_u64(self.effort.seed);
        let columns: Vec<Vec<f64>> = self
            .gains
            .iter()
            .map(|gain| {
                let mut column: Vec<f64> =
                    (0..count).map(|i| gain.at((i as f64 + 0.5) / count as f64)).collect();
                column.shuffle(&mut rng);
                column
            })
            .collect();
        let done = AtomicUsize::new(0);
        self.tell(Stage::Scan, 0, count);
        let mut trials: Vec<Trial> = (0..count)
            .into_par_iter()
            .map(|i| {
                let gains: Vec<f64> = columns.iter().map(|column| column[i]).collect();
                let trial = self.trial(&gains, models);
                self.tell(Stage::Scan, done.fetch_add(1, Ordering::Relaxed) + 1, count);
                trial
            })
            .collect();
        trials.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        trials
    }

    /// Nelder and Mead's simplex about the best so far, on all models.
    fn refine(&self, start: &[f64], restart: usize) -> Vec<Trial> {
        let origin: Vec<f64> = self.gains.iter().zip(start).map(|(gain, x)| gain.share(*x)).collect();
        let mut simplex = vec![origin.clone()];
        for i in 0..origin.len() {
            let mut corner = origin.clone();
            // Inwards at the ends of a range, else to one side and the next time to the other.
            let step = if restart.is_multiple_of(2) { SIMPLEX } else { -SIMPLEX };
            let inside = (0.0..=1.0).contains(&(corner[i] + step));
            corner[i] += if inside { step } else { -step };
            simplex.push(corner);
        }
        let problem = Refinement { search: self, restart, tried: RefCell::new(Vec::new()) };
        let solver = NelderMead::new(simplex);
        // A tolerance above zero is the only one that it takes.
        let Ok(solver) = solver.with_sd_tolerance(SETTLED) else { return Vec::new() };
        // Each iteration tries one or two, a shrink as many as there are gains.
        let iterations = (self.effort.refined.div_ceil(RESTARTS) as u64).max(1);
        let outcome = Executor::new(problem, solver).configure(|state| state.max_iters(iterations)).run();
        // The only error is that of a cost, which has none; what was tried before counts all the same.
        outcome
            .ok()
            .and_then(|mut done| done.problem.take_problem())
            .map_or_else(Vec::new, |problem| problem.tried.into_inner())
    }

    fn with(&self, gains: &[f64]) -> Rig {
        let mut rig = self.rig.clone();
        for (gain, value) in self.gains.iter().zip(gains) {
            gain.set(&mut rig.control, *value);
        }
        rig
    }

    fn fly(&self, gains: &[f64], seed: u64, extra_s: f64, count: usize) -> Vec<Option<Figures>> {
        fly_models(&self.with(gains), self.of, &self.task, seed, extra_s, count)
    }

    fn trial(&self, gains: &[f64], models: usize) -> Trial {
        let margins = self.of.response(&self.with(gains), &self.task).map(|response| response.margins());
        let lost = Figures {
            rms_m: f64::INFINITY,
            overshoot: f64::INFINITY,
            settling_s: f64::INFINITY,
            activity: f64::INFINITY,
        };
        // A loop that is not stable at rest needs no flights to be told.
        let flown: Vec<Option<Figures>> = match margins {
            Some(_) => self.fly(gains, self.effort.seed, 0.0, models),
            None => vec![None; models],
        };
        let at = |share: f64| {
            let of = |figure: fn(&Figures) -> f64| {
                percentile(flown.iter().map(|f| figure(&f.unwrap_or(lost))), share)
            };
            Figures {
                rms_m: of(|f| f.rms_m),
                overshoot: of(|f| f.overshoot),
                settling_s: of(|f| f.settling_s),
                activity: of(|f| f.activity),
            }
        };
        let (p95, median) = (at(SHARE), at(0.5));
        let broken = broken(&self.limits.inside(INSIDE), &p95, margins.as_ref());
        let l = &self.limits;
        let small = p95.overshoot / l.overshoot + p95.settling_s / l.settling_s + p95.activity / l.activity;
        let cost = p95.rms_m / l.rms_m + SMALL * small + BROKEN * broken;
        Trial {
            gains: gains.to_vec(),
            flown: Share::clopper_pearson(flown.iter().map(Option::is_some)),
            admissible: self::broken(l, &p95, margins.as_ref()) == 0.0,
            cost: if cost.is_finite() {
                cost.min(LOST)
            } else {
                LOST + LOST * (1.0 - Share::clopper_pearson(flown.iter().map(Option::is_some)).value())
            },
            p95,
            median,
            margins,
        }
    }
}

/// By how much limits are broken, as shares of them.
fn broken(l: &Limits, p95: &Figures, margins: Option<&Margins>) -> f64 {
    let above = |value: f64, limit: f64| (value / limit - 1.0).max(0.0);
    let below = |value: Option<f64>, limit: f64| value.map_or(0.0, |value| (1.0 - value / limit).max(0.0));
    let of_flights = above(p95.rms_m, l.rms_m)
        + above(p95.overshoot, l.overshoot)
        + above(p95.settling_s, l.settling_s)
        + above(p95.activity, l.activity);
    let of_loop = margins.map_or(f64::INFINITY, |m| {
        below(m.gain_db, l.gain_db)
            + below(m.gain_reduction_db, l.gain_db)
            + below(m.phase_deg, l.phase_deg)
            + below(m.delay_s, l.delay_s)
    });
    of_flights + of_loop
}

impl Limits {
    /// Stricter by a share.
    fn inside(&self, share: f64) -> Self {
        let (most, least) = (1.0 - share, 1.0 + share);
        Self {
            rms_m: most * self.rms_m,
            overshoot: most * self.overshoot,
            settling_s: most * self.settling_s,
            activity: most * self.activity,
            gain_db: least * self.gain_db,
            phase_deg: least * self.phase_deg,
            delay_s: least * self.delay_s,
        }
    }
}

/// The least cost of those that hold all limits or, where none does, of all.
fn best(trials: &[Trial]) -> &Trial {
    let order =
        |a: &&Trial, b: &&Trial| b.admissible.cmp(&a.admissible).then_with(|| a.cost.total_cmp(&b.cost));
    trials.iter().min_by(order).expect("the rig's own gains were tried")
}

/// What argmin sees of a search: shares of the ranges' logarithms.
struct Refinement<'s, 'a> {
    search: &'s Search<'a>,
    restart: usize,
    tried: RefCell<Vec<Trial>>,
}

impl CostFunction for Refinement<'_, '_> {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, shares: &Vec<f64>) -> Result<f64, Error> {
        let search = self.search;
        let tried = self.tried.borrow().len();
        let planned = (PER_STEP * search.effort.refined as f64 / RESTARTS as f64).ceil() as usize;
        let done = (self.restart * planned + tried.min(planned)).min(RESTARTS * planned);
        search.tell(Stage::Refine, done, RESTARTS * planned);
        let gains: Vec<f64> = search.gains.iter().zip(shares).map(|(gain, x)| gain.at(*x)).collect();
        let trial = search.trial(&gains, search.effort.models);
        // Outside of a range nothing is tried; the wall leads back.
        let outside: f64 = shares.iter().map(|x| (x - x.clamp(0.0, 1.0)).abs()).sum();
        let cost = trial.cost + BROKEN * outside;
        self.tried.borrow_mut().push(trial);
        Ok(cost)
    }
}
