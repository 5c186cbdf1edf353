//! An hour of a bad link and a bad host, in the board's own time.

use std::collections::VecDeque;

use firmware_proto::{Command, Decoder, HostFrame, WATCHDOG_MS};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::scripted::{Board, Event, encoded};

/// What stands for the truth beside the board: the bytes as they reached it, read by the other implementation.
#[derive(Default)]
struct Oracle {
    decoder: Decoder<Command>,
    /// When voltages last arrived intact and in time, us.
    fresh_us: Option<u64>,
    /// The most that an output may hold: on its way from where it was to what the newest fresh frame asks, uV.
    allowed_uv: [i32; 4],
    outputs: [i32; 4],
    checked: u64,
}

impl Oracle {
    /// Bytes reach the board at `now_us`.
    fn arrive(&mut self, now_us: u64, bytes: &[u8]) {
        for &byte in bytes {
            if let Some(Ok(frame)) = self.decoder.push(byte)
                && let Command::SetVoltages { deadline_us, voltages_uv } = frame.body
                && now_us <= deadline_us
            {
                self.fresh_us = Some(now_us);
                self.allowed_uv = std::array::from_fn(|i| voltages_uv[i].max(self.outputs[i]));
            }
        }
    }

    /// Every change of an output, and the passing of time up to `until_us`, must be covered by a fresh frame.
    fn check(&mut self, events: &[Event], until_us: u64) {
        for event in events {
            if let Event::Output { at_us, channel, microvolts } = *event {
                self.covered(at_us);
                let allowed_uv = self.allowed_uv[channel];
                assert!(microvolts <= allowed_uv, "at {at_us}: {microvolts} of {allowed_uv} uV allowed");
                self.outputs[channel] = microvolts;
            }
        }
        self.covered(until_us);
    }

    fn covered(&mut self, at_us: u64) {
        self.checked += 1;
        if self.outputs != [0; 4] {
            let fresh_us = self.fresh_us.expect("an output left zero without a frame");
            let age_us = at_us - fresh_us;
            assert!(age_us <= WATCHDOG_MS * 1000, "at {at_us}: outputs {:?}, {age_us} us old", self.outputs);
        }
    }
}

/// What the link makes of a frame: mostly itself.
fn mangled(mut bytes: Vec<u8>, rng: &mut ChaCha8Rng) -> Vec<u8> {
    match rng.random_range(0..100) {
        0..3 => bytes.clear(),
        3..6 => {
            let at = rng.random_range(0..bytes.len());
            bytes[at] ^= 1 << rng.random_range(0..8);
        }
        6 => bytes.truncate(rng.random_range(0..bytes.len())),
        7 => bytes.extend_from_within(..),
        8 => {
            let mut noise = vec![0; rng.random_range(1..80)];
            rng.fill_bytes(&mut noise);
            bytes.splice(0..0, noise);
        }
        _ => {}
    }
    bytes
}

#[test]
fn an_hour_of_link_faults_never_leaves_an_output_without_a_fresh_frame() {
    const HOUR_US: u64 = 3_600_000_000;
    const STEP_US: u64 = 5_000;
    const TICK_US: u64 = 20_000;
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let (mut board, mut oracle) = (Board::new(), Oracle::default());
    // Frames on their way to the board, each with its time of arrival.
    let mut link: VecDeque<(u64, Vec<u8>)> = VecDeque::new();
    let (mut tick_us, mut sequence) = (0, 0_u16);
    let (mut host_silent_until, mut link_stalled_until) = (0, 0);
    let (mut trips, mut applied) = (0, 0);
    while board.now_us < HOUR_US {
        let now_us = board.now_us;
        if now_us >= tick_us {
            tick_us += TICK_US;
            match rng.random_range(0..2000) {
                0 => host_silent_until = now_us + rng.random_range(50_000..3_000_000),
                1 => link_stalled_until = now_us + rng.random_range(50_000..2_000_000),
                _ => {}
            }
            let throttle_uv = 1_500_000 + rng.random_range(0..800_000);
            let deadline_us = now_us + TICK_US + 5_000;
            let voltages_uv = [throttle_uv, 1_650_000, 1_650_000, 0];
            let mut said = vec![Command::SetVoltages { deadline_us, voltages_uv }];
            // A host that recovers: about once a second it starts from the beginning.
            if rng.random_range(0..50) == 0 {
                said.splice(0..0, [Command::Disarm, Command::Arm]);
            }
            if now_us < host_silent_until {
                said.clear();
            }
            for body in said {
                sequence = sequence.checked_add(1).unwrap_or(1);
                let bytes = mangled(encoded(&HostFrame { sequence, body }), &mut rng);
                let delay_us = if rng.random_range(0..20) == 0 { rng.random_range(0..400_000) } else { 1000 };
                let before_us = link.back().map_or(0, |(last_us, _)| *last_us);
                link.push_back(((now_us + delay_us).max(link_stalled_until).max(before_us), bytes));
            }
        }
        let mut count = |events: &[Event]| {
            for event in events {
                if let Event::Signal { name, .. } = event {
                    trips += u32::from(name == "tripped");
                    applied += u32::from(name == "applied");
                }
            }
        };
        while link.front().is_some_and(|(at_us, _)| *at_us <= now_us) {
            let (_, bytes) = link.pop_front().unwrap();
            if !bytes.is_empty() {
                oracle.arrive(board.now_us, &bytes);
                let events = board.receive(&bytes);
                oracle.check(&events, board.now_us);
                count(&events);
            }
        }
        let events = board.order(&format!("run {STEP_US}"));
        oracle.check(&events, board.now_us);
        count(&events);
    }
    println!("{applied} frames applied, {trips} trips, {} checks", oracle.checked);
    // The campaign must have met what it is about: flights and trips.
    assert!(applied > 50_000 && trips > 50, "{applied} {trips}");
}
