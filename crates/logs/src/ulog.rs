//! PX4's `ULog`. `px4-ulog` decodes; this finds the messages, so that damage costs what is damaged and no more, and keeps from the
//! decoder what it would panic on.
//!
//! The format: <https://docs.px4.io/main/en/dev_log/ulog_file_format.html>.

use std::{cell::RefCell, io, ops::ControlFlow, path::Path};

use px4_ulog::stream_parser::{
    LogParser,
    model::{
        DataMessage, DropoutMessage, FlattenedFieldType, FlattenedFormat, InfoMessage, ParameterMessage,
    },
};

use crate::{
    Cell, Field, Format, LogError, Losses, Sample, Topic, Visitor,
    bytes::{Scalar, Window, text, unread},
};

/// Magic, version and time of the start.
const HEADER: usize = 16;
/// Length, two bytes, and type of each message.
const HEAD: usize = 3;
const LONGEST: usize = HEAD + u16::MAX as usize;
/// So many messages in a row are no accident where a stream is found again.
const IN_A_ROW: usize = 4;
/// As much is ahead as the search for them wants, unless the file ends.
const LOOKED_AT: usize = (IN_A_ROW + 1) * LONGEST;
/// What a message of synchronisation holds.
const SYNC: &[u8] = &[0x2f, 0x73, 0x13, 0x20, 0x25, 0x0c, 0xbb, 0x12];

/// A topic of the log, as a subscription has it.
struct Subscription {
    topic: usize,
    /// Where the stamp stands in a message.
    stamp: Option<usize>,
    /// Place and type of each wanted field; `None` where the topic is not wanted.
    wanted: Option<Vec<(usize, Scalar)>>,
    samples: u64,
}

struct State<'v> {
    visitor: &'v mut dyn Visitor,
    /// By the number that the log gives each.
    subscriptions: Vec<Option<Subscription>>,
    topics: usize,
    losses: Losses,
    enough: bool,
    cells: Vec<Cell<'static>>,
}

pub(crate) fn scan(path: &Path, visitor: &mut dyn Visitor) -> Result<Losses, LogError> {
    let state = RefCell::new(State {
        visitor,
        subscriptions: Vec::new(),
        topics: 0,
        losses: Losses::default(),
        enough: false,
        cells: Vec::new(),
    });
    let mut on_data = |message: &DataMessage<'_>| state.borrow_mut().data(message);
    let mut on_dropout = |message: &DropoutMessage| {
        let losses = &mut state.borrow_mut().losses;
        losses.dropouts += 1;
        losses.dropout_s += f64::from(message.duration_ms) * 1e-3;
    };
    let mut on_parameter = |message: &ParameterMessage<'_>| {
        let (name, value) = match message {
            ParameterMessage::Float(name, value, _) => (name, f64::from(*value)),
            ParameterMessage::Int32(name, value, _) => (name, f64::from(*value)),
        };
        state.borrow_mut().visitor.parameter(name, value);
    };
    let mut on_info = |message: &InfoMessage<'_>| {
        if message.type_str.starts_with("char") {
            let value = String::from_utf8_lossy(text(message.value)).into_owned();
            state.borrow_mut().visitor.about(message.key, &value);
        }
    };
    let mut parser = LogParser::default();
    parser.set_data_message_callback(&mut on_data);
    parser.set_dropout_message_callback(&mut on_dropout);
    parser.set_parameter_message_callback(&mut on_parameter);
    parser.set_info_message_callback(&mut on_info);

    let mut window = Window::open(path)?;
    let failed = |source: io::Error| unread(path, source);
    let head = window.ahead(HEADER).map_err(failed)?;
    if head.len() < HEADER {
        return Err(malformed(path, "it ends within its first 16 bytes", None));
    }
    parser
        .consume_bytes(&head[..HEADER])
        .map_err(|error| malformed(path, "its first bytes are not a ULog's", Some(error.into())))?;
    window.pass(HEADER);
    loop {
        // A section that was appended later begins at a place told at the beginning; the message before it may have been cut.
        let at = window.at;
        let boundary = parser.appended_offsets().iter().copied().filter(|place| *place > at).min();
        let ahead = window.ahead(LOOKED_AT).map_err(failed)?;
        let to_boundary = boundary.and_then(|place| usize::try_from(place - at).ok());
        let ahead = &ahead[..to_boundary.map_or(ahead.len(), |room| room.min(ahead.len()))];
        if ahead.is_empty() || state.borrow().enough {
            break;
        }
        let whole = message(ahead).filter(|message| acceptable(message));
        let Some(found) = whole else {
            let skipped = next_messages(ahead, &state.borrow());
            let cut = skipped == ahead.len() && is_cut(ahead);
            let losses = &mut state.borrow_mut().losses;
            losses.cut |= cut;
            losses.damaged += u64::from(!cut);
            losses.skipped_bytes += skipped as u64;
            window.pass(skipped);
            continue;
        };
        if parser.consume_bytes(found).is_ok() {
            let length = found.len();
            window.pass(length);
            continue;
        }
        if parser.appended_offsets().iter().all(|place| *place == 0)
            && at == HEADER as u64
            && found[2] == b'B'
        {
            return Err(malformed(path, "it needs a newer reader: its flags are not known here", None));
        }
        // A message that was understood as far as its length, and no further.
        let rest = &ahead[found.len()..];
        let goes_on = rest.is_empty() || message(rest).is_some_and(acceptable);
        let skipped = if goes_on { found.len() } else { next_messages(ahead, &state.borrow()) };
        let losses = &mut state.borrow_mut().losses;
        losses.damaged += 1;
        losses.skipped_bytes += skipped as u64;
        window.pass(skipped);
    }
    let State { losses, topics, .. } = state.into_inner();
    if topics == 0 && losses.damaged > 0 {
        return Err(malformed(
            path,
            "its definitions are damaged, and without them nothing can be read",
            None,
        ));
    }
    Ok(losses)
}

impl State<'_> {
    fn data(&mut self, message: &DataMessage<'_>) {
        let id = usize::from(message.msg_id);
        if self.subscriptions.len() <= id {
            self.subscriptions.resize_with(id + 1, || None);
        }
        if self.subscriptions[id].is_none() {
            let topic = topic(message.flattened_format, message.multi_id.value());
            let fields = &message.flattened_format.fields;
            let wanted = self.visitor.topic(&topic).map(|wanted| {
                let of =
                    |place: usize| (usize::from(fields[place].offset), scalar(&fields[place].field_type));
                wanted.into_iter().map(of).collect()
            });
            let stamp = message.flattened_format.timestamp_field.as_ref();
            self.subscriptions[id] = Some(Subscription {
                topic: self.topics,
                stamp: stamp.map(|field| usize::from(field.offset)),
                wanted,
                samples: 0,
            });
            self.topics += 1;
        }
        let Some(subscription) = &mut self.subscriptions[id] else { return };
        subscription.samples += 1;
        let Some(wanted) = &subscription.wanted else { return };
        self.cells.clear();
        self.cells.extend(
            wanted
                .iter()
                .map(|(offset, kind)| kind.read(message.data.get(*offset..).unwrap_or_default(), false)),
        );
        let micros = subscription.stamp.and_then(|offset| {
            match Scalar::U64.read(message.data.get(offset..)?, false) {
                Cell::Integer(micros) => Some(micros),
                _ => None,
            }
        });
        let sample = Sample {
            topic: subscription.topic,
            time_ns: micros.map(|micros| micros * 1000),
            cells: &self.cells,
            line: subscription.samples,
        };
        self.enough |= self.visitor.sample(sample) == ControlFlow::Break(());
    }
}

/// The name has the number of the instance behind it, but for the first.
fn topic(format: &FlattenedFormat, instance: u8) -> Topic {
    let name = match instance {
        0 => format.message_name.clone(),
        instance => format!("{}[{instance}]", format.message_name),
    };
    let fields = format.fields.iter().map(|field| Field::new(&field.flattened_field_name)).collect();
    Topic { name, kind: format.message_name.clone(), fields }
}

fn scalar(kind: &FlattenedFieldType) -> Scalar {
    match kind {
        FlattenedFieldType::Int8 => Scalar::I8,
        FlattenedFieldType::UInt8 | FlattenedFieldType::Char => Scalar::U8,
        FlattenedFieldType::Int16 => Scalar::I16,
        FlattenedFieldType::UInt16 => Scalar::U16,
        FlattenedFieldType::Int32 => Scalar::I32,
        FlattenedFieldType::UInt32 => Scalar::U32,
        FlattenedFieldType::Int64 => Scalar::I64,
        FlattenedFieldType::UInt64 => Scalar::U64,
        FlattenedFieldType::Float => Scalar::F32,
        FlattenedFieldType::Double => Scalar::F64,
        FlattenedFieldType::Bool => Scalar::Bool,
    }
}

fn length(ahead: &[u8]) -> Option<usize> {
    let [low, high, ..] = ahead else { return None };
    Some(HEAD + usize::from(u16::from_le_bytes([*low, *high])))
}

/// The message at the beginning of what is ahead, if all of it is there.
fn message(ahead: &[u8]) -> Option<&[u8]> {
    ahead.get(..length(ahead)?)
}

/// Whether its type is known, and its content as long as the type wants: the decoder takes that for granted.
fn acceptable(message: &[u8]) -> bool {
    let [_, _, kind, content @ ..] = message else { return false };
    match kind {
        b'F' | b'L' | b'C' | b'M' | b'I' | b'Q' => !content.is_empty(),
        b'D' => content.len() > 2,
        b'A' => content.len() > 3,
        b'P' => content.first().is_some_and(|key| content.len() == 1 + usize::from(*key) + 4),
        b'S' => content == SYNC,
        b'O' | b'R' => content.len() == 2,
        b'B' => content.len() >= 40,
        _ => false,
    }
}

/// Whether the file, or the section, ends within a message that is sound as far as it goes.
fn is_cut(ahead: &[u8]) -> bool {
    ahead.len() < LOOKED_AT
        && message(ahead).is_none()
        && ahead.get(2).is_none_or(|kind| b"FLCMIQDAPSORB".contains(kind))
}

/// How many bytes to pass until messages follow one another again.
fn next_messages(ahead: &[u8], state: &State<'_>) -> usize {
    let is_known = |message: &[u8]| {
        message[2] != b'D' || {
            let id = usize::from(u16::from_le_bytes([message[3], message[4]]));
            state.subscriptions.get(id).is_some_and(Option::is_some)
        }
    };
    let follows = |start: usize| {
        let mut rest = &ahead[start..];
        for _ in 0..IN_A_ROW {
            if rest.is_empty() {
                return true;
            }
            match message(rest).filter(|found| acceptable(found) && is_known(found)) {
                Some(found) => rest = &rest[found.len()..],
                None => return false,
            }
        }
        true
    };
    // What may begin a message that ends beyond what is ahead is looked at again with more ahead.
    let searched = if ahead.len() < LOOKED_AT { ahead.len() } else { ahead.len() - IN_A_ROW * LONGEST };
    (1..searched).find(|start| follows(*start)).unwrap_or(searched)
}

fn malformed(
    path: &Path,
    detail: &str,
    source: Option<Box<dyn std::error::Error + Send + Sync>>,
) -> LogError {
    LogError::Malformed {
        path: path.to_owned(),
        format: Format::Ulog.words(),
        detail: detail.to_owned(),
        source,
    }
}
