mod balance;

use std::path::PathBuf;

use anyhow::{Context, bail};
use bench_dac::emulator::{EmulatedPsoc5, LinkFaults};
use bench_run::Granted;
use clap::{Args, Subcommand};
use tokio::signal::unix::{SignalKind, signal};

use crate::{exit::Exit, words};

/// Stand in for hardware
#[derive(Args)]
pub struct Arguments {
    #[command(subcommand)]
    device: Device,
}

#[derive(Subcommand)]
enum Device {
    Psoc5(Psoc5),
    Balance(balance::Balance),
}

/// A PSoC5 board on a pseudo terminal, its outputs wired to its inputs, until Ctrl-C
#[derive(Args)]
#[command(after_help = "Examples:
  bench emulate psoc5 --link /tmp/psoc5 &
  bench hil --port /tmp/psoc5
  bench emulate psoc5 --latency-ms 20 --jitter-ms 10 --drop 0.02
  bench emulate psoc5 --link /tmp/psoc5 --unplug 8:2

The port is the first line on standard output. Times in seconds count from when the board was
first armed.")]
struct Psoc5 {
    /// Also make a symbolic link to the port, which stays the same when the board is unplugged and plugged in again
    #[arg(long, value_name = "PATH")]
    link: Option<PathBuf>,
    /// Delay of each frame, either way
    #[arg(long, value_name = "MS", default_value_t = 0.0)]
    latency_ms: f64,
    /// Added to that, evenly between 0 and this
    #[arg(long, value_name = "MS", default_value_t = 0.0)]
    jitter_ms: f64,
    /// Probability that a frame is lost, either way
    #[arg(long, value_name = "P", default_value_t = 0.0)]
    drop: f64,
    /// Probability that a bit of a frame flips, either way
    #[arg(long, value_name = "P", default_value_t = 0.0)]
    corrupt: f64,
    /// Time constant with which the outputs follow what they are set to
    #[arg(long, value_name = "MS", default_value_t = 0.0)]
    dac_lag_ms: f64,
    /// The throttle's output is off by so much, once the board is armed: after it was calibrated
    #[arg(long, value_name = "MV", default_value_t = 0.0, allow_negative_numbers = true)]
    dac_offset_mv: f64,
    /// The board hangs at a time, for a time
    #[arg(long, value_name = "AT:FOR")]
    stall: Option<String>,
    /// The board is unplugged at a time and plugged in again after a time, if one is given
    #[arg(long, value_name = "AT[:FOR]")]
    unplug: Option<String>,
    /// The board's supply sags at a time
    #[arg(long, value_name = "AT")]
    brown_out: Option<f64>,
    /// Speak another version of the protocol
    #[arg(long, value_name = "N")]
    protocol_version: Option<u8>,
    /// Seed of all that is random
    #[arg(long, default_value_t = 0)]
    seed: u64,
}

pub fn run(arguments: Arguments) -> anyhow::Result<Exit> {
    let arguments = match arguments.device {
        Device::Psoc5(arguments) => arguments,
        Device::Balance(arguments) => return balance::run(&arguments),
    };
    let faults = arguments.faults()?;
    // A real board does not wait for this machine's processes: where that is granted, neither does this one.
    let _ = Granted::ask();
    let runtime = tokio::runtime::Builder::new_current_thread().enable_io().build()?;
    runtime.block_on(async {
        let mut interrupt = signal(SignalKind::interrupt())?;
        let mut terminate = signal(SignalKind::terminate())?;
        let board = EmulatedPsoc5::start(faults, arguments.seed, arguments.link.as_deref())?;
        words::print(&board.port().display().to_string())?;
        tokio::select! {
            _ = interrupt.recv() => {}
            _ = terminate.recv() => {}
        }
        let applied = board.history().iter().filter(|moment| moment.applied).count() as u64;
        crate::words::say!("{} applied", words::count(applied, "command"));
        Ok(Exit::Done)
    })
}

impl Psoc5 {
    fn faults(&self) -> anyhow::Result<LinkFaults> {
        let seconds = |name, ms| Ok::<_, anyhow::Error>(within(name, ms, 60_000.0)? / 1000.0);
        let unplug = match &self.unplug {
            None => None,
            Some(text) => match text.split_once(':') {
                Some((at, again)) => Some((time("--unplug", at)?, Some(time("--unplug", again)?))),
                None => Some((time("--unplug", text)?, None)),
            },
        };
        let stall = match &self.stall {
            None => None,
            Some(text) => {
                let (at, length) = text.split_once(':').context("--stall wants AT:FOR, for example 8:0.5")?;
                Some((time("--stall", at)?, time("--stall", length)?))
            }
        };
        if self.unplug.is_some() && self.link.is_none() && unplug.is_some_and(|(_, again)| again.is_some()) {
            bail!("a port that is plugged in again has another name; add --link so that it can be found");
        }
        Ok(LinkFaults {
            latency_s: seconds("--latency-ms", self.latency_ms)?,
            jitter_s: seconds("--jitter-ms", self.jitter_ms)?,
            drop: within("--drop", self.drop, 1.0)?,
            corrupt: within("--corrupt", self.corrupt, 1.0)?,
            stall,
            unplug,
            brown_out: self.brown_out.map(|at_s| within("--brown-out", at_s, 1e6)).transpose()?,
            dac_lag_s: seconds("--dac-lag-ms", self.dac_lag_ms)?,
            dac_offset_v: between("--dac-offset-mv", self.dac_offset_mv, -1000.0, 1000.0)? / 1000.0,
            protocol_version: self.protocol_version,
        })
    }
}

fn time(name: &str, text: &str) -> anyhow::Result<f64> {
    let seconds = text.parse().with_context(|| format!("{name} wants seconds, not {text:?}"))?;
    within(name, seconds, 1e6)
}

fn within(name: &str, value: f64, most: f64) -> anyhow::Result<f64> {
    between(name, value, 0.0, most)
}

fn between(name: &str, value: f64, least: f64, most: f64) -> anyhow::Result<f64> {
    if !(least..=most).contains(&value) {
        bail!("{name} must be from {least} to {most}, not {value}");
    }
    Ok(value)
}
