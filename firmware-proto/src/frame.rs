//! The envelope that every frame wears: header, checksum, stuffing, delimiter.

use crc::{CRC_32_ISO_HDLC, Crc};

use crate::cursor::{Reader, Writer};
use crate::error::{BufferTooSmall, FrameError};
use crate::{DELIMITER, MAX_WIRE_LEN, PROTOCOL_VERSION};

/// Version, type, sequence number.
const HEADER_LEN: usize = 4;
const CRC_LEN: usize = 4;
/// COBS adds exactly one byte to content shorter than 254 bytes; the delimiter is the other.
const STUFFING_LEN: usize = 1;
pub(crate) const MAX_CONTENT_LEN: usize = MAX_WIRE_LEN - STUFFING_LEN - 1;

static CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// What is said, and the number that pairs a question with its answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame<B> {
    /// Counted by the host from 1 to 65,535 and on from 1; echoed by the board. 0 answers a frame whose number could
    /// not be read.
    pub sequence: u16,
    /// What is said.
    pub body: B,
}

/// One direction's repertoire: [`crate::Command`] or [`crate::Answer`].
pub trait Body: layout::Layout {}

pub(crate) mod layout {
    use super::{Reader, Writer};

    /// How a body lies in a frame.
    pub trait Layout: Sized {
        /// Protocol version in the header.
        fn version(&self) -> u8 {
            crate::PROTOCOL_VERSION
        }

        /// The frame's type.
        fn code(&self) -> u8;

        /// Whether a frame of this type is read whatever its version, because its layout is the same in all.
        fn is_in_every_version(code: u8) -> bool;

        /// The payload's length in bytes; `None` for a type that is not in this direction's repertoire.
        fn payload_len(code: u8) -> Option<usize>;

        /// Appends the payload.
        fn write(&self, payload: &mut Writer);

        /// Reads a payload of the right length; `None` when a field has a value that it cannot have.
        fn read(version: u8, code: u8, payload: &mut Reader<'_>) -> Option<Self>;
    }
}

impl<B: Body> Frame<B> {
    /// Writes the frame as it goes over the wire, delimiter included, and returns its length in bytes.
    pub fn encode(&self, out: &mut [u8]) -> Result<usize, BufferTooSmall> {
        let mut content = Writer::new();
        content.put(&[self.body.version(), self.body.code()]);
        content.put(&self.sequence.to_le_bytes());
        self.body.write(&mut content);
        let crc = CRC.checksum(content.written());
        content.put(&crc.to_le_bytes());
        stuff(content.written(), out)
    }
}

fn stuff(content: &[u8], out: &mut [u8]) -> Result<usize, BufferTooSmall> {
    let needed = content.len() + STUFFING_LEN + 1;
    let too_small = BufferTooSmall { needed, available: out.len() };
    let wire = out.get_mut(..needed).ok_or(too_small)?;
    let stuffed_len = cobs::try_encode(content, wire).map_err(|_| too_small)?;
    wire[stuffed_len..].fill(DELIMITER);
    Ok(needed)
}

/// Reads the bytes before a delimiter, unstuffing them in place.
pub(crate) fn parse<B: Body>(stuffed: &mut [u8]) -> Result<Frame<B>, FrameError> {
    let len = cobs::decode_in_place(stuffed).map_err(|_| FrameError::Stuffing)?;
    let Some((checked, crc)) = stuffed[..len].split_last_chunk::<CRC_LEN>() else {
        return Err(FrameError::Truncated { len });
    };
    let Some((&[version, code, low, high], payload)) = checked.split_first_chunk::<HEADER_LEN>() else {
        return Err(FrameError::Truncated { len });
    };
    let (computed, received) = (CRC.checksum(checked), u32::from_le_bytes(*crc));
    if computed != received {
        return Err(FrameError::Crc { computed, received });
    }
    let sequence = u16::from_le_bytes([low, high]);
    if version != PROTOCOL_VERSION && !B::is_in_every_version(code) {
        return Err(FrameError::Version { sequence, received: version });
    }
    let expected = B::payload_len(code).ok_or(FrameError::UnknownType { sequence, code })?;
    if payload.len() != expected {
        return Err(FrameError::Length { sequence, code, len: payload.len(), expected });
    }
    let body = B::read(version, code, &mut Reader(payload)).ok_or(FrameError::Value { sequence, code })?;
    Ok(Frame { sequence, body })
}
