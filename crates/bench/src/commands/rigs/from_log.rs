use std::{
    fmt::Write as _,
    path::{Path, PathBuf},
};

use anyhow::{Context, bail};
use bench_identification::{Draft, Known, Source};
use bench_recording::Flight;
use bench_rig::{Actuation, Rig};
use clap::Args;
use serde_json::json;

use crate::{
    arguments::{Force, Json},
    exit::Exit,
    files::{self, Form, Outputs},
    logs::Flown,
    words,
};

/// Draft a rig from logs of an aircraft of which nothing else is known
#[derive(Args)]
#[command(after_help = "Examples:
  bench rig from-log log.ulg -o my-draft.toml
  bench rig from-log nominal-*.ulg --mass-kg 0.8 -o my-draft.toml --force
  bench rig from-log log-*.mcap -o my-draft.toml --force --json

A draft has wide tolerances, and a comment at each number says what it was drawn from: the flights,
a parameter of the log, or nothing, which makes it a guess. `bench identify flight` narrows it by
nominal flights. docs/your-own-logs.md goes the whole way.")]
pub struct Arguments {
    /// Logs as `bench import` reads them, or recordings: nominal flights of one aircraft, the more the better
    #[arg(required = true)]
    logs: Vec<PathBuf>,
    /// Map by which logs are read, where `bench import` needs one; a file, or the name of a built-in one
    #[arg(long, value_name = "MAP")]
    map: Option<PathBuf>,
    /// Mass of the aircraft as it flew, kg. Without it that of the log's parameters is taken, else a place-holder
    #[arg(long, value_name = "KG", value_parser = mass)]
    mass_kg: Option<f64>,
    /// Rig to write, the airframe in it
    #[arg(short, long, default_value = "draft.toml")]
    output: PathBuf,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    json: Json,
}

fn mass(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(kg) if kg > 0.0 && kg <= 1000.0 => Ok(kg),
        _ => Err("a number of kilograms above 0 is expected, to 1000".to_owned()),
    }
}

/// Parameters that hold the mass, kg: PX4's vehicle model, and its simulation in hardware.
const MASS: [&str; 2] = ["VM_MASS", "SIH_MASS"];

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    let draft = written(arguments)?;
    if arguments.json.json {
        words::print_json(&as_json(&draft, arguments))?;
    } else {
        let count = words::count(arguments.logs.len() as u64, "flight");
        words::print(&in_words(&draft, &arguments.output, &count))?;
    }
    Ok(Exit::Done)
}

/// The draft as a program reads it.
pub fn as_json(draft: &Draft, arguments: &Arguments) -> serde_json::Value {
    let numbers: Vec<_> = draft
        .numbers()
        .into_iter()
        .map(|(note, value)| json!({ "key": note.key, "value": value, "from": note.from, "words": note.words }))
        .collect();
    json!({
        "schema": "bench.rig-draft/1",
        "rig": arguments.output.display().to_string(),
        "flights": arguments.logs.len(),
        "numbers": numbers,
    })
}

/// Drafts the rig and writes it.
pub fn written(arguments: &Arguments) -> anyhow::Result<Draft> {
    Outputs::new(arguments.force.force)
        .and(arguments.output.as_path(), Form::Toml)
        .from(arguments.logs.iter().map(PathBuf::as_path).chain(arguments.map.as_deref()))
        .check()?;
    let flown = arguments
        .logs
        .iter()
        .map(|log| Flown::read(log, arguments.map.as_deref()))
        .collect::<anyhow::Result<Vec<Flown>>>()?;
    let draft = drafted(flown, &arguments.output, arguments.mass_kg)?;
    let count = words::count(arguments.logs.len() as u64, "flight");
    let name = &draft.rig.name;
    let head = format!(
        "{name}: drafted by `bench rig from-log` from {count}. Tolerances are wide, and what is marked as a guess is one;\n\
         `bench identify flight` narrows them by nominal flights."
    );
    let text = draft.to_toml(&head);
    Rig::read(&arguments.output, &text).context("what was found makes no rig; nothing written")?;
    files::write(&arguments.output, &text)?;
    Ok(draft)
}

/// A rig drafted from what was flown, under the name of the file that it goes to.
pub fn drafted(flown: Vec<Flown>, output: &Path, mass_kg: Option<f64>) -> anyhow::Result<Draft> {
    let name =
        output.file_stem().map_or_else(|| "draft".to_owned(), |name| name.to_string_lossy().into_owned());
    let actuation = one_unit(&flown)?;
    let parameter = |names: &[&str]| {
        let of = |name: &str| {
            let value = flown.iter().find_map(|flown| flown.parameter(name))?;
            Some((value, name.to_owned()))
        };
        names.iter().find_map(|name| of(name)).filter(|(value, _)| *value > 0.0)
    };
    let mass_kg = match mass_kg {
        Some(kg) => Some((kg, "--mass-kg".to_owned())),
        None => parameter(&MASS).map(|(kg, name)| {
            (kg, format!("the log's parameter {name}; PX4 ships with 1, so see that somebody set it"))
        }),
    };
    let rotor = |axis: &str| flown.iter().find_map(|flown| flown.parameter(&format!("CA_ROTOR0_P{axis}")));
    let arm_m = rotor("X").zip(rotor("Y")).map(|(x, y)| x.hypot(y)).filter(|arm| *arm > 0.0 && *arm <= 10.0);
    let arm_m = arm_m.map(|arm| (arm, "the log's parameters CA_ROTOR0_PX and CA_ROTOR0_PY".to_owned()));
    let flights: Vec<(String, Flight)> = flown.into_iter().map(|flown| (flown.name, flown.flight)).collect();
    Ok(Draft::of(&flights, &Known { name, actuation, mass_kg, arm_m })?)
}

/// The unit of the throttle, which all flights must share.
fn one_unit(flown: &[Flown]) -> anyhow::Result<Actuation> {
    let mut known: Option<(&str, Actuation)> = None;
    for flown in flown {
        let Some(actuation) = flown.actuation else {
            bail!(
                "{}: nothing tells the unit of its throttle, or it has none; a map that names the throttle tells it (docs/import.md)",
                flown.name
            );
        };
        match known {
            Some((name, before)) if before != actuation => bail!(
                "{name} has its throttle in {}, {} in {}: these are not of one aircraft, or by different maps",
                before.unit(),
                flown.name,
                actuation.unit()
            ),
            _ => known = Some((&flown.name, actuation)),
        }
    }
    known.map(|(_, actuation)| actuation).context("no log was named")
}

fn in_words(draft: &Draft, output: &Path, count: &str) -> String {
    let mut out = format!("{}: drafted from {count}\n", output.display());
    let numbers = draft.numbers();
    // Writing to a String cannot fail, here and below.
    for (note, value) in numbers.iter().filter(|(note, _)| note.from != Source::Guess) {
        let _ = writeln!(out, "  {} = {value}\n    {}", note.key, note.words);
    }
    let guesses: Vec<&str> = numbers
        .iter()
        .filter(|(note, _)| note.from == Source::Guess)
        .map(|(note, _)| note.key.as_str())
        .collect();
    let _ = writeln!(out, "guesses, marked in the file: {}", guesses.join(", "));
    let file = output.display();
    let _ = writeln!(
        out,
        "`bench check {file}` tells whether it holds together, `bench identify flight --rig {file}` narrows it by nominal flights."
    );
    out
}
