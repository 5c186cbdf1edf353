//! Flights as the diagnosis and the identification take them.

use std::path::{Path, PathBuf};

use bench_filter::Track;
use bench_recording::Flight;
use bench_rig::Rig;
use clap::{Args, ValueEnum};

use crate::recorded::Recorded;

/// Which flights, and what of them.
#[derive(Args)]
pub struct Selection {
    /// Recordings of flights, or logs of autopilots as `bench import` reads them without a map
    #[arg(required = true)]
    pub flights: Vec<PathBuf>,
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
    /// These flights, all of them and all of each.
    pub fn whole(flights: Vec<PathBuf>) -> Self {
        Self { flights, above: None, without: Vec::new() }
    }

    /// Other flights, of which the same is used.
    pub fn of(&self, flights: &[PathBuf]) -> Self {
        Self { flights: flights.to_vec(), above: self.above, without: self.without.clone() }
    }

    /// What was asked for beside the flights, as on the command line.
    pub fn options(&self) -> String {
        let above = self.above.map(|above_m| format!(" --above {above_m}"));
        let without = self
            .without
            .iter()
            .filter_map(|channel| Some(format!(" --without {}", channel.to_possible_value()?.get_name())));
        above.into_iter().chain(without).collect()
    }

    /// The flights as a rig sees them, each shown to `look` before; those that cannot be used, and those that are given twice,
    /// are told in words.
    pub fn tracks(
        &self,
        rig: &Rig,
        mut look: impl FnMut(&Path, &Flight),
    ) -> anyhow::Result<(Vec<Track>, Vec<String>)> {
        let recorded = Recorded::read(&self.flights, |path, mut flight| {
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
