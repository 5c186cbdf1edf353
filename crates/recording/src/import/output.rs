//! The recording while it is written.

use std::{fs::File, path::Path};

use bench_device::Time;
use bench_rig::Rig;

use super::{ImportMap, ImportReport, map::Setting};
use crate::{Mode, Options, Record, Recorder, RecordingError, Session, partial::PartialFile};

/// A recording under a temporary name until it is whole.
pub(super) struct Output {
    recorder: Recorder,
    partial: PartialFile,
    file: File,
    /// The log's time at the recording's origin.
    pub origin_ns: i128,
}

impl Output {
    pub fn open(
        report: &ImportReport,
        map: &ImportMap,
        rig: Option<&Rig>,
        origin_ns: i128,
    ) -> Result<Self, RecordingError> {
        let session = session(&report.log, map, rig, origin_ns);
        let (partial, file) = PartialFile::create(&report.output)?;
        let recorder = Recorder::create(partial.temporary(), &session, Options::SIMULATION)?;
        Ok(Self { recorder, partial, file, origin_ns })
    }

    /// Whether a time of the log can be told in the recording.
    pub fn reaches(&self, nanos: i128) -> bool {
        u64::try_from(nanos - self.origin_ns).is_ok()
    }

    /// The recording's time at a time of the log that it reaches.
    pub fn time(&self, nanos: i128) -> Time {
        Time::from_nanos(u64::try_from(nanos - self.origin_ns).unwrap_or(u64::MAX))
    }

    pub fn put(&mut self, record: Record, report: &mut ImportReport) {
        *report.channels.entry(record.channel().topic()).or_default() += 1;
        self.recorder.record(record);
    }

    pub fn finish(self) -> Result<(), RecordingError> {
        self.recorder.finish()?;
        self.partial.complete(&self.file)
    }
}

/// What the recording says of itself.
fn session(log: &Path, map: &ImportMap, rig: Option<&Rig>, origin_ns: i128) -> Session {
    let mut session = Session::new(Mode::Import);
    if let Some(rig) = rig {
        session = session.with_rig(rig);
    }
    let log = log.file_name().unwrap_or_default().to_string_lossy().into_owned();
    session.extra.extend([
        ("import.log".to_owned(), log),
        ("import.map".to_owned(), map.name.clone()),
        ("import.map_toml".to_owned(), map.text.clone()),
        ("import.time_offset_s".to_owned(), seconds(origin_ns)),
    ]);
    // Where the rig gave it, the rig says so.
    if let (Setting::Given(latency_s), None) = (&map.latency, &map.exposed) {
        session.extra.insert("import.latency_s".to_owned(), latency_s.to_string());
    }
    // Samples of a log of topics arrive when they are stamped: their age is in the log, whatever a rig says.
    if map.log.is_some() && map.exposed.is_some() {
        session.extra.insert("import.exposed_at".to_owned(), "told".to_owned());
    }
    if map.has_sticks() {
        session.extra.insert("import.actuation".to_owned(), map.actuation.unit().to_owned());
    }
    session
}

/// Nanoseconds as seconds, exactly.
fn seconds(nanos: i128) -> String {
    let sign = if nanos < 0 { "-" } else { "" };
    let nanos = nanos.unsigned_abs();
    format!("{sign}{}.{:09}", nanos / 1_000_000_000, nanos % 1_000_000_000)
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_offset_keeps_its_sign_and_every_digit() {
        assert_eq!(super::seconds(1_772_429_894_780_505_180), "1772429894.780505180");
        assert_eq!(super::seconds(-500_000_000), "-0.500000000");
    }
}
