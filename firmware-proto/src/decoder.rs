use core::marker::PhantomData;

use crate::frame::{Body, Frame, parse};
use crate::{DELIMITER, FrameError, MAX_WIRE_LEN};

/// Finds frames in a stream of bytes: `Decoder<Command>` on the board, `Decoder<Answer>` on the host.
///
/// Memory is bounded (one frame) and so is the work a byte costs. Every delimiter starts afresh, whatever came before.
#[derive(Clone, Debug)]
pub struct Decoder<B> {
    stuffed: [u8; MAX_WIRE_LEN - 1],
    len: usize,
    over_long: bool,
    body: PhantomData<fn() -> B>,
}

impl<B: Body> Decoder<B> {
    /// A decoder at the start of a stream.
    pub const fn new() -> Self {
        Self { stuffed: [0; MAX_WIRE_LEN - 1], len: 0, over_long: false, body: PhantomData }
    }

    /// Takes the next byte of the stream. A delimiter gives the frame that it ends, or why it is none; delimiters that
    /// follow one another are idle line, and silent.
    pub fn push(&mut self, byte: u8) -> Option<Result<Frame<B>, FrameError>> {
        if byte != DELIMITER {
            self.keep(byte);
            return None;
        }
        let len = core::mem::take(&mut self.len);
        if core::mem::take(&mut self.over_long) {
            return Some(Err(FrameError::OverLong));
        }
        (len > 0).then(|| parse(&mut self.stuffed[..len]))
    }

    fn keep(&mut self, byte: u8) {
        match self.stuffed.get_mut(self.len) {
            Some(slot) => {
                *slot = byte;
                self.len += 1;
            }
            None => self.over_long = true,
        }
    }
}

impl<B: Body> Default for Decoder<B> {
    fn default() -> Self {
        Self::new()
    }
}
