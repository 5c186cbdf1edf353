//! The loopback bench: a real output wired to its own input, and the virtual airframe flying, in the time of the wall clock, from the
//! voltages read back.

use bench_device::{Clock, DeviceError, PositionSample, PositionSource, Readback, Sticks, VoltageOutput};
use bench_plant::{
    effects::EffectError,
    lab::{Lab, SharedWorld, SimulatedTracker},
};
use bench_recording::Record;
use bench_rig::Rig;

use crate::{Sink, WallClock, simulate::truth};

/// The virtual lab in real time.
pub struct Loopback {
    clock: WallClock,
    world: SharedWorld,
    tracker: SimulatedTracker,
}

/// A real output whose readback moves the virtual airframe.
pub struct LoopbackOutput<'a, V> {
    output: &'a mut V,
    clock: WallClock,
    world: SharedWorld,
}

/// Positions of the virtual airframe.
pub struct LoopbackTracker {
    clock: WallClock,
    world: SharedWorld,
    tracker: SimulatedTracker,
}

impl Loopback {
    /// A lab for a rig, effects on the virtual airframe included, at rest at the clock's origin.
    pub fn new(rig: &Rig, seed: u64, clock: WallClock) -> Result<Self, EffectError> {
        let Lab { tracker, world, .. } = Lab::new(rig, seed)?;
        Ok(Self { clock, world, tracker })
    }

    /// The two ends, the output wrapped around a real one.
    pub fn ends<V: VoltageOutput>(self, output: &mut V) -> (LoopbackOutput<'_, V>, LoopbackTracker) {
        let Self { clock, world, tracker } = self;
        (LoopbackOutput { output, clock, world: world.clone() }, LoopbackTracker { clock, world, tracker })
    }
}

impl<V> LoopbackOutput<'_, V> {
    /// The real output.
    pub fn inner(&mut self) -> &mut V {
        self.output
    }

    /// The virtual airframe's world.
    pub fn world(&self) -> SharedWorld {
        self.world.clone()
    }
}

/// Hands the records of the truth made since the last call to a sink.
pub fn drain_truth(world: &SharedWorld, sink: &mut impl Sink) {
    world.drain_truth(|state| sink.take(Record::Truth(truth(&state))));
}

impl<V: VoltageOutput> VoltageOutput for LoopbackOutput<'_, V> {
    fn write(&mut self, sticks: Sticks) -> Result<(), DeviceError> {
        // NaN must reach the real output's own refusal, so that it is refused in one way.
        let driven = self.world.with(|world| world.driven(sticks));
        self.output.write(driven)
    }

    fn read_back(&mut self) -> Result<Option<Readback>, DeviceError> {
        let readback = self.output.read_back()?;
        if let Some(readback) = readback {
            let now = self.clock.now();
            self.world.with(|world| {
                world.advance_to(now);
                world.set_pins(readback.sticks);
            });
        }
        Ok(readback)
    }
}

impl PositionSource for LoopbackTracker {
    fn poll(&mut self) -> Result<Option<PositionSample>, DeviceError> {
        let now = self.clock.now();
        self.world.with(|world| world.advance_to(now));
        self.tracker.poll()
    }
}
