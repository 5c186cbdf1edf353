//! Commands to the camera, both ways: a header of four little-endian words (magic, length of the payload in words, command, tag), then
//! the payload. A command goes out with one vendor request and its reply is fetched with another. Facts: `OpenKinect`'s protocol
//! documentation and libfreenect.

use std::time::Duration;

use super::{DriverError, Transport, TransportError};

/// `bRequest`, `wValue` and `wIndex` of both requests.
const REQUEST: u8 = 0;
/// Magic of a command and of a reply, as bytes on the wire.
const COMMAND_MAGIC: [u8; 2] = *b"GM";
const REPLY_MAGIC: [u8; 2] = *b"RB";
const HEADER: usize = 8;
/// Largest payload of either, bytes.
pub const LONGEST: usize = 0x3f8;
/// A reply is read into a buffer of this size. The device says "not yet" with nothing, or with all of it.
pub const REPLY_BUFFER: usize = 0x200;

/// How often a reply is asked for, and how long between: the device answers within a few milliseconds.
const POLLS: u32 = 200;
const BETWEEN: Duration = Duration::from_millis(1);
/// How often a command is sent before it is given up.
const ATTEMPTS: u32 = 3;

/// What a command asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u16)]
pub enum Command {
    /// The value of a register.
    ReadRegister = 0x02,
    /// Sets a register.
    WriteRegister = 0x03,
    /// The constants of the depth sensor's geometry.
    FixedParameters = 0x04,
    /// Constants of the depth sensor's algorithms, a block at a time.
    AlgorithmParameters = 0x16,
    /// Reads or sets a register of the colour sensor.
    Cmos = 0x95,
}

impl Command {
    fn name(self) -> &'static str {
        match self {
            Self::ReadRegister => "read a register",
            Self::WriteRegister => "write a register",
            Self::FixedParameters => "fixed parameters",
            Self::AlgorithmParameters => "algorithm parameters",
            Self::Cmos => "colour sensor's register",
        }
    }
}

/// A frame of either direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Message<'a> {
    /// The command's number; an emulated device may meet one that it does not know.
    pub command: u16,
    /// Counts commands; a reply repeats it.
    pub tag: u16,
    /// What comes with it.
    pub payload: &'a [u8],
}

/// Why bytes are no reply.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BadReply {
    /// Fewer bytes than a header.
    #[error("{0} bytes are less than a header")]
    Short(
        /// How many there are.
        usize,
    ),
    /// It begins with something else.
    #[error("it begins with {0:02x?}")]
    Magic(
        /// With what.
        [u8; 2],
    ),
    /// The payload is not as long as the header says.
    #[error("its header says {said} bytes, and {found} follow")]
    Length {
        /// Bytes by the header.
        said: usize,
        /// Bytes that follow.
        found: usize,
    },
    /// It answers another command.
    #[error("it answers command {command:#x} with tag {tag}")]
    Other {
        /// Which command.
        command: u16,
        /// With which tag.
        tag: u16,
    },
}

/// A command as bytes. The payload is cut at [`LONGEST`].
pub fn command(command: Command, tag: u16, payload: &[u16]) -> Vec<u8> {
    let words = &payload[..payload.len().min(LONGEST / 2)];
    let mut bytes = Vec::with_capacity(HEADER + 2 * words.len());
    bytes.extend(COMMAND_MAGIC);
    for word in [words.len() as u16, command as u16, tag].iter().chain(words) {
        bytes.extend(word.to_le_bytes());
    }
    bytes
}

/// A reply as bytes. The payload must have an even length and is cut at [`LONGEST`].
pub fn reply(command: u16, tag: u16, payload: &[u8]) -> Vec<u8> {
    let payload = &payload[..payload.len().min(LONGEST) & !1];
    let mut bytes = Vec::with_capacity(HEADER + payload.len());
    bytes.extend(REPLY_MAGIC);
    for word in [payload.len() as u16 / 2, command, tag] {
        bytes.extend(word.to_le_bytes());
    }
    bytes.extend(payload);
    bytes
}

/// Reads a command, as the device does.
pub fn parse_command(bytes: &[u8]) -> Result<Message<'_>, BadReply> {
    parse(bytes, COMMAND_MAGIC)
}

/// Reads a reply, whatever it answers.
pub fn parse_reply(bytes: &[u8]) -> Result<Message<'_>, BadReply> {
    parse(bytes, REPLY_MAGIC)
}

fn parse(bytes: &[u8], magic: [u8; 2]) -> Result<Message<'_>, BadReply> {
    let Some((header, payload)) = bytes.split_first_chunk::<HEADER>() else {
        return Err(BadReply::Short(bytes.len()));
    };
    let word = |at: usize| u16::from_le_bytes([header[at], header[at + 1]]);
    if header[..2] != magic {
        return Err(BadReply::Magic([header[0], header[1]]));
    }
    let said = 2 * usize::from(word(2));
    if said != payload.len() || said > LONGEST {
        return Err(BadReply::Length { said, found: payload.len() });
    }
    Ok(Message { command: word(4), tag: word(6), payload })
}

/// Sends commands and matches replies.
#[derive(Debug, Default)]
pub(super) struct Control {
    tag: u16,
}

impl Control {
    /// Sends a command and returns its reply's payload. A reply that is late, damaged or another command's is passed over; what is
    /// not answered is sent again.
    pub fn ask(
        &mut self,
        transport: &mut dyn Transport,
        which: Command,
        payload: &[u16],
    ) -> Result<Vec<u8>, DriverError> {
        let mut last = None;
        for _ in 0..ATTEMPTS {
            let sent = command(which, self.tag, payload);
            match transport.write(REQUEST, 0, 0, &sent) {
                Ok(()) => {}
                Err(TransportError::TimedOut) => continue,
                Err(error) => return Err(error.of(which.name())),
            }
            match self.await_reply(transport, which, &mut last)? {
                Some(payload) => {
                    self.tag = self.tag.wrapping_add(1);
                    return Ok(payload);
                }
                // What is sent again has a tag of its own, so that the late reply is not taken for it.
                None => self.tag = self.tag.wrapping_add(1),
            }
        }
        let command = which.name();
        Err(match last {
            Some(detail) => DriverError::BadAnswer { command, detail },
            None => DriverError::NoAnswer { command },
        })
    }

    fn await_reply(
        &self,
        transport: &mut dyn Transport,
        which: Command,
        last: &mut Option<String>,
    ) -> Result<Option<Vec<u8>>, DriverError> {
        let mut buffer = [0; REPLY_BUFFER];
        for _ in 0..POLLS {
            match transport.read(REQUEST, 0, 0, &mut buffer) {
                Ok(0 | REPLY_BUFFER) => std::thread::sleep(BETWEEN),
                Ok(length) => match parse_reply(&buffer[..length]) {
                    Ok(Message { command, tag, payload }) if (command, tag) == (which as u16, self.tag) => {
                        return Ok(Some(payload.to_vec()));
                    }
                    // An earlier command's; this one's comes after it.
                    Ok(Message { command, tag, .. }) => {
                        *last = Some(BadReply::Other { command, tag }.to_string());
                    }
                    Err(bad) => {
                        *last = Some(bad.to_string());
                        return Ok(None);
                    }
                },
                Err(TransportError::TimedOut) => return Ok(None),
                Err(error) => return Err(error.of(which.name())),
            }
        }
        Ok(None)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;

    use proptest::prelude::*;

    use super::*;
    use crate::usb::Packets;

    /// Gives scripted replies; `None` leaves the script to the command's own.
    #[derive(Default)]
    struct Scripted {
        sent: Vec<Vec<u8>>,
        replies: VecDeque<Result<Vec<u8>, TransportError>>,
    }

    impl Transport for Scripted {
        fn write(&mut self, _: u8, _: u16, _: u16, data: &[u8]) -> Result<(), TransportError> {
            self.sent.push(data.to_vec());
            Ok(())
        }

        fn read(&mut self, _: u8, _: u16, _: u16, buffer: &mut [u8]) -> Result<usize, TransportError> {
            let bytes = self.replies.pop_front().unwrap_or(Err(TransportError::TimedOut))?;
            buffer[..bytes.len()].copy_from_slice(&bytes);
            Ok(bytes.len())
        }

        fn start(&mut self, _: Box<dyn Packets>) -> Result<(), TransportError> {
            Ok(())
        }

        fn stop(&mut self) {}
    }

    fn ask(
        replies: impl IntoIterator<Item = Result<Vec<u8>, TransportError>>,
    ) -> (Result<Vec<u8>, DriverError>, Scripted) {
        let mut transport = Scripted { replies: replies.into_iter().collect(), ..Scripted::default() };
        let answer = Control::default().ask(&mut transport, Command::ReadRegister, &[0x12]);
        (answer, transport)
    }

    #[test]
    fn a_command_is_laid_out_as_the_device_wants_it() {
        // Write 3 to register 0x12, the fifth command.
        let bytes = command(Command::WriteRegister, 5, &[0x12, 3]);
        assert_eq!(bytes, [0x47, 0x4d, 2, 0, 3, 0, 5, 0, 0x12, 0, 3, 0]);
        let message = parse_command(&bytes).unwrap();
        assert_eq!((message.command, message.tag, message.payload), (3, 5, &bytes[8..]));
    }

    #[test]
    fn a_reply_is_waited_for_while_the_device_says_not_yet() {
        let reply = reply(2, 0, &[0, 0, 7, 0]);
        let (answer, transport) = ask([Ok(vec![]), Ok(vec![0; REPLY_BUFFER]), Ok(reply)]);
        assert_eq!((answer.unwrap(), transport.sent.len()), (vec![0, 0, 7, 0], 1));
    }

    #[test]
    fn late_and_damaged_replies_are_passed_over_and_silence_is_asked_again() {
        // Another command's reply comes first.
        let (answer, _) = ask([Ok(reply(3, 9, &[0, 0])), Ok(reply(2, 0, &[1, 1]))]);
        assert_eq!(answer.unwrap(), [1, 1]);
        // Silence, then the first command's reply, late, then the second's.
        let (answer, transport) =
            ask([Err(TransportError::TimedOut), Ok(reply(2, 0, &[1, 1])), Ok(reply(2, 1, &[2, 2]))]);
        assert_eq!((answer.unwrap(), transport.sent.len()), (vec![2, 2], 2));
        // A damaged one.
        let (answer, _) = ask([Ok(b"RBx".to_vec()), Ok(reply(2, 1, &[3, 3]))]);
        assert_eq!(answer.unwrap(), [3, 3]);
    }

    #[test]
    fn what_is_never_answered_is_an_error_that_says_what_to_do() {
        let (answer, transport) = ask([]);
        let words = answer.unwrap_err().to_string();
        assert!(words.contains("read a register") && words.contains("unplug"), "{words}");
        assert_eq!(transport.sent.len(), ATTEMPTS as usize);
        let (answer, _) =
            ask([Ok(b"XXXXXXXX".to_vec()), Ok(b"RB".to_vec()), Ok(b"RB\x09\0\0\0\0\0".to_vec())]);
        assert!(matches!(answer, Err(DriverError::BadAnswer { .. })));
        let (answer, _) = ask([Err(TransportError::Gone)]);
        assert!(matches!(answer, Err(DriverError::Gone)));
    }

    proptest! {
        #[test]
        fn any_bytes_are_a_reply_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..64)) {
            if let Ok(message) = parse_reply(&bytes) {
                prop_assert_eq!(reply(message.command, message.tag, message.payload), bytes);
            }
        }

        #[test]
        fn a_reply_reads_back(which in any::<u16>(), tag in any::<u16>(), words in prop::collection::vec(any::<u16>(), 0..200)) {
            let payload: Vec<u8> = words.into_iter().flat_map(u16::to_le_bytes).collect();
            let bytes = reply(which, tag, &payload);
            prop_assert_eq!(parse_reply(&bytes), Ok(Message { command: which, tag, payload: &payload }));
        }
    }
}
