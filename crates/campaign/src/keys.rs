//! The keys of a sweep's plan as a list, for the page of documentation and the JSON Schema.

use bench_rig::{
    keys::{Form, Key, Kind},
    visit::Range,
};

pub(crate) const NAME: &str = "name";
pub(crate) const DESCRIPTION: &str = "description";
pub(crate) const KIND: &str = "kind";
pub(crate) const RIGS: &str = "rigs";
pub(crate) const MISSIONS: &str = "missions";
pub(crate) const RECORDINGS: &str = "recordings";
pub(crate) const SEEDS: &str = "seeds";
pub(crate) const FIRST: &str = "first";
pub(crate) const COUNT: &str = "count";
pub(crate) const SETS: &str = "sets";
pub(crate) const AIRFRAMES: &str = "airframes";
pub(crate) const DIAGNOSIS: &str = "diagnosis";
pub(crate) const RUNS_PER_PART: &str = "runs_per_part";
pub(crate) const VARIANT: &str = "variant";
pub(crate) const EFFECTS: &str = "effects";
pub(crate) const UNIFORM: &str = "uniform";
pub(crate) const LOG_UNIFORM: &str = "log_uniform";
pub(crate) const NORMAL: &str = "normal";
pub(crate) const PRIOR: &str = "prior";

/// The largest seed.
pub(crate) const SEED_MAX: u32 = u32::MAX;
/// No plan has more seeds, so that a million runs fit with room.
pub(crate) const SEEDS_MAX: u32 = 10_000_000;
/// Case mixes are drawn as a whole, so that each effect comes as often as any other.
pub(crate) const SETS_MAX: u32 = 100_000;
/// A part is held in memory before it is written.
pub(crate) const RUNS_PER_PART_MAX: u32 = 100_000;

/// A text, or several.
fn texts() -> Kind {
    Kind::AnyOf(vec![Kind::Text, Kind::List(Box::new(Kind::Text), 1, None)])
}

fn choice(names: &[&str]) -> Kind {
    Kind::Choice(names.iter().map(|name| (*name).to_owned()).collect())
}

/// Every key of a plan: a form for each kind.
pub fn sweep_keys() -> Vec<Form> {
    let form = |kind: &str, keys: Vec<Key>| Form {
        when: Some((KIND.to_owned(), kind.to_owned())),
        keys: [head(), keys].concat(),
    };
    vec![form("flights", flights()), form("recordings", recordings()), form("mix", mix())]
}

fn head() -> Vec<Key> {
    vec![
        Key::required(NAME, "Name of the sweep.", Kind::Text),
        Key::required(DESCRIPTION, "What the sweep is for, in a sentence.", Kind::Text),
        Key::optional(
            KIND,
            "What its runs are: simulated flights; diagnoses of recordings; or diagnoses of simulated sets of flights whose causes come in the case mix of the calibration.",
            choice(&["flights", "recordings", "mix"]),
        )
        .or_text("flights"),
        Key::optional(
            RUNS_PER_PART,
            "Runs whose results are written as one file, whole or not at all: what a kill loses at most. Absent, it is 1,000 flights or 50 diagnoses.",
            Kind::Integer(1, RUNS_PER_PART_MAX),
        ),
    ]
}

fn rigs() -> Key {
    Key::required(RIGS, "Rigs: files, or names of built-in ones.", texts())
}

fn missions(meaning: &str) -> Key {
    Key::required(MISSIONS, meaning, texts())
}

fn flights() -> Vec<Key> {
    let seed = Kind::Integer(0, SEED_MAX);
    let range = Form::only(vec![
        Key::required(FIRST, "The first seed.", seed.clone()),
        Key::required(COUNT, "How many, one after another.", Kind::Integer(1, SEEDS_MAX)),
    ]);
    vec![
        rigs(),
        missions("Missions, each a flight: files, or names of those beside the rig or of built-in ones."),
        Key::optional(
            SEEDS,
            "Seeds of everything random: a list, or a table with the first and how many; absent, it is the seed 0.",
            Kind::AnyOf(vec![Kind::List(Box::new(seed), 1, None), Kind::Table(range)]),
        ),
        Key::optional(
            AIRFRAMES,
            "What flies: the rig's nominal numbers, or numbers drawn from its tolerances with the run's seed, while the controller goes by the nominal ones.",
            choice(&["nominal", "drawn"]),
        )
        .or_text("nominal"),
        Key::optional(DIAGNOSIS, "Whether each flight is diagnosed too.", choice(&["none", "each"])).or_text("none"),
        Key::optional(
            VARIANT,
            "Effects that are added to the rig: each variant is flown on each rig, with each mission and seed. Absent, rigs fly as they are.",
            Kind::Tables(variant(), 1),
        ),
    ]
}

fn variant() -> Vec<Form> {
    let pair = |range: Range| Kind::Pair(Box::new(Kind::Number(range)), Box::new(Kind::Number(range)));
    let distributions = Form::any([
        vec![Key::required(UNIFORM, "Drawn evenly from the first to the second number.", pair(Range::ANY))],
        vec![Key::required(
            LOG_UNIFORM,
            "Drawn evenly in the logarithm from the first to the second number.",
            pair(Range::above(0.0, f64::MAX)),
        )],
        vec![Key::required(
            NORMAL,
            "Drawn from the normal distribution with this mean and this standard deviation.",
            Kind::Pair(
                Box::new(Kind::Number(Range::ANY)),
                Box::new(Kind::Number(Range::closed(0.0, f64::MAX))),
            ),
        )],
    ]);
    let parameter = Kind::AnyOf(vec![
        Kind::Number(Range::ANY),
        Kind::List(Box::new(Kind::Number(Range::ANY)), 1, None),
        choice(&[PRIOR]),
        Kind::Table(distributions),
    ]);
    Form::only(vec![
        Key::required(NAME, "Name of the variant, unique in the plan.", Kind::Text),
        Key::optional(
            EFFECTS,
            "By the effect's name, and in it by the parameter's (`bench effects` lists them): a number; a list, whose numbers make a variant each; \"prior\", drawn from what the library expects; or a distribution to draw from. What is drawn stays within the parameter's range and depends on effect, parameter and seed alone. Absent, the rig flies as it is.",
            Kind::Names(Box::new(Kind::Names(Box::new(parameter)))),
        ),
    ])
}

fn recordings() -> Vec<Key> {
    vec![
        Key::required(
            RECORDINGS,
            "Recordings, each diagnosed alone: files, or folders whose files ending in .mcap are meant, from the plan's own folder.",
            texts(),
        ),
        Key::optional(
            RIGS,
            "Rigs that each recording is held against: files, or names of built-in ones. Absent, it is the rig that a recording carries.",
            texts(),
        ),
    ]
}

fn mix() -> Vec<Key> {
    vec![
        rigs(),
        missions(
            "Missions that are flown in turn and diagnosed together, in each set: files, names or folders of built-in ones.",
        ),
        Key::required(SETS, "Sets of flights for each rig.", Kind::Integer(1, SETS_MAX)),
    ]
}
