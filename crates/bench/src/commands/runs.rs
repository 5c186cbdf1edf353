use std::{
    fmt::Write as _,
    path::{Path, PathBuf},
};

use anyhow::{Context, bail};
use bench_station::{Filter, Log, Run, Trend};
use bench_suite::Measure;
use clap::Args;
use serde_json::json;

use crate::{
    arguments::{Force, Json},
    exit::Exit,
    files::{self, Form, Outputs},
    words::{self, short},
};

/// List the runs of a station, and how a figure of them drifts over the weeks
#[derive(Args)]
#[command(after_help = "Examples:
  bench runs --station lab/
  bench runs --station lab/ --outcome failed --since 2026-11-01
  bench runs --station lab/ --meta operator=Ada --mode sim --all
  bench runs --station lab/ --trend round_trip_p99
  bench runs --station lab/ --all --export runs.csv

`bench test`, `bench sim` and `bench hil` enter the runs with --station. A run that is listed as `begun` did not end, or is flown
at the moment. Dates are UTC.")]
pub struct Arguments {
    /// Folder of the station [default: what `BENCH_STATION` names]
    #[arg(long, value_name = "FOLDER", env = "BENCH_STATION")]
    station: Option<PathBuf>,
    /// Runs of this suite
    #[arg(long)]
    suite: Option<String>,
    /// Runs of tests whose name holds this text
    #[arg(long, value_name = "TEXT")]
    test: Option<String>,
    /// Runs on this rig
    #[arg(long)]
    rig: Option<String>,
    /// Runs of this mission
    #[arg(long)]
    mission: Option<String>,
    /// Runs in this mode
    #[arg(long)]
    mode: Option<String>,
    /// Runs that came to this: passed, failed, error or begun
    #[arg(long, value_parser = ["passed", "failed", "error", "begun"])]
    outcome: Option<String>,
    /// Runs from this day on, such as 2026-11-25, or an instant, such as 2026-11-25T14:00
    #[arg(long, value_name = "DATE")]
    since: Option<String>,
    /// Runs before this day or instant
    #[arg(long, value_name = "DATE")]
    before: Option<String>,
    /// Runs of which this was known; may be repeated
    #[arg(long = "meta", value_name = "KEY=VALUE")]
    meta: Vec<String>,
    /// How many, the latest first
    #[arg(long, value_name = "RUNS", default_value_t = 50)]
    limit: u64,
    /// All of them
    #[arg(long, conflicts_with = "limit")]
    all: bool,
    /// Show a figure week by week, such as peak, `settling_time` or `round_trip_p99`
    #[arg(long, value_name = "FIGURE")]
    trend: Option<String>,
    /// Write the runs with what was known of them and their figures as a table
    #[arg(long, value_name = "FILE.csv", conflicts_with = "trend")]
    export: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    json: Json,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    let Some(station) = &arguments.station else {
        bail!("which station? name its folder with --station, or by BENCH_STATION");
    };
    Outputs::new(arguments.force.force).and(arguments.export.as_deref(), Form::Csv).check()?;
    let log = Log::read(station)?;
    let filter = filter(arguments, &log)?;
    if let Some(figure) = &arguments.trend {
        return trend(arguments, &log, &filter, figure);
    }
    let limit = if arguments.all { None } else { Some(arguments.limit) };
    let (runs, all) = (log.runs(&filter, limit)?, log.count(&filter)?);
    if let Some(file) = &arguments.export {
        files::write_and_say(file, &csv(&log, &runs)?)?;
        return Ok(Exit::Done);
    }
    if arguments.json.json {
        let runs = runs.iter().map(|run| as_json(&log, run)).collect::<anyhow::Result<Vec<_>>>()?;
        words::print_json(
            &json!({ "schema": "bench.runs/1", "station": station, "count": all, "runs": runs }),
        )?;
    } else {
        words::print(&in_words(station, &runs, all))?;
    }
    Ok(Exit::Done)
}

fn filter(arguments: &Arguments, log: &Log) -> anyhow::Result<Filter> {
    let instant = |flag: &str, text: &Option<String>| -> anyhow::Result<Option<f64>> {
        let Some(text) = text else { return Ok(None) };
        let instant = log.instant(text)?;
        let expected = || {
            format!(
                "{flag} {text}: expected a day, such as 2026-11-25, or an instant, such as 2026-11-25T14:00"
            )
        };
        Ok(Some(instant.with_context(expected)?))
    };
    let mut meta = Vec::new();
    for text in &arguments.meta {
        let (key, value) = text
            .split_once('=')
            .with_context(|| format!("--meta {text}: expected KEY=VALUE, such as operator=Ada"))?;
        meta.push((key.to_owned(), value.to_owned()));
    }
    Ok(Filter {
        suite: arguments.suite.clone(),
        test: arguments.test.clone(),
        rig: arguments.rig.clone(),
        mission: arguments.mission.clone(),
        mode: arguments.mode.clone(),
        outcome: arguments.outcome.clone(),
        since_unix_s: instant("--since", &arguments.since)?,
        before_unix_s: instant("--before", &arguments.before)?,
        meta,
    })
}

fn in_words(station: &Path, runs: &[Run], all: u64) -> String {
    let mut out = String::new();
    for run in runs {
        let outcome = match run.outcome.as_str() {
            "passed" => words::passed(true),
            "failed" => words::passed(false),
            other => words::toned(bench_page::Tone::Odd, &format!("{other:<6}")),
        };
        // Writing to a String cannot fail, here and below.
        let _ = writeln!(
            out,
            "{:>6}  {}  {outcome}  {:<11} {} / {}, seed {}",
            run.id, run.started_utc, run.entry.mode, run.entry.suite, run.entry.test, run.entry.seed
        );
        if let Some(reason) = &run.reason {
            let _ = writeln!(out, "        {reason}");
        }
    }
    let shown = runs.len() as u64;
    let _ = match (shown, all) {
        (_, 0) => writeln!(out, "no run in {} is as asked", station.display()),
        (shown, all) if shown < all => {
            writeln!(
                out,
                "{} of {}; --all shows all of them",
                words::grouped(shown),
                words::count(all, "run")
            )
        }
        (_, all) => writeln!(out, "{}", words::count(all, "run")),
    };
    out
}

fn as_json(log: &Log, run: &Run) -> anyhow::Result<serde_json::Value> {
    Ok(json!({
        "id": run.id,
        "started_utc": run.started_utc,
        "started_unix_s": run.entry.started_unix_s,
        "took_s": run.took_s,
        "suite": run.entry.suite,
        "test": run.entry.test,
        "rig": run.entry.rig,
        "mission": run.entry.mission,
        "mode": run.entry.mode,
        "effects": run.entry.effects,
        "seed": run.entry.seed,
        "repeat": run.entry.repeat,
        "outcome": run.outcome,
        "reason": run.reason,
        "recording": run.recording,
        "sha256": run.sha256,
        "bench_version": run.entry.bench_version,
        "meta": log.meta(run.id)?,
        "figures": log.figures(run.id)?,
    }))
}

/// One row a run; a column for each thing that was known of any, and for each figure.
fn csv(log: &Log, runs: &[Run]) -> anyhow::Result<String> {
    let known = runs
        .iter()
        .map(|run| Ok((log.meta(run.id)?, log.figures(run.id)?)))
        .collect::<anyhow::Result<Vec<_>>>()?;
    let mut keys: Vec<&String> = known.iter().flat_map(|(meta, _)| meta.keys()).collect();
    keys.sort();
    keys.dedup();
    let mut names: Vec<&String> = known.iter().flat_map(|(_, figures)| figures.keys()).collect();
    names.sort();
    names.dedup();
    let mut writer = csv::Writer::from_writer(Vec::new());
    let head = [
        "run",
        "started_utc",
        "took_s",
        "suite",
        "test",
        "rig",
        "mission",
        "mode",
        "effects",
        "seed",
        "repeat",
        "outcome",
    ];
    let head = head
        .iter()
        .map(|name| (*name).to_owned())
        .chain(["reason", "recording", "sha256", "bench_version"].map(str::to_owned));
    writer.write_record(
        head.chain(keys.iter().map(|key| format!("meta_{key}")))
            .chain(names.iter().map(|name| with_unit(name))),
    )?;
    for (run, (meta, figures)) in runs.iter().zip(&known) {
        let row = [
            run.id.to_string(),
            run.started_utc.clone(),
            run.took_s.map(|took| format!("{took:.3}")).unwrap_or_default(),
            run.entry.suite.clone(),
            run.entry.test.clone(),
            run.entry.rig.clone(),
            run.entry.mission.clone(),
            run.entry.mode.clone(),
            run.entry.effects.clone(),
            run.entry.seed.to_string(),
            run.entry.repeat.to_string(),
            run.outcome.clone(),
            run.reason.clone().unwrap_or_default(),
            run.recording.clone(),
            run.sha256.clone().unwrap_or_default(),
            run.entry.bench_version.clone(),
        ];
        let meta = keys.iter().map(|key| meta.get(*key).cloned().unwrap_or_default());
        let figures = names.iter().map(|name| figures.get(*name).map(f64::to_string).unwrap_or_default());
        writer.write_record(row.into_iter().chain(meta).chain(figures))?;
    }
    let bytes = writer.into_inner().context("cannot write the table")?;
    Ok(String::from_utf8(bytes)?)
}

/// A figure's name with its unit, as keys end in it.
fn with_unit(name: &str) -> String {
    match unit(name) {
        "" => name.to_owned(),
        unit => format!("{name}_{unit}"),
    }
}

fn unit(name: &str) -> &'static str {
    Measure::named(name).map_or("", |measure| measure.unit)
}

fn trend(arguments: &Arguments, log: &Log, filter: &Filter, figure: &str) -> anyhow::Result<Exit> {
    let names = log.figure_names()?;
    if !names.iter().any(|name| name == figure) {
        bail!("no run has a figure {figure:?}; there is {}", names.join(", "));
    }
    let trend = log.trend(figure, filter)?;
    if arguments.json.json {
        let weeks: Vec<_> = trend
            .weeks
            .iter()
            .map(|week| json!({ "week": week.week, "runs": week.runs, "min": week.min, "median": week.median, "max": week.max }))
            .collect();
        let drift = trend
            .drift
            .map(|drift| json!({ "per_week": drift.per_week, "interval": drift.interval, "sure": drift.is_sure() }));
        words::print_json(&json!({
            "schema": "bench.trend/1", "figure": figure, "unit": unit(figure), "weeks": weeks, "drift": drift,
        }))?;
    } else {
        words::print(&trend_in_words(figure, &trend))?;
    }
    Ok(Exit::Done)
}

fn trend_in_words(figure: &str, trend: &Trend) -> String {
    let unit = unit(figure);
    let of = if unit.is_empty() { figure.to_owned() } else { format!("{figure}, {unit}") };
    let mut out = format!("{of}\n  week       runs       least      median    greatest\n");
    for week in &trend.weeks {
        // Writing to a String cannot fail, here and below.
        let _ = writeln!(
            out,
            "  {}  {:>5}  {:>10}  {:>10}  {:>10}",
            week.week,
            week.runs,
            short(week.min),
            short(week.median),
            short(week.max)
        );
    }
    let _ = match &trend.drift {
        None => writeln!(out, "too few runs to tell a drift, or all within a day"),
        Some(drift) => {
            let [low, high] = drift.interval.map(short);
            let verdict = if drift.is_sure() { "it drifts" } else { "no drift beyond what runs scatter" };
            writeln!(
                out,
                "{} {unit} a week, between {low} and {high} with 95 %: {verdict}",
                short(drift.per_week)
            )
        }
    };
    out
}
