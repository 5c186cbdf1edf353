//! What the nominal model lacks: one file an effect, each with its law, parameters, source and test.
//!
//! To add an effect, add a file with a `SPEC` and name it in `library.rs`, or [`Library::register`] it from elsewhere: the
//! spec holds all that simulation, diagnosis and reports know of it. An effect implements the hooks of [`Effect`]
//! for the stage in which it acts; the others do nothing.
//!
//! Hooks that advance a state take the time step (longer than zero) and return values averaged over it, exactly where
//! the law allows, so that a law means the same at a step of 1 ms in the simulator and of 50 ms in the diagnosis. None
//! allocates. With its neutral parameters ([`Parameter::neutral`]) an effect leaves the nominal model as it is, to the
//! last bit.

mod actuator_backlash;
mod actuator_lag;
mod actuator_quantisation;
mod actuator_saturation;
mod battery_discharge;
mod battery_load;
mod ceiling_effect;
mod descent_thrust_loss;
mod ground_effect_dynamic;
mod ground_effect_shape;
mod gusts;
mod inflow_damping;
mod lag;
mod library;
mod loop_overrun;
mod mass_change;
mod quadratic_drag;
mod rotor_lag;
mod signature;
mod spec;
mod thrust_curve;
mod thrust_loss;
mod tilt_loss;
mod tracker_dropout;
mod tracker_jitter;
mod tracker_latency;
mod tracker_noise;
mod tracker_outliers;
mod tracker_scale;
mod updraft;

use bench_device::Sticks;
use bench_rig::{Airframe, Rig};
use nalgebra::Vector3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::nominal::Air;
pub use library::{LIBRARY, Library, RegisterError, index_of, read_as};
pub use signature::{Axis, PerNumber, Reading, RigNumber, Shows, Signature, Spread, View};
pub use spec::{EffectError, EffectSpec, Parameter, Prior, Stage, parse_effect, resolve_all};

/// One source of random numbers an effect, so that switching one on does not change the others' draws.
pub type EffectRng = ChaCha8Rng;

/// One frame on its way through the tracker.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Position as seen, m.
    pub position_m: Vector3<f64>,
    /// Exposure to arrival, s.
    pub latency_s: f64,
    /// The frame never arrives.
    pub lost: bool,
}

/// A law that the nominal model lacks. Each hook is called for the effects of its stage only.
pub trait Effect: Send {
    /// Actuator: changes what the output's pins hold, once a write; the readback shows it.
    fn drive(&mut self, _sticks: &mut Sticks) {}

    /// Actuator: changes the sticks between the output's pin and the motors' command, over a step with the pins held.
    fn actuate(&mut self, _dt_s: f64, _sticks: &mut Sticks) {}

    /// Propulsion: changes the thrust out of the ground effect, N, over a step.
    fn propel(&mut self, _dt_s: f64, _free_thrust_n: &mut f64) {}

    /// Environment, airframe: moves the effect's own state on by a step that begins with `air`, before the body moves.
    fn advance(&mut self, _dt_s: f64, _air: &Air) {}

    /// Environment, airframe: changes the ground-effect multiplier less one.
    fn ground_effect(&self, _air: &Air, _ground_effect: &mut f64) {}

    /// Environment, airframe: changes the vertical thrust, ground effect included, N.
    fn thrust(&self, _air: &Air, _thrust_n: &mut f64) {}

    /// Environment, airframe: adds to the other forces, world frame, N.
    fn force(&self, _air: &Air, _force_n: &mut Vector3<f64>) {}

    /// Airframe: changes the mass, kg. Constant over a flight.
    fn mass(&self, _mass_kg: &mut f64) {}

    /// Environment: height of a surface that the airframe cannot pass, m. Constant over a flight.
    fn ceiling_m(&self) -> f64 {
        f64::INFINITY
    }

    /// Tracker: changes a frame.
    fn expose(&mut self, _frame: &mut Frame) {}

    /// Loop: by how much the next iteration starts late, s.
    fn lateness_s(&mut self) -> f64 {
        0.0
    }
}

/// The effects that act on one plant, by where they act.
#[derive(Default)]
pub struct Effects {
    /// Acting on frames.
    pub tracker: Vec<Box<dyn Effect>>,
    /// Acting on the loop's timing.
    pub timing: Vec<Box<dyn Effect>>,
    /// Acting on the sticks.
    pub actuator: Vec<Box<dyn Effect>>,
    /// Acting on the free thrust.
    pub propulsion: Vec<Box<dyn Effect>>,
    /// Acting on the airframe in its environment.
    pub air: Vec<Box<dyn Effect>>,
}

impl Effects {
    /// The effects listed in a rig, in the library's order. Random ones draw from streams that depend on `seed` and the
    /// effect's name alone.
    pub fn from_rig(rig: &Rig, seed: u64) -> Result<Self, EffectError> {
        let mut effects = Self::default();
        for (library_index, values) in spec::resolve_all(&rig.effects)? {
            effects.add(library_index, &values, &rig.airframe, seed);
        }
        Ok(effects)
    }

    /// Adds an effect of the library, to act after those of its stage that are there already. `values` are in the order
    /// of its spec's parameters and within their ranges, and act on this airframe.
    pub fn add(&mut self, library_index: usize, values: &[f64], airframe: &Airframe, seed: u64) {
        let spec = LIBRARY[library_index];
        let mut rng = EffectRng::seed_from_u64(seed);
        rng.set_stream(stream(spec.name));
        let effect = (spec.build)(values, airframe, rng);
        match spec.stage {
            Stage::Tracker => self.tracker.push(effect),
            Stage::Loop => self.timing.push(effect),
            Stage::Actuator => self.actuator.push(effect),
            Stage::Propulsion => self.propulsion.push(effect),
            Stage::Environment | Stage::Airframe => self.air.push(effect),
        }
    }

    /// Height of the lowest surface above, m; infinite where there is none.
    #[inline]
    pub fn ceiling_m(&self) -> f64 {
        self.air.iter().map(|effect| effect.ceiling_m()).fold(f64::INFINITY, f64::min)
    }
}

/// `x^exponent`, quickly where the exponent is that of a law's plainest form.
#[inline]
fn power(x: f64, exponent: f64) -> f64 {
    if exponent == 1.0 {
        x
    } else if exponent == 2.0 {
        x * x
    } else {
        x.powf(exponent)
    }
}

/// An effect's random stream: the FNV-1a hash of its name (Fowler, Noll, Vo). The lab's own streams are small numbers.
fn stream(name: &str) -> u64 {
    name.bytes()
        .fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

#[cfg(test)]
mod testing {
    use std::path::Path;

    use super::*;

    /// The virtual rig.
    pub(super) fn rig() -> Rig {
        Rig::load(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs/virtual.toml")).unwrap()
    }

    /// An effect of the library by name, for the virtual rig.
    pub(super) fn effect(name: &str, values: &[f64]) -> Box<dyn Effect> {
        let spec = LIBRARY.iter().find(|spec| spec.name == name).expect("the effect is in the library");
        let mut values = values.to_vec();
        values.extend(spec.parameters[values.len()..].iter().map(|p| p.default.expect("it is given")));
        (spec.build)(&values, &rig().airframe, EffectRng::seed_from_u64(1))
    }

    /// A level airframe that moves up.
    pub(super) fn air(height_m: f64, speed_m_s: f64) -> Air {
        let velocity_m_s = Vector3::new(0.0, 0.0, speed_m_s);
        Air { height_m, velocity_m_s, tilt_cos: 1.0, free_thrust_n: 0.15 }
    }

    /// A frame as the nominal tracker would pass it on.
    pub(super) fn frame() -> Frame {
        Frame { position_m: Vector3::new(0.1, 0.2, 0.5), latency_s: 0.3, lost: false }
    }

    pub(super) fn mean_and_deviation(values: &[f64]) -> (f64, f64) {
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let variance = values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / values.len() as f64;
        (mean, variance.sqrt())
    }
}
