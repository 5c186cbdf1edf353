#[cfg(feature = "exchange")]
mod draft;

use std::{
    fmt::Write as _,
    path::{Path, PathBuf},
};

use anyhow::{Context, bail};
use bench_diagnosis::{Ahead, Analysis, Diagnosis, NextFlight};
use bench_filter::Track;
use bench_identification::plausible_altitude;
use bench_inference::Problem;
use bench_recording::{Flight, Mode, Record, Session};
use bench_rig::{Mission, Rig};
use bench_run::{Ending, simulate_on};
use clap::Args;

use crate::{
    arguments::{Force, Json, Page},
    calibration::{self, Chosen, Missions, Wanted},
    commands::tracks::Selection,
    diagnosis::{
        page::page,
        report::{Conclusion, Report},
        terminal::in_words,
    },
    exit::Exit,
    files::{self, Form, Outputs},
    logs,
    nominal::{NominalModel, control_in_words, laws_in_words},
    progress::Progress,
    recorded::{Nominal, NominalRig},
    words::{self, short},
};
#[cfg(feature = "exchange")]
use draft::draft;

/// Say where the sim-to-real gap of flights lies and which unmodelled effect causes it
#[derive(Args)]
#[command(after_help = "Examples:
  bench diagnose flight-*.mcap
  bench diagnose --rig virtual flight-*.mcap --html diagnosis.html
  bench diagnose flight-*.mcap --json
  bench diagnose --rig virtual flight-*.mcap --write-rig better.toml
  bench diagnose --rig my-quad.toml --above 0.3 --without battery log-*.mcap
  bench diagnose --nominal good/*.mcap --test bad/*.mcap
  bench diagnose --model sim-*.ulg --test real-*.ulg
  bench diagnose flight-*.mcap --next-flight next.toml --between quadratic-drag,inflow-damping
  bench diagnose flight-*.mcap --fail-on-gap --min-confidence 0.8 || echo look at it
  bench diagnose flight-*.mcap --calibrate --write-calibration my-quad.json
  bench diagnose flight-*.mcap --calibration my-quad.json

Probabilities come from a calibration. The built-in one is the same on every machine, and so the
default. --calibrate learns one for this rig and these missions.

The verdict is `inconclusive` where what leads is less probable than --min-confidence, or where
the flights are not of one condition. With --fail-on-gap the exit code is 0 for `none` alone, and
1 for a gap, for `unknown` and for `inconclusive`, for then the check did not pass. Without it all
verdicts end with 0. Flights that the rig cannot describe at all end with 2 and no verdict.

A rig's own [[effect]] tables are part of the model: flights diagnosed with the rig that
--write-rig wrote should say `none`.

With --nominal flights that were fine are the model: `bench identify flight` finds it from them,
with the rig named or drafted as a start, and holds nominal flights against nominal ones. What the
model gets wrong alike in flights that were fine is no gap. --nominal without other flights is that
control alone: exit code 1 where most of it is not `none`.

The rig is the nominal model with its tolerances. All flights must be of one airframe in one
condition; more and richer flights (launches, steps, descents, low hover) tell more.
docs/diagnosis.md has the method, and what it does not do yet.")]
pub struct Arguments {
    /// Recordings of flights, or logs of autopilots as `bench import` reads them without a map
    #[arg(required_unless_present_any = ["test", "nominal"])]
    flights: Vec<PathBuf>,
    /// The same, after an option that takes several flights
    #[arg(long, value_name = "FLIGHT", num_args = 1..)]
    test: Vec<PathBuf>,
    #[command(flatten)]
    selection: Selection,
    #[command(flatten)]
    rig: NominalRig,
    /// Flights that were fine, such as those of your simulator, are the model: it is identified from them, and the others are held
    /// against it. Three at least; recordings or logs. --rig is then what is known before; without it, a rig is drafted
    #[arg(long, value_name = "FLIGHT", num_args = 1.., visible_alias = "model")]
    nominal: Vec<PathBuf>,
    /// First calibrate for this rig: simulate so many sets of nominal flights of these missions, move the weight of `none` until one
    /// set in a hundred would be an alarm, and keep that in the cache
    #[arg(long, value_name = "SETS", num_args = 0..=1, default_missing_value = "100", conflicts_with = "calibration")]
    calibrate: Option<usize>,
    /// What makes probabilities: built-in; auto, what this machine has learnt of this rig and these missions, if it has; or a
    /// file that --write-calibration wrote
    #[arg(long, value_name = "built-in|auto|FILE", default_value = "built-in")]
    calibration: Wanted,
    /// Write the calibration that was learnt, for --calibration on another machine
    #[arg(long, value_name = "FILE")]
    write_calibration: Option<PathBuf>,
    /// How often there is nothing wrong with flights that you ask about, before any is looked at [default: one in four]
    #[arg(long, value_name = "SHARE", value_parser = share, conflicts_with_all = ["calibrate", "calibration"])]
    prior_none: Option<f64>,
    /// Least probability with which anything is told; below it the verdict is `inconclusive`. 0 tells what leads, whatever it is worth
    #[arg(long, value_name = "PROBABILITY", default_value_t = MIN_CONFIDENCE, value_parser = probability)]
    min_confidence: f64,
    /// Write the rig with the named effect added, as a new rig file
    #[arg(long, value_name = "FILE")]
    write_rig: Option<PathBuf>,
    /// Exit with 1 unless the verdict is `none`: also where it is `inconclusive`
    #[arg(long)]
    fail_on_gap: bool,
    #[command(flatten)]
    page: Page,
    /// Write the mission that best tells the two leading hypotheses apart
    #[arg(long, value_name = "FILE")]
    next_flight: Option<PathBuf>,
    /// The two hypotheses that the next flight is to tell apart: names of effects, pairs as A+B, or none
    #[arg(long, value_name = "A,B", requires = "next_flight")]
    between: Option<String>,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    json: Json,
}

/// What is told is then more often right than wrong: probabilities are calibrated, so that half of what is told with 50 % is right.
const MIN_CONFIDENCE: f64 = 0.5;

fn probability(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(p) if (0.0..1.0).contains(&p) => Ok(p),
        _ => Err("a probability from 0 to below 1 is expected, such as 0.8".to_owned()),
    }
}

fn share(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(p) if p > 0.0 && p < 1.0 => Ok(p),
        _ => Err("a share between 0 and 1 is expected, such as 0.5".to_owned()),
    }
}

impl Arguments {
    /// Whether nominal flights are to be held against one another, and nothing else.
    fn is_control(&self) -> bool {
        self.flights.is_empty() && self.test.is_empty() && !self.nominal.is_empty()
    }

    fn check_outputs(&self) -> anyhow::Result<()> {
        Outputs::new(self.force.force)
            .and(self.page.html.as_deref(), Form::Html)
            .and(self.write_rig.as_deref(), Form::Toml)
            .and(self.next_flight.as_deref(), Form::Toml)
            .and(self.write_calibration.as_deref(), Form::Any)
            .from(self.flights.iter().chain(&self.test).chain(&self.nominal).map(PathBuf::as_path))
            .check()
    }
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    if arguments.is_control() {
        return control(arguments);
    }
    let made = Made::by(arguments)?;
    let report = &made.report;
    if arguments.json.json {
        words::print_json(report)?;
    } else {
        words::print(&in_words(report, made.rig.airframe.actuation))?;
    }
    made.write(arguments)?;
    let diagnosis = &report.diagnosis;
    if let (Some(next), Some(file), false) =
        (&diagnosis.next_flight, &arguments.next_flight, arguments.json.json)
    {
        words::print(&next_in_words(next, file, diagnosis.temperature))?;
    }
    let gap = report.verdict != Conclusion::None;
    Ok(if made.refused || arguments.fail_on_gap && gap { Exit::CheckFailed } else { Exit::Done })
}

/// The diagnosis without words; what is to be written is written.
pub fn report(arguments: &Arguments) -> anyhow::Result<Report> {
    let made = Made::by(arguments)?;
    made.write(arguments)?;
    Ok(made.report)
}

/// A diagnosis, and the rig that the flights were held against.
struct Made {
    report: Report,
    rig: Rig,
    /// Whether a next flight was asked for and there is none.
    refused: bool,
}

impl Made {
    fn by(arguments: &Arguments) -> anyhow::Result<Self> {
        let between = between(arguments)?;
        arguments.check_outputs()?;
        let tests = [arguments.flights.as_slice(), &arguments.test].concat();
        if tests.is_empty() {
            bail!("no flights to be held against the nominal ones: name them with --test");
        }
        if let Some(both) = tests
            .iter()
            .find(|test| arguments.nominal.iter().any(|nominal| files::is_same_file(test, nominal)))
        {
            bail!(
                "{} is among the nominal flights and among those to be held against them: a model says nothing of a flight that made it",
                both.display()
            );
        }
        let selection = &arguments.selection;
        let (prepared, model) = if arguments.nominal.is_empty() {
            (Prepared::read(&tests, selection, &arguments.rig)?, None)
        } else {
            let (nominal, model) = nominal(&arguments.nominal, selection, &arguments.rig)?;
            (Prepared::against(&tests, selection, nominal)?, Some(model.told()))
        };
        let Prepared { rig, from, tracks, flown, mut warnings } = prepared;
        let chosen = match arguments.calibrate {
            Some(sets) => calibration::learnt(&rig, &flown, sets)?,
            None => calibration::choose(&arguments.calibration, &rig, &flown)?,
        };
        let Chosen { calibration, choice, warning, kept } = chosen;
        let calibration = match arguments.prior_none {
            Some(share) => calibration.with_prior_none(share),
            None => calibration,
        };
        warnings.extend(warning);
        if let Some(file) = &arguments.write_calibration {
            let kept = kept.with_context(|| {
                format!(
                    "{} is not written: the calibration is the built-in one; --calibrate learns one",
                    file.display()
                )
            })?;
            kept.write(file)?;
        }
        let problem = Problem::new(&tracks, &rig);
        let progress = Progress::of("diagnose");
        let flights = words::count(tracks.len() as u64, "flight");
        progress.begin_untold(&format!("weighing what explains {flights}"));
        let analysis = Analysis::of(&problem, &calibration);
        let mut diagnosis = analysis.diagnosis();
        refuse_absurd(&diagnosis, &from)?;
        let mut refused = false;
        if arguments.next_flight.is_some() {
            progress.begin_untold("trying missions for the next flight");
            match NextFlight::propose(
                &analysis.problem(),
                &diagnosis.candidates,
                between,
                &flown.distinct(),
                fly,
            ) {
                Ok(next) => diagnosis.next_flight = Some(next),
                Err(reason) => {
                    refused = true;
                    warnings.push(reason.to_string());
                }
            }
        }
        drop(progress);
        diagnosis.warnings = warnings;
        let report = Report { model, ..Report::new(diagnosis, arguments.min_confidence, choice) };
        Ok(Self { report, rig, refused })
    }

    /// Writes the page, the rig and the mission that were asked for.
    fn write(&self, arguments: &Arguments) -> anyhow::Result<()> {
        let Self { report, rig, .. } = self;
        if let Some(file) = &arguments.page.html {
            files::write_and_say(file, &page(report, rig))?;
        }
        if let Some(path) = &arguments.write_rig {
            write_rig(path, rig, report)?;
        }
        if let (Some(next), Some(file)) = (&report.diagnosis.next_flight, &arguments.next_flight) {
            files::write(file, &next.to_toml())?;
        }
        Ok(())
    }
}

/// Flights as the diagnosis takes them, and the rig that they are held against.
struct Prepared {
    rig: Rig,
    /// Where the rig comes from, in words.
    from: String,
    tracks: Vec<Track>,
    /// The missions that the recordings carry.
    flown: Missions,
    warnings: Vec<String>,
}

impl Prepared {
    fn read(flights: &[PathBuf], selection: &Selection, rig: &NominalRig) -> anyhow::Result<Self> {
        Self::against(flights, selection, rig.resolve(flights, selection.map())?)
    }

    fn against(flights: &[PathBuf], selection: &Selection, nominal: Nominal) -> anyhow::Result<Self> {
        let rig = nominal.rig;
        let mut flown = Missions::default();
        let (mut unread, mut of_another_unit) = (Vec::new(), Vec::new());
        let (tracks, unused) = selection.tracks(flights, &rig, |path, flight| {
            if let Some(actuation) = logs::actuation(flight).filter(|unit| *unit != rig.airframe.actuation) {
                of_another_unit.push(format!(
                    "{} has its throttle in {}, and {} in {}: it cannot be a model of that flight",
                    path.display(),
                    actuation.unit(),
                    nominal.from,
                    rig.airframe.actuation.unit()
                ));
            }
            match flight.mission_toml().map(|text| Mission::read(path, text)) {
                Some(Ok(mission)) => flown.0.push(mission),
                // The flights can be diagnosed all the same.
                Some(Err(error)) => {
                    unread.push(format!("the mission that {} holds: {error}", path.display()));
                }
                None => {}
            }
        })?;
        if !of_another_unit.is_empty() {
            bail!("{}", of_another_unit.join("\n"));
        }
        if tracks.is_empty() {
            bail!("none of the flights can be diagnosed:\n{}", unused.join("\n"));
        }
        for track in &tracks {
            plausible_altitude(track, &rig).context("nothing diagnosed")?;
        }
        let mut warnings = [unused, nominal.remarks, unread].concat();
        warnings.extend(unused_motion(&tracks, &rig));
        Ok(Self { rig, from: nominal.from, tracks, flown, warnings })
    }
}

/// The model that nominal flights make, from the rig named, the one that they carry, or a draft.
fn nominal(
    flights: &[PathBuf],
    selection: &Selection,
    rig: &NominalRig,
) -> anyhow::Result<(Nominal, NominalModel)> {
    let carry = || {
        let session = |path: &PathBuf| logs::session(path, selection.map());
        flights.iter().map(session).all(|session| session.is_ok_and(|session| session.rig_toml.is_some()))
    };
    let given = rig.rig.is_some() || carry();
    let (prior, remarks) = if given {
        let Nominal { rig, remarks, .. } = rig.resolve(flights, selection.map())?;
        (rig, remarks)
    } else {
        (draft(flights, selection)?, Vec::new())
    };
    let progress = Progress::of("diagnose");
    let model = NominalModel::of(flights, selection, &prior, &progress)?;
    drop(progress);
    let mut remarks = [remarks, model.found.warnings.clone()].concat();
    let left: Vec<&str> =
        model.found.numbers.iter().filter(|number| !number.identified).map(|number| number.name).collect();
    if !left.is_empty() {
        let of = if given { "as before" } else { "as drafted" };
        remarks.push(format!("the nominal flights do not tell, and the model has {of}: {}", left.join(", ")));
    }
    let from = format!("the model of {}", words::count(model.found.flights.len() as u64, "nominal flight"));
    Ok((Nominal { rig: model.found.rig.clone(), from, remarks }, model))
}

/// Nominal flights held against nominal ones, and nothing else.
fn control(arguments: &Arguments) -> anyhow::Result<Exit> {
    let wants_more = [
        ("--html", arguments.page.html.is_some()),
        ("--write-rig", arguments.write_rig.is_some()),
        ("--next-flight", arguments.next_flight.is_some()),
        ("--write-calibration", arguments.write_calibration.is_some()),
    ];
    if let Some((option, _)) = wants_more.into_iter().find(|(_, wanted)| *wanted) {
        bail!("{option} needs flights to be held against the nominal ones: name them with --test");
    }
    let (nominal, model) = nominal(&arguments.nominal, &arguments.selection, &arguments.rig)?;
    if model.control.is_empty() {
        bail!(
            "{}: none of them can be left out, so there is no control; give four or more",
            words::count(model.found.flights.len() as u64, "nominal flight")
        );
    }
    let holds = model.holds();
    if arguments.json.json {
        words::print_json(&model)?;
    } else {
        let lines = control_in_words(&model.control).into_iter().chain(laws_in_words(&model.found.laws));
        words::print(&lines.map(|line| line + "\n").collect::<String>())?;
        for remark in &nominal.remarks {
            words::warn(remark);
        }
    }
    Ok(if holds { Exit::Done } else { Exit::CheckFailed })
}

/// A rig drafted from flights of which nothing else is known.
#[cfg(not(feature = "exchange"))]
fn draft(_: &[PathBuf], _: &Selection) -> anyhow::Result<Rig> {
    Err(crate::left_out::left_out("the draft of a rig that --nominal wants without --rig", "exchange"))
}

/// Recordings diagnosed with the built-in calibration, and the rig that they were held against.
pub fn diagnosed(flights: &[PathBuf], rig: &NominalRig) -> anyhow::Result<(Report, Rig)> {
    let Prepared { rig, from, tracks, flown, warnings } =
        Prepared::read(flights, &Selection::default(), rig)?;
    let chosen = calibration::choose(&Wanted::BuiltIn, &rig, &flown)?;
    let progress = Progress::of("diagnose");
    progress.begin_untold(&format!("weighing what explains {}", words::count(tracks.len() as u64, "flight")));
    let mut diagnosis = Diagnosis::of(&Problem::new(&tracks, &rig), &chosen.calibration);
    drop(progress);
    refuse_absurd(&diagnosis, &from)?;
    diagnosis.warnings = warnings;
    Ok((Report::new(diagnosis, MIN_CONFIDENCE, chosen.choice), rig))
}

/// Numbers further off are told as those that are.
const OFF_TOLERANCES: f64 = 5.0;

/// Refuses flights that the rig cannot describe, naming the numbers that are off.
fn refuse_absurd(diagnosis: &Diagnosis, rig: &str) -> anyhow::Result<()> {
    let Some(ahead) = diagnosis.ahead.as_ref().filter(|ahead| ahead.beyond) else { return Ok(()) };
    let mut off: Vec<_> = diagnosis.numbers.iter().filter(|n| n.sigmas.abs() > OFF_TOLERANCES).collect();
    off.sort_by(|a, b| b.sigmas.abs().total_cmp(&a.sigmas.abs()));
    let mut lines: Vec<String> = off
        .iter()
        .map(|n| {
            format!(
                "{} would have to be {} instead of {} ({:.0} tolerances)",
                n.name,
                short(n.fitted),
                short(n.nominal),
                n.sigmas.abs()
            )
        })
        .collect();
    lines.extend(nearest(ahead));
    let times = ahead.error_m / ahead.allowed_m;
    bail!(
        "{rig} cannot be a model of these flights: {} s ahead it is off by {} m, {} times the {} m that its tolerances and noise allow, and no verdict is told\n  {}\ncheck the rig, the unit and offset of the throttle and the unit of the altitude (`bench info`), or widen the tolerances that are too narrow",
        ahead.horizon_s,
        short(ahead.error_m),
        short(times),
        short(ahead.allowed_m),
        lines.join("\n  ")
    )
}

/// What the best explanation comes to, which is none.
fn nearest(ahead: &Ahead) -> Vec<String> {
    let effects = ahead.off.iter().filter_map(|off| {
        let effect = off.effect?;
        Some(format!(
            "nearest in the library: {effect} with {} = {}, {:.0} deviations from what is met",
            off.name,
            short(off.fitted),
            off.sigmas.abs()
        ))
    });
    let left = format!("with the best numbers and effects it is still off by {} m", short(ahead.best_m));
    effects.chain([left]).collect()
}

/// What was measured on board and is not used, because the rig does not say how good it is.
fn unused_motion(tracks: &[Track], rig: &Rig) -> Option<String> {
    let felt = || tracks.iter().flat_map(|track| &track.felt);
    let d = &rig.disturbance;
    let unused = [
        (felt().any(|f| f.velocity_m_s.is_some()) && d.velocity_noise_m_s.is_none(), "velocity_noise_m_s"),
        (
            felt().any(|f| f.acceleration_m_s2.is_some()) && d.acceleration_noise_m_s2.is_none(),
            "acceleration_noise_m_s2",
        ),
    ];
    let keys: Vec<&str> = unused.iter().filter(|(unused, _)| *unused).map(|(_, key)| *key).collect();
    (!keys.is_empty()).then(|| {
        format!(
            "vertical motion was measured on board, but the rig's [disturbance] does not say how well ({}): it is not used",
            keys.join(", ")
        )
    })
}

/// The two hypotheses of `--between`.
fn between(arguments: &Arguments) -> anyhow::Result<Option<[&str; 2]>> {
    let Some(names) = &arguments.between else { return Ok(None) };
    let Some((first, second)) = names.split_once(',') else {
        bail!("--between {names:?}: expected two hypotheses, such as quadratic-drag,inflow-damping");
    };
    let names = [first.trim(), second.trim()];
    NextFlight::check(names).context("--between")?;
    Ok(Some(names))
}

/// Flies a mission on a plant that the controller takes for the nominal rig.
fn fly(plant: &Rig, nominal: &Rig, mission: &Mission) -> Option<Flight> {
    let mut records: Vec<Record> = Vec::new();
    let flown = simulate_on(plant, nominal, mission, 0, &mut records, |_| true).ok()?;
    let whole = flown.ending == Ending::Complete;
    whole.then(|| Flight::from_records(Session::new(Mode::Sim), records))
}

fn next_in_words(next: &NextFlight, file: &Path, temperature: f64) -> String {
    let [first, second] = &next.between;
    let mut out = format!("\nNext flight: tells {first} from {second}\n  {}\n", next.flies);
    let nats = |gain: f64| format!("{}{gain:.1}", if gain < NextFlight::MOST { "" } else { "over " });
    let _ = writeln!(
        out,
        "  expected gain {:.1} nats ({} if {first} is true, {} if {second} is): odds {} times as clear",
        next.gain,
        nats(next.gain_if[0]),
        nats(next.gain_if[1]),
        match (next.gain / temperature).exp() {
            factor if factor < 1000.0 => format!("{factor:.1}"),
            _ => "over 1,000".to_owned(),
        }
    );
    let _ = match &next.repeat {
        Some(repeat) => {
            writeln!(out, "  flying {} once more would bring {:.1} nats", repeat.mission, repeat.gain)
        }
        None => writeln!(out, "  the recordings hold no mission to compare with"),
    };
    let _ = writeln!(
        out,
        "  written to {} after {}; fly it, then diagnose all recordings together",
        file.display(),
        words::count(next.tried as u64, "mission")
    );
    out
}

fn write_rig(path: &Path, rig: &Rig, report: &Report) -> anyhow::Result<()> {
    if report.verdict == Conclusion::Inconclusive {
        bail!(
            "the verdict is inconclusive: no effect is sure enough to write into {}; --min-confidence 0 writes what leads",
            path.display()
        );
    }
    let Some(changed) = report.diagnosis.rig_with_effect(rig) else {
        bail!("the verdict is {}: there is no effect to write into {}", report.leading, path.display());
    };
    files::write_and_say(path, &changed.to_toml())
}
