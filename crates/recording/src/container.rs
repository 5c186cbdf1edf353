//! MCAP's records, one after another, from a file of any size in bounded memory.

use std::{
    fs::File,
    io::{self, BufReader, Read, Seek, SeekFrom},
    path::{Path, PathBuf},
};

use mcap::{
    MAGIC, McapError,
    records::{self, Record, op},
    sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions},
};

use zstd::bulk::Decompressor;

use crate::{FileKind, RecordingError, zstd_decoder::ZstdDecoder};

/// Longest record or chunk, compressed or not, that is read: far above anything that the bench writes, and the most
/// that a damaged length can make a reader allocate.
const RECORD_LIMIT: usize = 64 << 20;
/// Opcode and length before each record.
pub(crate) const RECORD_HEAD: u64 = 9;
/// The footer record and the magic bytes after it.
const FOOTER_AND_MAGIC: u64 = RECORD_HEAD + 20 + MAGIC.len() as u64;
/// The data end record, which stands right before the summary.
const DATA_END: u64 = RECORD_HEAD + 4;

/// A recording's file and what its errors need.
#[derive(Debug)]
pub(crate) struct Container {
    pub path: PathBuf,
    pub file: BufReader<File>,
    pub bytes: u64,
}

/// Reads MCAP records in file order.
pub(crate) struct RecordStream<R> {
    source: R,
    reader: LinearReader,
    ended: bool,
}

impl<R: Read> RecordStream<R> {
    pub fn new(source: R, options: LinearReaderOptions) -> Self {
        let mut reader = LinearReader::new_with_options(options.with_record_length_limit(RECORD_LIMIT));
        reader.add_decompressor(ZstdDecoder::default()).expect("it has a name");
        Self { source, reader, ended: false }
    }

    /// The next record's opcode, with its content in `body`; nothing more after the end or an error.
    pub fn next(&mut self, body: &mut Vec<u8>) -> Option<Result<u8, McapError>> {
        while !self.ended {
            match self.reader.next_event() {
                Some(Ok(LinearReadEvent::Record { opcode, data })) => {
                    body.clear();
                    body.extend_from_slice(data);
                    return Some(Ok(opcode));
                }
                Some(Ok(LinearReadEvent::ReadRequest(wanted))) => match self.fill(wanted) {
                    Ok(read) => self.reader.notify_read(read),
                    Err(error) => {
                        self.ended = true;
                        return Some(Err(error.into()));
                    }
                },
                Some(Err(error)) => {
                    self.ended = true;
                    return Some(Err(error));
                }
                None => self.ended = true,
            }
        }
        None
    }

    /// Gives nothing more.
    pub fn end(&mut self) {
        self.ended = true;
    }

    fn fill(&mut self, wanted: usize) -> io::Result<usize> {
        let space = self.reader.insert(wanted);
        loop {
            match self.source.read(space) {
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                result => return result,
            }
        }
    }
}

/// A chunk record, its head made again.
pub(crate) type ChunkReader<B> = io::Chain<io::Cursor<[u8; RECORD_HEAD as usize]>, io::Cursor<B>>;

/// The records within a chunk, given only when its checksum holds. `body` is the chunk record's content.
pub(crate) fn records_of_chunk<B: AsRef<[u8]>>(body: B) -> RecordStream<ChunkReader<B>> {
    let mut head = [0; RECORD_HEAD as usize];
    head[0] = op::CHUNK;
    head[1..].copy_from_slice(&(body.as_ref().len() as u64).to_le_bytes());
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_skip_end_magic(true)
        .with_prevalidate_chunk_crcs(true);
    RecordStream::new(io::Cursor::new(head).chain(io::Cursor::new(body)), options)
}

/// The records within a chunk, one after another in one piece of memory, which is kept for the next chunk.
#[derive(Default)]
pub(crate) struct Chunk {
    decompressor: Option<Decompressor<'static>>,
    records: Vec<u8>,
    at: usize,
}

impl Chunk {
    /// Takes a chunk record's content apart; nothing of it is given unless its checksum holds.
    pub fn open(&mut self, body: &[u8]) -> Result<(), McapError> {
        self.at = 0;
        self.records.clear();
        let Record::Chunk { header, data } = mcap::parse_record(op::CHUNK, body)? else {
            return Err(McapError::BadIndex);
        };
        let size = usize::try_from(header.uncompressed_size).unwrap_or(usize::MAX);
        if size > RECORD_LIMIT {
            return Err(McapError::ChunkTooLarge(header.uncompressed_size));
        }
        match header.compression.as_str() {
            "zstd" => {
                let decompressor = match &mut self.decompressor {
                    Some(decompressor) => decompressor,
                    none => none.insert(Decompressor::new()?),
                };
                self.records.reserve(size);
                decompressor
                    .decompress_to_buffer(&data, &mut self.records)
                    .map_err(|error| McapError::DecompressionError(error.to_string()))?;
            }
            "" => self.records.extend_from_slice(&data),
            other => return Err(McapError::UnsupportedCompression(other.to_owned())),
        }
        if self.records.len() != size {
            let available = self.records.len() as u64;
            return Err(McapError::BadChunkLength { header: header.uncompressed_size, available });
        }
        let (saved, calculated) = (header.uncompressed_crc, crc32fast::hash(&self.records));
        if saved != 0 && saved != calculated {
            return Err(McapError::BadChunkCrc { saved, calculated });
        }
        Ok(())
    }

    /// The next record's opcode and content; `None` at the end.
    pub fn next(&mut self) -> Option<Result<(u8, &[u8]), McapError>> {
        let rest = &self.records[self.at..];
        if rest.is_empty() {
            return None;
        }
        let record = rest.split_first_chunk::<{ RECORD_HEAD as usize }>().and_then(|(head, rest)| {
            let [opcode, length @ ..] = *head;
            let length = usize::try_from(u64::from_le_bytes(length)).ok()?;
            Some((opcode, rest.get(..length)?))
        });
        let Some((opcode, content)) = record else {
            self.at = self.records.len();
            return Some(Err(McapError::UnexpectedEoc));
        };
        self.at += RECORD_HEAD as usize + content.len();
        Some(Ok((opcode, content)))
    }

    /// What was given so far; the content of the last record is at its end.
    pub fn read(&self) -> &[u8] {
        &self.records[..self.at]
    }

    /// Gives nothing more.
    pub fn end(&mut self) {
        self.at = self.records.len();
    }
}

/// Channel number, log time and content of a message record.
pub(crate) fn message(body: &[u8]) -> Option<(u16, u64, &[u8])> {
    let (head, data) = body.split_first_chunk::<22>()?;
    let channel = u16::from_le_bytes([head[0], head[1]]);
    let (_, times) = head.split_at(6);
    Some((channel, u64::from_le_bytes(*times.first_chunk()?), data))
}

/// Reads a record's content.
pub(crate) fn parse(opcode: u8, body: &[u8]) -> Result<Record<'_>, McapError> {
    // The parser takes the checksum at an attachment's end for granted.
    if opcode == op::ATTACHMENT && !attachment_is_complete(body) {
        return Err(McapError::UnexpectedEof);
    }
    mcap::parse_record(opcode, body)
}

/// Whether an attachment has all of its parts: two times, two strings, data, each with its length, and a checksum.
fn attachment_is_complete(body: &[u8]) -> bool {
    fn skip<const LENGTH: usize>(body: &[u8]) -> Option<&[u8]> {
        let (length, rest) = body.split_at_checked(LENGTH)?;
        let mut wide = [0; 8];
        wide[..LENGTH].copy_from_slice(length);
        rest.get(usize::try_from(u64::from_le_bytes(wide)).ok()?..)
    }
    body.get(16..)
        .and_then(skip::<4>)
        .and_then(skip::<4>)
        .and_then(skip::<8>)
        .is_some_and(|checksum| checksum.len() == 4)
}

/// The summary at the end of a closed file.
#[derive(Debug, Default)]
pub(crate) struct Summary {
    pub statistics: Option<records::Statistics>,
    pub schemas: Vec<(records::SchemaHeader, Vec<u8>)>,
    pub channels: Vec<records::Channel>,
    pub attachments: Vec<records::AttachmentIndex>,
    pub metadata: Vec<records::MetadataIndex>,
    /// Where the chunks begin, in their order.
    pub chunks: Vec<u64>,
}

impl Container {
    /// Opens a file that begins as MCAP does.
    pub fn open(path: &Path) -> Result<Self, RecordingError> {
        let io = |action| move |source| RecordingError::Io { action, path: path.to_owned(), source };
        let no_recording = || -> Result<RecordingError, RecordingError> {
            let kind = FileKind::of(path).map_err(io("read"))?;
            Ok(RecordingError::NotMcap { path: path.to_owned(), kind })
        };
        if path.is_dir() {
            return Err(no_recording()?);
        }
        let file = File::open(path).map_err(io("open"))?;
        let bytes = file.metadata().map_err(io("read"))?.len();
        if bytes == 0 {
            return Err(RecordingError::Empty { path: path.to_owned() });
        }
        let mut file = BufReader::with_capacity(64 << 10, file);
        let mut magic = [0; MAGIC.len()];
        match file.read_exact(&mut magic) {
            Err(error) if error.kind() != io::ErrorKind::UnexpectedEof => Err(io("read")(error)),
            Ok(()) if magic == *MAGIC => Ok(Self { path: path.to_owned(), file, bytes }),
            _ => Err(no_recording()?),
        }
    }

    /// Goes back to the file's start.
    pub fn rewind(&mut self) -> Result<(), RecordingError> {
        self.seek(0)
    }

    /// Reads the summary; `None` for a file that was closed without one.
    pub fn summary(&mut self) -> Result<Option<Summary>, RecordingError> {
        let Some(start) = self.summary_start()? else { return Ok(None) };
        let before = start.checked_sub(DATA_END).ok_or_else(|| self.damaged(&McapError::BadFooter))?;
        self.seek(before)?;
        let options = LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_validate_summary_section_crc(true);
        let mut stream = RecordStream::new(&mut self.file, options);
        let mut summary = Summary::default();
        let mut body = Vec::new();
        let read = loop {
            match stream.next(&mut body) {
                Some(Ok(opcode)) => match parse(opcode, &body) {
                    Ok(record) => summary.add(record),
                    Err(error) => break Err(error),
                },
                Some(Err(error)) => break Err(error),
                None => break Ok(()),
            }
        };
        match read {
            Ok(()) => Ok(Some(summary)),
            Err(error) => Err(self.damaged(&error)),
        }
    }

    /// Where the summary begins, by the footer; an error if the file has no proper end.
    fn summary_start(&mut self) -> Result<Option<u64>, RecordingError> {
        let unfinished = || RecordingError::Unfinished { path: self.path.clone() };
        let footer_at = self.bytes.checked_sub(FOOTER_AND_MAGIC).ok_or_else(unfinished)?;
        self.seek(footer_at)?;
        let mut end = [0; FOOTER_AND_MAGIC as usize];
        self.file.read_exact(&mut end).map_err(|source| self.io_error(source))?;
        let (footer, magic) = end.split_at(end.len() - MAGIC.len());
        if magic != MAGIC || footer[0] != op::FOOTER {
            return Err(RecordingError::Unfinished { path: self.path.clone() });
        }
        match parse(op::FOOTER, &footer[RECORD_HEAD as usize..]) {
            Ok(Record::Footer(footer)) => Ok(Some(footer.summary_start).filter(|start| *start > 0)),
            _ => Err(self.damaged(&McapError::BadFooter)),
        }
    }

    /// Reads a record by its place in an index; `None` if something else is there.
    pub fn record_at(&mut self, offset: u64, length: u64) -> Result<Option<Record<'static>>, RecordingError> {
        let inside = offset.checked_add(length).is_some_and(|end| end <= self.bytes);
        if !inside || length < RECORD_HEAD || length > RECORD_LIMIT as u64 {
            return Ok(None);
        }
        self.seek(offset)?;
        let mut record = vec![0; length as usize];
        self.file.read_exact(&mut record).map_err(|source| self.io_error(source))?;
        let (head, body) = record.split_at(RECORD_HEAD as usize);
        match parse(head[0], body) {
            Ok(record) => Ok(Some(record.into_owned())),
            Err(error) => Err(self.damaged(&error)),
        }
    }

    fn seek(&mut self, offset: u64) -> Result<(), RecordingError> {
        self.file.seek(SeekFrom::Start(offset)).map(drop).map_err(|source| self.io_error(source))
    }

    fn io_error(&self, source: io::Error) -> RecordingError {
        RecordingError::Io { action: "read", path: self.path.clone(), source }
    }

    /// The error for what MCAP's reader found.
    pub fn damaged(&self, error: &McapError) -> RecordingError {
        damaged(&self.path, error)
    }
}

/// The error for what MCAP's reader found in a file.
pub(crate) fn damaged(path: &Path, error: &McapError) -> RecordingError {
    RecordingError::Damaged { path: path.to_owned(), detail: error.to_string() }
}

impl Summary {
    fn add(&mut self, record: Record) {
        match record {
            Record::Statistics(statistics) => self.statistics = Some(statistics),
            Record::Schema { header, data } => self.schemas.push((header, data.into_owned())),
            Record::Channel(channel) => self.channels.push(channel),
            Record::AttachmentIndex(index) => self.attachments.push(index),
            Record::MetadataIndex(index) => self.metadata.push(index),
            Record::ChunkIndex(index) => self.chunks.push(index.chunk_start_offset),
            _ => {}
        }
    }
}
