//! A flight of a sweep as a recording.

use std::path::Path;

use bench_recording::{Finished, Options, Recorder, Session};
use bench_run::simulate_on;

use crate::{
    CampaignError,
    perform::{drawn_in_words, effect_in_words},
    plan::FlightRun,
};

/// Flies a run again and records it. The recording of a nominal airframe is the one that `bench sim` makes, byte for byte.
pub fn record(flight: &FlightRun<'_>, path: &Path) -> Result<Finished, CampaignError> {
    let added: Vec<String> =
        flight.plant.effects.iter().skip(flight.nominal.effects.len()).map(effect_in_words).collect();
    let mut session = Session::simulated(flight.nominal, &added, flight.mission, flight.seed);
    if flight.plant.airframe != flight.nominal.airframe {
        session.extra.insert("drawn_airframe".to_owned(), drawn_in_words(&flight.plant));
    }
    let mut recorder = Recorder::create(path, &session, Options::SIMULATION)?;
    simulate_on(&flight.plant, flight.nominal, flight.mission, flight.seed, &mut recorder, |_| true)?;
    Ok(recorder.finish()?)
}
