use std::collections::VecDeque;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// What is wrong with the link and the board. Nothing by default.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LinkFaults {
    /// Delay of each frame, either way, s.
    pub latency_s: f64,
    /// Added to that, evenly between 0 and this, s.
    pub jitter_s: f64,
    /// Probability that a frame is lost, either way.
    pub drop: f64,
    /// Probability that one bit of a frame flips, either way.
    pub corrupt: f64,
    /// The board hangs: from so many seconds after it was first armed, for so many seconds. What arrives meanwhile waits.
    pub stall: Option<(f64, f64)>,
    /// The port vanishes so many seconds after the board was first armed, and comes back after so many, if at all.
    pub unplug: Option<(f64, Option<f64>)>,
    /// The supply sags so many seconds after the board was first armed.
    pub brown_out: Option<f64>,
    /// Time constant with which the pins follow what they are set to, once the board is armed, s.
    pub dac_lag_s: f64,
    /// The throttle's pin is off by so much, once the board is armed, V.
    pub dac_offset_v: f64,
    /// The board speaks this protocol version instead.
    pub protocol_version: Option<u8>,
}

/// One direction of the link: frames go in, and come out later, altered, or not.
#[derive(Debug)]
pub(crate) struct Wire {
    faults: LinkFaults,
    rng: ChaCha8Rng,
    /// Frames by their time of arrival, us.
    queue: VecDeque<(u64, Vec<u8>)>,
}

impl Wire {
    pub fn new(faults: LinkFaults, seed: u64, stream: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(stream);
        Self { faults, rng, queue: VecDeque::new() }
    }

    pub fn put(&mut self, now_us: u64, mut bytes: Vec<u8>) {
        // All draws are made for every frame, so that one fault does not shift the others.
        let (lost, altered) = (self.rng.random::<f64>(), self.rng.random::<f64>());
        let (at, bit) = (self.rng.random_range(0..bytes.len().max(1)), self.rng.random_range(0..8));
        let delay_s = self.faults.latency_s + self.rng.random::<f64>() * self.faults.jitter_s;
        if lost < self.faults.drop {
            return;
        }
        if altered < self.faults.corrupt
            && let Some(byte) = bytes.get_mut(at)
        {
            *byte ^= 1 << bit;
        }
        // Frames do not overtake one another.
        let before_us = self.queue.back().map_or(0, |(at_us, _)| *at_us);
        self.queue.push_back(((now_us + (delay_s * 1e6) as u64).max(before_us), bytes));
    }

    /// The next frame, once it has arrived.
    pub fn take(&mut self, now_us: u64) -> Option<Vec<u8>> {
        if self.queue.front()?.0 > now_us {
            return None;
        }
        self.queue.pop_front().map(|(_, bytes)| bytes)
    }

    /// When the next frame arrives, us.
    pub fn due_us(&self) -> Option<u64> {
        self.queue.front().map(|(at_us, _)| *at_us)
    }

    pub fn clear(&mut self) {
        self.queue.clear();
    }
}
