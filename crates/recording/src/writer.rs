//! Records to MCAP.

use std::{
    borrow::Cow,
    collections::BTreeMap,
    io::{self, Seek, Write},
};

use mcap::{
    Attachment, Compression, McapError, McapResult, WriteOptions,
    records::{MessageHeader, Metadata},
    write::NoSeek,
};

use crate::{
    Channel, Record, Session,
    channel::{POSE_SCHEMA, Schema},
    codec::{self, PoseEncoder},
    session::{
        BENCH_VERSION, END_METADATA, EXTRA_METADATA, MISSION_ATTACHMENT, RIG_ATTACHMENT, SESSION_METADATA,
    },
};

/// Chunks are closed when they reach this size, uncompressed, if no flush closed them before.
const CHUNK_BYTES: u64 = 256 * 1024;
/// Fixed, so that bytes repeat. Higher levels gain little on floating-point series and cost much.
const ZSTD_LEVEL: u32 = 1;
/// MCAP channel and schema of the pose; those of a [`Channel`] follow in its order.
const POSE_ID: u16 = 1;

const fn channel_id(channel: Channel) -> u16 {
    POSE_ID + 1 + channel as u16
}

const CHANNEL_IDS: usize = POSE_ID as usize + 1 + Channel::ALL.len();

/// How every recording of the bench is laid out: whole chunks only, compressed on the writer's thread.
pub(crate) fn write_options() -> WriteOptions {
    WriteOptions::new()
        .library(format!("bench {BENCH_VERSION}"))
        .compression(Some(Compression::Zstd))
        .compression_level(ZSTD_LEVEL)
        .compression_threads(0)
        .chunk_size(Some(CHUNK_BYTES))
        // Chunks are put together in memory: a file never holds a part of one, and the output need not seek.
        .disable_seeking(true)
}

/// Writes one recording. Session and attachments come first, so that they survive whatever happens later.
pub(crate) struct MessageWriter<W: Write> {
    mcap: mcap::Writer<NoSeek<W>>,
    /// Messages written so far on each MCAP channel.
    counts: [u32; CHANNEL_IDS],
    pose: PoseEncoder,
    buffer: Vec<u8>,
}

impl<W: Write> MessageWriter<W> {
    /// Writes and flushes all that is known before the first message.
    pub fn start(output: W, session: &Session) -> io::Result<Self> {
        let mut mcap = write_options().create(NoSeek::new(output)).map_err(io_error)?;
        mcap.write_metadata(&metadata(SESSION_METADATA, session.to_metadata())).map_err(io_error)?;
        if !session.extra.is_empty() {
            mcap.write_metadata(&metadata(EXTRA_METADATA, session.extra.clone())).map_err(io_error)?;
        }
        for (name, text) in [(RIG_ATTACHMENT, &session.rig_toml), (MISSION_ATTACHMENT, &session.mission_toml)]
        {
            if let Some(text) = text {
                mcap.attach(&toml_attachment(name, text)).map_err(io_error)?;
            }
        }
        mcap.flush().map_err(io_error)?;
        Ok(Self { mcap, counts: [0; CHANNEL_IDS], pose: PoseEncoder::new(), buffer: Vec::with_capacity(512) })
    }

    /// Writes a record, and the pose beside a truth.
    pub fn write(&mut self, record: &Record) -> io::Result<()> {
        let channel = record.channel();
        // When it was sent, where that is known apart from when it came.
        let published_ns = match record {
            Record::Position(position) => position.exposed_at.nanos(),
            _ => record.time().nanos(),
        };
        self.buffer.clear();
        codec::encode(record, &mut self.buffer);
        let (log_time, publish_time) = (record.time().nanos(), published_ns);
        self.put(channel_id(channel), channel.topic(), &channel.schema(), log_time, publish_time)?;
        if let Record::Truth(truth) = record {
            self.buffer.clear();
            self.pose.encode(truth, &mut self.buffer);
            self.put(POSE_ID, Channel::POSE_TOPIC, &POSE_SCHEMA, log_time, publish_time)?;
        }
        Ok(())
    }

    /// Writes the buffer as a message; the channel is made known with its first one.
    fn put(
        &mut self,
        channel_id: u16,
        topic: &str,
        schema: &Schema,
        log_time: u64,
        publish_time: u64,
    ) -> io::Result<()> {
        let count = &mut self.counts[usize::from(channel_id)];
        if *count == 0 {
            add_channel(&mut self.mcap, channel_id, topic, schema).map_err(io_error)?;
        }
        let header = MessageHeader { channel_id, sequence: *count, log_time, publish_time };
        *count = count.wrapping_add(1).max(1);
        self.mcap.write_to_known_channel(&header, &self.buffer).map_err(io_error)
    }

    /// Closes the chunk and hands it to the output.
    pub fn flush(&mut self) -> io::Result<()> {
        self.mcap.flush().map_err(io_error)
    }

    /// Closes the recording and returns how many messages and bytes it has, and the output, not yet flushed.
    pub fn finish(mut self, end: BTreeMap<String, String>) -> io::Result<(u64, u64, NoSeek<W>)> {
        let closed = self.mcap.write_metadata(&metadata(END_METADATA, end)).and_then(|()| self.mcap.finish());
        // Taken out in any case: dropped, the writer would try once more to close the file, whatever it lacks.
        let mut output = self.mcap.into_inner();
        let messages = closed.map_err(io_error)?.stats.map_or(0, |stats| stats.message_count);
        Ok((messages, output.stream_position()?, output))
    }

    /// Leaves the recording open, as after a crash.
    pub fn abandon(self) {
        drop(self.mcap.into_inner());
    }
}

fn add_channel<W: Write>(
    mcap: &mut mcap::Writer<NoSeek<W>>,
    id: u16,
    topic: &str,
    schema: &Schema,
) -> McapResult<()> {
    mcap.add_schema_with_id(id, schema.name, "protobuf", schema.descriptor_set)?;
    mcap.add_channel_with_id(id, id, topic, "protobuf", &BTreeMap::new())?;
    Ok(())
}

fn metadata(name: &str, metadata: BTreeMap<String, String>) -> Metadata {
    Metadata { name: name.to_owned(), metadata }
}

/// Time stamps are zero, so that the same session gives the same bytes.
fn toml_attachment<'a>(name: &str, text: &'a str) -> Attachment<'a> {
    Attachment {
        log_time: 0,
        create_time: 0,
        name: name.to_owned(),
        media_type: "application/toml".to_owned(),
        data: Cow::Borrowed(text.as_bytes()),
    }
}

/// The operating system's own error where there is one.
pub(crate) fn io_error(error: McapError) -> io::Error {
    match error {
        McapError::Io(error) => error,
        other => io::Error::other(other),
    }
}
