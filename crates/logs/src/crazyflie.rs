//! Logs of the Crazyflie: of its deck with a card (uSD), which tells its events and their variables at the beginning, and of its
//! client, which writes a log block as CSV with a stamp in ms. Variables have the names that the firmware gives them.

use std::{collections::HashMap, fs::File, ops::ControlFlow, path::Path};

use crc32fast::Hasher;

use crate::{
    Cell, Field, LogError, Losses, Sample, Topic, Visitor,
    bytes::{Scalar, Window, unread},
};

/// The first byte of a log of the card.
const MAGIC: u8 = 0xbc;
/// The name of the first column that the client writes.
const STAMP: &str = "Timestamp";
/// The type of every topic: whichever event a variable is logged by, it is called the same.
const KIND: &str = "crazyflie/log";
/// No head and no event is longer.
const LONGEST: usize = 1 << 16;
/// The checksum at the end.
const TAIL: usize = 4;

pub(crate) fn scan(path: &Path, visitor: &mut dyn Visitor) -> Result<Losses, LogError> {
    let mut window = Window::open(path)?;
    match window.ahead(1).map_err(|source| unread(path, source))?.first() {
        Some(&MAGIC) => card(path, window, visitor),
        _ => client(path, visitor),
    }
}

fn malformed(path: &Path, detail: impl Into<String>) -> LogError {
    LogError::Malformed {
        path: path.to_owned(),
        format: "a log of the Crazyflie",
        detail: detail.into(),
        source: None,
    }
}

/// What an event holds.
struct Event {
    topic: usize,
    wanted: Option<Vec<usize>>,
    /// Type and place of each variable.
    variables: Vec<(Scalar, usize)>,
    length: usize,
    samples: u64,
}

/// Python's letters for types, as the firmware writes them.
fn scalar(letter: u8) -> Option<Scalar> {
    Some(match letter {
        b'b' => Scalar::I8,
        b'B' => Scalar::U8,
        b'?' => Scalar::Bool,
        b'h' => Scalar::I16,
        b'H' => Scalar::U16,
        b'i' => Scalar::I32,
        b'I' => Scalar::U32,
        b'q' => Scalar::I64,
        b'Q' => Scalar::U64,
        b'e' => Scalar::F16,
        b'f' => Scalar::F32,
        b'd' => Scalar::F64,
        _ => return None,
    })
}

/// An event as the head tells it: its number, its name, and its variables with their types.
type Told<'a> = (u16, &'a str, Vec<(&'a str, Scalar)>);

/// Bytes of the head, from the front.
struct Head<'a>(&'a [u8], usize);

impl<'a> Head<'a> {
    fn number(&mut self) -> Option<u16> {
        let number = self.0.get(self.1..)?.first_chunk()?;
        self.1 += 2;
        Some(u16::from_le_bytes(*number))
    }

    fn text(&mut self) -> Option<&'a str> {
        let rest = self.0.get(self.1..)?;
        let end = rest.iter().position(|byte| *byte == 0)?;
        self.1 += end + 1;
        str::from_utf8(&rest[..end]).ok()
    }

    fn event(&mut self) -> Option<Told<'a>> {
        let (id, name) = (self.number()?, self.text()?);
        let variables = (0..self.number()?).map(|_| {
            let (name, letter) = self.text()?.strip_suffix(')')?.rsplit_once('(')?;
            Some((name, scalar(*letter.as_bytes().first()?)?))
        });
        Some((id, name, variables.collect::<Option<_>>()?))
    }
}

fn card(path: &Path, mut window: Window, visitor: &mut dyn Visitor) -> Result<Losses, LogError> {
    let mut losses = Losses::default();
    let mut checksum = Hasher::new();
    let ahead = window.ahead(LONGEST).map_err(|source| unread(path, source))?;
    let mut head = Head(ahead, 1);
    let version = head.number();
    let stamp = match version {
        Some(1) => Scalar::U32,
        Some(2) => Scalar::U64,
        _ => {
            return Err(malformed(
                path,
                format!("version {version:?} of the format is not known, but 1 and 2 are"),
            ));
        }
    };
    let ns_per_unit = if stamp == Scalar::U32 { 1_000_000 } else { 1000 };
    let read = head.number().and_then(|count| (0..count).map(|_| head.event()).collect::<Option<Vec<_>>>());
    let told = read.ok_or_else(|| {
        malformed(path, "it ends before it tells its variables, or tells them in an unknown way")
    })?;
    let mut events: HashMap<u16, Event> = HashMap::new();
    for (topic, (id, name, variables)) in told.into_iter().enumerate() {
        let fields = variables.iter().map(|(name, _)| Field::new(*name)).collect();
        let wanted = visitor.topic(&Topic { name: name.to_owned(), kind: KIND.to_owned(), fields });
        let mut length = 2 + stamp.size();
        let places = variables.iter().map(|(_, scalar)| {
            length += scalar.size();
            (*scalar, length - scalar.size())
        });
        let variables = places.collect();
        events.insert(id, Event { topic, wanted, variables, length, samples: 0 });
    }
    checksum.update(&ahead[..head.1]);
    let head = head.1;
    window.pass(head);
    loop {
        let ahead = window.ahead(LONGEST).map_err(|source| unread(path, source))?;
        if ahead.len() == TAIL && *ahead == checksum.clone().finalize().to_le_bytes() {
            return Ok(losses);
        }
        let event = ahead.first_chunk().and_then(|id| events.get_mut(&u16::from_le_bytes(*id)));
        let Some(event) = event.filter(|event| event.length <= ahead.len()) else { break };
        let bytes = &ahead[..event.length];
        checksum.update(bytes);
        if event.take(bytes, stamp, ns_per_unit, visitor).is_break() {
            return Ok(losses);
        }
        window.pass(event.length);
    }
    // Nothing marks where an event begins: what follows one that is not known cannot be told apart.
    let rest =
        std::fs::metadata(path).map_err(|source| unread(path, source))?.len().saturating_sub(window.at);
    let is_end = rest < LONGEST as u64;
    losses.cut = is_end;
    losses.damaged = u64::from(!is_end);
    losses.skipped_bytes = rest;
    Ok(losses)
}

impl Event {
    fn take(
        &mut self,
        bytes: &[u8],
        stamp: Scalar,
        ns_per_unit: i128,
        visitor: &mut dyn Visitor,
    ) -> ControlFlow<()> {
        self.samples += 1;
        let Some(wanted) = &self.wanted else { return ControlFlow::Continue(()) };
        let cell = |place: &usize| {
            let variable = self.variables.get(*place);
            variable.map_or(Cell::Absent, |(scalar, at)| scalar.read(&bytes[*at..], false))
        };
        let time_ns = match stamp.read(&bytes[2..], false) {
            Cell::Integer(time) => Some(time * ns_per_unit),
            _ => None,
        };
        let cells: Vec<Cell<'_>> = wanted.iter().map(cell).collect();
        visitor.sample(Sample { topic: self.topic, time_ns, cells: &cells, line: self.samples })
    }
}

fn client(path: &Path, visitor: &mut dyn Visitor) -> Result<Losses, LogError> {
    let file = File::open(path).map_err(|source| unread(path, source))?;
    let mut rows = csv::ReaderBuilder::new().flexible(true).from_reader(file);
    let header = rows.headers().map_err(|error| unread(path, error.into()))?.clone();
    if header.get(0) != Some(STAMP) {
        return Err(malformed(path, format!("its first column is not {STAMP}")));
    }
    let fields = header.iter().skip(1).map(Field::new).collect();
    let wanted = visitor.topic(&Topic { name: "log".to_owned(), kind: KIND.to_owned(), fields });
    let mut losses = Losses::default();
    let mut row = csv::ByteRecord::new();
    let mut samples = 0;
    let mut is_short = false;
    loop {
        match rows.read_byte_record(&mut row) {
            Ok(true) => {}
            // The last row of a client that was ended.
            Ok(false) => {
                losses.cut = is_short;
                losses.damaged -= u64::from(is_short);
                return Ok(losses);
            }
            Err(error) => return Err(unread(path, error.into())),
        }
        let number = |place: usize| -> Option<&str> { str::from_utf8(row.get(place)?).ok() };
        let time_ms = number(0).and_then(|text| text.parse::<i128>().ok());
        let (Some(time_ms), true) = (time_ms, row.len() == header.len()) else {
            losses.damaged += 1;
            is_short = row.len() < header.len();
            continue;
        };
        is_short = false;
        samples += 1;
        let Some(wanted) = &wanted else { continue };
        let cells: Vec<Cell<'_>> = wanted
            .iter()
            .map(|place| match number(place + 1).and_then(|text| text.trim().parse().ok()) {
                Some(number) => Cell::Number(number),
                None => row.get(place + 1).filter(|text| !text.is_empty()).map_or(Cell::Absent, Cell::Text),
            })
            .collect();
        let time_ns = Some(time_ms * 1_000_000);
        if visitor.sample(Sample { topic: 0, time_ns, cells: &cells, line: samples }).is_break() {
            return Ok(losses);
        }
    }
}
