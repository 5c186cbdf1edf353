//! From packets to images, with what was lost of them.

use std::ops::AddAssign;

use crate::frame::Mask;

use super::packet::{Header, Position, Stream};

/// As many packets may be lost in a row; the sequence number of eight bits tells no more apart with confidence (libfreenect's limit).
pub const MOST_LOST: u8 = 5;

/// What became of a stream's packets.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Images handed on.
    pub images: u64,
    /// Of these, without some of their pixels.
    pub masked: u64,
    /// Images given up, because too much was lost or packets contradicted one another.
    pub refused: u64,
    /// Packets taken.
    pub packets: u64,
    /// Packets that are missing in images that were handed on or given up.
    pub lost: u64,
    /// Packets that were none of the stream, or of the wrong length.
    pub malformed: u64,
}

impl AddAssign for Counts {
    fn add_assign(&mut self, other: Self) {
        self.images += other.images;
        self.masked += other.masked;
        self.refused += other.refused;
        self.packets += other.packets;
        self.lost += other.lost;
        self.malformed += other.malformed;
    }
}

/// An image that is complete, as far as it came. The buffers may be swapped for others of the same length.
#[derive(Debug)]
pub struct Image<'a> {
    /// The stream's bytes; where packets were lost, what was there before.
    pub data: &'a mut Box<[u8]>,
    /// Which pixels were received.
    pub received: &'a mut Mask,
    /// Device time, 60 MHz.
    pub ticks: u32,
}

/// Puts the packets of one stream together.
///
/// Packets that are missing, by the sequence number, leave their pixels marked as lost. When more than [`MOST_LOST`] are missing in a row,
/// or a packet says that it belongs elsewhere than it should, the image is given up and the next one's beginning waited for.
#[derive(Debug)]
pub struct Assembler {
    stream: Stream,
    data: Box<[u8]>,
    received: Mask,
    /// The packet to come; `None` while an image's beginning is waited for.
    next: Option<Next>,
    ticks: u32,
    counts: Counts,
}

#[derive(Clone, Copy, Debug)]
struct Next {
    index: usize,
    sequence: u8,
    /// Whether anything of the image has come.
    begun: bool,
}

impl Assembler {
    /// One that waits for an image's beginning.
    pub fn new(stream: Stream) -> Self {
        Self {
            stream,
            data: vec![0; stream.image_bytes()].into_boxed_slice(),
            received: Mask::whole(),
            next: None,
            ticks: 0,
            counts: Counts::default(),
        }
    }

    /// What became of the packets so far.
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// Takes a packet; hands an image that is complete with it, or that it shows to be over, to `take`. Empty packets are what the
    /// device sends between images.
    pub fn packet(&mut self, packet: &[u8], take: impl FnMut(Image<'_>)) {
        if packet.is_empty() {
            return;
        }
        match Header::parse(self.stream, packet) {
            Some((header, data)) => self.place(header, data, take),
            // Whether it was one of the image's shows in the next packet's number.
            None => self.counts.malformed += 1,
        }
    }

    fn place(&mut self, header: Header, data: &[u8], mut take: impl FnMut(Image<'_>)) {
        let mut next = match self.next {
            Some(next) => match self.gap(next, header, &mut take) {
                Some(next) => next,
                None => return,
            },
            None if header.position == Position::First => {
                self.received.reset();
                Next { index: 0, sequence: header.sequence, begun: false }
            }
            None => return,
        };
        let place = self.stream.place(next.index);
        if data.len() != place.len() {
            // The next packet's number tells that this one is missing.
            self.counts.malformed += 1;
            self.next = Some(next);
            return;
        }
        self.data[place].copy_from_slice(data);
        self.counts.packets += 1;
        self.ticks = header.ticks;
        next = Next { index: next.index + 1, sequence: header.sequence.wrapping_add(1), begun: true };
        if next.index == self.stream.packets() {
            self.hand_on(&mut take);
            next = Next { index: 0, begun: false, ..next };
        }
        self.next = Some(next);
    }

    /// Accounts for packets missing before this one; returns where this one belongs, or nothing when it belongs nowhere.
    fn gap(&mut self, mut next: Next, header: Header, take: &mut impl FnMut(Image<'_>)) -> Option<Next> {
        let missing = header.sequence.wrapping_sub(next.sequence);
        next.sequence = header.sequence;
        if missing > MOST_LOST {
            return self.resync(next, header);
        }
        if missing > 0 {
            self.counts.lost += u64::from(missing);
            let (missing, left) = (usize::from(missing), self.stream.packets() - next.index);
            if missing < left {
                self.lose(next.index, next.index + missing);
                next.index += missing;
                next.begun = true;
            } else {
                self.lose(next.index, self.stream.packets());
                // Nothing of an image is no image.
                if next.begun {
                    self.hand_on(take);
                }
                next.index = missing - left;
                next.begun = next.index > 0;
                self.lose(0, next.index);
            }
        }
        if header.position == self.stream.position(next.index) {
            Some(next)
        } else {
            self.resync(next, header)
        }
    }

    fn resync(&mut self, next: Next, header: Header) -> Option<Next> {
        self.counts.refused += u64::from(next.begun);
        self.received.reset();
        self.next = None;
        // A beginning is a beginning, whatever went before.
        (header.position == Position::First).then_some(Next {
            index: 0,
            sequence: header.sequence,
            begun: false,
        })
    }

    fn lose(&mut self, from: usize, to: usize) {
        if from < to {
            let bytes = self.stream.place(from).start..self.stream.place(to - 1).end;
            self.received.lose(self.stream.pixels(bytes));
        }
    }

    fn hand_on(&mut self, take: &mut impl FnMut(Image<'_>)) {
        self.counts.images += 1;
        self.counts.masked += u64::from(!self.received.is_whole());
        take(Image { data: &mut self.data, received: &mut self.received, ticks: self.ticks });
        self.received.reset();
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::frame::PIXELS;

    /// Packets of images numbered from zero, whose bytes are the image's number plus one; the stream's numbers run on.
    fn packets(stream: Stream, images: usize) -> Vec<Vec<u8>> {
        let whole = stream.packets();
        (0..images * whole)
            .map(|number| {
                let (image, index) = (number / whole, number % whole);
                let length = stream.place(index).len();
                let header = Header {
                    position: stream.position(index),
                    sequence: number as u8,
                    ticks: 1000 * image as u32,
                };
                let mut bytes = header.bytes(stream, length).to_vec();
                bytes.resize(bytes.len() + length, image as u8 + 1);
                bytes
            })
            .collect()
    }

    struct Taken {
        data: Vec<u8>,
        received: Mask,
        ticks: u32,
    }

    fn assemble<'a>(stream: Stream, packets: impl IntoIterator<Item = &'a Vec<u8>>) -> (Vec<Taken>, Counts) {
        let mut assembler = Assembler::new(stream);
        let mut taken = Vec::new();
        for packet in packets {
            assembler.packet(packet, |image| {
                taken.push(Taken {
                    data: image.data.to_vec(),
                    received: image.received.clone(),
                    ticks: image.ticks,
                });
            });
        }
        (taken, assembler.counts())
    }

    fn without(packets: &[Vec<u8>], lost: impl Fn(usize) -> bool) -> Vec<&Vec<u8>> {
        packets.iter().enumerate().filter(|(i, _)| !lost(*i)).map(|(_, packet)| packet).collect()
    }

    #[test]
    fn images_come_whole_with_their_time_whatever_lies_between() {
        for stream in Stream::ALL {
            let all = packets(stream, 3);
            let empty = Vec::new();
            let spaced = all.iter().flat_map(|packet| [&empty, packet, &empty]);
            let (taken, counts) = assemble(stream, spaced);
            assert_eq!((counts.images, counts.masked, counts.refused, counts.lost), (3, 0, 0, 0));
            for (i, image) in taken.iter().enumerate() {
                assert!(image.data.iter().all(|byte| *byte == i as u8 + 1) && image.received.is_whole());
                assert_eq!(image.ticks, 1000 * i as u32);
            }
        }
    }

    #[test]
    fn lost_packets_cost_their_pixels_and_nothing_else() {
        let stream = Stream::Depth;
        let all = packets(stream, 2);
        let (taken, counts) = assemble(stream, without(&all, |i| (250..253).contains(&i)));
        assert_eq!((counts.images, counts.masked, counts.lost), (2, 1, 3));
        let lost = stream.pixels(stream.place(8).start..stream.place(10).end);
        for pixel in 0..PIXELS {
            assert_eq!(taken[1].received.received(pixel), !lost.contains(&pixel), "pixel {pixel}");
        }
    }

    #[test]
    fn a_gap_across_two_images_ends_the_one_and_begins_the_other() {
        let stream = Stream::Colour;
        let all = packets(stream, 3);
        // The last two of one, the first two of the next.
        let (taken, counts) = assemble(stream, without(&all, |i| (160..164).contains(&i)));
        assert_eq!((counts.images, counts.masked, counts.refused, counts.lost), (3, 2, 0, 4));
        assert_eq!(taken[0].received.lost(), stream.place(160).len() + stream.place(161).len());
        assert_eq!(taken[1].received.lost(), 2 * stream.piece());
        assert!(!taken[1].received.received(0) && taken[1].received.received(2 * stream.piece()));
        assert_eq!([taken[0].ticks, taken[1].ticks], [0, 1000]);
        assert!(taken[2].received.is_whole());
    }

    #[test]
    fn too_large_a_gap_costs_the_image_and_the_next_is_whole() {
        for stream in Stream::ALL {
            let all = packets(stream, 3);
            let whole = stream.packets();
            let (taken, counts) = assemble(stream, without(&all, |i| (whole + 10..whole + 16).contains(&i)));
            assert_eq!((counts.images, counts.masked, counts.refused), (2, 0, 1));
            assert_eq!([taken[0].data[0], taken[1].data[0]], [1, 3]);
        }
    }

    #[test]
    fn a_stream_that_is_joined_in_its_middle_waits_for_a_beginning() {
        let all = packets(Stream::Depth, 2);
        let (taken, counts) = assemble(Stream::Depth, &all[100..]);
        assert_eq!((taken.len(), taken[0].data[0], counts.refused), (1, 2, 0));
    }

    #[test]
    fn packets_that_are_cut_or_foreign_count_as_lost() {
        let stream = Stream::Colour;
        let mut all = packets(stream, 2);
        all[20].truncate(100);
        all[21][0] = b'X';
        all[22][3] = 0x72;
        let (taken, counts) = assemble(stream, &all);
        assert_eq!((counts.images, counts.masked, counts.malformed, counts.lost), (2, 1, 3, 3));
        assert_eq!(taken[0].received.lost(), 3 * stream.piece());
        assert!(taken[1].received.is_whole());
    }

    #[test]
    fn a_packet_that_contradicts_its_number_costs_the_image() {
        let stream = Stream::Colour;
        let mut all = packets(stream, 3);
        all[stream.packets() + 30][3] = 0x81;
        let (taken, counts) = assemble(stream, &all);
        // The false beginning is taken for one, and the image that it begins is given up as well.
        assert_eq!((counts.images, counts.refused), (2, 2));
        assert!(taken.iter().all(|image| image.received.is_whole()));
        assert_eq!([taken[0].data[0], taken[1].data[0]], [1, 3]);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]

        /// Whatever is lost: what is said to be received is what was sent.
        #[test]
        fn no_pixel_that_is_said_to_be_received_is_another(lost in prop::collection::vec(0..486_usize, 0..60), runs in prop::collection::vec((0..486_usize, 1..20_usize), 0..3)) {
            let stream = Stream::Colour;
            let all = packets(stream, 3);
            let gone = |i: usize| lost.contains(&i) || runs.iter().any(|(from, count)| (*from..from + count).contains(&i));
            let (taken, counts) = assemble(stream, without(&all, gone));
            prop_assert!(taken.len() <= 3);
            for image in &taken {
                let number = (image.ticks / 1000) as u8 + 1;
                for pixel in 0..PIXELS {
                    prop_assert!(!image.received.received(pixel) || image.data[pixel] == number);
                }
            }
            prop_assert_eq!(counts.images, taken.len() as u64);
        }

        #[test]
        fn any_bytes_are_survived(bytes in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..40), 0..40)) {
            let mut assembler = Assembler::new(Stream::Depth);
            for packet in &bytes {
                assembler.packet(packet, |_| {});
            }
            prop_assert_eq!(assembler.counts().images, 0);
        }
    }
}
