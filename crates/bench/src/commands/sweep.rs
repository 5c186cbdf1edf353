mod cluster;

use std::{
    fmt::Write as _,
    ops::ControlFlow,
    path::{Path, PathBuf},
    sync::atomic::{AtomicBool, Ordering},
    time::Instant,
};

use anyhow::{Context, bail};
use bench_campaign::{
    Done, Executed, Keep, Kind, Outcome, Plan, Shard, Step, Store, Work, Workload, encoded, execute, perform,
    perform_together, record, report, runs_together,
};
use bench_page::{Page, Tone};
use clap::{Args, Subcommand, ValueEnum};
use serde_json::json;

use crate::{
    arguments::{Force, Json},
    call,
    exit::Exit,
    files::{self, Form, Outputs},
    library,
    progress::{self, Progress},
    sweeps::Names,
    words,
};

/// Run thousands of flights or diagnoses that a plan describes, on this machine or as shares of a cluster's work
#[derive(Args)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Run(RunArguments),
    List(ListArguments),
    Merge(FolderArguments),
    Report(ReportArguments),
    Replay(ReplayArguments),
    Slurm(cluster::SlurmArguments),
    Kubernetes(cluster::KubernetesArguments),
}

/// Do the runs of a plan that are not done yet, and put the results into one table
#[derive(Args)]
#[command(after_help = "Examples:
  bench sweep run robustness -o robust/
  bench sweep run my-plan.toml -o mine/ --keep-recordings failed
  bench sweep run my-plan.toml -o shares/ --shard 3/8

Interrupted, the same command goes on where it stopped. A run that cannot be done is a row that
says why. Several machines may each run a share of the same folder; `bench sweep merge` then puts
the results together. docs/scale.md tells what a million runs take.")]
struct RunArguments {
    /// Plan: a file, or the name of a built-in one (`bench rigs` lists them); or the folder of a sweep that was begun
    plan: PathBuf,
    /// Folder of the results: a new one, or that of the same plan; needed with a plan
    #[arg(short, long, value_name = "FOLDER")]
    output: Option<PathBuf>,
    /// Run one of so many equal shares, such as 3/8
    #[arg(long, value_name = "I/N")]
    shard: Option<String>,
    /// Keep recordings of flights in the folder
    #[arg(long, value_name = "WHICH", default_value = "none")]
    keep_recordings: KeepChoice,
    /// Runs at the same time [default: one for each core]
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: Option<u16>,
    #[command(flatten)]
    json: Json,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum KeepChoice {
    /// None
    None,
    /// Those that missed their mission's criteria or were stopped
    Failed,
    /// All
    All,
}

/// Say what a plan comes to, without running it: how many runs, in which parts, and the first of them
#[derive(Args)]
#[command(after_help = "Examples:
  bench sweep list robustness
  bench sweep list my-plan.toml --all > runs.txt
  bench sweep list my-plan.toml --cost --shards 100 --interruptions-per-hour 0.5

--cost does a few of the runs to see how long one takes. docs/scale.md has the arithmetic.")]
struct ListArguments {
    /// Plan: a file, or the name of a built-in one
    plan: PathBuf,
    /// Print every run: its id, and what it is
    #[arg(long)]
    all: bool,
    /// Say what the sweep takes on a cluster
    #[arg(long)]
    cost: bool,
    /// Shards, each on a core of its own
    #[arg(long, value_name = "COUNT", default_value_t = 1, requires = "cost", value_parser = clap::value_parser!(u64).range(1..=100_000))]
    shards: u64,
    /// How often an hour a shard is interrupted
    #[arg(long, value_name = "TIMES", default_value_t = 0.0, requires = "cost", value_parser = from_0_to::<100>)]
    interruptions_per_hour: f64,
    /// From an interruption until the shard runs again, s
    #[arg(long, value_name = "SECONDS", default_value_t = 60.0, requires = "cost", value_parser = from_0_to::<86_400>)]
    restart: f64,
    /// Standard deviation of the logarithm of how slow a core is
    #[arg(long, value_name = "LN", default_value_t = 0.0, requires = "cost", value_parser = from_0_to::<2>)]
    slowness: f64,
}

fn from_0_to<const MOST: u32>(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|x| (0.0..=f64::from(MOST)).contains(x));
    number.ok_or_else(|| format!("a number from 0 to {MOST} is expected"))
}

/// Put the results of all shares into one table
#[derive(Args)]
#[command(after_help = "Examples:
  bench sweep merge swept/
  duckdb -c \"select variant, count(*) from 'swept/results.parquet' group by 1\"")]
struct FolderArguments {
    /// Folder of a sweep
    folder: PathBuf,
}

/// Draw what a sweep found: distributions, success against the size of each effect, the worst runs
#[derive(Args)]
#[command(after_help = "Examples:
  bench sweep report swept/
  bench sweep report swept/ -o robustness.html")]
struct ReportArguments {
    /// Folder of a sweep whose runs are all done
    folder: PathBuf,
    /// Page to write [default: report.html in the folder]
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
}

/// Fly a run of a sweep again, and record it
#[derive(Args)]
#[command(after_help = "Examples:
  bench sweep replay swept/ 1f0c9a3b -o worst.mcap && bench report worst.mcap")]
struct ReplayArguments {
    /// Folder of a sweep
    folder: PathBuf,
    /// The run's id, or its first eight digits or more
    id: String,
    /// Recording to write
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    #[command(flatten)]
    force: Force,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    match &arguments.command {
        Command::Run(arguments) => run_plan(arguments),
        Command::List(arguments) => list(arguments),
        Command::Merge(arguments) => merge(&arguments.folder),
        Command::Report(arguments) => draw(arguments),
        Command::Replay(arguments) => replay(arguments),
        Command::Slurm(arguments) => cluster::slurm(arguments),
        Command::Kubernetes(arguments) => cluster::kubernetes(arguments),
    }
}

/// Reads a plan: a file, or one of the library by its name.
fn read(named: &Path) -> anyhow::Result<Plan> {
    let (path, text) = files::text_of(library::Kind::Sweep, named)?;
    Ok(Plan::read(&path, &text, &Names { file: &path })?)
}

/// The sweep that a plan begins or goes on with in a folder, or the one of a folder that was begun.
fn begin(plan: &Path, output: Option<&Path>) -> anyhow::Result<Store> {
    match output {
        None if plan.is_dir() => Ok(Store::open(plan)?),
        None => bail!("--output is missing: name the folder that the results of {} go to", plan.display()),
        Some(output) if plan.is_dir() => {
            bail!(
                "{} is a folder, which goes on by itself; leave out --output {}",
                plan.display(),
                output.display()
            )
        }
        Some(output) => Ok(Store::begin(output, read(plan)?)?),
    }
}

/// What became of a plan, without words; `None` of what else a sweep's command does.
pub fn ran(arguments: &Arguments) -> Option<anyhow::Result<serde_json::Value>> {
    match &arguments.command {
        Command::Run(arguments) => Some(done(arguments).map(|ran| ran.as_json())),
        _ => None,
    }
}

/// Runs of a plan that are done.
struct Ran {
    store: Store,
    shard: Shard,
    executed: Executed,
    seconds: f64,
    /// The table of all runs, where all were asked for.
    results: Option<PathBuf>,
}

fn run_plan(arguments: &RunArguments) -> anyhow::Result<Exit> {
    let ran = done(arguments)?;
    if arguments.json.json {
        words::print_json(&ran.as_json())?;
    } else {
        words::print(&ran.in_words())?;
    }
    Ok(Exit::Done)
}

fn done(arguments: &RunArguments) -> anyhow::Result<Ran> {
    let shard = arguments.shard.as_deref().map_or(Ok(Shard::WHOLE), str::parse)?;
    let store = begin(&arguments.plan, arguments.output.as_deref())?;
    let plan = store.plan();
    let keep = match arguments.keep_recordings {
        KeepChoice::None => Keep::Nothing,
        KeepChoice::Failed => Keep::Failed,
        KeepChoice::All => Keep::All,
    };
    if keep != Keep::Nothing && plan.file().kind != Kind::Flights {
        bail!(
            "--keep-recordings: the plan {} diagnoses, and flies nothing that could be kept; leave it out",
            plan.file().name
        );
    }
    // This thread knows of the call, those of a pool do not.
    let stop = call::stop();
    let began = Instant::now();
    let executed = with_jobs(arguments.jobs, || computed(&store, shard, keep, &stop))?;
    let seconds = began.elapsed().as_secs_f64();
    let results = if shard == Shard::WHOLE { Some(store.merge()?) } else { None };
    Ok(Ran { store, shard, executed, seconds, results })
}

fn with_jobs<T: Send>(jobs: Option<u16>, work: impl FnOnce() -> T + Send) -> T {
    let pool =
        jobs.and_then(|jobs| rayon::ThreadPoolBuilder::new().num_threads(usize::from(jobs)).build().ok());
    match pool {
        Some(pool) => pool.install(work),
        None => work(),
    }
}

fn computed(
    store: &Store,
    shard: Shard,
    keep: Keep,
    stop: &AtomicBool,
) -> Result<Executed, bench_campaign::CampaignError> {
    let (_, done) = store.unfinished(shard);
    if done > 0 {
        progress::note(&format!("going on: {} done before", words::count(done, "run")));
    }
    let progress = Progress::of("sweep");
    execute(store, shard, keep, &|step| {
        match step {
            Step::Begun { runs, done } => {
                progress.begin("running", runs as f64, "runs");
                progress.resume_at(done as f64);
                progress.with_rate();
            }
            Step::Done(_) => progress.step(),
        }
        if stop.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    })
}

fn outcomes(executed: &Executed) -> impl Iterator<Item = (Outcome, u64)> {
    Outcome::ALL.into_iter().zip(executed.outcomes).filter(|(_, count)| *count > 0)
}

impl Ran {
    fn in_words(&self) -> String {
        let Self { store, shard, executed, seconds, results } = self;
        let now: u64 = executed.outcomes.iter().sum();
        let share = if *shard == Shard::WHOLE { String::new() } else { format!(" of shard {shard}") };
        let mut out = format!(
            "{}: {}{share} done, {} of them now",
            store.plan().file().name,
            words::count(executed.runs, "run"),
            words::grouped(now)
        );
        // Writing to a String cannot fail, here and below.
        if now > 0 {
            let _ = write!(out, " in {seconds:.1} s ({:.0} a second)", now as f64 / seconds.max(1e-9));
        }
        out.push('\n');
        for (outcome, count) in outcomes(executed) {
            let tone = match outcome {
                Outcome::Passed => Tone::Good,
                Outcome::Missed | Outcome::Stopped | Outcome::Error => Tone::Bad,
                Outcome::Diagnosed => Tone::Plain,
            };
            let _ = writeln!(out, "  {:<10} {}", words::toned(tone, outcome.name()), words::grouped(count));
        }
        let folder = words::quoted(&store.folder().display().to_string());
        let _ = match results {
            Some(results) => {
                writeln!(out, "results in {}; `bench sweep report {folder}` draws them", results.display())
            }
            None => {
                writeln!(out, "parts in {folder}; when all shards are done, `bench sweep merge {folder}`")
            }
        };
        out
    }

    fn as_json(&self) -> serde_json::Value {
        let Self { store, shard, executed, seconds, results } = self;
        let counts: serde_json::Map<_, _> = Outcome::ALL
            .into_iter()
            .zip(executed.outcomes)
            .map(|(outcome, count)| (outcome.name().to_owned(), json!(count)))
            .collect();
        json!({
            "schema": "bench.sweep/1",
            "name": store.plan().file().name,
            "id": store.plan().id(),
            "folder": store.folder(),
            "shard": shard.to_string(),
            "runs": executed.runs,
            "before": executed.before,
            "outcomes": counts,
            "seconds": seconds,
            "busy_s": executed.busy.as_secs_f64(),
            "results": results,
        })
    }
}

fn list(arguments: &ListArguments) -> anyhow::Result<Exit> {
    /// As many are enough to see what a plan is.
    const FIRST: u64 = 5;
    let plan = read(&arguments.plan)?;
    let shown = if arguments.all { plan.runs() } else { plan.runs().min(FIRST) };
    let mut out = format!(
        "{}: {} in {}, id {}\n{}\n",
        plan.file().name,
        words::count(plan.runs(), "run"),
        words::count(plan.parts(), "part"),
        plan.id().get(..16).unwrap_or_default(),
        plan.file().description
    );
    for index in 0..shown {
        let run = plan.run(index);
        let what = match &run.work {
            Work::Flight(flight) => {
                let effects: Vec<String> = flight.effects.iter().map(files::effect_in_words).collect();
                let with =
                    if effects.is_empty() { String::new() } else { format!(", {}", effects.join(" + ")) };
                format!(
                    "{} on {}, {}, seed {}{with}",
                    flight.mission_name, flight.rig_name, flight.variant, flight.seed
                )
            }
            Work::Recording { path, rig, .. } => {
                format!(
                    "{} held against {}",
                    path.display(),
                    rig.map_or("the rig that it carries", |(name, _)| name)
                )
            }
            Work::Set { rig_name, causes, missions, .. } => {
                let causes: Vec<&str> = causes.iter().map(|cause| cause.name.as_str()).collect();
                let causes = if causes.is_empty() { "nothing".to_owned() } else { causes.join(" + ") };
                format!("{} on {rig_name} with {causes}", words::count(missions.len() as u64, "flight"))
            }
        };
        let _ = writeln!(out, "  {}  {what}", run.id);
        if out.len() > 1 << 16 {
            words::print(&std::mem::take(&mut out))?;
        }
    }
    if shown < plan.runs() {
        let _ = writeln!(out, "  and {} more: --all lists them", words::grouped(plan.runs() - shown));
    }
    if arguments.cost {
        out += &cost(&plan, arguments)?;
    }
    words::print(&out)?;
    Ok(Exit::Done)
}

/// Does a few runs and writes them, and says what all of them take.
fn cost(plan: &Plan, arguments: &ListArguments) -> anyhow::Result<String> {
    /// As many tell the mean to a few percent, where runs are alike; and as many go together.
    const SAMPLED: u64 = 20;
    let sampled = plan.runs().min(SAMPLED.max(runs_together(plan)));
    // One to warm up.
    perform(plan, 0);
    let done = perform_together(plan, (0..sampled).map(|i| i * plan.runs() / sampled));
    let run_s = done.iter().map(|done| done.took.as_secs_f64()).sum::<f64>() / sampled as f64;
    let rows: Vec<Done> = done.iter().cycle().take(plan.runs_per_part() as usize).cloned().collect();
    let began = Instant::now();
    let bytes = encoded(plan, &rows)?.len() as f64;
    let write_s = began.elapsed().as_secs_f64();
    let workload = Workload {
        runs: plan.runs(),
        run_s,
        runs_per_write: plan.runs_per_part(),
        write_s,
        shards: arguments.shards,
        slowness_ln: arguments.slowness,
        interruptions_per_hour: arguments.interruptions_per_hour,
        restart_s: arguments.restart,
    };
    let cost = workload.cost();
    let mut out = format!(
        "cost by {} on this machine: {} s a run\n",
        words::count(sampled, "run"),
        words::short(run_s)
    );
    let _ = writeln!(out, "  core hours   {}", words::short(cost.core_hours));
    let _ = writeln!(
        out,
        "  wall hours   {} on {}",
        words::short(cost.wall_hours),
        words::count(arguments.shards, "core")
    );
    let _ = writeln!(out, "  lost         {:.1} % to interruptions", 100.0 * cost.lost_share);
    let all_bytes = plan.parts() as f64 * bytes;
    let _ =
        writeln!(out, "  results      about {}, as much again once merged", words::size(all_bytes as u64));
    Ok(out)
}

fn merge(folder: &Path) -> anyhow::Result<Exit> {
    let results = Store::open(folder)?.merge()?;
    progress::note(&format!("wrote {}", results.display()));
    Ok(Exit::Done)
}

fn draw(arguments: &ReportArguments) -> anyhow::Result<Exit> {
    let store = Store::open(&arguments.folder)?;
    let own = arguments.folder.join("report.html");
    let output = arguments.output.as_deref().unwrap_or(&own);
    // The page that stands in the sweep's own folder is made anew.
    let force = arguments.force.force || arguments.output.is_none();
    Outputs::new(force).and(output, Form::Html).check()?;
    let results = match store.results() {
        Some(results) => results,
        None => store.merge()?,
    };
    let folder = words::quoted(&arguments.folder.display().to_string());
    let drawn = report(&store, &results, &folder)?;
    let page = Page::new(drawn.title, drawn.verdict).sections(drawn.sections).made_by(words::command());
    files::write_and_say(output, &page.html())?;
    Ok(Exit::Done)
}

fn replay(arguments: &ReplayArguments) -> anyhow::Result<Exit> {
    Outputs::new(arguments.force.force).and(arguments.output.as_path(), Form::Recording).check()?;
    let store = Store::open(&arguments.folder)?;
    let run = store.plan().run(store.find(&arguments.id)?);
    let Work::Flight(flight) = &run.work else {
        bail!(
            "run {} of {} is a diagnosis of its own, and no flight to replay",
            run.id,
            store.plan().file().name
        );
    };
    files::make_folder(&arguments.output)?;
    let finished = record(flight, &arguments.output).context("the flight could not be recorded")?;
    progress::note(&format!(
        "recorded {} ({}) to {}",
        words::count(finished.messages, "message"),
        words::size(finished.bytes),
        finished.path.display()
    ));
    Ok(Exit::Done)
}
