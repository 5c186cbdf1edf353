//! What is drawn: how many cases of which family, their kinds and sizes, and every nuisance.

mod catalogue;
mod lab;

use std::collections::BTreeMap;

use bench_rig::Rig;
use serde::{Deserialize, Serialize};

pub(crate) use self::catalogue::Kind;
use self::catalogue::{Draw, KINDS, Made, Scale};
pub(crate) use self::lab::{Fault, Lab};
use crate::{
    physics::{air::Turbulence, body::Numbers},
    random::{self, Random, below, happens, log_uniform, normal_within, sign, uniform},
};

/// What a case is meant to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Family {
    /// Nothing but numbers within tolerance, or a little beyond.
    None,
    /// One effect of the library, in another form.
    Single,
    /// Two of them.
    Pair,
    /// Something that the library does not have.
    Outside,
}

impl Family {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::None, Self::Single, Self::Pair, Self::Outside];

    /// Its name in keys and on the screen.
    pub const fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Single => "single",
            Self::Pair => "pair",
            Self::Outside => "outside",
        }
    }
}

/// A parameter of an effect in the library's words.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Parameter {
    /// The effect's name.
    pub effect: String,
    /// The parameter's name, which ends in its unit.
    pub name: String,
    /// Its true value, or that which comes closest in a foreign form.
    pub value: f64,
}

/// One thing that was put into a case.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Ingredient {
    /// The library's name; absent outside of it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub effect: Option<String>,
    /// The form it took.
    pub form: String,
    /// Where it sits: tracker, loop, actuator, propulsion, environment or airframe.
    pub stage: String,
    /// Axes along which it shows; empty where there is none.
    pub regions: Vec<String>,
    /// Its size, in the unit that `size_of` names.
    pub size: f64,
    /// What the size is, with its unit.
    pub size_of: String,
    /// Detectability of this alone, all else in the case known: square root of twice the expected log-likelihood ratio.
    pub detectability: f64,
    /// Everything about the form, for people.
    pub form_in_full: String,
}

/// What a case is, as its key tells.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Truth {
    /// Its family.
    pub family: Family,
    /// What was put in.
    pub ingredients: Vec<Ingredient>,
    /// Parameters in the library's words, where it has some.
    pub parameters: Vec<Parameter>,
    /// Detectability of all that was put in.
    pub detectability: f64,
    /// This airframe's own numbers, in deviations (one sigma of the rig) from nominal.
    pub nuisances_sigma: BTreeMap<String, f64>,
    /// Deviation of the room's turbulence, m/s.
    pub turbulence_m_s: f64,
    /// Correlation time of it, s.
    pub turbulence_correlation_s: f64,
    /// Fraction of thrust gone after a minute of hover, without any effect.
    pub drain_per_min: f64,
}

impl Truth {
    /// What the right answer is called: `none`, `unknown`, an effect, or two in order joined by `+`.
    pub fn label(&self) -> String {
        match self.family {
            Family::None => "none".to_owned(),
            Family::Outside => "unknown".to_owned(),
            Family::Single | Family::Pair => {
                label(self.ingredients.iter().filter_map(|i| i.effect.as_deref()))
            }
        }
    }
}

/// The label of a set of effects.
pub(crate) fn label<'a>(effects: impl IntoIterator<Item = &'a str>) -> String {
    let mut names: Vec<_> = effects.into_iter().collect();
    names.sort_unstable();
    names.join("+")
}

/// Every room's air moves; more than this is gusts.
pub(crate) const STRONGEST_TURBULENCE_M_S: f64 = 0.06;

/// A case ready to be flown, and its truth but for the detectability.
pub(crate) struct Case {
    pub lab: Lab,
    pub truth: Truth,
}

/// A generator's random numbers: what they are for.
const ORDER: u64 = 1 << 32;
const DRAW: u64 = 2 << 32;
const POWER: u64 = 3 << 32;

/// How many cases of each family: a fifth none, a fifth outside, two in fifteen pairs, the rest single.
fn shares(cases: usize) -> [(Family, usize); 4] {
    let part = |of_300: usize| (cases * of_300 + 150) / 300;
    let (none, pairs, outside) = (part(60), part(40), part(60));
    let single = cases.saturating_sub(none + pairs + outside);
    [(Family::None, none), (Family::Single, single), (Family::Pair, pairs), (Family::Outside, outside)]
}

/// Draws all cases in the order in which they are sealed.
pub(crate) fn draw(rig: &Rig, cases: usize, seed: u64, with_reserved: bool) -> Vec<Case> {
    let mut order = random::stream(seed, ORDER, 0, 0);
    let scale = Scale::of(rig);
    let mut plans: Vec<(Family, Vec<Made>, Vec<&Kind>)> = Vec::new();
    for (family, count) in shares(cases) {
        let mut turns = Turns::new(family, with_reserved);
        for i in 0..count {
            let mut random = random::stream(seed, DRAW, family as u64, i as u64);
            let (kinds, made) = match family {
                Family::None => (Vec::new(), Vec::new()),
                Family::Single | Family::Outside => {
                    let kind = turns.next(&mut order);
                    (vec![kind], vec![(kind.make)(&mut Draw::any(&mut random), &scale)])
                }
                Family::Pair => pair(&mut turns, &mut order, &mut random, &scale),
            };
            plans.push((family, made, kinds));
        }
    }
    random::shuffle(&mut order, &mut plans);
    let sealed = plans.into_iter().enumerate();
    sealed.map(|(i, (family, made, kinds))| case(rig, seed, i as u64, family, made, &kinds)).collect()
}

/// All forms of the library's effects, with a number of their own.
pub(crate) fn known_kinds() -> impl Iterator<Item = (u64, &'static Kind)> {
    (0..).zip(KINDS).filter(|(_, kind)| !kind.effect.is_empty())
}

/// A case of one kind with its size chosen, 0 the smallest that is drawn and 1 the largest. The airframe's own numbers,
/// the air and the noise are those of the draw, whatever the kind and the size.
pub(crate) fn of_size(rig: &Rig, seed: u64, draw: u64, (number, kind): (u64, &Kind), at: f64) -> Case {
    let mut random = random::stream(seed, POWER, number, draw);
    let made = (kind.make)(&mut Draw::of_size(&mut random, at), &Scale::of(rig));
    case(rig, seed, draw, Family::Single, vec![made], &[kind])
}

/// The same without any effect.
pub(crate) fn without_effect(rig: &Rig, seed: u64, draw: u64) -> Case {
    case(rig, seed, draw, Family::None, Vec::new(), &[])
}

/// Goes through all effects before any comes again, in random order; of an effect, any form.
struct Turns {
    effects: Vec<Vec<&'static Kind>>,
    left: Vec<usize>,
}

impl Turns {
    fn new(family: Family, with_reserved: bool) -> Self {
        let mut effects: BTreeMap<&str, Vec<&Kind>> = BTreeMap::new();
        for kind in KINDS.iter().filter(|kind| with_reserved || !kind.reserved) {
            if kind.effect.is_empty() == (family == Family::Outside) {
                let turn = if kind.effect.is_empty() { kind.form } else { kind.effect };
                effects.entry(turn).or_default().push(kind);
            }
        }
        Self { effects: effects.into_values().collect(), left: Vec::new() }
    }

    fn next(&mut self, random: &mut Random) -> &'static Kind {
        if self.left.is_empty() {
            self.left = (0..self.effects.len()).collect();
            random::shuffle(random, &mut self.left);
        }
        let forms = &self.effects[self.left.pop().unwrap_or(0)];
        forms[below(random, forms.len())]
    }
}

/// Two effects of different names that one case can hold.
fn pair(
    turns: &mut Turns,
    order: &mut Random,
    random: &mut Random,
    scale: &Scale,
) -> (Vec<&'static Kind>, Vec<Made>) {
    let first = turns.next(order);
    let made = (first.make)(&mut Draw::any(random), scale);
    loop {
        let second = turns.next(order);
        if second.effect == first.effect {
            continue;
        }
        let other = (second.make)(&mut Draw::any(random), scale);
        if made.fault.goes_with(&other.fault) {
            // In the order of the catalogue: rotors before batteries, ground before mass.
            let place =
                |kind: &Kind| KINDS.iter().position(|k| k.form == kind.form && k.effect == kind.effect);
            return if place(first) <= place(second) {
                (vec![first, second], vec![made, other])
            } else {
                (vec![second, first], vec![other, made])
            };
        }
    }
}

fn case(rig: &Rig, seed: u64, index: u64, family: Family, made: Vec<Made>, kinds: &[&Kind]) -> Case {
    let mut random = random::stream(seed, DRAW, 1 << 16, index);
    let (nominal, sigma) = Numbers::of(rig);
    let deviations = deviations(&mut random);
    let mut numbers = nominal;
    for (number, (deviation, sigma)) in numbers.0.iter_mut().zip(deviations.iter().zip(sigma)) {
        *number += deviation * sigma;
    }
    // A tolerance may be wide enough to reach what cannot be: no negative drag, no ground effect upside down.
    numbers.0[1] = numbers.0[1].max(0.0);
    numbers.0[4] = numbers.0[4].max(1.0);
    numbers.0[5] = numbers.0[5].max(1e-3);
    numbers.0[Numbers::LATENCY] = numbers.0[Numbers::LATENCY].max(0.0);
    let turbulence = Turbulence {
        sigma_m_s: log_uniform(&mut random, 0.008, STRONGEST_TURBULENCE_M_S),
        correlation_s: log_uniform(&mut random, 0.3, 1.5),
    };
    let drain_per_min = uniform(&mut random, 0.001, 0.005);
    let mut parameters = Vec::new();
    let mut ingredients = Vec::new();
    let mut faults = Vec::new();
    for (made, kind) in made.into_iter().zip(kinds) {
        let effect = (!kind.effect.is_empty()).then(|| kind.effect.to_owned());
        for parameter in made.parameters {
            parameters.push(Parameter { effect: kind.effect.to_owned(), ..parameter });
        }
        ingredients.push(Ingredient {
            effect,
            form: kind.form.to_owned(),
            stage: kind.stage.to_owned(),
            regions: kind.regions.iter().map(|&axis| axis.to_owned()).collect(),
            size: made.size,
            size_of: kind.size_of.to_owned(),
            detectability: 0.0,
            form_in_full: format!("{:?}", made.fault),
        });
        faults.push(made.fault);
    }
    let names = Numbers::NAMES.iter().map(|&name| name.to_owned());
    let truth = Truth {
        family,
        ingredients,
        parameters,
        detectability: 0.0,
        nuisances_sigma: names.zip(deviations).collect(),
        turbulence_m_s: turbulence.sigma_m_s,
        turbulence_correlation_s: turbulence.correlation_s,
        drain_per_min,
    };
    let camera = Lab::camera(rig, numbers, &faults);
    let rest = rig.airframe.sticks.min;
    let lab = Lab { numbers, faults, turbulence, drain_per_min, camera, rest, seed, stream: index };
    Case { lab, truth }
}

/// How far each number is off, in deviations: mostly within tolerance, in a fifth of the cases all near its edge, in
/// another fifth one of them beyond, up to 1.5.
fn deviations(random: &mut Random) -> [f64; 7] {
    let mut all = std::array::from_fn(|_| normal_within(random, 1.0));
    let edge = uniform(random, 0.0, 1.0);
    if edge < 0.2 {
        all = std::array::from_fn(|_| sign(random) * uniform(random, 0.85, 1.0));
    } else if edge < 0.4 {
        all[below(random, 7)] = uniform(random, 1.0, 1.5) * if happens(random, 0.5) { 1.0 } else { -1.0 };
    }
    all
}
