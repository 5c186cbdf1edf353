//! The keys of a suite file as a list, for the page of documentation and the JSON Schema.

use bench_rig::{
    Phase,
    keys::{Form, Key, Kind},
    visit::Range,
};

use crate::{MEASURES, Mode, Side, Statistic};

pub(crate) const NAME: &str = "name";
pub(crate) const DESCRIPTION: &str = "description";
pub(crate) const PORT: &str = "port";
pub(crate) const BASELINES: &str = "baselines";
pub(crate) const ASK: &str = "ask";
pub(crate) const CASE: &str = "case";
pub(crate) const RIG: &str = "rig";
pub(crate) const MISSION: &str = "mission";
pub(crate) const MODE: &str = "mode";
pub(crate) const EFFECTS: &str = "effects";
pub(crate) const SEEDS: &str = "seeds";
pub(crate) const FIRST_SEED: &str = "first";
pub(crate) const SEED_COUNT: &str = "count";
pub(crate) const REPEATS: &str = "repeats";
pub(crate) const TAGS: &str = "tags";
pub(crate) const REQUIREMENTS: &str = "requirements";
pub(crate) const MISSION_CRITERIA: &str = "mission_criteria";
pub(crate) const COMPARE: &str = "compare";
pub(crate) const TOLERANCES: &str = "tolerances";
pub(crate) const LIMITS: &str = "limits";
pub(crate) const LIMIT: &str = "limit";
pub(crate) const FIELD: &str = "field";
pub(crate) const STATISTIC: &str = "statistic";
pub(crate) const PHASE: &str = "phase";
pub(crate) const EQUALS: &str = "equals";
pub(crate) const UNIT: &str = "unit";
pub(crate) const MIN: &str = "min";
pub(crate) const MAX: &str = "max";
pub(crate) const SPREAD_MAX: &str = "spread_max";

/// The largest seed of a first repeat.
pub(crate) const SEED_MAX: f64 = u32::MAX as f64;
/// No case has more seeds.
pub(crate) const SEEDS_MAX: f64 = 10_000.0;
/// No test is repeated more often.
pub(crate) const REPEATS_MAX: u32 = 1000;

/// A text, or several.
fn texts() -> Kind {
    Kind::AnyOf(vec![Kind::Text, Kind::List(Box::new(Kind::Text), 1, None)])
}

/// One of several names, or a list of them.
fn choices(names: &[&str]) -> Kind {
    let choice = Kind::Choice(names.iter().map(|name| (*name).to_owned()).collect());
    Kind::AnyOf(vec![choice.clone(), Kind::List(Box::new(choice), 1, None)])
}

/// Every key of a suite file.
pub fn suite_keys() -> Vec<Form> {
    let meaning = "The cases. What a case lists several of makes a test for each combination.";
    Form::only(vec![
        Key::required(NAME, "Name of the suite.", Kind::Text),
        Key::required(DESCRIPTION, "What the suite is for, in a sentence.", Kind::Text),
        Key::optional(
            PORT,
            "Serial port of the board, for the modes loopback and transmitter; `--port` names another.",
            Kind::Text,
        ),
        Key::optional(
            BASELINES,
            "Folder of the baselines, from the suite's own; absent, it is beside the suite and called as it with `.baselines`.",
            Kind::File,
        ),
        Key::optional(
            ASK,
            "What must be known before anything is flown, such as \"operator\": it is given by `--meta` or asked for on a terminal.",
            texts(),
        ),
        Key::required(CASE, meaning, Kind::Tables(case_forms(), 1)),
    ])
}

fn case_forms() -> Vec<Form> {
    let modes = Mode::CHOICES.map(|(name, _)| name);
    let seed = Kind::Integer(0, u32::MAX);
    let range = Form::only(vec![
        Key::required(FIRST_SEED, "The first seed.", seed.clone()),
        Key::required(SEED_COUNT, "How many, one after another.", Kind::Integer(1, SEEDS_MAX as u32)),
    ]);
    Form::only(vec![
        Key::required(NAME, "Name of the case, unique in the suite.", Kind::Text),
        Key::optional(DESCRIPTION, "What the case is for, in a sentence.", Kind::Text),
        Key::required(RIG, "Rig: a file, or the name of a built-in one.", texts()),
        Key::required(MISSION, "Mission: a file, or the name of one beside the rig or of a built-in one.", texts()),
        Key::optional(MODE, "How it is flown.", choices(&modes)).or_text("sim"),
        Key::optional(
            EFFECTS,
            "Effects added to the rig, as `--effect` takes them, with ` + ` between those that are flown together; \"none\" is the rig as it is.",
            texts(),
        )
        .or_text("none"),
        Key::optional(
            SEEDS,
            "Seeds of everything random: a list, or a table with the first and how many; absent, it is the seed 0.",
            Kind::AnyOf(vec![Kind::List(Box::new(seed), 1, None), Kind::Table(range)]),
        ),
        Key::optional(
            REPEATS,
            "How often each test is flown. A test of which some repeats pass and some fail is flaky, which is no pass.",
            Kind::Integer(1, REPEATS_MAX),
        )
        .or_number(1.0),
        Key::optional(TAGS, "Words to choose tests by, with `--tag`.", texts()),
        Key::optional(REQUIREMENTS, "Requirements that the case shows to be met, told in every report.", texts()),
        Key::optional(
            MISSION_CRITERIA,
            "Whether the criteria that stand in the mission are limits as well; a limit of the case wins over the same one there.",
            Kind::Choice(vec!["count".to_owned(), "ignore".to_owned()]),
        )
        .or_text("count"),
        Key::optional(
            COMPARE,
            "What recordings are held against: the stored baseline of the test, or the same test in the other mode or with the other effects. Back-to-back with two rigs and two modes, the first rig belongs to the first mode.",
            choices(&["baseline", "back-to-back"]),
        ),
        Key::optional(
            TOLERANCES,
            "Tolerance file for comparisons, from the suite's folder; it wins over tolerances that are derived.",
            Kind::File,
        ),
        Key::optional(LIMITS, "Limits on figures of each flight.", Kind::Table(limits_forms())),
        Key::optional(LIMIT, "Limits on any field of the recording.", Kind::Tables(limit_forms(), 1)),
    ])
}

fn limits_forms() -> Vec<Form> {
    let meaning = |what: &str, side: Side| match side {
        Side::Least => format!("{}, at least.", bench_page::capitalised(what)),
        Side::Most => format!("{}, at most.", bench_page::capitalised(what)),
        Side::Spread => format!("Greatest less least of the repeats, at most: {what}."),
    };
    let number = || Kind::Number(Range::closed(0.0, f64::MAX));
    let keys = MEASURES.iter().flat_map(|measure| {
        Side::ALL.map(|side| Key::optional(&measure.key(side), &meaning(measure.meaning, side), number()))
    });
    Form::only(keys.collect())
}

fn limit_forms() -> Vec<Form> {
    let number = || Kind::Number(Range::ANY);
    let statistics = Statistic::CHOICES.map(|(name, _)| name.to_owned()).to_vec();
    Form::only(vec![
        Key::required(
            FIELD,
            "Topic and field of the recording, such as /tracker/position/position_m.z.",
            Kind::Text,
        ),
        Key::required(STATISTIC, "What is made of the field's samples.", Kind::Choice(statistics)),
        Key::optional(
            PHASE,
            "Only samples of this phase; absent, all samples count.",
            Kind::Choice(Phase::ALL.map(|phase| phase.name().to_owned()).to_vec()),
        ),
        Key::optional(
            EQUALS,
            "With `share` alone: the value whose share of the samples is meant.",
            Kind::Text,
        ),
        Key::optional(
            UNIT,
            "Unit of the limits, which must be the field's; absent, the field or the statistic has none.",
            Kind::Text,
        ),
        Key::optional(MIN, "The least that it may be.", number()),
        Key::optional(MAX, "The most that it may be.", number()),
        Key::optional(SPREAD_MAX, "The most that repeats may differ by.", number()),
    ])
}
