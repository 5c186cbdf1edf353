//! Blackbox logs of Betaflight and INAV: a head of texts that says which fields frames have, how each is packed and what it is
//! predicted by; then frames, most of them differences to the ones before. After a damaged frame all are lost to the next whole one,
//! which comes some times a second.
//!
//! Numbers are handed over as the firmware packed them: what they mean depends on its version.

use std::{collections::HashMap, ops::ControlFlow, path::Path};

use crate::{
    Cell, Field, LogError, Losses, Sample, Topic, Visitor,
    bytes::{Window, unread},
};

/// The first line of each log of a file.
pub(crate) const MARKER: &[u8] = b"H Product:Blackbox flight data recorder by Nicholas Sherlock\n";
/// No head and no frame is longer.
const LONGEST: usize = 1 << 16;
/// Main frames further apart than this are not of one stretch, us.
const LONGEST_GAP_US: i64 = 10_000_000;
const END: &[u8] = b"End of log\0";
const FORMAT: &str = "a Betaflight log (blackbox)";

/// Why a frame is not read.
enum Fault {
    /// The bytes end within it.
    Cut,
    /// It cannot be one.
    Damaged,
}

/// Bytes of a frame, read from the front.
struct Bytes<'a> {
    all: &'a [u8],
    at: usize,
}

impl Bytes<'_> {
    fn byte(&mut self) -> Result<u8, Fault> {
        let byte = *self.all.get(self.at).ok_or(Fault::Cut)?;
        self.at += 1;
        Ok(byte)
    }

    /// Seven bits a byte, the lowest first.
    fn unsigned(&mut self) -> Result<i64, Fault> {
        let mut value = 0;
        for place in 0..5 {
            let byte = self.byte()?;
            value |= i64::from(byte & 0x7f) << (7 * place);
            if byte & 0x80 == 0 {
                return Ok(value & 0xffff_ffff);
            }
        }
        Err(Fault::Damaged)
    }

    /// The sign in the lowest bit.
    fn signed(&mut self) -> Result<i64, Fault> {
        let folded = self.unsigned()?;
        Ok((folded >> 1) ^ -(folded & 1))
    }

    /// A number of some bytes, the lowest first.
    fn little(&mut self, bytes: u32) -> Result<i64, Fault> {
        let mut value = 0;
        for place in 0..bytes {
            value |= i64::from(self.byte()?) << (8 * place);
        }
        Ok(extended(value, 8 * bytes))
    }
}

/// A number of so many bits, the highest of which is its sign.
fn extended(value: i64, bits: u32) -> i64 {
    (value << (64 - bits)) >> (64 - bits)
}

/// How fields are packed, by their numbers in the head.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Encoding {
    Signed,
    Unsigned,
    Negative14,
    Tag8Of8,
    Tag2Of3,
    Tag8Of4,
    Null,
    Tag2Of3Variable,
}

impl Encoding {
    fn of(number: i64) -> Option<Self> {
        Some(match number {
            0 => Self::Signed,
            1 => Self::Unsigned,
            3 => Self::Negative14,
            6 => Self::Tag8Of8,
            7 => Self::Tag2Of3,
            8 => Self::Tag8Of4,
            9 => Self::Null,
            10 => Self::Tag2Of3Variable,
            _ => return None,
        })
    }

    /// How many fields in a row share a tag.
    const fn shared(self) -> usize {
        match self {
            Self::Tag8Of8 => 8,
            Self::Tag8Of4 => 4,
            Self::Tag2Of3 | Self::Tag2Of3Variable => 3,
            _ => 1,
        }
    }

    /// Adds the packed numbers of `fields` fields that follow one another.
    fn read(self, bytes: &mut Bytes<'_>, fields: usize, into: &mut Vec<i64>) -> Result<(), Fault> {
        let begins = into.len();
        match self {
            Self::Signed => into.push(bytes.signed()?),
            Self::Unsigned => into.push(bytes.unsigned()?),
            Self::Negative14 => into.push(-extended(bytes.unsigned()?, 14)),
            Self::Null => into.push(0),
            Self::Tag8Of8 if fields == 1 => into.push(bytes.signed()?),
            Self::Tag8Of8 => {
                let tag = bytes.byte()?;
                for place in 0..fields {
                    into.push(if tag >> place & 1 == 1 { bytes.signed()? } else { 0 });
                }
            }
            Self::Tag8Of4 => tag8_of_4(bytes, into)?,
            Self::Tag2Of3 => tag2_of_3(bytes, into, [[2, 2, 2], [4, 4, 4], [6, 6, 6]])?,
            Self::Tag2Of3Variable => tag2_of_3(bytes, into, [[2, 2, 2], [5, 5, 4], [8, 7, 7]])?,
        }
        // Whoever wrote fewer fields filled up with zeros.
        into.truncate(begins + fields);
        Ok(())
    }
}

/// Four numbers of 0, 4, 8 or 16 bits, by two bits each of a tag; halves of bytes are filled.
fn tag8_of_4(bytes: &mut Bytes<'_>, into: &mut Vec<i64>) -> Result<(), Fault> {
    let tag = bytes.byte()?;
    // The low half of a byte that was read, where it is not used yet.
    let mut half: Option<u8> = None;
    for place in 0..4 {
        let bits = [0, 4, 8, 16][usize::from(tag >> (2 * place) & 3)];
        let mut value = 0;
        for _ in 0..bits / 4 {
            let next = if let Some(low) = half.take() {
                low
            } else {
                let byte = bytes.byte()?;
                half = Some(byte & 0xf);
                byte >> 4
            };
            value = value << 4 | i64::from(next);
        }
        into.push(if bits == 0 { 0 } else { extended(value, bits) });
    }
    Ok(())
}

/// Three numbers: by the two highest bits of the first of widths `packed`, the highest bits first, or of one to four bytes each.
fn tag2_of_3(bytes: &mut Bytes<'_>, into: &mut Vec<i64>, packed: [[u32; 3]; 3]) -> Result<(), Fault> {
    let first = bytes.byte()?;
    let Some(widths) = packed.get(usize::from(first >> 6)) else {
        for place in 0..3 {
            into.push(bytes.little(u32::from(first >> (2 * place) & 3) + 1)?);
        }
        return Ok(());
    };
    let bits: u32 = widths.iter().sum();
    // With the two of the tag they fill whole bytes; the wide ones begin each number in a byte of its own.
    let mut all = i64::from(first & 0x3f);
    let mut held = 6;
    if widths == &[6, 6, 6] {
        into.push(extended(all, 6));
        for _ in 1..3 {
            into.push(extended(i64::from(bytes.byte()?), 6));
        }
        return Ok(());
    }
    while held < bits {
        all = all << 8 | i64::from(bytes.byte()?);
        held += 8;
    }
    // Where less than whole bytes are needed, the first ones after the tag are empty.
    let mut left = bits;
    for width in widths {
        left -= width;
        into.push(extended(all >> left, *width));
    }
    Ok(())
}

/// What a field is predicted by, by its number in the head.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Predictor {
    /// A number that stands in the head, or zero.
    Constant(i64),
    Previous,
    StraightLine,
    Average,
    /// The first motor of the same frame.
    Motor,
    Increment,
    /// A coordinate of the place where the aircraft was armed.
    Home(usize),
    MainTime,
}

/// One kind of frame.
#[derive(Clone, Debug, Default)]
struct Layout {
    names: Vec<String>,
    signed: Vec<bool>,
    encodings: Vec<Encoding>,
    predictors: Vec<Predictor>,
}

impl Layout {
    fn place(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|known| known == name)
    }

    /// Reads a frame behind its letter.
    fn read(&self, bytes: &mut Bytes<'_>, known: &Known<'_>) -> Result<Vec<i64>, Fault> {
        let mut packed = Vec::with_capacity(self.names.len());
        while let Some(encoding) = self.encodings.get(packed.len()) {
            let alike = self.encodings[packed.len()..].iter().take(encoding.shared());
            let fields = alike.take_while(|other| *other == encoding).count();
            encoding.read(bytes, fields, &mut packed)?;
        }
        let mut values: Vec<i64> = Vec::with_capacity(packed.len());
        for (place, (packed, predictor)) in packed.into_iter().zip(&self.predictors).enumerate() {
            let of = |frame: Option<&Vec<i64>>| frame.map(|frame| frame[place]);
            let [last, before] = [of(known.last), of(known.before)];
            let predicted = match predictor {
                Predictor::Constant(number) => *number,
                Predictor::Previous => last.unwrap_or(0),
                Predictor::StraightLine => last.map_or(0, |last| 2 * last - before.unwrap_or(last)),
                Predictor::Average => last.map_or(0, |last| i64::midpoint(last, before.unwrap_or(last))),
                Predictor::Motor => {
                    self.place("motor[0]").and_then(|first| values.get(first)).copied().unwrap_or(0)
                }
                Predictor::Increment => last.unwrap_or(0) + 1 + known.left_out,
                Predictor::Home(axis) => known.home[*axis],
                Predictor::MainTime => known.time,
            };
            let value = packed + predicted;
            // Numbers are of 32 bits there, and run over.
            values.push(if self.signed[place] { i64::from(value as i32) } else { i64::from(value as u32) });
        }
        Ok(values)
    }
}

/// What predictions go by.
struct Known<'a> {
    last: Option<&'a Vec<i64>>,
    before: Option<&'a Vec<i64>>,
    /// Frames between the last one and this that were never to be written.
    left_out: i64,
    home: [i64; 2],
    time: i64,
}

/// The layouts of a log's frames, as its head tells them.
struct Head {
    whole: Layout,
    difference: Layout,
    slow: Option<Layout>,
    gps: Option<Layout>,
    home: Option<Layout>,
    /// Of so many iterations, the first is a whole frame ...
    whole_every: i64,
    /// ... and of so many, this many are written.
    written: i64,
    of: i64,
}

/// The lines of a head as keys and values, and how long it is.
fn lines(bytes: &[u8]) -> (Vec<(&str, &str)>, usize) {
    let mut length = MARKER.len();
    let mut found = Vec::new();
    while let Some(rest) = bytes.get(length..).filter(|rest| rest.starts_with(b"H ")) {
        let Some(end) = rest.iter().position(|byte| *byte == b'\n') else { break };
        let Some(line) = str::from_utf8(&rest[2..end]).ok().and_then(|line| line.split_once(':')) else {
            break;
        };
        found.push(line);
        length += end + 1;
    }
    (found, length)
}

fn numbers(text: &str) -> impl Iterator<Item = Option<i64>> {
    text.split(',').map(|number| number.trim().parse().ok())
}

impl Head {
    /// What is wrong is told in words.
    fn of(lines: &[(&str, &str)]) -> Result<Self, String> {
        let keys: HashMap<&str, &str> = lines.iter().copied().collect();
        let number = |key: &str| keys.get(key).and_then(|value| numbers(value).next().flatten());
        let layout = |letter: char, names: char| -> Result<Option<Layout>, String> {
            let key = |letter: char, of: &str| format!("Field {letter} {of}");
            let Some(named) = keys.get(key(names, "name").as_str()) else { return Ok(None) };
            let text = |letter: char, of: &str| {
                let key = key(letter, of);
                keys.get(key.as_str()).ok_or_else(|| format!("its head has no line {key}"))
            };
            let names_of: Vec<String> = named.split(',').map(str::to_owned).collect();
            let signed: Vec<bool> = match keys.get(key(names, "signed").as_str()) {
                Some(text) => text.split(',').map(|text| text.trim() != "0").collect(),
                None => vec![false; names_of.len()],
            };
            let unknown =
                |what: &str| format!("its head packs {letter} frames by a {what} that is not known");
            let encodings: Option<Vec<Encoding>> =
                numbers(text(letter, "encoding")?).map(|number| Encoding::of(number?)).collect();
            let mut homes = 0;
            let predictors: Option<Vec<Predictor>> = numbers(text(letter, "predictor")?)
                .map(|of| {
                    Some(match of? {
                        0 => Predictor::Constant(0),
                        1 => Predictor::Previous,
                        2 => Predictor::StraightLine,
                        3 => Predictor::Average,
                        4 => Predictor::Constant(number("minthrottle").unwrap_or(0)),
                        5 => Predictor::Motor,
                        6 => Predictor::Increment,
                        7 => {
                            homes += 1;
                            Predictor::Home(usize::from(homes % 2 == 0))
                        }
                        8 => Predictor::Constant(1500),
                        9 => Predictor::Constant(number("vbatref").unwrap_or(0)),
                        10 => Predictor::MainTime,
                        11 => Predictor::Constant(number("motorOutput").unwrap_or(0)),
                        _ => return None,
                    })
                })
                .collect();
            let layout = Layout {
                signed,
                encodings: encodings.ok_or_else(|| unknown("encoding"))?,
                predictors: predictors.ok_or_else(|| unknown("predictor"))?,
                names: names_of,
            };
            let fields = layout.names.len();
            if [layout.signed.len(), layout.encodings.len(), layout.predictors.len()] != [fields; 3] {
                return Err(format!("the lines of its head for {letter} frames differ in length"));
            }
            Ok(Some(layout))
        };
        let whole = layout('I', 'I')?.filter(|layout| layout.place("time").is_some());
        let whole = whole.ok_or("its head names no fields of main frames with a time")?;
        let difference = layout('P', 'I')?.ok_or("its head names no fields of main frames")?;
        let (written, of) = match keys.get("P interval").and_then(|text| text.split_once('/')) {
            Some((written, of)) => (written.trim().parse().unwrap_or(1), of.trim().parse().unwrap_or(1)),
            None => (1, number("P interval").unwrap_or(1)),
        };
        Ok(Self {
            whole,
            difference,
            slow: layout('S', 'S')?,
            gps: layout('G', 'G')?,
            home: layout('H', 'H')?,
            whole_every: number("I interval").unwrap_or(1).max(1),
            written: i64::max(written, 1),
            of: i64::max(of, 1),
        })
    }

    /// How many iterations after one are not written.
    fn left_out(&self, iteration: i64) -> i64 {
        let is_written =
            |iteration: i64| (iteration % self.whole_every + self.written - 1) % self.of < self.written;
        (0..self.of).find(|more| is_written(iteration + 1 + more)).unwrap_or(self.of)
    }
}

/// A topic as the visitor wants it.
struct Stream {
    topic: usize,
    wanted: Option<Vec<usize>>,
    samples: u64,
}

/// One log of the file, as far as it was read.
struct Log {
    head: Head,
    main: Stream,
    slow: Option<Stream>,
    gps: Option<Stream>,
    last: Option<Vec<i64>>,
    before: Option<Vec<i64>>,
    home: [i64; 2],
    /// Time of the last main frame, us; it does not run over.
    time_us: Option<i64>,
    /// Time of a whole frame that was too far away to be believed.
    doubted_us: Option<i64>,
    /// Slow frames come before the first one with a time.
    waiting: Option<Vec<i64>>,
    /// Frames are lost until the next whole one.
    is_lost: bool,
    resumes: bool,
}

enum Found {
    /// A frame of this length, or bytes that were passed over.
    Frame(usize),
    End(usize),
    Cut,
    Nothing,
}

pub(crate) fn scan(path: &Path, visitor: &mut dyn Visitor) -> Result<Losses, LogError> {
    let mut window = Window::open(path)?;
    let mut losses = Losses::default();
    let mut log: Option<Log> = None;
    let (mut logs, mut topics) = (0, 0);
    loop {
        let ahead = window.ahead(LONGEST).map_err(|source| unread(path, source))?;
        if ahead.starts_with(MARKER) {
            // The one before has no end.
            losses.cut |= log.is_some();
            let (lines, length) = lines(ahead);
            let head = Head::of(&lines).map_err(|detail| LogError::Malformed {
                path: path.to_owned(),
                format: FORMAT,
                detail,
                source: None,
            });
            match head {
                Ok(head) => {
                    if logs == 0 {
                        for (key, value) in &lines {
                            match value.trim().parse() {
                                Ok(number) => visitor.parameter(key, number),
                                Err(_) => visitor.about(key, value),
                            }
                        }
                    }
                    log = Some(Log::begin(head, logs, &mut topics, visitor));
                    logs += 1;
                }
                Err(error) if logs == 0 => return Err(error),
                Err(_) => {
                    losses.damaged += 1;
                    log = None;
                }
            }
            window.pass(length);
            continue;
        }
        if ahead.is_empty() {
            losses.cut |= log.is_some();
            return Ok(losses);
        }
        let Some(open) = &mut log else {
            // Between two logs is what the memory held before.
            let next = ahead.windows(MARKER.len()).position(|bytes| bytes == MARKER);
            let length = next.unwrap_or_else(|| (ahead.len() + 1).saturating_sub(MARKER.len()).max(1));
            window.pass(length);
            continue;
        };
        let mut enough = ControlFlow::Continue(());
        match open.frame(ahead, visitor, &mut losses, &mut enough) {
            Found::Frame(length) => window.pass(length),
            Found::End(length) => {
                log = None;
                window.pass(length);
            }
            Found::Cut => {
                losses.cut = true;
                losses.skipped_bytes += ahead.len() as u64;
                return Ok(losses);
            }
            Found::Nothing => {
                losses.damaged += u64::from(!open.is_lost);
                losses.skipped_bytes += 1;
                open.is_lost = true;
                (open.last, open.before) = (None, None);
                window.pass(1);
            }
        }
        if enough.is_break() {
            return Ok(losses);
        }
    }
}

impl Log {
    fn begin(head: Head, number: usize, topics: &mut usize, visitor: &mut dyn Visitor) -> Self {
        let mut stream = |kind: &str, layout: &Layout| {
            let name = if number == 0 { kind.to_owned() } else { format!("{kind}[{number}]") };
            let fields = layout.names.iter().map(Field::new).collect();
            let wanted = visitor.topic(&Topic { name, kind: kind.to_owned(), fields });
            *topics += 1;
            Stream { topic: *topics - 1, wanted, samples: 0 }
        };
        let main = stream("main", &head.whole);
        let slow = head.slow.as_ref().map(|layout| stream("slow", layout));
        let gps = head.gps.as_ref().map(|layout| stream("gps", layout));
        Self {
            head,
            main,
            slow,
            gps,
            last: None,
            before: None,
            home: [0; 2],
            time_us: None,
            doubted_us: None,
            waiting: None,
            is_lost: false,
            resumes: false,
        }
    }

    /// The frame at the beginning of the bytes.
    fn frame(
        &mut self,
        ahead: &[u8],
        visitor: &mut dyn Visitor,
        losses: &mut Losses,
        enough: &mut ControlFlow<()>,
    ) -> Found {
        let letter = ahead[0];
        let mut bytes = Bytes { all: ahead, at: 1 };
        // Slow frames and those of the receiver are never differences.
        let is_main = b"IP".contains(&letter);
        let known = Known {
            last: self.last.as_ref().filter(|_| is_main),
            before: self.before.as_ref().filter(|_| is_main),
            left_out: self.last.as_ref().map_or(0, |last| self.head.left_out(self.iteration(last))),
            home: self.home,
            time: self.last_time(),
        };
        let layout = match letter {
            b'I' => Some(&self.head.whole),
            b'P' if self.last.is_some() => Some(&self.head.difference),
            b'S' if !self.is_lost => self.head.slow.as_ref(),
            b'G' if !self.is_lost => self.head.gps.as_ref(),
            b'H' if !self.is_lost => self.head.home.as_ref(),
            b'E' if !self.is_lost => None,
            _ => return Found::Nothing,
        };
        let read = match layout {
            Some(layout) => layout.read(&mut bytes, &known),
            None if letter == b'E' => event(&mut bytes).map(|event| vec![event]),
            None => return Found::Nothing,
        };
        let values = match read {
            Ok(values) => values,
            Err(Fault::Cut) if ahead.len() < LONGEST => return Found::Cut,
            Err(_) => return Found::Nothing,
        };
        if letter == b'E' && values == [EVENT_END] {
            return Found::End(bytes.at);
        }
        // A frame is whole where the next one follows, or the end.
        if ahead.get(bytes.at).is_some_and(|next| !b"IPSGHE".contains(next)) {
            return Found::Nothing;
        }
        match letter {
            b'I' | b'P' => {
                let Some(time_us) = self.believed(&values, letter == b'I') else { return Found::Nothing };
                let is_first = self.time_us.is_none();
                self.time_us = Some(time_us);
                (self.is_lost, self.resumes, self.doubted_us) = (false, false, None);
                *enough = self.main.hand(&values, time_us, visitor);
                if is_first && let (Some(slow), Some(waiting)) = (&mut self.slow, self.waiting.take()) {
                    *enough = slow.hand(&waiting, time_us, visitor);
                }
                // What follows a whole frame is predicted by it alone.
                self.before = if letter == b'I' { Some(values.clone()) } else { self.last.take() };
                self.last = Some(values);
            }
            b'S' => match (self.time_us, &mut self.slow) {
                (Some(time_us), Some(slow)) => *enough = slow.hand(&values, time_us, visitor),
                _ => self.waiting = Some(values),
            },
            b'G' => {
                let own =
                    self.head.gps.as_ref().and_then(|layout| layout.place("time")).map(|place| values[place]);
                let time_us = self.time_us.map(|last| own.map_or(last, |own| unrolled(own, last)));
                if let (Some(time_us), Some(gps)) = (time_us, &mut self.gps) {
                    *enough = gps.hand(&values, time_us, visitor);
                }
            }
            b'H' => {
                if let [latitude, longitude, ..] = values[..] {
                    self.home = [latitude, longitude];
                }
            }
            _ if values == [EVENT_RESUME] => {
                self.resumes = true;
                losses.dropouts += 1;
            }
            _ => {}
        }
        Found::Frame(bytes.at)
    }

    fn iteration(&self, frame: &[i64]) -> i64 {
        self.head.whole.place("loopIteration").map_or(0, |place| frame[place])
    }

    fn time_of(&self, frame: &[i64]) -> i64 {
        self.head.whole.place("time").map_or(0, |place| frame[place])
    }

    fn last_time(&self) -> i64 {
        self.last.as_ref().map_or_else(|| self.time_us.unwrap_or(0), |last| self.time_of(last))
    }

    /// The time of a main frame, us, where it fits to what was read before. A whole frame that does not is believed when the next
    /// whole one confirms it.
    fn believed(&mut self, values: &[i64], is_whole: bool) -> Option<i64> {
        let time = self.time_of(values);
        let Some(last) = self.time_us.filter(|_| !self.resumes) else {
            return Some(self.time_us.map_or(time, |last| unrolled(time, last)));
        };
        let fits = |last: i64| (0..=LONGEST_GAP_US).contains(&(unrolled(time, last) - last));
        let is_confirmed = self.doubted_us.is_some_and(fits);
        self.doubted_us = Some(time).filter(|_| is_whole);
        (fits(last) || is_whole && is_confirmed).then(|| unrolled(time, last))
    }
}

/// A time of 32 bits as one that does not run over, near another.
fn unrolled(time: i64, near: i64) -> i64 {
    near + i64::from((time - near) as i32)
}

impl Stream {
    fn hand(&mut self, values: &[i64], time_us: i64, visitor: &mut dyn Visitor) -> ControlFlow<()> {
        self.samples += 1;
        let Some(wanted) = &self.wanted else { return ControlFlow::Continue(()) };
        let cells: Vec<Cell<'_>> = wanted
            .iter()
            .map(|place| values.get(*place).map_or(Cell::Absent, |value| Cell::Integer((*value).into())))
            .collect();
        visitor.sample(Sample {
            topic: self.topic,
            time_ns: Some(i128::from(time_us) * 1000),
            cells: &cells,
            line: self.samples,
        })
    }
}

const EVENT_RESUME: i64 = 14;
const EVENT_END: i64 = 255;

/// Which event it is, past what it says.
fn event(bytes: &mut Bytes<'_>) -> Result<i64, Fault> {
    let event = bytes.byte()?.into();
    match event {
        // Beep to synchronise; failure of the sensors; why it was disarmed.
        0 | 15 | 40 => drop(bytes.unsigned()?),
        // A number changed in flight: whole, or a float.
        13 => match bytes.byte()? {
            0..128 => drop(bytes.signed()?),
            _ => drop(bytes.little(4)?),
        },
        // Flight modes; logging goes on.
        EVENT_RESUME | 30 => {
            bytes.unsigned()?;
            bytes.unsigned()?;
        }
        EVENT_END => {
            for expected in END {
                if bytes.byte()? != *expected {
                    return Err(Fault::Damaged);
                }
            }
        }
        _ => return Err(Fault::Damaged),
    }
    Ok(event)
}
