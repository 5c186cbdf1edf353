//! Little-endian integers into and out of a frame's content.

use crate::frame::MAX_CONTENT_LEN;

/// Collects a frame's content.
pub struct Writer {
    bytes: [u8; MAX_CONTENT_LEN],
    len: usize,
}

impl Writer {
    pub const fn new() -> Self {
        Self { bytes: [0; MAX_CONTENT_LEN], len: 0 }
    }

    /// Appends `bytes`. The longest layout is shorter than the buffer (the tests hold every frame against it), so
    /// nothing is ever cut off.
    pub fn put(&mut self, bytes: &[u8]) {
        let room = self.bytes[self.len..].iter_mut();
        self.len += room.zip(bytes).map(|(slot, &byte)| *slot = byte).count();
    }

    pub fn put_i32s(&mut self, values: &[i32]) {
        for value in values {
            self.put(&value.to_le_bytes());
        }
    }

    pub fn written(&self) -> &[u8] {
        &self.bytes[..self.len]
    }
}

/// Takes a frame's content apart; `None` when nothing is left.
pub struct Reader<'a>(pub &'a [u8]);

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (head, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(*head)
    }

    pub fn u8(&mut self) -> Option<u8> {
        self.take().map(u8::from_le_bytes)
    }

    pub fn u32(&mut self) -> Option<u32> {
        self.take().map(u32::from_le_bytes)
    }

    pub fn u64(&mut self) -> Option<u64> {
        self.take().map(u64::from_le_bytes)
    }

    pub fn i32(&mut self) -> Option<i32> {
        self.take().map(i32::from_le_bytes)
    }

    pub fn i32s<const N: usize>(&mut self) -> Option<[i32; N]> {
        let mut values = [0; N];
        for value in &mut values {
            *value = self.i32()?;
        }
        Some(values)
    }
}
