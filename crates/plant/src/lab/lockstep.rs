//! Several worlds that are waited for together, so that their airframes move in the lanes of one batch.
//!
//! Each world sees its exposures, its records of the truth and its effects' draws as if it were alone: only the steps between
//! them are shared, and a lane's step is what the world's own would be, to the last bit.

use bench_device::{Sticks, Time};

use super::{SharedWorld, Stretch, World};
use crate::{
    batch::{Batch, WIDTH},
    body::Body,
};

/// Up to [`WIDTH`] worlds, a lane each.
#[derive(Default)]
pub struct Lockstep {
    batch: Batch,
    lanes: [Option<Lane>; WIDTH],
}

struct Lane {
    world: SharedWorld,
    /// Effects act between the pins and the rotors, so that each step holds something else.
    is_varying: bool,
    /// What is left of the way to the next thing that happens; `None`: the world is where it was to go.
    stretch: Option<Stretch>,
}

impl Lockstep {
    /// No worlds in it.
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes a world into a free lane. It returns false where the world cannot share its steps: its airframe is no rigid body,
    /// or effects act on its air.
    pub fn enter(&mut self, lane: usize, world: &SharedWorld) -> bool {
        let own = world.borrow();
        let Body::SixDegree(body) = &own.body else { return false };
        if !own.effects.air.is_empty() {
            return false;
        }
        self.batch.enter(lane, body, &own.nominal, own.mass_kg);
        let is_varying = !(own.effects.actuator.is_empty() && own.effects.propulsion.is_empty());
        self.lanes[lane] = Some(Lane { world: world.clone(), is_varying, stretch: None });
        true
    }

    /// Leaves a lane to another world.
    pub fn leave(&mut self, lane: usize) {
        self.batch.leave(lane);
        self.lanes[lane] = None;
    }

    /// Moves each world on to its lane's deadline, as [`World::advance_to`] does.
    pub fn advance(&mut self, deadlines: &[Time; WIDTH]) {
        let Self { batch, lanes } = self;
        for (index, lane) in lanes.iter_mut().enumerate() {
            if let Some(lane) = lane {
                let mut world = lane.world.0.borrow_mut();
                // While it stood still others did not, and each step rounds.
                if let Body::SixDegree(body) = &world.body {
                    batch.put(index, body);
                }
                lane.stretch = world.begin_stretch(batch, index, deadlines[index], lane.is_varying);
            }
        }
        loop {
            let mut steps = u64::MAX;
            for (index, lane) in lanes.iter().enumerate() {
                let Some((lane, stretch)) = lane.as_ref().and_then(|lane| Some((lane, lane.stretch?))) else {
                    continue;
                };
                if lane.is_varying {
                    let mut world = lane.world.0.borrow_mut();
                    let sticks = world.push(stretch.dt_s);
                    world.hold(batch, index, sticks);
                    steps = 1;
                }
                steps = steps.min(stretch.steps);
            }
            if steps == u64::MAX {
                return;
            }
            batch.step(steps);
            for (index, lane) in lanes.iter_mut().enumerate() {
                let Some(lane) = lane else { continue };
                let Some(stretch) = &mut lane.stretch else { continue };
                stretch.steps -= steps;
                if stretch.steps == 0 {
                    let mut world = lane.world.0.borrow_mut();
                    world.now = stretch.until;
                    if let Body::SixDegree(body) = &mut world.body {
                        batch.tell(index, body);
                    }
                    lane.stretch = world.begin_stretch(batch, index, deadlines[index], lane.is_varying);
                }
            }
        }
    }
}

impl World {
    /// What its lane holds from now on.
    fn hold(&mut self, batch: &mut Batch, lane: usize, sticks: Sticks) {
        if let Body::SixDegree(body) = &mut self.body {
            batch.hold(lane, self.free_thrust_n, body, sticks);
        }
    }

    /// The next stretch, its steps told to the lane: their length, and what they hold unless that varies.
    fn begin_stretch(
        &mut self,
        batch: &mut Batch,
        lane: usize,
        deadline: Time,
        is_varying: bool,
    ) -> Option<Stretch> {
        let stretch = self.next_stretch(deadline);
        batch.set_step(lane, stretch.map_or(0.0, |stretch| stretch.dt_s));
        if let (Some(stretch), false) = (stretch, is_varying) {
            let pins = self.pins;
            self.free_thrust_n = self.nominal.free_thrust_n(pins.throttle);
            self.hold(batch, lane, pins);
            let drawn = self.charge_of_step(stretch.dt_s);
            // One by one, as steps add it: a product would be rounded once.
            for _ in 0..stretch.steps {
                self.charge_hover_min += drawn;
            }
        }
        stretch
    }
}
