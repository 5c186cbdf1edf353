use std::{fmt::Write as _, path::PathBuf};

use anyhow::bail;
use bench_page::digits;
use bench_plant::effects::LIBRARY;
use bench_rig::Rig;
use bench_tuning::{Achieved, Case, Comparison, Goals, Share, compare};
use clap::Args;

use crate::{
    arguments::{Force, Json},
    exit::Exit,
    files::{self, Form, Outputs},
    progress::Progress,
    words,
};

/// Hold control laws against one another, over the tolerances and every effect
#[derive(Args)]
#[command(after_help = "Examples:
  bench laws virtual virtual-model
  bench laws virtual virtual-tuned virtual-model -o laws.md
  bench laws virtual virtual-model --effects rotor-lag --json

The rigs differ in name and [control] alone. Each case draws airframes from the first rig's
tolerances, with an effect of the library whose size is drawn from its prior, and flies each of
them under every law: launch, hold 0.4 m, land; launch, hover at 3 cm.")]
pub struct Arguments {
    /// Rigs whose laws are compared: files, or names of built-in ones (`bench rigs` lists them)
    #[arg(required = true)]
    rigs: Vec<PathBuf>,
    /// Airframes drawn for each case
    #[arg(long, default_value_t = 100)]
    models: usize,
    /// Effects to fly besides the tolerances alone [default: all of the library]
    #[arg(long, value_delimiter = ',', value_name = "NAMES")]
    effects: Option<Vec<String>>,
    /// Seed of everything random
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Write the comparison as Markdown
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    json: Json,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    if arguments.models == 0 {
        bail!("--models 0: nothing would be flown; at least 1");
    }
    Outputs::new(arguments.force.force)
        .and(arguments.output.as_deref(), Form::Markdown)
        .from(arguments.rigs.iter().map(PathBuf::as_path))
        .check()?;
    let rigs = arguments.rigs.iter().map(|path| files::rig(path)).collect::<anyhow::Result<Vec<Rig>>>()?;
    let effects: Vec<&str> = match &arguments.effects {
        Some(names) => names.iter().map(String::as_str).collect(),
        None => LIBRARY.iter().map(|spec| spec.name).collect(),
    };
    let progress = Progress::of("laws");
    progress.begin("flying", (1 + effects.len()) as f64, "cases");
    let tell = |done: usize, _all: usize| progress.at(done as f64);
    let found = compare(&rigs, Goals::PAPER, &effects, arguments.models, arguments.seed, &tell)?;
    drop(progress);
    if let Some(file) = &arguments.output {
        files::write_and_say(file, &markdown(&found, arguments))?;
    }
    if arguments.json.json {
        words::print_json(&found)?;
    } else {
        words::print(&in_words(&found))?;
    }
    Ok(Exit::Done)
}

fn name(case: &Case) -> &str {
    case.effect.unwrap_or("tolerances alone")
}

fn in_words(found: &Comparison) -> String {
    let mut out = format!(
        "{} a case; held 0.4 m / hovered at 3 cm / landed softly, %\n\n",
        words::count(found.models as u64, "airframe")
    );
    let _ = write!(out, "{:<24}", "");
    for law in &found.laws {
        let _ = write!(out, "{law:>20}");
    }
    for case in &found.cases {
        let _ = write!(out, "\n{:<24}", name(case));
        for achieved in &case.achieved {
            let [held, hovered, landed] = [achieved.held, achieved.hovered, achieved.landed].map(percent);
            let told = format!("{held} / {hovered} / {landed}");
            let _ = write!(out, "{told:>20}");
        }
    }
    out + "\n"
}

fn percent(share: Share) -> String {
    format!("{:.0}", 100.0 * share.value())
}

/// A table's title, and what it tells of a law.
type Column = (&'static str, fn(&Achieved) -> String);

fn markdown(found: &Comparison, arguments: &Arguments) -> String {
    let rigs: Vec<String> = arguments.rigs.iter().map(|path| path.display().to_string()).collect();
    let goals = &found.goals;
    let mut out = format!(
        "# Control laws compared\n\nMade by `bench laws {} --models {} --seed {} -o FILE`. What the laws are: [control](../control.md).\n\n\
         Each case draws {} airframes from the first rig's tolerances, adds the effect with a size from its prior, and flies each under every\n\
         law: launch, hold {} m, land at 0.15 m/s; launch, descend, hover at {} cm. *Held*: within {} cm RMS of the true altitude over 10 s.\n\
         *Hovered*: within {} cm RMS over 10 s without touching the ground. *Landed*: touched down below {} m/s. The airframe, effect and\n\
         noise of a row are the same for every law.\n",
        rigs.join(" "),
        found.models,
        found.seed,
        found.models,
        digits(goals.high_m),
        digits(100.0 * goals.low_m),
        digits(100.0 * goals.high_rms_m),
        digits(100.0 * goals.low_rms_m),
        digits(goals.touch_down_m_s),
    );
    if let Some(alone) = found.cases.first() {
        out.push_str("\n## Within the tolerances\nIn brackets: interval of 95 % (Clopper and Pearson).\n\n| law | held | median RMS there, cm | hovered | median RMS there, cm | landed | touch-down, m/s: median, 95 % below |\n|---|---|---|---|---|---|---|\n");
        for (law, a) in found.laws.iter().zip(&alone.achieved) {
            let _ = writeln!(
                out,
                "| {law} | {} | {} | {} | {} | {} | {}, {} |",
                told(a.held),
                centimetres(a.held_rms_m),
                told(a.hovered),
                centimetres(a.hovered_rms_m),
                told(a.landed),
                speed(a.touch_down_m_s),
                speed(a.touch_down_p95_m_s)
            );
        }
    }
    let columns: [Column; 3] = [
        ("Held at the altitude of the paper, % (median RMS, cm)", |a| {
            format!("{} ({})", percent(a.held), centimetres(a.held_rms_m))
        }),
        ("Hovered within the ground effect, % (median RMS, cm)", |a| {
            format!("{} ({})", percent(a.hovered), centimetres(a.hovered_rms_m))
        }),
        ("Landed softly, % (median touch-down, m/s)", |a| {
            format!("{} ({})", percent(a.landed), speed(a.touch_down_m_s))
        }),
    ];
    for (title, tell) in columns {
        let _ = writeln!(out, "\n## {title}\n\n| effect | {} |", found.laws.join(" | "));
        let _ = writeln!(out, "|---|{}", "---|".repeat(found.laws.len()));
        for case in &found.cases {
            let cells: Vec<String> = case.achieved.iter().map(tell).collect();
            let _ = writeln!(out, "| {} | {} |", name(case), cells.join(" | "));
        }
    }
    out.push_str("\n`-`: half of the flights or more did not get so far: they touched the ground, left the bench's limits, or did not stand in the end.\n");
    out
}

fn told(share: Share) -> String {
    format!("{} % ({:.1} to {:.1} %)", digits(100.0 * share.value()), 100.0 * share.low, 100.0 * share.high)
}

fn centimetres(m: f64) -> String {
    digits(100.0 * m)
}

fn speed(m_s: f64) -> String {
    if m_s.is_finite() { format!("{m_s:.2}") } else { "-".to_owned() }
}
