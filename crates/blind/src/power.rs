//! What a rig's flights can show: how large each effect must be, what is taken for what, and which mission helps.
//!
//! Every form of every effect is flown in several sizes on several drawn airframes, in the same air and noise each, and
//! its detectability computed as in a seal. What can be told apart comes from the angle between two effects' expected
//! responses on flights without any.

use std::{
    collections::BTreeSet,
    sync::atomic::{AtomicUsize, Ordering},
};

use bench_rig::{Mission, Rig};
use bench_statistics::{mean, median};
use nalgebra::DMatrix;
use rayon::prelude::*;
use serde::Serialize;

use crate::{
    BlindError,
    cases::{self, Case, Kind},
    detect::{Responses, Watch, is_random},
    flight,
};

/// Schema of what a rig's flights can show.
pub const POWER_SCHEMA: &str = "bench.blind-power/1";

/// d' from which an effect can be suspected, and from which it is plain in most flights.
pub const THRESHOLDS: [f64; 2] = [2.0, 5.0];
/// Effects whose responses have a larger cosine than this cannot be told apart.
pub const ALIKE: f64 = 0.8;
/// Sizes between the smallest and the largest, both included.
const SIZES: usize = 7;
/// Responses below this d' have no direction worth telling.
const LEAST_RESPONSE: f64 = 0.1;

/// What is asked.
#[derive(Clone, Debug)]
pub struct PowerPlan {
    /// The rig; effects in it are refused.
    pub rig: Rig,
    /// Flown in turn.
    pub missions: Vec<Mission>,
    /// Effects to fly; all with none.
    pub effects: Vec<String>,
    /// Airframes that are drawn, each with its own air and forms; 1 to 99.
    pub draws: usize,
    /// Everything random follows from it.
    pub seed: u64,
}

/// What a rig's flights can show. As JSON it is `bench.blind-power/1`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Power {
    /// [`POWER_SCHEMA`].
    pub schema: &'static str,
    /// The rig.
    pub rig: String,
    /// Missions in the order in which they are flown.
    pub missions: Vec<String>,
    /// Airframes drawn.
    pub draws: usize,
    /// Of everything random.
    pub seed: u64,
    /// Every form of every effect.
    pub forms: Vec<FormPower>,
    /// Effects that these flights cannot tell apart.
    pub groups: Vec<Group>,
    /// Every two effects with a response, most alike first.
    pub cosines: Vec<Cosine>,
}

/// How well a form of an effect is seen.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FormPower {
    /// The effect.
    pub effect: String,
    /// The form that it takes.
    pub form: String,
    /// What a size is, with its unit.
    pub size_of: String,
    /// Whether smaller is stronger: `seen_from` then holds the largest size that is seen, not the smallest.
    pub stronger_when_small: bool,
    /// d' by size, from the weakest to the strongest.
    pub curve: Vec<Point>,
    /// The size from which d' is 2, and 5, with all missions.
    pub seen_from: Vec<SeenFrom>,
    /// The mission that shows it best alone; absent where none shows it.
    pub best_mission: Option<usize>,
    /// The same for each mission alone.
    pub by_mission: Vec<Vec<SeenFrom>>,
}

/// A point of a curve of detectability.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Point {
    /// Size, absolute; the median of the draws where they differ.
    pub size: f64,
    /// Median d' of the draws.
    pub detectability: f64,
    /// Smallest.
    pub low: f64,
    /// Largest.
    pub high: f64,
}

/// The size from which an effect is seen.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct SeenFrom {
    /// At this d'.
    pub detectability: f64,
    /// Median of the draws; absent where half of them or more do not show it at the strongest size flown.
    pub size: Option<f64>,
    /// `size` is the weakest one flown: weaker ones may be seen, too.
    pub or_weaker: bool,
    /// Weakest of the draws; absent where none shows it.
    pub low: Option<f64>,
    /// Strongest of the draws; absent where one of them does not show it.
    pub high: Option<f64>,
}

/// Effects that these flights cannot tell apart: every two of them are alike.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Group {
    /// Their names.
    pub effects: Vec<String>,
    /// Smallest cosine between two of them.
    pub cosine: f64,
    /// The mission that tells them apart best.
    pub best_mission: usize,
    /// d' of the difference between the two most alike, with that mission alone ...
    pub apart: f64,
    /// ... and with all.
    pub apart_with_all: f64,
}

/// How alike two effects are.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Cosine {
    /// Two names.
    pub effects: [String; 2],
    /// Absolute cosine between their responses, the rig's tolerances projected out: of the two forms most alike, mean of
    /// the draws.
    pub cosine: f64,
}

impl PowerPlan {
    fn check(&self) -> Result<(), BlindError> {
        let refuse = |detail: String| Err(BlindError::Power { detail });
        if !self.rig.effects.is_empty() {
            return refuse(format!("rig {} has effects; take them out", self.rig.name));
        }
        if self.missions.is_empty() {
            return refuse("there is no mission to fly".to_owned());
        }
        if !(1..=99).contains(&self.draws) {
            return refuse(format!("{} draws asked for, expected 1 to 99", self.draws));
        }
        let known: BTreeSet<&str> = cases::known_kinds().map(|(_, kind)| kind.effect).collect();
        if let Some(stranger) = self.effects.iter().find(|effect| !known.contains(effect.as_str())) {
            let known: Vec<_> = known.into_iter().collect();
            return refuse(format!("no effect is called {stranger:?} here; there are {}", known.join(", ")));
        }
        Ok(())
    }

    fn kinds(&self) -> Vec<(u64, &'static Kind)> {
        let wanted = |kind: &Kind| self.effects.is_empty() || self.effects.iter().any(|e| e == kind.effect);
        cases::known_kinds().filter(|(_, kind)| wanted(kind)).collect()
    }

    /// How many flights of all missions [`power`] takes.
    pub fn flights(&self) -> usize {
        self.kinds().len() * self.draws * SIZES + self.draws
    }
}

/// Flies everything; calls `each` with how many of [`PowerPlan::flights`] are done.
pub fn power(plan: &PowerPlan, each: impl Fn(usize) + Sync) -> Result<Power, BlindError> {
    plan.check()?;
    let kinds = plan.kinds();
    let done = AtomicUsize::new(0);
    let tick = || each(done.fetch_add(1, Ordering::Relaxed) + 1);
    let jobs: Vec<(usize, usize, usize)> = (0..kinds.len())
        .flat_map(|kind| (0..plan.draws).flat_map(move |draw| (0..SIZES).map(move |step| (kind, draw, step))))
        .collect();
    let flown: Vec<Flown> = jobs
        .into_par_iter()
        .map(|(kind, draw, step)| {
            let flown = fly(plan, kinds[kind], draw, step);
            tick();
            flown
        })
        .collect::<Result<_, _>>()?;
    // By kind, draw and size.
    let of = |kind: usize, draw: usize| &flown[(kind * plan.draws + draw) * SIZES..][..SIZES];
    let forms: Vec<FormPower> =
        kinds.iter().enumerate().map(|(i, (_, kind))| form_power(plan, kind, &|draw| of(i, draw))).collect();
    let products: Vec<Vec<DMatrix<f64>>> = (0..plan.draws)
        .into_par_iter()
        .map(|draw| {
            let places: Vec<f64> = (0..kinds.len()).map(|kind| place_of_plain(of(kind, draw))).collect();
            let products = responses(plan, &kinds, draw, &places);
            tick();
            products
        })
        .collect::<Result<_, _>>()?;
    let (groups, cosines) = alike(&kinds, &products);
    Ok(Power {
        schema: POWER_SCHEMA,
        rig: plan.rig.name.clone(),
        missions: plan.missions.iter().map(|mission| mission.name.clone()).collect(),
        draws: plan.draws,
        seed: plan.seed,
        forms,
        groups,
        cosines,
    })
}

/// A kind in one size on one airframe.
struct Flown {
    /// The size, or its inverse where smaller is stronger.
    strength: f64,
    /// d' with all missions.
    all: f64,
    /// With each alone.
    alone: Vec<f64>,
}

/// Place of a step between the weakest (0) and the strongest (1).
fn place(step: usize) -> f64 {
    step as f64 / (SIZES - 1) as f64
}

/// The same between the smallest and the largest size.
fn place_of_size(kind: &Kind, place: f64) -> f64 {
    if kind.is_stronger_when_small() { 1.0 - place } else { place }
}

/// A size's strength, and a strength's size.
fn strength(kind: &Kind, size: f64) -> f64 {
    if kind.is_stronger_when_small() { size.recip() } else { size }
}

fn fly(plan: &PowerPlan, kind: (u64, &Kind), draw: usize, step: usize) -> Result<Flown, BlindError> {
    let case = cases::of_size(&plan.rig, plan.seed, draw as u64, kind, place_of_size(kind.1, place(step)));
    let size = case.truth.ingredients.first().map_or(0.0, |ingredient| ingredient.size.abs());
    let mut all = Watch::new(&plan.rig, &case.lab);
    let mut alone = Vec::new();
    flight::fly_all(&plan.rig, &plan.missions, &case.lab, |_, flown| {
        let mut own = Watch::new(&plan.rig, &case.lab);
        own.add(&flown.trace);
        all.absorb(&own);
        alone.push(own.detectability().0);
        Ok(())
    })?;
    Ok(Flown { strength: strength(kind.1, size), all: all.detectability().0, alone })
}

/// The place between weakest and strongest from which an effect is plain; the strongest where it never is.
fn place_of_plain(flown: &[Flown]) -> f64 {
    let places: Vec<f64> = (0..SIZES).map(|step| (10.0 * place(step)).exp()).collect();
    let curve: Vec<f64> = flown.iter().map(|f| f.all).collect();
    match crossing(&places, &curve, THRESHOLDS[1]) {
        Crossing::Below => 0.0,
        Crossing::At(x) => x.ln() / 10.0,
        Crossing::Never => 1.0,
    }
}

enum Crossing {
    /// Above the threshold at the smallest size.
    Below,
    At(f64),
    Never,
}

/// Where a curve first passes a threshold, straight lines between logarithms.
fn crossing(sizes: &[f64], curve: &[f64], threshold: f64) -> Crossing {
    const LEAST: f64 = 1e-3;
    let Some(first) = curve.iter().position(|d| *d >= threshold) else { return Crossing::Never };
    if first == 0 {
        return Crossing::Below;
    }
    let (low, high) = (curve[first - 1].max(LEAST).ln(), curve[first].ln());
    let part = (threshold.ln() - low) / (high - low);
    let (from, to) = (sizes[first - 1].ln(), sizes[first].ln());
    Crossing::At((from + part * (to - from)).exp())
}

fn seen_from<'a>(
    kind: &Kind,
    draws: usize,
    of: &dyn Fn(usize) -> &'a [Flown],
    curve_of: &dyn Fn(&Flown) -> f64,
) -> Vec<SeenFrom> {
    let at = |detectability: f64| {
        let mut below = 0;
        let mut sizes: Vec<f64> = (0..draws)
            .map(|draw| {
                let sizes: Vec<f64> = of(draw).iter().map(|f| f.strength).collect();
                let curve: Vec<f64> = of(draw).iter().map(curve_of).collect();
                match crossing(&sizes, &curve, detectability) {
                    Crossing::Below => {
                        below += 1;
                        sizes[0]
                    }
                    Crossing::At(size) => size,
                    Crossing::Never => f64::INFINITY,
                }
            })
            .collect();
        sizes.sort_by(f64::total_cmp);
        let finite = |found: f64| Some(found).filter(|x| x.is_finite()).map(|x| strength(kind, x));
        // A half that is infinite makes the mean of the middle two so, too.
        let size = median(sizes.iter().copied()).and_then(finite);
        let (low, high) = (finite(sizes[0]), finite(sizes[draws - 1]));
        SeenFrom { detectability, size, or_weaker: size.is_some() && 2 * below > draws, low, high }
    };
    THRESHOLDS.map(at).to_vec()
}

fn form_power<'a>(plan: &PowerPlan, kind: &Kind, of: &dyn Fn(usize) -> &'a [Flown]) -> FormPower {
    let over_draws = |value: &dyn Fn(&'a [Flown]) -> f64| -> Vec<f64> {
        let mut values: Vec<f64> = (0..plan.draws).map(|draw| value(of(draw))).collect();
        values.sort_by(f64::total_cmp);
        values
    };
    let middle = |values: &[f64]| median(values.iter().copied()).unwrap_or(0.0);
    let curve = (0..SIZES)
        .map(|step| {
            let seen = over_draws(&|flown| flown[step].all);
            Point {
                size: strength(kind, middle(&over_draws(&|flown| flown[step].strength))),
                detectability: middle(&seen),
                low: seen[0],
                high: seen[plan.draws - 1],
            }
        })
        .collect();
    let missions = 0..plan.missions.len();
    let by_mission: Vec<Vec<SeenFrom>> =
        missions.clone().map(|i| seen_from(kind, plan.draws, of, &|flown| flown.alone[i])).collect();
    // Best is what shows most of the smallest size that all missions together show plainly.
    let step = (0..SIZES)
        .find(|step| middle(&over_draws(&|flown| flown[*step].all)) >= THRESHOLDS[1])
        .unwrap_or(SIZES - 1);
    let shown: Vec<f64> = missions.map(|i| middle(&over_draws(&|flown| flown[step].alone[i]))).collect();
    let best = (0..shown.len()).max_by(|a, b| shown[*a].total_cmp(&shown[*b]));
    FormPower {
        effect: kind.effect.to_owned(),
        form: kind.form.to_owned(),
        size_of: kind.size_of.to_owned(),
        stronger_when_small: kind.is_stronger_when_small(),
        curve,
        seen_from: seen_from(kind, plan.draws, of, &|flown| flown.all),
        best_mission: best.filter(|best| shown[*best] >= 1.0),
        by_mission,
    }
}

/// Products of all kinds' responses for each mission, and for all of them at the end, on an airframe's flights without
/// any effect.
fn responses(
    plan: &PowerPlan,
    kinds: &[(u64, &'static Kind)],
    draw: usize,
    places: &[f64],
) -> Result<Vec<DMatrix<f64>>, BlindError> {
    let number = draw as u64;
    let sound = cases::without_effect(&plan.rig, plan.seed, number);
    let cases: Vec<Case> = kinds
        .iter()
        .zip(places)
        .map(|(kind, place)| {
            cases::of_size(&plan.rig, plan.seed, number, *kind, place_of_size(kind.1, *place))
        })
        .collect();
    let labs: Vec<_> = cases.iter().map(|case| &case.lab).collect();
    let mut sum: Option<Responses> = None;
    let mut products = Vec::new();
    flight::fly_all(&plan.rig, &plan.missions, &sound.lab, |_, flown| {
        let own = Responses::of(&plan.rig, &sound.lab, &flown.trace, &labs);
        products.push(own.products());
        match &mut sum {
            Some(sum) => sum.absorb(&own),
            None => sum = Some(own),
        }
        Ok(())
    })?;
    products.extend(sum.map(|sum| sum.products()));
    // What no one can predict has no direction: gusts, and what shows in the spread of noise or in counts.
    for (i, case) in cases.iter().enumerate() {
        if case.lab.faults.iter().any(|fault| is_random(fault) || fault.is_told_by_spread()) {
            for product in &mut products {
                product.row_mut(i).fill(0.0);
                product.column_mut(i).fill(0.0);
            }
        }
    }
    Ok(products)
}

/// Cosine of the responses `i` and `j`; absent where one of them is none.
fn cosine(products: &DMatrix<f64>, i: usize, j: usize) -> Option<f64> {
    let (own, other) = (products[(i, i)], products[(j, j)]);
    let least = LEAST_RESPONSE * LEAST_RESPONSE;
    (own > least && other > least).then(|| (products[(i, j)].abs() / (own * other).sqrt()).min(1.0))
}

/// A value of the forms `i` and `j` from one draw's products.
type OfForms<'a> = dyn Fn(&[DMatrix<f64>], usize, usize) -> Option<f64> + 'a;

fn alike(kinds: &[(u64, &'static Kind)], products: &[Vec<DMatrix<f64>>]) -> (Vec<Group>, Vec<Cosine>) {
    let effects: BTreeSet<&str> = kinds.iter().map(|(_, kind)| kind.effect).collect();
    let effects: Vec<&str> = effects.into_iter().collect();
    let forms_of = |effect: &&str| (0..kinds.len()).filter(|i| kinds[*i].1.effect == *effect).collect();
    let forms: Vec<Vec<usize>> = effects.iter().map(forms_of).collect();
    let last = products.first().map_or(0, |draw| draw.len().saturating_sub(1));
    // Nobody knows which form an effect takes: what counts is the two forms that are most alike. Mean over draws.
    let over_draws = |a: usize, b: usize, value: &OfForms<'_>| {
        let values = products.iter().filter_map(|draw| {
            let of_forms = forms[a].iter().flat_map(|i| forms[b].iter().map(move |j| (*i, *j)));
            let alike = of_forms.filter_map(|(i, j)| Some((cosine(&draw[last], i, j)?, i, j)));
            let (_, i, j) = alike.max_by(|x, y| x.0.total_cmp(&y.0))?;
            value(draw, i, j)
        });
        mean(values)
    };
    let mut between = vec![vec![None; effects.len()]; effects.len()];
    let mut cosines = Vec::new();
    for a in 0..effects.len() {
        for b in a + 1..effects.len() {
            let mean = over_draws(a, b, &|draw, i, j| cosine(&draw[last], i, j));
            between[a][b] = mean;
            between[b][a] = mean;
            let effects = [effects[a].to_owned(), effects[b].to_owned()];
            cosines.extend(mean.map(|cosine| Cosine { effects, cosine }));
        }
    }
    cosines.sort_by(|a, b| b.cosine.total_cmp(&a.cosine));
    // d' of what of `a` no size of `b` explains.
    let apart = |mission: usize, a: usize, b: usize| {
        over_draws(a, b, &|draw, i, j| {
            let rest = 1.0 - cosine(&draw[mission], i, j)?.powi(2);
            Some((draw[mission][(i, i)].min(draw[mission][(j, j)]) * rest).max(0.0).sqrt())
        })
        .unwrap_or(0.0)
    };
    let groups = clusters(&between)
        .into_iter()
        .map(|members| {
            let pairs: Vec<(usize, usize)> = members
                .iter()
                .flat_map(|a| members.iter().filter(move |b| a < *b).map(|b| (*a, *b)))
                .collect();
            let hardest = |mission: usize| {
                pairs.iter().map(|(a, b)| apart(mission, *a, *b)).fold(f64::INFINITY, f64::min)
            };
            let best = (0..last).max_by(|a, b| hardest(*a).total_cmp(&hardest(*b))).unwrap_or(0);
            Group {
                effects: members.iter().map(|i| effects[*i].to_owned()).collect(),
                cosine: pairs.iter().filter_map(|(a, b)| between[*a][*b]).fold(1.0, f64::min),
                best_mission: best,
                apart: hardest(best),
                apart_with_all: hardest(last),
            }
        })
        .collect();
    (groups, cosines)
}

/// Groups in which every two are alike, the most alike joined first.
fn clusters(between: &[Vec<Option<f64>>]) -> Vec<Vec<usize>> {
    let mut groups: Vec<Vec<usize>> = (0..between.len()).map(|i| vec![i]).collect();
    let least = |a: &[usize], b: &[usize]| {
        let all = a.iter().flat_map(|i| b.iter().map(|j| between[*i][*j].unwrap_or(0.0)));
        all.fold(1.0, f64::min)
    };
    loop {
        let mut best = (ALIKE, None);
        for a in 0..groups.len() {
            for b in a + 1..groups.len() {
                let cosine = least(&groups[a], &groups[b]);
                if cosine > best.0 {
                    best = (cosine, Some((a, b)));
                }
            }
        }
        let (_, Some((a, b))) = best else { break };
        let other = groups.remove(b);
        groups[a].extend(other);
        groups[a].sort_unstable();
    }
    groups.retain(|group| group.len() > 1);
    groups
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_crossing_lies_between_sizes_on_logarithmic_lines() {
        // d' = 10 size: 2 at 0.2, 5 at 0.5.
        let (sizes, curve) = ([0.01, 0.1, 1.0], [0.1, 1.0, 10.0]);
        assert!(matches!(crossing(&sizes, &curve, 5.0), Crossing::At(x) if (x - 0.5).abs() < 1e-12));
        assert!(matches!(crossing(&sizes, &curve, 0.05), Crossing::Below));
        assert!(matches!(crossing(&sizes, &curve, 11.0), Crossing::Never));
    }

    #[test]
    fn a_group_has_no_two_members_that_can_be_told_apart() {
        // 0 and 1 alike, 1 and 2 alike, 0 and 2 not; 3 has no response.
        let (a, b, c) = (Some(0.95), Some(0.9), Some(0.3));
        let between = [
            vec![None, a, c, None],
            vec![a, None, b, None],
            vec![c, b, None, None],
            vec![None, None, None, None],
        ];
        assert_eq!(clusters(&between), [vec![0, 1]]);
    }
}
