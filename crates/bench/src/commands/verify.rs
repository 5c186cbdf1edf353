use std::{fmt::Write as _, path::PathBuf};

use anyhow::{Context, bail};
use bench_filter::Track;
use bench_identification::{OpenLoop, Tolerance, Verification, VerifyVerdict, verify};
use bench_page::Tone;
use bench_recording::Flight;
use bench_rig::{Phase, Rig};
use clap::Args;

use crate::{
    arguments::{Force, Json, Page},
    exit::Exit,
    files::{self, Form, Outputs},
    model_page,
    recorded::{NominalRig, Recorded},
    words::{self, short},
};

/// Hold a rig's model against open-loop flights: does it predict them within a tolerance?
#[derive(Args)]
#[command(after_help = "Examples:
  bench sim --mission hop -o hop.mcap && bench verify hop.mcap --band 2
  bench verify --rig my-quad.toml hop-*.mcap --tolerance 0.03 --html verify.html
  bench verify --rig my-quad.toml hop-*.mcap --json > verify.json || echo not good enough

Nothing is fitted. A flight is predicted twice: one second ahead from what was seen before,
which --tolerance is about, and from its throttle alone, from take-off until a closed loop takes
over, which --trajectory and --inside are about. A flight within a band that nearly any flight
would be within shows nothing: that is told as `not informative`, with what would narrow it.
Exit code 0 says that the model passed, 1 that it did not or that nothing can be told, 2 that the
flights or the rig could not be used. docs/model-development.md has the equations; `bench identify flight` finds numbers that predict better, `bench diagnose` what the
model lacks.")]
pub struct Arguments {
    /// Recordings of open-loop flights
    #[arg(required = true)]
    flights: Vec<PathBuf>,
    #[command(flatten)]
    rig: NominalRig,
    /// Greatest RMS error of altitude predicted 1 s ahead, m, in any flight
    #[arg(long, value_name = "METRES", default_value_t = Tolerance::default().ahead_m)]
    tolerance: f64,
    /// Greatest RMS distance of any flight from the trajectory that its throttle alone predicts, m
    #[arg(long, value_name = "METRES")]
    trajectory: Option<f64>,
    /// Least share of sightings in the band that holds 95 % of predictions
    #[arg(long, value_name = "SHARE", default_value_t = Tolerance::default().inside)]
    inside: f64,
    /// Greatest mean of squared errors over expected ones in any flight, from sighting to sighting; 1 for a right model
    #[arg(long, value_name = "RATIO", default_value_t = Tolerance::default().consistency)]
    consistency: f64,
    /// Greatest mean width of the band that holds 95 % of predictions, m: a wider one tells nothing [default: what each flight
    /// spans in altitude]
    #[arg(long, value_name = "METRES")]
    band: Option<f64>,
    #[command(flatten)]
    json: Json,
    #[command(flatten)]
    page: Page,
    #[command(flatten)]
    force: Force,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    let above_zero = |name: &str, x: f64| {
        if x.is_finite() && x > 0.0 {
            Ok(x)
        } else {
            bail!("{name} must be a number of metres above 0, not {x}")
        }
    };
    if !(0.0..=1.0).contains(&arguments.inside) {
        bail!("--inside must be a share from 0 to 1, not {}", arguments.inside);
    }
    if !(arguments.consistency.is_finite() && arguments.consistency > 0.0) {
        bail!("--consistency must be a number above 0, not {}", arguments.consistency);
    }
    let tolerance = Tolerance {
        ahead_m: above_zero("--tolerance", arguments.tolerance)?,
        trajectory_m: arguments.trajectory.map(|x| above_zero("--trajectory", x)).transpose()?,
        inside: arguments.inside,
        consistency: arguments.consistency,
        band_m: arguments.band.map(|x| above_zero("--band", x)).transpose()?,
    };
    Outputs::new(arguments.force.force)
        .and(arguments.page.html.as_deref(), Form::Html)
        .from(arguments.flights.iter().map(PathBuf::as_path))
        .check()?;
    let (found, rig) = verified(&arguments.flights, &arguments.rig, &tolerance)?;
    if let Some(page) = &arguments.page.html {
        files::write_and_say(page, &model_page::verification(&found, &rig))?;
    }
    if arguments.json.json {
        words::print_json(&found)?;
    } else {
        words::print(&in_words(&found))?;
    }
    Ok(if found.passed { Exit::Done } else { Exit::CheckFailed })
}

/// The model held against recordings, and the rig that it is of. What should be known of them is told.
pub fn verified(
    flights: &[PathBuf],
    rig: &NominalRig,
    tolerance: &Tolerance,
) -> anyhow::Result<(Verification, Rig)> {
    let nominal = rig.resolve(flights, None)?;
    let rig = nominal.rig;
    let recorded = Recorded::read(flights, None, |path, flight| {
        open_loop(&path.display().to_string(), &flight, &rig).context("nothing verified")
    })?;
    for remark in recorded.remarks.iter().chain(&nominal.remarks) {
        words::warn(format_args!("{remark}"));
    }
    let found = verify(&recorded.made, &rig, tolerance).context("nothing verified")?;
    Ok((found, rig))
}

/// A flight as far as its throttle was not closed over the altitude.
pub fn open_loop(name: &str, flight: &Flight, rig: &Rig) -> anyhow::Result<OpenLoop> {
    let track = Track::from_flight(name, flight, rig)?;
    let closed = flight.phases().into_iter().find(|interval| {
        matches!(interval.phase, Phase::Hold | Phase::Land | Phase::Abort)
            && interval.from.seconds() >= track.begin_s
    });
    Ok(OpenLoop { until_s: closed.map(|interval| interval.from.seconds()), track })
}

fn in_words(found: &Verification) -> String {
    let mut out = String::new();
    // Writing to a String cannot fail, here and below.
    for flight in &found.flights {
        let cm = |x: Option<f64>| x.map_or_else(|| "-".to_owned(), |x| format!("{:.1}", 100.0 * x));
        let [seen, predicted, low, high] = flight.peak_m;
        let _ = writeln!(
            out,
            "{}\n  errors 0.5, 1, 2 s ahead: {}, {}, {} cm RMS; over expected {:.2}, whiteness p {}\n  from the throttle alone: {:.1} cm RMS over {:.1} s, {:.0} % in the band of 95 %; peak {:.1} cm, predicted {:.1} ({:.1} to {:.1})",
            flight.name,
            cm(flight.k_step_m[0]),
            cm(flight.k_step_m[1]),
            cm(flight.k_step_m[2]),
            flight.consistency.mean_nis,
            words::probability(flight.consistency.whiteness_p),
            100.0 * flight.trajectory_rms_m,
            flight.trajectory.time_s.last().copied().unwrap_or(0.0),
            100.0 * flight.inside,
            100.0 * seen,
            100.0 * predicted,
            100.0 * low,
            100.0 * high,
        );
    }
    let _ = writeln!(
        out,
        "\n{}",
        match found.verdict {
            VerifyVerdict::Passed => words::toned(Tone::Good, "The model predicts these flights"),
            VerifyVerdict::Failed => words::toned(Tone::Bad, "The model misses these flights"),
            VerifyVerdict::NotInformative => words::toned(
                Tone::Odd,
                "Not informative: within the rig's tolerances nearly any flight would have passed"
            ),
        }
    );
    for check in &found.checks {
        let _ = writeln!(
            out,
            "{} {}: {} ({} {}){}",
            match (check.passed, found.verdict) {
                (false, VerifyVerdict::NotInformative) => words::toned(Tone::Odd, "TOO WIDE"),
                (passed, _) => words::passed(passed),
            },
            check.name,
            short(check.value),
            if check.at_least { "at least" } else { "at most" },
            short(check.limit),
            check.flight.as_ref().map_or_else(String::new, |flight| format!(", {flight}"))
        );
    }
    let shares: Vec<String> = found
        .widened_by
        .iter()
        .filter(|share| share.share >= 0.01)
        .map(|share| format!("{} {:.0} %", share.name, 100.0 * share.share))
        .collect();
    let _ = writeln!(out, "the band's variance comes from: {}", shares.join(", "));
    for how in &found.narrowed_by {
        let _ = writeln!(out, "what would narrow it: {how}");
    }
    for warning in &found.warnings {
        let _ = writeln!(out, "{}: {warning}", words::toned(Tone::Odd, "warning"));
    }
    out
}
