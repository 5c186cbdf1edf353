//! What the host and the `PSoC5` board say to each other.
//!
//! The host sends a [`HostFrame`], the board answers with one [`BoardFrame`] that echoes its sequence number. A frame
//! is `encode`d into a byte slice and recovered from a byte stream, one byte at a time, by a [`Decoder`]. The written
//! specification, with layouts and timing, is `docs/protocol.md`; the same protocol in C99 is in `c/`, and
//! `golden/` holds the bytes on which both must agree.
//!
//! Promises: no `std`, no allocation, no `unsafe`, no panic on any input; every accepted frame encodes to exactly the
//! bytes it came from; after any garbage the decoder is in step again at the next delimiter.
//!
//! ```
//! use firmware_proto::{Command, Decoder, HostFrame, MAX_WIRE_LEN};
//!
//! let sent = HostFrame { sequence: 7, body: Command::Read };
//! let mut wire = [0; MAX_WIRE_LEN];
//! let len = sent.encode(&mut wire)?;
//!
//! let mut decoder = Decoder::<Command>::new();
//! let received = wire[..len].iter().find_map(|&byte| decoder.push(byte));
//! assert_eq!(received, Some(Ok(sent)));
//! # Ok::<(), firmware_proto::BufferTooSmall>(())
//! ```

#![no_std]
#![forbid(unsafe_code)]

mod answer;
mod command;
mod cursor;
mod decoder;
mod error;
mod frame;
mod voltage;

pub use answer::{Answer, ArmState, BoardFrame, ChannelCalibration, ErrorCode, Faults, FirmwareVersion};
pub use command::{Command, HostFrame};
pub use decoder::Decoder;
pub use error::{BufferTooSmall, FrameError};
pub use frame::{Body, Frame};
pub use voltage::{microvolts, volts};

/// The version of the protocol spoken here: the first byte of every frame.
pub const PROTOCOL_VERSION: u8 = 1;

/// Ends every frame and occurs nowhere inside one.
pub const DELIMITER: u8 = 0;

/// No frame of any protocol version is longer than this on the wire, delimiter included, bytes: one packet of a
/// full-speed USB bulk endpoint.
pub const MAX_WIRE_LEN: usize = 64;

/// An armed board sets its outputs to zero when it has not applied a [`Command::SetVoltages`] for this long,
/// milliseconds.
pub const WATCHDOG_MS: u64 = 300;

/// Throttle, pitch, roll and yaw, in this order wherever a frame holds four values.
pub const CHANNELS: usize = 4;
