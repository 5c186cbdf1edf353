//! Rotors and batteries.

use super::law::{Law, Memory, Now, Push};

/// Rotor speed as a damped oscillator: an electronic speed controller with a loop of its own.
#[derive(Debug)]
pub(crate) struct SecondOrderRotor {
    pub natural_rad_s: f64,
    pub damping: f64,
}

impl Law for SecondOrderRotor {
    fn act(&self, now: &Now, [speed, rate, _]: &Memory, push: &mut Push) -> Memory {
        let wanted = (push.thrust_n / now.weight_n).sqrt();
        push.thrust_n = now.weight_n * speed.max(0.0).powi(2);
        let pull = self.natural_rad_s.powi(2) * (wanted - speed);
        [*rate, pull - 2.0 * self.damping * self.natural_rad_s * rate, 0.0]
    }
}

/// A rotor that spins up under power and coasts down without: two time constants.
#[derive(Debug)]
pub(crate) struct AsymmetricRotor {
    pub rise_s: f64,
    pub fall_s: f64,
}

impl Law for AsymmetricRotor {
    fn act(&self, now: &Now, [speed, ..]: &Memory, push: &mut Push) -> Memory {
        let wanted = (push.thrust_n / now.weight_n).sqrt();
        push.thrust_n = now.weight_n * speed.max(0.0).powi(2);
        let lag = if wanted > *speed { self.rise_s } else { self.fall_s };
        [(wanted - speed) / lag, 0.0, 0.0]
    }
}

/// Thrust as a power of what the linear law gives, equal to it at hover.
#[derive(Debug)]
pub(crate) struct PowerCurve {
    pub exponent: f64,
}

impl Law for PowerCurve {
    fn act(&self, now: &Now, _: &Memory, push: &mut Push) -> Memory {
        push.thrust_n = now.weight_n * (push.thrust_n / now.weight_n).max(0.0).powf(self.exponent);
        [0.0; 3]
    }
}

/// Thrust that levels off as motors run out of voltage, equal to the linear law at hover.
#[derive(Debug)]
pub(crate) struct LevellingCurve {
    pub knee: f64,
}

impl Law for LevellingCurve {
    fn act(&self, now: &Now, _: &Memory, push: &mut Push) -> Memory {
        push.thrust_n *= (1.0 + self.knee) / (1.0 + self.knee * push.thrust_n / now.weight_n);
        [0.0; 3]
    }
}

/// A worn propeller: a share of thrust is missing.
#[derive(Debug)]
pub(crate) struct Worn {
    pub fraction: f64,
}

impl Law for Worn {
    fn act(&self, _: &Now, _: &Memory, push: &mut Push) -> Memory {
        push.thrust_n *= 1.0 - self.fraction;
        [0.0; 3]
    }
}

/// One bad motor of four, which loses more the harder it works.
#[derive(Debug)]
pub(crate) struct WeakMotor {
    pub fraction: f64,
}

impl Law for WeakMotor {
    fn act(&self, now: &Now, _: &Memory, push: &mut Push) -> Memory {
        let load = (push.thrust_n / now.weight_n).clamp(0.0, 2.0);
        push.thrust_n *= 1.0 - self.fraction * (0.8 + 0.2 * load);
        [0.0; 3]
    }
}

/// Power drawn by rotors over that of hover.
fn power(push: &Push, now: &Now) -> f64 {
    (push.thrust_n / now.weight_n).max(0.0).powf(1.5)
}

/// Shepherd's cell without its resistance: voltage falls with K Q/(Q - q); thrust goes with voltage squared.
///
/// Source: Shepherd, Design of Primary and Secondary Cells II, Journal of the Electrochemical Society 112(7), 1965.
#[derive(Debug)]
pub(crate) struct Shepherd {
    /// Fraction of thrust lost per minute of hover when fresh.
    pub loss_per_min: f64,
    /// Minutes of hover in a full cell.
    pub full_min: f64,
}

impl Law for Shepherd {
    fn act(&self, now: &Now, [drawn, ..]: &Memory, push: &mut Push) -> Memory {
        let rate = power(push, now) / 60.0;
        let left = (self.full_min - drawn).max(0.05 * self.full_min);
        let voltage = 1.0 - 0.5 * self.loss_per_min * drawn * self.full_min / left;
        push.thrust_n *= voltage.max(0.3).powi(2);
        [rate, 0.0, 0.0]
    }
}

/// A cell with an exponential zone after charging, then a slope.
#[derive(Debug)]
pub(crate) struct FreshCell {
    /// Loss of thrust over the exponential zone.
    pub zone: f64,
    /// Minutes of hover over which the zone falls by e.
    pub zone_min: f64,
    /// Fraction of thrust lost per minute of hover afterwards.
    pub slope_per_min: f64,
}

impl Law for FreshCell {
    fn act(&self, now: &Now, [drawn, ..]: &Memory, push: &mut Push) -> Memory {
        let rate = power(push, now) / 60.0;
        let lost = self.zone * (1.0 - (-drawn / self.zone_min).exp()) + self.slope_per_min * drawn;
        push.thrust_n *= (1.0 - lost).max(0.1);
        [rate, 0.0, 0.0]
    }
}

/// Two resistor-capacitor pairs in series: a fast and a slow sag, both with the load.
///
/// Source: Chen, Rincón-Mora, Accurate Electrical Battery Model Capable of Predicting Runtime and I-V Performance, IEEE
/// Transactions on Energy Conversion 21(2), 2006.
#[derive(Debug)]
pub(crate) struct TwoPairs {
    /// Loss of thrust in steady hover.
    pub sag: f64,
    pub fast_s: f64,
    pub slow_s: f64,
    /// Share of the fast pair.
    pub fast_share: f64,
}

impl Law for TwoPairs {
    fn act(&self, now: &Now, [fast, slow, _]: &Memory, push: &mut Push) -> Memory {
        let load = power(push, now);
        let drop = self.fast_share * fast + (1.0 - self.fast_share) * slow;
        push.thrust_n *= (1.0 - 0.5 * self.sag * drop).max(0.3).powi(2);
        [(load - fast) / self.fast_s, (load - slow) / self.slow_s, 0.0]
    }
}
