//! Laws that no library of effects has: a diagnosis should say that it does not know them.

use super::law::{Law, Memory, Now, Place, Push};

/// What is left of `x` beyond a dead zone of half-width `half`.
fn beyond(x: f64, half: f64) -> f64 {
    x - x.clamp(-half, half)
}

/// Thrust follows the throttle through some play that no readback shows.
#[derive(Debug)]
pub(crate) struct ThrustHysteresis {
    /// Play as a fraction of the weight.
    pub width: f64,
}

impl Law for ThrustHysteresis {
    fn act(&self, now: &Now, [level, ..]: &Memory, push: &mut Push) -> Memory {
        const FOLLOW_S: f64 = 0.01;
        let wanted = push.thrust_n / now.weight_n;
        push.thrust_n = now.weight_n * level.max(0.0);
        [beyond(wanted - level, 0.5 * self.width) / FOLLOW_S, 0.0, 0.0]
    }
}

/// Motors heat up with work and fade beyond a temperature.
#[derive(Debug)]
pub(crate) struct HotMotor {
    /// Thrust lost when as hot as hover for ever makes it.
    pub fade: f64,
    pub warm_up_s: f64,
}

impl Law for HotMotor {
    fn act(&self, now: &Now, [heat, ..]: &Memory, push: &mut Push) -> Memory {
        const ONSET: f64 = 0.4;
        let work = (push.thrust_n / now.weight_n).powi(2);
        push.thrust_n *= 1.0 - self.fade * ((heat - ONSET) / (1.0 - ONSET)).clamp(0.0, 2.0).powi(2);
        [(work - heat) / self.warm_up_s, 0.0, 0.0]
    }
}

/// A soft frame: thrust shakes a mode that passes on its motion.
#[derive(Debug)]
pub(crate) struct Resonance {
    pub share: f64,
    pub natural_rad_s: f64,
    pub damping: f64,
}

impl Law for Resonance {
    fn act(&self, now: &Now, [x, rate, _]: &Memory, push: &mut Push) -> Memory {
        let load = push.thrust_n / now.weight_n - 1.0;
        push.force_n += self.share * now.weight_n * (x - load);
        let pull = self.natural_rad_s.powi(2) * (load - x);
        [*rate, pull - 2.0 * self.damping * self.natural_rad_s * rate, 0.0]
    }
}

/// Hovering low, the wall jet comes back from above and takes thrust; moving on clears the air.
#[derive(Debug)]
pub(crate) struct Recirculation {
    pub loss: f64,
    pub build_up_s: f64,
    pub height_m: f64,
}

impl Law for Recirculation {
    fn act(&self, now: &Now, [air, ..]: &Memory, push: &mut Push) -> Memory {
        let low = (-(now.z_m / self.height_m).powi(2)).exp();
        let slow = (-(now.v_m_s / 0.15).powi(2)).exp();
        let working = (push.thrust_n / now.weight_n).min(1.0);
        push.factor *= 1.0 - self.loss * air;
        [(low * slow * working - air) / self.build_up_s, 0.0, 0.0]
    }
}

/// Something at one height pulls, as a magnet would.
#[derive(Debug)]
pub(crate) struct Attraction {
    /// Largest pull over the weight.
    pub pull: f64,
    pub height_m: f64,
    pub reach_m: f64,
}

impl Law for Attraction {
    fn act(&self, now: &Now, _: &Memory, push: &mut Push) -> Memory {
        let x = (now.z_m - self.height_m) / self.reach_m;
        push.force_n -= self.pull * now.weight_n * x * (0.5 - 0.5 * x * x).exp();
        [0.0; 3]
    }
}

/// A fan in the room that turns.
#[derive(Debug)]
pub(crate) struct Fan {
    /// Largest force over the weight.
    pub pull: f64,
    pub frequency_hz: f64,
    pub phase_rad: f64,
}

impl Law for Fan {
    fn act(&self, now: &Now, _: &Memory, push: &mut Push) -> Memory {
        let angle = std::f64::consts::TAU * self.frequency_hz * now.t_s + self.phase_rad;
        push.force_n += self.pull * now.weight_n * angle.sin();
        [0.0; 3]
    }
}

/// Rotors that stall while they are hurried: thrust is lost while the throttle changes, either way.
#[derive(Debug)]
pub(crate) struct HurriedStall {
    pub loss: f64,
    pub memory_s: f64,
}

impl Law for HurriedStall {
    fn act(&self, now: &Now, [settled, ..]: &Memory, push: &mut Push) -> Memory {
        let wanted = push.thrust_n / now.weight_n;
        let hurry = ((wanted - settled).abs() / 0.1).tanh();
        push.thrust_n *= 1.0 - self.loss * hurry;
        [(wanted - settled) / self.memory_s, 0.0, 0.0]
    }
}

/// A motor that misses now and then.
#[derive(Debug)]
pub(crate) struct MissingMotor {
    pub depth: f64,
}

impl Law for MissingMotor {
    fn act(&self, now: &Now, _: &Memory, push: &mut Push) -> Memory {
        push.thrust_n *= 1.0 - self.depth * now.miss;
        [0.0; 3]
    }
}

/// Mass goes away from flight to flight (a leaking pack of water as payload).
#[derive(Debug)]
pub(crate) struct Leak {
    pub loss_per_min: f64,
}

impl Law for Leak {
    fn act(&self, now: &Now, _: &Memory, push: &mut Push) -> Memory {
        push.mass_kg *= 1.0 - (self.loss_per_min * now.session_min).min(0.5);
        [0.0; 3]
    }
}

/// The hand controller takes no notice of small changes about hover, behind the readback.
#[derive(Debug)]
pub(crate) struct DeadBand {
    /// Half-width, in units of the sticks.
    pub half_width: f64,
}

impl Law for DeadBand {
    fn place(&self) -> Place {
        Place::Throttle
    }

    fn act(&self, now: &Now, _: &Memory, push: &mut Push) -> Memory {
        push.throttle = now.hover + beyond(push.throttle - now.hover, self.half_width);
        [0.0; 3]
    }
}

/// A thread to the floor that pulls once it is taut.
#[derive(Debug)]
pub(crate) struct Tether {
    /// Pull over the weight, per metre beyond the free length.
    pub stiffness_per_m: f64,
    pub free_m: f64,
}

impl Law for Tether {
    fn act(&self, now: &Now, _: &Memory, push: &mut Push) -> Memory {
        push.force_n -= self.stiffness_per_m * now.weight_n * (now.z_m - self.free_m).max(0.0);
        [0.0; 3]
    }
}

/// Air moves in one layer of the room only.
#[derive(Debug)]
pub(crate) struct Layer {
    pub speed_m_s: f64,
    pub centre_m: f64,
    pub depth_m: f64,
}

impl Law for Layer {
    fn act(&self, now: &Now, _: &Memory, push: &mut Push) -> Memory {
        let x = (now.z_m - self.centre_m) / self.depth_m;
        push.air_m_s += self.speed_m_s * (-x.powi(4)).exp();
        [0.0; 3]
    }
}

/// Something heavy hangs below on a spring.
#[derive(Debug)]
pub(crate) struct HangingLoad {
    /// Its mass over the airframe's.
    pub share: f64,
    pub natural_rad_s: f64,
    pub damping: f64,
}

impl Law for HangingLoad {
    fn act(&self, now: &Now, [load_speed, stretch, _]: &Memory, push: &mut Push) -> Memory {
        let closing = now.v_m_s - load_speed;
        let pull = self.natural_rad_s.powi(2) * stretch + 2.0 * self.damping * self.natural_rad_s * closing;
        push.force_n -= self.share * push.mass_kg * pull;
        [pull, closing, 0.0]
    }
}
