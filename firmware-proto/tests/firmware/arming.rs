use firmware_proto::{Answer, ArmState, Command, ErrorCode, Faults};

use crate::scripted::{Board, Event};

const HOVER: [i32; 4] = [1_900_000, 1_650_000, 1_650_000, 1_650_000];

fn state(answer: Answer) -> (ArmState, Faults) {
    match answer {
        Answer::Readback { state, faults, .. } => (state, faults),
        other => panic!("no readback: {other:?}"),
    }
}

fn refusal(answer: Answer) -> ErrorCode {
    match answer {
        Answer::ErrorReport { code, .. } => code,
        other => panic!("not refused: {other:?}"),
    }
}

fn armed() -> Board {
    let mut board = Board::new();
    assert_eq!(state(board.ask(Command::Arm)), (ArmState::Armed, Faults::default()));
    board
}

#[test]
fn a_board_does_nothing_before_it_is_armed() {
    let mut board = Board::new();
    assert!(matches!(board.ask(Command::Hello), Answer::Hello { .. }));
    assert_eq!(refusal(board.set(HOVER)), ErrorCode::NotArmed);
    assert_eq!(state(board.ask(Command::Read)).0, ArmState::Disarmed);
    assert_eq!(board.outputs, [0; 4]);
}

#[test]
fn an_armed_board_follows_and_reads_back_what_the_loop_makes_of_it() {
    let mut board = armed();
    let Answer::Readback { voltages_uv, state, faults, .. } = board.set(HOVER) else { panic!() };
    assert_eq!((board.outputs, state, faults), (HOVER, ArmState::Armed, Faults::default()));
    // The loop's gain and offset are within 2 % and 11 mV, a step is 16 mV, noise 0.5 mV (boards/loop/loop.c).
    for (set, read) in HOVER.into_iter().zip(voltages_uv) {
        assert!((set - read).abs() < set / 50 + 11_000 + 8_000 + 500, "{set} {read}");
    }
    assert_eq!(state_of_zero(&mut board), ArmState::Armed);
    assert_eq!(board.outputs, [0; 4]);
}

fn state_of_zero(board: &mut Board) -> ArmState {
    state(board.ask(Command::Zero)).0
}

#[test]
fn outputs_move_no_faster_than_a_volt_a_millisecond_and_stop_at_the_range() {
    let mut board = armed();
    let sent = firmware_proto::HostFrame {
        sequence: 9,
        body: Command::SetVoltages {
            deadline_us: u64::MAX,
            voltages_uv: [5_000_000, -1, 3_300_001, i32::MIN],
        },
    };
    let events = board.receive(&crate::scripted::encoded(&sent));
    let throttle: Vec<_> = events
        .iter()
        .filter_map(|event| match *event {
            Event::Output { at_us, channel: 0, microvolts } => Some((at_us, microvolts)),
            _ => None,
        })
        .collect();
    for pair in throttle.windows(2) {
        let (elapsed_us, change_uv) = (pair[1].0 - pair[0].0, pair[1].1 - pair[0].1);
        assert!(u64::try_from(change_uv).unwrap() <= elapsed_us * 1000, "{pair:?}");
    }
    assert_eq!(board.outputs, [3_300_000, 0, 3_300_000, 0]);
    let answer = board.answers(&events)[0].body;
    assert!(state(answer).1.clamped);
    let Answer::Readback { device_time_us, .. } = answer else { unreachable!() };
    // The answer may take 5 ms.
    assert!(device_time_us - throttle[0].0 < 5000);
    assert!(!state(board.set(HOVER)).1.clamped, "the flag goes with the voltages");
}

#[test]
fn silence_trips_the_board_within_300_ms_and_only_voltages_count_as_life() {
    let mut board = armed();
    assert_eq!(state(board.set(HOVER)).0, ArmState::Armed);
    let mut tripped_us = None;
    let mut fed_us = 0;
    for _ in 0..40 {
        // A host whose loop hangs while its other threads talk.
        if let Answer::Readback { device_time_us, .. } = board.ask(Command::Read) {
            fed_us = if fed_us == 0 { device_time_us } else { fed_us };
        }
        board.ask(Command::Arm);
        board.ask(Command::SetVoltages { deadline_us: 0, voltages_uv: HOVER });
        for event in board.run_ms(10) {
            if let Event::Signal { at_us, name } = event
                && name == "tripped"
            {
                tripped_us = Some(at_us);
            }
        }
    }
    let silent_us = tripped_us.expect("it trips") - fed_us;
    assert!((250_000..=300_000).contains(&silent_us), "{silent_us}");
    assert_eq!(board.outputs, [0; 4]);
    assert_eq!(refusal(board.set(HOVER)), ErrorCode::Tripped);
    assert_eq!(refusal(board.ask(Command::Arm)), ErrorCode::Tripped);
    assert_eq!(refusal(board.ask(Command::SelfTest { level_uv: 0 })), ErrorCode::Tripped);
    let (now, faults) = state(board.ask(Command::Read));
    assert_eq!((now, faults.watchdog), (ArmState::Tripped, true));
    assert_eq!(state(board.ask(Command::Disarm)), (ArmState::Disarmed, Faults::default()));
    assert_eq!(state(board.ask(Command::Arm)).0, ArmState::Armed);
}

#[test]
fn a_board_that_was_armed_and_then_forgotten_trips_too() {
    let mut board = armed();
    board.run_ms(301);
    assert_eq!(state(board.ask(Command::Read)).0, ArmState::Tripped);
}

#[test]
fn voltages_in_time_keep_it_armed_and_late_ones_change_nothing() {
    let mut board = armed();
    for tick in 0..100 {
        let throttle_uv = 1_900_000 + tick * 1000;
        assert_eq!(state(board.set([throttle_uv, 0, 0, 0])).0, ArmState::Armed);
        board.run_ms(100);
    }
    let before = board.outputs;
    let answer = board.ask(Command::SetVoltages { deadline_us: 1, voltages_uv: [0; 4] });
    assert_eq!(refusal(answer), ErrorCode::Late);
    assert_eq!(board.outputs, before);
}

#[test]
fn a_supply_that_falls_zeroes_the_outputs_and_is_remembered() {
    let mut board = armed();
    board.set(HOVER);
    board.order("supply 0");
    assert_eq!(board.outputs, [0; 4]);
    let (now, faults) = state(board.ask(Command::Read));
    assert_eq!((now, faults.brown_out), (ArmState::Tripped, true));
    // Disarming clears it only if it is over.
    board.ask(Command::Disarm);
    assert_eq!(refusal(board.ask(Command::Arm)), ErrorCode::NotReady);
    board.order("supply 1");
    assert_eq!(refusal(board.ask(Command::Arm)), ErrorCode::NotReady);
    board.ask(Command::Disarm);
    assert_eq!(state(board.ask(Command::Arm)).0, ArmState::Armed);
}

#[test]
fn a_reset_disarms_restarts_the_clock_and_tells_a_brown_out() {
    let mut board = armed();
    board.set(HOVER);
    board.run_ms(50);
    board.order("reset 1");
    assert_eq!(board.outputs, [0; 4]);
    let Answer::Readback { device_time_us, state, faults, .. } = board.ask(Command::Read) else { panic!() };
    assert!(device_time_us < 50_000);
    assert_eq!((state, faults.brown_out), (ArmState::Disarmed, true));
}

#[test]
fn a_broken_wire_shows_in_the_self_test_and_keeps_an_output_that_is_not_zero_from_arming() {
    let mut board = Board::new();
    let test = Command::SelfTest { level_uv: 1_600_000 };
    let Answer::SelfTestReport { passed, deviations_uv, .. } = board.ask(test) else { panic!() };
    // 2 % of 1.6 V, 11 mV, 0.5 mV: boards/loop/loop.c.
    assert!(passed && deviations_uv.iter().all(|d| d.abs() < 43_500), "{deviations_uv:?}");
    board.order("open 2");
    let Answer::SelfTestReport { passed, deviations_uv, .. } = board.ask(test) else { panic!() };
    assert!(!passed && deviations_uv[2] == -1_600_000, "{deviations_uv:?}");
    assert_eq!(board.outputs, [0; 4]);
    board.ask(Command::Arm);
    assert!(state(board.set(HOVER)).1.mismatch);
    assert_eq!(refusal(board.ask(test)), ErrorCode::Armed);
}
