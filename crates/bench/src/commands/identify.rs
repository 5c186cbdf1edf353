mod ground;
mod thrust;

use std::{fmt::Write as _, path::PathBuf};

use anyhow::Context;
use bench_identification::{Mounting, Readings, Refused, ThrustOptions};
use bench_rig::{GRAVITY_M_S2, Rig};
use clap::{Args, Subcommand, ValueEnum};
use serde::Serialize;

use crate::{
    arguments::{Force, Json, Page},
    commands::tracks::Selection,
    exit::Exit,
    files::{self, Form, Outputs},
    nominal::{self, NominalModel},
    progress::Progress,
    recorded::NominalRig,
    words,
    words::short,
};

/// Find the rig's numbers and their tolerances from measurements
#[derive(Args)]
pub struct Arguments {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    Thrust(thrust::ThrustArguments),
    GroundEffect(ground::GroundArguments),
    Flight(FlightArguments),
}

/// Readings of a balance, and what becomes of them.
#[derive(Args)]
struct Balance {
    /// Table of readings, CSV
    readings: PathBuf,
    /// Rig to begin with: a file, or the name of a built-in one (`bench rigs` lists them)
    #[arg(long, value_name = "RIG")]
    rig: PathBuf,
    /// Rig to write, the airframe in it
    #[arg(short, long)]
    output: PathBuf,
    /// How thrust comes to the balance; not asked where the column is called `thrust_g` or `thrust_n`
    #[arg(long, value_name = "HOW", default_value = "suspended")]
    mounting: MountingChoice,
    /// What the balance carries while the rotors rest, g, where no reading tells
    #[arg(long, value_name = "GRAMS")]
    hanging_g: Option<f64>,
    /// Step of the balance, g, where the readings' digits do not tell
    #[arg(long, value_name = "GRAMS")]
    resolution_g: Option<f64>,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    json: Json,
    #[command(flatten)]
    page: Page,
}

#[derive(Clone, Copy, ValueEnum)]
enum MountingChoice {
    /// It carries the hanging airframe: readings fall by the thrust (the paper's figure 8)
    Suspended,
    /// The same, zeroed with the airframe hanging at rest
    Tared,
    /// Thrust presses on it, zeroed at rest
    Pressing,
}

impl Balance {
    /// Rig and readings; an error where the output may not be written.
    fn begin(&self) -> anyhow::Result<(Rig, Readings)> {
        Outputs::new(self.force.force)
            .and(self.output.as_path(), Form::Toml)
            .and(self.page.html.as_deref(), Form::Html)
            .from([self.readings.as_path()])
            .check()?;
        let rig = files::rig(&self.rig)?;
        let readings = Readings::load(&self.readings, &rig).context("nothing identified, nothing written")?;
        Ok((rig, readings))
    }

    /// Where nothing was found.
    fn nothing(&self) -> String {
        format!("{}: nothing identified, nothing written", self.readings.display())
    }

    /// Writes the rig, with `head` saying how it was made, and tells what was found.
    fn end(
        &self,
        (rig, head): (&Rig, &str),
        found: &impl Serialize,
        in_words: impl FnOnce() -> String,
        page: impl FnOnce() -> String,
    ) -> anyhow::Result<Exit> {
        files::write_rig(&self.output, head, rig)?;
        if self.json.json {
            words::print_json(found)?;
        } else {
            words::print(&in_words())?;
        }
        if let Some(file) = &self.page.html {
            files::write_and_say(file, &page())?;
        }
        Ok(Exit::Done)
    }

    fn options(&self) -> anyhow::Result<ThrustOptions> {
        let newtons = |name: &str, grams: Option<f64>| -> anyhow::Result<Option<f64>> {
            match grams {
                Some(g) if !(g.is_finite() && g > 0.0) => anyhow::bail!("{name} must be above 0, not {g}"),
                _ => Ok(grams.map(|g| g * GRAVITY_M_S2 / 1000.0)),
            }
        };
        Ok(ThrustOptions {
            mounting: match self.mounting {
                MountingChoice::Suspended => Mounting::Suspended,
                MountingChoice::Tared => Mounting::Tared,
                MountingChoice::Pressing => Mounting::Pressing,
            },
            hanging_n: newtons("--hanging-g", self.hanging_g)?,
            resolution_n: newtons("--resolution-g", self.resolution_g)?,
            ..ThrustOptions::default()
        })
    }
}

/// Grams of thrust.
fn grams(newtons: f64) -> f64 {
    newtons * 1000.0 / GRAVITY_M_S2
}

/// Readings that are not used, in words; the many at rest in one line.
fn refused_in_words(out: &mut String, refused: &[Refused]) {
    const MOST: usize = 12;
    let (rest, others): (Vec<_>, Vec<_>) = refused.iter().partition(|one| one.why.ends_with("weight alone"));
    if !rest.is_empty() {
        let _ =
            writeln!(out, "  {} at rest, for the weight alone", words::count(rest.len() as u64, "reading"));
    }
    for one in others.iter().take(MOST) {
        let throttle = one.throttle.map_or_else(|| "none".to_owned(), short);
        let _ = writeln!(out, "  line {}, throttle {throttle}: {}", one.line, one.why);
    }
    if others.len() > MOST {
        let _ = writeln!(out, "  and {} more; --json has all", others.len() - MOST);
    }
}

/// From flights that are known to be nominal
#[derive(Args)]
#[command(after_help = "Examples:
  bench identify flight --rig my-quad.toml nominal-*.mcap -o my-quad-identified.toml
  bench identify flight --rig crazyflie-2 --above 0.3 --without readback cf-*.mcap -o cf.toml

The rig's tolerances are the priors: a number without one is taken as exact. What the flights do
not tell is said and left as it was. Then `bench diagnose --rig my-quad-identified.toml ...`
holds other flights against these, with the same --above and --without. docs/identify.md has the
method.")]
struct FlightArguments {
    /// Recordings of flights, or logs of autopilots as `bench import` reads them without a map
    #[arg(required = true)]
    flights: Vec<PathBuf>,
    #[command(flatten)]
    selection: Selection,
    #[command(flatten)]
    rig: NominalRig,
    /// Rig to write, the airframe in it
    #[arg(short, long)]
    output: PathBuf,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    json: Json,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    match &arguments.what {
        What::Thrust(arguments) => thrust::run(arguments),
        What::GroundEffect(arguments) => ground::run(arguments),
        What::Flight(arguments) => flight(arguments),
    }
}

fn flight(arguments: &FlightArguments) -> anyhow::Result<Exit> {
    let (model, written) = identified(arguments)?;
    if arguments.json.json {
        words::print_json(&model)?;
    } else {
        words::print(&in_words(&model, arguments))?;
    }
    if !written {
        words::fail(not_written(arguments));
    }
    Ok(if written { Exit::Done } else { Exit::CheckFailed })
}

/// What the flights tell, without words; `None` where something else is to be identified.
pub fn from_flights(arguments: &Arguments) -> Option<anyhow::Result<NominalModel>> {
    let What::Flight(arguments) = &arguments.what else { return None };
    Some(identified(arguments).and_then(|(model, written)| {
        anyhow::ensure!(written, not_written(arguments));
        Ok(model)
    }))
}

fn not_written(arguments: &FlightArguments) -> String {
    format!(
        "{} is not written: the model of some of these flights does not hold for the others, so that other flights held against it would tell of the model; look at the control, add flights of other kinds or leave out what is not like the rest, or write it all the same with --force",
        arguments.output.display()
    )
}

/// What the flights tell, and whether the rig is written: a model that does not hold for the flights that made it is handed out to who insists.
fn identified(arguments: &FlightArguments) -> anyhow::Result<(NominalModel, bool)> {
    let FlightArguments { flights, selection, .. } = arguments;
    Outputs::new(arguments.force.force)
        .and(arguments.output.as_path(), Form::Toml)
        .from(flights.iter().map(PathBuf::as_path))
        .check()?;
    let nominal = arguments.rig.resolve(flights, selection.map())?;
    let progress = Progress::of("identify flight");
    let model = NominalModel::of(flights, selection, &nominal.rig, &progress)
        .context("nothing identified, nothing written");
    drop(progress);
    let mut model = model?;
    model.found.warnings.extend(nominal.remarks);
    let written = model.holds() || arguments.force.force;
    if written {
        files::write_rig(&arguments.output, &head(&model, arguments, &nominal.from), &model.found.rig)?;
    }
    Ok((model, written))
}

/// How the rig was made.
fn head(
    NominalModel { found, control, .. }: &NominalModel,
    arguments: &FlightArguments,
    prior: &str,
) -> String {
    let mut out = format!(
        "identified by `bench identify flight{}` from {},\n# with {prior} as prior. A sigma covers the spread between flights.",
        arguments.selection.options(),
        words::count(found.flights.len() as u64, "flight"),
    );
    let none = control.iter().filter(|fold| fold.is_none()).count();
    let _ = match control.len() {
        0 => write!(out, "\n# Nominal against nominal was not checked."),
        blocks => write!(out, "\n# Nominal against nominal: `none` in {none} of {blocks}."),
    };
    let left: Vec<_> = found.numbers.iter().filter(|n| !n.identified).map(|n| n.name).collect();
    if !left.is_empty() {
        let _ = write!(out, "\n# Not told by these flights, left as in the prior: {}.", left.join(", "));
    }
    out
}

fn in_words(model: &NominalModel, arguments: &FlightArguments) -> String {
    let NominalModel { found, frame_period_s, control } = model;
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
    out.push('\n');
    for line in nominal::in_words(&found.laws, control) {
        let _ = writeln!(out, "  {line}");
    }
    let [before, after] = found.tracker_noise_m;
    let _ = writeln!(out, "\n  tracker noise {} m, was {} m", short(after), short(before));
    let [before, after] = frame_period_s;
    if before != after {
        let _ = writeln!(
            out,
            "  measurements count {} s apart, was {} s: the errors of nearer ones follow one another",
            short(*after),
            short(*before)
        );
    }
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
