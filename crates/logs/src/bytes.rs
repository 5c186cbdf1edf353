//! Bytes of a file through a window that moves forward, and numbers in them.

use std::{
    fs::File,
    io::{self, Read},
    path::Path,
};

use crate::{Cell, LogError};

/// So many bytes are read at once.
const WINDOW: usize = 1 << 18;

/// A file, of which a stretch is in memory.
pub(crate) struct Window {
    file: File,
    buffer: Vec<u8>,
    /// Where the unread bytes of `buffer` begin.
    start: usize,
    /// Position in the file of `start`.
    pub at: u64,
    ended: bool,
}

impl Window {
    pub fn open(path: &Path) -> Result<Self, LogError> {
        let file = File::open(path).map_err(|source| unread(path, source))?;
        Ok(Self { file, buffer: Vec::new(), start: 0, at: 0, ended: false })
    }

    /// The bytes ahead: at least `wanted`, or all that are left.
    pub fn ahead(&mut self, wanted: usize) -> io::Result<&[u8]> {
        if self.buffer.len() - self.start < wanted && !self.ended {
            self.buffer.drain(..self.start);
            self.start = 0;
            let held = self.buffer.len();
            self.buffer.resize(held.max(wanted).next_multiple_of(WINDOW) + WINDOW, 0);
            let mut filled = held;
            while filled < self.buffer.len() && !self.ended {
                match self.file.read(&mut self.buffer[filled..]) {
                    Ok(0) => self.ended = true,
                    Ok(read) => filled += read,
                    Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                    Err(error) => return Err(error),
                }
            }
            self.buffer.truncate(filled);
        }
        Ok(&self.buffer[self.start..])
    }

    /// Goes on by so many of the bytes ahead.
    pub fn pass(&mut self, bytes: usize) {
        self.start += bytes;
        self.at += bytes as u64;
    }
}

pub(crate) fn unread(path: &Path, source: io::Error) -> LogError {
    LogError::Read { path: path.to_owned(), source }
}

/// A little-endian number in binary logs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F16,
    F32,
    F64,
    Bool,
}

impl Scalar {
    pub const fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 | Self::Bool => 1,
            Self::I16 | Self::U16 | Self::F16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    /// The number at the beginning of `bytes`; absent where there are too few.
    #[inline]
    pub fn read(self, bytes: &[u8], big_endian: bool) -> Cell<'static> {
        /// Of a length that is known when this is compiled: a log has millions of them.
        #[inline]
        fn first<const N: usize>(bytes: &[u8], big_endian: bool) -> Option<[u8; N]> {
            let mut first: [u8; N] = *bytes.first_chunk()?;
            if big_endian {
                first.reverse();
            }
            Some(first)
        }
        let first_1 = || first::<1>(bytes, big_endian);
        let first_2 = || first::<2>(bytes, big_endian);
        let first_4 = || first::<4>(bytes, big_endian);
        let first_8 = || first::<8>(bytes, big_endian);
        let cell = match self {
            Self::I8 => first_1().map(|raw| Cell::Integer(i8::from_le_bytes(raw).into())),
            Self::U8 | Self::Bool => first_1().map(|raw| Cell::Integer(u8::from_le_bytes(raw).into())),
            Self::I16 => first_2().map(|raw| Cell::Integer(i16::from_le_bytes(raw).into())),
            Self::U16 => first_2().map(|raw| Cell::Integer(u16::from_le_bytes(raw).into())),
            Self::F16 => first_2().map(|raw| Cell::Number(half(u16::from_le_bytes(raw)))),
            Self::I32 => first_4().map(|raw| Cell::Integer(i32::from_le_bytes(raw).into())),
            Self::U32 => first_4().map(|raw| Cell::Integer(u32::from_le_bytes(raw).into())),
            Self::F32 => first_4().map(|raw| Cell::Number(f32::from_le_bytes(raw).into())),
            Self::I64 => first_8().map(|raw| Cell::Integer(i64::from_le_bytes(raw).into())),
            Self::U64 => first_8().map(|raw| Cell::Integer(u64::from_le_bytes(raw).into())),
            Self::F64 => first_8().map(|raw| Cell::Number(f64::from_le_bytes(raw))),
        };
        cell.unwrap_or_default()
    }
}

/// IEEE 754 binary16.
fn half(bits: u16) -> f64 {
    let sign = if bits & 0x8000 == 0 { 1.0 } else { -1.0 };
    let (exponent, fraction) = (i32::from(bits >> 10 & 0x1f), f64::from(bits & 0x3ff));
    sign * match exponent {
        0 => fraction * 2_f64.powi(-24),
        31 if fraction == 0.0 => f64::INFINITY,
        31 => f64::NAN,
        _ => (1.0 + fraction / 1024.0) * 2_f64.powi(exponent - 15),
    }
}

/// A text up to its first zero byte.
pub(crate) fn text(bytes: &[u8]) -> &[u8] {
    let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
    &bytes[..end]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_read_with_sign_and_order_of_bytes() {
        assert_eq!(Scalar::I16.read(&[0xfe, 0xff, 7], false), Cell::Integer(-2));
        assert_eq!(Scalar::I16.read(&[0xff, 0xfe], true), Cell::Integer(-2));
        assert_eq!(Scalar::U64.read(&[0xff; 8], false), Cell::Integer(u64::MAX.into()));
        assert_eq!(Scalar::F32.read(&1.5_f32.to_be_bytes(), true), Cell::Number(1.5));
        assert_eq!(Scalar::F64.read(&[0; 7], false), Cell::Absent);
    }

    #[test]
    fn half_precision_is_that_of_the_standard() {
        for (bits, number) in
            [(0x3c00, 1.0), (0xc000, -2.0), (0x0001, 5.960_464_477_539_063e-8), (0x7bff, 65504.0)]
        {
            assert_eq!(half(bits), number);
        }
        assert_eq!(half(0x7c00), f64::INFINITY);
        assert!(half(0x7c01).is_nan());
    }
}
