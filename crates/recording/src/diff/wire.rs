//! How the fields of a message lie in its bytes, learnt from one message and used for all that lie the same.

use super::rows::{MISSING, Row, Shape};
use crate::{Channel, Kind};

const VARINT: u8 = 0;
const FIXED_64: u8 = 1;
const LENGTH_DELIMITED: u8 = 2;

/// Longest whole number that is read here, bytes: 63 bits.
const VARINT_MAX: usize = 9;

/// By number in the protobuf message, from 1 on: the first column of a field, and how many it has; more than one are a message of
/// numbers 1 and so on.
const fn columns(channel: Channel) -> &'static [(usize, usize)] {
    match channel {
        Channel::Position => &[(1, 1), (0, 1), (2, 3), (5, 1), (6, 2), (8, 1), (9, 1)],
        Channel::Motion => &[(0, 1), (1, 3), (4, 1), (5, 3)],
        Channel::ControlState => {
            &[(0, 1), (1, 1), (2, 3), (5, 1), (6, 3), (9, 3), (12, 1), (13, 1), (14, 1), (15, 1)]
        }
        Channel::Command => &[(0, 1), (1, 4)],
        Channel::Readback => &[(0, 1), (1, 1), (2, 4), (6, 4)],
        Channel::Truth => &[(0, 1), (1, 3), (4, 3), (7, 4), (11, 3), (14, 1), (15, 1), (16, 1)],
        // The lateness is made of the two before it.
        Channel::Tick => &[(1, 1), (2, 1), (0, 1), (NO_COLUMN, 1), (3, 1), (4, 1), (5, 1), (6, 1)],
        // Texts are of any length.
        Channel::Event => &[],
        Channel::Battery => &[(0, 1), (1, 1), (2, 1)],
        Channel::Rotor => &[(0, 1), (1, 1), (2, 1), (3, 1), (4, 1)],
    }
}
const NO_COLUMN: usize = usize::MAX;

/// Where numbers stand in messages of one channel that are alike but for these.
pub(super) struct Layout {
    bytes: Vec<u8>,
    /// The bits in which messages of this layout are equal.
    mask: Vec<u8>,
    /// Offset and column.
    doubles: Vec<(usize, usize)>,
    /// Offset and place among the row's counts.
    counts: Vec<(usize, usize)>,
    /// Has what all of these messages have, and the numbers of the one that was read last.
    row: Row,
}

impl Layout {
    /// The layout of a message that `row` was made of; `None` where there is something in it that does not belong to a channel's
    /// message or stands there twice.
    pub fn of(message: &[u8], shape: &Shape, row: &Row) -> Option<Self> {
        let mut layout = Self {
            bytes: message.to_vec(),
            mask: vec![0xff; message.len()],
            doubles: Vec::new(),
            counts: Vec::new(),
            row: *row,
        };
        layout.learn(0, message.len(), columns(row.channel), shape)?;
        layout.read(message, shape).is_as(row).then_some(layout)
    }

    /// Learns from a message, or one within it, of fields that have these columns.
    fn learn(&mut self, from: usize, until: usize, columns: &[(usize, usize)], shape: &Shape) -> Option<()> {
        let mut at = from;
        let mut seen = 0_u32;
        while at < until {
            let key = self.bytes[at];
            at += 1;
            let number = usize::from(key >> 3);
            let (column, width) = *columns.get(number.checked_sub(1)?)?;
            let bit = 1 << number;
            if seen & bit != 0 {
                return None;
            }
            seen |= bit;
            let rest = &self.bytes[at..until];
            let length = match key & 7 {
                VARINT if width == 1 => 1 + rest.iter().take(VARINT_MAX).position(|byte| byte & 0x80 == 0)?,
                FIXED_64 if width == 1 && rest.len() >= 8 => 8,
                LENGTH_DELIMITED if width > 1 => usize::from(*rest.first().filter(|length| **length < 0x80)?),
                _ => return None,
            };
            match key & 7 {
                VARINT => self.learn_whole(at, length, column, shape),
                FIXED_64 => self.learn_double(at, column)?,
                _ => {
                    at += 1;
                    let within: Vec<(usize, usize)> =
                        (column..column + width).map(|column| (column, 1)).collect();
                    let end = at.checked_add(length).filter(|end| *end <= until)?;
                    self.learn(at, end, &within, shape)?;
                }
            }
            at += length;
        }
        Some(())
    }

    /// Flags and enumerations are equal in all messages of a layout; only the length of counts is.
    fn learn_whole(&mut self, at: usize, length: usize, column: usize, shape: &Shape) {
        if let Some(place) = shape.place(column) {
            self.mask[at..at + length].fill(0x80);
            self.counts.push((at, place));
        }
    }

    fn learn_double(&mut self, at: usize, column: usize) -> Option<()> {
        self.mask[at..at + 8].fill(0);
        if column == NO_COLUMN {
            return Some(());
        }
        if self.row.channel.fields()[column].kind != Kind::Float {
            return None;
        }
        // What a lost position holds is not there.
        if self.row.numbers[column].to_bits() != MISSING.to_bits() {
            self.doubles.push((at, column));
        }
        Some(())
    }

    /// Whether a message has this layout.
    pub fn fits(&self, message: &[u8]) -> bool {
        let differs = |((byte, like), mask): ((&u8, &u8), &u8)| (byte ^ like) & mask;
        message.len() == self.bytes.len()
            && message.iter().zip(&self.bytes).zip(&self.mask).map(differs).fold(0, |all, one| all | one) == 0
    }

    /// Reads a message that fits.
    pub fn read(&mut self, message: &[u8], shape: &Shape) -> &mut Row {
        let row = &mut self.row;
        for &(at, column) in &self.doubles {
            if let Some(bytes) = message[at..].first_chunk() {
                row.numbers[column] = f64::from_le_bytes(*bytes);
            }
        }
        for &(at, place) in &self.counts {
            row.counts[place] = varint(&message[at..]);
        }
        shape.set_age(row);
        row
    }
}

fn varint(bytes: &[u8]) -> u64 {
    let mut value = 0;
    for (place, byte) in bytes.iter().enumerate().take(VARINT_MAX) {
        value |= u64::from(byte & 0x7f) << (7 * place);
        if byte & 0x80 == 0 {
            break;
        }
    }
    value
}
