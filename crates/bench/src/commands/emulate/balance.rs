//! A balance from which the airframe hangs.

use std::path::PathBuf;

use anyhow::bail;
use bench_plant::effects::parse_effect;
use clap::Args;

use crate::{
    arguments::{Force, RigArgument},
    balance::Plan,
    exit::Exit,
    files::{self, Form, Outputs},
    words,
};

/// Readings of a balance from which a rig's airframe hangs, as CSV
#[derive(Args)]
#[command(after_help = "Examples:
  bench emulate balance --effect battery-discharge:loss_per_hover_minute=0.01 -o thrust.csv
  bench emulate balance --ground-effect -o ground.csv
  bench emulate balance --throttles 0,1.2,1.5,1.8,2.1 --level full:0 --repeats 5 --noise-g 0.2

The rig's airframe is held still, so that its effects act with a speed of zero: for trying
`bench identify thrust` and `bench identify ground-effect`. Throttles, altitudes and levels are
chosen by the rig where none are given.")]
pub struct Balance {
    #[command(flatten)]
    rig: RigArgument,
    /// Add an effect to the rig: NAME:param=value,...; may be repeated
    #[arg(long = "effect", value_name = "NAME:PARAM=VALUE")]
    effects: Vec<String>,
    /// At static altitudes about the ground effect, instead of far from any surface
    #[arg(long)]
    ground_effect: bool,
    /// Throttles, in the rig's unit
    #[arg(long, value_name = "A,B,...", value_delimiter = ',')]
    throttles: Vec<f64>,
    /// Altitudes, mm
    #[arg(long, value_name = "A,B,...", value_delimiter = ',', requires = "ground_effect")]
    altitudes_mm: Vec<f64>,
    /// A battery level: its name and the minutes of hover drawn before; may be repeated
    #[arg(long = "level", value_name = "NAME:MINUTES")]
    levels: Vec<String>,
    /// Readings at each throttle and altitude
    #[arg(long)]
    repeats: Option<usize>,
    /// What the balance carries at rest, g
    #[arg(long)]
    hanging_g: Option<f64>,
    /// One sigma of a reading before rounding, g
    #[arg(long)]
    noise_g: Option<f64>,
    /// Share of readings that are off by up to 5 g
    #[arg(long)]
    outliers: Option<f64>,
    /// Decimals of a reading in g
    #[arg(long, value_parser = clap::value_parser!(u8).range(0..=6))]
    decimals: Option<u8>,
    /// Seed of noise and outliers
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// File to write instead of standard output
    #[arg(short, long)]
    output: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
}

pub fn run(arguments: &Balance) -> anyhow::Result<Exit> {
    Outputs::new(arguments.force.force).and(arguments.output.as_deref(), Form::Csv).check()?;
    let mut rig = arguments.rig.load()?;
    for text in &arguments.effects {
        rig.effects.push(parse_effect(text)?);
    }
    let mut plan = if arguments.ground_effect { Plan::ground(&rig) } else { Plan::thrust(&rig) };
    plan.seed = arguments.seed;
    if !arguments.throttles.is_empty() {
        plan.throttles.clone_from(&arguments.throttles);
    }
    if !arguments.altitudes_mm.is_empty() {
        plan.altitudes_mm.clone_from(&arguments.altitudes_mm);
    }
    if !arguments.levels.is_empty() {
        plan.levels = arguments.levels.iter().map(|text| level(text)).collect::<Result<_, _>>()?;
    }
    let number = |name: &str, given: Option<f64>, usual: f64, most: f64| match given {
        Some(x) if !(0.0..=most).contains(&x) => bail!("{name} must be from 0 to {most}, not {x}"),
        given => Ok(given.unwrap_or(usual)),
    };
    plan.repeats = arguments.repeats.unwrap_or(plan.repeats);
    plan.hanging_g = number("--hanging-g", arguments.hanging_g, plan.hanging_g, 1e6)?;
    plan.noise_g = number("--noise-g", arguments.noise_g, plan.noise_g, 1e6)?;
    plan.outliers = number("--outliers", arguments.outliers, plan.outliers, 1.0)?;
    plan.decimals = arguments.decimals.map_or(plan.decimals, usize::from);
    if plan.throttles.iter().chain(&plan.altitudes_mm).any(|x| !x.is_finite()) {
        bail!("throttles and altitudes must be finite numbers");
    }
    let text = format!("# {}\n{}", words::command(), plan.readings(&rig)?);
    match &arguments.output {
        Some(output) => {
            files::write_and_say(output, &text)?;
        }
        None => words::print(&text)?,
    }
    Ok(Exit::Done)
}

fn level(text: &str) -> anyhow::Result<(String, f64)> {
    let (name, minutes) = text.split_once(':').unwrap_or((text, "0"));
    match minutes.parse() {
        Ok(minutes) if (0.0..=600.0).contains(&minutes) && !name.is_empty() && !name.contains(',') => {
            Ok((name.to_owned(), minutes))
        }
        _ => bail!("--level {text:?}: expected NAME:MINUTES, such as half:3, with 0 to 600 minutes of hover"),
    }
}
