//! Flights that are simulated together: each has a loop, a controller and a lab of its own, and they share the work of the physics.

use bench_device::Time;
use bench_plant::{
    batch::WIDTH,
    lab::{Lab, Lockstep},
};
use bench_rig::{Mission, Rig};

use crate::{Flown, SimulationError, fly, fly::Flight};

/// A flight in the virtual lab that nobody records.
#[derive(Clone, Copy, Debug)]
pub struct Simulation<'a> {
    /// What flies.
    pub plant: &'a Rig,
    /// What controller and safety stops go by.
    pub rig: &'a Rig,
    /// What is flown.
    pub mission: &'a Mission,
    /// Seed of everything random.
    pub seed: u64,
}

struct Aloft {
    index: usize,
    lab: Lab,
    flight: Flight,
}

/// Flies them all and gives, in their order, what each comes to: the same as [`simulate_on`](crate::simulate_on) gives for it
/// alone. The more there are, the fuller the lanes: a flight that ends leaves its lane to the next.
pub fn simulate_together(simulations: &[Simulation<'_>]) -> Vec<Result<Flown, SimulationError>> {
    let mut flown: Vec<Option<Result<Flown, SimulationError>>> = simulations.iter().map(|_| None).collect();
    let mut waiting = simulations.iter().enumerate();
    let mut lockstep = Lockstep::new();
    let mut lanes: [Option<Aloft>; WIDTH] = [const { None }; WIDTH];
    let mut wake = [Time::ZERO; WIDTH];
    loop {
        for (lane, place) in lanes.iter_mut().enumerate() {
            while place.is_none() {
                let Some((index, simulation)) = waiting.next() else { break };
                match Lab::new(simulation.plant, simulation.seed) {
                    Err(error) => flown[index] = Some(Err(error)),
                    Ok(lab) if lockstep.enter(lane, &lab.world) => {
                        let flight =
                            Flight::new(simulation.rig, simulation.mission, lab.world.borrow().now());
                        *place = Some(Aloft { index, lab, flight });
                    }
                    Ok(lab) => flown[index] = Some(Ok(alone(lab, simulation))),
                }
            }
        }
        if lanes.iter().all(Option::is_none) {
            // Each was waiting until it had a result or a lane, and left its lane with one.
            return flown.into_iter().flatten().collect();
        }
        for (place, wake) in lanes.iter_mut().zip(&mut wake) {
            if let Some(aloft) = place {
                *wake = aloft.lab.clock.wake(aloft.flight.scheduled());
            }
        }
        lockstep.advance(&wake);
        for (lane, place) in lanes.iter_mut().enumerate() {
            let Some(aloft) = place else { continue };
            let Lab { clock, output, tracker, world } = &mut aloft.lab;
            let mut each = |_: &_, (): &mut ()| {
                world.drain_truth(|_| ());
                true
            };
            let ending = aloft.flight.go_on(Ok(wake[lane]), (clock, output, tracker), &mut (), &mut each);
            let Some(ending) = ending else { continue };
            lockstep.leave(lane);
            if let Some(aloft) = place.take() {
                flown[aloft.index] = Some(Ok(aloft.flight.over(ending)));
            }
        }
    }
}

fn alone(lab: Lab, simulation: &Simulation<'_>) -> Flown {
    let Lab { mut clock, mut output, mut tracker, world } = lab;
    let ends = (&mut clock, &mut output, &mut tracker);
    fly(ends, simulation.rig, simulation.mission, &mut (), |_, (): &mut ()| {
        world.drain_truth(|_| ());
        true
    })
}
