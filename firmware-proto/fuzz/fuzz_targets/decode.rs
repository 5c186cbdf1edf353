//! Any bytes into the Rust decoders: no panic, and an accepted frame encodes to the bytes it came from.
//!
//! The input goes in twice: as a stream, and as content with a right checksum, which a fuzzer does not find by itself.

#![no_main]

use crc::{CRC_32_ISO_HDLC, Crc};
use firmware_proto::{Answer, Body, Command, DELIMITER, Decoder, MAX_WIRE_LEN};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| {
    let sealed = seal(input);
    for stream in [input, &sealed] {
        check::<Command>(stream);
        check::<Answer>(stream);
    }
});

fn check<B: Body>(stream: &[u8]) {
    let mut decoder = Decoder::<B>::new();
    for (at, &byte) in stream.iter().enumerate() {
        if let Some(Ok(frame)) = decoder.push(byte) {
            let mut wire = [0; MAX_WIRE_LEN];
            let len = frame.encode(&mut wire).expect("no frame is longer than the longest");
            assert!(stream[..=at].ends_with(&wire[..len]));
        }
    }
}

fn seal(content: &[u8]) -> Vec<u8> {
    let crc = Crc::<u32>::new(&CRC_32_ISO_HDLC).checksum(content);
    let sealed = [content, &crc.to_le_bytes()].concat();
    let mut wire = vec![DELIMITER; cobs::max_encoding_length(sealed.len()) + 1];
    let len = cobs::try_encode(&sealed, &mut wire).expect("room for the stuffing");
    wire.truncate(len + 1);
    wire
}
