use std::{
    fmt,
    time::{Duration, Instant},
};

use bench_device::{DeviceError, Faults, Readback, Sticks, Time, VoltageOutput};
use bench_rig::{Actuation, Rig};
use firmware_proto::{
    Answer, ArmState, ChannelCalibration, Command, FirmwareVersion, FrameError, HostFrame, PROTOCOL_VERSION,
    WATCHDOG_MS, microvolts, volts,
};

use crate::{
    Calibration, ChannelLoop, DacError,
    clock::BoardClock,
    link::{Exchange, Link, LinkError, Outcome},
};

/// The channels' names, in the order of the protocol.
pub(crate) const CHANNELS: [&str; 4] = ["throttle", "pitch", "roll", "yaw"];

const DEVICE: &str = "the PSoC5";

/// The protocol's time-outs (docs/protocol.md, Timing).
const ANSWER: Duration = Duration::from_millis(50);
const SELF_TEST: Duration = Duration::from_secs(1);

/// How often a board that says nothing is asked who it is, for two and a half seconds in all: one that was just plugged in, or an emulator that
/// looks for its host once a second, needs a moment.
const HELLOS: u32 = 50;

/// How often anything else is asked outside of the loop, where a command may be repeated: a bad link loses one in many, five in a row is
/// another matter.
const ATTEMPTS: u32 = 5;

/// The outputs' range, V.
const RANGE_V: f64 = 3.3;

/// Levels of a calibration, V: multiples of the converter's 16 mV, so that its steps do not enter.
const LEVELS_V: [f64; 5] = [0.208, 0.8, 1.6, 2.4, 3.2];

/// What a wire between a VDAC8 and the converter may do at worst: data sheet, with half as much again.
const GAIN_ERROR: f64 = 0.08;
const OFFSET_V: f64 = 0.06;
const RESIDUAL_V: f64 = 0.02;

/// What an output at zero may read, V: the firmware's own limit.
const ZERO_V: f64 = 0.1;

/// A board that is connected.
#[derive(Debug)]
pub struct Psoc5 {
    port: String,
    link: Option<Link>,
    sequence: u16,
    clock: Option<BoardClock>,
    identity: Identity,
    calibration: Calibration,
    /// How long an answer is waited for within the loop.
    loop_timeout: Duration,
    period: Duration,
    sticks_min: f64,
    sticks_max: f64,
    armed: bool,
    awaited: Option<Awaited>,
    answered: Instant,
    device_time_us: u64,
    counts: LinkCounts,
}

#[derive(Debug)]
enum Awaited {
    Answer(crate::link::Pending),
    /// The thread was still busy with an earlier command.
    Nothing,
}

/// Who is on the port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Identity {
    /// Version of the firmware.
    pub firmware: FirmwareVersion,
    /// Calibration in the board's memory.
    pub stored: [ChannelCalibration; 4],
}

impl fmt::Display for Identity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let FirmwareVersion { major, minor, patch } = self.firmware;
        write!(f, "firmware {major}.{minor}.{patch}, protocol {PROTOCOL_VERSION}")
    }
}

/// What became of the commands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LinkCounts {
    /// Commands.
    pub asked: u64,
    /// Commands whose answer did not come in time; their outputs hold the value before.
    pub lost: u64,
    /// Voltages that reached the board after their deadline and were not applied.
    pub late: u64,
    /// Answers that came after they were given up.
    pub stale: u64,
    /// Stretches of bytes that were no frame.
    pub corrupt: u64,
}

/// How sure it is that the outputs are at zero.
#[derive(Clone, Debug, PartialEq)]
pub enum Safe {
    /// The board is disarmed and its outputs read zero.
    Confirmed {
        /// The port had to be opened again for that.
        reconnected: bool,
        /// What the board complained of before it was disarmed, as far as it could still be asked.
        faults: Faults,
    },
    /// Nobody answers; the board's own watchdog zeroes the outputs 300 ms after the last voltages.
    Unconfirmed(DacError),
}

impl Psoc5 {
    /// Connects to the board at a port for a rig: finds out who is there, sets its clock against the host's, and has it disarmed
    /// with its outputs at zero. The port's thread inherits the scheduling of the calling one.
    pub fn connect(port: &str, rig: &Rig) -> Result<Self, DacError> {
        if rig.airframe.actuation != Actuation::Volt {
            return Err(DacError::NotVolts { airframe: rig.airframe.name.clone() });
        }
        let period = Duration::from_secs_f64(rig.control_loop.period_s);
        let mut board = Self {
            port: port.to_owned(),
            link: None,
            sequence: 0,
            clock: None,
            identity: Identity {
                firmware: FirmwareVersion { major: 0, minor: 0, patch: 0 },
                stored: [ChannelCalibration::IDENTITY; 4],
            },
            calibration: Calibration::IDENTITY,
            // An answer may take 5 ms; half a period leaves the rest of the iteration its time.
            loop_timeout: (period / 2).clamp(Duration::from_millis(5), ANSWER),
            period,
            sticks_min: rig.airframe.sticks.min,
            sticks_max: rig.airframe.sticks.max,
            armed: false,
            awaited: None,
            answered: Instant::now(),
            device_time_us: 0,
            counts: LinkCounts::default(),
        };
        board.open()?;
        Ok(board)
    }

    /// Who is on the port.
    pub fn identity(&self) -> Identity {
        self.identity
    }

    /// What became of the commands so far.
    pub fn counts(&self) -> LinkCounts {
        self.counts
    }

    /// What the host corrects by.
    pub fn calibration(&self) -> Calibration {
        self.calibration
    }

    /// Measures the loop from outputs to inputs by driving the outputs, and corrects by it from then on. Only where nothing that
    /// can fly hangs on the outputs.
    pub fn calibrate(&mut self) -> Result<Calibration, DacError> {
        let mut points = [const { Vec::new() }; 4];
        for level_v in LEVELS_V {
            let read = self.self_test(level_v)?;
            for (points, read_v) in points.iter_mut().zip(read) {
                points.push((level_v, read_v));
            }
        }
        let mut calibration = Calibration::IDENTITY;
        for (i, points) in points.iter().enumerate() {
            let bad = |detail| DacError::BadLoop { port: self.port.clone(), channel: CHANNELS[i], detail };
            let fitted = ChannelLoop::fit(points).ok_or_else(|| bad("could not be measured".to_owned()))?;
            let ChannelLoop { gain, offset_v, residual_v } = fitted;
            if (gain - 1.0).abs() > GAIN_ERROR || offset_v.abs() > OFFSET_V || residual_v > RESIDUAL_V {
                return Err(bad(format!(
                    "reads {gain:.3} of what is set, {:+.0} mV off, up to {:.0} mV from a line",
                    offset_v * 1e3,
                    residual_v * 1e3
                )));
            }
            calibration.0[i] = fitted;
        }
        self.calibration = calibration;
        Ok(calibration)
    }

    /// The board's own check with its outputs left at zero, for where something that can fly hangs on them; corrects by what the
    /// board's memory has.
    pub fn check_at_zero(&mut self) -> Result<(), DacError> {
        self.self_test(0.0)?;
        let line = |stored: ChannelCalibration| ChannelLoop {
            gain: f64::from(stored.gain_ppm) / 1e6,
            offset_v: volts(stored.offset_uv),
            residual_v: 0.0,
        };
        self.calibration = Calibration(self.identity.stored.map(line));
        Ok(())
    }

    /// Lets the outputs leave zero; they must be set within 300 ms from now on.
    pub fn arm(&mut self) -> Result<(), DacError> {
        let faults = self.expect_zero(Command::Read)?;
        if faults.brown_out || faults.watchdog {
            return Err(self.not_safe("the board's supply sags; give it a better one"));
        }
        match self.ask(Command::Arm, ANSWER)?.answer {
            Answer::Readback { state: ArmState::Armed, .. } => {
                self.armed = true;
                self.answered = Instant::now();
                Ok(())
            }
            _ => Err(self.not_safe("the board did not arm; unplug it and plug it in again")),
        }
    }

    /// Outputs to zero, board disarmed. When the port went away it is opened again for as long as `patience`.
    pub fn make_safe(&mut self, patience: Duration) -> Safe {
        self.armed = false;
        self.awaited = None;
        let until = Instant::now() + patience;
        let mut faults = Faults::default();
        // Zero before all else; the faults, which disarming clears, before that.
        let asked = self.exchange(Command::Zero, ANSWER).or_else(|_| self.exchange(Command::Zero, ANSWER));
        if let Ok(Exchange { answer: Answer::Readback { faults: told, .. }, .. }) = asked {
            faults = from_board(told);
        }
        let mut error = match self.zero() {
            Ok(()) => return Safe::Confirmed { reconnected: false, faults },
            Err(error) => error,
        };
        while Instant::now() < until {
            // Opening begins with zeroing.
            self.link = None;
            match self.open() {
                Ok(()) => return Safe::Confirmed { reconnected: true, faults },
                Err(new @ (DacError::WrongFirmware { .. } | DacError::NotSafe { .. })) => {
                    return Safe::Unconfirmed(new);
                }
                Err(DacError::NotThere { .. }) => {}
                Err(new) => error = new,
            }
            std::thread::sleep(Duration::from_millis(50));
        }
        Safe::Unconfirmed(error)
    }

    fn open(&mut self) -> Result<(), DacError> {
        self.link = Some(Link::open(&self.port)?);
        self.identity = self.hello()?;
        self.zero()?;
        self.set_clock()
    }

    /// Asks who is there, until somebody says so.
    fn hello(&mut self) -> Result<Identity, DacError> {
        let mut silence = None;
        for _ in 0..HELLOS {
            match self.exchange(Command::Hello, ANSWER) {
                Ok(Exchange { answer: Answer::Hello { firmware, calibration }, .. }) => {
                    return Ok(Identity { firmware, stored: calibration });
                }
                Ok(_) => {
                    let detail = "the board answers `hello` with something else".to_owned();
                    return Err(DacError::WrongFirmware { port: self.port.clone(), detail });
                }
                // Something that speaks says more than silence.
                Err(error @ DacError::Corrupt { .. }) => silence = Some(error),
                Err(DacError::Timeout { .. }) => {}
                Err(error) => return Err(error),
            }
        }
        Err(silence.unwrap_or_else(|| self.timeout("hello", ANSWER * HELLOS)))
    }

    /// Outputs to zero, board disarmed, and both seen.
    fn zero(&mut self) -> Result<(), DacError> {
        self.expect_zero(Command::Disarm).map(|_| ())
    }

    fn expect_zero(&mut self, command: Command) -> Result<firmware_proto::Faults, DacError> {
        match self.ask(command, ANSWER)?.answer {
            Answer::Readback { voltages_uv, state, faults, .. } => {
                let off = voltages_uv.iter().position(|read_uv| volts(*read_uv).abs() > ZERO_V);
                if let Some(i) = off {
                    let (channel, read_v) = (CHANNELS[i], volts(voltages_uv[i]));
                    return Err(self.not_safe(&format!(
                        "{channel} reads {read_v:.3} V while it should be zero; check the wire to its input"
                    )));
                }
                if state != ArmState::Disarmed {
                    return Err(self.not_safe("the board does not disarm; unplug it and plug it in again"));
                }
                Ok(faults)
            }
            _ => Err(self.not_safe("the board does not say what its outputs are; flash its firmware anew")),
        }
    }

    /// A few exchanges; the shortest gives the clocks' offset.
    fn set_clock(&mut self) -> Result<(), DacError> {
        self.clock = None;
        self.device_time_us = 0;
        for _ in 0..8 {
            match self.exchange(Command::Read, ANSWER) {
                Ok(Exchange { answer: Answer::Readback { device_time_us, .. }, sent, received }) => {
                    match &mut self.clock {
                        Some(clock) => clock.update(sent, received, device_time_us),
                        None => self.clock = Some(BoardClock::new(sent, received, device_time_us)),
                    }
                }
                Ok(_) | Err(DacError::Timeout { .. } | DacError::Corrupt { .. }) => {}
                Err(error) => return Err(error),
            }
        }
        if self.clock.is_none() { Err(self.timeout("read", ANSWER * 8)) } else { Ok(()) }
    }

    /// What each channel reads at a level, V.
    fn self_test(&mut self, level_v: f64) -> Result<[f64; 4], DacError> {
        let level_uv = microvolts(level_v).unwrap_or(0);
        let answer = self.ask(Command::SelfTest { level_uv }, SELF_TEST)?.answer;
        let Answer::SelfTestReport { deviations_uv, passed, .. } = answer else {
            return Err(
                self.not_safe("the board does not say how its self-test went; flash its firmware anew")
            );
        };
        if !passed {
            let i = (0..4).max_by_key(|&i| deviations_uv[i].unsigned_abs()).unwrap_or(0);
            let off_v = volts(deviations_uv[i]);
            if off_v.abs() <= ZERO_V {
                return Err(self.not_safe("the board's supply is too low; give it a better one"));
            }
            let detail = format!("is {off_v:+.3} V off when {level_v:.3} V is set");
            return Err(DacError::BadLoop { port: self.port.clone(), channel: CHANNELS[i], detail });
        }
        Ok(std::array::from_fn(|i| {
            let stored = self.identity.stored[i];
            f64::from(stored.gain_ppm) / 1e6 * level_v + volts(stored.offset_uv) + volts(deviations_uv[i])
        }))
    }

    fn frame(&mut self, body: Command) -> HostFrame {
        self.sequence = self.sequence.checked_add(1).unwrap_or(1);
        self.counts.asked += 1;
        HostFrame { sequence: self.sequence, body }
    }

    /// A command outside of the loop, until it is answered.
    fn ask(&mut self, command: Command, timeout: Duration) -> Result<Exchange, DacError> {
        let mut outcome = self.exchange(command, timeout);
        for _ in 1..ATTEMPTS {
            if !matches!(outcome, Err(DacError::Timeout { .. } | DacError::Corrupt { .. })) {
                break;
            }
            outcome = self.exchange(command, timeout);
        }
        outcome
    }

    /// One exchange outside of the loop.
    fn exchange(&mut self, command: Command, timeout: Duration) -> Result<Exchange, DacError> {
        let name = name(&command);
        let frame = self.frame(command);
        let port = self.port.clone();
        let Some(link) = &mut self.link else {
            return Err(DacError::Unplugged { port, detail: "it was given up".to_owned() });
        };
        let Some(pending) = link.send(frame, timeout) else {
            return Err(self.timeout(name, timeout));
        };
        let outcome = link.receive(pending);
        self.count(&outcome);
        match outcome.result {
            Ok(Exchange { answer: Answer::WrongVersion { board_version, .. }, .. }) => {
                let detail =
                    format!("the board speaks protocol {board_version}, this bench {PROTOCOL_VERSION}");
                Err(DacError::WrongFirmware { port, detail })
            }
            Ok(Exchange { answer: Answer::ErrorReport { code, .. }, .. }) => {
                Err(DacError::Refused { port, command: name, code })
            }
            Ok(exchange) => Ok(exchange),
            Err(LinkError::Unplugged(kind)) => Err(DacError::Unplugged { port, detail: kind.to_string() }),
            Err(LinkError::Timeout { garbage: Some(FrameError::Version { received, .. }) }) => {
                let detail = format!("the board speaks protocol {received}, this bench {PROTOCOL_VERSION}");
                Err(DacError::WrongFirmware { port, detail })
            }
            Err(LinkError::Timeout { garbage: Some(garbage) }) => {
                Err(DacError::Corrupt { port, command: name, detail: garbage.to_string() })
            }
            Err(LinkError::Timeout { garbage: None }) => Err(self.timeout(name, timeout)),
        }
    }

    fn count(&mut self, outcome: &Outcome) {
        self.counts.stale += u64::from(outcome.stale);
        self.counts.corrupt += u64::from(outcome.corrupt);
        if let Err(LinkError::Timeout { .. }) = outcome.result {
            self.counts.lost += 1;
        }
    }

    fn timeout(&self, command: &'static str, waited: Duration) -> DacError {
        DacError::Timeout { port: self.port.clone(), command, waited }
    }

    fn not_safe(&self, detail: &str) -> DacError {
        DacError::NotSafe { port: self.port.clone(), detail: detail.to_owned() }
    }

    /// What to put on a channel so that it reads `wanted_v`. What only the correction takes beyond the outputs' range is the
    /// converter's shortcoming, not the caller's: it is cut here, and not flagged by the board.
    fn corrected_v(&self, channel: usize, wanted_v: f64) -> f64 {
        let set_v = self.calibration.0[channel].to_set(wanted_v);
        if (self.sticks_min..=self.sticks_max).contains(&wanted_v) {
            set_v.clamp(0.0, RANGE_V)
        } else {
            set_v
        }
    }

    fn gone(&self, detail: &str) -> DeviceError {
        DeviceError::Gone { device: DEVICE, detail: format!("{}: {detail}", self.port) }
    }

    fn failed(&self, detail: &str) -> DeviceError {
        DeviceError::Failed { device: DEVICE, detail: format!("{}: {detail}", self.port) }
    }

    /// An answer within the loop; `Ok(None)` when the voltages were not applied, or nobody knows.
    fn judge(&mut self, outcome: &Outcome) -> Result<Option<Readback>, DeviceError> {
        self.count(outcome);
        let exchange = match outcome.result {
            Ok(exchange) => exchange,
            Err(LinkError::Timeout { .. }) => return Ok(None),
            Err(LinkError::Unplugged(kind)) => return Err(self.gone(&kind.to_string())),
        };
        match exchange.answer {
            Answer::Readback { device_time_us, voltages_uv, state, faults } => {
                if device_time_us < self.device_time_us {
                    return Err(self.failed("it was reset in flight; check its supply"));
                }
                self.device_time_us = device_time_us;
                if let Some(clock) = &mut self.clock {
                    clock.update(exchange.sent, exchange.received, device_time_us);
                }
                if faults.brown_out {
                    return Err(
                        self.failed("its supply sagged and it zeroed its outputs; give it a better one")
                    );
                }
                if self.armed && state != ArmState::Armed {
                    return Err(self.failed("it is no longer armed; check its supply and the link"));
                }
                Ok(Some(Readback {
                    device_time: Time::from_nanos(device_time_us.saturating_mul(1000)),
                    sticks: Sticks::from_array(voltages_uv.map(volts)),
                    faults: from_board(faults),
                }))
            }
            Answer::ErrorReport { code: firmware_proto::ErrorCode::Late, .. } => {
                self.counts.late += 1;
                Ok(None)
            }
            Answer::ErrorReport { code: firmware_proto::ErrorCode::Tripped, .. } => Err(self.failed(
                "it tripped and zeroed its outputs: no voltages reached it for 300 ms, or its supply sagged",
            )),
            Answer::ErrorReport { code: firmware_proto::ErrorCode::NotArmed, .. } => {
                Err(self.failed("it is not armed; was it reset in flight? check its supply"))
            }
            _ => Ok(None),
        }
    }
}

impl VoltageOutput for Psoc5 {
    fn write(&mut self, sticks: Sticks) -> Result<(), DeviceError> {
        let wanted = sticks.to_array();
        for (channel, value) in CHANNELS.into_iter().zip(wanted) {
            if !value.is_finite() {
                return Err(DeviceError::BadCommand { device: DEVICE, channel, value });
            }
        }
        let now = Instant::now();
        let voltages_uv = std::array::from_fn(|i| {
            let set_v = self.corrected_v(i, wanted[i]);
            // Beyond what the wire can say is beyond the board's range too.
            microvolts(set_v).unwrap_or(if set_v > 0.0 { i32::MAX } else { i32::MIN })
        });
        let deadline_us = self.clock.map_or(0, |clock| clock.deadline_us(now, self.period));
        let frame = self.frame(Command::SetVoltages { deadline_us, voltages_uv });
        let timeout = self.loop_timeout;
        let Some(link) = &mut self.link else { return Err(self.gone("it was given up")) };
        self.awaited = Some(link.send(frame, timeout).map_or(Awaited::Nothing, Awaited::Answer));
        Ok(())
    }

    fn read_back(&mut self) -> Result<Option<Readback>, DeviceError> {
        let outcome = match (self.awaited.take(), &mut self.link) {
            (Some(Awaited::Answer(pending)), Some(link)) => link.receive(pending),
            _ => Outcome { result: Err(LinkError::Timeout { garbage: None }), stale: 0, corrupt: 0 },
        };
        let readback = self.judge(&outcome)?;
        let now = Instant::now();
        if readback.is_some() {
            self.answered = now;
        }
        let silent = now.saturating_duration_since(self.answered);
        // By now the board has zeroed its outputs.
        if silent > Duration::from_millis(WATCHDOG_MS) {
            return Err(DeviceError::TimedOut { device: DEVICE, waited_s: silent.as_secs_f64() });
        }
        Ok(readback)
    }
}

impl Drop for Psoc5 {
    fn drop(&mut self) {
        if self.armed {
            self.make_safe(Duration::ZERO);
        }
    }
}

fn from_board(faults: firmware_proto::Faults) -> Faults {
    let firmware_proto::Faults { watchdog, clamped, mismatch, brown_out } = faults;
    Faults { watchdog, clamped, mismatch, brown_out }
}

fn name(command: &Command) -> &'static str {
    match command {
        Command::Hello => "hello",
        Command::Arm => "arm",
        Command::Disarm => "disarm",
        Command::Zero => "zero",
        Command::Read => "read",
        Command::SetVoltages { .. } => "set_voltages",
        Command::SelfTest { .. } => "self_test",
    }
}
