use std::{
    collections::{BTreeMap, BTreeSet},
    fs::{self, File},
    io::{self, BufWriter},
    path::Path,
};

use mcap::{
    records::{AttachmentHeader, Channel, MessageHeader, Metadata, Record, SchemaHeader, op},
    sans_io::LinearReaderOptions,
};
use serde::Serialize;

use crate::{
    RecordingError,
    container::{self, Container, RecordStream},
    layout::{ChannelKey, Layout},
    partial::PartialFile,
    session::{END_METADATA, RECOVERED, RecordedSession, SESSION_METADATA},
    writer::library,
};

/// What [`recover`] found; as JSON, schema `bench.recover/1`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct RecoverReport {
    /// `bench.recover/1`.
    pub schema: &'static str,
    /// Whether the input was closed.
    pub closed: bool,
    /// Whether the input holds something that could not be got back. An open input that ends with a whole record has
    /// lost nothing of what was written to it; what was recorded after its last flush never got there.
    pub lost: bool,
    /// Messages got back.
    pub messages: u64,
    /// Attachments got back, by name.
    pub attachments: Vec<String>,
    /// Metadata records got back, by name.
    pub metadata: Vec<String>,
    /// Chunks and other records whose content contradicts its checksum or the format, and chunks that the summary lists
    /// and that are not there.
    pub damaged_records: u64,
    /// Bytes after the last whole record.
    pub trailing_bytes: u64,
    /// What stopped the reading before the end of the data.
    pub stopped_by: Option<String>,
}

/// Makes a whole recording of one that was cut, damaged or left open: everything whose checksum holds comes back in its
/// order, with session and attachments. `output` appears only when it is whole; an ordinary file there is replaced.
pub fn recover(input: impl AsRef<Path>, output: impl AsRef<Path>) -> Result<RecoverReport, RecordingError> {
    let (input, output) = (input.as_ref(), output.as_ref());
    let mut container = Container::open(input)?;
    if same_file(input, output) {
        return Err(RecordingError::OutputIsInput { path: output.to_owned() });
    }
    let (partial, file) = PartialFile::create(output)?;
    let mut salvage = Salvage::start(file, &mut container).map_err(|error| partial.error(error))?;
    let copied = salvage.copy_all(&mut container);
    let session = salvage.session.take();
    let topics = salvage.definitions.topics();
    let (file, report) = salvage.finish(copied).map_err(|error| partial.error(error))?;
    let Some(session) = session else {
        return Err(RecordingError::NothingToRecover { path: input.to_owned(), channels: topics });
    };
    // What nobody could open again is not called recovered.
    RecordedSession::from_metadata(input, &session)?;
    partial.complete(&file)?;
    Ok(report)
}

/// Whether both are there and are one file.
pub(crate) fn same_file(a: &Path, b: &Path) -> bool {
    matches!((fs::canonicalize(a), fs::canonicalize(b)), (Ok(a), Ok(b)) if a == b)
}

/// Schemas and channels as known so far.
#[derive(Default)]
struct Definitions {
    schemas: BTreeMap<u16, (SchemaHeader, Vec<u8>)>,
    channels: BTreeMap<u16, Channel>,
}

impl Definitions {
    fn topics(&self) -> Vec<String> {
        self.channels.values().map(|channel| channel.topic.clone()).collect()
    }
}

/// A recording being copied as far as it is whole. Its functions err only where the output does; what is wrong with the
/// input goes into the report.
struct Salvage {
    layout: Layout<BufWriter<File>>,
    /// Where chunks begin that the summary lists and that were not met yet.
    chunks: BTreeSet<u64>,
    definitions: Definitions,
    /// Channels of the output by their number.
    channels: BTreeMap<u16, ChannelKey>,
    session: Option<BTreeMap<String, String>>,
    /// How the recorder ended the recording, if it did.
    end: BTreeMap<String, String>,
    report: RecoverReport,
}

impl Salvage {
    fn start(file: File, container: &mut Container) -> io::Result<Self> {
        let summary = container.summary();
        let closed = !matches!(summary, Err(RecordingError::Unfinished { .. }));
        let mut chunks = BTreeSet::new();
        let mut definitions = Definitions::default();
        // The chunk that defines a channel may be damaged; the summary repeats the definition.
        if let Ok(Some(summary)) = summary {
            for (header, data) in summary.schemas {
                definitions.schemas.insert(header.id, (header, data));
            }
            for channel in summary.channels {
                definitions.channels.insert(channel.id, channel);
            }
            chunks.extend(summary.chunks);
        }
        Ok(Self {
            layout: Layout::start(BufWriter::new(file), library())?,
            chunks,
            definitions,
            channels: BTreeMap::new(),
            session: None,
            end: BTreeMap::new(),
            report: RecoverReport {
                schema: "bench.recover/1",
                closed,
                lost: false,
                messages: 0,
                attachments: Vec::new(),
                metadata: Vec::new(),
                damaged_records: 0,
                trailing_bytes: 0,
                stopped_by: None,
            },
        })
    }

    fn copy_all(&mut self, container: &mut Container) -> io::Result<()> {
        if let Err(error) = container.rewind() {
            self.report.stopped_by = Some(error.to_string());
            return Ok(());
        }
        let options = LinearReaderOptions::default().with_emit_chunks(true).with_skip_end_magic(true);
        let mut stream = RecordStream::new(&mut container.file, options);
        let mut body = Vec::new();
        let mut whole_bytes = mcap::MAGIC.len() as u64;
        while let Some(read) = stream.next(&mut body) {
            match read {
                Ok(op::DATA_END) if self.chunks.is_empty() => return Ok(()),
                Ok(op::CHUNK) => {
                    self.chunks.remove(&whole_bytes);
                    self.copy_chunk(&body)?;
                }
                // What the recorder puts into chunks stands nowhere else, where no checksum would cover it; the summary, which
                // repeats definitions, was read.
                Ok(op::MESSAGE | op::SCHEMA | op::CHANNEL | op::DATA_END) => self.report.damaged_records += 1,
                Ok(opcode) => self.copy_record(opcode, &body)?,
                Err(error) => {
                    self.report.stopped_by = Some(error.to_string());
                    break;
                }
            }
            whole_bytes += container::RECORD_HEAD + body.len() as u64;
        }
        self.report.trailing_bytes = container.bytes.saturating_sub(whole_bytes);
        Ok(())
    }

    fn copy_chunk(&mut self, chunk: &[u8]) -> io::Result<()> {
        let mut records = container::records_of_chunk(chunk);
        let mut body = Vec::new();
        while let Some(read) = records.next(&mut body) {
            match read {
                Ok(opcode) => self.copy_record(opcode, &body)?,
                Err(_) => self.report.damaged_records += 1,
            }
        }
        Ok(())
    }

    fn copy_record(&mut self, opcode: u8, body: &[u8]) -> io::Result<()> {
        match container::parse(opcode, body) {
            Ok(Record::Metadata(metadata)) => self.copy_metadata(metadata)?,
            Ok(Record::Attachment { header, data, .. }) => self.copy_attachment(header, &data)?,
            Ok(Record::Schema { header, data }) => {
                self.definitions.schemas.entry(header.id).or_insert((header, data.into_owned()));
            }
            Ok(Record::Channel(channel)) => {
                self.definitions.channels.entry(channel.id).or_insert(channel);
            }
            Ok(Record::Message { header, data }) => self.copy_message(&header, &data)?,
            Ok(_) => {}
            Err(_) => self.report.damaged_records += 1,
        }
        Ok(())
    }

    fn copy_metadata(&mut self, metadata: Metadata) -> io::Result<()> {
        if metadata.name == END_METADATA {
            self.end = metadata.metadata;
            return Ok(());
        }
        self.layout.add_metadata(&metadata)?;
        if metadata.name == SESSION_METADATA {
            self.session = Some(metadata.metadata);
        }
        self.report.metadata.push(metadata.name);
        Ok(())
    }

    fn copy_attachment(&mut self, header: AttachmentHeader, data: &[u8]) -> io::Result<()> {
        self.report.attachments.push(header.name.clone());
        self.layout.attach(header, data)
    }

    fn copy_message(&mut self, header: &MessageHeader, data: &[u8]) -> io::Result<()> {
        let &MessageHeader { channel_id, sequence, log_time, publish_time } = header;
        let Some(channel) = self.channel(channel_id)? else {
            self.report.damaged_records += 1;
            return Ok(());
        };
        let append = |out: &mut Vec<u8>| out.extend_from_slice(data);
        self.layout.message(channel, sequence, log_time, publish_time, append)?;
        self.report.messages += 1;
        Ok(())
    }

    /// A channel of the input in the output, made known there with its first message; `None` if its definition or that of
    /// its schema is missing.
    fn channel(&mut self, id: u16) -> io::Result<Option<ChannelKey>> {
        if let Some(key) = self.channels.get(&id) {
            return Ok(Some(*key));
        }
        let Definitions { schemas, channels } = &self.definitions;
        let Some(channel) = channels.get(&id) else { return Ok(None) };
        // Number 0 stands for a channel without a schema.
        if channel.schema_id != 0 && !self.layout.has_schema(channel.schema_id) {
            let Some((header, data)) = schemas.get(&channel.schema_id) else { return Ok(None) };
            self.layout.add_schema(header, data)?;
        }
        let key = self.layout.add_channel(channel)?;
        self.channels.insert(id, key);
        Ok(Some(key))
    }

    /// Closes the output if the copying went well.
    fn finish(mut self, copied: io::Result<()>) -> io::Result<(File, RecoverReport)> {
        copied?;
        self.end.insert(RECOVERED.to_owned(), "true".to_owned());
        self.layout.add_metadata(&Metadata { name: END_METADATA.to_owned(), metadata: self.end })?;
        let (_, _, buffer) = self.layout.finish()?;
        let file = buffer.into_inner()?;
        let report = &mut self.report;
        report.damaged_records += self.chunks.len() as u64;
        report.lost = report.damaged_records > 0 || report.trailing_bytes > 0 || report.stopped_by.is_some();
        Ok((file, self.report))
    }
}
