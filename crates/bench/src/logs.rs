//! Flights from files of any kind: recordings as they are, logs by their maps.

use std::path::Path;

use anyhow::{Context, bail};
use bench_logs::{Format, Survey};
use bench_recording::{Channel, FileKind, Flight, Mode, Recording, Session, import::import};
use bench_rig::{Actuation, Rig};

use crate::{commands::import::map_of, files};

/// A flight and what its file says beside it.
pub struct Flown {
    /// The file as it was named.
    pub name: String,
    pub flight: Flight,
    /// The unit of the throttle; `None` where the file does not say it.
    pub actuation: Option<Actuation>,
    /// What its log tells of parameters, by name.
    pub survey: Option<Survey>,
}

impl Flown {
    /// Reads a recording, or a log by the map named, or by the one that `bench import` takes without a name.
    pub fn read(path: &Path, map: Option<&Path>) -> anyhow::Result<Self> {
        let name = path.display().to_string();
        let kind = FileKind::of(path).with_context(|| format!("cannot read {name}"))?;
        if map.is_none() && kind == FileKind::Mcap && is_own(path) {
            let flight = Flight::load(path)?;
            let actuation = actuation(&flight);
            return Ok(Self { name, flight, actuation, survey: None });
        }
        if let FileKind::OwnTable(_) = kind
            && map.is_none()
        {
            bail!("{name} was exported from a recording: name the recording, which holds more");
        }
        let map = match map {
            Some(map) => files::import_map(map)?,
            None => map_of(path, false)?,
        };
        let rig = map.rig.as_deref().map(files::rig).transpose()?;
        let folder = tempfile::tempdir().context("cannot make a folder for what is imported")?;
        let imported = folder.path().join("flight.mcap");
        import(&map, path, &imported, rig.as_ref())?;
        let flight = Flight::load(&imported)?;
        let survey = kind.log_format().map(|format| Survey::of(path, format)).transpose()?;
        Ok(Self { actuation: actuation(&flight), name, flight, survey })
    }

    /// A parameter of the autopilot.
    pub fn parameter(&self, name: &str) -> Option<f64> {
        self.survey.as_ref()?.parameters.get(name).copied().filter(|value| value.is_finite())
    }
}

/// Whether an MCAP file is a recording of the bench's, whole or cut.
pub fn is_own(path: &Path) -> bool {
    match Recording::open(path) {
        Ok(recording) => Channel::ALL.iter().any(|channel| recording.count(*channel) > 0),
        Err(_) => Survey::of(path, Format::Mcap)
            .is_ok_and(|survey| survey.topics.iter().any(|found| found.topic.kind.starts_with("bench.v1."))),
    }
}

/// The kind of a log that is read without being told how; `None` of recordings and all else.
pub fn kind(path: &Path) -> Option<FileKind> {
    FileKind::of(path).ok().filter(|kind| *kind != FileKind::Mcap && kind.log_format().is_some())
}

/// The flight of a recording, or of a log that `bench import` reads without a map's name.
pub fn flight(path: &Path) -> anyhow::Result<Flight> {
    if kind(path).is_some() { Ok(Flown::read(path, None)?.flight) } else { Ok(Flight::load(path)?) }
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
