use std::{fmt::Write as _, path::PathBuf};

use anyhow::{Context, bail};
use bench_identification::{FlightIdentification, identify_flights};
use bench_rig::Rig;
use clap::{Args, Subcommand};

use crate::{commands::tracks::Selection, exit::Exit, files, words};

/// Find the rig's numbers and their tolerances from measurements
#[derive(Args)]
pub struct Arguments {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    Flight(FlightArguments),
}

/// From flights that are known to be nominal
#[derive(Args)]
#[command(after_help = "Examples:
  bench identify flight --rig my-quad.toml nominal-*.mcap -o my-quad-identified.toml
  bench identify flight --rig rigs/crazyflie-2.toml --above 0.3 --without readback normal-*.mcap -o normal.toml

The rig's tolerances are the priors: a number without one is taken as exact. What the flights do not tell is said
and left as it was. Then `bench diagnose --rig my-quad-identified.toml ...` holds other flights against these, with
the same --above and --without. docs/identify.md has the method.")]
struct FlightArguments {
    #[command(flatten)]
    selection: Selection,
    /// Rig to begin with: its numbers and tolerances are what is known before the flights
    #[arg(long)]
    rig: PathBuf,
    /// Rig to write, the airframe in it
    #[arg(short, long)]
    output: PathBuf,
    /// Replace an existing output
    #[arg(long)]
    force: bool,
    /// Print as JSON (schema bench.identification/1)
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    match &arguments.what {
        What::Flight(arguments) => flight(arguments),
    }
}

fn flight(arguments: &FlightArguments) -> anyhow::Result<Exit> {
    if arguments.output.exists() && !arguments.force {
        bail!("{} exists; name another output or add --force", arguments.output.display());
    }
    let rig = files::rig(&arguments.rig)?;
    let (tracks, refused) = arguments.selection.tracks(&rig, |_, _| {})?;
    let found = identify_flights(&tracks, &rig);
    let mut found = found.with_context(|| match refused.as_slice() {
        [] => "nothing identified, nothing written".to_owned(),
        refused => format!("nothing identified, nothing written; not used:\n{}", refused.join("\n")),
    })?;
    found.warnings = refused;
    if let Some(name) = arguments.output.file_stem() {
        found.rig.name = name.to_string_lossy().into_owned();
    }
    let text = file(&found, arguments);
    // What is written must be a rig.
    Rig::read(&arguments.output, &text).context("what was identified makes no rig; nothing written")?;
    if let Some(folder) = arguments.output.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        std::fs::create_dir_all(folder)
            .with_context(|| format!("cannot make the folder {}", folder.display()))?;
    }
    std::fs::write(&arguments.output, text)
        .with_context(|| format!("cannot write {}", arguments.output.display()))?;
    if arguments.json {
        words::print_json(&found)?;
    } else {
        words::print(&in_words(&found, arguments))?;
    }
    Ok(Exit::Done)
}

/// The rig file: how it was made, then the rig.
fn file(found: &FlightIdentification, arguments: &FlightArguments) -> String {
    let mut out = format!(
        "# {}: identified by `bench identify flight{}` from {},\n# with {} as prior. A sigma covers the spread between flights.\n",
        found.rig.name,
        arguments.selection.options(),
        words::count(found.flights.len() as u64, "flight"),
        arguments.rig.display(),
    );
    let left: Vec<_> = found.numbers.iter().filter(|n| !n.identified).map(|n| n.name).collect();
    if !left.is_empty() {
        let _ = writeln!(out, "# Not told by these flights, left as in the prior: {}.", left.join(", "));
    }
    out + &found.rig.to_toml()
}

fn in_words(found: &FlightIdentification, arguments: &FlightArguments) -> String {
    let mut out = String::new();
    let sightings: usize = found.flights.iter().map(|(_, n)| n).sum();
    let _ = writeln!(
        out,
        "{}: from {} with {}\n",
        arguments.output.display(),
        words::count(found.flights.len() as u64, "flight"),
        words::count(sightings as u64, "sighting"),
    );
    let _ = writeln!(out, "  {:<26} {:>24} {:>24}  between flights", "", "before", "after");
    for number in &found.numbers {
        let pair = |(value, sigma): (f64, f64)| format!("{} ± {}", short(value), short(sigma));
        let (after, spread) = if number.identified {
            (pair(number.after), short(number.between_flights))
        } else {
            ("not told, left".to_owned(), String::new())
        };
        let _ = writeln!(out, "  {:<26} {:>24} {:>24}  {spread}", number.name, pair(number.before), after);
    }
    let [before, after] = found.tracker_noise_m;
    let _ = writeln!(out, "\n  tracker noise {} m, was {} m", short(after), short(before));
    let _ = writeln!(
        out,
        "  what acts besides: {} m/s^2 per root Hz at random and {} m/s^2 for {} s at a time; {} m/s^2 from flight to flight, {} m/s^2 in a minute",
        short(found.white_m_s2_per_root_hz),
        short(found.turbulence_m_s2),
        short(found.turbulence_time_s),
        short(found.trim_m_s2),
        short(found.trim_walk_m_s2_per_root_s * 60_f64.sqrt()),
    );
    let (probability, wrong_m) = found.outliers;
    let _ = writeln!(
        out,
        "  exposures to {} s; one sighting in {:.0} wrong by {} m",
        short(found.timing_s),
        probability.recip(),
        short(wrong_m),
    );
    let _ = writeln!(
        out,
        "  noise differs from flight to flight by a factor of {:.2}",
        found.noise_spread_ln.exp()
    );
    for warning in &found.warnings {
        let _ = writeln!(out, "warning: {warning}");
    }
    out
}

/// Four digits, as plain as they can be.
fn short(x: f64) -> String {
    if x == 0.0 {
        return "0".to_owned();
    }
    let digits = 3 - x.abs().log10().floor() as i32;
    match digits {
        0..=7 => format!("{x:.*}", digits as usize),
        i32::MIN..0 => format!("{x:.0}"),
        _ => format!("{x:.3e}"),
    }
}
