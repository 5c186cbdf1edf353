//! MCAP as it is laid out in a file, put together a chunk at a time.
//!
//! The records and how they become bytes are those of the `mcap` crate; its writer is not used, because it passes each
//! part of each message through checksum and compressor on its own, which took longer than a simulated flight. Here a
//! message is encoded where it will lie in its chunk, and a chunk is summed, compressed and written in one piece.

use std::{
    collections::BTreeMap,
    io::{self, Cursor, Write},
    mem::take,
};

use binrw::BinWrite;
use crc32fast::Hasher;
use mcap::{
    MAGIC,
    records::{
        AttachmentHeader, AttachmentIndex, Channel, ChunkHeader, ChunkIndex, DataEnd, Footer, Header,
        Metadata, MetadataIndex, SchemaHeader, Statistics, SummaryOffset, op,
    },
};
use zstd::{bulk::Compressor, zstd_safe::compress_bound};

/// Tells what the file's channels and metadata conform to.
const PROFILE: &str = "bench";
/// Chunks are closed when they reach this size, uncompressed, if no flush closed them before.
const CHUNK_BYTES: usize = 256 * 1024;
/// Fixed, so that bytes repeat. On simulated flights level 1 makes files 1 % smaller and recording 15 % slower, level -3
/// makes them 7 % larger and recording 8 % faster: floating-point series gain little from a longer search.
const ZSTD_LEVEL: i32 = -1;
/// Opcode and length of a record.
const HEAD: usize = 9;
/// Channel, sequence number and two times of a message.
const MESSAGE_HEAD: usize = 22;

/// A channel of the file being written, as [`Layout::add_channel`] gave it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ChannelKey(usize);

struct ChannelState {
    id: u16,
    messages: u64,
    /// Log time and place of each message in the chunk, as its index will have them.
    index: Vec<u8>,
}

/// What is to be compressed and written next.
#[derive(Default)]
struct Chunk {
    /// Its records, not compressed.
    records: Vec<u8>,
    times: Option<(u64, u64)>,
}

/// Writes one MCAP file to an output that need not seek. After an error, what follows in the file is of no use.
pub(crate) struct Layout<W> {
    output: W,
    position: u64,
    /// Of all bytes up to here.
    crc: Hasher,
    compressor: Compressor<'static>,
    chunk: Chunk,
    channels: Vec<ChannelState>,
    schema_ids: Vec<u16>,
    /// What goes to the output next, kept for its memory.
    buffer: Vec<u8>,
    /// Records that the summary repeats.
    schemas: Vec<u8>,
    channel_records: Vec<u8>,
    chunks: Vec<ChunkIndex>,
    attachments: Vec<AttachmentIndex>,
    metadata: Vec<MetadataIndex>,
    times: Option<(u64, u64)>,
}

impl<W: Write> Layout<W> {
    /// Begins the file. `library` names who writes it.
    pub fn start(output: W, library: String) -> io::Result<Self> {
        let mut layout = Self {
            output,
            position: 0,
            crc: Hasher::new(),
            compressor: Compressor::new(ZSTD_LEVEL)?,
            chunk: Chunk::default(),
            channels: Vec::new(),
            schema_ids: Vec::new(),
            buffer: Vec::new(),
            schemas: Vec::new(),
            channel_records: Vec::new(),
            chunks: Vec::new(),
            attachments: Vec::new(),
            metadata: Vec::new(),
            times: None,
        };
        layout.buffer.extend_from_slice(MAGIC);
        put(&mut layout.buffer, op::HEADER, &Header { profile: PROFILE.to_owned(), library }, &[])?;
        layout.write_buffer()?;
        Ok(layout)
    }

    /// Closes the chunk and writes metadata.
    pub fn add_metadata(&mut self, metadata: &Metadata) -> io::Result<()> {
        self.close_chunk()?;
        put(&mut self.buffer, op::METADATA, metadata, &[])?;
        let (offset, length) = self.write_buffer()?;
        self.metadata.push(MetadataIndex { offset, length, name: metadata.name.clone() });
        Ok(())
    }

    /// Closes the chunk and writes an attachment.
    pub fn attach(&mut self, header: AttachmentHeader, data: &[u8]) -> io::Result<()> {
        self.close_chunk()?;
        let data_size = data.len() as u64;
        put(&mut self.buffer, op::ATTACHMENT, &header, &[&data_size.to_le_bytes(), data, &[0; 4]])?;
        // The checksum is that of the record up to it, less opcode and length.
        let crc_at = self.buffer.len() - 4;
        let crc = crc32fast::hash(&self.buffer[HEAD..crc_at]);
        self.buffer[crc_at..].copy_from_slice(&crc.to_le_bytes());
        let (offset, length) = self.write_buffer()?;
        let AttachmentHeader { log_time, create_time, name, media_type } = header;
        self.attachments.push(AttachmentIndex {
            offset,
            length,
            log_time,
            create_time,
            data_size,
            name,
            media_type,
        });
        Ok(())
    }

    /// Whether a schema of this number is in the file.
    pub fn has_schema(&self, id: u16) -> bool {
        self.schema_ids.contains(&id)
    }

    /// Puts a schema into the chunk. Each number is to be used once.
    pub fn add_schema(&mut self, header: &SchemaHeader, data: &[u8]) -> io::Result<()> {
        debug_assert!(!self.has_schema(header.id), "schema {} is there", header.id);
        let begin = self.chunk.records.len();
        let length = (data.len() as u32).to_le_bytes();
        put(&mut self.chunk.records, op::SCHEMA, header, &[&length, data])?;
        self.schemas.extend_from_slice(&self.chunk.records[begin..]);
        self.schema_ids.push(header.id);
        Ok(())
    }

    /// Puts a channel into the chunk, whose schema must be there. Each number is to be used once.
    pub fn add_channel(&mut self, channel: &Channel) -> io::Result<ChannelKey> {
        debug_assert!(self.channels.iter().all(|known| known.id != channel.id), "{} is there", channel.id);
        let begin = self.chunk.records.len();
        put(&mut self.chunk.records, op::CHANNEL, channel, &[])?;
        self.channel_records.extend_from_slice(&self.chunk.records[begin..]);
        self.channels.push(ChannelState { id: channel.id, messages: 0, index: Vec::new() });
        Ok(ChannelKey(self.channels.len() - 1))
    }

    /// Puts a message into the chunk; `encode` appends its content. A full chunk is closed first.
    pub fn message(
        &mut self,
        channel: ChannelKey,
        sequence: u32,
        log_time: u64,
        publish_time: u64,
        encode: impl FnOnce(&mut Vec<u8>),
    ) -> io::Result<()> {
        if self.chunk.records.len() > CHUNK_BYTES {
            self.close_chunk()?;
        }
        let channel = &mut self.channels[channel.0];
        let records = &mut self.chunk.records;
        let begin = records.len();
        let mut head = [0; HEAD + MESSAGE_HEAD];
        head[0] = op::MESSAGE;
        head[HEAD..HEAD + 2].copy_from_slice(&channel.id.to_le_bytes());
        head[HEAD + 2..HEAD + 6].copy_from_slice(&sequence.to_le_bytes());
        head[HEAD + 6..HEAD + 14].copy_from_slice(&log_time.to_le_bytes());
        head[HEAD + 14..].copy_from_slice(&publish_time.to_le_bytes());
        records.extend_from_slice(&head);
        encode(records);
        set_length(records, begin);

        let mut entry = [0; 16];
        entry[..8].copy_from_slice(&log_time.to_le_bytes());
        entry[8..].copy_from_slice(&(begin as u64).to_le_bytes());
        channel.index.extend_from_slice(&entry);
        channel.messages += 1;
        self.chunk.times = Some(span(self.chunk.times, (log_time, log_time)));
        Ok(())
    }

    /// Closes the chunk and hands all to the operating system.
    pub fn flush(&mut self) -> io::Result<()> {
        self.close_chunk()?;
        self.output.flush()
    }

    /// Writes summary and footer; returns how many messages and bytes the file has, and the output, not yet flushed.
    pub fn finish(mut self) -> io::Result<(u64, u64, W)> {
        self.close_chunk()?;
        let data_section_crc = self.crc.clone().finalize();
        put(&mut self.buffer, op::DATA_END, &DataEnd { data_section_crc }, &[])?;
        self.write_buffer()?;

        let summary_start = self.position;
        let statistics = self.statistics();
        let mut summary = Summary { bytes: take(&mut self.buffer), start: summary_start, groups: Vec::new() };
        let Self { schemas, channel_records, chunks, attachments, metadata, .. } = &self;
        summary.group(op::SCHEMA, |out| {
            out.extend_from_slice(schemas);
            Ok(())
        })?;
        summary.group(op::CHANNEL, |out| {
            out.extend_from_slice(channel_records);
            Ok(())
        })?;
        summary.group(op::STATISTICS, |out| put(out, op::STATISTICS, &statistics, &[]))?;
        summary.group(op::CHUNK_INDEX, |out| put_all(out, op::CHUNK_INDEX, chunks))?;
        summary.group(op::ATTACHMENT_INDEX, |out| put_all(out, op::ATTACHMENT_INDEX, attachments))?;
        summary.group(op::METADATA_INDEX, |out| put_all(out, op::METADATA_INDEX, metadata))?;
        let Summary { mut bytes, groups, .. } = summary;
        let summary_offset_start = summary_start + bytes.len() as u64;
        put_all(&mut bytes, op::SUMMARY_OFFSET, &groups)?;
        put(&mut bytes, op::FOOTER, &Footer { summary_start, summary_offset_start, summary_crc: 0 }, &[])?;
        // The checksum is that of the summary and of the footer up to it.
        let crc_at = bytes.len() - 4;
        let crc = crc32fast::hash(&bytes[..crc_at]);
        bytes[crc_at..].copy_from_slice(&crc.to_le_bytes());
        bytes.extend_from_slice(MAGIC);
        self.buffer = bytes;
        self.write_buffer()?;
        Ok((statistics.message_count, self.position, self.output))
    }

    fn statistics(&self) -> Statistics {
        let counts: BTreeMap<_, _> =
            self.channels.iter().map(|channel| (channel.id, channel.messages)).collect();
        let (message_start_time, message_end_time) = self.times.unwrap_or_default();
        Statistics {
            message_count: counts.values().sum(),
            schema_count: self.schema_ids.len() as u16,
            channel_count: self.channels.len() as u32,
            attachment_count: self.attachments.len() as u32,
            metadata_count: self.metadata.len() as u32,
            chunk_count: self.chunks.len() as u32,
            message_start_time,
            message_end_time,
            channel_message_counts: counts,
        }
    }

    /// Writes the chunk, if there is one, and the indexes of its messages.
    fn close_chunk(&mut self) -> io::Result<()> {
        let records = &mut self.chunk.records;
        if records.is_empty() {
            return Ok(());
        }
        let times = self.chunk.times.take();
        let (message_start_time, message_end_time) = times.unwrap_or_default();
        let mut header = ChunkHeader {
            message_start_time,
            message_end_time,
            uncompressed_size: records.len() as u64,
            uncompressed_crc: crc32fast::hash(records),
            compression: "zstd".to_owned(),
            compressed_size: 0,
        };
        // The compressed size is the header's last field and known when the data stand behind it.
        put(&mut self.buffer, op::CHUNK, &header, &[])?;
        let data_at = self.buffer.len();
        self.buffer.reserve(compress_bound(records.len()));
        let mut behind = Cursor::new(&mut self.buffer);
        behind.set_position(data_at as u64);
        header.compressed_size = self.compressor.compress_to_buffer(records, &mut behind)? as u64;
        self.buffer[data_at - 8..data_at].copy_from_slice(&header.compressed_size.to_le_bytes());
        set_length(&mut self.buffer, 0);
        let chunk_length = self.buffer.len() as u64;
        records.clear();

        let mut message_index_offsets = BTreeMap::new();
        for channel in self.channels.iter_mut().filter(|channel| !channel.index.is_empty()) {
            let begin = self.buffer.len();
            message_index_offsets.insert(channel.id, self.position + begin as u64);
            self.buffer.push(op::MESSAGE_INDEX);
            self.buffer.extend_from_slice(&(2 + 4 + channel.index.len() as u64).to_le_bytes());
            self.buffer.extend_from_slice(&channel.id.to_le_bytes());
            self.buffer.extend_from_slice(&(channel.index.len() as u32).to_le_bytes());
            self.buffer.append(&mut channel.index);
        }
        let message_index_length = self.buffer.len() as u64 - chunk_length;
        let (chunk_start_offset, _) = self.write_buffer()?;
        self.times = times.map_or(self.times, |times| Some(span(self.times, times)));
        self.chunks.push(ChunkIndex {
            message_start_time,
            message_end_time,
            chunk_start_offset,
            chunk_length,
            message_index_offsets,
            message_index_length,
            compression: header.compression,
            compressed_size: header.compressed_size,
            uncompressed_size: header.uncompressed_size,
        });
        Ok(())
    }

    /// Writes the buffer and empties it; returns where it stands in the file and how long it is.
    fn write_buffer(&mut self) -> io::Result<(u64, u64)> {
        self.crc.update(&self.buffer);
        self.output.write_all(&self.buffer)?;
        let (offset, length) = (self.position, self.buffer.len() as u64);
        self.position += length;
        self.buffer.clear();
        Ok((offset, length))
    }
}

/// The summary while it is put together.
struct Summary {
    bytes: Vec<u8>,
    /// Where it will stand in the file.
    start: u64,
    groups: Vec<SummaryOffset>,
}

impl Summary {
    /// Appends records of one kind and, if there are any, notes where.
    fn group(
        &mut self,
        group_opcode: u8,
        fill: impl FnOnce(&mut Vec<u8>) -> io::Result<()>,
    ) -> io::Result<()> {
        let begin = self.bytes.len() as u64;
        fill(&mut self.bytes)?;
        let group_length = self.bytes.len() as u64 - begin;
        if group_length > 0 {
            self.groups.push(SummaryOffset { group_opcode, group_start: self.start + begin, group_length });
        }
        Ok(())
    }
}

/// Appends a record: its opcode, its length, its fields, and what else belongs to it.
fn put<F>(out: &mut Vec<u8>, opcode: u8, fields: &F, rest: &[&[u8]]) -> io::Result<()>
where
    F: for<'a> BinWrite<Args<'a> = ()>,
{
    let begin = out.len();
    out.push(opcode);
    out.extend_from_slice(&[0; 8]);
    let mut behind = Cursor::new(&mut *out);
    behind.set_position((begin + HEAD) as u64);
    fields.write_le(&mut behind).map_err(io::Error::other)?;
    for part in rest {
        out.extend_from_slice(part);
    }
    set_length(out, begin);
    Ok(())
}

fn put_all<F>(out: &mut Vec<u8>, opcode: u8, records: &[F]) -> io::Result<()>
where
    F: for<'a> BinWrite<Args<'a> = ()>,
{
    records.iter().try_for_each(|record| put(out, opcode, record, &[]))
}

/// Sets the length of the record that began at `begin` and ends with `out`.
fn set_length(out: &mut [u8], begin: usize) {
    let length = (out.len() - begin - HEAD) as u64;
    out[begin + 1..begin + HEAD].copy_from_slice(&length.to_le_bytes());
}

fn span(so_far: Option<(u64, u64)>, more: (u64, u64)) -> (u64, u64) {
    so_far.map_or(more, |(first, last)| (first.min(more.0), last.max(more.1)))
}

#[cfg(test)]
mod tests {
    use std::{collections::BTreeMap, io};

    use mcap::{
        Attachment, WriteOptions,
        records::{
            AttachmentHeader, Channel, ChunkIndex, MessageHeader, Metadata, Record, SchemaHeader,
            SummaryOffset, op,
        },
        sans_io::LinearReaderOptions,
        write::NoSeek,
    };

    use super::{CHUNK_BYTES, Layout, PROFILE};
    use crate::container::{self, RecordStream};

    /// What a file is made of, so that two writers can be given the same.
    enum Part {
        Metadata(&'static str),
        Attachment(&'static str, &'static [u8]),
        /// Channel, log time, publish time, bytes of content.
        Message(u16, u64, u64, usize),
        Flush,
    }

    fn metadata(name: &str) -> Metadata {
        Metadata { name: name.to_owned(), metadata: [("key".to_owned(), "värde".to_owned())].into() }
    }

    fn attachment(name: &str) -> AttachmentHeader {
        AttachmentHeader {
            log_time: 1,
            create_time: 2,
            name: name.to_owned(),
            media_type: "text/plain".to_owned(),
        }
    }

    fn schema(id: u16) -> (SchemaHeader, Vec<u8>) {
        let header = SchemaHeader { id, name: format!("schema {id}"), encoding: "protobuf".to_owned() };
        (header, vec![id as u8; 100])
    }

    fn channel(id: u16) -> Channel {
        Channel {
            id,
            // The last channel shares the schema of the first.
            schema_id: if id == 9 { 3 } else { id },
            topic: format!("/{id}"),
            message_encoding: "protobuf".to_owned(),
            metadata: BTreeMap::new(),
        }
    }

    fn by_layout(parts: &[Part]) -> Vec<u8> {
        let mut layout = Layout::start(Vec::new(), "test".to_owned()).unwrap();
        let mut channels = BTreeMap::new();
        for (i, part) in parts.iter().enumerate() {
            match *part {
                Part::Metadata(name) => layout.add_metadata(&metadata(name)).unwrap(),
                Part::Attachment(name, data) => layout.attach(attachment(name), data).unwrap(),
                Part::Message(id, log_time, publish_time, bytes) => {
                    let key = *channels.entry(id).or_insert_with(|| {
                        let channel = channel(id);
                        if !layout.has_schema(channel.schema_id) {
                            let (header, data) = schema(channel.schema_id);
                            layout.add_schema(&header, &data).unwrap();
                        }
                        layout.add_channel(&channel).unwrap()
                    });
                    let encode = |out: &mut Vec<u8>| out.resize(out.len() + bytes, i as u8);
                    layout.message(key, i as u32, log_time, publish_time, encode).unwrap();
                }
                Part::Flush => layout.flush().unwrap(),
            }
        }
        let messages = parts.iter().filter(|part| matches!(part, Part::Message(..))).count();
        let (counted, bytes, output) = layout.finish().unwrap();
        assert_eq!((counted, bytes), (messages as u64, output.len() as u64));
        output
    }

    fn by_mcap(parts: &[Part]) -> Vec<u8> {
        let mut writer = WriteOptions::new()
            .profile(PROFILE)
            .library("test")
            .compression_level(1)
            .compression_threads(0)
            .chunk_size(Some(CHUNK_BYTES as u64))
            .disable_seeking(true)
            .create(NoSeek::new(Vec::new()))
            .unwrap();
        for (i, part) in parts.iter().enumerate() {
            match *part {
                Part::Metadata(name) => writer.write_metadata(&metadata(name)).unwrap(),
                Part::Attachment(name, data) => {
                    let AttachmentHeader { log_time, create_time, name, media_type } = attachment(name);
                    let data = data.into();
                    writer.attach(&Attachment { log_time, create_time, name, media_type, data }).unwrap();
                }
                Part::Message(id, log_time, publish_time, bytes) => {
                    let Channel { schema_id, topic, message_encoding, metadata, .. } = channel(id);
                    let (header, data) = schema(schema_id);
                    writer.add_schema_with_id(schema_id, &header.name, &header.encoding, &data).unwrap();
                    writer.add_channel_with_id(id, schema_id, &topic, &message_encoding, &metadata).unwrap();
                    let header = MessageHeader { channel_id: id, sequence: i as u32, log_time, publish_time };
                    writer.write_to_known_channel(&header, &vec![i as u8; bytes]).unwrap();
                }
                Part::Flush => writer.flush().unwrap(),
            }
        }
        writer.finish().unwrap();
        writer.into_inner().into_inner()
    }

    /// The records of a file and of its chunks, all checksums checked, without what depends on the compressor: places
    /// in the file, compressed sizes and the checksums over them. As text, because records do not compare.
    fn records(file: &[u8]) -> Vec<String> {
        let options = LinearReaderOptions::default()
            .with_emit_chunks(true)
            .with_validate_data_section_crc(true)
            .with_validate_summary_section_crc(true);
        let mut stream = RecordStream::new(io::Cursor::new(file), options);
        let (mut body, mut within, mut all) = (Vec::new(), Vec::new(), Vec::new());
        while let Some(opcode) = stream.next(&mut body) {
            let opcode = opcode.unwrap();
            let mut record = container::parse(opcode, &body).unwrap().into_owned();
            match &mut record {
                Record::Chunk { header, data } => {
                    header.compressed_size = 0;
                    *data = Vec::new().into();
                }
                Record::ChunkIndex(index) => {
                    *index = ChunkIndex {
                        chunk_start_offset: 0,
                        chunk_length: 0,
                        compressed_size: 0,
                        message_index_offsets: index
                            .message_index_offsets
                            .keys()
                            .map(|id| (*id, 0))
                            .collect(),
                        ..index.clone()
                    };
                }
                Record::AttachmentIndex(index) => index.offset = 0,
                Record::MetadataIndex(index) => index.offset = 0,
                Record::SummaryOffset(offset) => offset.group_start = 0,
                Record::DataEnd(end) => end.data_section_crc = 0,
                Record::Footer(footer) => *footer = mcap::records::Footer::default(),
                _ => {}
            }
            all.push(format!("{record:?}"));
            if opcode == op::CHUNK {
                let mut chunk = container::records_of_chunk(&body);
                while let Some(opcode) = chunk.next(&mut within) {
                    all.push(format!("{:?}", container::parse(opcode.unwrap(), &within).unwrap()));
                }
            }
        }
        all
    }

    fn parts() -> Vec<Part> {
        let mut parts =
            vec![Part::Metadata("first"), Part::Attachment("a.txt", b"text"), Part::Flush, Part::Flush];
        // Times that go back, a channel that comes late, chunks that are flushed and chunks that are full.
        for i in 0..3000 {
            parts.push(Part::Message(3, 1000 + i, 900 + i, (i % 500) as usize));
            if i % 3 == 0 {
                parts.push(Part::Message(7, 5000 - i, 0, 0));
            }
            if i > 2000 {
                parts.push(Part::Message(9, u64::MAX - i, u64::MAX, 1));
            }
            if i == 100 || i == 2999 {
                parts.push(Part::Flush);
            }
        }
        parts.extend([Part::Attachment("empty", b""), Part::Metadata("last")]);
        parts
    }

    #[test]
    fn a_file_is_that_of_the_mcap_crates_writer_but_for_the_compressor() {
        for parts in [parts(), vec![Part::Metadata("alone")], vec![]] {
            let (ours, theirs) = (records(&by_layout(&parts)), records(&by_mcap(&parts)));
            assert_eq!(ours.len(), theirs.len());
            for (ours, theirs) in ours.iter().zip(&theirs) {
                assert_eq!(ours, theirs);
            }
        }
        let chunks = records(&by_layout(&parts())).iter().filter(|r| r.starts_with("Chunk {")).count();
        assert!(chunks > 3, "{chunks}");
    }

    /// The places, which the test above leaves out.
    #[test]
    fn indexes_point_at_what_they_name() {
        let file = by_layout(&parts());
        let summary = mcap::Summary::read(&file).unwrap().unwrap();
        let mut seen = 0;
        for index in &summary.chunk_indexes {
            let by_channel = summary.read_message_indexes(&file, index).unwrap();
            for (channel, entries) in by_channel {
                for entry in entries {
                    let message = summary.seek_message(&file, index, &entry).unwrap();
                    assert_eq!((message.channel.id, message.log_time), (channel.id, entry.log_time));
                    seen += 1;
                }
            }
        }
        assert_eq!(seen, summary.stats.as_ref().unwrap().message_count);
        let names: Vec<_> = summary
            .attachment_indexes
            .iter()
            .map(|index| mcap::read::attachment(&file, index).unwrap().name)
            .collect();
        assert_eq!(names, ["a.txt", "empty"]);
        let names: Vec<_> = summary
            .metadata_indexes
            .iter()
            .map(|index| mcap::read::metadata(&file, index).unwrap().name)
            .collect();
        assert_eq!(names, ["first", "last"]);

        let footer = mcap::read::footer(&file).unwrap();
        let mut at = footer.summary_start;
        let offsets: Vec<_> = records_from(&file[footer.summary_offset_start as usize..]);
        assert_eq!(offsets.len(), 6);
        for SummaryOffset { group_opcode, group_start, group_length } in offsets {
            assert_eq!((file[group_start as usize], group_start), (group_opcode, at));
            at += group_length;
        }
        assert_eq!(at, footer.summary_offset_start);
    }

    /// The summary offsets at the beginning of `bytes`.
    fn records_from(bytes: &[u8]) -> Vec<SummaryOffset> {
        let options = LinearReaderOptions::default().with_skip_start_magic(true).with_skip_end_magic(true);
        let mut stream = RecordStream::new(io::Cursor::new(bytes), options);
        let mut body = Vec::new();
        let mut offsets = Vec::new();
        while let Some(Ok(opcode)) = stream.next(&mut body) {
            if let Record::SummaryOffset(offset) = container::parse(opcode, &body).unwrap() {
                offsets.push(offset);
            }
        }
        offsets
    }
}
