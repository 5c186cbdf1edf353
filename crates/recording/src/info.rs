use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use bench_device::Time;
use mcap::{
    records::{Record, op},
    sans_io::LinearReaderOptions,
};
use serde::Serialize;

use crate::{
    RecordingError, Session,
    container::{self, Container, RecordStream, Summary},
    session::{
        DROPPED, END_METADATA, EXTRA_METADATA, MISSION_ATTACHMENT, RECOVERED, RIG_ATTACHMENT,
        RecordedSession, SESSION_METADATA,
    },
};

/// What a recording is and holds; as JSON, schema `bench.info/1`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Info {
    /// `bench.info/1`.
    pub schema: &'static str,
    /// Where it is.
    pub path: PathBuf,
    /// Size of the file.
    pub size_bytes: u64,
    /// Whether it was closed. An open one counts what is whole in it.
    pub closed: bool,
    /// Whether it was made by [`crate::recover`] from a damaged or open one.
    pub recovered: bool,
    /// `sim`, `hil` or `import`.
    pub mode: String,
    /// The rig's name.
    pub rig: String,
    /// The mission's name.
    pub mission: String,
    /// The seed of a simulation's noise.
    pub seed: Option<u64>,
    /// The bench that recorded it.
    pub bench_version: String,
    /// Version of channels and metadata.
    pub schema_version: u32,
    /// Processor and operating system that recorded it.
    pub platform: String,
    /// The origin of its times, s since 1970 (UTC), if it tells.
    pub epoch_unix_s: Option<f64>,
    /// Log time of the first message since the origin, s; absent without messages.
    pub first_time_s: Option<f64>,
    /// Log time of the last message since the origin, s; absent without messages.
    pub last_time_s: Option<f64>,
    /// From the first to the last message, s.
    pub duration_s: f64,
    /// All messages.
    pub messages: u64,
    /// Records that found the recorder's queue full; absent in an open recording.
    pub dropped: Option<u64>,
    /// Channels with at least one message, by name.
    pub channels: Vec<ChannelInfo>,
    /// Attached files.
    pub attachments: Vec<AttachmentInfo>,
    /// What else the session tells.
    pub extra: BTreeMap<String, String>,
}

/// A channel of a recording.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ChannelInfo {
    /// Its topic.
    pub name: String,
    /// The protobuf message that it holds.
    pub message: String,
    /// How many messages it has.
    pub messages: u64,
}

/// A file attached to a recording.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct AttachmentInfo {
    /// Its name.
    pub name: String,
    /// Its size.
    pub size_bytes: u64,
}

impl Info {
    /// Reads a recording's particulars: of a closed one from its summary, of an open one by going through it.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, RecordingError> {
        Survey::read(path.as_ref()).map(|survey| survey.info)
    }
}

/// A recording's particulars and session.
#[derive(Debug)]
pub(crate) struct Survey {
    pub info: Info,
    pub session: Session,
    /// Where the summary says that chunks begin; `None` without a summary.
    pub chunks: Option<Vec<u64>>,
}

impl Survey {
    pub fn read(path: &Path) -> Result<Self, RecordingError> {
        let mut container = Container::open(path)?;
        match container.summary() {
            Ok(Some(mut summary)) => {
                let chunks = std::mem::take(&mut summary.chunks);
                let survey = Findings::from_summary(&mut container, summary)?.survey(&container, true)?;
                Ok(Self { chunks: Some(chunks), ..survey })
            }
            Ok(None) => Findings::by_scan(&mut container)?.survey(&container, true),
            Err(RecordingError::Unfinished { .. }) => {
                Findings::by_scan(&mut container)?.survey(&container, false)
            }
            Err(error) => Err(error),
        }
    }
}

/// What was found in a file before it is known to be a recording of the bench.
#[derive(Default)]
struct Findings {
    metadata: BTreeMap<String, BTreeMap<String, String>>,
    attachments: Vec<AttachmentInfo>,
    rig_toml: Option<String>,
    mission_toml: Option<String>,
    schemas: BTreeMap<u16, String>,
    /// Topic and schema.
    channels: BTreeMap<u16, (String, u16)>,
    counts: BTreeMap<u16, u64>,
    /// Log times of the earliest and the latest message, ns.
    span_ns: Option<(u64, u64)>,
}

impl Findings {
    fn from_summary(container: &mut Container, summary: Summary) -> Result<Self, RecordingError> {
        let mut found = Self::default();
        for (schema, _) in summary.schemas {
            found.schemas.insert(schema.id, schema.name);
        }
        for channel in summary.channels {
            found.channels.insert(channel.id, (channel.topic, channel.schema_id));
        }
        if let Some(statistics) = summary.statistics {
            if statistics.message_count > 0 {
                found.span_ns = Some((statistics.message_start_time, statistics.message_end_time));
            }
            found.counts = statistics.channel_message_counts;
        }
        let metadata = summary.metadata.iter().map(|index| (index.offset, index.length));
        let attachments = summary.attachments.iter().map(|index| (index.offset, index.length));
        for (offset, length) in metadata.chain(attachments) {
            if let Some(record) = container.record_at(offset, length)? {
                found.add(record);
            }
        }
        Ok(found)
    }

    /// Goes through the whole file, as far as it can be read.
    fn by_scan(container: &mut Container) -> Result<Self, RecordingError> {
        let mut found = Self::default();
        container.rewind()?;
        let options = LinearReaderOptions::default().with_emit_chunks(true).with_skip_end_magic(true);
        let mut stream = RecordStream::new(&mut container.file, options);
        let mut body = Vec::new();
        while let Some(Ok(opcode)) = stream.next(&mut body) {
            if opcode == op::CHUNK {
                let mut records = container::records_of_chunk(&body);
                let mut body = Vec::new();
                while let Some(Ok(opcode)) = records.next(&mut body) {
                    found.parse(opcode, &body);
                }
            } else {
                found.parse(opcode, &body);
            }
        }
        Ok(found)
    }

    /// Adds a record if it can be read.
    fn parse(&mut self, opcode: u8, body: &[u8]) {
        if let Ok(record) = container::parse(opcode, body) {
            self.add(record);
        }
    }

    fn add(&mut self, record: Record) {
        match record {
            Record::Metadata(metadata) => {
                self.metadata.insert(metadata.name, metadata.metadata);
            }
            Record::Attachment { header, data, .. } => {
                let text = || String::from_utf8(data.to_vec()).ok();
                match header.name.as_str() {
                    RIG_ATTACHMENT => self.rig_toml = text(),
                    MISSION_ATTACHMENT => self.mission_toml = text(),
                    _ => {}
                }
                self.attachments.push(AttachmentInfo { name: header.name, size_bytes: data.len() as u64 });
            }
            Record::Schema { header, .. } => {
                self.schemas.insert(header.id, header.name);
            }
            Record::Channel(channel) => {
                self.channels.insert(channel.id, (channel.topic, channel.schema_id));
            }
            Record::Message { header, .. } => {
                *self.counts.entry(header.channel_id).or_default() += 1;
                let (first, last) = self.span_ns.unwrap_or((header.log_time, header.log_time));
                self.span_ns = Some((first.min(header.log_time), last.max(header.log_time)));
            }
            _ => {}
        }
    }

    fn survey(mut self, container: &Container, closed: bool) -> Result<Survey, RecordingError> {
        let path = &container.path;
        let Some(metadata) = self.metadata.get(SESSION_METADATA) else {
            return Err(self.no_session(path, closed));
        };
        let recorded = RecordedSession::from_metadata(path, metadata)?;
        let session = Session {
            rig_toml: self.rig_toml.take(),
            mission_toml: self.mission_toml.take(),
            extra: self.metadata.remove(EXTRA_METADATA).unwrap_or_default(),
            ..recorded.session
        };
        let end = self.metadata.get(END_METADATA);
        let epoch_ns = session.epoch_unix_ns.unwrap_or(0);
        let since_origin_s = |log_ns: u64| Time::from_nanos(log_ns.saturating_sub(epoch_ns)).seconds();
        let info = Info {
            schema: "bench.info/1",
            path: path.clone(),
            size_bytes: container.bytes,
            closed,
            recovered: end.is_some_and(|end| end.contains_key(RECOVERED)),
            mode: session.mode.to_string(),
            rig: session.rig_name.clone(),
            mission: session.mission_name.clone(),
            seed: session.seed,
            bench_version: recorded.bench_version,
            schema_version: recorded.schema_version,
            platform: recorded.platform,
            epoch_unix_s: session.epoch_unix_ns.map(|epoch_ns| epoch_ns as f64 * 1e-9),
            first_time_s: self.span_ns.map(|(first, _)| since_origin_s(first)),
            last_time_s: self.span_ns.map(|(_, last)| since_origin_s(last)),
            duration_s: self
                .span_ns
                .map_or(0.0, |(first, last)| Time::from_nanos(last.saturating_sub(first)).seconds()),
            messages: self.counts.values().sum(),
            dropped: end.and_then(|end| end.get(DROPPED)).and_then(|dropped| dropped.parse().ok()),
            channels: self.channels_with_messages(),
            attachments: self.attachments,
            extra: session.extra.clone(),
        };
        Ok(Survey { info, session, chunks: None })
    }

    fn no_session(&self, path: &Path, closed: bool) -> RecordingError {
        let path = path.to_owned();
        if self.channels.is_empty() && !closed {
            return RecordingError::Unfinished { path };
        }
        let schema = |id: &u16| self.schemas.get(id).map_or("", String::as_str);
        let with_schema = |(topic, id): &(String, u16)| match schema(id) {
            "" => topic.clone(),
            schema => format!("{topic} ({schema})"),
        };
        let mut channels: Vec<_> = self.channels.values().map(with_schema).collect();
        channels.sort();
        let has = |part: &str| self.schemas.values().any(|schema| schema.contains(part));
        let origin = match () {
            () if has("/msg/") => Some("ROS 2"),
            () if has("foxglove.") => Some("Foxglove"),
            () => None,
        };
        RecordingError::NotBench { path, origin, channels }
    }

    fn channels_with_messages(&self) -> Vec<ChannelInfo> {
        let mut channels: Vec<_> = self
            .channels
            .iter()
            .map(|(id, (topic, schema))| ChannelInfo {
                name: topic.clone(),
                message: self.schemas.get(schema).cloned().unwrap_or_default(),
                messages: self.counts.get(id).copied().unwrap_or_default(),
            })
            .filter(|channel| channel.messages > 0)
            .collect();
        channels.sort_by(|a, b| a.name.cmp(&b.name));
        channels
    }
}
