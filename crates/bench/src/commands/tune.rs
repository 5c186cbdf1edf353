use std::{
    fmt::Write as _,
    path::{Path, PathBuf},
};

use anyhow::{Context, bail};
use bench_page::{Tone, digits};
use bench_rig::{Predictor, Rig};
use bench_tuning::{
    Effort, HOLDING, Limits, LoopKind, Made, Standing, Step, Task, Tuned, Tuning, page, tune, with_gains,
};
use clap::{Args, ValueEnum};

use crate::{
    arguments::{Force, Json, Page},
    exit::Exit,
    files::{self, Form, Outputs},
    library,
    progress::Progress,
    words,
};

/// Find gains for a rig that hold for all that its tolerances allow
#[derive(Args)]
#[command(after_help = "Examples:
  bench tune --rig crazyflie-2 -o tuned.toml --html tune.html
  bench tune --rig my-quad.toml -o my-quad-tuned.toml --altitude 0.5
  bench tune --rig my-quad.toml -o slow.toml --loops altitude --delay-margin 0.35 --settling 8

Gains are flown in the virtual lab, by the controller's own code, on airframes drawn from the
rig's tolerances: launch, hold, step. Then they are checked on fresh ones. That is some ten
thousand flights a loop and takes minutes; --models and --check make it less. The rig is written
with its comments and its order kept; only gains change. Exit code 1 says that a limit is not
held, or that fewer than 99 % of the fresh airframes hold within --rms; the rig is written all
the same. docs/tune.md has the method.")]
pub struct Arguments {
    /// Rig whose gains are tuned, its laws, tolerances, delay and noise: a file, or the name of a built-in one
    #[arg(long, value_name = "RIG")]
    rig: PathBuf,
    /// Rig to write
    #[arg(short, long)]
    output: PathBuf,
    /// Which loops
    #[arg(long, value_delimiter = ',', default_values_t = [Which::Altitude, Which::Lateral])]
    loops: Vec<Which>,
    /// Altitude that is held, m
    #[arg(long, default_value_t = Task::PAPER.altitude_m)]
    altitude: f64,
    /// RMS altitude error to stay within, m
    #[arg(long, value_name = "METRES")]
    rms: Option<f64>,
    /// Overshoot of a step to stay within, as a share of it
    #[arg(long, value_name = "SHARE")]
    overshoot: Option<f64>,
    /// Settling time of a step to stay within, s
    #[arg(long, value_name = "SECONDS")]
    settling: Option<f64>,
    /// What hold may ask of the rotors: RMS about the mean, as a share of the weight
    #[arg(long, value_name = "SHARE")]
    activity: Option<f64>,
    /// Gain margin at least, dB
    #[arg(long, value_name = "DECIBELS")]
    gain_margin: Option<f64>,
    /// Phase margin at least, degrees
    #[arg(long, value_name = "DEGREES")]
    phase_margin: Option<f64>,
    /// By how much the delay must be able to grow, s
    #[arg(long, value_name = "SECONDS")]
    delay_margin: Option<f64>,
    /// Airframes to tune on
    #[arg(long, default_value_t = Effort::USUAL.models)]
    models: usize,
    /// Fresh airframes to check on
    #[arg(long, default_value_t = Effort::USUAL.checked)]
    check: usize,
    /// Sets of gains to try all over their ranges
    #[arg(long, default_value_t = Effort::USUAL.scanned)]
    scan: usize,
    /// Steps of the search about the best of them
    #[arg(long, default_value_t = Effort::USUAL.refined)]
    refine: usize,
    /// Seed of everything random
    #[arg(long, default_value_t = Effort::USUAL.seed)]
    seed: u64,
    #[command(flatten)]
    page: Page,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    json: Json,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Which {
    Altitude,
    Lateral,
}

impl std::fmt::Display for Which {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.kind().name())
    }
}

impl Which {
    fn kind(self) -> LoopKind {
        match self {
            Self::Altitude => LoopKind::Altitude,
            Self::Lateral => LoopKind::Lateral,
        }
    }
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    let output = &arguments.output;
    Outputs::new(arguments.force.force)
        .and(output.as_path(), Form::Toml)
        .and(arguments.page.html.as_deref(), Form::Html)
        .check()?;
    let rig = files::rig(&arguments.rig)?;
    let file = files::rig_path(&arguments.rig)?;
    // What a built-in rig names lies in no folder: it is written whole.
    let text = if library::is_embedded(&file) { rig.to_toml() } else { files::read(&file)? };
    let moved = if library::is_embedded(&file) { Vec::new() } else { moved_files(&file, output, &text)? };
    let moved: Vec<(&str, &Path)> = moved.iter().map(|(key, path)| (*key, path.as_path())).collect();
    let mut loops: Vec<LoopKind> = Vec::new();
    for which in &arguments.loops {
        if !loops.contains(&which.kind()) {
            loops.push(which.kind());
        }
    }
    // The lateral loop goes by the altitude's predictor.
    loops.sort_by_key(|of| *of == LoopKind::Lateral);
    let limits = arguments.limits(&rig)?;
    let effort = Effort {
        models: arguments.models,
        checked: arguments.check,
        scanned: arguments.scan,
        refined: arguments.refine,
        seed: arguments.seed,
    };
    let task = Task { altitude_m: arguments.altitude, ..Task::PAPER };
    warn(&rig);
    let progress = Progress::of("tune");
    let tell = |step: Step| {
        progress.begin(&format!("{} loop, {}", step.of.name(), step.what), step.all as f64, step.unit);
        progress.at(step.done as f64);
        progress.overall(step.share);
    };
    let tuning = tune(&rig, &task, &|of| limits(of), &loops, effort, &tell);
    drop(progress);
    let tuning = tuning.context("nothing tuned, nothing written")?;

    let how = format!(
        "`--rig {} --altitude {}{} --models {} --check {} --scan {} --refine {} --seed {}`; docs/tune.md",
        arguments.rig.display(),
        digits(arguments.altitude),
        arguments.loops.iter().fold(String::from(" --loops "), |out, of| {
            let comma = if out.ends_with(' ') { "" } else { "," };
            format!("{out}{comma}{of}")
        }),
        effort.models,
        effort.checked,
        effort.scanned,
        effort.refined,
        effort.seed
    );
    let name =
        output.file_stem().map_or_else(|| rig.name.clone(), |stem| stem.to_string_lossy().into_owned());
    let written = with_gains(&text, &tuning, &name, &how, &moved)?;
    // What is written must be the rig that was flown.
    let again = Rig::read(output, &written).context("the gains make no rig; nothing written")?;
    if again.control != tuning.control {
        bail!("the rig's file does not take the gains found; nothing written");
    }
    files::write(output, &written)?;
    if let Some(file) = &arguments.page.html {
        let command = words::command();
        files::write_and_say(file, &page(&tuning, &Made { rig: &rig.name, command: &command }))?;
    }
    if arguments.json.json {
        words::print_json(&tuning)?;
    } else {
        words::print(&in_words(&tuning, output))?;
    }
    Ok(if tuning.passed() { Exit::Done } else { Exit::CheckFailed })
}

impl Arguments {
    fn limits(&self, rig: &Rig) -> anyhow::Result<impl Fn(LoopKind) -> Limits> {
        let asked = [
            ("--rms", self.rms),
            ("--overshoot", self.overshoot),
            ("--settling", self.settling),
            ("--activity", self.activity),
            ("--gain-margin", self.gain_margin),
            ("--phase-margin", self.phase_margin),
            ("--delay-margin", self.delay_margin),
        ];
        for (name, value) in asked {
            if let Some(value) = value.filter(|value| !(value.is_finite() && *value > 0.0)) {
                bail!("{name} {value}: expected a number above 0");
            }
        }
        let [rms, overshoot, settling, activity, gain, phase, delay] = asked.map(|(_, value)| value);
        let usual = [LoopKind::Altitude, LoopKind::Lateral].map(|of| (of, of.usual_limits(rig)));
        Ok(move |of: LoopKind| {
            let mut limits = if of == LoopKind::Altitude { usual[0].1 } else { usual[1].1 };
            if of == LoopKind::Altitude {
                limits.rms_m = rms.unwrap_or(limits.rms_m);
            }
            limits.overshoot = overshoot.unwrap_or(limits.overshoot);
            limits.settling_s = settling.unwrap_or(limits.settling_s);
            limits.activity = activity.unwrap_or(limits.activity);
            limits.gain_db = gain.unwrap_or(limits.gain_db);
            limits.phase_deg = phase.unwrap_or(limits.phase_deg);
            limits.delay_s = delay.unwrap_or(limits.delay_s);
            limits
        })
    }
}

/// What makes a rig hard to tune, told before it takes minutes.
fn warn(rig: &Rig) {
    let control = &rig.control;
    if control.predictor == Predictor::Linear && control.velocity_window_s < rig.tracker.frame_period_s {
        words::warn(format_args!(
            "velocity_window_s = {} is shorter than the tracker's frame_period_s = {}: no two sightings fall into it, and the rig's own gains fly without any velocity",
            control.velocity_window_s, rig.tracker.frame_period_s
        ));
    }
    let airframe = &rig.airframe;
    let sigmas = [
        airframe.mass_kg.sigma,
        airframe.thrust.gain_n_per_unit.sigma,
        airframe.thrust.offset.sigma,
        airframe.thrust.hover_sigma.unwrap_or(0.0),
    ];
    if sigmas.iter().all(|sigma| *sigma == 0.0) {
        words::warn(format_args!(
            "neither mass nor thrust has a tolerance (`sigma`): gains are tuned for one airframe"
        ));
    }
}

/// Files that the rig names beside it, as they must be named from the output's folder: unchanged where that is the same.
fn moved_files(rig: &Path, output: &Path, text: &str) -> anyhow::Result<Vec<(&'static str, PathBuf)>> {
    let folder = |file: &Path| match file.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder.to_owned(),
        _ => PathBuf::from("."),
    };
    let from = folder(rig).canonicalize().with_context(|| format!("cannot find {}", rig.display()))?;
    // A folder that is not there yet is another one.
    if folder(output).canonicalize().is_ok_and(|to| to == from) {
        return Ok(Vec::new());
    }
    let named = |key: &str| -> Option<String> {
        let line = text.lines().take_while(|line| !line.trim_start().starts_with('['));
        let mut values =
            line.filter_map(|line| line.trim().strip_prefix(key)?.trim_start().strip_prefix('='));
        Some(values.next()?.trim().trim_start_matches('"').split('"').next()?.to_owned())
    };
    let mut moved = Vec::new();
    for key in ["airframe", "calibration"] {
        if let Some(name) = named(key) {
            let path = from.join(&name);
            let path = path.canonicalize().with_context(|| format!("cannot find {}", path.display()))?;
            moved.push((key, path));
        }
    }
    Ok(moved)
}

fn in_words(tuning: &Tuning, output: &Path) -> String {
    let mut out = format!(
        "{}\n\n{}: tuned on {}, checked on {} fresh\n",
        words::toned(Tone::of(tuning.passed()), &tuning.verdict()),
        output.display(),
        words::count(tuning.effort.models as u64, "airframe"),
        words::grouped(tuning.effort.checked as u64)
    );
    for tuned in &tuning.loops {
        of_loop(&mut out, tuned, tuning.altitude_m);
    }
    out
}

fn of_loop(out: &mut String, tuned: &Tuned, altitude_m: f64) {
    let _ =
        writeln!(out, "\n{} loop{:25} {:>12} {:>12} {:>12}", tuned.of.name(), "", "before", "after", "limit");
    for ((key, before), after) in tuned.keys.iter().zip(&tuned.before.gains).zip(&tuned.after.gains) {
        let _ = writeln!(out, "  {key:<36} {:>12} {:>12}", digits(*before), digits(*after));
    }
    for judged in &tuned.judged {
        let none = |stable: bool| match (judged.between, stable) {
            (Some(_), _) => "lost",
            (None, false) => "not stable",
            (None, true) => "-",
        };
        let before = judged.before.map_or_else(|| none(tuned.before.margins.is_some()).to_owned(), digits);
        let [after, limit] = judged.apart();
        let after =
            if judged.after.is_some() { after } else { none(tuned.after.margins.is_some()).to_owned() };
        let standing = match (judged.standing, judged.between) {
            (Standing::Broken, _) => format!("  {}", words::toned(Tone::Bad, "broken")),
            (Standing::AtLimit, Some([low, high])) => {
                format!("  at the limit: {} to {}", digits(low), digits(high))
            }
            (Standing::Held | Standing::AtLimit, _) => String::new(),
        };
        let _ = writeln!(out, "  {:<36} {before:>12} {after:>12} {limit:>12}{standing}", judged.name);
    }
    let percent = |x: f64| digits(100.0 * x);
    let checked = &tuned.checked;
    let place = match tuned.of {
        LoopKind::Altitude => format!("hold {} m", digits(altitude_m)),
        LoopKind::Lateral => "keep their place".to_owned(),
    };
    let _ = writeln!(
        out,
        "  {} of {} fresh airframes {place} within {} cm RMS: {} % (95 %: {} to {} %); before {} %",
        words::grouped(checked.count as u64),
        words::grouped(checked.of as u64),
        digits(100.0 * tuned.limits.rms_m),
        percent(checked.value()),
        percent(checked.low),
        percent(checked.high),
        percent(tuned.checked_before.value())
    );
    let kept = tuned.grown.iter().take_while(|grown| grown.within.value() >= HOLDING).last();
    let lost = tuned.grown.iter().find(|grown| grown.within.value() < HOLDING);
    let beyond = |extra_s: f64| format!("{} s", digits(extra_s));
    let _ = match (kept, lost) {
        (Some(kept), Some(lost)) => writeln!(
            out,
            "  with noise and launch, 99 % still do with {} more latency, {} % with {}",
            beyond(kept.extra_s),
            percent(lost.within.value()),
            beyond(lost.extra_s)
        ),
        (Some(kept), None) => writeln!(out, "  99 % still do with {} more latency", beyond(kept.extra_s)),
        _ => Ok(()),
    };
}
