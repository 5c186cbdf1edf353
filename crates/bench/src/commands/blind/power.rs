use std::{fmt::Write as _, path::PathBuf};

use bench_blind::{FormPower, Group, Power, PowerPlan, SeenFrom, THRESHOLDS};
use clap::Args;

use crate::{
    arguments::{Json, RigArgument},
    exit::Exit,
    files,
    progress::Progress,
    words,
};

/// Say what a rig's flights can show: how large an effect must be, what is taken for what, which mission helps
#[derive(Args)]
#[command(after_help = "Examples:
  bench blind power --rig virtual --missions blind
  bench blind power --missions hop steps --effect rotor-lag --effect gusts
  bench blind power --json > power.json

Flies every form of every effect in seven sizes on drawn airframes, with the blind check's own
physics; it takes minutes. d' of 2 can be suspected, d' of 5 is plain. Sizes are those from
which the median airframe shows it, and the range over airframes. docs/blind.md has how d' is
computed.")]
pub struct PowerArguments {
    #[command(flatten)]
    rig: RigArgument,
    /// Missions, flown in turn: files, names of built-in ones, or folders of either in the order of their names
    #[arg(long, num_args = 1.., default_value = files::BLIND_MISSIONS)]
    missions: Vec<PathBuf>,
    /// Only this effect; may be repeated [default: all]
    #[arg(long = "effect", value_name = "NAME")]
    effects: Vec<String>,
    /// How many airframes to draw within the rig's tolerances
    #[arg(long, default_value_t = 4)]
    draws: usize,
    /// Seed of everything random
    #[arg(long, default_value_t = 0)]
    seed: u64,
    #[command(flatten)]
    json: Json,
}

pub fn power(arguments: PowerArguments) -> anyhow::Result<Exit> {
    let plan = PowerPlan {
        rig: arguments.rig.load()?,
        missions: files::missions(&arguments.missions)?,
        effects: arguments.effects,
        draws: arguments.draws,
        seed: arguments.seed,
    };
    let progress = Progress::of("blind power");
    progress.begin("flying", plan.flights() as f64, "flights");
    let power = bench_blind::power(&plan, |done| progress.at(done as f64));
    drop(progress);
    let power = power?;
    if arguments.json.json {
        words::print_json(&power)?;
    } else {
        words::print(&in_words(&power))?;
    }
    Ok(Exit::Done)
}

fn in_words(power: &Power) -> String {
    let mut out = format!(
        "{} of rig {}, {} drawn\n\n",
        words::count(power.missions.len() as u64, "flight"),
        power.rig,
        words::count(power.draws as u64, "airframe"),
    );
    let [suspected, plain] = THRESHOLDS;
    // Writing to a String cannot fail.
    let _ = writeln!(
        out,
        "{:<22} {:<16} {:>24} {:>24}  {:<16} size",
        "effect",
        "form",
        format!("d' {suspected} from"),
        format!("d' {plain} from"),
        "best mission"
    );
    let mut last = "";
    for form in &power.forms {
        let name = if form.effect == last { "" } else { form.effect.as_str() };
        last = &form.effect;
        let [a, b] = [0, 1].map(|i| form.seen_from.get(i).map_or(String::new(), |seen| from(form, seen)));
        let best = form.best_mission.map_or("-".to_owned(), |i| mission(power, i));
        let _ = writeln!(out, "{name:<22} {:<16} {a:>24} {b:>24}  {best:<16} {}", form.form, form.size_of);
    }
    out += "\nNot told apart by these flights (responses with a cosine above 0.8)\n";
    if power.groups.is_empty() {
        out += "  none\n";
    }
    for group in &power.groups {
        let _ = writeln!(out, "  {}", in_one_line(power, group));
    }
    out
}

fn in_one_line(power: &Power, group: &Group) -> String {
    format!(
        "{}: {:.2} or more; the hardest two differ by d' {:.1} where each is plain, by {:.1} in {} alone",
        group.effects.join(", "),
        group.cosine,
        group.apart_with_all,
        group.apart,
        mission(power, group.best_mission),
    )
}

/// A mission with its place, for the same may be flown twice.
fn mission(power: &Power, index: usize) -> String {
    format!("{} {}", index + 1, power.missions.get(index).map_or("", String::as_str))
}

/// `0.012 (0.009 to 0.02)`.
fn from(form: &FormPower, seen: &SeenFrom) -> String {
    let strongest = form.curve.last().map_or(0.0, |point| point.size);
    match (seen.size, seen.low, seen.high) {
        (Some(size), Some(low), Some(high)) => {
            let sign = match (seen.or_weaker, form.stronger_when_small) {
                (false, _) => "",
                (true, false) => "<=",
                (true, true) => ">=",
            };
            format!("{sign}{} ({} to {})", short(size), short(low), short(high))
        }
        (Some(size), Some(low), None) => format!("{} ({} to none)", short(size), short(low)),
        _ => format!("not at {}", short(strongest)),
    }
}

/// Two significant digits.
fn short(x: f64) -> String {
    if x <= 0.0 {
        return "0".to_owned();
    }
    let digits = (1 - x.log10().floor() as i32).max(0) as usize;
    format!("{x:.digits$}")
}

#[cfg(test)]
mod tests {
    use super::short;

    #[test]
    fn sizes_have_two_digits() {
        assert_eq!([0.0123, 0.5, 1.0, 12.34, 0.0].map(short), ["0.012", "0.50", "1.0", "12", "0"]);
    }
}
