use std::path::PathBuf;

use bench_recording::recover;
use clap::Args;

use crate::{
    arguments::{Force, Json},
    exit::Exit,
    files::{self, Form, Outputs},
    words,
};

/// Make a whole recording of one that was cut or left open
#[derive(Args)]
#[command(after_help = "Example:
  bench recover cut.mcap -o whole.mcap

Exit code 3 says that something at the end (or a damaged part) was lost.")]
pub struct Arguments {
    /// The damaged recording; it is not changed
    recording: PathBuf,
    /// The recording to write
    #[arg(short, long)]
    output: PathBuf,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    json: Json,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    Outputs::new(arguments.force.force)
        .and(arguments.output.as_path(), Form::Recording)
        .from([arguments.recording.as_path()])
        .check()?;
    files::make_folder(&arguments.output)?;
    let report = recover(&arguments.recording, &arguments.output)?;
    if arguments.json.json {
        words::print_json(&report)?;
    } else {
        let lost = match (&report.stopped_by, report.damaged_records, report.trailing_bytes) {
            _ if !report.lost => "nothing was lost".to_owned(),
            (_, damaged, _) if damaged > 0 => format!("lost: {}", words::count(damaged, "damaged record")),
            (Some(reason), ..) => format!("lost what came after: {reason}"),
            (None, _, bytes) => format!("lost: {} after the last whole record", words::size(bytes)),
        };
        words::print(&format!(
            "{} from {} to {}; {lost}",
            words::count(report.messages, "message"),
            arguments.recording.display(),
            arguments.output.display()
        ))?;
    }
    Ok(if report.lost { Exit::DataLoss } else { Exit::Done })
}
