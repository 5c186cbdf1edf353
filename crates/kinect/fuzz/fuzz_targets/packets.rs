//! Any packets into the assembler: no panic, and no pixel that is said to be received holds anything but what a packet had for it.
//!
//! Four bytes of input make a packet: how many are skipped before it, what it says of its place, how long it is, what it holds. A fuzzer
//! does not find right lengths and numbers by itself.

#![no_main]

use bench_kinect::{
    frame::PIXELS,
    usb::{
        Stream,
        assembly::Assembler,
        packet::{Header, Position},
    },
};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| {
    raw(input);
    made(input);
});

/// The input as it is, cut into packets.
fn raw(input: &[u8]) {
    for stream in Stream::ALL {
        let mut assembler = Assembler::new(stream);
        for packet in input.chunks(64) {
            assembler.packet(packet, |_| panic!("no image has so few bytes"));
        }
    }
}

/// Packets that make sense as far as the input lets them. All hold the number of the image that they are of.
fn made(input: &[u8]) {
    let stream = Stream::Colour;
    let whole = stream.packets();
    let mut assembler = Assembler::new(stream);
    let (mut number, mut images, mut bytes) = (0, 0, Vec::new());
    for word in input.as_chunks::<4>().0 {
        let [skip, place, length, run] = *word;
        // Mostly none.
        number += usize::from(skip.saturating_sub(200));
        for _ in 0..=run {
            let (image, index) = (number / whole, number % whole);
            let position = match place {
                0..240 => stream.position(index),
                240..245 => Position::First,
                245..250 => Position::Middle,
                _ => Position::Last,
            };
            let header = Header { position, sequence: number as u8, ticks: image as u32 };
            bytes.clear();
            let data = stream.place(index).len().saturating_sub(usize::from(length.saturating_sub(240)));
            bytes.extend(header.bytes(stream, data));
            bytes.resize(bytes.len() + data, image as u8);
            number += 1;
            assembler.packet(&bytes, |found| {
                images += 1;
                // Fewer than 256 packets in a row were skipped, so an image is of one number, but for one that lost its beginning.
                for pixel in 0..PIXELS {
                    assert!(!found.received.received(pixel) || found.data[pixel] == found.ticks as u8);
                }
            });
        }
    }
    let counts = assembler.counts();
    assert_eq!(counts.images, images);
    assert!(counts.masked <= counts.images);
}
