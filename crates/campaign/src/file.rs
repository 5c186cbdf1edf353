//! The plan's file: TOML to checked values, all problems at once.

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

use bench_plant::effects::{LIBRARY, index_of, resolve_all};
use bench_rig::{
    EffectEntry, Location, Problem, RigError,
    visit::{self, Node, Range, Reader, Value},
};

use crate::{
    draw::Draw,
    keys::{
        AIRFRAMES, COUNT, DESCRIPTION, DIAGNOSIS, EFFECTS, FIRST, KIND, LOG_UNIFORM, MISSIONS, NAME, NORMAL,
        PRIOR, RECORDINGS, RIGS, RUNS_PER_PART, RUNS_PER_PART_MAX, SEED_MAX, SEEDS, SEEDS_MAX, SETS,
        SETS_MAX, UNIFORM, VARIANT,
    },
};

/// Combinations are kept in memory.
const POINTS_MAX: u64 = 10_000;

/// A plan as it stands in its file. What it names is not looked for yet.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanFile {
    /// The file, as it was named.
    pub file: PathBuf,
    /// What it is called.
    pub name: String,
    /// What it is for.
    pub description: String,
    /// What its runs are.
    pub kind: Kind,
    /// Rigs as they are named; none for recordings that carry theirs.
    pub rigs: Vec<String>,
    /// Missions as they are named.
    pub missions: Vec<String>,
    /// Recordings and folders of them as they are named.
    pub recordings: Vec<String>,
    /// Seeds of flights.
    pub seeds: Seeds,
    /// Sets of the case mix for each rig.
    pub sets: u64,
    /// What flies.
    pub airframes: Airframes,
    /// Whether flights are diagnosed.
    pub diagnosis: Diagnosing,
    /// Runs of a part, if the file says.
    pub runs_per_part: Option<u64>,
    /// One at least where flights are swept.
    pub variants: Vec<Variant>,
    lines: Vec<(String, usize)>,
}

/// What the runs of a plan are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Simulated flights.
    Flights,
    /// Diagnoses of recordings.
    Recordings,
    /// Diagnoses of simulated sets of flights with causes of the case mix.
    Mix,
}

/// What flies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Airframes {
    /// The rig's numbers.
    Nominal,
    /// Numbers drawn from its tolerances.
    Drawn,
}

/// Whether flights are diagnosed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Diagnosing {
    /// They are not.
    None,
    /// Each alone.
    Each,
}

/// Seeds, each once.
#[derive(Clone, Debug, PartialEq)]
pub enum Seeds {
    /// One after another.
    Range {
        /// The first.
        first: u64,
        /// How many.
        count: u64,
    },
    /// As listed.
    Listed(Vec<u64>),
}

impl Seeds {
    /// How many.
    pub fn count(&self) -> u64 {
        match self {
            Self::Range { count, .. } => *count,
            Self::Listed(seeds) => seeds.len() as u64,
        }
    }

    /// The seed at a place below [`Seeds::count`].
    pub(crate) fn at(&self, place: u64) -> u64 {
        match self {
            Self::Range { first, .. } => first + place,
            Self::Listed(seeds) => seeds[place as usize],
        }
    }
}

/// Effects that are added to a rig.
#[derive(Clone, Debug, PartialEq)]
pub struct Variant {
    /// Unique in the plan.
    pub name: String,
    /// In the order of the file.
    pub effects: Vec<EffectPlan>,
}

/// An effect whose parameters are given or drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct EffectPlan {
    /// Its name in the library.
    pub effect: String,
    /// Key and how it comes about, in the order of the file.
    pub parameters: Vec<(String, Draw)>,
    /// Line in the plan.
    pub(crate) line: usize,
}

impl PlanFile {
    /// Reads a plan from text; `file` serves messages.
    pub fn read(file: &Path, text: &str) -> Result<Self, RigError> {
        let (plan, problems) = Self::read_as_far_as_possible(file, text)?;
        if problems.is_empty() { Ok(plan) } else { Err(RigError::Invalid(problems)) }
    }

    /// The same with what is right beside all that is wrong, for who has more to check before telling.
    pub fn read_as_far_as_possible(file: &Path, text: &str) -> Result<(Self, Vec<Problem>), RigError> {
        let root = visit::parse(file, text)?;
        let lines = match &root.value {
            Value::Table(entries) => entries.iter().map(|(key, node)| (key.clone(), node.line)).collect(),
            _ => Vec::new(),
        };
        let mut plan = Self {
            file: file.to_owned(),
            name: String::new(),
            description: String::new(),
            kind: Kind::Flights,
            rigs: Vec::new(),
            missions: Vec::new(),
            recordings: Vec::new(),
            seeds: Seeds::Range { first: 0, count: 1 },
            sets: 1,
            airframes: Airframes::Nominal,
            diagnosis: Diagnosing::None,
            runs_per_part: None,
            variants: Vec::new(),
            lines,
        };
        let mut problems = Vec::new();
        Reader::read(file, "", &root, &mut problems, |reader| plan.fill(reader));
        if problems.is_empty() {
            plan.check_effects(&mut problems);
        }
        Ok((plan, problems))
    }

    /// Says what does not fit about one of the keys at its top, where the key stands.
    pub fn problem(&self, key: &str, detail: String) -> Problem {
        let line = self.lines.iter().find(|(name, _)| name == key).map_or(1, |(_, line)| *line);
        Problem::Contradiction { at: self.at(line), key: key.to_owned(), detail }
    }

    pub(crate) fn at(&self, line: usize) -> Location {
        Location { file: self.file.clone(), line }
    }

    fn fill(&mut self, reader: &mut Reader<'_, '_>) {
        reader.text(NAME, &mut self.name);
        reader.text(DESCRIPTION, &mut self.description);
        let kinds = [("flights", Kind::Flights), ("recordings", Kind::Recordings), ("mix", Kind::Mix)];
        reader.choice_or(KIND, &kinds, &mut self.kind);
        self.runs_per_part = maybe_whole(reader, RUNS_PER_PART, 1, RUNS_PER_PART_MAX);
        match self.kind {
            Kind::Flights => self.fill_flights(reader),
            Kind::Recordings => {
                let _ = reader.require(RECORDINGS, "a recording, a folder of some, or a list of them");
                self.recordings = reader.texts(RECORDINGS);
                self.rigs = reader.texts(RIGS);
            }
            Kind::Mix => {
                self.fill_rigs_and_missions(reader);
                if reader.require(SETS, "how many sets").is_some() {
                    self.sets = maybe_whole(reader, SETS, 1, SETS_MAX).unwrap_or(1);
                }
            }
        }
        once(reader, RIGS, &self.rigs);
        once(reader, MISSIONS, &self.missions);
        once(reader, RECORDINGS, &self.recordings);
    }

    fn fill_rigs_and_missions(&mut self, reader: &mut Reader<'_, '_>) {
        let _ = reader.require(RIGS, "a rig's name or file, or a list of them");
        self.rigs = reader.texts(RIGS);
        let _ = reader.require(MISSIONS, "a mission's name or file, or a list of them");
        self.missions = reader.texts(MISSIONS);
    }

    fn fill_flights(&mut self, reader: &mut Reader<'_, '_>) {
        self.fill_rigs_and_missions(reader);
        self.read_seeds(reader);
        let airframes = [("nominal", Airframes::Nominal), ("drawn", Airframes::Drawn)];
        reader.choice_or(AIRFRAMES, &airframes, &mut self.airframes);
        let diagnosis = [("none", Diagnosing::None), ("each", Diagnosing::Each)];
        reader.choice_or(DIAGNOSIS, &diagnosis, &mut self.diagnosis);
        let Some(node) = reader.get(VARIANT) else {
            self.variants = vec![Variant { name: "as it is".to_owned(), effects: Vec::new() }];
            return;
        };
        let expected = "tables, each written as [[variant]]";
        let Value::List(items) = &node.value else { return reader.wrong_type(VARIANT, node, expected) };
        if items.is_empty() {
            return reader.wrong_type(VARIANT, node, expected);
        }
        let mut names = BTreeSet::new();
        for item in items {
            let mut variant = Variant { name: String::new(), effects: Vec::new() };
            reader.within(VARIANT, item, |reader| {
                reader.text(NAME, &mut variant.name);
                if let Some(node) = reader.get(EFFECTS) {
                    variant.effects = effects(reader, node);
                }
                if !variant.name.is_empty() && !names.insert(variant.name.clone()) {
                    let detail = format!("another variant is called {:?}; results are told by names, so each needs its own", variant.name);
                    reader.contradiction(NAME, detail);
                }
                if variant.count() > POINTS_MAX {
                    let detail = format!("its lists make more than {POINTS_MAX} combinations; shorten them, or draw from a distribution");
                    reader.contradiction(EFFECTS, detail);
                    variant.effects.clear();
                }
                let same = |other: &&Variant| other.shares_a_run_with(&variant);
                if let Some(other) = self.variants.iter().find(same) {
                    let detail = format!("adds the same effects as the variant {:?}: its runs would be counted twice", other.name);
                    reader.contradiction(EFFECTS, detail);
                }
            });
            self.variants.push(variant);
        }
    }

    fn read_seeds(&mut self, reader: &mut Reader<'_, '_>) {
        const EXPECTED: &str = "whole numbers in a list, or { first = 0, count = 100 }";
        let Some(node) = reader.get(SEEDS) else { return };
        match &node.value {
            Value::List(items) if !items.is_empty() => {
                let range = Range::closed(0.0, f64::from(SEED_MAX));
                let numbers: Vec<f64> =
                    items.iter().filter_map(|item| reader.number_in(SEEDS, item, range)).collect();
                if numbers.iter().any(|number| number.fract() != 0.0) {
                    reader.contradiction(SEEDS, "seeds are whole numbers".to_owned());
                }
                let seeds: Vec<u64> = numbers.iter().map(|number| *number as u64).collect();
                once(reader, SEEDS, &seeds);
                self.seeds = Seeds::Listed(seeds);
            }
            Value::Table(_) => reader.within(SEEDS, node, |reader| {
                let mut of = |key: &str, low, high| {
                    let _ = reader.require(key, "a whole number");
                    maybe_whole(reader, key, low, high).unwrap_or(1)
                };
                self.seeds = Seeds::Range { first: of(FIRST, 0, SEED_MAX), count: of(COUNT, 1, SEEDS_MAX) };
            }),
            _ => reader.wrong_type(SEEDS, node, EXPECTED),
        }
    }

    /// Names and ranges of all effects, held against the library.
    fn check_effects(&self, problems: &mut Vec<Problem>) {
        for variant in &self.variants {
            for plan in &variant.effects {
                let samples = plan.samples();
                let wrong = samples.iter().find_map(|sample| resolve_all(std::slice::from_ref(sample)).err());
                if let Some(error) = wrong {
                    let key = format!("{VARIANT}.{EFFECTS}.{}", plan.effect);
                    problems.push(Problem::Contradiction {
                        at: self.at(plan.line),
                        key,
                        detail: error.detail(),
                    });
                }
            }
        }
    }
}

impl Variant {
    /// All that decides which effects it adds: what ids are made of. It does not depend on the order of effects and parameters.
    pub(crate) fn definition(&self) -> String {
        let mut effects: Vec<String> = self.effects.iter().map(EffectPlan::definition).collect();
        effects.sort();
        effects.join("\n")
    }
}

impl Variant {
    /// How many combinations its lists make.
    fn count(&self) -> u64 {
        let draws = self.effects.iter().flat_map(|effect| &effect.parameters);
        draws.fold(1, |count, (_, draw)| count.saturating_mul(draw.points()))
    }

    /// Whether a combination of its lists is one of another's too.
    fn shares_a_run_with(&self, other: &Self) -> bool {
        let definitions =
            |of: &Self| of.points().map(|places| of.at(&places).definition()).collect::<BTreeSet<_>>();
        !definitions(self).is_disjoint(&definitions(other))
    }

    /// Every combination of its lists: a place in each parameter's, in the order of the file.
    pub(crate) fn points(&self) -> impl Iterator<Item = Vec<u64>> {
        let sizes: Vec<u64> = self
            .effects
            .iter()
            .flat_map(|effect| &effect.parameters)
            .map(|(_, draw)| draw.points())
            .collect();
        (0..sizes.iter().product::<u64>()).map(move |combination| {
            let mut rest = combination;
            let place = |size: &u64| {
                let place = rest % size;
                rest /= size;
                place
            };
            sizes.iter().map(place).collect()
        })
    }

    /// The variant with one number for each list: its place in each parameter's, in the order of the file.
    pub(crate) fn at(&self, places: &[u64]) -> Self {
        let mut variant = self.clone();
        let draws =
            variant.effects.iter_mut().flat_map(|effect| &mut effect.parameters).map(|(_, draw)| draw);
        for (draw, place) in draws.zip(places) {
            if let Draw::Grid(values) = draw {
                *draw = Draw::Fixed(values[*place as usize]);
            }
        }
        variant
    }
}

impl EffectPlan {
    fn definition(&self) -> String {
        let mut parameters: Vec<String> =
            self.parameters.iter().map(|(key, draw)| format!("{key}={}", draw.definition())).collect();
        parameters.sort();
        format!("{}:{}", self.effect, parameters.join(","))
    }

    /// Entries with the least and the greatest of what may be drawn: if both are sound, so is what lies between.
    fn samples(&self) -> [EffectEntry; 2] {
        let spec = index_of(&self.effect).map(|index| LIBRARY[index]);
        [0, 1].map(|end| EffectEntry {
            name: self.effect.clone(),
            parameters: self
                .parameters
                .iter()
                .map(|(key, draw)| {
                    let typical = spec
                        .and_then(|spec| spec.parameters.iter().find(|parameter| parameter.key == *key))
                        .map_or(0.0, |parameter| parameter.prior.typical());
                    (key.clone(), draw.ends().map_or(typical, |ends| ends[end]), self.line)
                })
                .collect(),
            at: Location { file: PathBuf::from("plan"), line: self.line },
        })
    }
}

fn effects(reader: &mut Reader<'_, '_>, node: &Node) -> Vec<EffectPlan> {
    let Value::Table(entries) = &node.value else {
        reader.wrong_type(EFFECTS, node, "a table of effects by their names");
        return Vec::new();
    };
    let mut plans = Vec::new();
    for (effect, node) in entries {
        let path = format!("{EFFECTS}.{effect}");
        let Value::Table(entries) = &node.value else {
            reader.wrong_type(&path, node, "a table of parameters by their names");
            continue;
        };
        let mut parameters = Vec::new();
        for (key, node) in entries {
            if let Some(draw) = draw(reader, &format!("{path}.{key}"), node) {
                parameters.push((key.clone(), draw));
            }
        }
        plans.push(EffectPlan { effect: effect.clone(), parameters, line: node.line });
    }
    plans
}

fn draw(reader: &mut Reader<'_, '_>, key: &str, node: &Node) -> Option<Draw> {
    const EXPECTED: &str = "a number, a list of numbers, \"prior\", or one of { uniform = [0, 1] }, { log_uniform = [0.1, 1] }, { normal = [0, 1] }";
    match &node.value {
        Value::Number(_) => reader.number_in(key, node, Range::ANY).map(Draw::Fixed),
        Value::Text(text) if text == PRIOR => Some(Draw::Prior),
        Value::List(items) if !items.is_empty() => {
            let numbers: Vec<f64> =
                items.iter().filter_map(|item| reader.number_in(key, item, Range::ANY)).collect();
            once(reader, key, &numbers);
            (numbers.len() == items.len()).then_some(Draw::Grid(numbers))
        }
        Value::Table(entries) => {
            let [(name, node)] = entries.as_slice() else {
                reader.wrong_type(key, node, EXPECTED);
                return None;
            };
            let path = format!("{key}.{name}");
            let (first, second) = match name.as_str() {
                UNIFORM => (Range::ANY, Range::ANY),
                LOG_UNIFORM => (Range::above(0.0, f64::MAX), Range::above(0.0, f64::MAX)),
                NORMAL => (Range::ANY, Range::closed(0.0, f64::MAX)),
                _ => {
                    reader.wrong_type(key, node, EXPECTED);
                    return None;
                }
            };
            let Value::List(items) = &node.value else {
                reader.wrong_type(&path, node, "two numbers in a list");
                return None;
            };
            let [a, b] = items.as_slice() else {
                reader.wrong_type(&path, node, "two numbers in a list");
                return None;
            };
            let (a, b) = (reader.number_in(&path, a, first)?, reader.number_in(&path, b, second)?);
            if name == NORMAL {
                return Some(Draw::Normal { mean: a, sigma: b });
            }
            if a >= b {
                reader.contradiction(
                    EFFECTS,
                    format!("{path}: {a} is not below {b}, so there is nothing to draw from"),
                );
                return None;
            }
            Some(if name == UNIFORM { Draw::Uniform([a, b]) } else { Draw::LogUniform([a, b]) })
        }
        _ => {
            reader.wrong_type(key, node, EXPECTED);
            None
        }
    }
}

/// An optional whole number.
fn maybe_whole(reader: &mut Reader<'_, '_>, key: &str, low: u32, high: u32) -> Option<u64> {
    let mut number = None;
    reader.maybe(key, Range::closed(f64::from(low), f64::from(high)), &mut number);
    let number = number?;
    if number.fract() != 0.0 {
        reader.contradiction(key, format!("{number} is not a whole number"));
        return None;
    }
    Some(number as u64)
}

/// Nothing is listed twice.
fn once<T: PartialEq + std::fmt::Debug>(reader: &mut Reader<'_, '_>, key: &str, items: &[T]) {
    let twice = items.iter().enumerate().find(|(index, item)| items[..*index].contains(item));
    if let Some((_, item)) = twice {
        reader.contradiction(key, format!("{item:?} is listed twice"));
    }
}
