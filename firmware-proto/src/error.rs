use thiserror::Error;

use crate::{MAX_WIRE_LEN, PROTOCOL_VERSION};

/// Why the bytes between two delimiters are not a frame. Checked in this order; the first that fails is reported.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum FrameError {
    /// More bytes without a delimiter than any frame has.
    #[error("no delimiter within {MAX_WIRE_LEN} bytes; is something else than a bench board on this port?")]
    OverLong,
    /// The byte stuffing (COBS) points beyond the end.
    #[error("broken byte stuffing: bytes were lost or altered on the link")]
    Stuffing,
    /// Too short for a header and a checksum.
    #[error("{len} bytes are too short for a frame: its beginning was lost")]
    Truncated {
        /// Bytes after unstuffing.
        len: usize,
    },
    /// The checksum does not match.
    #[error("checksum {computed:08x} computed, {received:08x} received: the frame was altered on the link")]
    Crc {
        /// Over the bytes as received.
        computed: u32,
        /// As it stood in the frame.
        received: u32,
    },
    /// An intact frame of another protocol version. The board answers it with [`crate::Answer::WrongVersion`].
    #[error(
        "frame of protocol version {received}, this side speaks {PROTOCOL_VERSION}; flash matching firmware or use a matching bench"
    )]
    Version {
        /// Sequence number of the frame.
        sequence: u16,
        /// Protocol version of the frame.
        received: u8,
    },
    /// An intact frame of a type that this side is not to receive.
    #[error("frame {sequence} has the unknown type {code:#04x}")]
    UnknownType {
        /// Sequence number of the frame.
        sequence: u16,
        /// The type received.
        code: u8,
    },
    /// An intact frame whose payload is longer or shorter than its type says.
    #[error("frame {sequence} of type {code:#04x} has {len} bytes of payload instead of {expected}")]
    Length {
        /// Sequence number of the frame.
        sequence: u16,
        /// Type of the frame.
        code: u8,
        /// Payload length received, bytes.
        len: usize,
        /// Payload length of this type, bytes.
        expected: usize,
    },
    /// An intact frame with a value that its field cannot have.
    #[error("frame {sequence} of type {code:#04x} holds a value that its field cannot have")]
    Value {
        /// Sequence number of the frame.
        sequence: u16,
        /// Type of the frame.
        code: u8,
    },
}

impl FrameError {
    /// The rejected frame's sequence number; 0 where the frame was not intact and none of it can be believed.
    pub fn sequence(&self) -> u16 {
        match *self {
            Self::OverLong | Self::Stuffing | Self::Truncated { .. } | Self::Crc { .. } => 0,
            Self::Version { sequence, .. }
            | Self::UnknownType { sequence, .. }
            | Self::Length { sequence, .. }
            | Self::Value { sequence, .. } => sequence,
        }
    }
}

/// The slice to encode into is too short; [`MAX_WIRE_LEN`] bytes are always enough.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
#[error("the frame needs {needed} bytes, the buffer has {available}")]
pub struct BufferTooSmall {
    /// Length of the frame on the wire, bytes.
    pub needed: usize,
    /// Length of the slice, bytes.
    pub available: usize,
}
