//! The ground effect from a balance.

use std::fmt::Write as _;

use anyhow::Context;
use bench_identification::{GroundIdentification, identify_ground_effect};
use clap::Args;

use super::{Balance, grams, refused_in_words};
use crate::{
    exit::Exit,
    model_page,
    words::{self, short, with_sigma},
};

/// Boundary and multiplier of the ground effect from readings of thrust at static altitudes
#[derive(Args)]
#[command(after_help = "Examples:
  bench rigs copy balance/hubsan-q4-ground
  bench identify ground-effect hubsan-q4-ground.csv --rig with-thrust.toml -o with-ground.toml
  bench identify ground-effect ground.csv --rig my-quad-2.toml --with-shape -o my-quad-3.toml

The table has the columns throttle_v (or as the rig's), altitude_m (or _cm, _mm), reading_g or
reading_n, and battery where several levels were read. Each throttle gets a free thrust of its
own; some altitudes must lie above the effect. The linear law is held against the exponential
one and Cheeseman and Bennett's by their evidence. docs/model-development.md has the way of
working and the equations.")]
pub struct GroundArguments {
    #[command(flatten)]
    balance: Balance,
    /// Where the readings prefer another law than the linear one, add the exponential one to the rig as the effect
    /// ground-effect-shape
    #[arg(long)]
    with_shape: bool,
}

pub fn run(arguments: &GroundArguments) -> anyhow::Result<Exit> {
    let balance = &arguments.balance;
    let (rig, readings) = balance.begin()?;
    let found = identify_ground_effect(&readings, &rig, &balance.options()?, arguments.with_shape)
        .with_context(|| balance.nothing())?;
    let head = format!(
        "ground effect by `bench identify ground-effect` from {} of {},\n# the rest from {}.",
        words::count(found.points.iter().filter(|point| point.used).count() as u64, "reading"),
        balance.readings.display(),
        balance.rig.display(),
    );
    balance.end(
        (&found.rig, &head),
        &found,
        || in_words(&found, balance),
        || model_page::ground(&found, &rig),
    )
}

fn in_words(found: &GroundIdentification, balance: &Balance) -> String {
    let mut out =
        format!("{}: ground effect from {}\n\n", balance.output.display(), balance.readings.display());
    // Writing to a String cannot fail, here and below.
    let _ = writeln!(out, "  {:<26} {:>18} {:>18}   95 %", "", "before", "after");
    for (number, unit) in found.numbers.iter().zip(["", ", m"]) {
        let name = number.name.trim_end_matches("_m");
        let _ = writeln!(
            out,
            "  {:<26} {:>18} {:>18}   {} to {}",
            format!("{name}{unit}"),
            with_sigma(number.before),
            with_sigma(number.after),
            short(number.interval_95[0]),
            short(number.interval_95[1])
        );
    }
    out.push_str("\n  law, by evidence\n");
    for law in &found.laws {
        let _ = writeln!(
            out,
            "  {:<18} {:>5.1} %  {:+7.1} nats  at the ground {}, length {} m, leaves {:.2} g",
            law.law.name(),
            100.0 * law.probability,
            law.nats,
            with_sigma(law.multiplier),
            with_sigma(law.length_m),
            grams(law.rms_n)
        );
    }
    out.push('\n');
    for told in &found.throttles {
        let level = if told.level.is_empty() { String::new() } else { format!(", battery {}", told.level) };
        let _ = writeln!(
            out,
            "  throttle {}{level}: {} g far from the ground ({:.1} g by the rig), {} at it, {}",
            short(told.throttle),
            with_sigma((grams(told.free_thrust_n.0), grams(told.free_thrust_n.1))),
            grams(told.rig_thrust_n),
            with_sigma(told.multiplier),
            words::count(told.readings as u64, "reading")
        );
    }
    if let Some(p) = found.throttles_differ_p {
        let _ = writeln!(out, "  one multiplier for all throttles: p {}", words::probability(p));
    }
    let _ = writeln!(
        out,
        "  a reading is good to {:.2} g (one sigma) in steps of {} g",
        grams(found.reading_sigma_n),
        short(grams(found.resolution_n))
    );
    if !found.refused.is_empty() {
        out.push_str("\nnot used:\n");
        refused_in_words(&mut out, &found.refused);
    }
    for warning in &found.warnings {
        let _ = writeln!(out, "warning: {warning}");
    }
    out
}
