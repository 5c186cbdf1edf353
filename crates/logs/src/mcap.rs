//! MCAP files of others: bags of ROS 2 (CDR), protobuf, JSON. Chunks whose checksum does not hold are passed over and counted.

use std::{
    collections::HashMap,
    fs::File,
    io::{self, BufReader, Read},
    ops::ControlFlow,
    path::Path,
};

use mcap::{
    McapError, parse_record,
    records::{Record, op},
    sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions},
};
use serde_json::Value;

use crate::{
    Cell, Field, Format, LogError, Losses, Sample, Topic, Visitor, bytes::unread, cdr, json, protobuf,
};

/// The longest record that is read, and the most that a damaged length can make this allocate.
const RECORD_LIMIT: usize = 256 << 20;
/// Opcode and length before each record.
const HEAD: usize = 9;

enum Decoder {
    Cdr(cdr::Definition),
    Protobuf(protobuf::Definition),
    /// The paths of the fields, once the first message told them.
    Json(Vec<String>),
}

/// A channel of the file.
struct Stream {
    decoder: Option<Decoder>,
    name: String,
    kind: String,
    /// Known from its first message on.
    topic: Option<usize>,
    wanted: Option<Vec<usize>>,
    samples: u64,
}

struct Reader<'v> {
    visitor: &'v mut dyn Visitor,
    /// Name, encoding and content of each schema.
    schemas: HashMap<u16, (String, String, Vec<u8>)>,
    streams: HashMap<u16, Stream>,
    topics: usize,
    losses: Losses,
}

pub(crate) fn scan(path: &Path, visitor: &mut dyn Visitor) -> Result<Losses, LogError> {
    let file = File::open(path).map_err(|source| unread(path, source))?;
    let mut reader = Reader {
        visitor,
        schemas: HashMap::new(),
        streams: HashMap::new(),
        topics: 0,
        losses: Losses::default(),
    };
    let options = LinearReaderOptions::default().with_emit_chunks(true).with_skip_end_magic(true);
    let mut ended = false;
    let outcome = records(BufReader::with_capacity(1 << 20, file), options, |kind, body| {
        match kind {
            op::CHUNK => return reader.chunk(body),
            op::DATA_END | op::FOOTER => ended = true,
            _ => {}
        }
        if ended { ControlFlow::Break(()) } else { reader.record(kind, body) }
    });
    match outcome {
        Ok(broken_off) => reader.losses.cut = !ended && !broken_off,
        Err(McapError::Io(source)) if source.kind() != io::ErrorKind::UnexpectedEof => {
            return Err(unread(path, source));
        }
        Err(source) if reader.topics == 0 => {
            let detail = "nothing could be read before its first fault".to_owned();
            let format = Format::Mcap.words();
            return Err(LogError::Malformed {
                path: path.to_owned(),
                format,
                detail,
                source: Some(source.into()),
            });
        }
        Err(_) => reader.losses.cut = true,
    }
    Ok(reader.losses)
}

/// Hands over records one after another; whether the taker had enough.
fn records<R: Read>(
    mut source: R,
    options: LinearReaderOptions,
    mut take: impl FnMut(u8, &[u8]) -> ControlFlow<()>,
) -> Result<bool, McapError> {
    let mut reader = LinearReader::new_with_options(options.with_record_length_limit(RECORD_LIMIT));
    while let Some(event) = reader.next_event() {
        match event? {
            LinearReadEvent::ReadRequest(wanted) => {
                let read = loop {
                    match source.read(reader.insert(wanted)) {
                        Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                        outcome => break outcome?,
                    }
                };
                reader.notify_read(read);
            }
            LinearReadEvent::Record { opcode, data } => {
                if take(opcode, data) == ControlFlow::Break(()) {
                    return Ok(true);
                }
            }
        }
    }
    Ok(false)
}

impl Reader<'_> {
    fn chunk(&mut self, body: &[u8]) -> ControlFlow<()> {
        let mut head = [0; HEAD];
        head[0] = op::CHUNK;
        head[1..].copy_from_slice(&(body.len() as u64).to_le_bytes());
        let options = LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true);
        match records(head.chain(body), options, |kind, body| self.record(kind, body)) {
            Ok(true) => ControlFlow::Break(()),
            Ok(false) => ControlFlow::Continue(()),
            Err(_) => {
                self.losses.damaged += 1;
                self.losses.skipped_bytes += body.len() as u64;
                ControlFlow::Continue(())
            }
        }
    }

    fn record(&mut self, kind: u8, body: &[u8]) -> ControlFlow<()> {
        if !matches!(kind, op::SCHEMA | op::CHANNEL | op::MESSAGE | op::METADATA) {
            return ControlFlow::Continue(());
        }
        match parse_record(kind, body) {
            Ok(Record::Schema { header, data }) => {
                self.schemas.insert(header.id, (header.name, header.encoding, data.into_owned()));
            }
            Ok(Record::Channel(channel)) => {
                if !self.streams.contains_key(&channel.id) {
                    let stream = self.stream(channel.topic, &channel.message_encoding, channel.schema_id);
                    self.streams.insert(channel.id, stream);
                }
            }
            Ok(Record::Message { header, data }) => {
                return self.message(header.channel_id, i128::from(header.log_time), &data);
            }
            Ok(Record::Metadata(metadata)) => {
                for (key, value) in &metadata.metadata {
                    self.visitor.about(&format!("{}.{key}", metadata.name), value);
                }
            }
            Ok(_) => {}
            Err(_) => self.losses.damaged += 1,
        }
        ControlFlow::Continue(())
    }

    fn stream(&self, topic: String, encoding: &str, schema: u16) -> Stream {
        let (kind, of, content) = match self.schemas.get(&schema) {
            Some((kind, of, content)) => (kind.as_str(), of.as_str(), content.as_slice()),
            None => ("", "", &[][..]),
        };
        let decoder = match (encoding, of) {
            ("cdr", "ros2msg") => {
                let text = String::from_utf8_lossy(content);
                cdr::Definition::parse(kind, &text).ok().map(Decoder::Cdr)
            }
            ("protobuf", _) => protobuf::Definition::parse(kind, content).ok().map(Decoder::Protobuf),
            ("json", _) => Some(Decoder::Json(Vec::new())),
            _ => None,
        };
        Stream { decoder, name: topic, kind: kind.to_owned(), topic: None, wanted: None, samples: 0 }
    }

    fn message(&mut self, channel: u16, time_ns: i128, data: &[u8]) -> ControlFlow<()> {
        let Some(stream) = self.streams.get_mut(&channel) else {
            self.losses.damaged += 1;
            return ControlFlow::Continue(());
        };
        stream.samples += 1;
        let parsed: Value;
        if let Some(Decoder::Json(_)) = stream.decoder {
            let Ok(value) = serde_json::from_slice(data) else {
                self.losses.damaged += 1;
                return ControlFlow::Continue(());
            };
            parsed = value;
        } else {
            parsed = Value::Null;
        }
        if stream.topic.is_none() {
            let fields: Vec<Field> = match &mut stream.decoder {
                None => Vec::new(),
                Some(Decoder::Cdr(definition)) => definition.fields(),
                Some(Decoder::Protobuf(definition)) => definition.fields().to_vec(),
                Some(Decoder::Json(pointers)) => {
                    let (fields, found) = json::fields(&parsed).into_iter().unzip();
                    *pointers = found;
                    fields
                }
            };
            stream.topic = Some(self.topics);
            self.topics += 1;
            let topic = Topic { name: stream.name.clone(), kind: stream.kind.clone(), fields };
            stream.wanted = self.visitor.topic(&topic);
        }
        let (Some(topic), Some(wanted)) = (stream.topic, &stream.wanted) else {
            return ControlFlow::Continue(());
        };
        let mut all = Vec::new();
        let read = match &stream.decoder {
            _ if wanted.is_empty() => Some(()),
            None => Some(()),
            Some(Decoder::Cdr(definition)) => definition.read(data, &mut all),
            Some(Decoder::Protobuf(definition)) => definition.read(data, &mut all),
            Some(Decoder::Json(pointers)) => {
                all.extend(pointers.iter().map(|pointer| match parsed.pointer(pointer) {
                    Some(Value::Number(number)) => match number.as_i128() {
                        Some(whole) => Cell::Integer(whole),
                        None => Cell::Number(number.as_f64().unwrap_or(f64::NAN)),
                    },
                    Some(Value::String(text)) => Cell::Text(text.as_bytes()),
                    Some(Value::Bool(is)) => Cell::Integer(i128::from(*is)),
                    _ => Cell::Absent,
                }));
                Some(())
            }
        };
        if read.is_none() {
            self.losses.damaged += 1;
            return ControlFlow::Continue(());
        }
        let cells: Vec<Cell<'_>> =
            wanted.iter().map(|place| all.get(*place).copied().unwrap_or_default()).collect();
        let line = stream.samples;
        self.visitor.sample(Sample { topic, time_ns: Some(time_ns), cells: &cells, line })
    }
}
