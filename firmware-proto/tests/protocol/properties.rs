//! Properties of every frame and every stream.

use firmware_proto::{Answer, BufferTooSmall, Command, DELIMITER, Decoder, Frame, MAX_WIRE_LEN};
use proptest::collection::vec;
use proptest::prelude::*;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::random::{Generate, board_frame, host_frame};
use crate::text::{Direction, encoded};

fn frame<B: Direction + std::fmt::Debug>(generate: Generate<B>) -> impl Strategy<Value = Frame<B>> {
    any::<u64>().prop_map(move |seed| generate(&mut ChaCha8Rng::seed_from_u64(seed)))
}

/// Bytes as a broken link gives them: any, and many zeros and small codes, on which the stuffing hinges.
fn stream() -> impl Strategy<Value = Vec<u8>> {
    vec(prop_oneof![any::<u8>(), 0..8_u8], 0..400)
}

fn assert_survives_the_wire<B: Direction + PartialEq + std::fmt::Debug>(frame: &Frame<B>) {
    let wire = encoded(frame);
    assert_eq!(wire.iter().position(|&byte| byte == DELIMITER), Some(wire.len() - 1));
    let mut decoder = Decoder::<B>::new();
    let events: Vec<_> = wire.iter().filter_map(|&byte| decoder.push(byte)).collect();
    assert_eq!(events.len(), 1);
    assert_eq!(events[0].as_ref(), Ok(frame));
}

fn assert_accepts_only_what_it_would_send<B: Direction>(stream: &[u8]) {
    let mut decoder = Decoder::<B>::new();
    for (at, &byte) in stream.iter().enumerate() {
        if let Some(Ok(frame)) = decoder.push(byte) {
            assert!(stream[..=at].ends_with(&encoded(&frame)));
        }
    }
}

fn assert_in_step_after<B: Direction + PartialEq + std::fmt::Debug>(garbage: &[u8], frame: &Frame<B>) {
    let mut decoder = Decoder::<B>::new();
    for &byte in garbage.iter().chain(&[DELIMITER]) {
        decoder.push(byte);
    }
    let first = encoded(frame).into_iter().find_map(|byte| decoder.push(byte));
    assert_eq!(first.as_ref().map(Result::as_ref), Some(Ok(frame)));
}

proptest! {
    #[test]
    fn a_command_survives_the_wire(frame in frame(host_frame)) {
        assert_survives_the_wire(&frame);
    }

    #[test]
    fn an_answer_survives_the_wire(frame in frame(board_frame)) {
        assert_survives_the_wire(&frame);
    }

    #[test]
    fn any_stream_is_taken_without_panic(stream in stream()) {
        assert_accepts_only_what_it_would_send::<Command>(&stream);
        assert_accepts_only_what_it_would_send::<Answer>(&stream);
    }

    #[test]
    fn the_next_delimiter_brings_the_decoder_into_step(
        garbage in stream(), command in frame(host_frame), answer in frame(board_frame),
    ) {
        assert_in_step_after(&garbage, &command);
        assert_in_step_after(&garbage, &answer);
    }

    #[test]
    fn a_short_buffer_is_refused(frame in frame(board_frame), available in 0..MAX_WIRE_LEN) {
        let needed = encoded(&frame).len();
        let result = frame.encode(&mut vec![0xAA; available]);
        if available < needed {
            prop_assert_eq!(result, Err(BufferTooSmall { needed, available }));
        } else {
            prop_assert_eq!(result, Ok(needed));
        }
    }
}
