//! A link at its worst: what both decoders make of millions of random and altered bytes.

use std::collections::HashSet;

use firmware_proto::{Answer, Command, DELIMITER, Decoder};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::c;
use crate::random::{Generate, board_frame, host_frame};
use crate::text::{Direction, encoded, transcript};

/// For each decoder; half of it noise, half altered frames.
const BYTES: usize = 10_000_000;

fn noise(rng: &mut ChaCha8Rng) -> Vec<u8> {
    let len = rng.random_range(1..100);
    // Small bytes make plausible stuffing codes and many delimiters.
    let top = if rng.random() { u8::MAX } else { 12 };
    (0..len).map(|_| rng.random_range(0..=top)).collect()
}

/// One of the things that links do to bytes.
fn alter(wire: &mut Vec<u8>, rng: &mut ChaCha8Rng) {
    if wire.is_empty() {
        return;
    }
    let at = rng.random_range(0..wire.len());
    let end = rng.random_range(at..wire.len());
    match rng.random_range(0..6) {
        0 => wire[at] ^= 1 << rng.random_range(0..8),
        1 => wire[at] = rng.random(),
        2 => wire.insert(at, rng.random()),
        3 => drop(wire.drain(at..=end)),
        4 => wire.extend_from_within(at..=end),
        _ => wire[at..=end].reverse(),
    }
}

/// Streams of noise, whole frames and altered frames, and the text of every frame that was put into them.
fn bad_link<B: Direction>(generate: Generate<B>, rng: &mut ChaCha8Rng) -> (Vec<u8>, HashSet<String>) {
    let mut stream = Vec::new();
    let mut sent = HashSet::new();
    while stream.len() < BYTES / 2 {
        stream.extend(noise(rng));
    }
    stream.push(DELIMITER);
    while stream.len() < BYTES {
        let frame = generate(rng);
        let mut wire = encoded(&frame);
        for _ in 0..rng.random_range(0..4) {
            alter(&mut wire, rng);
        }
        sent.insert(format!("{} {}", B::SENDER, B::describe(&frame)));
        stream.extend(wire);
    }
    (stream, sent)
}

/// Both decoders say the same about each piece, and accept no frame that was not sent.
///
/// An altered frame passes a 32-bit checksum with probability 2^-32. Hundreds of thousands of altered pieces make about
/// 1e-4 accepted ones, so that the right number is none, and the seed is fixed.
fn assert_accepts_only_what_was_sent<B: Direction>(generate: Generate<B>, seed: u64) {
    let (stream, sent) = bad_link(generate, &mut ChaCha8Rng::seed_from_u64(seed));
    let transcript = transcript::<B>(&stream, true);
    assert!(c::decode(B::SENDER, &stream) == transcript, "the decoders differ");

    let lines = || transcript.lines().filter(|line| line.starts_with(B::SENDER));
    let rejected = lines().filter(|line| line.contains(" rejected ")).count();
    let failed_crc = lines().filter(|line| line.ends_with(" rejected crc")).count();
    let accepted: Vec<_> = lines().filter(|line| !line.contains(" rejected ")).collect();
    let corrupt = accepted.iter().filter(|line| !sent.contains(**line)).count();
    println!(
        "{}: {} bytes, {} frames accepted, {rejected} pieces rejected, {failed_crc} by the checksum alone, \
         {corrupt} corrupt accepted ({:.0e} expected)",
        B::SENDER,
        stream.len(),
        accepted.len(),
        rejected as f64 / 2_f64.powi(32)
    );
    assert_eq!(corrupt, 0);
    // The odds were put to the test: whole frames do get through, and the checksum had work to do.
    assert!(accepted.len() > 10_000 && failed_crc > 10_000);
}

#[test]
fn the_board_accepts_only_what_was_sent() {
    assert_accepts_only_what_was_sent::<Command>(host_frame, 3);
}

#[test]
fn the_host_accepts_only_what_was_sent() {
    assert_accepts_only_what_was_sent::<Answer>(board_frame, 4);
}

/// Content as a faulty sender would seal it: altered first, then given a right checksum.
fn faulty_sender<B: Direction>(generate: Generate<B>, rng: &mut ChaCha8Rng) -> Vec<u8> {
    let mut content = encoded(&generate(rng));
    let len = cobs::decode_in_place(&mut content).expect("a frame is well stuffed");
    content.truncate(len - 4);
    alter(&mut content, rng);
    let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(&content);
    content.extend(crc.to_le_bytes());
    let mut wire = vec![DELIMITER; content.len() + 3];
    let len = cobs::try_encode(&content, &mut wire).expect("room for the stuffing");
    wire.truncate(len + 1);
    wire
}

fn assert_same_verdicts_on_faulty_senders<B: Direction>(generate: Generate<B>, seed: u64) -> String {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let stream: Vec<u8> = (0..20_000).flat_map(|_| faulty_sender(generate, &mut rng)).collect();
    let transcript = transcript::<B>(&stream, true);
    assert!(c::decode(B::SENDER, &stream) == transcript, "the decoders differ");
    transcript
}

#[test]
fn both_decoders_agree_on_what_lies_beyond_the_checksum() {
    let host = assert_same_verdicts_on_faulty_senders::<Command>(host_frame, 5);
    let board = assert_same_verdicts_on_faulty_senders::<Answer>(board_frame, 6);
    for reason in ["truncated", "version", "unknown_type", "length"] {
        assert!(host.contains(&format!("host rejected {reason}")), "{reason} never came");
    }
    assert!(board.contains("board rejected value"));
}

/// Pushes an altered frame and whatever delimiter it may have lost.
fn accepts<B: Direction>(wire: &[u8]) -> bool {
    let mut decoder = Decoder::<B>::new();
    wire.iter().chain(&[DELIMITER]).any(|&byte| matches!(decoder.push(byte), Some(Ok(_))))
}

/// Shorter frames have fewer places to go wrong, so that the longest of the loop's traffic speaks for them.
#[test]
fn no_one_or_two_flipped_bits_get_through() {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let frame = std::iter::repeat_with(|| host_frame(&mut rng))
        .find(|frame| matches!(frame.body, Command::SetVoltages { .. }))
        .expect("the generator never ends");
    let mut wire = encoded(&frame);
    let bits = wire.len() * 8;
    let flip = |wire: &mut Vec<u8>, bit: usize| wire[bit / 8] ^= 1 << (bit % 8);
    for first in 0..bits {
        flip(&mut wire, first);
        assert!(!accepts::<Command>(&wire), "bit {first}");
        for second in first + 1..bits {
            flip(&mut wire, second);
            assert!(!accepts::<Command>(&wire), "bits {first} and {second}");
            flip(&mut wire, second);
        }
        flip(&mut wire, first);
    }
}
