//! Flights from logs of other programs.

use std::path::Path;

use anyhow::{Context, bail};
use bench_logs::{Format, Survey};
use bench_recording::{
    Channel, FileKind, Flight, Recording,
    import::{ImportMap, import},
};
use bench_rig::Actuation;

use super::actuation;
use crate::{commands::import::map_of, files, library::Kind};

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
        if kind == FileKind::Mcap && is_own(path) {
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
            Some(map) => import_map(map)?,
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

/// Reads an import map: a file, or one of the library by its name.
pub fn import_map(named: &Path) -> anyhow::Result<ImportMap> {
    let (path, text) = files::text_of(Kind::ImportMap, named)?;
    Ok(ImportMap::read(&path, &text)?)
}
