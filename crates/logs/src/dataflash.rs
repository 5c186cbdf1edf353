//! `ArduPilot`'s dataflash log: messages of fixed length, whose layout the log tells of itself in messages of type FMT.
//!
//! Own code, since what there is gives up after some damage without a word, and trusts lengths that a damaged FMT holds. The format:
//! <https://ardupilot.org/dev/docs/code-overview-adding-a-new-log-message.html> and `libraries/AP_Logger/LogStructure.h`.

use std::{borrow::Cow, collections::HashMap, ops::ControlFlow, path::Path};

use crate::{
    Cell, Field, LogError, Losses, Sample, Topic, Visitor,
    bytes::{Scalar, Window, text, unread},
};

const MAGIC: [u8; 2] = [0xa3, 0x95];
const HEAD: usize = 3;
/// The message that tells of messages, and its whole length.
const FMT: u8 = 128;
const FMT_LENGTH: usize = 89;
const LONGEST: usize = 255;

/// What one letter of a format stands for.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Letter {
    Number(Scalar),
    /// A whole number that stands for so many parts of one.
    Scaled(Scalar, f64),
    Text(usize),
    /// Of 32 numbers, of which nothing is handed over.
    Array,
}

impl Letter {
    fn of(letter: u8) -> Option<Self> {
        Some(match letter {
            b'b' => Self::Number(Scalar::I8),
            b'B' | b'M' => Self::Number(Scalar::U8),
            b'h' => Self::Number(Scalar::I16),
            b'H' => Self::Number(Scalar::U16),
            b'i' => Self::Number(Scalar::I32),
            b'I' => Self::Number(Scalar::U32),
            b'q' => Self::Number(Scalar::I64),
            b'Q' => Self::Number(Scalar::U64),
            b'g' => Self::Number(Scalar::F16),
            b'f' => Self::Number(Scalar::F32),
            b'd' => Self::Number(Scalar::F64),
            b'c' => Self::Scaled(Scalar::I16, 100.0),
            b'C' => Self::Scaled(Scalar::U16, 100.0),
            b'e' => Self::Scaled(Scalar::I32, 100.0),
            b'E' => Self::Scaled(Scalar::U32, 100.0),
            b'L' => Self::Scaled(Scalar::I32, 1e7),
            b'n' => Self::Text(4),
            b'N' => Self::Text(16),
            b'Z' => Self::Text(64),
            b'a' => Self::Array,
            _ => return None,
        })
    }

    const fn size(self) -> usize {
        match self {
            Self::Number(scalar) | Self::Scaled(scalar, _) => scalar.size(),
            Self::Text(size) => size,
            Self::Array => 64,
        }
    }

    fn read(self, bytes: &[u8]) -> Cell<'_> {
        match self {
            Self::Number(scalar) => scalar.read(bytes, false),
            Self::Scaled(scalar, parts) => match scalar.read(bytes, false) {
                Cell::Integer(number) => Cell::Number(number as f64 / parts),
                other => other,
            },
            Self::Text(size) => bytes.get(..size).map_or(Cell::Absent, |bytes| Cell::Text(text(bytes))),
            Self::Array => Cell::Absent,
        }
    }
}

/// What a FMT says of one type of messages.
struct Layout {
    name: String,
    length: usize,
    labels: Vec<String>,
    /// Letter and place in the message of each field.
    fields: Vec<(Letter, usize)>,
    /// Ids of the fields' units, where a FMTU told them.
    units: Vec<u8>,
}

impl Layout {
    fn place(&self, label: &str) -> Option<usize> {
        self.labels.iter().position(|known| known == label)
    }

    fn cell<'a>(&self, label: &str, message: &'a [u8]) -> Cell<'a> {
        let Some((letter, at)) = self.place(label).and_then(|place| self.fields.get(place)) else {
            return Cell::Absent;
        };
        letter.read(message.get(*at..).unwrap_or_default())
    }

    fn time_ns(&self, message: &[u8]) -> Option<i128> {
        let whole = |label, factor| match self.cell(label, message) {
            Cell::Integer(time) => Some(time * factor),
            _ => None,
        };
        whole("TimeUS", 1000).or_else(|| whole("TimeMS", 1_000_000))
    }

    /// Which of several sensors or filters it is of: the log marks that field's unit, or it has one of the usual names.
    fn instance(&self, message: &[u8]) -> i128 {
        let marked = self.units.iter().position(|unit| *unit == b'#');
        let usual = || ["I", "C", "Inst", "Instance"].iter().find_map(|label| self.place(label));
        let place = marked.or_else(usual);
        match place.and_then(|place| self.fields.get(place)) {
            Some((letter @ Letter::Number(Scalar::U8), at)) => {
                match letter.read(message.get(*at..).unwrap_or_default()) {
                    Cell::Integer(number) => number,
                    _ => 0,
                }
            }
            _ => 0,
        }
    }
}

/// A topic: one type of messages of one instance.
struct Stream {
    topic: usize,
    wanted: Option<Vec<usize>>,
    samples: u64,
}

pub(crate) fn scan(path: &Path, visitor: &mut dyn Visitor) -> Result<Losses, LogError> {
    let mut reader = Reader {
        visitor,
        layouts: HashMap::from([(FMT, fmt_of_fmt())]),
        units: HashMap::new(),
        streams: HashMap::new(),
        losses: Losses::default(),
    };
    let mut window = Window::open(path)?;
    loop {
        let ahead = window.ahead(2 * LONGEST).map_err(|source| unread(path, source))?;
        if ahead.is_empty() {
            break;
        }
        match reader.message(ahead) {
            Found::Message(length) => {
                let message = &ahead[..length];
                let enough = reader.take(message) == ControlFlow::Break(());
                window.pass(length);
                if enough {
                    break;
                }
            }
            Found::Cut => {
                reader.losses.cut = true;
                reader.losses.skipped_bytes += ahead.len() as u64;
                break;
            }
            Found::Nothing => {
                let next = (1..ahead.len()).find(|start| ahead[*start..].starts_with(&MAGIC));
                let skipped = next.unwrap_or_else(|| (ahead.len() - 1).max(1));
                // Where the card's last block was not filled, the rest of it is of one kind.
                let is_filler = next.is_none() && ahead.iter().all(|byte| *byte == ahead[0]);
                if !is_filler {
                    reader.losses.damaged += u64::from(ahead.starts_with(&MAGIC));
                    reader.losses.skipped_bytes += skipped as u64;
                }
                window.pass(skipped);
            }
        }
    }
    Ok(reader.losses)
}

enum Found {
    /// A message of this length.
    Message(usize),
    /// The file ends within a message.
    Cut,
    /// No message begins here.
    Nothing,
}

struct Reader<'v> {
    visitor: &'v mut dyn Visitor,
    layouts: HashMap<u8, Layout>,
    /// Labels of units by their ids.
    units: HashMap<u8, String>,
    streams: HashMap<(u8, i128), Stream>,
    losses: Losses,
}

impl Reader<'_> {
    fn message(&self, ahead: &[u8]) -> Found {
        let [first, second, kind, ..] = ahead else {
            return if MAGIC.starts_with(&ahead[..ahead.len().min(2)]) { Found::Cut } else { Found::Nothing };
        };
        let Some(layout) = self.layouts.get(kind).filter(|_| [*first, *second] == MAGIC) else {
            return Found::Nothing;
        };
        match ahead.get(layout.length..) {
            None => Found::Cut,
            // A message is whole where the next one, or the end or the filler of the last block, follows.
            Some(rest) => match rest {
                [] | [0xa3] | [0xa3, 0x95, ..] | [0 | 0xff, ..] => Found::Message(layout.length),
                _ => Found::Nothing,
            },
        }
    }

    fn take(&mut self, message: &[u8]) -> ControlFlow<()> {
        let kind = message[2];
        if kind == FMT {
            self.learn_layout(message);
            return ControlFlow::Continue(());
        }
        let Some(layout) = self.layouts.get(&kind) else { return ControlFlow::Continue(()) };
        match layout.name.as_str() {
            "FMTU" => {
                let (of, units) = (layout.cell("FmtType", message), layout.cell("UnitIds", message));
                if let (Cell::Integer(of), Cell::Text(units)) = (of, units)
                    && let Some(layout) = u8::try_from(of).ok().and_then(|of| self.layouts.get_mut(&of))
                {
                    layout.units = units.to_vec();
                }
                return ControlFlow::Continue(());
            }
            "UNIT" => {
                let (id, label) = (layout.cell("Id", message), layout.cell("Label", message));
                if let (Cell::Integer(id), Cell::Text(label)) = (id, label) {
                    let label = String::from_utf8_lossy(label).into_owned();
                    self.units.extend(u8::try_from(id).ok().map(|id| (id, label)));
                }
                return ControlFlow::Continue(());
            }
            "PARM" => {
                if let (Cell::Text(name), Cell::Number(value)) =
                    (layout.cell("Name", message), layout.cell("Value", message))
                {
                    self.visitor.parameter(&String::from_utf8_lossy(name), value);
                }
            }
            "MSG" => {
                if let Cell::Text(words) = layout.cell("Message", message) {
                    let words = String::from_utf8_lossy(words);
                    // The first ones name firmware and board.
                    if ["ArduCopter", "ArduPlane", "ArduRover", "Rover", "ArduSub", "Blimp"]
                        .iter()
                        .any(|name| words.starts_with(name))
                    {
                        self.visitor.about("firmware", &words);
                    }
                }
            }
            // The logger's own account: how many messages found no room.
            "DSF" => {
                if let Cell::Integer(dropped) = layout.cell("Dp", message) {
                    self.losses.dropouts = self.losses.dropouts.max(u64::try_from(dropped).unwrap_or(0));
                }
            }
            _ => {}
        }
        self.sample(kind, message)
    }

    fn sample(&mut self, kind: u8, message: &[u8]) -> ControlFlow<()> {
        let layout = &self.layouts[&kind];
        let instance = layout.instance(message);
        let topics = self.streams.len();
        let stream = match self.streams.entry((kind, instance)) {
            std::collections::hash_map::Entry::Occupied(entry) => entry.into_mut(),
            std::collections::hash_map::Entry::Vacant(entry) => {
                let name = match instance {
                    0 => layout.name.clone(),
                    instance => format!("{}[{instance}]", layout.name),
                };
                let unit = |place: usize| {
                    let id = layout.units.get(place).filter(|id| !b"-?#".contains(id))?;
                    self.units.get(id).cloned()
                };
                let fields = layout.labels.iter().enumerate();
                let fields =
                    fields.map(|(place, label)| Field { name: label.clone(), unit: unit(place) }).collect();
                let wanted = self.visitor.topic(&Topic { name, kind: layout.name.clone(), fields });
                entry.insert(Stream { topic: topics, wanted, samples: 0 })
            }
        };
        stream.samples += 1;
        let Some(wanted) = &stream.wanted else { return ControlFlow::Continue(()) };
        let cells: Vec<Cell<'_>> = wanted
            .iter()
            .map(|place| match layout.fields.get(*place) {
                Some((letter, at)) => letter.read(message.get(*at..).unwrap_or_default()),
                None => Cell::Absent,
            })
            .collect();
        self.visitor.sample(Sample {
            topic: stream.topic,
            time_ns: layout.time_ns(message),
            cells: &cells,
            line: stream.samples,
        })
    }

    /// Takes what a FMT says, unless it contradicts itself.
    fn learn_layout(&mut self, message: &[u8]) {
        let [_, _, _, kind, length, rest @ ..] = message else { return };
        let words = |from: usize, to: usize| {
            rest.get(from..to).map_or(Cow::Borrowed(""), |bytes| String::from_utf8_lossy(text(bytes)))
        };
        let (name, format, labels) = (words(0, 4), words(4, 20), words(20, 84));
        let mut at = HEAD;
        let mut fields = Vec::new();
        for letter in format.bytes() {
            let Some(letter) = Letter::of(letter) else {
                self.losses.damaged += 1;
                return;
            };
            fields.push((letter, at));
            at += letter.size();
        }
        let labels: Vec<String> =
            labels.split(',').filter(|label| !label.is_empty()).map(str::to_owned).collect();
        if *kind == FMT || at != usize::from(*length) || labels.len() != fields.len() || name.is_empty() {
            // That of itself is known, and some firmwares tell it differently.
            self.losses.damaged += u64::from(*kind != FMT);
            return;
        }
        let layout = Layout { name: name.into_owned(), length: at, labels, fields, units: Vec::new() };
        self.layouts.insert(*kind, layout);
    }
}

fn fmt_of_fmt() -> Layout {
    Layout {
        name: "FMT".to_owned(),
        length: FMT_LENGTH,
        labels: Vec::new(),
        fields: Vec::new(),
        units: Vec::new(),
    }
}
