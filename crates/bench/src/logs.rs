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
    FileKind::of(path).ok().filter(FileKind::is_log)
}

/// The flight of a recording, or of a log, by the map named or by the one that `bench import` takes without a name.
pub fn flight(path: &Path, map: Option<&Path>) -> anyhow::Result<Flight> {
    if is_log(path, map) { log(path, map) } else { Ok(Flight::load(path)?) }
}

/// Whether a file is read as a log: those that need a map only where one is named.
fn is_log(path: &Path, map: Option<&Path>) -> bool {
    kind(path).is_some() || map.is_some() && !is_own(path)
}

#[cfg(feature = "exchange")]
fn log(path: &Path, map: Option<&Path>) -> anyhow::Result<Flight> {
    Ok(Flown::read(path, map)?.flight)
}

#[cfg(not(feature = "exchange"))]
fn log(path: &Path, _: Option<&Path>) -> anyhow::Result<Flight> {
    Err(crate::left_out::left_out(&format!("the readers of logs such as {}", path.display()), "exchange"))
}

/// Whether a file is a recording, as far as a program without readers of logs can tell.
#[cfg(not(feature = "exchange"))]
fn is_own(path: &Path) -> bool {
    Recording::open(path).is_ok()
}

/// What a recording says of itself; nothing of a log.
pub fn session(path: &Path, map: Option<&Path>) -> anyhow::Result<Session> {
    if is_log(path, map) {
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
