use std::path::Path;

use bench_rig::Rig;

use crate::{Channel, Field, Kind, Recording, RecordingError, Session, Value};

/// A column's heading and the kind of its values.
#[derive(Clone, Debug)]
pub(crate) struct Column {
    pub name: String,
    pub kind: Kind,
}

/// Takes a row; its values stand in the order of the columns.
pub(crate) type TakeRow<'a> = dyn FnMut(&[Value]) -> Result<(), RecordingError> + 'a;

/// Rows of values, one after another.
pub(crate) trait Table {
    fn name(&self) -> &str;
    fn columns(&self) -> &[Column];
    fn row_count(&self) -> u64;
    fn for_each_row(&self, take: &mut TakeRow) -> Result<(), RecordingError>;
}

/// The messages of one channel, streamed from the file.
pub(crate) struct ChannelTable<'a> {
    recording: &'a Recording,
    channel: Channel,
    columns: Vec<Column>,
}

impl<'a> ChannelTable<'a> {
    pub fn new(recording: &'a Recording, channel: Channel) -> Self {
        let actuation = actuation_suffix(recording.session());
        let columns = channel
            .fields()
            .iter()
            .map(|field| Column { name: column_name(field, actuation), kind: field.kind });
        Self { recording, channel, columns: columns.collect() }
    }
}

impl Table for ChannelTable<'_> {
    fn name(&self) -> &str {
        self.channel.topic()
    }

    fn columns(&self) -> &[Column] {
        &self.columns
    }

    fn row_count(&self) -> u64 {
        self.recording.count(self.channel)
    }

    fn for_each_row(&self, take: &mut TakeRow) -> Result<(), RecordingError> {
        for record in self.recording.records()? {
            let record = record?;
            if record.channel() == self.channel {
                take(&record.values())?;
            }
        }
        Ok(())
    }
}

/// The field's name as a heading that query languages take without quotes: `position_m_z`, `sticks_throttle_v`.
fn column_name(field: &Field, actuation: &str) -> String {
    let name = field.name.replace('.', "_");
    if field.unit == Field::ACTUATION { format!("{name}_{actuation}") } else { name }
}

/// The ending of names of sticks: the unit of the rig's actuation, where the attached rig tells it.
pub(crate) fn actuation_suffix(session: &Session) -> &'static str {
    let rig = session.rig_toml.as_deref().map(|text| Rig::read(Path::new("rig.toml"), text));
    match rig {
        Some(Ok(rig)) => rig.airframe.actuation.suffix(),
        _ => Field::ACTUATION,
    }
}
