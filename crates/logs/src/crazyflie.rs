//! What the Crazyflie's micro-SD deck writes: types of events with their variables, then events.
//!
//! The format, of versions 1 and 2: `docs/userguides/decks/micro-sd-card-deck.md` and `tools/usdlog` of the firmware.

use std::{fs::File, io::Read as _, ops::ControlFlow, path::Path};

use crc32fast::Hasher;

use crate::{
    Cell, Field, Format, LogError, Losses, Sample, Topic, Visitor,
    bytes::{Scalar, Window, unread},
};

/// The checksum over all before it, at the end.
const CHECKSUM: u64 = 4;
/// Far more than any header of the firmware.
const LONGEST_HEADER: usize = 1 << 16;

struct EventType {
    id: u16,
    /// Place among the topics.
    topic: usize,
    variables: Vec<(Scalar, usize)>,
    length: usize,
    wanted: Option<Vec<usize>>,
    samples: u64,
}

pub(crate) fn scan(path: &Path, visitor: &mut dyn Visitor) -> Result<Losses, LogError> {
    let (is_closed, bytes) = check(path)?;
    let end = if is_closed { bytes - CHECKSUM } else { bytes };
    let mut losses = Losses { cut: !is_closed, ..Losses::default() };
    let mut window = Window::open(path)?;
    let head = window.ahead(LONGEST_HEADER).map_err(|source| unread(path, source))?;
    let (version, mut events, length) = header(head, visitor).ok_or_else(|| LogError::Malformed {
        path: path.to_owned(),
        format: Format::Crazyflie.words(),
        detail: "its list of variables is damaged".to_owned(),
        source: None,
    })?;
    window.pass(length);
    // Its number and its time stand before each event.
    let stamp = if version == 1 { Scalar::U32 } else { Scalar::U64 };
    let before = 2 + stamp.size();
    let longest = events.iter().map(|event| event.length).max().unwrap_or(0);
    let mut cells = Vec::new();
    while window.at < end {
        let left = usize::try_from(end - window.at).unwrap_or(usize::MAX);
        let ahead = window.ahead(before + longest).map_err(|source| unread(path, source))?;
        let ahead = &ahead[..ahead.len().min(left)];
        let id = ahead.get(..2).map(|bytes| u16::from_le_bytes([bytes[0], bytes[1]]));
        let event = events.iter_mut().find(|event| Some(event.id) == id);
        let Some((event, values)) = event.and_then(|event| {
            let values = ahead.get(before..before + event.length)?;
            Some((event, values))
        }) else {
            // Nothing marks where the next event begins.
            losses.damaged += 1;
            losses.skipped_bytes += left as u64;
            break;
        };
        event.samples += 1;
        if let Some(wanted) = &event.wanted {
            cells.clear();
            cells.extend(wanted.iter().map(|place| {
                let (scalar, at) = event.variables[*place];
                scalar.read(&values[at..], false)
            }));
            let to_ns = if version == 1 { 1_000_000 } else { 1000 };
            let time_ns = match stamp.read(&ahead[2..], false) {
                Cell::Integer(time) => Some(time * to_ns),
                _ => None,
            };
            let sample =
                Sample { topic: event.topic, time_ns, cells: &cells, line: event.samples, torn: None };
            if visitor.sample(sample) == ControlFlow::Break(()) {
                break;
            }
        }
        let length = before + event.length;
        window.pass(length);
    }
    Ok(losses)
}

/// Whether the checksum at the end holds, and how long the file is.
fn check(path: &Path) -> Result<(bool, u64), LogError> {
    let failed = |source| unread(path, source);
    let mut file = File::open(path).map_err(failed)?;
    let bytes = file.metadata().map_err(failed)?.len();
    let mut hasher = Hasher::new();
    let mut left = bytes.saturating_sub(CHECKSUM);
    let mut buffer = vec![0; 1 << 16];
    while left > 0 {
        let room = buffer.len().min(usize::try_from(left).unwrap_or(buffer.len()));
        let read = file.read(&mut buffer[..room]).map_err(failed)?;
        if read == 0 {
            break;
        }
        hasher.update(&buffer[..read]);
        left -= read as u64;
    }
    let mut checksum = Vec::new();
    file.read_to_end(&mut checksum).map_err(failed)?;
    let holds = checksum.try_into().is_ok_and(|bytes| u32::from_le_bytes(bytes) == hasher.finalize());
    Ok((holds, bytes))
}

/// Version, types of events and length of the header.
fn header(head: &[u8], visitor: &mut dyn Visitor) -> Option<(u16, Vec<EventType>, usize)> {
    let short = |at: usize| Some(u16::from_le_bytes([*head.get(at)?, *head.get(at + 1)?]));
    let name = |at: usize| {
        let end = at + head.get(at..)?.iter().position(|byte| *byte == 0)?;
        Some((str::from_utf8(&head[at..end]).ok()?, end + 1))
    };
    let (version, count) = (short(1)?, short(3)?);
    let mut at = 5;
    let mut events = Vec::new();
    for topic in 0..usize::from(count) {
        let id = short(at)?;
        let (event, next) = name(at + 2)?;
        at = next + 2;
        let mut fields = Vec::new();
        let mut variables = Vec::new();
        let mut length = 0;
        for _ in 0..short(next)? {
            // Such as `stateEstimate.z(f)`.
            let (variable, next) = name(at)?;
            at = next;
            let (variable, letter) = variable.strip_suffix(')')?.rsplit_once('(')?;
            let scalar = match letter {
                "b" => Scalar::I8,
                "B" => Scalar::U8,
                "?" => Scalar::Bool,
                "h" => Scalar::I16,
                "H" => Scalar::U16,
                "i" | "l" => Scalar::I32,
                "I" | "L" => Scalar::U32,
                "q" => Scalar::I64,
                "Q" => Scalar::U64,
                "e" => Scalar::F16,
                "f" => Scalar::F32,
                "d" => Scalar::F64,
                _ => return None,
            };
            fields.push(Field::new(variable));
            variables.push((scalar, length));
            length += scalar.size();
        }
        let wanted = visitor.topic(&Topic { name: event.to_owned(), kind: String::new(), fields });
        events.push(EventType { id, topic, variables, length, wanted, samples: 0 });
    }
    Some((version, events, at))
}
