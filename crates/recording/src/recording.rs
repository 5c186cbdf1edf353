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
    container::{self, ChunkReader, Container, RecordStream},
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
        self.records_of(&Channel::ALL)
    }

    /// The same of some channels only; what stands in the others is neither decoded nor checked.
    pub(crate) fn records_of(&self, channels: &[Channel]) -> Result<Records, RecordingError> {
        Records::open(&self.path, self.chunks.clone(), channels.to_vec())
    }
}

/// The records of a recording, one by one. Memory is bounded by the largest chunk, not by the file. A chunk gives its
/// records only if its checksum holds and none that the summary lists before it is missing. Ends after the first error.
pub struct Records {
    path: PathBuf,
    /// The file's own records, chunks whole.
    file: RecordStream<BufReader<File>>,
    /// Where the file's next record begins.
    offset: u64,
    /// Where the chunks to come begin, the next one last; `None` if the file has no summary.
    chunks: Option<Vec<u64>>,
    /// The records of the chunk that is being read.
    chunk: Option<RecordStream<ChunkReader<Vec<u8>>>>,
    body: Vec<u8>,
    /// By MCAP channel; topics that hold no records, or none that are wanted, are absent.
    channels: Vec<Option<Channel>>,
    wanted: Vec<Channel>,
    past_data: bool,
}

impl Records {
    fn open(path: &Path, chunks: Option<Vec<u64>>, wanted: Vec<Channel>) -> Result<Self, RecordingError> {
        let mut container = Container::open(path)?;
        container.rewind()?;
        let options =
            LinearReaderOptions::default().with_emit_chunks(true).with_validate_data_section_crc(true);
        Ok(Self {
            path: container.path,
            file: RecordStream::new(container.file, options),
            offset: MAGIC.len() as u64,
            chunks,
            chunk: None,
            body: Vec::new(),
            channels: Vec::new(),
            wanted,
            past_data: false,
        })
    }

    /// The next record; `None` at the end.
    fn read(&mut self) -> Result<Option<Record>, RecordingError> {
        while let Some(opcode) = self.next_opcode().transpose()? {
            let record = container::parse(opcode, &self.body).map_err(|error| self.error(&error))?;
            match record {
                McapRecord::Channel(channel) if !self.past_data => {
                    remember(&mut self.channels, &channel, &self.wanted);
                }
                McapRecord::Message { header, data } => {
                    if let Some(channel) =
                        self.channels.get(usize::from(header.channel_id)).copied().flatten()
                    {
                        return decode(&self.path, channel, header.log_time, &data).map(Some);
                    }
                }
                // The summary repeats schemas and channels; it is read on to check the file's end.
                McapRecord::DataEnd(_) => self.past_data = true,
                _ => {}
            }
        }
        Ok(None)
    }

    /// The opcode of the next record, of a chunk or of the file, with its content in `body`.
    fn next_opcode(&mut self) -> Option<Result<u8, RecordingError>> {
        loop {
            if let Some(chunk) = &mut self.chunk {
                match chunk.next(&mut self.body) {
                    Some(Ok(opcode)) => return Some(Ok(opcode)),
                    Some(Err(error)) => return Some(Err(self.error(&error))),
                    None => self.chunk = None,
                }
            }
            let opcode = match self.file.next(&mut self.body)? {
                Ok(opcode) => opcode,
                Err(error) => return Some(Err(self.error(&error))),
            };
            if let Err(error) = self.expect(opcode) {
                return Some(Err(error));
            }
            self.offset += container::RECORD_HEAD + self.body.len() as u64;
            if opcode != op::CHUNK {
                return Some(Ok(opcode));
            }
            self.chunk = Some(container::records_of_chunk(std::mem::take(&mut self.body)));
        }
    }

    /// Refuses a file in which a chunk does not stand where the summary says: a damaged head would otherwise hide a whole
    /// chunk until the checksum at the end, after the records that follow it were given. Messages stand in chunks alone, and
    /// the data ends after the last one: other records have no checksum of their own.
    fn expect(&mut self, opcode: u8) -> Result<(), RecordingError> {
        let Some(chunks) = &mut self.chunks else { return Ok(()) };
        let due = chunks.last().copied();
        let is_right = match opcode {
            op::CHUNK => due == Some(self.offset),
            op::MESSAGE => false,
            op::DATA_END => due.is_none(),
            _ => due.is_none_or(|due| due > self.offset),
        };
        if !is_right {
            return Err(RecordingError::Damaged {
                path: self.path.clone(),
                detail: format!("the record at byte {} is not what the summary lists there", self.offset),
            });
        }
        if opcode == op::CHUNK {
            chunks.pop();
        }
        Ok(())
    }

    fn error(&self, error: &McapError) -> RecordingError {
        match error {
            McapError::UnexpectedEof => RecordingError::Unfinished { path: self.path.clone() },
            error => container::damaged(&self.path, error),
        }
    }
}

impl Iterator for Records {
    type Item = Result<Record, RecordingError>;

    fn next(&mut self) -> Option<Self::Item> {
        let next = self.read().transpose();
        if matches!(next, Some(Err(_))) {
            self.file.end();
            self.chunk = None;
        }
        next
    }
}

fn remember(channels: &mut Vec<Option<Channel>>, channel: &records::Channel, wanted: &[Channel]) {
    let id = usize::from(channel.id);
    if channels.len() <= id {
        channels.resize(id + 1, None);
    }
    channels[id] = Channel::from_topic(&channel.topic).filter(|channel| wanted.contains(channel));
}

fn decode(path: &Path, channel: Channel, log_time: u64, data: &[u8]) -> Result<Record, RecordingError> {
    codec::decode(channel, data).map_err(|detail| RecordingError::BadMessage {
        path: path.to_owned(),
        channel: channel.topic(),
        time: Time::from_nanos(log_time),
        detail,
    })
}
