//! Flights as the diagnosis and the identification take them.

use std::path::{Path, PathBuf};

use bench_filter::Track;
use bench_recording::Flight;
use bench_rig::Rig;
use clap::{Args, ValueEnum};

use crate::recorded::Recorded;

/// How flights are read, and what of them is used.
#[derive(Args, Default)]
pub struct Selection {
    /// Map by which logs are read that need one: a file, or the name of a built-in one. Recordings are read as they are
    #[arg(long, value_name = "MAP")]
    map: Option<PathBuf>,
    /// Use only what was flown above this altitude, m: for flights whose take-off and landing are no vertical ones
    /// from a firm floor
    #[arg(long, value_name = "METRES", value_parser = altitude)]
    above: Option<f64>,
    /// Leave a channel out as if it had not been recorded; may be given several times
    #[arg(long, value_name = "CHANNEL")]
    without: Vec<Left>,
}

/// A channel that can be left out.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Left {
    Battery,
    Motion,
    Readback,
    Rotor,
    Tick,
}

fn altitude(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(x) if (0.0..=1000.0).contains(&x) => Ok(x),
        _ => Err("a number of metres from 0 to 1000 is expected".to_owned()),
    }
}

impl Selection {
    /// The map by which logs are read.
    pub fn map(&self) -> Option<&Path> {
        self.map.as_deref()
    }

    /// What was asked for, as on the command line.
    pub fn options(&self) -> String {
        let above = self.above.map(|above_m| format!(" --above {above_m}"));
        let without = self
            .without
            .iter()
            .filter_map(|channel| Some(format!(" --without {}", channel.to_possible_value()?.get_name())));
        let map = self.map.iter().map(|map| format!(" --map {}", map.display()));
        map.chain(above).chain(without).collect()
    }

    /// The flights as a rig sees them, each shown to `look` before; those that cannot be used, and those that are given twice,
    /// are told in words.
    pub fn tracks(
        &self,
        flights: &[PathBuf],
        rig: &Rig,
        mut look: impl FnMut(&Path, &Flight),
    ) -> anyhow::Result<(Vec<Track>, Vec<String>)> {
        let recorded = Recorded::read(flights, self.map(), |path, mut flight| {
            look(path, &flight);
            for channel in &self.without {
                match channel {
                    Left::Battery => flight.battery.clear(),
                    Left::Motion => flight.motion.clear(),
                    Left::Readback => flight.readbacks.clear(),
                    Left::Rotor => flight.rotor.clear(),
                    Left::Tick => flight.ticks.clear(),
                }
            }
            let track = Track::from_flight(&path.display().to_string(), &flight, rig);
            Ok(match self.above {
                Some(above_m) => track.and_then(|track| track.above(above_m, rig)),
                None => track,
            })
        })?;
        let mut tracks = Vec::new();
        let mut remarks = recorded.remarks;
        for track in recorded.made {
            match track {
                Ok(track) => tracks.push(track),
                Err(error) => remarks.push(error.to_string()),
            }
        }
        Ok((tracks, remarks))
    }
}
