//! Protobuf messages by the descriptors that an MCAP file carries, without code made for them.

use prost::Message as _;
use prost_types::{
    DescriptorProto, FileDescriptorSet,
    field_descriptor_proto::{Label, Type},
};

use crate::{Cell, Field, bytes::Scalar};

/// Of a repeated field, as many elements are fields.
const LISTED: usize = 8;
/// Messages in messages deeper than this are passed over; so is a message in itself.
const DEEPEST: usize = 8;

#[derive(Debug)]
enum Kind {
    /// A number as it stands in the bytes.
    Fixed(Scalar),
    /// A whole number of seven bits a byte.
    Varint {
        signed: bool,
        zigzag: bool,
    },
    Text,
    /// Seconds and nanoseconds, which become one number of nanoseconds.
    Time,
    Message(usize),
}

#[derive(Debug)]
struct Member {
    number: u64,
    name: String,
    kind: Kind,
    repeated: bool,
    /// Where its cells begin among those of its message.
    offset: usize,
    /// How many cells one element has.
    width: usize,
}

/// How messages of one type are laid out.
#[derive(Debug)]
pub(crate) struct Definition {
    messages: Vec<Vec<Member>>,
    width: usize,
    fields: Vec<Field>,
}

impl Definition {
    /// Reads the descriptors of a type and all that it names.
    pub fn parse(kind: &str, bytes: &[u8]) -> Result<Self, String> {
        let set = FileDescriptorSet::decode(bytes).map_err(|error| error.to_string())?;
        let mut types = Vec::new();
        for file in &set.file {
            let package = file.package();
            let before = if package.is_empty() { String::new() } else { format!(".{package}") };
            collect(&before, &file.message_type, &mut types);
        }
        let mut definition = Self { messages: Vec::new(), width: 0, fields: Vec::new() };
        let (_, width) = definition
            .build(&format!(".{kind}"), &types, &mut Vec::new())
            .ok_or_else(|| format!("it does not define {kind}"))?;
        definition.width = width;
        let mut fields = vec![Field::default(); width];
        definition.list(definition.messages.len() - 1, "", 0, &mut fields);
        definition.fields = fields;
        Ok(definition)
    }

    /// Adds a type and those that it names; its place and how many cells it has.
    fn build(
        &mut self,
        name: &str,
        types: &[(String, &DescriptorProto)],
        above: &mut Vec<String>,
    ) -> Option<(usize, usize)> {
        if above.len() >= DEEPEST || above.iter().any(|known| known == name) {
            return None;
        }
        let (_, descriptor) = types.iter().find(|(known, _)| known == name)?;
        above.push(name.to_owned());
        let mut members = Vec::new();
        let mut offset = 0;
        for field in &descriptor.field {
            let (kind, width) = match field.r#type() {
                Type::Double => (Kind::Fixed(Scalar::F64), 1),
                Type::Float => (Kind::Fixed(Scalar::F32), 1),
                Type::Fixed64 => (Kind::Fixed(Scalar::U64), 1),
                Type::Fixed32 => (Kind::Fixed(Scalar::U32), 1),
                Type::Sfixed64 => (Kind::Fixed(Scalar::I64), 1),
                Type::Sfixed32 => (Kind::Fixed(Scalar::I32), 1),
                Type::Int32 | Type::Int64 | Type::Enum => (Kind::Varint { signed: true, zigzag: false }, 1),
                Type::Uint32 | Type::Uint64 | Type::Bool => {
                    (Kind::Varint { signed: false, zigzag: false }, 1)
                }
                Type::Sint32 | Type::Sint64 => (Kind::Varint { signed: true, zigzag: true }, 1),
                Type::String | Type::Bytes => (Kind::Text, 1),
                Type::Message
                    if [".google.protobuf.Timestamp", ".google.protobuf.Duration"]
                        .contains(&field.type_name()) =>
                {
                    (Kind::Time, 1)
                }
                Type::Message => match self.build(field.type_name(), types, above) {
                    Some((place, width)) => (Kind::Message(place), width),
                    None => continue,
                },
                Type::Group => continue,
            };
            let repeated = field.label() == Label::Repeated;
            let number = u64::from(field.number().unsigned_abs());
            members.push(Member { number, name: field.name().to_owned(), kind, repeated, offset, width });
            offset += if repeated { LISTED * width } else { width };
        }
        above.pop();
        self.messages.push(members);
        Some((self.messages.len() - 1, offset))
    }

    fn list(&self, message: usize, before: &str, at: usize, fields: &mut [Field]) {
        for member in &self.messages[message] {
            for place in 0..if member.repeated { LISTED } else { 1 } {
                let name = if member.repeated {
                    format!("{before}{}[{place}]", member.name)
                } else {
                    format!("{before}{}", member.name)
                };
                let at = at + member.offset + place * member.width;
                match member.kind {
                    Kind::Message(inner) => self.list(inner, &format!("{name}."), at, fields),
                    Kind::Time => fields[at] = Field { name, unit: Some("ns".to_owned()) },
                    _ => fields[at] = Field::new(name),
                }
            }
        }
    }

    /// The fields of a message, in the order in which [`Definition::read`] gives their cells.
    pub fn fields(&self) -> &[Field] {
        &self.fields
    }

    /// Reads a message; `None` where its bytes are none.
    pub fn read<'a>(&self, bytes: &'a [u8], cells: &mut Vec<Cell<'a>>) -> Option<()> {
        cells.clear();
        cells.resize(self.width, Cell::Absent);
        self.read_message(self.messages.len() - 1, bytes, cells)
    }

    fn read_message<'a>(&self, message: usize, bytes: &'a [u8], cells: &mut [Cell<'a>]) -> Option<()> {
        let members = &self.messages[message];
        // What is not there has its default, which writers leave out.
        for member in members.iter().filter(|member| !member.repeated) {
            cells[member.offset] = match member.kind {
                Kind::Fixed(Scalar::F32 | Scalar::F64) => Cell::Number(0.0),
                Kind::Fixed(_) | Kind::Varint { .. } => Cell::Integer(0),
                _ => continue,
            };
        }
        let mut seen = vec![0; members.len()];
        let mut wire = Wire(bytes);
        while !wire.0.is_empty() {
            let (number, piece) = wire.piece()?;
            let Some(place) = members.iter().position(|member| member.number == number) else { continue };
            let member = &members[place];
            let packed = match (&member.kind, piece) {
                (Kind::Fixed(_) | Kind::Varint { .. }, Piece::Bytes(bytes)) if member.repeated => Some(bytes),
                _ => None,
            };
            let Some(packed) = packed else {
                self.read_piece(member, piece, seen[place], cells)?;
                seen[place] += usize::from(member.repeated);
                continue;
            };
            let mut packed = Wire(packed);
            while !packed.0.is_empty() {
                let piece = match member.kind {
                    Kind::Fixed(scalar) => Piece::Bytes(packed.take(scalar.size())?),
                    _ => Piece::Varint(packed.varint()?),
                };
                self.read_piece(member, piece, seen[place], cells)?;
                seen[place] += 1;
            }
        }
        Some(())
    }

    fn read_piece<'a>(
        &self,
        member: &Member,
        piece: Piece<'a>,
        element: usize,
        cells: &mut [Cell<'a>],
    ) -> Option<()> {
        if element >= LISTED {
            return Some(());
        }
        let at = member.offset + element * member.width;
        let cells = &mut cells[at..at + member.width];
        let cell = match (&member.kind, piece) {
            (Kind::Message(inner), Piece::Bytes(bytes)) => return self.read_message(*inner, bytes, cells),
            (Kind::Fixed(scalar), Piece::Bytes(bytes)) if bytes.len() == scalar.size() => {
                scalar.read(bytes, false)
            }
            (Kind::Varint { zigzag: true, .. }, Piece::Varint(bits)) => {
                Cell::Integer(((bits >> 1).cast_signed() ^ -((bits & 1).cast_signed())).into())
            }
            (Kind::Varint { signed: true, .. }, Piece::Varint(bits)) => {
                Cell::Integer(bits.cast_signed().into())
            }
            (Kind::Varint { .. }, Piece::Varint(bits)) => Cell::Integer(bits.into()),
            (Kind::Text, Piece::Bytes(bytes)) => Cell::Text(bytes),
            (Kind::Time, Piece::Bytes(bytes)) => {
                let (mut seconds, mut nanos) = (0, 0);
                let mut wire = Wire(bytes);
                while !wire.0.is_empty() {
                    match wire.piece()? {
                        (1, Piece::Varint(bits)) => seconds = i128::from(bits.cast_signed()),
                        (2, Piece::Varint(bits)) => nanos = i128::from(bits.cast_signed()),
                        _ => {}
                    }
                }
                Cell::Integer(seconds * 1_000_000_000 + nanos)
            }
            _ => return None,
        };
        cells[0] = cell;
        Some(())
    }
}

/// The messages of files and messages by their full names.
fn collect<'d>(
    before: &str,
    messages: &'d [DescriptorProto],
    types: &mut Vec<(String, &'d DescriptorProto)>,
) {
    for message in messages {
        let name = format!("{before}.{}", message.name());
        collect(&name, &message.nested_type, types);
        types.push((name, message));
    }
}

#[derive(Clone, Copy)]
enum Piece<'a> {
    Varint(u64),
    Bytes(&'a [u8]),
}

/// Protobuf's wire format: <https://protobuf.dev/programming-guides/encoding/>.
struct Wire<'a>(&'a [u8]);

impl<'a> Wire<'a> {
    fn take(&mut self, size: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(size)?;
        self.0 = rest;
        Some(taken)
    }

    fn varint(&mut self) -> Option<u64> {
        let mut bits = 0;
        for shift in (0..64).step_by(7) {
            let [byte] = self.take(1)? else { return None };
            bits |= u64::from(byte & 0x7f) << shift;
            if byte & 0x80 == 0 {
                return Some(bits);
            }
        }
        None
    }

    fn piece(&mut self) -> Option<(u64, Piece<'a>)> {
        let tag = self.varint()?;
        let piece = match tag & 7 {
            0 => Piece::Varint(self.varint()?),
            1 => Piece::Bytes(self.take(8)?),
            2 => {
                let length = usize::try_from(self.varint()?).ok()?;
                Piece::Bytes(self.take(length)?)
            }
            5 => Piece::Bytes(self.take(4)?),
            _ => return None,
        };
        Some((tag >> 3, piece))
    }
}

#[cfg(test)]
mod tests {
    use prost_types::{FieldDescriptorProto, FileDescriptorProto};

    use super::*;

    fn field(name: &str, number: i32, kind: Type, label: Label, of: Option<&str>) -> FieldDescriptorProto {
        FieldDescriptorProto {
            name: Some(name.to_owned()),
            number: Some(number),
            r#type: Some(kind.into()),
            label: Some(label.into()),
            type_name: of.map(str::to_owned),
            ..FieldDescriptorProto::default()
        }
    }

    #[test]
    fn numbers_nested_messages_lists_and_defaults_come_through() {
        let inner = DescriptorProto {
            name: Some("P".to_owned()),
            field: vec![field("z", 1, Type::Double, Label::Optional, None)],
            ..DescriptorProto::default()
        };
        let outer = DescriptorProto {
            name: Some("M".to_owned()),
            field: vec![
                field("p", 1, Type::Message, Label::Optional, Some(".x.P")),
                field("n", 2, Type::Sint32, Label::Optional, None),
                field("u", 3, Type::Float, Label::Repeated, None),
                field("k", 4, Type::Uint32, Label::Optional, None),
            ],
            ..DescriptorProto::default()
        };
        let file = FileDescriptorProto {
            package: Some("x".to_owned()),
            message_type: vec![inner, outer],
            ..FileDescriptorProto::default()
        };
        let set = FileDescriptorSet { file: vec![file] }.encode_to_vec();
        let definition = Definition::parse("x.M", &set).unwrap();
        let names: Vec<&str> = definition.fields().iter().map(|field| field.name.as_str()).collect();
        assert_eq!(names[..3], ["p.z", "n", "u[0]"]);
        assert_eq!(*names.last().unwrap(), "k");
        let mut bytes = vec![0x0a, 9, 0x09];
        bytes.extend(2.5_f64.to_le_bytes());
        bytes.extend([0x10, 3, 0x1a, 8]);
        bytes.extend(1.0_f32.to_le_bytes());
        bytes.extend(0.5_f32.to_le_bytes());
        let mut cells = Vec::new();
        definition.read(&bytes, &mut cells).unwrap();
        assert_eq!(
            cells[..5],
            [Cell::Number(2.5), Cell::Integer(-2), Cell::Number(1.0), Cell::Number(0.5), Cell::Absent]
        );
        assert_eq!(cells.last(), Some(&Cell::Integer(0)));
        assert!(definition.read(&bytes[..bytes.len() - 1], &mut Vec::new()).is_none());
        assert!(Definition::parse("x.N", &set).unwrap_err().contains("x.N"));
    }
}
