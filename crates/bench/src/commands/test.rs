use std::{
    collections::BTreeMap,
    fmt::Write as _,
    io::{BufRead as _, IsTerminal as _, Write as _},
    path::{Path, PathBuf},
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    time::Instant,
};

use anyhow::bail;
use bench_suite::{
    Comparison, Counts, Journal, Kept, Kind, Mode, Outcome, Report, Run, Tested, Times, page::tone,
};
use clap::{Args, ValueEnum};
use rayon::prelude::*;

use crate::{
    arguments::{Force, Json, Meta},
    exit::Exit,
    progress::{self, Progress},
    signals,
    station::Station,
    suites::{
        Baselines, Change, Flying, Folder, PAGE, Plan, Planned, Selected, Stored, compare_back_to_back,
    },
    words,
};

/// Fly a suite of tests and hold every flight to its limits, its baseline or its partner
#[derive(Args)]
#[command(after_help = "Examples:
  bench test paper
  bench test paper --list
  bench test paper --tag ci --force --json
  bench test pre-flight --port /dev/ttyACM0 --station lab/ --meta operator=Ada --meta airframe=Q4-07
  bench test hover.toml --record-baselines
  bench test hover.toml --effect thrust-loss:fraction=0.01 -o what-if/

The folder of the results holds results.json, junit.xml, summary.md, report.html and the
recordings. A suite that was killed goes on with --resume. Simulated tests use all cores; tests on
hardware are flown one at a time. docs/test.md tells all of it, docs/suite.md has every key.

Exit code 0: all tests passed; 1: some failed or are flaky; 2: the suite is wrong, and nothing was
flown; 3: records were lost; 4: a device failed, a safety limit stopped a flight, or it was
interrupted.")]
pub struct Arguments {
    /// Suite: a file, or the name of a built-in one (`bench rigs` lists them)
    suite: PathBuf,
    /// Folder for the results [default: test-results/NAME]
    #[arg(short, long, value_name = "FOLDER")]
    output: Option<PathBuf>,
    /// Only cases with this tag; may be repeated
    #[arg(long = "tag", value_name = "TAG")]
    tags: Vec<String>,
    /// Only tests whose name holds this text; may be repeated
    #[arg(long = "test", value_name = "TEXT")]
    tests: Vec<String>,
    /// Only tests in this mode; may be repeated
    #[arg(long = "mode", value_name = "MODE")]
    modes: Vec<ModeChoice>,
    /// List the tests instead of flying them
    #[arg(long)]
    list: bool,
    /// Add an effect to every test: does the suite notice it? May be repeated
    #[arg(long = "effect", value_name = "NAME:PARAM=VALUE")]
    effects: Vec<String>,
    /// Serial port of the board, for tests on hardware; MODE=PORT where each mode has a board of its own. May be repeated
    #[arg(long = "port", value_name = "[MODE=]PORT")]
    ports: Vec<String>,
    /// Which Kinect, for tests with the real airframe
    #[arg(long, value_name = "INDEX|SERIAL")]
    kinect: Option<String>,
    /// Exposure of the Kinect
    #[arg(long, value_name = "MS")]
    exposure_ms: Option<f64>,
    #[command(flatten)]
    meta: Meta,
    /// Folder of the station that flies: its log of all runs, and the recordings [default: none, or what `BENCH_STATION` names]
    #[arg(long, value_name = "FOLDER", env = "BENCH_STATION")]
    station: Option<PathBuf>,
    /// Go on with a suite that was killed: what it flew is not flown again
    #[arg(long, conflicts_with = "force")]
    resume: bool,
    /// Record the flights as baselines; those that exist and differ are shown, and replaced with --force alone
    #[arg(long, value_name = "FORM", num_args = 0..=1, require_equals = true, default_missing_value = "thinned")]
    record_baselines: Option<Stored>,
    /// Folder of the baselines [default: the suite's]
    #[arg(long, value_name = "FOLDER")]
    baselines: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    json: Json,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum ModeChoice {
    /// In the virtual lab
    Sim,
    /// In the virtual lab, by rendered frames
    Frames,
    /// Through a real board
    Loopback,
    /// The real airframe
    Transmitter,
}

impl ModeChoice {
    const fn mode(self) -> Mode {
        match self {
            Self::Sim => Mode::Sim,
            Self::Frames => Mode::Frames,
            Self::Loopback => Mode::Loopback,
            Self::Transmitter => Mode::Transmitter,
        }
    }
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    let selected = Selected {
        tags: &arguments.tags,
        tests: &arguments.tests,
        modes: arguments.modes.iter().map(|mode| mode.mode()).collect(),
    };
    // What is only listed needs no port.
    let ports = (!arguments.list).then_some(&arguments.ports[..]);
    let (mut plan, mut problems) = Plan::read(&arguments.suite, &selected, ports, &arguments.effects)?;
    if arguments.list {
        plan.refuse(&problems)?;
        return list(&plan);
    }
    let mut baselines = Baselines::open(&plan, arguments.baselines.as_deref())?;
    if arguments.record_baselines.is_none() {
        problems.extend(baselines.check(&plan));
    }
    plan.refuse(&problems)?;
    if arguments.record_baselines.is_some() {
        plan.keep_those_with_baselines();
    }
    let name = plan.path.file_stem().unwrap_or_default();
    let folder = arguments.output.clone().unwrap_or_else(|| Path::new("test-results").join(name));
    let folder = Folder::open(&folder, arguments.force.force, arguments.resume)?;
    let meta = known(&plan, arguments)?;
    let station = arguments.station.as_deref().map(Station::open).transpose()?;
    let stop = Arc::new(AtomicBool::new(false));
    let _interrupts = signals::heed(Arc::clone(&stop))?;
    let flying = Flying {
        suite: &plan.suite,
        ports: &plan.ports,
        hil_arguments: hil_arguments(arguments),
        meta: meta.clone(),
        folder: folder.path(),
        station: station.as_ref(),
        stop: &stop,
    };
    let (journal, kept) = folder.journal(&plan.digest(&meta), arguments.resume, &flying)?;
    let began = Instant::now();
    let started_unix_s = crate::recorded::since_1970().as_secs_f64();
    let against = arguments.record_baselines.is_none().then_some(&baselines);
    let flown = match fly_all(&plan, &flying, against, journal, kept) {
        Ok(flown) => flown,
        Err(error) => {
            words::fail(words::causes(&error));
            words::warn(format_args!(
                "the flights until then are kept in {}; go on with --resume",
                folder.path().display()
            ));
            return Ok(Exit::DataLoss);
        }
    };
    let mut report = report(&plan, meta, flown);
    if let Some(stored) = arguments.record_baselines {
        return record(&plan, &flying, &mut baselines, &report, (stored, arguments.force.force));
    }
    for remark in compare_back_to_back(&plan, &flying, &mut report) {
        words::warn(remark);
    }
    for id in baselines.unused(&plan) {
        words::warn(format_args!(
            "the baseline {id} in {} belongs to no test any more",
            baselines.folder().display()
        ));
    }
    report.times = Times { started_unix_s, took_s: began.elapsed().as_secs_f64() };
    report.settle();
    folder.write(&report, &flying)?;
    if arguments.json.json {
        words::print_json(&report)?;
    } else {
        words::print(&in_words(&report))?;
    }
    progress::note(&format!("wrote {}", folder.path().join(PAGE).display()));
    Ok(exit(&report))
}

fn exit(report: &Report) -> Exit {
    let runs = || report.tests.iter().flat_map(|test| &test.runs);
    match report.outcome {
        Outcome::Passed => Exit::Done,
        Outcome::NotRun => Exit::Stopped,
        _ if report.counts.not_run > 0 || runs().any(|run| run.stopped) => Exit::Stopped,
        _ if runs().any(|run| run.data_lost) => Exit::DataLoss,
        // An error of any other kind is a device that could not be used.
        Outcome::Error => Exit::Stopped,
        Outcome::Failed | Outcome::Flaky => Exit::CheckFailed,
    }
}

fn list(plan: &Plan) -> anyhow::Result<Exit> {
    let mut out = String::new();
    for Planned { test, .. } in &plan.tests {
        let case = &plan.suite.cases[test.case];
        let repeats = if case.repeats > 1 { format!(", {} flights", case.repeats) } else { String::new() };
        let tags = if case.tags.is_empty() { String::new() } else { format!(" [{}]", case.tags.join(", ")) };
        // Writing to a String cannot fail.
        let _ = writeln!(
            out,
            "{:<40} rig {}, mission {}, {}, seed {}{repeats}{tags}",
            test.id, test.rig, test.mission, test.mode, test.seed
        );
    }
    let _ = writeln!(out, "{}", words::count(plan.tests.len() as u64, "test"));
    words::print(&out)?;
    Ok(Exit::Done)
}

/// What the suite wants to know of the station, from the command line or from who sits at the terminal.
fn known(plan: &Plan, arguments: &Arguments) -> anyhow::Result<BTreeMap<String, String>> {
    let mut meta: BTreeMap<String, String> = arguments.meta.meta.iter().cloned().collect();
    let missing: Vec<&String> = plan.suite.ask.iter().filter(|key| !meta.contains_key(*key)).collect();
    let is_terminal = std::io::stdin().is_terminal() && std::io::stderr().is_terminal();
    if !missing.is_empty() && !is_terminal {
        let missing: Vec<String> = missing.iter().map(|key| format!("--meta {key}=...")).collect();
        bail!("{} asks what it cannot find out; add {}", plan.path.display(), missing.join(" "));
    }
    for key in missing {
        let mut answer = String::new();
        while answer.trim().is_empty() {
            let mut stderr = std::io::stderr();
            write!(stderr, "{key}: ").and_then(|()| stderr.flush())?;
            if std::io::stdin().lock().read_line(&mut answer)? == 0 {
                bail!("{key} was not answered; give it as --meta {key}=...");
            }
        }
        meta.insert(key.clone(), answer.trim().to_owned());
    }
    Ok(meta)
}

fn hil_arguments(arguments: &Arguments) -> Vec<String> {
    let kinect = arguments.kinect.iter().flat_map(|kinect| ["--kinect".to_owned(), kinect.clone()]);
    let exposure = arguments.exposure_ms.iter().flat_map(|ms| ["--exposure-ms".to_owned(), ms.to_string()]);
    kinect.chain(exposure).collect()
}

/// One flight that is to be flown: the place of its test in the plan, and which repeat.
type Due = (usize, u32);

/// Flies what is not in the journal: simulated flights on all cores, then those on hardware one at a time.
fn fly_all(
    plan: &Plan,
    flying: &Flying<'_>,
    baselines: Option<&Baselines>,
    journal: Journal,
    kept: Vec<Kept>,
) -> anyhow::Result<BTreeMap<Due, Run>> {
    let mut flown = BTreeMap::new();
    for Kept { test, run } in kept {
        if let Some(index) = plan.tests.iter().position(|planned| planned.test.id == test) {
            flown.insert((index, run.repeat), run);
        }
    }
    let due: Vec<Due> = plan
        .tests
        .iter()
        .enumerate()
        .flat_map(|(index, planned)| {
            (0..plan.suite.cases[planned.test.case].repeats).map(move |repeat| (index, repeat))
        })
        // A baseline is the first flight of its test.
        .filter(|due| !flown.contains_key(due) && (baselines.is_some() || due.1 == 0))
        .collect();
    if !flown.is_empty() {
        progress::note(&format!(
            "{} flown before; {} to go",
            words::count(flown.len() as u64, "flight"),
            due.len()
        ));
    }
    warm(plan, baselines);
    let progress = Progress::of("test");
    progress.begin("flying", due.len() as f64, "flights");
    let journal = Mutex::new(journal);
    let fly = |(index, repeat): Due| -> anyhow::Result<Option<(Due, Run)>> {
        if flying.stop.load(Ordering::Relaxed) {
            return Ok(None);
        }
        let planned = &plan.tests[index];
        let Some(mut run) = flying.fly(planned, repeat)? else { return Ok(None) };
        if let Some(baselines) = baselines.filter(|_| plan.suite.cases[planned.test.case].compare.baseline) {
            hold_against_baseline(plan, flying, baselines, planned, &mut run);
        }
        let kept = Kept { test: planned.test.id.clone(), run };
        // A line is whole or not there.
        journal.lock().unwrap_or_else(PoisonError::into_inner).keep(&kept)?;
        progress.step();
        Ok(Some(((index, repeat), kept.run)))
    };
    let (hardware, simulated): (Vec<Due>, Vec<Due>) =
        due.into_iter().partition(|(index, _)| plan.tests[*index].test.mode.is_hardware());
    let made = simulated.into_par_iter().map(fly).collect::<anyhow::Result<Vec<_>>>()?;
    flown.extend(made.into_iter().flatten());
    for due in hardware {
        let test = &plan.tests[due.0].test;
        if test.mode == Mode::Transmitter && !flying.stop.load(Ordering::Relaxed) {
            wait_until_placed(&progress, &test.id)?;
        }
        progress.doing(&format!("flying {}", test.id));
        flown.extend(fly(due)?);
    }
    Ok(flown)
}

/// The real airframe stands where the flight before left it: who sits at the terminal puts it back. Without a terminal it is flown from there.
fn wait_until_placed(progress: &Progress, test: &str) -> anyhow::Result<()> {
    if std::io::stdin().is_terminal() {
        progress.say(&format!(
            "{test} is next: put the airframe in its place, then press Enter (Ctrl-C and Enter end the suite)"
        ));
        std::io::stdin().lock().read_line(&mut String::new())?;
    }
    Ok(())
}

/// Simulations that tolerances are derived from use all cores themselves, so they are made before the flights that need them.
fn warm(plan: &Plan, baselines: Option<&Baselines>) {
    let mut known: Vec<(&str, &str)> = Vec::new();
    for planned in &plan.tests {
        let compare = plan.suite.cases[planned.test.case].compare;
        let key = (planned.test.rig.as_str(), planned.test.mission.as_str());
        if (compare.baseline && baselines.is_some() || compare.back_to_back) && !known.contains(&key) {
            known.push(key);
            let _ = crate::repeats::of(planned.nominal.clone(), &planned.mission);
        }
    }
}

fn hold_against_baseline(
    plan: &Plan,
    flying: &Flying<'_>,
    baselines: &Baselines,
    planned: &Planned,
    run: &mut Run,
) {
    let Some(attached) = &run.recording else { return };
    let made = baselines.compare(plan, planned, &flying.recording(attached));
    run.comparisons.push(made.unwrap_or_else(|error| Comparison {
        kind: Kind::Baseline,
        with: planned.test.id.clone(),
        passed: false,
        summary: words::causes(&error),
        differences: Vec::new(),
    }));
    run.settle();
}

fn report(plan: &Plan, meta: BTreeMap<String, String>, mut flown: BTreeMap<Due, Run>) -> Report {
    let tests = plan.tests.iter().enumerate().map(|(index, planned)| {
        let repeats = plan.suite.cases[planned.test.case].repeats;
        let mut tested =
            Tested::new(&plan.suite, &planned.test, &planned.nominal.name, &planned.mission.name);
        tested.effects = planned.added();
        tested.runs = (0..repeats).filter_map(|repeat| flown.remove(&(index, repeat))).collect();
        tested.settle(&plan.suite, repeats);
        tested
    });
    let mut report = Report {
        schema: Report::SCHEMA.to_owned(),
        suite: plan.suite.name.clone(),
        description: plan.suite.description.clone(),
        bench_version: env!("CARGO_PKG_VERSION").to_owned(),
        meta,
        outcome: Outcome::NotRun,
        counts: Counts::default(),
        tests: tests.collect(),
        diagnoses: Vec::new(),
        times: Times::default(),
    };
    report.settle();
    report
}

/// Takes the flights as baselines, and shows what changes.
fn record(
    plan: &Plan,
    flying: &Flying<'_>,
    baselines: &mut Baselines,
    report: &Report,
    how: (Stored, bool),
) -> anyhow::Result<Exit> {
    let (mut out, mut left) = (String::new(), 0_u64);
    let mut exit = Exit::Done;
    for (planned, tested) in plan.tests.iter().zip(&report.tests) {
        if !plan.suite.cases[planned.test.case].compare.baseline {
            continue;
        }
        let id = &planned.test.id;
        let Some(run) = tested.runs.first().filter(|run| run.outcome == Outcome::Passed) else {
            let why = tested.faults().first().cloned().unwrap_or_else(|| "it was not flown".to_owned());
            // Writing to a String cannot fail, here and below.
            let _ = writeln!(out, "not recorded  {id}: {why}");
            exit = Exit::CheckFailed;
            continue;
        };
        match baselines.record(plan, flying, planned, run, how)? {
            Change::New => _ = writeln!(out, "new           {id}"),
            Change::Same => _ = writeln!(out, "the same      {id}"),
            Change::Differs { comparison, replaced } => {
                let word = if replaced { "replaced" } else { "kept" };
                left += u64::from(!replaced);
                let _ = writeln!(out, "{word:<13} {id}: {}", comparison.in_words());
            }
        }
    }
    if out.is_empty() {
        bail!(
            "no case of {} has `compare = \"baseline\"`, so there is nothing to record",
            plan.path.display()
        );
    }
    words::print(&out)?;
    if left > 0 {
        words::warn(format_args!(
            "{} not replaced; look at what changed, and replace with --force",
            words::count(left, "baseline")
        ));
        exit = Exit::CheckFailed;
    }
    progress::note(&format!("baselines are in {}", baselines.folder().display()));
    Ok(exit)
}

fn in_words(report: &Report) -> String {
    let mut out = String::new();
    let word = |outcome: Outcome| {
        let word =
            if outcome == Outcome::Passed { "passed".to_owned() } else { outcome.name().to_uppercase() };
        words::toned(tone(outcome), &format!("{word:<7}"))
    };
    for test in &report.tests {
        let share = test.share();
        let share = if share.is_empty() { share } else { format!("  ({share})") };
        // Writing to a String cannot fail.
        let _ = writeln!(out, "{} {}{share}", word(test.outcome), test.id);
        for fault in test.faults() {
            let _ = writeln!(out, "        {fault}");
        }
    }
    for diagnosed in &report.diagnoses {
        let _ = writeln!(out, "diagnosis of {}: {}", diagnosed.of(), diagnosed.words);
    }
    let _ = writeln!(out, "{}", words::toned(tone(report.outcome), &report.headline()));
    out
}
