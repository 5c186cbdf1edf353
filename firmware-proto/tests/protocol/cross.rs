//! Random frames from Rust to C and back.

use std::fmt::Write;

use firmware_proto::{Answer, Command};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::c;
use crate::random::{Generate, board_frame, host_frame};
use crate::text::{Direction, encoded, hex, transcript};

const FRAMES: usize = 10_000;

fn assert_that_c_reads_and_returns<B: Direction>(generate: Generate<B>, seed: u64) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut stream = Vec::new();
    let mut expected = String::new();
    for _ in 0..FRAMES {
        let frame = generate(&mut rng);
        let wire = encoded(&frame);
        writeln!(expected, "{} {}\n  {}", B::SENDER, B::describe(&frame), hex(&wire)).unwrap();
        stream.extend(wire);
    }
    assert!(c::decode(B::SENDER, &stream) == expected, "C read or wrote a frame otherwise than Rust");
    assert!(transcript::<B>(&stream, true) == expected, "Rust does not read what it wrote");
}

#[test]
fn c_reads_and_returns_what_rust_writes_for_the_board() {
    assert_that_c_reads_and_returns::<Command>(host_frame, 1);
}

#[test]
fn c_reads_and_returns_what_rust_writes_for_the_host() {
    assert_that_c_reads_and_returns::<Answer>(board_frame, 2);
}
