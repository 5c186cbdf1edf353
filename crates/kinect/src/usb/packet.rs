//! Packets of the two image streams: a header of twelve bytes, then a piece of the image. Facts: `OpenKinect`'s protocol documentation
//! and libfreenect.

use crate::frame::{PACKED_DEPTH_BYTES, PIXELS};

/// Bytes of a packet's header.
pub const HEADER: usize = 12;
/// Longest packet, bytes: what the endpoints take in a microframe.
pub const PACKET: usize = 1920;

/// The two image streams.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stream {
    /// Bayer, 8 bits.
    Colour,
    /// Disparity, packed 11 bits.
    Depth,
}

impl Stream {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Colour, Self::Depth];

    /// The stream's endpoint, direction bit included.
    pub const fn endpoint(self) -> u8 {
        match self {
            Self::Colour => 0x81,
            Self::Depth => 0x82,
        }
    }

    /// What the flags of its packets begin with.
    const fn base(self) -> u8 {
        match self {
            Self::Colour => 0x80,
            Self::Depth => 0x70,
        }
    }

    /// Bytes of an image in all packets but the last.
    pub const fn piece(self) -> usize {
        match self {
            Self::Colour => 1908,
            Self::Depth => 1748,
        }
    }

    /// Bytes of an image.
    pub const fn image_bytes(self) -> usize {
        match self {
            Self::Colour => PIXELS,
            Self::Depth => PACKED_DEPTH_BYTES,
        }
    }

    /// Packets of an image.
    pub const fn packets(self) -> usize {
        self.image_bytes().div_ceil(self.piece())
    }

    /// Where in the image a packet's bytes lie.
    pub fn place(self, index: usize) -> std::ops::Range<usize> {
        let begin = index * self.piece();
        begin..(begin + self.piece()).min(self.image_bytes())
    }

    /// Which pixels have a bit in a range of the image's bytes.
    pub fn pixels(self, bytes: std::ops::Range<usize>) -> std::ops::Range<usize> {
        match self {
            Self::Colour => bytes,
            Self::Depth => bytes.start * 8 / 11..(bytes.end * 8).div_ceil(11),
        }
    }

    /// What a packet at a place in the image should say of itself.
    pub fn position(self, index: usize) -> Position {
        match index {
            0 => Position::First,
            index if index + 1 == self.packets() => Position::Last,
            _ => Position::Middle,
        }
    }
}

/// Where in an image a packet says that it belongs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Position {
    /// At its beginning.
    First = 1,
    /// Between.
    Middle = 2,
    /// At its end.
    Last = 5,
}

/// A packet's header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// Where it belongs.
    pub position: Position,
    /// Counts the stream's packets, wraps.
    pub sequence: u8,
    /// Device time of the image, 60 MHz, wraps.
    pub ticks: u32,
}

impl Header {
    /// Reads a stream's packet; `None` when it is none. Length and sequence are for who puts packets together.
    pub fn parse(stream: Stream, packet: &[u8]) -> Option<(Self, &[u8])> {
        let (header, data) = packet.split_first_chunk::<HEADER>()?;
        let [b'R', b'B', _, flag, _, sequence, _, _, t0, t1, t2, t3] = *header else { return None };
        let position = match flag.checked_sub(stream.base())? {
            1 => Position::First,
            2 => Position::Middle,
            5 => Position::Last,
            _ => return None,
        };
        Some((Self { position, sequence, ticks: u32::from_le_bytes([t0, t1, t2, t3]) }, data))
    }

    /// The header as bytes; `length` is that of the data. Bytes of unknown meaning are the packet's length, as seen on the wire, and zero.
    pub fn bytes(&self, stream: Stream, length: usize) -> [u8; HEADER] {
        let [high, low] = ((HEADER + length) as u16).to_be_bytes();
        let [t0, t1, t2, t3] = self.ticks.to_le_bytes();
        [b'R', b'B', 0, stream.base() | self.position as u8, 0, self.sequence, high, low, t0, t1, t2, t3]
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn streams_have_the_shape_that_was_seen_on_real_devices() {
        assert_eq!((Stream::Colour.packets(), Stream::Depth.packets()), (162, 242));
        assert_eq!((Stream::Colour.place(161).len(), Stream::Depth.place(241).len()), (12, 1132));
        assert!(Stream::ALL.iter().all(|stream| stream.piece() + HEADER <= PACKET));
    }

    #[test]
    fn a_lost_byte_costs_every_pixel_that_has_a_bit_in_it() {
        // Byte 1 holds the end of pixel 0 and the beginning of pixel 1; byte 11 begins pixel 8.
        assert_eq!(Stream::Depth.pixels(1..2), 0..2);
        assert_eq!(Stream::Depth.pixels(11..12), 8..9);
        assert_eq!(Stream::Depth.pixels(0..11), 0..8);
        assert_eq!(Stream::Depth.pixels(Stream::Depth.place(241)).end, PIXELS);
        for byte in 0..44 {
            let touched: Vec<_> =
                (0..40).filter(|pixel| (pixel * 11 / 8..=(pixel * 11 + 10) / 8).contains(&byte)).collect();
            assert_eq!(Stream::Depth.pixels(byte..byte + 1).collect::<Vec<_>>(), touched, "byte {byte}");
        }
    }

    proptest! {
        #[test]
        fn headers_read_back(sequence in any::<u8>(), ticks in any::<u32>(), which in 0..3_usize) {
            for stream in Stream::ALL {
                let position = [Position::First, Position::Middle, Position::Last][which];
                let header = Header { position, sequence, ticks };
                let packet = [header.bytes(stream, 1).as_slice(), &[42]].concat();
                prop_assert_eq!(Header::parse(stream, &packet), Some((header, [42].as_slice())));
            }
        }
    }
}
