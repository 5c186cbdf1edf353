//! Messages of ROS 2: their definitions as bags carry them (`ros2msg`), and their bytes (CDR, the plain encoding of XCDR1).
//!
//! Definitions: <https://docs.ros.org/en/rolling/Concepts/Basic/About-Interfaces.html>. Encoding: OMG, DDS-XTypes 1.3, 7.4.1.

use std::collections::HashMap;

use crate::{Cell, Field, bytes::Scalar};

/// Of a list whose length a message tells, as many elements are fields.
const LISTED: usize = 8;
/// Arrays of fixed length up to this are fields, element by element; longer ones are passed over.
const LONGEST_ARRAY: usize = 64;
/// Deeper than any message in use.
const DEEPEST: usize = 12;

#[derive(Clone, Debug, PartialEq)]
enum Kind {
    Scalar(Scalar),
    Text,
    /// Seconds and nanoseconds, which become one number of nanoseconds.
    Time,
    Message(usize),
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Arity {
    One,
    Array(usize),
    List,
}

#[derive(Clone, Debug)]
struct Member {
    name: String,
    kind: Kind,
    arity: Arity,
}

/// How messages of one type are laid out.
#[derive(Debug)]
pub(crate) struct Definition {
    /// The members of each message type that is named; the first is the one that is defined.
    messages: Vec<Vec<Member>>,
}

impl Definition {
    /// Reads what a bag says of a type.
    pub fn parse(kind: &str, text: &str) -> Result<Self, String> {
        let mut bodies: Vec<(String, Vec<&str>)> = vec![(short(kind), Vec::new())];
        let mut heading = false;
        for line in text.lines() {
            let line = line.trim();
            if line.starts_with("=====") {
                heading = true;
            } else if let Some(name) = line.strip_prefix("MSG:").filter(|_| heading) {
                bodies.push((short(name.trim()), Vec::new()));
                heading = false;
            } else if let Some((_, body)) = bodies.last_mut() {
                body.push(line);
            }
        }
        let places: HashMap<String, usize> =
            bodies.iter().enumerate().map(|(place, (name, _))| (name.clone(), place)).collect();
        let messages = bodies
            .iter()
            .map(|(name, body)| {
                let package = name.split('/').next().unwrap_or_default();
                body.iter().filter_map(|line| member(line, package, &places).transpose()).collect()
            })
            .collect::<Result<_, String>>()?;
        let definition = Self { messages };
        if definition.depth(0, 0) > DEEPEST {
            return Err(format!("{kind} contains itself, or is nested deeper than {DEEPEST} messages"));
        }
        Ok(definition)
    }

    fn depth(&self, message: usize, above: usize) -> usize {
        if above > DEEPEST {
            return above;
        }
        let inner = self.messages[message].iter().filter_map(|member| match member.kind {
            Kind::Message(inner) => Some(self.depth(inner, above + 1)),
            _ => None,
        });
        inner.max().unwrap_or(above)
    }

    /// The fields of a message, in the order in which [`Definition::read`] gives their cells.
    pub fn fields(&self) -> Vec<Field> {
        let mut fields = Vec::new();
        self.list(0, "", &mut fields);
        fields
    }

    fn list(&self, message: usize, before: &str, fields: &mut Vec<Field>) {
        for member in &self.messages[message] {
            let name = format!("{before}{}", member.name);
            let names: Vec<String> = match member.arity {
                Arity::One => vec![name],
                Arity::Array(length) if length > LONGEST_ARRAY => Vec::new(),
                Arity::Array(length) => (0..length).map(|place| format!("{name}[{place}]")).collect(),
                Arity::List => (0..LISTED).map(|place| format!("{name}[{place}]")).collect(),
            };
            for name in names {
                match member.kind {
                    Kind::Message(inner) => self.list(inner, &format!("{name}."), fields),
                    Kind::Time => fields.push(Field { name, unit: Some("ns".to_owned()) }),
                    _ => fields.push(Field::new(name)),
                }
            }
        }
    }

    /// Reads a message; `None` where it ends too early or its encoding is another.
    pub fn read<'a>(&self, bytes: &'a [u8], cells: &mut Vec<Cell<'a>>) -> Option<()> {
        cells.clear();
        let (head, body) = bytes.split_at_checked(4)?;
        if head[0] != 0 || head[1] > 1 {
            return None;
        }
        let mut cursor = Cursor { body, at: 0, big_endian: head[1] == 0 };
        self.read_message(0, &mut cursor, Some(cells))
    }

    fn read_message<'a>(
        &self,
        message: usize,
        cursor: &mut Cursor<'a>,
        mut cells: Option<&mut Vec<Cell<'a>>>,
    ) -> Option<()> {
        for member in &self.messages[message] {
            let (count, listed) = match member.arity {
                Arity::One => (1, 1),
                Arity::Array(length) => (length, if length > LONGEST_ARRAY { 0 } else { length }),
                Arity::List => (cursor.count()?, LISTED),
            };
            if let Kind::Scalar(scalar) = member.kind
                && count > listed
                && listed == 0
            {
                cursor.skip(scalar, count)?;
                continue;
            }
            for place in 0..count {
                if place >= listed {
                    if let Kind::Scalar(scalar) = member.kind {
                        cursor.skip(scalar, count - place)?;
                        break;
                    }
                    self.read_one(member, cursor, None)?;
                } else {
                    self.read_one(member, cursor, cells.as_deref_mut())?;
                }
            }
            if let Some(cells) = cells.as_deref_mut() {
                let width = match member.kind {
                    Kind::Message(inner) => self.width(inner),
                    _ => 1,
                };
                let absent = listed.saturating_sub(count) * width;
                cells.resize(cells.len() + absent, Cell::Absent);
            }
        }
        Some(())
    }

    fn read_one<'a>(
        &self,
        member: &Member,
        cursor: &mut Cursor<'a>,
        cells: Option<&mut Vec<Cell<'a>>>,
    ) -> Option<()> {
        let cell = match member.kind {
            Kind::Message(inner) => return self.read_message(inner, cursor, cells),
            Kind::Scalar(scalar) => cursor.scalar(scalar)?,
            Kind::Text => Cell::Text(cursor.text()?),
            Kind::Time => {
                let (Cell::Integer(seconds), Cell::Integer(nanos)) =
                    (cursor.scalar(Scalar::I32)?, cursor.scalar(Scalar::U32)?)
                else {
                    return None;
                };
                Cell::Integer(seconds * 1_000_000_000 + nanos)
            }
        };
        if let Some(cells) = cells {
            cells.push(cell);
        }
        Some(())
    }

    /// How many fields a message has.
    fn width(&self, message: usize) -> usize {
        let mut fields = Vec::new();
        self.list(message, "", &mut fields);
        fields.len()
    }
}

/// `package/msg/Type` and `package/Type` are one.
fn short(name: &str) -> String {
    name.replace("/msg/", "/")
}

/// A member of a message; `None` for constants, comments and empty lines.
fn member(line: &str, package: &str, places: &HashMap<String, usize>) -> Result<Option<Member>, String> {
    let line = line.split('#').next().unwrap_or_default().trim();
    let mut words = line.split_whitespace();
    let (Some(kind), Some(name)) = (words.next(), words.next()) else { return Ok(None) };
    if name.contains('=') || words.next().is_some_and(|word| word.starts_with('=')) {
        return Ok(None);
    }
    let (kind, arity) = match kind.split_once('[') {
        None => (kind, Arity::One),
        Some((kind, length)) => match length.trim_end_matches(']').parse() {
            Ok(length) => (kind, Arity::Array(length)),
            Err(_) => (kind, Arity::List),
        },
    };
    let kind = match kind.split_once("<=").map_or(kind, |(kind, _)| kind) {
        "bool" => Kind::Scalar(Scalar::Bool),
        "int8" => Kind::Scalar(Scalar::I8),
        "uint8" | "byte" | "char" => Kind::Scalar(Scalar::U8),
        "int16" => Kind::Scalar(Scalar::I16),
        "uint16" => Kind::Scalar(Scalar::U16),
        "int32" => Kind::Scalar(Scalar::I32),
        "uint32" => Kind::Scalar(Scalar::U32),
        "int64" => Kind::Scalar(Scalar::I64),
        "uint64" => Kind::Scalar(Scalar::U64),
        "float32" => Kind::Scalar(Scalar::F32),
        "float64" => Kind::Scalar(Scalar::F64),
        "string" => Kind::Text,
        "time"
        | "duration"
        | "builtin_interfaces/Time"
        | "builtin_interfaces/msg/Time"
        | "builtin_interfaces/Duration"
        | "builtin_interfaces/msg/Duration" => Kind::Time,
        other => {
            let other = match short(other) {
                header if header == "Header" => "std_msgs/Header".to_owned(),
                other if other.contains('/') => other,
                other => format!("{package}/{other}"),
            };
            let place = places.get(&other).ok_or_else(|| format!("it does not define {other}"))?;
            Kind::Message(*place)
        }
    };
    Ok(Some(Member { name: name.to_owned(), kind, arity }))
}

/// Where a message is being read. Numbers stand at multiples of their size, counted from behind the head.
struct Cursor<'a> {
    body: &'a [u8],
    at: usize,
    big_endian: bool,
}

impl<'a> Cursor<'a> {
    fn take(&mut self, size: usize, alignment: usize) -> Option<&'a [u8]> {
        let start = self.at.checked_next_multiple_of(alignment)?;
        let end = start.checked_add(size)?;
        let bytes = self.body.get(start..end)?;
        self.at = end;
        Some(bytes)
    }

    fn scalar(&mut self, scalar: Scalar) -> Option<Cell<'static>> {
        let size = scalar.size();
        Some(scalar.read(self.take(size, size)?, self.big_endian))
    }

    fn skip(&mut self, scalar: Scalar, count: usize) -> Option<()> {
        if count > 0 {
            self.take(scalar.size().checked_mul(count)?, scalar.size())?;
        }
        Some(())
    }

    fn count(&mut self) -> Option<usize> {
        match self.scalar(Scalar::U32)? {
            // No list is longer than what is left, whatever damage says.
            Cell::Integer(count) => usize::try_from(count).ok().filter(|count| *count <= self.body.len()),
            _ => None,
        }
    }

    /// A length that counts the zero byte at the end.
    fn text(&mut self) -> Option<&'a [u8]> {
        let length = self.count()?;
        let bytes = self.take(length, 1)?;
        Some(bytes.strip_suffix(&[0]).unwrap_or(bytes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STAMPED: &str = "std_msgs/Header header\nint8 FIXED = 3\nfloat64[3] p # metres\nfloat32[] speeds\nstring name\n\
        ================================================================================\nMSG: std_msgs/Header\n\
        builtin_interfaces/Time stamp\nstring frame_id\n";

    #[test]
    fn members_are_read_at_their_alignment_and_lists_in_part() {
        let definition = Definition::parse("x_msgs/msg/Stamped", STAMPED).unwrap();
        let names: Vec<String> = definition.fields().into_iter().map(|field| field.name).collect();
        assert_eq!(names[..5], ["header.stamp", "header.frame_id", "p[0]", "p[1]", "p[2]"]);
        assert_eq!(names.len(), 5 + LISTED + 1);
        let mut bytes = vec![0, 1, 0, 0];
        bytes.extend(7_i32.to_le_bytes());
        bytes.extend(5_u32.to_le_bytes());
        bytes.extend(2_u32.to_le_bytes());
        bytes.extend(b"w\0");
        bytes.extend([0; 2]);
        for p in [1.0_f64, 2.0, 3.0] {
            bytes.extend(p.to_le_bytes());
        }
        bytes.extend(2_u32.to_le_bytes());
        bytes.extend(4.5_f32.to_le_bytes());
        bytes.extend(5.5_f32.to_le_bytes());
        bytes.extend(4_u32.to_le_bytes());
        bytes.extend(b"end\0");
        let mut cells = Vec::new();
        definition.read(&bytes, &mut cells).unwrap();
        assert_eq!(cells[..3], [Cell::Integer(7_000_000_005), Cell::Text(b"w"), Cell::Number(1.0)]);
        assert_eq!(cells[5..8], [Cell::Number(4.5), Cell::Number(5.5), Cell::Absent]);
        assert_eq!(cells.last(), Some(&Cell::Text(b"end")));
        for end in 0..bytes.len() {
            assert!(definition.read(&bytes[..end], &mut Vec::new()).is_none(), "{end}");
        }
    }

    #[test]
    fn what_is_not_defined_or_contains_itself_is_refused() {
        assert!(Definition::parse("a/B", "c/D d").unwrap_err().contains("c/D"));
        assert!(Definition::parse("a/B", "B b").unwrap_err().contains("contains itself"));
    }
}
