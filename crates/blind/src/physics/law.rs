//! What a law sees and what it may change.

use std::fmt::Debug;

/// Up to three numbers that a law remembers; it says how fast they change.
pub(crate) type Memory = [f64; 3];

/// An instant of the flight.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Now {
    /// Since the flight began, s.
    pub t_s: f64,
    /// Since the first flight of the case began, min.
    pub session_min: f64,
    /// Altitude, m.
    pub z_m: f64,
    /// Vertical speed, m/s.
    pub v_m_s: f64,
    /// Throttle as the radio hands it on, in units of the sticks.
    pub heard: f64,
    /// Vertical speed of the air, m/s.
    pub air_m_s: f64,
    /// 1 while a motor misses, 0 while it does not.
    pub miss: f64,
    /// The rig's nominal weight, N.
    pub weight_n: f64,
    /// The rig's nominal hover throttle, in units of the sticks.
    pub hover: f64,
}

/// What pushes the airframe: filled in by the nominal law, then changed by one law after another.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Push {
    /// Throttle that the motors' drivers take, in units of the sticks.
    pub throttle: f64,
    /// Thrust of the free rotors, N.
    pub thrust_n: f64,
    /// What the ground adds, as a fraction of that.
    pub ground: f64,
    /// What else multiplies thrust.
    pub factor: f64,
    /// Forces that are not thrust, up, N.
    pub force_n: f64,
    /// Mass, kg.
    pub mass_kg: f64,
    /// Vertical speed of the air, m/s.
    pub air_m_s: f64,
}

/// When a law acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Place {
    /// On the throttle, before there is thrust.
    Throttle,
    /// On thrust and forces.
    Thrust,
}

/// One way in which a flight departs from the nominal model.
pub(crate) trait Law: Debug + Send + Sync {
    fn place(&self) -> Place {
        Place::Thrust
    }

    /// What it remembers when a flight begins.
    fn start(&self) -> Memory {
        [0.0; 3]
    }

    /// Changes the push and returns the rates of its memory.
    fn act(&self, now: &Now, memory: &Memory, push: &mut Push) -> Memory;
}
