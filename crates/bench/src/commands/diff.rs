use std::path::{Path, PathBuf};

use bench_recording::diff::{
    Align, DiffOptions, DiffReport, ToleranceKey, Tolerances, Verdict, diff, html_verdict, render_html,
    render_text,
};
use clap::{Args, ValueEnum};

use crate::{
    arguments::{Force, Json, Page},
    exit::Exit,
    files::{self, Form, Outputs},
    repeats, words,
};

/// Compare two recordings, field by field
#[derive(Args)]
#[command(after_help = "Examples:
  bench diff sim.mcap lab.mcap
  bench diff sim.mcap lab.mcap --html diff.html --abs position_m.z=0.02
  bench diff sim.mcap sim-again.mcap --exact
  bench diff sim.mcap lab.mcap --floor lab-1.mcap lab-2.mcap lab-3.mcap

Tolerances are derived from the rig and mission attached to both recordings: what the rig
resolves, and how far simulations of them scatter (kept in the cache). Flags and files win over
them.

Exit code 0: the same or within tolerance; 1: different; 2: cannot be compared. docs/diff.md
tells the rules.")]
pub struct Arguments {
    /// First recording
    a: PathBuf,
    /// Second recording
    b: PathBuf,
    /// How the clocks are brought together
    #[arg(long, default_value = "auto")]
    align: AlignChoice,
    /// Tolerance file
    #[arg(long, value_name = "FILE")]
    tolerances: Option<PathBuf>,
    /// Absolute tolerance of a field, in its unit; may be repeated
    #[arg(long, value_name = "FIELD=X")]
    abs: Vec<String>,
    /// Relative tolerance of a field; may be repeated
    #[arg(long, value_name = "FIELD=X")]
    rel: Vec<String>,
    /// Time tolerance of a field, s; may be repeated
    #[arg(long, value_name = "FIELD=X")]
    time: Vec<String>,
    /// Leave a field out of the verdict; may be repeated
    #[arg(long, value_name = "FIELD")]
    ignore: Vec<String>,
    /// Repeats of one flight: what they differ by is tolerated
    #[arg(long, num_args = 2.., value_name = "RECORDING")]
    floor: Vec<PathBuf>,
    /// No tolerance: whatever is not the same is different
    #[arg(long, conflicts_with_all = ["tolerances", "abs", "rel", "time", "ignore", "floor"])]
    exact: bool,
    /// Show every field, not only what matters
    #[arg(long)]
    all: bool,
    #[command(flatten)]
    page: Page,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    json: Json,
}

#[derive(Clone, Copy, ValueEnum)]
enum AlignChoice {
    /// None for two simulations that start together, else by phase, else by clock
    Auto,
    /// Equal times belong together
    None,
    /// The starts of the mission's phases belong together
    Phase,
    /// Offset and drift estimated from a shared signal
    Clock,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    let report = report(arguments)?;
    if arguments.json.json {
        words::print_json(&report)?;
    } else {
        words::print(&words::headed(html_verdict(&report).tone, &render_text(&report, arguments.all)))?;
    }
    Ok(match report.verdict() {
        Verdict::Same | Verdict::WithinTolerance => Exit::Done,
        Verdict::NotComparable => Exit::BadInput,
        _ => Exit::CheckFailed,
    })
}

/// The comparison; its page is written.
pub fn report(arguments: &Arguments) -> anyhow::Result<DiffReport> {
    Outputs::new(arguments.force.force)
        .and(arguments.page.html.as_deref(), Form::Html)
        .from([arguments.a.as_path(), arguments.b.as_path()])
        .check()?;
    let options = DiffOptions {
        align: match arguments.align {
            AlignChoice::Auto => Align::Auto,
            AlignChoice::None => Align::None,
            AlignChoice::Phase => Align::Phase,
            AlignChoice::Clock => Align::Clock,
        },
        tolerances: tolerances(arguments)?,
        floor: arguments.floor.clone(),
        exact: arguments.exact,
        ..DiffOptions::default()
    };
    let report = compared(&arguments.a, &arguments.b, options)?;
    if let Some(page) = &arguments.page.html {
        files::write_and_say(page, &render_html(&report, &words::command()))?;
    }
    Ok(report)
}

/// Two recordings compared, with tolerances from the rig and mission that both carry unless the options have others.
pub fn compared(a: &Path, b: &Path, mut options: DiffOptions) -> anyhow::Result<DiffReport> {
    let mut underived = None;
    if !options.exact && options.floor.is_empty() {
        match repeats::derived(a, b)? {
            Ok(derived) => options.derived = Some(derived),
            Err(why) => underived = Some(why),
        }
    }
    let mut report = diff(a, b, &options)?;
    if let Some(why) = underived {
        report.notes.insert(0, format!("tolerances are the built-in ones, by unit: {why}"));
    }
    Ok(report)
}

fn tolerances(arguments: &Arguments) -> anyhow::Result<Tolerances> {
    let mut tolerances = match &arguments.tolerances {
        Some(file) => Tolerances::load(file)?,
        None => Tolerances::default(),
    };
    let flags = [
        (ToleranceKey::Absolute, &arguments.abs),
        (ToleranceKey::Relative, &arguments.rel),
        (ToleranceKey::Time, &arguments.time),
    ];
    for (key, texts) in flags {
        for text in texts {
            tolerances.add_flag(key, text)?;
        }
    }
    for pattern in &arguments.ignore {
        tolerances.ignore(pattern)?;
    }
    Ok(tolerances)
}
