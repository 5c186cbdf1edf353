//! USB/IP as `vhci_hcd` speaks it (the kernel documents it as "USB/IP protocol"): big-endian, 48 bytes of header.

use std::io::{self, Read};

const SUBMIT: u32 = 1;
const UNLINK: u32 = 2;
const RET_SUBMIT: u32 = 3;
const RET_UNLINK: u32 = 4;

pub(crate) const HEADER_LEN: usize = 48;
const PACKET_LEN: usize = 16;

/// Longest transfer accepted, bytes: above what any driver here asks for.
const LONGEST: u32 = 1 << 20;

/// "Connection reset by peer": what the kernel wants to hear of a request that was taken back.
const ECONNRESET: i32 = 104;

/// One request of the kernel to a device: a USB request block.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Urb {
    /// The kernel's number for it.
    pub(crate) sequence: u32,
    /// Endpoint, without the direction bit.
    pub endpoint: u8,
    /// To the host.
    pub to_host: bool,
    /// How many bytes the host takes or sends.
    pub length: u32,
    /// First frame of an isochronous transfer.
    pub start_frame: u32,
    /// Packets of an isochronous transfer; else none.
    pub packets: Vec<Packet>,
    /// The setup packet of endpoint 0.
    pub(crate) setup: [u8; 8],
    /// What the host sends.
    pub data: Vec<u8>,
}

/// Where a packet of an isochronous transfer lies in its buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Packet {
    /// From the buffer's beginning, bytes.
    pub offset: u32,
    /// At most, bytes.
    pub length: u32,
}

/// What the kernel asks.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Request {
    Submit(Urb),
    /// Take back the request numbered `victim`.
    Unlink {
        sequence: u32,
        victim: u32,
    },
}

impl Request {
    pub fn read(stream: &mut impl Read) -> io::Result<Self> {
        let mut header = [0; HEADER_LEN];
        stream.read_exact(&mut header)?;
        let word =
            |at: usize| u32::from_be_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]]);
        let bad = |detail| io::Error::new(io::ErrorKind::InvalidData, detail);
        let sequence = word(4);
        match word(0) {
            UNLINK => Ok(Self::Unlink { sequence, victim: word(20) }),
            SUBMIT => {
                let (to_host, length) = (word(12) == 1, word(24));
                // Transfers that are not isochronous say 0 or -1.
                let packets = if word(32) == u32::MAX { 0 } else { word(32) };
                if length > LONGEST || packets > LONGEST / PACKET_LEN as u32 {
                    return Err(bad("a transfer is too long"));
                }
                let mut data = vec![0; if to_host { 0 } else { length as usize }];
                stream.read_exact(&mut data)?;
                let mut table = vec![0; packets as usize * PACKET_LEN];
                stream.read_exact(&mut table)?;
                let packets = table
                    .chunks_exact(PACKET_LEN)
                    .map(|entry| {
                        let word = |at: usize| {
                            u32::from_be_bytes([entry[at], entry[at + 1], entry[at + 2], entry[at + 3]])
                        };
                        Packet { offset: word(0), length: word(4) }
                    })
                    .collect();
                let mut setup = [0; 8];
                setup.copy_from_slice(&header[40..48]);
                let (endpoint, start_frame) = (word(16) as u8, word(28));
                Ok(Self::Submit(Urb {
                    sequence,
                    endpoint,
                    to_host,
                    length,
                    start_frame,
                    packets,
                    setup,
                    data,
                }))
            }
            other => Err(bad(if other == 0 { "an empty request" } else { "an unknown request" })),
        }
    }
}

fn header(words: [u32; 12]) -> Vec<u8> {
    words.into_iter().flat_map(u32::to_be_bytes).collect()
}

/// The answer to a transfer: `status` is 0 or a negative errno.
pub(crate) fn submitted(urb: &Urb, status: i32, actual: u32, data: &[u8]) -> Vec<u8> {
    let mut reply = header([
        RET_SUBMIT,
        urb.sequence,
        0,
        0,
        0,
        status.cast_unsigned(),
        actual,
        urb.start_frame,
        0,
        0,
        0,
        0,
    ]);
    reply.extend_from_slice(data);
    reply
}

/// The answer to an isochronous transfer to the host: a packet each, which may be empty. Data comes without the gaps.
pub(crate) fn streamed(urb: &Urb, packets: &[&[u8]]) -> Vec<u8> {
    let fitted: Vec<&[u8]> = urb
        .packets
        .iter()
        .enumerate()
        .map(|(i, packet)| {
            let data = packets.get(i).copied().unwrap_or_default();
            &data[..data.len().min(packet.length as usize)]
        })
        .collect();
    let actual = fitted.iter().map(|data| data.len() as u32).sum();
    let count = urb.packets.len() as u32;
    let mut reply = header([RET_SUBMIT, urb.sequence, 0, 0, 0, 0, actual, urb.start_frame, count, 0, 0, 0]);
    for data in &fitted {
        reply.extend_from_slice(data);
    }
    for (packet, data) in urb.packets.iter().zip(&fitted) {
        for word in [packet.offset, packet.length, data.len() as u32, 0] {
            reply.extend_from_slice(&word.to_be_bytes());
        }
    }
    reply
}

/// The answer to taking a request back: whether it was still there to be taken.
pub(crate) fn unlinked(sequence: u32, was_pending: bool) -> Vec<u8> {
    let status = if was_pending { -ECONNRESET } else { 0 };
    header([RET_UNLINK, sequence, 0, 0, 0, status.cast_unsigned(), 0, 0, 0, 0, 0, 0])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A request of an isochronous transfer to the host on endpoint 1, as the kernel writes it.
    fn isochronous(packets: &[(u32, u32)]) -> Vec<u8> {
        let length: u32 = packets.iter().map(|(_, length)| length).sum();
        let words = [SUBMIT, 7, 0, 1, 1, 0, length, 42, packets.len() as u32, 8, 0, 0];
        let table = packets.iter().flat_map(|(offset, length)| [*offset, *length, 0, 0]);
        words.into_iter().chain(table).flat_map(u32::to_be_bytes).collect()
    }

    #[test]
    fn isochronous_packets_come_without_gaps_and_say_how_long_they_are() {
        let bytes = isochronous(&[(0, 100), (100, 100), (200, 100)]);
        let Request::Submit(urb) = Request::read(&mut bytes.as_slice()).unwrap() else { panic!() };
        assert_eq!((urb.endpoint, urb.to_host, urb.length, urb.packets.len()), (1, true, 300, 3));
        // The second slot stays empty, the third is longer than its slot.
        let reply = streamed(&urb, &[&[1; 40], &[], &[3; 120]]);
        let word = |at: usize| u32::from_be_bytes(reply[at..at + 4].try_into().unwrap());
        assert_eq!(
            [word(0), word(4), word(20), word(24), word(28), word(32)],
            [RET_SUBMIT, 7, 0, 140, 42, 3]
        );
        assert_eq!(reply[48..88], [1; 40]);
        assert_eq!(reply[88..188], [3; 100]);
        let table: Vec<u32> = (188..reply.len()).step_by(4).map(word).collect();
        assert_eq!(table, [0, 100, 40, 0, 100, 100, 0, 0, 200, 100, 100, 0]);
    }

    #[test]
    fn what_is_no_request_is_an_error_and_not_an_allocation() {
        let request =
            |words: [u32; 12]| -> Vec<u8> { words.into_iter().flat_map(u32::to_be_bytes).collect() };
        for words in [
            [0; 12],
            [9, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
            [SUBMIT, 1, 0, 0, 2, 0, u32::MAX, 0, 0, 0, 0, 0],
            [SUBMIT, 1, 0, 1, 2, 0, 64, 0, u32::MAX - 1, 0, 0, 0],
        ] {
            let error = Request::read(&mut request(words).as_slice()).unwrap_err();
            assert_eq!(error.kind(), io::ErrorKind::InvalidData, "{words:?}");
        }
    }
}
