//! The airframe's vertical motion: the rig's law with this airframe's own numbers, and the laws added to it.

use bench_rig::{GRAVITY_M_S2, Rig};

use super::law::{Law, Now, Place, Push};

/// How many laws a case may add.
pub(crate) const LAWS: usize = 2;
/// Altitude, speed, charge drawn, and what each law remembers.
pub(crate) const STATES: usize = 3 + 3 * LAWS;

/// Numbers of the rig that are not known exactly, as this airframe has them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Numbers(pub [f64; 7]);

impl Numbers {
    pub(crate) const NAMES: [&'static str; 7] = [
        "mass_kg",
        "drag_n_s_per_m",
        "gain_n_per_unit",
        "offset",
        "ground_effect_multiplier",
        "ground_effect_height_m",
        "tracker_latency_s",
    ];
    pub(crate) const LATENCY: usize = 6;

    /// How acceleration changes with altitude in the ground effect of an airframe that bears its weight, 1/s^2.
    pub(crate) fn cushion_per_s2(&self, z_m: f64) -> f64 {
        let [_, _, _, _, multiplier, height_m, _] = self.0;
        if (0.0..height_m).contains(&z_m) { -GRAVITY_M_S2 * (multiplier - 1.0) / height_m } else { 0.0 }
    }

    /// The rig's nominal numbers, and one sigma of each.
    pub(crate) fn of(rig: &Rig) -> (Self, [f64; 7]) {
        let a = &rig.airframe;
        let all = [
            a.mass_kg,
            a.drag_n_s_per_m,
            a.thrust.gain_n_per_unit,
            a.thrust.offset,
            a.ground_effect.multiplier,
            a.ground_effect.height_m,
            rig.tracker.latency_s,
        ];
        (Self(all.map(|number| number.value)), all.map(|number| number.sigma))
    }
}

/// The vertical airframe.
#[derive(Debug)]
pub(crate) struct Body<'a> {
    pub numbers: Numbers,
    /// Thrust of this flight over that of others: how full the cell was.
    pub trim: f64,
    /// Fraction of thrust that is gone after the first minute of hover.
    pub drain_per_min: f64,
    pub laws: Vec<&'a dyn Law>,
}

/// Undamped frequency of an airframe that stands on its skids or is held by its guards, rad/s, and its damping ratio.
const SPRING_RAD_S: f64 = 120.0;
const SPRING_DAMPING: f64 = 0.6;

impl Body<'_> {
    /// At rest on the floor.
    pub(crate) fn start(&self) -> [f64; STATES] {
        let mut state = [0.0; STATES];
        state[0] = -GRAVITY_M_S2 / SPRING_RAD_S.powi(2);
        for (memory, law) in state[3..].chunks_exact_mut(3).zip(&self.laws) {
            memory.copy_from_slice(&law.start());
        }
        state
    }

    /// Acceleration without the floor's push [m/s^2], thrust over weight, and the rates of charge and memories.
    pub(crate) fn evaluate(&self, now: &Now, memory: &[f64]) -> (f64, f64, [f64; STATES - 2]) {
        let [mass_kg, drag, gain, offset, multiplier, height_m, _] = self.numbers.0;
        let mut push = Push {
            throttle: now.heard,
            thrust_n: 0.0,
            ground: (multiplier - 1.0) * hinge(1.0 - now.z_m.max(0.0) / height_m),
            factor: 1.0,
            force_n: 0.0,
            mass_kg,
            air_m_s: now.air_m_s,
        };
        let mut rates = [0.0; STATES - 2];
        self.act(Place::Throttle, now, memory, &mut push, &mut rates);
        let drawn_min = memory[0];
        let fresh = self.trim * (1.0 - self.drain_per_min * drawn_min / (1.0 + 0.2 * drawn_min));
        push.thrust_n = fresh * (gain * (push.throttle - offset)).max(0.0);
        rates[0] = (push.thrust_n / now.weight_n).powf(1.3) / 60.0;
        self.act(Place::Thrust, now, memory, &mut push, &mut rates);
        let thrust_n = push.thrust_n * (1.0 + push.ground) * push.factor;
        let force_n = thrust_n + push.force_n - drag * (now.v_m_s - push.air_m_s);
        (force_n / push.mass_kg - GRAVITY_M_S2, thrust_n / now.weight_n, rates)
    }

    fn act(&self, place: Place, now: &Now, memory: &[f64], push: &mut Push, rates: &mut [f64]) {
        for (i, law) in self.laws.iter().enumerate().filter(|(_, law)| law.place() == place) {
            let slot = 1 + 3 * i..4 + 3 * i;
            let own = [memory[slot.start], memory[slot.start + 1], memory[slot.start + 2]];
            rates[slot].copy_from_slice(&law.act(now, &own, push));
        }
    }

    /// The floor's push on an airframe at `z_m` that moves at `v_m_s`, m/s^2, never down.
    pub(crate) fn floor(z_m: f64, v_m_s: f64) -> f64 {
        springs(-z_m, -v_m_s)
    }

    /// The push of a lid that hangs at `lid_m`, m/s^2 down.
    pub(crate) fn lid(lid_m: f64, z_m: f64, v_m_s: f64) -> f64 {
        springs(z_m - lid_m, v_m_s)
    }
}

/// How much a solid pushes back that the airframe went `depth_m` into at a speed, m/s^2.
fn springs(depth_m: f64, speed_m_s: f64) -> f64 {
    if depth_m <= 0.0 {
        return 0.0;
    }
    (SPRING_RAD_S.powi(2) * depth_m + 2.0 * SPRING_DAMPING * SPRING_RAD_S * speed_m_s).max(0.0)
}

/// `max(0, x)` with a small round in its corner.
fn hinge(x: f64) -> f64 {
    const ROUND: f64 = 0.02;
    0.5 * (x + x.hypot(ROUND))
}
