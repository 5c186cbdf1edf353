//! Airframes that a rig's tolerances allow.

use bench_rig::{EffectEntry, Location, Rig, Uncertain};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// Rigs drawn from a rig's tolerances: what the plant may really be, while the controller goes by the rig.
///
/// Mass, thrust, ground effect and drag are normal with the rig's sigmas, and so is the latency, of which the controller
/// goes on believing the rig's value. Where the rig says how turbulent the air is, it blows.
#[derive(Clone, Copy, Debug)]
pub struct Models<'a> {
    rig: &'a Rig,
    seed: u64,
}

/// Multipliers, masses and the like stay above this share of their nominal value, whatever is drawn.
const LEAST_SHARE: f64 = 0.05;

impl<'a> Models<'a> {
    /// Draws for a rig. Another seed is another set of models.
    pub fn new(rig: &'a Rig, seed: u64) -> Self {
        Self { rig, seed }
    }

    /// The model with this number and the seed of its flight.
    pub fn draw(&self, index: u64) -> (Rig, u64) {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        rng.set_stream(index);
        let mut rig = self.rig.clone();
        let mut normal = || rng.sample::<f64, _>(StandardNormal);
        let mut drawn = |x: Uncertain| x.value + x.sigma * normal();
        let positive = |x: Uncertain, drawn: f64| drawn.max(LEAST_SHARE * x.value);

        let nominal = &self.rig.airframe;
        let airframe = &mut rig.airframe;
        airframe.mass_kg.value = positive(nominal.mass_kg, drawn(nominal.mass_kg));
        airframe.drag_n_s_per_m.value = drawn(nominal.drag_n_s_per_m).max(0.0);
        let ground = &mut airframe.ground_effect;
        ground.multiplier.value = drawn(nominal.ground_effect.multiplier).max(1.0);
        let height = nominal.ground_effect.height_m;
        ground.height_m.value = positive(height, drawn(height));
        let thrust = nominal.thrust;
        airframe.thrust.offset.value = drawn(thrust.offset);
        let gain = drawn(thrust.gain_n_per_unit);
        airframe.thrust.gain_n_per_unit.value = match thrust.hover_sigma {
            // The gain is what carries the weight at the throttle that hovers.
            Some(sigma) => {
                let hover = Uncertain { value: nominal.throttle_for(nominal.weight_n()), sigma };
                let range = drawn(hover) - airframe.thrust.offset.value;
                airframe.weight_n() / range.max(LEAST_SHARE * hover.value)
            }
            None => positive(thrust.gain_n_per_unit, gain),
        };
        let extra_s = drawn(self.rig.tracker.latency_s) - self.rig.tracker.latency_s.value;
        add_latency(&mut rig, extra_s);
        self.add_turbulence(&mut rig);
        (rig, self.seed.wrapping_add(index))
    }

    /// The rig's turbulence as wind that acts through the drag.
    fn add_turbulence(&self, rig: &mut Rig) {
        let disturbance = &self.rig.disturbance;
        let blows = rig.effects.iter().any(|effect| effect.name == "gusts");
        let drag_per_s = rig.airframe.drag_n_s_per_m.value / rig.airframe.mass_kg.value;
        if let (Some(sigma), Some(time_s), false) =
            (disturbance.turbulence_m_s2, disturbance.turbulence_time_s, blows)
            && drag_per_s > 0.0
        {
            let wind_m_s = (sigma / drag_per_s).min(20.0);
            add(rig, "gusts", &[("sigma_m_s", wind_m_s), ("correlation_time_s", time_s.clamp(0.01, 60.0))]);
        }
    }
}

/// Sightings that arrive later than the rig says, by up to half a second (or earlier, by up to 0.2 s).
pub(crate) fn add_latency(rig: &mut Rig, extra_s: f64) {
    let known = rig.effects.iter_mut().find(|effect| effect.name == "tracker-latency");
    let slot = known.and_then(|effect| effect.parameters.iter_mut().find(|(key, ..)| key == "extra_s"));
    match slot {
        Some((_, value, _)) => *value = (*value + extra_s).clamp(-0.2, 0.5),
        None => add(rig, "tracker-latency", &[("extra_s", extra_s.clamp(-0.2, 0.5))]),
    }
}

/// Adds an effect of the library.
pub(crate) fn add(rig: &mut Rig, name: &str, values: &[(&str, f64)]) {
    rig.effects.push(EffectEntry {
        name: name.to_owned(),
        parameters: values.iter().map(|(key, value)| ((*key).to_owned(), *value, 0)).collect(),
        at: Location { file: "drawn".into(), line: 0 },
    });
}

/// Adds an effect of the library to a rig that [`Models`] drew, with its values by their keys. What the tolerances drew of the same name
/// is part of it: latencies add up, all else is replaced.
pub fn add_to_drawn(plant: &mut Rig, name: &str, values: &[(&str, f64)]) {
    let before = plant.effects.iter().position(|known| known.name == name);
    match before.map(|at| plant.effects.remove(at)) {
        Some(known) if name == "tracker-latency" => {
            let own = known.parameters.iter().map(|(_, value, _)| value).sum::<f64>();
            let Some((key, value)) = values.first() else { return };
            add(plant, name, &[(key, (value + own).clamp(-0.2, 0.5))]);
        }
        _ => add(plant, name, values),
    }
}
