//! The virtual lab: output, plant and tracker on one simulated clock, behind the traits of `bench_device`.
//!
//! The three ends share one [`World`]. Waiting on the [`SimulatedClock`] moves the world on; writing to the
//! [`SimulatedOutput`] changes the pins from that instant on; the [`SimulatedTracker`] hands out frames once they have
//! arrived. Everything random comes from the seed, so a run repeats exactly.

mod lockstep;

use std::{
    cell::{Ref, RefCell},
    collections::VecDeque,
    rc::Rc,
};

use bench_device::{
    Clock, DeviceError, Faults, PositionSample, PositionSource, Readback, Sticks, Time, TrackStatus,
    VoltageOutput,
};
use bench_rig::{Output, Rig, StickRange};
use nalgebra::{UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::{
    body::{Body, heading_rad},
    effects::{EffectError, Effects, Frame},
    nominal::{Air, Forces, Nominal},
};
pub use lockstep::Lockstep;

/// The three ends of the loop, and a window on the world behind them.
pub struct Lab {
    /// The clock; waiting on it moves the world.
    pub clock: SimulatedClock,
    /// The four outputs.
    pub output: SimulatedOutput,
    /// The position source.
    pub tracker: SimulatedTracker,
    /// What really happens.
    pub world: SharedWorld,
}

impl Lab {
    /// A lab for a rig, its effects included, with the airframe at rest on the surface at time zero.
    pub fn new(rig: &Rig, seed: u64) -> Result<Self, EffectError> {
        let world = SharedWorld(Rc::new(RefCell::new(World::new(rig, seed)?)));
        Ok(Self {
            clock: SimulatedClock(world.clone()),
            output: SimulatedOutput::new(world.clone(), rig, seed),
            tracker: SimulatedTracker(world.clone()),
            world,
        })
    }
}

/// The plant, its effects and the frames on their way.
pub struct World {
    nominal: Nominal,
    mass_kg: f64,
    effects: Effects,
    body: Body,
    pins: Sticks,
    now: Time,
    step_s: f64,
    /// Thrust out of the ground effect over the last step, N.
    free_thrust_n: f64,
    charge_hover_min: f64,
    camera: Camera,
    truth_period: Time,
    truth_due: Time,
    truth: Vec<TrueState>,
}

/// Equal steps to the next thing that happens in a world.
#[derive(Clone, Copy)]
struct Stretch {
    until: Time,
    dt_s: f64,
    steps: u64,
}

/// The airframe as it really is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrueState {
    /// When.
    pub time: Time,
    /// World frame, m.
    pub position_m: Vector3<f64>,
    /// World frame, m/s.
    pub velocity_m_s: Vector3<f64>,
    /// Body to world.
    pub attitude: UnitQuaternion<f64>,
    /// Body frame, rad/s.
    pub body_rate_rad_s: Vector3<f64>,
    /// Vertical thrust of all rotors, ground effect included, N.
    pub thrust_n: f64,
    /// Rotor speed over rotor speed at hover.
    pub rotor_speed_ratio: f64,
    /// Charge drawn, in minutes of hover.
    pub charge_hover_min: f64,
}

/// Positions as a tracker would report them: exposure, noise, rounding, transport.
struct Camera {
    frame_period: Time,
    nominal_latency_s: f64,
    resolution_m: f64,
    noise_m: f64,
    heading_noise_rad: Option<f64>,
    dropout_probability: f64,
    rng: ChaCha8Rng,
    exposure_due: Time,
    on_the_way: VecDeque<PositionSample>,
    /// Where somebody else makes frames and positions of exposures.
    exposures: Option<VecDeque<Exposure>>,
}

/// A frame's exposure, for whoever renders what the camera sees. The effects on the tracker have acted on it: they are in the
/// frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure {
    /// When, in the middle of the exposure.
    pub exposed_at: Time,
    /// When the frame reaches the host.
    pub arrives_at: Time,
    /// World frame, m.
    pub position_m: Vector3<f64>,
    /// World frame, m/s.
    pub velocity_m_s: Vector3<f64>,
    /// Body to world.
    pub attitude: UnitQuaternion<f64>,
    /// Body frame, rad/s.
    pub body_rate_rad_s: Vector3<f64>,
}

/// Random streams of the lab itself; those of effects begin far above.
const TRACKER_STREAM: u64 = 1;
const OUTPUT_STREAM: u64 = 2;

fn stream(seed: u64, stream: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(stream);
    rng
}

impl World {
    fn new(rig: &Rig, seed: u64) -> Result<Self, EffectError> {
        let nominal = Nominal::new(&rig.airframe);
        let effects = Effects::from_rig(rig, seed)?;
        let mut mass_kg = nominal.mass_kg;
        for effect in &effects.air {
            effect.mass(&mut mass_kg);
        }
        Ok(Self {
            nominal,
            mass_kg,
            effects,
            body: Body::at_rest(rig.plant.model, &rig.airframe),
            pins: rig.airframe.sticks.at_rest(),
            now: Time::ZERO,
            step_s: rig.plant.step_s,
            free_thrust_n: 0.0,
            charge_hover_min: 0.0,
            camera: Camera::new(rig, stream(seed, TRACKER_STREAM)),
            truth_period: Time::from_seconds(rig.plant.truth_period_s),
            truth_due: Time::ZERO,
            truth: Vec::with_capacity(64),
        })
    }

    /// The present instant of the world.
    pub fn now(&self) -> Time {
        self.now
    }

    /// Sets what the outputs' pins hold from now on. For benches whose output is real.
    pub fn set_pins(&mut self, sticks: Sticks) {
        self.pins = sticks;
    }

    /// What effects on the command's way make of it.
    pub fn driven(&mut self, mut sticks: Sticks) -> Sticks {
        for effect in &mut self.effects.actuator {
            effect.drive(&mut sticks);
        }
        sticks
    }

    /// Moves the world on to `deadline`, stopping at each exposure and each record of the truth.
    pub fn advance_to(&mut self, deadline: Time) {
        while let Some(stretch) = self.next_stretch(deadline) {
            for _ in 0..stretch.steps {
                self.step(stretch.dt_s);
            }
            self.now = stretch.until;
        }
    }

    /// What is due now, then the steps to what comes next: equal ones, none longer than the rig's.
    fn next_stretch(&mut self, deadline: Time) -> Option<Stretch> {
        if self.now == self.truth_due {
            let truth = self.true_state();
            self.truth.push(truth);
            self.truth_due = Time::from_nanos(self.truth_due.nanos() + self.truth_period.nanos());
        }
        if self.now == self.camera.exposure_due {
            self.expose();
        }
        if self.now >= deadline {
            return None;
        }
        let until = deadline.min(self.truth_due).min(self.camera.exposure_due);
        let span_s = until.since_s(self.now);
        let steps = (span_s / self.step_s - 1e-9).ceil().max(1.0);
        Some(Stretch { until, dt_s: span_s / steps, steps: steps as u64 })
    }

    /// The airframe as it is now.
    pub fn true_state(&self) -> TrueState {
        let air = self.body.air(self.free_thrust_n);
        TrueState {
            time: self.now,
            position_m: self.body.position_m(),
            velocity_m_s: self.body.velocity_m_s(),
            attitude: self.body.attitude(),
            body_rate_rad_s: self.body.body_rate_rad_s(),
            thrust_n: self.forces().thrust_n(&air),
            rotor_speed_ratio: (self.free_thrust_n / self.nominal.weight_n).sqrt(),
            charge_hover_min: self.charge_hover_min,
        }
    }

    /// Takes the records of the truth made since the last call, oldest first.
    pub fn drain_truth(&mut self) -> impl Iterator<Item = TrueState> + '_ {
        self.truth.drain(..)
    }

    fn forces(&self) -> Forces<'_> {
        Forces {
            nominal: &self.nominal,
            effects: &self.effects,
            free_thrust_n: self.free_thrust_n,
            mass_kg: self.mass_kg,
        }
    }

    #[inline]
    fn step(&mut self, dt_s: f64) {
        let sticks = self.push(dt_s);
        let free_thrust_n = self.free_thrust_n;
        if !self.effects.air.is_empty() {
            let air: Air = self.body.air(free_thrust_n);
            for effect in &mut self.effects.air {
                effect.advance(dt_s, &air);
            }
        }
        let forces =
            Forces { nominal: &self.nominal, effects: &self.effects, free_thrust_n, mass_kg: self.mass_kg };
        self.body.step(dt_s, &forces, sticks);
    }

    /// From the pins to the thrust over a step; returns what the sticks are behind the effects on their way.
    #[inline]
    fn push(&mut self, dt_s: f64) -> Sticks {
        let mut sticks = self.pins;
        for effect in &mut self.effects.actuator {
            effect.actuate(dt_s, &mut sticks);
        }
        let mut free_thrust_n = self.nominal.free_thrust_n(sticks.throttle);
        for effect in &mut self.effects.propulsion {
            effect.propel(dt_s, &mut free_thrust_n);
        }
        self.free_thrust_n = free_thrust_n;
        self.charge_hover_min += self.charge_of_step(dt_s);
        sticks
    }

    #[inline]
    fn charge_of_step(&self, dt_s: f64) -> f64 {
        dt_s * self.free_thrust_n / self.nominal.weight_n / 60.0
    }

    fn expose(&mut self) {
        let mut frame = Frame {
            position_m: self.body.position_m(),
            latency_s: self.camera.nominal_latency_s,
            lost: false,
        };
        for effect in &mut self.effects.tracker {
            effect.expose(&mut frame);
        }
        if self.camera.exposures.is_none() {
            self.camera.take(self.now, frame, heading_rad(&self.body.attitude()));
        } else {
            let exposure = Exposure {
                exposed_at: self.now,
                arrives_at: self.now.shifted(frame.latency_s),
                position_m: frame.position_m,
                velocity_m_s: self.body.velocity_m_s(),
                attitude: self.body.attitude(),
                body_rate_rad_s: self.body.body_rate_rad_s(),
            };
            self.camera.pass_on(exposure, frame.lost);
        }
    }
}

impl Camera {
    fn new(rig: &Rig, mut rng: ChaCha8Rng) -> Self {
        let tracker = &rig.tracker;
        // No camera is in step with the loop: the first exposure falls anywhere in a frame period.
        let first_exposure = Time::from_seconds(rng.random_range(0.0..tracker.frame_period_s));
        Self {
            frame_period: Time::from_seconds(tracker.frame_period_s),
            nominal_latency_s: tracker.latency_s.value,
            resolution_m: tracker.resolution_m,
            noise_m: tracker.noise_m,
            heading_noise_rad: tracker.heading_noise_rad,
            dropout_probability: tracker.dropout_probability,
            rng,
            exposure_due: first_exposure,
            on_the_way: VecDeque::with_capacity(1024),
            exposures: None,
        }
    }

    /// An exposure instead of a position: noise and rounding are left to the frame.
    fn pass_on(&mut self, mut exposure: Exposure, lost: bool) {
        self.exposure_due = Time::from_nanos(exposure.exposed_at.nanos() + self.frame_period.nanos());
        let dropped = self.rng.random::<f64>() < self.dropout_probability;
        let Some(exposures) = &mut self.exposures else { return };
        if !(dropped || lost) {
            let last_arrival = exposures.back().map_or(Time::ZERO, |last| last.arrives_at);
            exposure.arrives_at = exposure.arrives_at.max(last_arrival);
            exposures.push_back(exposure);
        }
    }

    fn take(&mut self, now: Time, frame: Frame, heading_rad: f64) {
        self.exposure_due = Time::from_nanos(now.nanos() + self.frame_period.nanos());
        // All draws are made for every frame, so that a lost frame does not shift the noise of the next.
        let dropped = self.rng.random::<f64>() < self.dropout_probability;
        let noise = Vector3::from_fn(|_, _| self.normal() * self.noise_m);
        let heading_noise = self.normal() * self.heading_noise_rad.unwrap_or(0.0);
        if dropped || frame.lost {
            return;
        }
        // Frames leave the pipeline in the order in which they entered it.
        let last_arrival = self.on_the_way.back().map_or(Time::ZERO, |sample| sample.arrived_at);
        let arrived_at = now.shifted(frame.latency_s).max(last_arrival);
        let position = (frame.position_m + noise).map(|x| self.rounded(x));
        self.on_the_way.push_back(PositionSample {
            exposed_at: arrived_at.shifted(-self.nominal_latency_s),
            arrived_at,
            position_m: position.into(),
            heading_rad: self.heading_noise_rad.map(|_| heading_rad + heading_noise),
            pixel: [0.0; 2],
            size_px: 0.0,
            status: TrackStatus::Found,
        });
    }

    fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.rng)
    }

    fn rounded(&self, x: f64) -> f64 {
        if self.resolution_m > 0.0 { (x / self.resolution_m).round() * self.resolution_m } else { x }
    }
}

/// A handle on the world that the three ends share.
#[derive(Clone)]
pub struct SharedWorld(Rc<RefCell<World>>);

impl SharedWorld {
    /// A look at the world between two calls of its ends.
    pub fn borrow(&self) -> Ref<'_, World> {
        self.0.borrow()
    }

    /// Does something to the world. For benches that advance it themselves.
    pub fn with<T>(&self, act: impl FnOnce(&mut World) -> T) -> T {
        act(&mut self.0.borrow_mut())
    }

    /// From now on the tracker gets exposures, which [`Exposures::poll`] hands out, and no positions.
    pub fn into_exposures(self) -> Exposures {
        self.0.borrow_mut().camera.exposures = Some(VecDeque::with_capacity(1024));
        Exposures(self)
    }

    /// Hands the records of the truth made since the last call to `take`, oldest first.
    pub fn drain_truth(&self, take: impl FnMut(TrueState)) {
        self.0.borrow_mut().drain_truth().for_each(take);
    }
}

/// The world's own time: waiting moves the world.
pub struct SimulatedClock(SharedWorld);

impl SimulatedClock {
    /// When one who waits for `deadline` wakes up. Nothing moves: that is left to a [`Lockstep`].
    pub fn wake(&mut self, deadline: Time) -> Time {
        let mut world = self.0.0.borrow_mut();
        let lateness_s: f64 = world.effects.timing.iter_mut().map(|effect| effect.lateness_s()).sum();
        world.now.max(deadline).shifted(lateness_s.max(0.0))
    }
}

impl Clock for SimulatedClock {
    fn now(&self) -> Time {
        self.0.borrow().now
    }

    fn wait_until(&mut self, deadline: Time) -> Result<Time, DeviceError> {
        let wake = self.wake(deadline);
        self.0.0.borrow_mut().advance_to(wake);
        Ok(wake)
    }
}

/// A DAC with range, resolution and hold, and an ADC that reads it back with noise.
pub struct SimulatedOutput {
    world: SharedWorld,
    output: Output,
    sticks: StickRange,
    readback_noise: f64,
    rng: ChaCha8Rng,
    clamped: bool,
}

impl SimulatedOutput {
    fn new(world: SharedWorld, rig: &Rig, seed: u64) -> Self {
        let range = rig.airframe.sticks.max - rig.airframe.sticks.min;
        Self {
            world,
            output: rig.output,
            sticks: rig.airframe.sticks,
            readback_noise: rig.output.readback_noise_fraction * range,
            rng: stream(seed, OUTPUT_STREAM),
            clamped: false,
        }
    }
}

impl VoltageOutput for SimulatedOutput {
    fn write(&mut self, sticks: Sticks) -> Result<(), DeviceError> {
        const CHANNELS: [&str; 4] = ["throttle", "pitch", "roll", "yaw"];
        for (channel, value) in CHANNELS.into_iter().zip(sticks.to_array()) {
            if !value.is_finite() {
                return Err(DeviceError::BadCommand { device: "simulated output", channel, value });
            }
        }
        self.clamped =
            sticks.to_array().iter().any(|value| !(self.sticks.min..=self.sticks.max).contains(value));
        let mut world = self.world.0.borrow_mut();
        let driven = world.driven(sticks);
        world.set_pins(driven.map(|value| self.output.on_the_pin(&self.sticks, value)));
        Ok(())
    }

    fn read_back(&mut self) -> Result<Option<Readback>, DeviceError> {
        let world = self.world.borrow();
        let (device_time, pins) = (world.now, world.pins);
        let sticks = pins.map(|value| {
            let noise: f64 = StandardNormal.sample(&mut self.rng);
            value + noise * self.readback_noise
        });
        let faults = Faults { clamped: self.clamped, ..Faults::default() };
        Ok(Some(Readback { device_time, sticks, faults }))
    }
}

/// Hands out exposures once their frames have arrived.
pub struct Exposures(SharedWorld);

impl Exposures {
    /// The next exposure whose frame has arrived and was not yet returned, oldest first.
    pub fn poll(&mut self) -> Option<Exposure> {
        let mut world = self.0.0.borrow_mut();
        let now = world.now;
        let exposures = world.camera.exposures.as_mut()?;
        let arrived = exposures.front().is_some_and(|exposure| exposure.arrives_at <= now);
        if arrived { exposures.pop_front() } else { None }
    }
}

/// Hands out frames once they have arrived.
pub struct SimulatedTracker(SharedWorld);

impl PositionSource for SimulatedTracker {
    fn poll(&mut self) -> Result<Option<PositionSample>, DeviceError> {
        let mut world = self.0.0.borrow_mut();
        let now = world.now;
        let frames = &mut world.camera.on_the_way;
        if frames.front().is_some_and(|sample| sample.arrived_at <= now) {
            Ok(frames.pop_front())
        } else {
            Ok(None)
        }
    }
}
