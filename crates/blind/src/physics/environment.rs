//! Ground, ceiling and air.

use super::{
    body::Body,
    law::{Law, Memory, Now, Push},
};

/// Part of the ground effect fades exponentially with height.
#[derive(Debug)]
pub(crate) struct ExponentialGround {
    pub share: f64,
    pub gain: f64,
    pub length_m: f64,
}

impl Law for ExponentialGround {
    fn act(&self, now: &Now, _: &Memory, push: &mut Push) -> Memory {
        let shape = self.gain * (-now.z_m.max(0.0) / self.length_m).exp();
        push.ground = (1.0 - self.share) * push.ground + self.share * shape;
        [0.0; 3]
    }
}

/// Part of the ground effect follows an image rotor below the floor, `1 / (1 - (R / 4h)^2)`.
///
/// Source: Cheeseman, Bennett, The Effect of the Ground on a Helicopter Rotor in Forward Flight, ARC R&M 3021, 1955.
#[derive(Debug)]
pub(crate) struct ImageGround {
    pub share: f64,
    pub radius_m: f64,
}

impl Law for ImageGround {
    fn act(&self, now: &Now, _: &Memory, push: &mut Push) -> Memory {
        // The rotor's plane stands half a radius above the skids.
        let height_m = now.z_m.max(0.0) + 0.5 * self.radius_m;
        let shape = 1.0 / (1.0 - (self.radius_m / (4.0 * height_m)).powi(2)) - 1.0;
        push.ground = (1.0 - self.share) * push.ground + self.share * shape;
        [0.0; 3]
    }
}

/// The cushion builds up and fades through two stages.
#[derive(Debug)]
pub(crate) struct SlowCushion {
    /// Mean delay of both stages together, s.
    pub delay_s: f64,
}

impl Law for SlowCushion {
    fn act(&self, _: &Now, [first, second, _]: &Memory, push: &mut Push) -> Memory {
        let steady = push.ground;
        push.ground = *second;
        let stage_s = 0.5 * self.delay_s;
        [(steady - first) / stage_s, (first - second) / stage_s, 0.0]
    }
}

/// The cushion builds up quickly and fades slowly.
#[derive(Debug)]
pub(crate) struct StickyCushion {
    pub rise_s: f64,
    pub fall_s: f64,
}

impl Law for StickyCushion {
    fn act(&self, _: &Now, [cushion, ..]: &Memory, push: &mut Push) -> Memory {
        let steady = push.ground;
        push.ground = *cushion;
        let lag = if steady > *cushion { self.rise_s } else { self.fall_s };
        [(steady - cushion) / lag, 0.0, 0.0]
    }
}

/// A lid above draws the rotors up as an image rotor does, `gain (r / (r + d))^2`, until the airframe hits it.
#[derive(Debug)]
pub(crate) struct ImageCeiling {
    pub gain: f64,
    pub ceiling_m: f64,
    pub radius_m: f64,
}

impl Law for ImageCeiling {
    fn act(&self, now: &Now, _: &Memory, push: &mut Push) -> Memory {
        let distance_m = (self.ceiling_m - now.z_m).max(0.0);
        push.factor *= 1.0 + self.gain * (self.radius_m / (self.radius_m + distance_m)).powi(2);
        push.force_n -= push.mass_kg * Body::lid(self.ceiling_m, now.z_m, now.v_m_s);
        [0.0; 3]
    }
}

/// The same with a draw that is a bell over distance.
#[derive(Debug)]
pub(crate) struct BellCeiling {
    pub gain: f64,
    pub ceiling_m: f64,
    pub reach_m: f64,
}

impl Law for BellCeiling {
    fn act(&self, now: &Now, _: &Memory, push: &mut Push) -> Memory {
        let distance = (self.ceiling_m - now.z_m).max(0.0) / self.reach_m;
        push.factor *= 1.0 + self.gain * (-distance * distance).exp();
        push.force_n -= push.mass_kg * Body::lid(self.ceiling_m, now.z_m, now.v_m_s);
        [0.0; 3]
    }
}

/// Air rises (or sinks) everywhere.
#[derive(Debug)]
pub(crate) struct Rising {
    pub speed_m_s: f64,
}

impl Law for Rising {
    fn act(&self, _: &Now, _: &Memory, push: &mut Push) -> Memory {
        push.air_m_s += self.speed_m_s;
        [0.0; 3]
    }
}

/// Rising air that the floor holds back.
#[derive(Debug)]
pub(crate) struct Plume {
    pub speed_m_s: f64,
    pub depth_m: f64,
}

impl Law for Plume {
    fn act(&self, now: &Now, _: &Memory, push: &mut Push) -> Memory {
        push.air_m_s += self.speed_m_s * (1.0 - (-now.z_m.max(0.0) / self.depth_m).exp());
        [0.0; 3]
    }
}
