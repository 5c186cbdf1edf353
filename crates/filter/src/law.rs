//! The vertical model at one point of its parameter space, through the same laws as the simulator.

use std::sync::Arc;

use bench_device::Sticks;
use bench_plant::{
    effects::{Effects, LIBRARY, Parameter, PerNumber, RigNumber, Stage, View, resolve_all},
    nominal::{Air, Forces, Nominal},
};
use bench_rig::{Airframe, GRAVITY_M_S2, Rig};
use nalgebra::Vector3;

use crate::noise::is_random;

/// Names of the nominal model's uncertain numbers.
const NAMES: PerNumber<&str> = PerNumber([
    "mass_kg",
    "thrust_gain",
    "thrust_offset",
    "ground_effect_multiplier",
    "ground_effect_height_m",
    "drag_n_s_per_m",
    "tracker_latency_s",
    "tracker_bias_m",
]);

/// The effects that a rig lists; none if it lists them wrongly, which whoever loads a rig for use is told elsewhere.
pub fn known(rig: &Rig) -> Arc<[(usize, Vec<f64>)]> {
    resolve_all(&rig.effects).unwrap_or_default().into()
}

/// One sigma of an ordinary tracker's origin, m, where its resolution says less.
const LEAST_BIAS_M: f64 = 5e-4;

/// A point of the parameter space: the nominal numbers, and effects of the library with their values.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    /// Values of the rig's numbers: nuisance parameters of a hypothesis about effects.
    pub nuisances: PerNumber<f64>,
    /// Library index and values in the order of the spec.
    pub effects: Vec<(usize, Vec<f64>)>,
    /// The same of those that the rig says are there: part of the nominal model.
    pub known: Arc<[(usize, Vec<f64>)]>,
}

/// One coordinate of a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coordinate {
    /// One of a point's nuisances.
    Nuisance(RigNumber),
    /// Parameter of one of the point's effects.
    Effect {
        /// Which of the point's effects.
        slot: usize,
        /// Which of its parameters.
        parameter: usize,
    },
}

/// From where on, between throttle and measurement, a law differs that differs in one thing alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reach {
    /// From the throttle on.
    Throttle,
    /// From the force on: the thrust out of the ground effect is the same.
    Force,
    /// In how a flight is seen: the flight is the same.
    Sight,
}

impl Reach {
    /// Of an effect of the library.
    pub fn of_effect(effect: usize) -> Self {
        match LIBRARY[effect].stage {
            Stage::Actuator | Stage::Propulsion => Self::Throttle,
            Stage::Environment | Stage::Airframe => Self::Force,
            Stage::Tracker | Stage::Loop => Self::Sight,
        }
    }

    /// Of a coordinate of a point.
    pub fn of(at: Coordinate, point: &Point, rig: &Rig) -> Self {
        match at {
            Coordinate::Nuisance(RigNumber::Latency | RigNumber::Origin) => Self::Sight,
            Coordinate::Nuisance(RigNumber::ThrustGain | RigNumber::ThrustOffset) => Self::Throttle,
            // The throttle that hovers is kept; effects of propulsion reckon in weights.
            Coordinate::Nuisance(RigNumber::Mass)
                if rig.airframe.thrust.hover_sigma.is_some() || point.propels() =>
            {
                Self::Throttle
            }
            Coordinate::Nuisance(_) => Self::Force,
            Coordinate::Effect { slot, .. } => Self::of_effect(point.effects[slot].0),
        }
    }
}

impl Point {
    /// The rig's nominal numbers and one sigma of each.
    pub fn nominal(rig: &Rig) -> (Self, PerNumber<f64>) {
        let a = &rig.airframe;
        let all = [
            a.mass_kg,
            a.thrust.gain_n_per_unit,
            a.thrust.offset,
            a.ground_effect.multiplier,
            a.ground_effect.height_m,
            a.drag_n_s_per_m,
            rig.tracker.latency_s,
        ];
        // No rig says so, and every tracker has it: the origin is not known to a fraction of the resolution.
        let bias = (0.2 * rig.tracker.resolution_m).max(LEAST_BIAS_M);
        let with = |[a, b, c, d, e, f, g]: [f64; 7], last: f64| PerNumber([a, b, c, d, e, f, g, last]);
        let mut values = with(all.map(|x| x.value), 0.0);
        let mut sigma = with(all.map(|x| x.sigma), bias);
        if let Some(hover_sigma) = a.thrust.hover_sigma {
            values[RigNumber::ThrustGain] = a.throttle_for(a.weight_n());
            sigma[RigNumber::ThrustGain] = hover_sigma;
        }
        (Self { nuisances: values, effects: Vec::new(), known: known(rig) }, sigma)
    }

    /// Names of the nuisances of a rig.
    pub fn names(rig: &Rig) -> PerNumber<&'static str> {
        let mut names = NAMES;
        if rig.airframe.thrust.hover_sigma.is_some() {
            names[RigNumber::ThrustGain] = "thrust_hover";
        }
        names
    }

    /// All effects that act: the rig's own, then the hypothesis'.
    pub fn acting(&self) -> impl Iterator<Item = &(usize, Vec<f64>)> {
        self.known.iter().chain(&self.effects)
    }

    fn propels(&self) -> bool {
        self.acting().any(|(effect, _)| LIBRARY[*effect].stage == Stage::Propulsion)
    }

    /// Library indices of the hypothesis' effects.
    pub fn effect_indices(&self) -> Vec<usize> {
        self.effects.iter().map(|(effect, _)| *effect).collect()
    }

    /// The thrust gain, N per unit of throttle: where a rig says how well the throttle that hovers is known, that which
    /// carries the weight there.
    pub fn gain_n_per_unit(&self, rig: &Rig) -> f64 {
        let n = &self.nuisances;
        if rig.airframe.thrust.hover_sigma.is_none() {
            return n[RigNumber::ThrustGain];
        }
        // Never at or below the offset: a fit may try what no rig may say.
        let range = n[RigNumber::ThrustGain] - n[RigNumber::ThrustOffset];
        n[RigNumber::Mass] * GRAVITY_M_S2
            / range.max(1e-3 * n[RigNumber::ThrustGain].abs()).max(f64::MIN_POSITIVE) // numerical
    }

    /// The rig's airframe with these numbers.
    pub fn airframe(&self, rig: &Rig) -> Airframe {
        let n = &self.nuisances;
        let mut airframe = rig.airframe.clone();
        airframe.mass_kg.value = n[RigNumber::Mass];
        airframe.thrust.offset.value = n[RigNumber::ThrustOffset];
        airframe.thrust.gain_n_per_unit.value = self.gain_n_per_unit(rig);
        airframe.ground_effect.multiplier.value = n[RigNumber::GroundEffectMultiplier];
        airframe.ground_effect.height_m.value = n[RigNumber::GroundEffectHeight];
        airframe.drag_n_s_per_m.value = n[RigNumber::Drag];
        airframe
    }

    /// The value at a coordinate.
    pub fn get(&self, at: Coordinate) -> f64 {
        match at {
            Coordinate::Nuisance(i) => self.nuisances[i],
            Coordinate::Effect { slot, parameter } => self.effects[slot].1[parameter],
        }
    }

    /// The value at a coordinate, to be changed.
    pub fn get_mut(&mut self, at: Coordinate) -> &mut f64 {
        match at {
            Coordinate::Nuisance(i) => &mut self.nuisances[i],
            Coordinate::Effect { slot, parameter } => &mut self.effects[slot].1[parameter],
        }
    }

    /// The library's description of an effect's parameter.
    pub fn parameter(&self, slot: usize, parameter: usize) -> &'static Parameter {
        &LIBRARY[self.effects[slot].0].parameters[parameter]
    }
}

/// A throttle that the pin holds for a while.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hold {
    /// For how long, s.
    pub h: f64,
    /// Throttle on the pin, in units of the actuation.
    pub throttle: f64,
}

/// The law with its effects' inner states, advanced along a flight.
pub struct Law {
    nominal: Nominal,
    effects: Effects,
    mass_kg: f64,
    /// Its reciprocal: a step waits for every division.
    per_kg: f64,
    free_thrust_n: f64,
    /// Height of a surface above that stops the airframe, m; infinite where there is none.
    pub ceiling_m: f64,
    /// Cosine of the tilt, where it was measured.
    pub tilt_cos: f64,
    /// How the tracker sees altitude, and how late.
    pub view: View,
}

impl Law {
    /// At rest, before a flight.
    pub fn new(point: &Point, rig: &Rig) -> Self {
        let n = &point.nuisances;
        let mut airframe = point.airframe(rig);
        let nominal = Nominal::new(&airframe);
        // How strong wind pushes is told by flights, how much drag it pushes against hardly: its speed is that for the rig's drag.
        airframe.drag_n_s_per_m = rig.airframe.drag_n_s_per_m;
        let mut effects = Effects::default();
        for (index, values) in point.acting().filter(|(index, _)| !is_random(*index)) {
            // What pins do was read with the rig's own numbers.
            let pins = LIBRARY[*index].stage == Stage::Actuator;
            effects.add(*index, values, if pins { &rig.airframe } else { &airframe }, 0);
        }
        let mut mass_kg = nominal.mass_kg;
        for effect in &effects.air {
            effect.mass(&mut mass_kg);
        }
        let mut law = Self {
            nominal,
            ceiling_m: effects.ceiling_m(),
            effects,
            mass_kg,
            per_kg: mass_kg.recip(),
            free_thrust_n: 0.0,
            tilt_cos: 1.0,
            view: View {
                factor: 1.0,
                bend_per_m: 0.0,
                offset_m: n[RigNumber::Origin],
                latency_s: n[RigNumber::Latency],
            },
        };
        for (index, values) in point.acting() {
            (LIBRARY[*index].signature.view)(values, &mut law.view);
        }
        law
    }

    /// Takes what the pin holds over the next step: the thrust is the mean of what it gives.
    #[inline]
    pub fn hold(&mut self, holds: &[Hold]) {
        let [hold] = holds else {
            let (mut impulse, mut lasted_s) = (0.0, 0.0);
            for hold in holds {
                impulse += self.free_thrust_n(hold) * hold.h;
                lasted_s += hold.h;
            }
            self.free_thrust_n = impulse / lasted_s;
            return;
        };
        self.free_thrust_n = self.free_thrust_n(hold);
    }

    #[inline]
    fn free_thrust_n(&mut self, hold: &Hold) -> f64 {
        let mut sticks = Sticks { throttle: hold.throttle, ..Sticks::default() };
        for effect in &mut self.effects.actuator {
            effect.actuate(hold.h, &mut sticks);
        }
        let mut free_thrust_n = self.nominal.free_thrust_n(sticks.throttle);
        for effect in &mut self.effects.propulsion {
            effect.propel(hold.h, &mut free_thrust_n);
        }
        free_thrust_n
    }

    /// Moves the effects' states on along the flight.
    #[inline]
    pub fn advance(&mut self, dt_s: f64, z_m: f64, speed_m_s: f64) {
        if !self.effects.air.is_empty() {
            let air = self.air(z_m, speed_m_s);
            for effect in &mut self.effects.air {
                effect.advance(dt_s, &air);
            }
        }
    }

    /// Moves on beside another law that it differs from no earlier than `reach` says, which has moved on.
    #[inline]
    pub fn move_beside(
        &mut self,
        other: &Self,
        reach: Reach,
        dt_s: f64,
        holds: &[Hold],
        [z_m, speed_m_s]: [f64; 2],
    ) {
        match reach {
            Reach::Sight => return,
            Reach::Force => self.free_thrust_n = other.free_thrust_n,
            Reach::Throttle => self.hold(holds),
        }
        self.advance(dt_s, z_m, speed_m_s);
    }

    /// Upward acceleration, m/s^2.
    #[inline]
    pub fn acceleration_m_s2(&self, z_m: f64, speed_m_s: f64) -> f64 {
        let forces = Forces {
            nominal: &self.nominal,
            effects: &self.effects,
            free_thrust_n: self.free_thrust_n,
            mass_kg: self.mass_kg,
        };
        let air = self.air(z_m, speed_m_s);
        (forces.thrust_n(&air) + forces.drag_n(&air).z) * self.per_kg - GRAVITY_M_S2
    }

    #[inline]
    fn air(&self, z_m: f64, speed_m_s: f64) -> Air {
        Air {
            height_m: z_m,
            velocity_m_s: Vector3::new(0.0, 0.0, speed_m_s),
            tilt_cos: self.tilt_cos,
            free_thrust_n: self.free_thrust_n,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    /// Largest difference of acceleration, m/s^2, between a law that moves on by itself and one that moves on beside the point's.
    fn worst(point: &Point, moved: &Point, reach: Reach, rig: &Rig) -> f64 {
        let (mut base, mut alone, mut beside) =
            (Law::new(point, rig), Law::new(moved, rig), Law::new(moved, rig));
        let mut worst = 0.0_f64;
        for k in 0..2000 {
            let t_s = 0.02 * f64::from(k);
            // Up to above the ceiling's reach and down to the ground, throttle about hover.
            let (z, v) = (0.45 - 0.44 * (0.4 * t_s).cos(), 0.176 * (0.4 * t_s).sin());
            let throttle = 1.9 + 0.15 * (2.0 * t_s).sin() + if k % 50 < 25 { 0.05 } else { 0.0 };
            for law in [&mut base, &mut alone] {
                law.hold(&[Hold { h: 0.02, throttle }]);
                law.advance(0.02, z, v);
            }
            beside.move_beside(&base, reach, 0.02, &[Hold { h: 0.02, throttle }], [z, v]);
            let expected = match reach {
                // Whoever asks takes the base's.
                Reach::Sight => base.acceleration_m_s2(z, v),
                _ => beside.acceleration_m_s2(z, v),
            };
            let aside = (alone.acceleration_m_s2(z, v) - expected).abs();
            assert!(aside.is_finite());
            worst = worst.max(aside);
        }
        worst
    }

    #[test]
    fn a_law_that_moves_on_beside_another_is_where_it_would_be_alone() {
        let mut rig =
            Rig::load(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs/virtual.toml")).unwrap();
        for hover_sigma in [None, Some(0.01)] {
            rig.airframe.thrust.hover_sigma = hover_sigma;
            let (nominal, sigma) = Point::nominal(&rig);
            for effect in (0..LIBRARY.len()).filter(|effect| !is_random(*effect)) {
                let parameters = LIBRARY[effect].parameters;
                let values = parameters.iter().map(|p| p.default.unwrap_or(p.prior.typical())).collect();
                let point = Point { effects: vec![(effect, values)], ..nominal.clone() };
                // An effect added.
                assert_eq!(
                    worst(&nominal, &point, Reach::of_effect(effect), &rig),
                    0.0,
                    "{}",
                    LIBRARY[effect].name
                );
                let numbers = sigma.iter().map(|(number, sigma)| (Coordinate::Nuisance(number), *sigma));
                let own = (0..parameters.len()).map(|parameter| {
                    (
                        Coordinate::Effect { slot: 0, parameter },
                        0.1 * (parameters[parameter].max - parameters[parameter].min),
                    )
                });
                for (at, step) in numbers.chain(own) {
                    let mut moved = point.clone();
                    *moved.get_mut(at) += step;
                    let reach = Reach::of(at, &point, &rig);
                    assert_eq!(worst(&point, &moved, reach, &rig), 0.0, "{} {at:?}", LIBRARY[effect].name);
                }
            }
        }
    }

    #[test]
    fn effects_act_on_the_airframe_as_it_is_thought_to_be() {
        let rig = Rig::load(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs/virtual.toml")).unwrap();
        let mut real = rig.clone();
        let a = &mut real.airframe;
        a.mass_kg.value *= 1.02;
        a.thrust.gain_n_per_unit.value *= 0.97;
        a.thrust.offset.value *= 1.03;
        a.ground_effect.multiplier.value -= 0.06;
        a.ground_effect.height_m.value *= 1.1;
        for effect in (0..LIBRARY.len()).filter(|effect| !is_random(*effect)) {
            let values: Vec<f64> =
                LIBRARY[effect].parameters.iter().map(|p| p.default.unwrap_or(p.prior.typical())).collect();
            let with = |rig: &Rig| Point { effects: vec![(effect, values.clone())], ..Point::nominal(rig).0 };
            let thought = Point { nuisances: with(&real).nuisances, ..with(&rig) };
            let (mut fitted, mut flown) = (Law::new(&thought, &rig), Law::new(&with(&real), &real));
            for k in 0..500 {
                let t_s = 0.02 * f64::from(k);
                let (z, v) = (0.03 - 0.03 * (4.0 * t_s).cos(), 0.12 * (4.0 * t_s).sin());
                for law in [&mut fitted, &mut flown] {
                    // Below where any typical saturation acts, for pins do as the rig says.
                    law.hold(&[Hold { h: 0.02, throttle: 1.7 + 0.1 * (2.0 * t_s).sin() }]);
                    law.advance(0.02, z, v);
                }
                let aside = fitted.acceleration_m_s2(z, v) - flown.acceleration_m_s2(z, v);
                assert!(aside.abs() < 1e-9, "{}: {aside} m/s^2 at {t_s} s", LIBRARY[effect].name);
            }
        }
    }
}
