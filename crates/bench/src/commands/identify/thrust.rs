//! Gain and offset from a balance.

use std::fmt::Write as _;

use anyhow::Context;
use bench_identification::{ThrustIdentification, ThrustOptions, identify_thrust};
use bench_rig::Rig;
use clap::Args;

use super::{Balance, grams, refused_in_words};
use crate::{
    exit::Exit,
    model_page,
    words::{self, short, with_sigma},
};

/// Gain and offset from readings of throttle and thrust on a balance
#[derive(Args)]
#[command(after_help = "Examples:
  bench rigs copy balance/hubsan-q4-thrust
  bench identify thrust hubsan-q4-thrust.csv --rig virtual -o with-thrust.toml
  bench identify thrust readings.csv --rig my-quad.toml --from 1.2 -o my-quad-2.toml

The table has the columns throttle_v (or throttle_fraction, throttle_count, as the rig's),
reading_g or reading_n, and battery where several levels were read. The paper's rig hangs the
airframe from the balance: readings at rest tell the weight to take off. Next comes `bench
identify ground-effect` with the rig that this one writes. docs/model-development.md has the way
of working and the equations.")]
pub struct ThrustArguments {
    #[command(flatten)]
    balance: Balance,
    /// Lowest throttle of the line
    #[arg(long, value_name = "THROTTLE")]
    from: Option<f64>,
    /// Highest throttle of the line
    #[arg(long, value_name = "THROTTLE")]
    to: Option<f64>,
}

pub fn run(arguments: &ThrustArguments) -> anyhow::Result<Exit> {
    let balance = &arguments.balance;
    let (rig, readings) = balance.begin()?;
    let options = ThrustOptions { from: arguments.from, to: arguments.to, ..balance.options()? };
    let found = identify_thrust(&readings, &rig, &options).with_context(|| balance.nothing())?;
    let levels = match found.levels.as_slice() {
        [_] => String::new(),
        levels => format!(" at {} battery levels", levels.len()),
    };
    let head = format!(
        "gain and offset by `bench identify thrust` from {} of {}{levels},\n# the rest from {}. A sigma covers the spread between levels.",
        words::count(found.levels.iter().map(|level| level.readings as u64).sum(), "reading"),
        balance.readings.display(),
        balance.rig.display(),
    );
    balance.end(
        (&found.rig, &head),
        &found,
        || in_words(&found, balance, &rig),
        || model_page::thrust(&found, &rig),
    )
}

fn in_words(found: &ThrustIdentification, balance: &Balance, rig: &Rig) -> String {
    let unit = found.throttle_unit;
    let mut out = format!("{}: thrust from {}\n\n", balance.output.display(), balance.readings.display());
    // Writing to a String cannot fail, here and below.
    let _ = writeln!(out, "  {:<22} {:>20} {:>20}   95 % of the mean over levels", "", "before", "after");
    let units = [format!("N/{unit}"), unit.to_owned(), unit.to_owned()];
    for (number, unit) in found.numbers.iter().zip(units) {
        let _ = writeln!(
            out,
            "  {:<22} {:>20} {:>20}   {} to {}",
            format!("{}, {unit}", number.name),
            with_sigma(number.before),
            with_sigma(number.after),
            short(number.interval_95[0]),
            short(number.interval_95[1])
        );
    }
    out.push('\n');
    for level in &found.levels {
        let name = if level.name.is_empty() { "all".to_owned() } else { level.name.clone() };
        let _ = write!(
            out,
            "  battery {name}: gain {}, offset {}, hovers at {}; {:.1} g at rest, {} on the line",
            with_sigma(level.gain_n_per_unit),
            with_sigma(level.offset),
            with_sigma(level.hover),
            level.rest_g,
            words::count(level.readings as u64, "reading")
        );
        if level.thrust_change.1 > 0.0 {
            let (change, sigma) = level.thrust_change;
            let _ = write!(out, "; {:+.1} ± {:.1} % of the weight at hover", 100.0 * change, 100.0 * sigma);
        }
        out.push('\n');
        if let Some([from, to]) = level.dead_zone {
            let _ = writeln!(out, "    thrust begins between {} and {} {unit}", short(from), short(to));
        }
        if let Some(([from, to], thrust_n)) = level.saturation {
            let _ = writeln!(
                out,
                "    saturates between {} and {} {unit} at {:.1} g",
                short(from),
                short(to),
                grams(thrust_n)
            );
        }
    }
    if let Some(differ) = found.levels_differ {
        let _ = writeln!(
            out,
            "  levels: {:.1} % of the weight apart at hover, p {}",
            100.0 * differ.of_weight,
            words::probability(differ.p)
        );
    }
    let line = &found.linearity;
    let _ = writeln!(
        out,
        "  {}: curvature {} (p {}){}; a parabola would be {:.2} % of the weight off the line at most",
        if line.linear { "linear" } else { "not linear" },
        with_sigma(line.curvature),
        words::probability(line.curvature_p),
        line.lack_of_fit_p.map_or_else(String::new, |p| format!(
            ", lack of fit against repeats p {}",
            words::probability(p)
        )),
        100.0 * line.departure_of_weight
    );
    let _ = writeln!(
        out,
        "  a reading is good to {:.2} g (one sigma) in steps of {} g; the rig's weight is {:.1} g",
        grams(found.reading_sigma_n),
        short(grams(found.resolution_n)),
        1000.0 * rig.airframe.mass_kg.value
    );
    if !found.refused.is_empty() {
        out.push_str("\nnot on the line:\n");
        refused_in_words(&mut out, &found.refused);
    }
    for warning in &found.warnings {
        let _ = writeln!(out, "warning: {warning}");
    }
    out
}
