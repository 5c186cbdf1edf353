//! Records to MCAP.

use std::{
    borrow::Cow,
    collections::BTreeMap,
    io::{self, Write},
};

use bench_device::{Time, TrackStatus};
use bench_rig::Rig;
use mcap::records::{self, AttachmentHeader, Metadata, SchemaHeader};

use crate::{
    Channel, Message, Observer, Record, Session, View, ViewerChannel,
    channel::Schema,
    codec::{self, since_epoch},
    images,
    layout::{ChannelKey, Layout},
    session::{
        BENCH_VERSION, END_METADATA, EXTRA_METADATA, MISSION_ATTACHMENT, RIG_ATTACHMENT, SESSION_METADATA,
    },
    viewer::{self, Placed, Room},
};

/// MCAP channels: that of the poses is the first, those of a [`Channel`] follow in its order, then the other ones for viewers.
const POSE_ID: u16 = 1;

/// Least time between two poses, s: thirty a second are what a three-dimensional view can show, whatever the rate of the
/// truth. A little less than a thirtieth, so that thirty truths a second are thirty poses.
const POSE_INTERVAL_S: f64 = 0.033;

const fn channel_id(channel: Channel) -> u16 {
    POSE_ID + 1 + channel as u16
}

const fn viewer_id(channel: ViewerChannel) -> u16 {
    match channel {
        ViewerChannel::Pose => POSE_ID,
        other => POSE_ID + Channel::ALL.len() as u16 + other as u16,
    }
}

const CHANNEL_IDS: usize = POSE_ID as usize + Channel::ALL.len() + ViewerChannel::ALL.len();

/// Names the writer in the file.
pub(crate) fn library() -> String {
    format!("bench {BENCH_VERSION}")
}

/// Writes one recording. Session and attachments come first, so that they survive whatever happens later.
pub(crate) struct MessageWriter<W: Write> {
    layout: Layout<W>,
    observer: Option<Box<dyn Observer>>,
    /// By the MCAP channel's number, from its first message on.
    channels: [Option<ChannelState>; CHANNEL_IDS],
    /// What log times count from, ns since 1970.
    epoch_ns: u64,
    /// The attached rig, until the scene is made of it with the first record; none if it cannot be read.
    rig: Option<Rig>,
    begun: bool,
    truth: Rate,
    tracked: Rate,
    is_bare: bool,
}

/// Where a message belongs.
struct Place {
    id: u16,
    schema_id: u16,
    topic: &'static str,
    schema: Schema,
    is_static: bool,
}

#[derive(Clone, Copy)]
struct ChannelState {
    key: ChannelKey,
    next_sequence: u32,
}

/// Lets through what viewers can show.
#[derive(Default)]
struct Rate {
    last: Option<Time>,
}

impl Rate {
    fn is_due(&mut self, time: Time) -> bool {
        let due = self.last.is_none_or(|last| time < last || time.since_s(last) >= POSE_INTERVAL_S);
        if due {
            self.last = Some(time);
        }
        due
    }
}

impl<W: Write> MessageWriter<W> {
    /// Writes and flushes all that is known before the first message.
    pub fn start(output: W, session: &Session, observer: Option<Box<dyn Observer>>) -> io::Result<Self> {
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
        Ok(Self {
            layout,
            observer,
            channels: [None; CHANNEL_IDS],
            epoch_ns: session.epoch_unix_ns.unwrap_or(0),
            rig: session.rig().map(Cow::into_owned),
            begun: false,
            truth: Rate::default(),
            tracked: Rate::default(),
            is_bare: false,
        })
    }

    /// Without what viewers draw, and with numbers of single precision.
    pub fn bare(self) -> Self {
        Self { is_bare: true, rig: None, ..self }
    }

    /// Writes a record and what viewers draw of it, if that is due.
    pub fn write(&mut self, record: &Record) -> io::Result<()> {
        let (channel, time) = (record.channel(), record.time());
        if !self.begun {
            self.begun = true;
            self.write_room(time)?;
        }
        // When it was sent, where that is known apart from when it came.
        let published = match record {
            Record::Position(position) => position.exposed_at,
            _ => time,
        };
        let (epoch_ns, single, times) = (self.epoch_ns, self.is_bare, (time, published));
        let id = channel_id(channel);
        let place =
            Place { id, schema_id: id, topic: channel.topic(), schema: channel.schema(), is_static: false };
        self.put(&place, times, |out| codec::encode(record, epoch_ns, single, out))?;
        match record {
            _ if self.is_bare => Ok(()),
            Record::Truth(truth) if self.truth.is_due(time) => {
                self.write_placed(ViewerChannel::Pose, &Placed::from(truth), times)
            }
            // Where there is a truth, a second pose beside it would cost more than it shows.
            Record::Position(position)
                if position.status != TrackStatus::Lost
                    && self.truth.last.is_none()
                    && self.tracked.is_due(time) =>
            {
                self.write_placed(ViewerChannel::TrackedPose, &Placed::from(position), times)
            }
            _ => Ok(()),
        }
    }

    /// Writes a pose, and moves the airframe there.
    fn write_placed(
        &mut self,
        channel: ViewerChannel,
        placed: &Placed,
        times: (Time, Time),
    ) -> io::Result<()> {
        let stamp = since_epoch(times.0, self.epoch_ns);
        self.put_for_viewers(channel, times, |out| placed.encode_pose(stamp, out))?;
        self.put_for_viewers(ViewerChannel::Transform, times, |out| placed.encode_transform(stamp, out))
    }

    /// Writes what stands still, by the attached rig. One that cannot be read is attached all the same; its scene is left out.
    fn write_room(&mut self, time: Time) -> io::Result<()> {
        let Some(rig) = self.rig.take() else { return Ok(()) };
        let room = Room::new(&rig, since_epoch(time, self.epoch_ns));
        let messages = [
            (ViewerChannel::Scene, Some(room.scene())),
            (ViewerChannel::StaticTransforms, room.cameras()),
            (ViewerChannel::Calibration, room.calibration()),
        ];
        for (channel, message) in messages {
            if let Some(message) = message {
                self.put_for_viewers(channel, (time, time), |out| out.extend_from_slice(&message))?;
            }
        }
        Ok(())
    }

    /// Compresses a view and writes it.
    pub fn write_view(&mut self, view: &View) -> io::Result<()> {
        let png = images::png(view)?;
        let stamp = since_epoch(view.exposed_at, self.epoch_ns);
        self.put_for_viewers(view.channel, (view.arrived_at, view.exposed_at), |out| {
            viewer::encode_image(view.channel, stamp, png, out);
        })
    }

    fn put_for_viewers(
        &mut self,
        channel: ViewerChannel,
        times: (Time, Time),
        encode: impl FnOnce(&mut Vec<u8>),
    ) -> io::Result<()> {
        let place = Place {
            id: viewer_id(channel),
            schema_id: viewer_id(channel.schema_of()),
            topic: channel.topic(),
            schema: channel.schema(),
            is_static: channel.is_static(),
        };
        self.put(&place, times, encode)
    }

    /// Writes a message; the channel, and its schema, are made known with the first one.
    fn put(
        &mut self,
        place: &Place,
        (logged, published): (Time, Time),
        encode: impl FnOnce(&mut Vec<u8>),
    ) -> io::Result<()> {
        let channel = match &mut self.channels[usize::from(place.id)] {
            Some(channel) => channel,
            unknown => {
                unknown.insert(ChannelState { key: add_channel(&mut self.layout, place)?, next_sequence: 0 })
            }
        };
        let sequence = channel.next_sequence;
        channel.next_sequence = sequence.wrapping_add(1);
        let [log_time, publish_time] =
            [logged, published].map(|time| since_epoch(time, self.epoch_ns).nanos());
        let observer = self.observer.as_mut();
        self.layout.message(channel.key, sequence, log_time, publish_time, |out| {
            let begin = out.len();
            encode(out);
            if let Some(observer) = observer {
                observer.see(&Message {
                    topic: place.topic,
                    schema: place.schema.name,
                    descriptor_set: place.schema.descriptor_set,
                    log_time_ns: log_time,
                    is_static: place.is_static,
                    data: &out[begin..],
                });
            }
        })
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

fn add_channel<W: Write>(layout: &mut Layout<W>, place: &Place) -> io::Result<ChannelKey> {
    let &Place { id, schema_id, topic, schema, .. } = place;
    let encoding = || "protobuf".to_owned();
    if !layout.has_schema(schema_id) {
        let header = SchemaHeader { id: schema_id, name: schema.name.to_owned(), encoding: encoding() };
        layout.add_schema(&header, schema.descriptor_set)?;
    }
    layout.add_channel(&records::Channel {
        id,
        schema_id,
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
