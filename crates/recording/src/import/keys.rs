//! The keys of a mapping file as a list, from the same tables, units and ranges that its reader goes by.

use bench_rig::{
    Actuation, Phase,
    keys::{Form, Key, Kind},
    visit::Range,
};

use super::{
    map::ImportMap,
    number::TimeUnit,
    read::{DELIMITERS, EMPTY, FRAMES, GRAVITY, KEEP, LATENCY, LOGS, PERIOD},
    target::{Dimension, TABLES, Table, Target},
};
use crate::Channel;

impl ImportMap {
    /// Every key of a mapping file.
    pub fn keys() -> Vec<Form> {
        let shared = [
            Key::required("name", "Name of the map, kept with what was imported.", Kind::Text),
            Key::optional(
                "rig",
                "Rig that is attached when no other is named, seen from the map's folder.",
                Kind::File,
            ),
            Key::optional("actuation", "Unit of the sticks.", choice(&Actuation::CHOICES))
                .beside(&["command", "readback"]),
        ];
        let of_tables = vec![
            Key::optional("delimiter", "What stands between the cells.", choice(&DELIMITERS)).or_text(","),
            Key::optional(
                "header",
                "Whether the first line names the columns, as is taken without this key. Else they are called \"1\", \"2\" and so on.",
                Kind::Flag,
            ),
            table("time", "The time of a row of a table.", vec![column("column"), time_unit()]),
            Key::optional(
                "filter",
                "Rows to keep: all filters must agree, and one has at_least, below or both.",
                Kind::Tables(
                    Form::only(vec![
                        column("column"),
                        number("at_least", "Keep rows with this or more."),
                        number("below", "Keep rows with less than this."),
                    ]),
                    0,
                ),
            ),
            optional(table(
                "tick",
                "How late each row was.",
                vec![Key::required("period_s", "The loop's period, or \"rig\".", setting(PERIOD))],
            )),
        ];
        let of_topics = vec![Key::required(
            "log",
            "The kind of log of topics that the map is for, instead of a table: columns are called TOPIC.FIELD, and samples have \
             their own times.",
            choice(&LOGS),
        )];
        Form::any([of_tables, of_topics].map(|of| {
            let channels = TABLES.iter().map(channel);
            shared.iter().cloned().chain(of).chain(channels).collect()
        }))
    }
}

fn channel(of: &Table) -> Key {
    // What a channel needs besides its quantities, in each of the ways in which it may be given.
    let ways: Vec<Vec<Key>> = match of.channel {
        Channel::Position => vec![
            vec![
                Key::required(
                    "latency_s",
                    "How old a position is in the row that holds it, or \"rig\".",
                    setting(LATENCY),
                ),
                Key::optional(
                    "newest_of_frames_s",
                    "Rows hold the newest frame at hand, of frames that come so often, or \"rig\".",
                    setting(PERIOD),
                ),
            ],
            vec![table(
                "exposed_at",
                "When a position was exposed, by a column, in place of latency_s and newest_of_frames_s.",
                vec![column("column"), time_unit()],
            )],
        ],
        Channel::ControlState => {
            vec![vec![Key::required("phase", "The phase: one of the bench's, or by a column.", phase())]]
        }
        _ => vec![Vec::new()],
    };
    let frame = of.has_frame().then(|| {
        Key::optional(
            "frame",
            "The directions of x, y, z: ned has y, z, pitch and yaw turned into the bench's signs.",
            choice(&FRAMES),
        )
        .or_text("nwu")
    });
    let forms = ways.into_iter().map(|mut keys| {
        keys.extend(frame.clone());
        keys.extend(of.targets.iter().map(quantity));
        keys.extend([
            Key::optional(
                "keep",
                "Whether a message that says what the last one said is kept.",
                choice(&KEEP),
            )
            .or_text("all"),
            Key::optional(
                "every_s",
                "At most one message in each stretch of this length.",
                Kind::Number(PERIOD),
            ),
            Key::optional(
                "empty",
                "Whether an empty cell or NaN makes a row bad or a message absent.",
                choice(&EMPTY),
            )
            .or_text("bad"),
        ]);
        keys
    });
    let meaning = format!("What becomes of a row in the channel {}.", of.channel.topic());
    optional(Key::required(of.name, &meaning, Kind::Table(Form::any(forms))))
}

/// A constant, or one column or several with their unit.
fn quantity(target: &Target) -> Key {
    let unit = target.dimension.unit(Actuation::default());
    let (unit, sticks) = match target.dimension {
        Dimension::Stick => ("the map's actuation unit", true),
        _ => (unit, false),
    };
    let mut units: Vec<String> = Vec::new();
    for (_, actuation) in Actuation::CHOICES {
        let of_actuation = target.dimension.units(actuation).iter().map(|(name, _)| (*name).to_owned());
        let new: Vec<_> = of_actuation.filter(|name| !units.contains(name)).collect();
        units.extend(new);
    }
    let meaning = if sticks {
        "The unit that the columns are in; one of the actuation's."
    } else {
        "The unit that the columns are in."
    };
    let optional_keys = vec![
        number("scale", "The mean of the columns is multiplied by this.").or_number(1.0),
        number("offset", "Added after that, in the column's unit.").or_number(0.0),
        Key::optional(
            "valid",
            "The columns' own numbers, lowest and highest; a row with any outside is bad.",
            Kind::List(Box::new(Kind::Number(Range::ANY)), 2, Some(2)),
        ),
        may_lack(),
    ];
    let mut shared = vec![Key::required("unit", meaning, Kind::Choice(units))];
    shared.extend(optional_keys.iter().cloned());
    if sticks {
        shared.push(Key::optional(
            "square",
            "Of sticks alone: whether the numbers are squared before their mean is taken, as rotor speeds are.",
            Kind::Flag,
        ));
    }
    if target.dimension == Dimension::Acceleration {
        shared.push(Key::required(
            "gravity",
            "Of vertical_acceleration alone: whether gravity is in it, 1 g at rest and taken \
             off, or 0 at rest.",
            choice(&GRAVITY),
        ));
    }
    let several = Key::required(
        "columns",
        "Several columns, whose mean is taken, instead of `column`.",
        Kind::List(Box::new(Kind::Text), 1, None),
    );
    let with = |first: Key, rest: &[Key]| {
        let mut keys = vec![first];
        keys.extend(rest.iter().cloned());
        keys
    };
    let mut forms = vec![with(column("column"), &shared), with(several, &shared)];
    if target.dimension == Dimension::Angle {
        let quaternion = Key::required(
            "quaternion",
            "Of angles alone: four columns of a quaternion, real part first, whose angle is taken, in rad.",
            Kind::List(Box::new(Kind::Text), 4, Some(4)),
        );
        forms.push(with(quaternion, &optional_keys));
    }
    let kind = Kind::AnyOf(vec![Kind::Number(Range::ANY), Kind::Table(Form::any(forms))]);
    let meaning = format!("A constant in {unit}, or by columns.");
    let key = Key::required(target.key, &meaning, kind);
    if target.required { key } else { optional(key) }
}

fn phase() -> Kind {
    let phases = || Kind::Choice(Phase::ALL.map(|phase| phase.name().to_owned()).to_vec());
    let names = Key::required(
        "names",
        "The column's words, and which phase each is.",
        Kind::Names(Box::new(phases())),
    );
    let from = Key::required(
        "from",
        "Points [number, phase] whose numbers rise; the column reaches the highest of them.",
        Kind::List(Box::new(Kind::Pair(Box::new(Kind::Number(Range::ANY)), Box::new(phases()))), 1, None),
    );
    let forms = Form::any([names, from].map(|how| vec![column("column"), how, may_lack()]));
    Kind::AnyOf(vec![phases(), Kind::Table(forms)])
}

fn time_unit() -> Key {
    let meaning = "The unit that the column is in, or that it has dates and times as text.";
    Key::required("unit", meaning, choice(&TimeUnit::CHOICES))
}

fn may_lack() -> Key {
    Key::optional(
        "optional",
        "Whether the log may lack the columns, or have empty cells there: then nothing is recorded of them.",
        Kind::Flag,
    )
}

/// A number of seconds, or `"rig"`.
fn setting(range: Range) -> Kind {
    Kind::AnyOf(vec![Kind::Number(range), Kind::Choice(vec!["rig".to_owned()])])
}

fn table(name: &str, meaning: &str, keys: Vec<Key>) -> Key {
    Key::required(name, meaning, Kind::Table(Form::only(keys)))
}

fn optional(key: Key) -> Key {
    Key { presence: bench_rig::keys::Presence::Optional, ..key }
}

fn column(key: &str) -> Key {
    Key::required(key, "Name of a column of the log.", Kind::Text)
}

fn number(key: &str, meaning: &str) -> Key {
    Key::optional(key, meaning, Kind::Number(Range::ANY))
}

fn choice<T>(choices: &[(&str, T)]) -> Kind {
    Kind::Choice(choices.iter().map(|(name, _)| (*name).to_owned()).collect())
}
