use std::{fmt::Write as _, path::PathBuf};

use bench_recording::Info;
use clap::Args;

use crate::{arguments::Json, exit::Exit, words};

/// Say what a recording holds
#[derive(Args)]
#[command(after_help = "Example:
  bench info recordings/virtual_climb-040_seed0.mcap

Exit code 3 says that the recording was not closed.")]
pub struct Arguments {
    /// Recording
    recording: PathBuf,
    #[command(flatten)]
    json: Json,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    let info = info(arguments)?;
    if arguments.json.json {
        words::print_json(&info)?;
    } else {
        words::print(&in_words(&info))?;
    }
    if info.closed {
        return Ok(Exit::Done);
    }
    words::warn(format_args!(
        "{} was not closed, its end may be missing; `bench recover` makes a whole recording of it",
        info.path.display()
    ));
    Ok(Exit::DataLoss)
}

/// What the recording holds.
pub fn info(arguments: &Arguments) -> anyhow::Result<Info> {
    Ok(Info::read(&arguments.recording)?)
}

fn in_words(info: &Info) -> String {
    let mut out = format!(
        "{}: {:.1} s in mode {}, {}, {}\n",
        info.path.display(),
        info.duration_s,
        info.mode,
        words::count(info.messages, "message"),
        words::size(info.size_bytes)
    );
    let mut line = |name: &str, value: &str| {
        if !value.is_empty() {
            let _ = writeln!(out, "  {name:<10} {value}");
        }
    };
    line("rig", &info.rig);
    line("mission", &info.mission);
    line("seed", &info.seed.map(|seed| seed.to_string()).unwrap_or_default());
    line("bench", &format!("{} on {}", info.bench_version, info.platform));
    if info.recovered {
        line("recovered", "yes: its end may be missing");
    }
    if let Some(dropped) = info.dropped.filter(|dropped| *dropped > 0) {
        line("dropped", &words::count(dropped, "record"));
    }
    for (key, value) in &info.extra {
        line(key, value);
    }
    for channel in &info.channels {
        let _ = writeln!(
            out,
            "  {:<20} {:>9}  {}",
            channel.name,
            words::grouped(channel.messages),
            channel.message
        );
    }
    for attachment in &info.attachments {
        let _ = writeln!(out, "  attached {} ({})", attachment.name, words::size(attachment.size_bytes));
    }
    out
}
