mod answer;
mod power;

use std::{
    hash::{BuildHasher, RandomState},
    path::PathBuf,
    time::Instant,
};

use bench_blind::Plan;
use clap::{Args, Subcommand};

use crate::{
    arguments::{Force, Json, Page, RigArgument},
    exit::Exit,
    files::{self, Form, Outputs},
    progress::Progress,
    words,
};

/// Check a diagnosis on flights whose cause is withheld
#[derive(Args)]
#[command(after_help = "Examples:
  bench blind seal --cases 60 -o sealed/ --key key.json
  bench blind answer sealed/ -o answers.json
  bench blind open sealed/ --key key.json --answers answers.json --html score.html
  bench blind power --rig virtual --missions blind

docs/blind.md tells how answers are written, and what the scores mean.")]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Seal(SealArguments),
    Answer(answer::AnswerArguments),
    Stamp(StampArguments),
    Open(OpenArguments),
    Power(power::PowerArguments),
}

pub fn run(arguments: Arguments) -> anyhow::Result<Exit> {
    match arguments.command {
        Command::Seal(arguments) => seal(&arguments),
        Command::Answer(arguments) => answer::answer(&arguments),
        Command::Stamp(arguments) => stamp(&arguments),
        Command::Power(arguments) => power::power(arguments),
        Command::Open(arguments) => open(&arguments),
    }
}

/// Make cases, seal them, and keep what they are in a key apart
#[derive(Args)]
struct SealArguments {
    #[command(flatten)]
    rig: RigArgument,
    /// Missions that every case flies in turn: files, names of built-in ones, or folders of either in the order of their names
    #[arg(long, num_args = 1.., default_value = files::BLIND_MISSIONS)]
    missions: Vec<PathBuf>,
    /// How many cases
    #[arg(long, default_value_t = 300)]
    cases: usize,
    /// Seed of everything random; whoever knows it can make the key again [default: drawn by chance]
    #[arg(long)]
    seed: Option<u64>,
    /// Also draw the kinds that are kept for a seal whose scores are published
    #[arg(long)]
    with_reserved: bool,
    /// Folder to make
    #[arg(short, long, visible_alias = "out")]
    output: PathBuf,
    /// File for the key, outside of the folder
    #[arg(long)]
    key: PathBuf,
}

fn seal(arguments: &SealArguments) -> anyhow::Result<Exit> {
    let plan = Plan {
        rig: arguments.rig.load()?,
        missions: files::missions(&arguments.missions)?,
        cases: arguments.cases,
        seed: arguments.seed.unwrap_or_else(any_seed),
        with_reserved: arguments.with_reserved,
    };
    let progress = Progress::of("blind seal");
    progress.begin("flying", plan.cases as f64, "cases");
    let began = Instant::now();
    let seal = bench_blind::seal(&plan, &arguments.output, &arguments.key, |done| {
        progress.at(done as f64);
    })?;
    drop(progress);
    words::print(&format!(
        "{} of {} sealed in {} ({:.0} s)\n  seal  {}\n  key   {}: keep it where whoever answers cannot read it",
        words::count(plan.cases as u64, "case"),
        words::count(plan.missions.len() as u64, "flight"),
        arguments.output.display(),
        began.elapsed().as_secs_f64(),
        seal.key_sha256,
        arguments.key.display(),
    ))?;
    Ok(Exit::Done)
}

/// Put their hash into answers that another tool wrote
#[derive(Args)]
struct StampArguments {
    /// Answers (bench.answers/1); the hash replaces the 64 digits of its "sha256"
    answers: PathBuf,
}

fn stamp(arguments: &StampArguments) -> anyhow::Result<Exit> {
    words::print(&bench_blind::stamp(&arguments.answers)?)?;
    Ok(Exit::Done)
}

/// Check that seal, key and answers are what they were, then score the answers
#[derive(Args)]
struct OpenArguments {
    /// Sealed folder
    folder: PathBuf,
    /// Its key
    #[arg(long)]
    key: PathBuf,
    /// Answers (bench.answers/1)
    #[arg(long)]
    answers: PathBuf,
    #[command(flatten)]
    json: Json,
    #[command(flatten)]
    page: Page,
    #[command(flatten)]
    force: Force,
}

fn open(arguments: &OpenArguments) -> anyhow::Result<Exit> {
    Outputs::new(arguments.force.force)
        .and(arguments.page.html.as_deref(), Form::Html)
        .from([arguments.key.as_path(), arguments.answers.as_path()])
        .check()?;
    let score = bench_blind::open(&arguments.folder, &arguments.key, &arguments.answers)?;
    if arguments.json.json {
        words::print_json(&score)?;
    } else {
        words::print(&score.in_words())?;
    }
    if let Some(file) = &arguments.page.html {
        files::write_and_say(file, &bench_blind::page(&score, &words::command()))?;
    }
    Ok(Exit::Done)
}

/// A seed that nobody chose: the standard library's hash keys come from the operating system.
fn any_seed() -> u64 {
    RandomState::new().hash_one(0)
}
