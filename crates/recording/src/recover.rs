use std::{
    collections::BTreeMap,
    fs::{self, File},
    io::{self, BufWriter, Write},
    path::Path,
};

use mcap::{
    Attachment, McapError, McapResult,
    records::{AttachmentHeader, Channel, MessageHeader, Metadata, Record, SchemaHeader, op},
    sans_io::LinearReaderOptions,
    write::NoSeek,
};
use serde::Serialize;

use crate::{
    RecordingError,
    container::{self, Container, RecordStream},
    partial::PartialFile,
    session::{END_METADATA, RECOVERED, SESSION_METADATA},
    writer::{io_error, write_options},
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
    /// Chunks and other records whose content contradicts its checksum or the format.
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
    let mut salvage = Salvage::start(file, &mut container).map_err(|error| partial.error(io_error(error)))?;
    let copied = salvage.copy_all(&mut container);
    let has_session = salvage.has_session;
    let topics = salvage.definitions.topics();
    let (file, report) = salvage.finish(copied).map_err(|error| partial.error(error))?;
    if !has_session {
        return Err(RecordingError::NothingToRecover { path: input.to_owned(), channels: topics });
    }
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

type Output = NoSeek<BufWriter<File>>;

/// A recording being copied as far as it is whole. Its functions err only where the output does; what is wrong with the
/// input goes into the report.
struct Salvage {
    writer: mcap::Writer<Output>,
    definitions: Definitions,
    has_session: bool,
    /// How the recorder ended the recording, if it did.
    end: BTreeMap<String, String>,
    report: RecoverReport,
}

impl Salvage {
    fn start(file: File, container: &mut Container) -> McapResult<Self> {
        let summary = container.summary();
        let closed = !matches!(summary, Err(RecordingError::Unfinished { .. }));
        let mut definitions = Definitions::default();
        // The chunk that defines a channel may be damaged; the summary repeats the definition.
        if let Ok(Some(summary)) = summary {
            for (header, data) in summary.schemas {
                definitions.schemas.insert(header.id, (header, data));
            }
            for channel in summary.channels {
                definitions.channels.insert(channel.id, channel);
            }
        }
        Ok(Self {
            writer: write_options().create(NoSeek::new(BufWriter::new(file)))?,
            definitions,
            has_session: false,
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

    fn copy_all(&mut self, container: &mut Container) -> McapResult<()> {
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
                Ok(op::DATA_END) => return Ok(()),
                Ok(op::CHUNK) => self.copy_chunk(&body)?,
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

    fn copy_chunk(&mut self, chunk: &[u8]) -> McapResult<()> {
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

    fn copy_record(&mut self, opcode: u8, body: &[u8]) -> McapResult<()> {
        match container::parse(opcode, body) {
            Ok(Record::Metadata(metadata)) => self.copy_metadata(metadata)?,
            Ok(Record::Attachment { header, data, .. }) => self.copy_attachment(header, data.into_owned())?,
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

    fn copy_metadata(&mut self, metadata: Metadata) -> McapResult<()> {
        if metadata.name == END_METADATA {
            self.end = metadata.metadata;
            return Ok(());
        }
        self.has_session |= metadata.name == SESSION_METADATA;
        self.writer.write_metadata(&metadata)?;
        self.report.metadata.push(metadata.name);
        Ok(())
    }

    fn copy_attachment(&mut self, header: AttachmentHeader, data: Vec<u8>) -> McapResult<()> {
        let AttachmentHeader { log_time, create_time, name, media_type } = header;
        self.report.attachments.push(name.clone());
        self.writer.attach(&Attachment { log_time, create_time, name, media_type, data: data.into() })
    }

    fn copy_message(&mut self, header: &MessageHeader, data: &[u8]) -> McapResult<()> {
        let Some(channel) = self.definitions.channels.get(&header.channel_id) else {
            self.report.damaged_records += 1;
            return Ok(());
        };
        if let Some((schema, data)) = self.definitions.schemas.get(&channel.schema_id) {
            self.writer.add_schema_with_id(schema.id, &schema.name, &schema.encoding, data)?;
        }
        let Channel { id, schema_id, topic, message_encoding, metadata } = channel;
        match self.writer.add_channel_with_id(*id, *schema_id, topic, message_encoding, metadata) {
            Ok(_) => {}
            Err(McapError::UnknownSchema(..)) => {
                self.report.damaged_records += 1;
                return Ok(());
            }
            Err(error) => return Err(error),
        }
        self.writer.write_to_known_channel(header, data)?;
        self.report.messages += 1;
        Ok(())
    }

    /// Closes the output if the copying went well.
    fn finish(mut self, copied: McapResult<()>) -> io::Result<(File, RecoverReport)> {
        self.end.insert(RECOVERED.to_owned(), "true".to_owned());
        let end = Metadata { name: END_METADATA.to_owned(), metadata: self.end };
        let closed = copied
            .and_then(|()| self.writer.write_metadata(&end))
            .and_then(|()| self.writer.finish().map(drop));
        // Taken out in any case: dropped, the writer would close a file that is given up.
        let mut output = self.writer.into_inner();
        closed.map_err(io_error)?;
        let buffer = output.get_mut();
        buffer.flush()?;
        let file = buffer.get_ref().try_clone()?;
        let report = &mut self.report;
        report.lost = report.damaged_records > 0 || report.trailing_bytes > 0 || report.stopped_by.is_some();
        Ok((file, self.report))
    }
}
