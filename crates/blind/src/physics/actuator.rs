//! From the command to the pins, and from the pins to what the motors hear.

use super::law::{Law, Memory, Now, Place, Push};

/// What goes wrong between command and pins; the readback shows it.
#[derive(Clone, Debug)]
pub(crate) enum OutputFault {
    /// The output bends away before a level, in units of the sticks.
    SoftLimit { level: f64, softness: f64 },
    /// The highest output falls as the supply does.
    FallingLimit { level: f64, fall_per_min: f64 },
    /// Steps that round down.
    Floor { step: f64 },
    /// Steps that are long and short by turns.
    Uneven { step: f64 },
    /// The output stays until the command has gone far enough, then jumps to it.
    Stiction { width: f64 },
    /// Play that creeps shut.
    CreepingPlay { width: f64, creep: f64 },
    /// The reference drifts as the board warms up: outside the library.
    WarmReference { drift: f64, warm_up_min: f64 },
}

/// A converter of so many bits over the sticks' range.
#[derive(Clone, Debug)]
pub(crate) struct Converter {
    pub min: f64,
    pub max: f64,
    /// One step; zero for a continuous output.
    pub step: f64,
    pin: f64,
}

impl Converter {
    pub(crate) fn new(min: f64, max: f64, bits: u32) -> Self {
        let step = if bits == 0 { 0.0 } else { (max - min) / (f64::from(bits).exp2() - 1.0) };
        Self { min, max, step, pin: min }
    }

    /// Writes a command and returns where the pin goes.
    pub(crate) fn write(&mut self, command: f64, session_min: f64, fault: Option<&OutputFault>) -> f64 {
        let asked = command.clamp(self.min, self.max);
        let bent = fault.map_or(asked, |fault| self.bend(fault, asked, session_min));
        let pin = match fault {
            Some(OutputFault::Floor { .. } | OutputFault::Uneven { .. }) => bent,
            _ => self.rounded(bent),
        };
        let drift = match fault {
            Some(OutputFault::WarmReference { drift, warm_up_min }) => {
                1.0 + drift * (1.0 - (-session_min / warm_up_min).exp())
            }
            _ => 1.0,
        };
        self.pin = (pin * drift).clamp(self.min, self.max);
        self.pin
    }

    fn rounded(&self, x: f64) -> f64 {
        if self.step > 0.0 { self.min + self.step * ((x - self.min) / self.step).round() } else { x }
    }

    fn bend(&self, fault: &OutputFault, asked: f64, session_min: f64) -> f64 {
        match *fault {
            OutputFault::SoftLimit { level, softness } => {
                // Softplus: follows below, levels off above.
                let over = (asked - level) / softness;
                let soft_plus = if over > 30.0 { over } else { over.exp().ln_1p() };
                asked - softness * soft_plus
            }
            OutputFault::FallingLimit { level, fall_per_min } => {
                asked.min(level - fall_per_min * session_min)
            }
            OutputFault::Floor { step } => self.min + step * ((asked - self.min) / step).floor(),
            OutputFault::Uneven { step } => {
                let place = (asked - self.min) / (2.0 * step);
                let part = if place.fract() < 0.35 { 0.0 } else { 0.7 };
                self.min + 2.0 * step * (place.floor() + part)
            }
            OutputFault::Stiction { width } => {
                if (asked - self.pin).abs() > 0.5 * width || asked == self.min { asked } else { self.pin }
            }
            OutputFault::CreepingPlay { width, creep } => {
                let moved = self.pin.clamp(asked - 0.5 * width, asked + 0.5 * width);
                moved + creep * (asked - moved)
            }
            OutputFault::WarmReference { .. } => asked,
        }
    }
}

/// What goes wrong between the pins and the motors; no readback shows it.
#[derive(Clone, Debug)]
pub(crate) enum RadioFault {
    /// Everything is late by the same time.
    Delay { delay_s: f64 },
    /// The transmitter samples the sticks when its frame comes round and sends them in the next one.
    Frames { period_s: f64, phase_s: f64 },
}

impl RadioFault {
    /// When a pin that changed at `t_s` is heard.
    pub(crate) fn heard_at(&self, t_s: f64) -> f64 {
        match *self {
            Self::Delay { delay_s } => t_s + delay_s,
            Self::Frames { period_s, phase_s } => {
                phase_s + period_s * (((t_s - phase_s) / period_s).ceil() + 0.5)
            }
        }
    }
}

/// Sticks that reach the motors through two equal low passes.
#[derive(Debug)]
pub(crate) struct TwoPole {
    /// Time constant of each, s.
    pub pole_s: f64,
    /// Throttle at rest, in units of the sticks.
    pub rest: f64,
}

impl Law for TwoPole {
    fn place(&self) -> Place {
        Place::Throttle
    }

    fn start(&self) -> Memory {
        [self.rest, self.rest, 0.0]
    }

    fn act(&self, _: &Now, [first, second, _]: &Memory, push: &mut Push) -> Memory {
        let asked = push.throttle;
        push.throttle = *second;
        [(asked - first) / self.pole_s, (first - second) / self.pole_s, 0.0]
    }
}
