use std::path::PathBuf;

use anyhow::{Context, bail};
use bench_identification::Tolerance;
use bench_page::{Section, Tone, Verdict, parts::warnings};
use bench_recording::{
    RecordingError,
    diff::{DiffOptions, html_sections, html_verdict},
};
use clap::Args;
use maud::html;

use super::{diagnose::diagnosed, diff::compared, verify::verified};
use crate::{
    arguments::Force,
    diagnosis::page as diagnosis_page,
    exit::Exit,
    files::{self, Form, Outputs},
    model_page,
    recorded::NominalRig,
    report::{Flown, Loaded, page},
    words,
};

/// Write flights as one self-contained page: what they reached, traces, timing, events, rig and mission
#[derive(Args)]
#[command(after_help = "Examples:
  bench report recordings/virtual_climb-040_seed0.mcap
  bench report sim.mcap lab.mcap --diff -o both.html
  bench report flight-*.mcap --diagnose -o gap.html
  bench report hop-*.mcap --verify -o model.html

The page needs nothing else and loads nothing: send it as it is. Criteria are those of the mission
in each recording. --diff, --diagnose and --verify add what those commands say with their usual
settings; --rig names the nominal model for the latter two. What a recording that was cut or
damaged still holds is shown with a warning, and the exit code is 3; in place of what --diff,
--diagnose and --verify would add stands why it is missing. A flight that missed its criteria ends
with 0: the page says so. docs/report.md tells what is in it.")]
pub struct Arguments {
    /// Recordings
    #[arg(required = true)]
    recordings: Vec<PathBuf>,
    /// Page to write
    #[arg(short, long, value_name = "FILE", default_value = "report.html")]
    output: PathBuf,
    /// Compare the two recordings, field by field
    #[arg(long)]
    diff: bool,
    /// Say where the sim-to-real gap lies and what causes it
    #[arg(long)]
    diagnose: bool,
    /// Hold the rig's model against the flights, which are open-loop ones
    #[arg(long)]
    verify: bool,
    #[command(flatten)]
    rig: NominalRig,
    #[command(flatten)]
    force: Force,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    let recordings = &arguments.recordings;
    if arguments.diff && recordings.len() != 2 {
        bail!(
            "--diff compares two recordings, and {} given; name two, or leave it out",
            given(recordings.len())
        );
    }
    if arguments.rig.rig.is_some() && !arguments.diagnose && !arguments.verify {
        bail!(
            "--rig is the model that flights are held against; add --diagnose or --verify, or leave it out"
        );
    }
    Outputs::new(arguments.force.force)
        .and(arguments.output.as_path(), Form::Html)
        .from(recordings.iter().map(PathBuf::as_path))
        .check()?;
    let mut flights = Vec::new();
    let mut is_lossy = false;
    for path in recordings {
        let loaded = Loaded::read(path)?;
        for warning in &loaded.warnings {
            words::warn(format_args!("{warning}"));
        }
        is_lossy |= loaded.is_lossy;
        flights.push(Flown::new(loaded));
    }
    files::write_and_say(&arguments.output, &page(&flights, further(arguments)?))?;
    Ok(if is_lossy { Exit::DataLoss } else { Exit::Done })
}

fn given(count: usize) -> String {
    if count == 1 { "1 is".to_owned() } else { format!("{count} are") }
}

/// What else was asked for. A part that a damaged recording does not allow says why.
fn further(arguments: &Arguments) -> anyhow::Result<Vec<Section>> {
    let recordings = &arguments.recordings;
    let mut sections = Vec::new();
    if let ([a, b], true) = (recordings.as_slice(), arguments.diff) {
        let title = format!("Difference: {} and {}", words::file_name(a), words::file_name(b));
        sections.push(part("--diff", &title, || {
            let report = compared(a, b, DiffOptions::default())?;
            Ok((html_verdict(&report), html_sections(&report)))
        })?);
    }
    if arguments.diagnose {
        sections.push(part("--diagnose", "Diagnosis", || {
            let (report, rig) = diagnosed(recordings, &arguments.rig)?;
            Ok((diagnosis_page::verdict(&report, &rig), diagnosis_page::sections(&report, &rig)))
        })?);
    }
    if arguments.verify {
        sections.push(part("--verify", "Verification", || {
            let (found, rig) = verified(recordings, &arguments.rig, &Tolerance::default())?;
            Ok((model_page::verification_verdict(&found, &rig), model_page::verification_sections(&found)))
        })?);
    }
    Ok(sections)
}

/// A part of the page, or in its place what keeps a damaged recording from having it.
fn part(
    flag: &'static str,
    title: &str,
    make: impl FnOnce() -> anyhow::Result<(Verdict, Vec<Section>)>,
) -> anyhow::Result<Section> {
    let section = Section::new(title, html! {});
    match make().context(flag) {
        Ok((verdict, parts)) => Ok(section.verdict(verdict).parts(parts)),
        Err(error) if is_of_damage(&error) => {
            let why = words::causes(&error);
            words::warn(&why);
            Ok(section
                .verdict(Verdict::new(Tone::Odd, "Left out: a recording is damaged").with(warnings(&[why]))))
        }
        Err(error) => Err(error),
    }
}

/// Whether a recording is not whole, which the page shows as far as it goes.
fn is_of_damage(error: &anyhow::Error) -> bool {
    let not_whole = |error: &RecordingError| {
        matches!(error, RecordingError::Unfinished { .. } | RecordingError::Damaged { .. })
    };
    error.chain().filter_map(|cause| cause.downcast_ref()).any(not_whole)
}
