//! A flight without clock, output or tracker: hooks, forces and body in the order in which the lab calls them.

use std::path::{Path, PathBuf};

use bench_device::Sticks;
use bench_plant::{
    body::{Body, Vertical},
    effects::{EffectSpec, Effects, LIBRARY},
    nominal::{Forces, Nominal},
};
use bench_rig::{EffectEntry, Location, Model, Rig};

/// The virtual rig with this model and no effects.
pub fn rig(model: Model) -> Rig {
    let mut rig = Rig::load(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs/virtual.toml")).unwrap();
    rig.plant.model = model;
    rig.effects.clear();
    rig
}

/// The virtual rig's vertical model with one effect, values in the order of its spec.
pub fn rig_with(name: &str, values: &[f64]) -> Rig {
    let mut rig = rig(Model::Vertical);
    rig.effects.push(entry(spec(name), values));
    rig
}

pub fn spec(name: &str) -> &'static EffectSpec {
    LIBRARY.iter().find(|spec| spec.name == name).unwrap()
}

pub fn entry(spec: &EffectSpec, values: &[f64]) -> EffectEntry {
    let left_out = spec.parameters.iter().skip(values.len());
    assert!(left_out.clone().all(|p| p.default.is_some()), "{}", spec.name);
    EffectEntry {
        name: spec.name.to_owned(),
        parameters: spec
            .parameters
            .iter()
            .zip(values)
            .map(|(p, value)| (p.key.to_owned(), *value, 1))
            .collect(),
        at: Location { file: PathBuf::from("test.toml"), line: 1 },
    }
}

/// What one would see of an effect: its parameters' typical values, and its plainest form.
pub fn typical(spec: &EffectSpec) -> Vec<f64> {
    spec.parameters.iter().map(|p| p.default.unwrap_or(p.prior.typical())).collect()
}

/// Sticks that ask for a nominal thrust in weights, the others centred.
pub fn sticks(rig: &Rig, thrust_to_weight: f64) -> Sticks {
    let throttle = rig.airframe.throttle_for(thrust_to_weight * rig.airframe.weight_n());
    let centre = rig.airframe.sticks.centre;
    Sticks { throttle, pitch: centre, roll: centre, yaw: centre }
}

pub struct Flight {
    nominal: Nominal,
    pub effects: Effects,
    mass_kg: f64,
    pub body: Body,
    pub free_thrust_n: f64,
}

impl Flight {
    /// At rest on the surface.
    pub fn new(rig: &Rig) -> Self {
        let nominal = Nominal::new(&rig.airframe);
        let effects = Effects::from_rig(rig, 1).unwrap();
        let mut mass_kg = nominal.mass_kg;
        for effect in &effects.air {
            effect.mass(&mut mass_kg);
        }
        let body = Body::at_rest(rig.plant.model, &rig.airframe);
        Self { nominal, effects, mass_kg, body, free_thrust_n: 0.0 }
    }

    /// The vertical model at a height, with a vertical speed.
    pub fn airborne(rig: &Rig, z_m: f64, speed_m_s: f64) -> Self {
        Self { body: Body::Vertical(Vertical { z_m, speed_m_s }), ..Self::new(rig) }
    }

    pub fn step(&mut self, dt_s: f64, mut sticks: Sticks) {
        for effect in &mut self.effects.actuator {
            // Driving the pins again with the same command changes nothing.
            effect.drive(&mut sticks);
        }
        for effect in &mut self.effects.actuator {
            effect.actuate(dt_s, &mut sticks);
        }
        self.free_thrust_n = self.nominal.free_thrust_n(sticks.throttle);
        for effect in &mut self.effects.propulsion {
            effect.propel(dt_s, &mut self.free_thrust_n);
        }
        let air = self.body.air(self.free_thrust_n);
        for effect in &mut self.effects.air {
            effect.advance(dt_s, &air);
        }
        let forces = Forces {
            nominal: &self.nominal,
            effects: &self.effects,
            free_thrust_n: self.free_thrust_n,
            mass_kg: self.mass_kg,
        };
        self.body.step(dt_s, &forces, sticks);
    }

    /// Steps of `dt_s` with the sticks held for a whole number of them.
    pub fn hold(&mut self, duration_s: f64, dt_s: f64, sticks: Sticks) {
        for _ in 0..(duration_s / dt_s).round() as u64 {
            self.step(dt_s, sticks);
        }
    }

    pub fn height_m(&self) -> f64 {
        self.body.position_m().z
    }

    pub fn speed_m_s(&self) -> f64 {
        self.body.velocity_m_s().z
    }
}
