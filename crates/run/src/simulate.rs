use bench_device::PositionSource;
use bench_plant::{
    effects::EffectError,
    lab::{Exposures, Lab, TrueState},
};
use bench_recording::{Record, Truth};
use bench_rig::{Mission, Rig};

use crate::{Directive, Flown, Progress, Sink, fly};

/// Why a simulation could not begin.
pub type SimulationError = EffectError;

/// Flies `mission` in the virtual lab, in lockstep, as fast as it goes. The same rig, mission and seed give the same
/// records. `each` is called every iteration; what it returns is heeded.
pub fn simulate<D: Into<Directive>>(
    rig: &Rig,
    mission: &Mission,
    seed: u64,
    sink: &mut impl Sink,
    each: impl FnMut(&Progress) -> D,
) -> Result<Flown, SimulationError> {
    simulate_on(rig, rig, mission, seed, sink, each)
}

/// The same where the lab is not what the controller takes it for: `plant` flies, while controller and safety stops go
/// by `rig`.
pub fn simulate_on<D: Into<Directive>>(
    plant: &Rig,
    rig: &Rig,
    mission: &Mission,
    seed: u64,
    sink: &mut impl Sink,
    mut each: impl FnMut(&Progress) -> D,
) -> Result<Flown, SimulationError> {
    let Lab { mut clock, mut output, mut tracker, world } = Lab::new(plant, seed)?;
    let ends = (&mut clock, &mut output, &mut tracker);
    Ok(fly(ends, rig, mission, sink, |progress, sink| {
        world.drain_truth(|state| sink.take(Record::Truth(truth(&state))));
        each(progress)
    }))
}

/// The same with positions that somebody makes of the camera's exposures, such as by rendering frames and tracking the marker
/// in them. `see` gets the exposures and gives the position source.
pub fn simulate_seen<P: PositionSource, D: Into<Directive>>(
    rig: &Rig,
    mission: &Mission,
    seed: u64,
    see: impl FnOnce(Exposures) -> P,
    sink: &mut impl Sink,
    mut each: impl FnMut(&Progress) -> D,
) -> Result<Flown, SimulationError> {
    let Lab { mut clock, mut output, world, .. } = Lab::new(rig, seed)?;
    let mut tracker = see(world.clone().into_exposures());
    let ends = (&mut clock, &mut output, &mut tracker);
    Ok(fly(ends, rig, mission, sink, |progress, sink| {
        world.drain_truth(|state| sink.take(Record::Truth(truth(&state))));
        each(progress)
    }))
}

/// The true state as recorded.
pub(crate) fn truth(state: &TrueState) -> Truth {
    let attitude = state.attitude;
    Truth {
        time: state.time,
        position_m: state.position_m.into(),
        velocity_m_s: state.velocity_m_s.into(),
        attitude: [attitude.w, attitude.i, attitude.j, attitude.k],
        body_rate_rad_s: state.body_rate_rad_s.into(),
        thrust_n: state.thrust_n,
        rotor_speed_ratio: state.rotor_speed_ratio,
        charge_hover_min: state.charge_hover_min,
    }
}
