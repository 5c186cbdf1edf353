use std::{
    fs::File,
    io::BufReader,
    path::{Path, PathBuf},
};

use bench_device::Time;
use mcap::{
    MAGIC, McapError,
    records::{self, Record as McapRecord, op},
    sans_io::LinearReaderOptions,
};

use crate::{
    Channel, Info, Record, RecordingError, Session, codec,
    container::{self, Chunk, Container, RecordStream},
    info::Survey,
};

/// A closed recording, ready to be read.
#[derive(Debug)]
pub struct Recording {
    path: PathBuf,
    session: Session,
    info: Info,
    /// Where chunks begin, the first one last; `None` if the file has no summary.
    chunks: Option<Vec<u64>>,
}

impl Recording {
    /// Opens a recording that was closed. One that was not is [`RecordingError::Unfinished`].
    pub fn open(path: impl AsRef<Path>) -> Result<Self, RecordingError> {
        let path = path.as_ref();
        let Survey { info, session, mut chunks } = Survey::read(path)?;
        if let Some(starts) = &mut chunks {
            starts.sort_unstable_by(|a, b| b.cmp(a));
        }
        if info.closed {
            Ok(Self { path: path.to_owned(), session, info, chunks })
        } else {
            Err(RecordingError::Unfinished { path: path.to_owned() })
        }
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What was known before its first message.
    pub fn session(&self) -> &Session {
        &self.session
    }

    /// What it is and holds.
    pub fn info(&self) -> &Info {
        &self.info
    }

    /// How many messages a channel has.
    pub fn count(&self, channel: Channel) -> u64 {
        let of_channel = self.info.channels.iter().find(|info| info.name == channel.topic());
        of_channel.map_or(0, |info| info.messages)
    }

    /// Reads the records in the order of the file, which is that in which they were recorded.
    pub fn records(&self) -> Result<Records, RecordingError> {
        Ok(Records { messages: self.messages_of(&Channel::ALL)?, decoder: self.decoder() })
    }

    /// The messages of some channels, as they are in the file; what stands in the others is not looked at.
    pub(crate) fn messages_of(&self, channels: &[Channel]) -> Result<Messages, RecordingError> {
        Messages::open(&self.path, self.chunks.clone(), channels)
    }

    /// Reads messages as records.
    pub(crate) fn decoder(&self) -> Decoder {
        Decoder::new(&self.path, self.session.epoch_unix_ns.unwrap_or(0))
    }
}

/// The records of a recording, one by one. Memory is bounded by the largest chunk, not by the file. A chunk gives its
/// records only if its checksum holds and none that the summary lists before it is missing. Ends after the first error.
pub struct Records {
    messages: Messages,
    decoder: Decoder,
}

impl Iterator for Records {
    type Item = Result<Record, RecordingError>;

    fn next(&mut self) -> Option<Self::Item> {
        let message = self.messages.next().transpose()?;
        let record = message.and_then(|message| self.decoder.decode(message));
        if record.is_err() {
            self.messages.end();
        }
        Some(record)
    }
}

/// A message as it is in the file.
#[derive(Clone, Copy)]
pub(crate) struct Message<'a> {
    pub channel: Channel,
    pub log_time: u64,
    pub data: &'a [u8],
}

/// Makes records of messages.
pub(crate) struct Decoder {
    path: PathBuf,
    /// What log times count from, ns since 1970.
    epoch_ns: u64,
}

impl Decoder {
    pub fn new(path: &Path, epoch_ns: u64) -> Self {
        Self { path: path.to_owned(), epoch_ns }
    }

    pub fn decode(&self, message: Message) -> Result<Record, RecordingError> {
        let Message { channel, log_time, data } = message;
        codec::decode(channel, self.epoch_ns, data).map_err(|detail| RecordingError::BadMessage {
            path: self.path.clone(),
            channel: channel.topic(),
            time: Time::from_nanos(log_time.saturating_sub(self.epoch_ns)),
            detail,
        })
    }
}

/// The messages of a recording, one by one.
pub(crate) struct Messages {
    path: PathBuf,
    /// The file's own records, chunks whole.
    file: RecordStream<BufReader<File>>,
    /// Where the file's next record begins.
    offset: u64,
    /// Where the chunks to come begin, the next one last; `None` if the file has no summary.
    chunks: Option<Vec<u64>>,
    /// The chunk that is being read.
    chunk: Chunk,
    body: Vec<u8>,
    channels: Channels,
    past_data: bool,
}

/// Where a message stands: at the end of what was read last.
struct Found {
    channel: Channel,
    log_time: u64,
    length: usize,
    in_chunk: bool,
}

impl Messages {
    fn open(path: &Path, chunks: Option<Vec<u64>>, wanted: &[Channel]) -> Result<Self, RecordingError> {
        let mut container = Container::open(path)?;
        container.rewind()?;
        let options =
            LinearReaderOptions::default().with_emit_chunks(true).with_validate_data_section_crc(true);
        Ok(Self {
            path: container.path,
            file: RecordStream::new(container.file, options),
            offset: MAGIC.len() as u64,
            chunks,
            chunk: Chunk::default(),
            body: Vec::new(),
            channels: Channels { known: Vec::new(), wanted: wanted.to_vec() },
            past_data: false,
        })
    }

    /// The next message; `None` at the end. Nothing more is to be read after an error.
    pub fn next(&mut self) -> Result<Option<Message<'_>>, RecordingError> {
        let found = self.find().inspect_err(|_| self.end())?;
        Ok(found.map(|Found { channel, log_time, length, in_chunk }| {
            let read = if in_chunk { self.chunk.read() } else { &self.body };
            Message { channel, log_time, data: &read[read.len() - length..] }
        }))
    }

    /// Gives nothing more.
    fn end(&mut self) {
        self.file.end();
        self.chunk.end();
    }

    fn find(&mut self) -> Result<Option<Found>, RecordingError> {
        let Self { path, channels, .. } = self;
        loop {
            while let Some(next) = self.chunk.next() {
                let (opcode, content) = next.map_err(|error| container::damaged(path, &error))?;
                if let Some(found) = channels.take(opcode, content, true, path)? {
                    return Ok(Some(found));
                }
            }
            let Some(opcode) = self.file.next(&mut self.body) else { return Ok(None) };
            let opcode = opcode.map_err(|error| broken(path, &error))?;
            expect(&mut self.chunks, opcode, self.offset, path)?;
            self.offset += container::RECORD_HEAD + self.body.len() as u64;
            match opcode {
                op::CHUNK => self.chunk.open(&self.body).map_err(|error| container::damaged(path, &error))?,
                // Parsed whatever it is, as it has no checksum of its own.
                _ => drop(container::parse(opcode, &self.body).map_err(|error| broken(path, &error))?),
            }
            // The summary repeats schemas and channels; it is read on to check the file's end.
            self.past_data |= opcode == op::DATA_END;
            if !self.past_data
                && matches!(opcode, op::CHANNEL | op::MESSAGE)
                && let Some(found) = channels.take(opcode, &self.body, false, path)?
            {
                return Ok(Some(found));
            }
        }
    }
}

/// Refuses a file in which a chunk does not stand where the summary says: a damaged head would otherwise hide a whole chunk until
/// the checksum at the end, after the records that follow it were given. Messages stand in chunks alone, and the data ends after the
/// last one: other records have no checksum of their own.
fn expect(chunks: &mut Option<Vec<u64>>, opcode: u8, offset: u64, path: &Path) -> Result<(), RecordingError> {
    let Some(chunks) = chunks else { return Ok(()) };
    let due = chunks.last().copied();
    let is_right = match opcode {
        op::CHUNK => due == Some(offset),
        op::MESSAGE => false,
        op::DATA_END => due.is_none(),
        _ => due.is_none_or(|due| due > offset),
    };
    if !is_right {
        return Err(RecordingError::Damaged {
            path: path.to_owned(),
            detail: format!("the record at byte {offset} is not what the summary lists there"),
        });
    }
    if opcode == op::CHUNK {
        chunks.pop();
    }
    Ok(())
}

/// What a file's channels are.
struct Channels {
    /// By MCAP channel; topics that hold no records, or none that are wanted, are absent.
    known: Vec<Option<Channel>>,
    wanted: Vec<Channel>,
}

impl Channels {
    /// Finds a message of a wanted channel and remembers a channel; anything else is passed over.
    fn take(
        &mut self,
        opcode: u8,
        content: &[u8],
        in_chunk: bool,
        path: &Path,
    ) -> Result<Option<Found>, RecordingError> {
        match opcode {
            op::MESSAGE => {
                let (id, log_time, data) = container::message(content)
                    .ok_or_else(|| container::damaged(path, &McapError::UnexpectedEoc))?;
                let channel = self.known.get(usize::from(id)).copied().flatten();
                Ok(channel.map(|channel| Found { channel, log_time, length: data.len(), in_chunk }))
            }
            op::CHANNEL => {
                let record = container::parse(opcode, content);
                if let McapRecord::Channel(channel) =
                    record.map_err(|error| container::damaged(path, &error))?
                {
                    self.remember(&channel);
                }
                Ok(None)
            }
            _ => Ok(None),
        }
    }

    fn remember(&mut self, channel: &records::Channel) {
        let id = usize::from(channel.id);
        if self.known.len() <= id {
            self.known.resize(id + 1, None);
        }
        let known = Channel::from_topic(&channel.topic);
        self.known[id] = known.filter(|channel| self.wanted.contains(channel));
    }
}

/// The error for a file that cannot be read on.
fn broken(path: &Path, error: &McapError) -> RecordingError {
    match error {
        McapError::UnexpectedEof => RecordingError::Unfinished { path: path.to_owned() },
        error => container::damaged(path, error),
    }
}
