//! Records to MCAP.

use std::{
    collections::BTreeMap,
    io::{self, Write},
};

use bench_device::Time;
use mcap::records::{self, AttachmentHeader, Metadata, SchemaHeader};

use crate::{
    Channel, Record, Session,
    channel::{POSE_SCHEMA, Schema},
    codec,
    layout::{ChannelKey, Layout},
    session::{
        BENCH_VERSION, END_METADATA, EXTRA_METADATA, MISSION_ATTACHMENT, RIG_ATTACHMENT, SESSION_METADATA,
    },
};

/// MCAP channel and schema of the pose; those of a [`Channel`] follow in its order.
const POSE_ID: u16 = 1;

/// Least time between two poses, s: thirty a second are what a three-dimensional view can show, whatever the rate of the
/// truth. A little less than a thirtieth, so that thirty truths a second are thirty poses.
const POSE_INTERVAL_S: f64 = 0.033;

const fn channel_id(channel: Channel) -> u16 {
    POSE_ID + 1 + channel as u16
}

const CHANNEL_IDS: usize = POSE_ID as usize + 1 + Channel::ALL.len();

/// Names the writer in the file.
pub(crate) fn library() -> String {
    format!("bench {BENCH_VERSION}")
}

/// Writes one recording. Session and attachments come first, so that they survive whatever happens later.
pub(crate) struct MessageWriter<W: Write> {
    layout: Layout<W>,
    /// By the MCAP channel's number, from its first message on.
    channels: [Option<ChannelState>; CHANNEL_IDS],
    last_pose: Option<Time>,
}

#[derive(Clone, Copy)]
struct ChannelState {
    key: ChannelKey,
    next_sequence: u32,
}

impl<W: Write> MessageWriter<W> {
    /// Writes and flushes all that is known before the first message.
    pub fn start(output: W, session: &Session) -> io::Result<Self> {
        let mut layout = Layout::start(output, library())?;
        layout.add_metadata(&metadata(SESSION_METADATA, session.to_metadata()))?;
        if !session.extra.is_empty() {
            layout.add_metadata(&metadata(EXTRA_METADATA, session.extra.clone()))?;
        }
        for (name, text) in [(RIG_ATTACHMENT, &session.rig_toml), (MISSION_ATTACHMENT, &session.mission_toml)]
        {
            if let Some(text) = text {
                layout.attach(toml_attachment(name), text.as_bytes())?;
            }
        }
        layout.flush()?;
        Ok(Self { layout, channels: [None; CHANNEL_IDS], last_pose: None })
    }

    /// Writes a record and, beside a truth, the pose if one is due.
    pub fn write(&mut self, record: &Record) -> io::Result<()> {
        let channel = record.channel();
        // When it was sent, where that is known apart from when it came.
        let published_ns = match record {
            Record::Position(position) => position.exposed_at.nanos(),
            _ => record.time().nanos(),
        };
        let times = (record.time().nanos(), published_ns);
        self.put(channel_id(channel), channel.topic(), &channel.schema(), times, |out| {
            codec::encode(record, out);
        })?;
        if let Record::Truth(truth) = record
            && self.pose_is_due(truth.time)
        {
            self.last_pose = Some(truth.time);
            self.put(POSE_ID, Channel::POSE_TOPIC, &POSE_SCHEMA, times, |out| {
                codec::encode_pose(truth, out);
            })?;
        }
        Ok(())
    }

    fn pose_is_due(&self, time: Time) -> bool {
        self.last_pose.is_none_or(|last| time < last || time.since_s(last) >= POSE_INTERVAL_S)
    }

    /// Writes a message; the channel is made known with its first one.
    fn put(
        &mut self,
        id: u16,
        topic: &str,
        schema: &Schema,
        (log_time, publish_time): (u64, u64),
        encode: impl FnOnce(&mut Vec<u8>),
    ) -> io::Result<()> {
        let channel = match &mut self.channels[usize::from(id)] {
            Some(channel) => channel,
            unknown => unknown.insert(ChannelState {
                key: add_channel(&mut self.layout, id, topic, schema)?,
                next_sequence: 0,
            }),
        };
        let sequence = channel.next_sequence;
        channel.next_sequence = sequence.wrapping_add(1);
        self.layout.message(channel.key, sequence, log_time, publish_time, encode)
    }

    /// Closes the chunk and hands it to the output.
    pub fn flush(&mut self) -> io::Result<()> {
        self.layout.flush()
    }

    /// Closes the recording and returns how many messages and bytes it has, and the output, not yet flushed.
    pub fn finish(mut self, end: BTreeMap<String, String>) -> io::Result<(u64, u64, W)> {
        self.layout.add_metadata(&metadata(END_METADATA, end))?;
        self.layout.finish()
    }
}

fn add_channel<W: Write>(
    layout: &mut Layout<W>,
    id: u16,
    topic: &str,
    schema: &Schema,
) -> io::Result<ChannelKey> {
    let encoding = || "protobuf".to_owned();
    let header = SchemaHeader { id, name: schema.name.to_owned(), encoding: encoding() };
    layout.add_schema(&header, schema.descriptor_set)?;
    layout.add_channel(&records::Channel {
        id,
        schema_id: id,
        topic: topic.to_owned(),
        message_encoding: encoding(),
        metadata: BTreeMap::new(),
    })
}

fn metadata(name: &str, metadata: BTreeMap<String, String>) -> Metadata {
    Metadata { name: name.to_owned(), metadata }
}

/// Time stamps are zero, so that the same session gives the same bytes.
fn toml_attachment(name: &str) -> AttachmentHeader {
    AttachmentHeader {
        log_time: 0,
        create_time: 0,
        name: name.to_owned(),
        media_type: "application/toml".to_owned(),
    }
}
