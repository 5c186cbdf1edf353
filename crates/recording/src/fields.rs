//! Protobuf's wire format for messages whose layout is known: a few bytes a field, without the lengths that a general
//! encoder works out beforehand and without the cases that a general decoder is ready for. As in every proto3 writer, a field
//! that is zero and not `optional` is left out.

use bench_device::{Sticks, Time};

const VARINT: u8 = 0;
const FIXED_64: u8 = 1;
const LENGTH_DELIMITED: u8 = 2;

/// Appends fields to a message. Numbers of fields are 1 to 15, whose keys take one byte.
pub(crate) struct Fields<'a> {
    pub out: &'a mut Vec<u8>,
    /// Whether numbers are rounded to single precision. They take as many bytes, of which compressing leaves half.
    pub single: bool,
}

impl Fields<'_> {
    pub fn integer(&mut self, number: u8, value: u64) {
        if value != 0 {
            self.out.push(key(number, VARINT));
            self.varint(value);
        }
    }

    /// The number of an enumeration's value, which is not negative.
    pub fn enumeration(&mut self, number: u8, value: i32) {
        self.integer(number, value.cast_unsigned().into());
    }

    /// Zero of either sign is left out.
    pub fn double(&mut self, number: u8, value: f64) {
        if value != 0.0 {
            self.measured(number, Some(value));
        }
    }

    /// An `optional` field, there whatever its value if it was measured.
    pub fn measured(&mut self, number: u8, value: Option<f64>) {
        if let Some(value) = value {
            let value = if self.single { f64::from(value as f32) } else { value };
            let mut field = [key(number, FIXED_64); 9];
            field[1..].copy_from_slice(&value.to_le_bytes());
            self.out.extend_from_slice(&field);
        }
    }

    /// A message of doubles, numbered from 1.
    pub fn doubles<const N: usize>(&mut self, number: u8, values: [f64; N]) {
        self.message(number, |message| (1..).zip(values).for_each(|(i, value)| message.double(i, value)));
    }

    /// A message of `optional` doubles, numbered from 1.
    pub fn all_measured<const N: usize>(&mut self, number: u8, values: [Option<f64>; N]) {
        self.message(number, |message| (1..).zip(values).for_each(|(i, value)| message.measured(i, value)));
    }

    pub fn sticks(&mut self, number: u8, sticks: Sticks) {
        let Sticks { throttle, pitch, roll, yaw } = sticks;
        self.doubles(number, [throttle, pitch, roll, yaw]);
    }

    /// `google.protobuf.Timestamp`.
    pub fn timestamp(&mut self, number: u8, time: Time) {
        const NANOS: u64 = 1_000_000_000;
        self.message(number, |timestamp| {
            timestamp.integer(1, time.nanos() / NANOS);
            timestamp.integer(2, time.nanos() % NANOS);
        });
    }

    pub fn text(&mut self, number: u8, text: &str) {
        if !text.is_empty() {
            self.out.push(key(number, LENGTH_DELIMITED));
            self.varint(text.len() as u64);
            self.out.extend_from_slice(text.as_bytes());
        }
    }

    /// A message within the message, of 127 bytes at most: its length takes one byte, which stands before it is known.
    pub fn message(&mut self, number: u8, fill: impl FnOnce(&mut Fields)) {
        self.out.extend_from_slice(&[key(number, LENGTH_DELIMITED), 0]);
        let begin = self.out.len();
        fill(&mut Fields { out: self.out, single: self.single });
        let length = self.out.len() - begin;
        assert!(length < 128, "field {number} takes {length} bytes");
        self.out[begin - 1] = length as u8;
    }

    fn varint(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.out.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.out.push(value as u8);
    }
}

/// Takes fields off a message in the order of their numbers, as [`Fields`] appends them. `None` where the message has another
/// layout, as one of another writer may: that is left to a general decoder.
pub(crate) struct FieldReader<'a>(pub &'a [u8]);

impl<'a> FieldReader<'a> {
    /// Whether the next field has this number and kind; its key is taken if so.
    fn next_is(&mut self, number: u8, kind: u8) -> bool {
        match self.0.split_first() {
            Some((first, rest)) if *first == key(number, kind) => {
                self.0 = rest;
                true
            }
            _ => false,
        }
    }

    pub fn integer(&mut self, number: u8) -> Option<u64> {
        if self.next_is(number, VARINT) { self.varint() } else { Some(0) }
    }

    /// `None` also for a number that the enumeration does not have.
    pub fn enumeration<E: TryFrom<i32>>(&mut self, number: u8) -> Option<E> {
        E::try_from(i32::try_from(self.integer(number)?).ok()?).ok()
    }

    pub fn time(&mut self, number: u8) -> Option<Time> {
        self.integer(number).map(Time::from_nanos)
    }

    pub fn flag(&mut self, number: u8) -> Option<bool> {
        self.integer(number).map(|flag| flag != 0)
    }

    pub fn double(&mut self, number: u8) -> Option<f64> {
        self.measured(number).map(Option::unwrap_or_default)
    }

    /// An `optional` field; `Some(None)` where it is absent.
    #[expect(clippy::option_option, reason = "another layout and an absent field are two things")]
    pub fn measured(&mut self, number: u8) -> Option<Option<f64>> {
        if !self.next_is(number, FIXED_64) {
            return Some(None);
        }
        let (bytes, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(Some(f64::from_le_bytes(*bytes)))
    }

    /// A message of doubles, numbered from 1.
    pub fn doubles<const N: usize>(&mut self, number: u8) -> Option<[f64; N]> {
        let mut values = [0.0; N];
        let mut message = self.message(number)?;
        for (i, value) in (1..).zip(&mut values) {
            *value = message.double(i)?;
        }
        message.end()?;
        Some(values)
    }

    /// A message of `optional` doubles, numbered from 1.
    pub fn all_measured<const N: usize>(&mut self, number: u8) -> Option<[Option<f64>; N]> {
        let mut values = [None; N];
        let mut message = self.message(number)?;
        for (i, value) in (1..).zip(&mut values) {
            *value = message.measured(i)?;
        }
        message.end()?;
        Some(values)
    }

    pub fn sticks(&mut self, number: u8) -> Option<Sticks> {
        let [throttle, pitch, roll, yaw] = self.doubles(number)?;
        Some(Sticks { throttle, pitch, roll, yaw })
    }

    /// A message within the message, of 127 bytes at most; an empty one where there is none.
    pub fn message(&mut self, number: u8) -> Option<FieldReader<'a>> {
        if !self.next_is(number, LENGTH_DELIMITED) {
            return Some(FieldReader(&[]));
        }
        let (length, rest) = self.0.split_first().filter(|(length, _)| **length < 128)?;
        let (message, rest) = rest.split_at_checked(usize::from(*length))?;
        self.0 = rest;
        Some(FieldReader(message))
    }

    /// There is nothing more.
    pub fn end(self) -> Option<()> {
        self.0.is_empty().then_some(())
    }

    fn varint(&mut self) -> Option<u64> {
        let mut value = 0;
        for (place, byte) in self.0.iter().enumerate().take(9) {
            value |= u64::from(byte & 0x7f) << (7 * place);
            if byte & 0x80 == 0 {
                self.0 = &self.0[place + 1..];
                return Some(value);
            }
        }
        None
    }
}

/// What stands before a field: its number and the kind of what follows.
fn key(number: u8, kind: u8) -> u8 {
    debug_assert!((1..16).contains(&number), "field {number}");
    number << 3 | kind
}
