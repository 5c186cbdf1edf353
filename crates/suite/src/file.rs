//! The suite file: TOML to checked values, all problems at once.

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

use bench_rig::{
    Location, Phase, Problem, RigError,
    visit::{self, Node, Range, Reader, Value},
};

use crate::{
    FieldLimit, Limit, MEASURES, Mode, Side, Statistic,
    keys::{
        ASK, BASELINES, CASE, COMPARE, DESCRIPTION, EFFECTS, EQUALS, FIELD, FIRST_SEED, LIMIT, LIMITS, MAX,
        MIN, MISSION, MISSION_CRITERIA, MODE, NAME, PHASE, PORT, REPEATS, REPEATS_MAX, REQUIREMENTS, RIG,
        SEED_COUNT, SEED_MAX, SEEDS, SEEDS_MAX, SPREAD_MAX, STATISTIC, TAGS, TOLERANCES, UNIT,
    },
    limit::fields,
};

/// A suite of tests.
#[derive(Clone, Debug, PartialEq)]
pub struct Suite {
    /// The file, as it was named.
    pub file: PathBuf,
    /// What it is called.
    pub name: String,
    /// What it is for.
    pub description: String,
    /// Serial port of the board, for modes on hardware; the command line may name another.
    pub port: Option<String>,
    /// Folder of the baselines, as it stands in the file.
    pub baselines: Option<String>,
    /// What must be known of the station before anything is flown: keys of `--meta`.
    pub ask: Vec<String>,
    /// Its cases, in the order of the file.
    pub cases: Vec<Case>,
}

/// A case: a test for each combination of what it lists.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// Unique in the suite.
    pub name: String,
    /// What it is for; may be empty.
    pub description: String,
    /// Rigs as they are named, one at least.
    pub rigs: Vec<String>,
    /// Missions as they are named, one at least.
    pub missions: Vec<String>,
    /// One at least.
    pub modes: Vec<Mode>,
    /// One set of effects at least, each as `--effect` takes them; an empty set is the rig as it is.
    pub effects: Vec<Vec<String>>,
    /// One seed at least.
    pub seeds: Vec<u64>,
    /// How often each test is flown, from 1.
    pub repeats: u32,
    /// For `--tag`.
    pub tags: Vec<String>,
    /// Requirements that it shows to be met, in free text.
    pub requirements: Vec<String>,
    /// What becomes of the criteria of the mission.
    pub mission_criteria: MissionCriteria,
    /// Limits of its own.
    pub limits: Vec<Limit>,
    /// What its recordings are held against.
    pub compare: Compare,
    /// Tolerance file for comparisons, as it stands in the file.
    pub tolerances: Option<String>,
    /// Line of the case, and of each of its keys.
    lines: (usize, Vec<(String, usize)>),
}

/// What becomes of the criteria that stand in the mission.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MissionCriteria {
    /// They are limits of the case as well, unless it has the same limit itself.
    Count,
    /// They are left out.
    Ignore,
}

/// What recordings are held against.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Compare {
    /// The stored recording of the same test.
    pub baseline: bool,
    /// The same test in the other mode, or with the other effects.
    pub back_to_back: bool,
}

impl Suite {
    /// Reads a suite from text; `file` serves messages.
    pub fn read(file: &Path, text: &str) -> Result<Self, RigError> {
        let (suite, problems) = Self::read_as_far_as_possible(file, text)?;
        if problems.is_empty() { Ok(suite) } else { Err(RigError::Invalid(problems)) }
    }

    /// The same with what is right beside all that is wrong, for who has more to check before telling.
    pub fn read_as_far_as_possible(file: &Path, text: &str) -> Result<(Self, Vec<Problem>), RigError> {
        let root = visit::parse(file, text)?;
        let mut suite = Self {
            file: file.to_owned(),
            name: String::new(),
            description: String::new(),
            port: None,
            baselines: None,
            ask: Vec::new(),
            cases: Vec::new(),
        };
        let mut problems = Vec::new();
        Reader::read(file, "", &root, &mut problems, |reader| suite.fill(reader));
        Ok((suite, problems))
    }

    fn fill(&mut self, reader: &mut Reader<'_, '_>) {
        reader.text(NAME, &mut self.name);
        reader.text(DESCRIPTION, &mut self.description);
        self.port = maybe_text(reader, PORT);
        self.baselines = maybe_text(reader, BASELINES);
        self.ask = reader.texts(ASK);
        let expected = "at least one [[case]]";
        let Some(node) = reader.require(CASE, expected) else { return };
        let Value::List(list) = &node.value else {
            reader.wrong_type(CASE, node, "tables, each written as [[case]]");
            return;
        };
        let mut names = BTreeSet::new();
        for item in list {
            let mut case = Case::blank(item);
            reader.within(CASE, item, |reader| {
                case.fill(reader);
                if !case.name.is_empty() && !names.insert(case.name.clone()) {
                    reader.contradiction(
                        NAME,
                        format!(
                            "another case is called {:?}; results are told by names, so each needs its own",
                            case.name
                        ),
                    );
                }
            });
            self.cases.push(case);
        }
    }
}

impl Case {
    fn blank(node: &Node) -> Self {
        let keys = match &node.value {
            Value::Table(entries) => entries.iter().map(|(key, node)| (key.clone(), node.line)).collect(),
            _ => Vec::new(),
        };
        Self {
            name: String::new(),
            description: String::new(),
            rigs: Vec::new(),
            missions: Vec::new(),
            modes: vec![Mode::Sim],
            effects: vec![Vec::new()],
            seeds: vec![0],
            repeats: 1,
            tags: Vec::new(),
            requirements: Vec::new(),
            mission_criteria: MissionCriteria::Count,
            limits: Vec::new(),
            compare: Compare::default(),
            tolerances: None,
            lines: (node.line, keys),
        }
    }

    /// Says what does not fit about one of its keys, where the key stands.
    pub fn problem(&self, file: &Path, key: &str, detail: &str) -> Problem {
        let line = self.lines.1.iter().find(|(name, _)| name == key).map_or(self.lines.0, |(_, line)| *line);
        Problem::Contradiction {
            at: Location { file: file.to_owned(), line },
            key: format!("{CASE}.{key}"),
            detail: format!("{detail} (case {})", self.name),
        }
    }

    fn fill(&mut self, reader: &mut Reader<'_, '_>) {
        reader.text(NAME, &mut self.name);
        self.description = maybe_text(reader, DESCRIPTION).unwrap_or_default();
        let _ = reader.require(RIG, "a rig's name or file, or a list of them");
        self.rigs = reader.texts(RIG);
        let _ = reader.require(MISSION, "a mission's name or file, or a list of them");
        self.missions = reader.texts(MISSION);
        choices(reader, MODE, &Mode::CHOICES, &mut self.modes);
        self.read_effects(reader);
        self.read_seeds(reader);
        let mut repeats = f64::from(self.repeats);
        if reader.has(REPEATS) {
            whole(reader, REPEATS, 1.0, f64::from(REPEATS_MAX), &mut repeats);
        } else {
            let _ = reader.get(REPEATS);
        }
        self.repeats = repeats as u32;
        self.tags = reader.texts(TAGS);
        self.requirements = reader.texts(REQUIREMENTS);
        let criteria = [("count", MissionCriteria::Count), ("ignore", MissionCriteria::Ignore)];
        if reader.get(MISSION_CRITERIA).is_some() {
            reader.choice(MISSION_CRITERIA, &criteria, &mut self.mission_criteria);
        }
        self.read_compare(reader);
        self.tolerances = maybe_text(reader, TOLERANCES);
        if self.tolerances.is_some() && self.compare == Compare::default() {
            reader
                .contradiction(TOLERANCES, format!("nothing is compared; add `{COMPARE}`, or leave it out"));
        }
        if let Some(node) = reader.get(LIMITS) {
            reader.within(LIMITS, node, |reader| self.read_limits(reader));
        }
        self.read_field_limits(reader);
        self.check(reader);
    }

    fn read_effects(&mut self, reader: &mut Reader<'_, '_>) {
        if reader.get(EFFECTS).is_none() {
            return;
        }
        let sets = reader.texts(EFFECTS);
        let set = |text: &String| match text.as_str() {
            "none" => Vec::new(),
            text => text.split(" + ").map(|effect| effect.trim().to_owned()).collect(),
        };
        if !sets.is_empty() {
            self.effects = sets.iter().map(set).collect();
        }
    }

    fn read_seeds(&mut self, reader: &mut Reader<'_, '_>) {
        const EXPECTED: &str = "whole numbers in a list, or { first = 0, count = 100 }";
        let Some(node) = reader.get(SEEDS) else { return };
        match &node.value {
            Value::List(items) if !items.is_empty() => {
                let range = Range::closed(0.0, SEED_MAX);
                let numbers: Vec<f64> =
                    items.iter().filter_map(|item| reader.number_in(SEEDS, item, range)).collect();
                if numbers.iter().any(|number| number.fract() != 0.0) {
                    reader.contradiction(SEEDS, "seeds are whole numbers".to_owned());
                }
                self.seeds = numbers.iter().map(|number| *number as u64).collect();
                once(reader, SEEDS, &self.seeds);
            }
            Value::Table(_) => {
                let (mut first, mut count) = (0.0, 1.0);
                reader.within(SEEDS, node, |reader| {
                    whole(reader, FIRST_SEED, 0.0, SEED_MAX, &mut first);
                    whole(reader, SEED_COUNT, 1.0, SEEDS_MAX, &mut count);
                });
                self.seeds = (0..count as u64).map(|index| first as u64 + index).collect();
            }
            _ => reader.wrong_type(SEEDS, node, EXPECTED),
        }
    }

    fn read_compare(&mut self, reader: &mut Reader<'_, '_>) {
        let baseline = Compare { baseline: true, back_to_back: false };
        let back_to_back = Compare { baseline: false, back_to_back: true };
        let mut chosen = Vec::new();
        choices(reader, COMPARE, &[("baseline", baseline), ("back-to-back", back_to_back)], &mut chosen);
        self.compare = Compare {
            baseline: chosen.iter().any(|compare: &Compare| compare.baseline),
            back_to_back: chosen.iter().any(|compare| compare.back_to_back),
        };
        let two = (self.modes.len() == 2) || (self.modes.len() == 1 && self.effects.len() == 2);
        if self.compare.back_to_back && !two {
            reader.contradiction(
                COMPARE,
                format!(
                    "back-to-back compares two: list two in `{MODE}`, or one there and two in `{EFFECTS}`"
                ),
            );
        }
    }

    fn read_limits(&mut self, reader: &mut Reader<'_, '_>) {
        for measure in &MEASURES {
            for side in Side::ALL {
                let key = measure.key(side);
                let mut value = None;
                reader.maybe(&key, Range::closed(0.0, f64::MAX), &mut value);
                if let Some(limit) = value {
                    self.limits.push(Limit::Measure { name: measure.name, side, limit });
                }
            }
            let of = |wanted| {
                self.limits.iter().find_map(|limit| match limit {
                    Limit::Measure { name, side, limit } if *name == measure.name && *side == wanted => {
                        Some(*limit)
                    }
                    _ => None,
                })
            };
            if let (Some(least), Some(most)) = (of(Side::Least), of(Side::Most))
                && least > most
            {
                let key = measure.key(Side::Least);
                reader.contradiction(&key, format!("{least} is above {} = {most}", measure.key(Side::Most)));
            }
        }
    }

    fn read_field_limits(&mut self, reader: &mut Reader<'_, '_>) {
        let Some(node) = reader.get(LIMIT) else { return };
        let Value::List(items) = &node.value else {
            reader.wrong_type(LIMIT, node, "tables, each written as [[case.limit]]");
            return;
        };
        for item in items {
            reader.within(LIMIT, item, |reader| {
                if let Some(limit) = field_limit(reader) {
                    self.limits.push(Limit::Field(limit));
                }
            });
        }
    }

    /// What does not fit together.
    fn check(&self, reader: &mut Reader<'_, '_>) {
        once(reader, RIG, &self.rigs);
        once(reader, MISSION, &self.missions);
        once(reader, MODE, &self.modes);
        once(reader, EFFECTS, &self.effects);
        let has_spread = self.limits.iter().any(|limit| match limit {
            Limit::Measure { side, .. } => *side == Side::Spread,
            Limit::Field(limit) => limit.sides.iter().any(|(side, _)| *side == Side::Spread),
        });
        if has_spread && self.repeats < 2 {
            let key = if reader.has(LIMITS) { LIMITS } else { LIMIT };
            reader.contradiction(
                key,
                format!("a spread is that of repeats, and there is one; give `{REPEATS}` = 2 or more"),
            );
        }
        if self.limits.is_empty()
            && self.mission_criteria == MissionCriteria::Ignore
            && self.compare == Compare::default()
        {
            reader.contradiction(
                MISSION_CRITERIA,
                format!(
                    "nothing is left that could fail; give `[case.{LIMITS}]`, `[[case.{LIMIT}]]` or `{COMPARE}`"
                ),
            );
        }
    }
}

/// An optional text.
fn maybe_text(reader: &mut Reader<'_, '_>, key: &str) -> Option<String> {
    reader.get(key)?;
    let mut text = String::new();
    reader.text(key, &mut text);
    Some(text).filter(|text| !text.is_empty())
}

/// One of the named choices or a list of them; absent, the value stays what it is.
fn choices<T: Copy>(reader: &mut Reader<'_, '_>, key: &str, choices: &[(&str, T)], value: &mut Vec<T>) {
    if reader.get(key).is_none() {
        return;
    }
    let names: Vec<_> = choices.iter().map(|(name, _)| format!("{name:?}")).collect();
    let mut chosen = Vec::new();
    for text in reader.texts(key) {
        match choices.iter().find(|(name, _)| *name == text) {
            Some((_, choice)) => chosen.push(*choice),
            None => reader.contradiction(key, format!("{text:?} is none of {}", names.join(", "))),
        }
    }
    if !chosen.is_empty() {
        *value = chosen;
    }
}

/// A whole number.
fn whole(reader: &mut Reader<'_, '_>, key: &str, low: f64, high: f64, value: &mut f64) {
    let mut number = f64::NAN;
    reader.number(key, Range::closed(low, high), &mut number);
    if number.fract() == 0.0 {
        *value = number;
    } else if !number.is_nan() {
        reader.contradiction(key, format!("{number} is not a whole number"));
    }
}

/// Nothing is listed twice.
fn once<T: PartialEq + std::fmt::Debug>(reader: &mut Reader<'_, '_>, key: &str, items: &[T]) {
    let twice = items.iter().enumerate().find(|(index, item)| items[..*index].contains(item));
    if let Some((_, item)) = twice {
        reader.contradiction(key, format!("{item:?} is listed twice"));
    }
}

fn field_limit(reader: &mut Reader<'_, '_>) -> Option<FieldLimit> {
    let mut path = String::new();
    reader.text(FIELD, &mut path);
    let mut statistic = None;
    let statistics = Statistic::CHOICES.map(|(name, statistic)| (name, Some(statistic)));
    reader.choice(STATISTIC, &statistics, &mut statistic);
    let mut phase = None;
    if reader.get(PHASE).is_some() {
        let choices = Phase::ALL.map(|phase| (phase.name(), Some(phase)));
        reader.choice(PHASE, &choices, &mut phase);
    }
    let equals = maybe_text(reader, EQUALS);
    let unit = maybe_text(reader, UNIT);
    let mut sides = Vec::new();
    for (key, side) in [(MIN, Side::Least), (MAX, Side::Most), (SPREAD_MAX, Side::Spread)] {
        let mut value = None;
        reader.maybe(key, Range::ANY, &mut value);
        sides.extend(value.map(|value| (side, value)));
    }
    if !reader.has(MIN) && !reader.has(MAX) && !reader.has(SPREAD_MAX) {
        reader.contradiction(FIELD, format!("no limit is given; add `{MIN}`, `{MAX}` or `{SPREAD_MAX}`"));
    }
    if let [(Side::Least, least), (Side::Most, most), ..] = sides.as_slice()
        && least > most
    {
        reader.contradiction(MIN, format!("{least} is above `{MAX}` = {most}"));
    }
    if path.is_empty() {
        return None;
    }
    let Some((_, channel, index, field)) = fields().find(|(known, ..)| *known == path) else {
        reader.contradiction(FIELD, format!("no field is called {path:?}; {}", nearest(&path)));
        return None;
    };
    let statistic = statistic?;
    if !statistic.suits(field.kind) {
        let kind = match field.kind {
            bench_recording::Kind::Text => "names: take `count`, or `share` with `equals`",
            bench_recording::Kind::Bool => "yes or no: take `count`, or `share` with `equals = \"true\"`",
            _ => "numbers, of which no value has a share: take another statistic",
        };
        reader.contradiction(STATISTIC, format!("{path} holds {kind}"));
    }
    if (statistic == Statistic::Share) != equals.is_some() {
        let detail = if equals.is_some() {
            "is for the statistic `share` alone"
        } else {
            "`share` is that of the samples with this value, so it needs one"
        };
        reader.contradiction(EQUALS, detail.to_owned());
    }
    check_unit(reader, &path, statistic, field.unit, unit.as_deref());
    Some(FieldLimit { path, channel, index, statistic, phase, equals, sides, unit: unit.unwrap_or_default() })
}

/// Units that the sticks may be in, as rigs say it.
pub(crate) const STICK_UNITS: [&str; 3] = ["V", "fraction", "count"];

/// A limit says its unit, so that nobody takes it for another.
fn check_unit(
    reader: &mut Reader<'_, '_>,
    path: &str,
    statistic: Statistic,
    of_field: &str,
    given: Option<&str>,
) {
    let wanted = if statistic.has_unit() { of_field } else { "" };
    let problem = match (wanted, given) {
        ("" | "1", None | Some("1")) => None,
        ("" | "1", Some(given)) => Some(format!(
            "the {} of {path} has no unit, and {given:?} is given; leave it out",
            statistic.name()
        )),
        (bench_recording::Field::ACTUATION, Some(given)) if STICK_UNITS.contains(&given) => None,
        (bench_recording::Field::ACTUATION, _) => Some(format!(
            "{path} is in the unit of the rig's sticks; say which: {}",
            STICK_UNITS.map(|unit| format!("{unit:?}")).join(", ")
        )),
        (wanted, Some(given)) if wanted == given => None,
        (wanted, Some(given)) => Some(format!("{path} is in {wanted}, not in {given}")),
        (wanted, None) => Some(format!("{path} is in {wanted}; say so by `{UNIT} = {wanted:?}`")),
    };
    if let Some(problem) = problem {
        reader.contradiction(UNIT, problem);
    }
}

/// What may have been meant by a field that there is not.
fn nearest(path: &str) -> String {
    let all: Vec<_> = fields().collect();
    let last = path.rsplit('/').next().unwrap_or(path);
    let same_name: Vec<&str> =
        all.iter().filter(|(_, _, _, field)| field.name == last).map(|(path, ..)| path.as_str()).collect();
    if !same_name.is_empty() {
        return format!("is {} meant?", same_name.join(" or "));
    }
    let same_channel: Vec<&str> = all
        .iter()
        .filter(|(_, channel, ..)| path.starts_with(channel.topic()))
        .map(|(path, ..)| path.as_str())
        .collect();
    if same_channel.is_empty() {
        "`bench info --json` lists the channels of a recording, docs/recording.md their fields".to_owned()
    } else {
        format!("there is {}", same_channel.join(", "))
    }
}
