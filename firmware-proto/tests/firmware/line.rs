use firmware_proto::{Answer, ArmState, Command, ErrorCode, HostFrame};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::scripted::{Board, encoded};

#[test]
fn garbage_and_half_frames_are_answered_by_name_and_the_next_frame_is_carried_out() {
    let mut board = Board::new();
    let read = encoded(&HostFrame { sequence: 7, body: Command::Read });
    let mut flipped = read.clone();
    flipped[3] ^= 0x10;
    let cases: [(&[u8], ErrorCode); 4] = [
        (&[&read[..4], &[0]].concat(), ErrorCode::Truncated),
        (&[&[b'x'; 100][..], &[0]].concat(), ErrorCode::OverLong),
        (&[9, 1, 0], ErrorCode::Stuffing),
        (&flipped, ErrorCode::Crc),
    ];
    for (bytes, expected) in cases {
        let events = board.receive(bytes);
        let answers = board.answers(&events);
        assert_eq!(answers.len(), 1, "{expected:?}: {answers:?}");
        assert_eq!(answers[0].sequence, 0);
        assert!(
            matches!(answers[0].body, Answer::ErrorReport { code, .. } if code == expected),
            "{answers:?}"
        );
        assert!(matches!(board.ask(Command::Read), Answer::Readback { .. }));
    }
}

#[test]
fn bytes_that_come_one_by_one_make_the_same_frame() {
    let mut board = Board::new();
    let mut answers = Vec::new();
    for byte in encoded(&HostFrame { sequence: 7, body: Command::Arm }) {
        let mut events = board.receive(&[byte]);
        events.extend(board.run_ms(3));
        answers.extend(board.answers(&events));
    }
    assert!(matches!(answers[..], [frame] if frame.sequence == 7), "{answers:?}");
}

#[test]
fn a_host_of_another_version_is_told_so() {
    let mut board = Board::new();
    // The golden example of docs/protocol.md: hello in version 2.
    let events = board.receive(&[0x04, 0x02, 0x01, 0x01, 0x05, 0xE1, 0x4C, 0x94, 0x93, 0x00]);
    let answers = board.answers(&events);
    assert!(
        matches!(answers[0].body, Answer::WrongVersion { board_version: 1, host_version: 2 }),
        "{answers:?}"
    );
}

#[test]
fn an_answer_without_room_is_dropped_and_its_command_carried_out() {
    let mut board = Board::new();
    board.order("full 1");
    let events = board.receive(&encoded(&HostFrame { sequence: 1, body: Command::Arm }));
    assert!(board.answers(&events).is_empty());
    board.order("full 0");
    assert!(matches!(board.ask(Command::Read), Answer::Readback { state: ArmState::Armed, .. }));
}

#[test]
fn noise_never_arms_a_board() {
    let mut board = Board::new();
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    for _ in 0..200 {
        let mut noise = vec![0; rng.random_range(1..500)];
        rng.fill_bytes(&mut noise);
        board.receive(&noise);
        assert_eq!(board.outputs, [0; 4]);
    }
    board.receive(&[0]);
    assert!(matches!(board.ask(Command::Read), Answer::Readback { state: ArmState::Disarmed, .. }));
}
