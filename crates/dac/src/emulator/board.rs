use firmware_proto::{
    Answer, ArmState, BoardFrame, ChannelCalibration, Command, ErrorCode, Faults, FirmwareVersion, HostFrame,
    PROTOCOL_VERSION, WATCHDOG_MS,
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// The firmware's limits: `firmware-proto/firmware/app.h`.
const RANGE_UV: i32 = 3_300_000;
const SLEW_UV_PER_US: u64 = 1000;
const MISMATCH_UV: i32 = 100_000;
const SETTLE_US: u64 = 2000;
const WATCHDOG_US: u64 = WATCHDOG_MS * 1000 - 10_000;

/// A VDAC8 in its 4.08 V range.
const STEP_UV: i32 = 16_000;
/// Largest deviation of a measurement, uV.
const NOISE_UV: i32 = 500;
/// Gain and offset of the loops from output to input, as a data sheet allows.
const LOOPS: [(f64, f64); 4] = [(0.985, 9000.0), (1.012, -6000.0), (0.995, 4000.0), (1.02, 11_000.0)];

/// What the board does with commands and time, all in microseconds of its own clock, which must not run back.
#[derive(Debug)]
pub struct Board {
    state: ArmState,
    watchdog: bool,
    brown_out: bool,
    clamped: bool,
    set_uv: [i32; 4],
    /// Pins by the law of [`Board::with_lag`]: what they head for, and where they were when that was set.
    pins: [Pin; 4],
    lag_us: f64,
    /// What the throttle's pin is off by once the board is armed, uV.
    offset_uv: f64,
    fed_us: u64,
    noise: ChaCha8Rng,
    history: Vec<Moment>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Pin {
    from_uv: f64,
    to_uv: f64,
    since_us: u64,
}

/// What the outputs were set to, from when on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Moment {
    /// By the board's clock, us.
    pub at_us: u64,
    /// Throttle, pitch, roll, yaw, uV.
    pub set_uv: [i32; 4],
    /// The state from then on.
    pub state: ArmState,
    /// This came of voltages from the host.
    pub applied: bool,
}

impl Board {
    /// A board after its reset. Once it is armed its pins follow with a time constant `lag_s`, s, and the throttle's is off by
    /// `offset_v`, V; 0 for neither.
    pub fn new(seed: u64, lag_s: f64, offset_v: f64) -> Self {
        Self {
            state: ArmState::Disarmed,
            watchdog: false,
            brown_out: false,
            clamped: false,
            set_uv: [0; 4],
            pins: LOOPS.map(|(_, offset_uv)| Pin { from_uv: offset_uv, to_uv: offset_uv, since_us: 0 }),
            lag_us: lag_s * 1e6,
            offset_uv: offset_v * 1e6,
            fed_us: 0,
            noise: ChaCha8Rng::seed_from_u64(seed),
            history: Vec::new(),
        }
    }

    /// Whether the outputs may leave zero.
    pub fn state(&self) -> ArmState {
        self.state
    }

    /// Everything that changed the outputs or the state since the last call, oldest first.
    pub fn take_history(&mut self) -> Vec<Moment> {
        std::mem::take(&mut self.history)
    }

    /// Lets time pass.
    pub fn pass(&mut self, now_us: u64) {
        if self.state == ArmState::Armed && now_us - self.fed_us >= WATCHDOG_US {
            self.watchdog = true;
            self.leave_armed(now_us, ArmState::Tripped);
        }
    }

    /// When [`Board::pass`] next does something, if no command comes before, us.
    pub fn due_us(&self) -> Option<u64> {
        (self.state == ArmState::Armed).then_some(self.fed_us + WATCHDOG_US)
    }

    /// The supply sags and recovers.
    pub fn brown_out(&mut self, now_us: u64) {
        self.brown_out = true;
        if self.state == ArmState::Armed {
            self.leave_armed(now_us, ArmState::Tripped);
        }
    }

    /// Carries out a command; returns the answer and when it is given.
    pub fn carry_out(&mut self, now_us: u64, command: &HostFrame) -> (BoardFrame, u64) {
        self.pass(now_us);
        let mut at_us = now_us;
        let body = match command.body {
            Command::Hello => Answer::Hello {
                firmware: FirmwareVersion { major: 1, minor: 0, patch: 0 },
                calibration: [ChannelCalibration::IDENTITY; 4],
            },
            Command::Arm => self.arm(now_us),
            Command::Disarm => {
                (self.watchdog, self.brown_out) = (false, false);
                self.leave_armed(now_us, ArmState::Disarmed);
                self.readback(now_us)
            }
            Command::Zero => {
                self.zero(now_us);
                self.remember(now_us, false);
                self.readback(now_us)
            }
            Command::Read => self.readback(now_us),
            Command::SetVoltages { deadline_us, voltages_uv } => match self.state {
                ArmState::Disarmed => refusal(now_us, ErrorCode::NotArmed),
                ArmState::Tripped => refusal(now_us, ErrorCode::Tripped),
                ArmState::Armed if now_us > deadline_us => refusal(now_us, ErrorCode::Late),
                ArmState::Armed => {
                    at_us += self.apply(now_us, voltages_uv);
                    self.readback(at_us)
                }
            },
            Command::SelfTest { level_uv } => match self.state {
                ArmState::Armed => refusal(now_us, ErrorCode::Armed),
                ArmState::Tripped => refusal(now_us, ErrorCode::Tripped),
                ArmState::Disarmed => {
                    at_us += 4 * SETTLE_US;
                    self.self_test(now_us, level_uv.clamp(0, RANGE_UV))
                }
            },
        };
        (BoardFrame { sequence: command.sequence, body }, at_us)
    }

    /// Sets the outputs; returns how long they slew, us.
    fn apply(&mut self, now_us: u64, voltages_uv: [i32; 4]) -> u64 {
        self.fed_us = now_us;
        let target_uv = voltages_uv.map(|uv| uv.clamp(0, RANGE_UV));
        self.clamped = target_uv != voltages_uv;
        let way_uv = (0..4).map(|i| target_uv[i].abs_diff(self.set_uv[i])).max().unwrap_or(0);
        for (i, uv) in target_uv.into_iter().enumerate() {
            self.set(now_us, i, uv);
        }
        self.remember(now_us, true);
        u64::from(way_uv).div_ceil(SLEW_UV_PER_US)
    }

    fn arm(&mut self, now_us: u64) -> Answer {
        match self.state {
            ArmState::Tripped => refusal(now_us, ErrorCode::Tripped),
            ArmState::Armed => self.readback(now_us),
            ArmState::Disarmed => {
                let measured = self.measure(now_us);
                let off = (0..4).any(|i| self.deviates(i, measured[i]));
                if off || self.brown_out || self.watchdog {
                    return refusal(now_us, ErrorCode::NotReady);
                }
                self.state = ArmState::Armed;
                self.fed_us = now_us;
                self.remember(now_us, false);
                self.readback(now_us)
            }
        }
    }

    fn self_test(&mut self, now_us: u64, level_uv: i32) -> Answer {
        let mut deviations_uv = [0; 4];
        for (i, deviation) in deviations_uv.iter_mut().enumerate() {
            let began_us = now_us + i as u64 * SETTLE_US;
            self.set(began_us, i, level_uv);
            *deviation = self.measure_one(began_us + SETTLE_US, i) - level_uv;
            self.set(began_us + SETTLE_US, i, 0);
        }
        let passed = deviations_uv.iter().all(|uv| uv.abs() <= MISMATCH_UV) && !self.brown_out;
        Answer::SelfTestReport { device_time_us: now_us + 4 * SETTLE_US, deviations_uv, passed }
    }

    fn readback(&mut self, now_us: u64) -> Answer {
        let voltages_uv = self.measure(now_us);
        let mismatch = (0..4).any(|i| self.deviates(i, voltages_uv[i]));
        let Self { state, watchdog, clamped, brown_out, .. } = *self;
        let faults = Faults { watchdog, clamped, mismatch, brown_out };
        Answer::Readback { device_time_us: now_us, voltages_uv, state, faults }
    }

    fn deviates(&self, channel: usize, measured_uv: i32) -> bool {
        (measured_uv - self.set_uv[channel]).abs() > MISMATCH_UV
    }

    fn measure(&mut self, now_us: u64) -> [i32; 4] {
        std::array::from_fn(|i| self.measure_one(now_us, i))
    }

    fn measure_one(&mut self, now_us: u64, channel: usize) -> i32 {
        let pin_uv = self.pins[channel].at(now_us, self.lag_us());
        pin_uv.round() as i32 + self.noise.random_range(-NOISE_UV..=NOISE_UV)
    }

    fn set(&mut self, now_us: u64, channel: usize, uv: i32) {
        self.set_uv[channel] = uv;
        let stepped = f64::from((uv + STEP_UV / 2) / STEP_UV * STEP_UV);
        let (gain, offset_uv) = LOOPS[channel];
        let from_uv = self.pins[channel].at(now_us, self.lag_us());
        let off_uv = if channel == 0 && self.state == ArmState::Armed { self.offset_uv } else { 0.0 };
        self.pins[channel] = Pin { from_uv, to_uv: gain * stepped + offset_uv + off_uv, since_us: now_us };
    }

    /// A lag, or an offset, from the beginning would be found by the calibration, and never fly.
    fn lag_us(&self) -> f64 {
        if self.state == ArmState::Armed { self.lag_us } else { 0.0 }
    }

    fn zero(&mut self, now_us: u64) {
        for channel in 0..4 {
            self.set(now_us, channel, 0);
        }
        self.clamped = false;
    }

    fn leave_armed(&mut self, now_us: u64, state: ArmState) {
        self.zero(now_us);
        self.state = state;
        self.remember(now_us, false);
    }

    fn remember(&mut self, at_us: u64, applied: bool) {
        self.history.push(Moment { at_us, set_uv: self.set_uv, state: self.state, applied });
    }
}

impl Pin {
    /// First-order lag; at once when there is none.
    fn at(&self, now_us: u64, lag_us: f64) -> f64 {
        if lag_us <= 0.0 {
            return self.to_uv;
        }
        let elapsed_us = now_us.saturating_sub(self.since_us) as f64;
        self.to_uv + (self.from_uv - self.to_uv) * (-elapsed_us / lag_us).exp()
    }
}

fn refusal(device_time_us: u64, code: ErrorCode) -> Answer {
    Answer::ErrorReport { device_time_us, code }
}

/// What a board of another protocol version says to every frame.
pub(crate) fn foreign(version: u8, sequence: u16) -> BoardFrame {
    let body = Answer::WrongVersion { board_version: version, host_version: PROTOCOL_VERSION };
    BoardFrame { sequence, body }
}
