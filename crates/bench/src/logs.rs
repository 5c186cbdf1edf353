//! Flights from files of any kind: recordings as they are, logs by their maps.

#[cfg(feature = "exchange")]
mod flown;

use std::path::Path;

use bench_recording::{FileKind, Flight, Mode, Recording, Session};
use bench_rig::{Actuation, Rig};

#[cfg(feature = "exchange")]
pub use flown::{Flown, import_map, is_own};

/// The kind of a log that is read without being told how; `None` of recordings and all else.
pub fn kind(path: &Path) -> Option<FileKind> {
    FileKind::of(path).ok().filter(|kind| matches!(kind, FileKind::Ulog | FileKind::Dataflash))
}

/// The flight of a recording, or of a log that `bench import` reads without a map's name.
pub fn flight(path: &Path) -> anyhow::Result<Flight> {
    if kind(path).is_some() { log(path) } else { Ok(Flight::load(path)?) }
}

#[cfg(feature = "exchange")]
fn log(path: &Path) -> anyhow::Result<Flight> {
    Ok(Flown::read(path, None)?.flight)
}

#[cfg(not(feature = "exchange"))]
fn log(path: &Path) -> anyhow::Result<Flight> {
    Err(crate::left_out::left_out(&format!("the readers of logs such as {}", path.display()), "exchange"))
}

/// What a recording says of itself; nothing of a log.
pub fn session(path: &Path) -> anyhow::Result<Session> {
    if kind(path).is_some() {
        Ok(Session::new(Mode::Import))
    } else {
        Ok(Recording::open(path)?.session().clone())
    }
}

/// The unit of a flight's throttle, where its file says it.
pub fn actuation(flight: &Flight) -> Option<Actuation> {
    if let Some(text) = flight.rig_toml() {
        return Rig::read(Path::new("rig.toml"), text).ok().map(|rig| rig.airframe.actuation);
    }
    let unit = flight.session.extra.get("import.actuation")?;
    Actuation::CHOICES.iter().map(|(_, choice)| *choice).find(|choice| choice.unit() == unit)
}
