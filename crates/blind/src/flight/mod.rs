//! Flies a mission of a case and records what a bench would.

mod pilot;

use std::collections::VecDeque;

use bench_device::{Faults, PositionSample, Readback, Sticks, Time, TrackStatus};
use bench_recording::{Command, ReadbackAt, Record, Tick};
use bench_rig::{Mission, Rig};

use self::pilot::Pilot;
use crate::{
    cases::Lab,
    physics::{
        actuator::Converter,
        air::GRID_S,
        timing,
        tracker::{CameraState, Frame},
        world::{Series, Setting, World},
    },
    random::{self, Random},
};

/// A flight: what was recorded, and what only its maker knows.
pub(crate) struct Flown {
    pub records: Vec<Record>,
    pub trace: Trace,
}

/// What a flight was, for the detectability of its effects.
pub(crate) struct Trace {
    pub setting: Setting,
    pub trim: f64,
    /// Altitude [m] and speed [m/s] on the grid.
    pub path: Vec<[f64; 2]>,
    pub series: Series,
    /// When each command reached the pins [s], the command, and where the pin went.
    pub pins: Vec<[f64; 3]>,
    pub frames: Vec<Frame>,
}

/// One purpose of random numbers each.
const AIR: u64 = 1;
const TRACKER: u64 = 2;
const TIMING: u64 = 3;
const READBACK: u64 = 4;
const TRIM: u64 = 5;

/// One sigma of thrust from flight to flight: no two cells are equally full.
pub(crate) const TRIM_SIGMA: f64 = 0.003;

/// Time between two flights of a case, min.
const BETWEEN_MIN: f64 = 0.5;

/// The tracker looks on for so long after the mission, s ...
const LOOK_ON_S: f64 = 0.3;
/// ... and the loop runs on for so long, s: the last frames arrive before it ends, so that a recording's end does not
/// tell their latency.
const RUN_ON_S: f64 = 1.0;

/// Flies all missions of a case in turn.
pub(crate) fn fly_all(
    rig: &Rig,
    missions: &[Mission],
    lab: &Lab,
    mut each: impl FnMut(usize, Flown) -> Result<(), crate::BlindError>,
) -> Result<(), crate::BlindError> {
    let mut begins_min = 0.0;
    for (i, mission) in missions.iter().enumerate() {
        each(i, fly(rig, mission, lab, i as u64, begins_min))?;
        begins_min += mission.duration_s() / 60.0 + BETWEEN_MIN;
    }
    Ok(())
}

fn fly(rig: &Rig, mission: &Mission, lab: &Lab, flight: u64, begins_min: f64) -> Flown {
    let stream = |purpose| random::stream(lab.seed, lab.stream, flight, purpose);
    let period_s = rig.control_loop.period_s;
    // The same for every flight of a mission, whatever happens on it.
    let iterations = ((mission.duration_s() + RUN_ON_S) / period_s).floor() as u64;
    // A margin beyond the last exposure.
    let points = ((iterations as f64 * period_s + 2.0) / GRID_S) as usize;
    let mut air = stream(AIR);
    let series = Series {
        turbulence: lab.turbulence.series(points, &mut air),
        gust: lab.gust().map_or(Vec::new(), |gust| gust.series(points, &mut air)),
        miss: lab.miss().map_or(Vec::new(), |miss| miss.series(points, &mut air)),
    };
    let trim = 1.0 + TRIM_SIGMA * random::normal_within(&mut stream(TRIM), 3.0);
    let setting = Setting::of(rig, begins_min);
    let rest = rig.airframe.sticks.min;
    let mut tracker = stream(TRACKER);
    let frame_s = rig.tracker.frame_period_s;
    let first_exposure_s = random::uniform(&mut tracker, 0.0, frame_s);
    let mut bench = Bench {
        lab,
        world: World::new(lab.body(trim), setting, series, rest),
        camera_state: CameraState::some_time(&mut tracker),
        tracker,
        edges: VecDeque::new(),
        frames: Vec::new(),
        frame_count: ((mission.duration_s() + LOOK_ON_S) / frame_s).floor() as usize,
        frame_s,
        first_exposure_s,
    };
    let (records, pins) = bench.run(rig, mission, iterations, &mut stream(TIMING), &mut stream(READBACK));
    let World { setting, series, path, .. } = bench.world;
    Flown { records, trace: Trace { setting, trim, path, series, pins, frames: bench.frames } }
}

/// World and camera together.
struct Bench<'a> {
    lab: &'a Lab,
    world: World<'a>,
    camera_state: CameraState,
    tracker: Random,
    /// When the motors will hear of which pin.
    edges: VecDeque<(f64, f64)>,
    frames: Vec<Frame>,
    frame_count: usize,
    frame_s: f64,
    first_exposure_s: f64,
}

impl Bench<'_> {
    fn run(
        &mut self,
        rig: &Rig,
        mission: &Mission,
        iterations: u64,
        timing: &mut Random,
        readback: &mut Random,
    ) -> (Vec<Record>, Vec<[f64; 3]>) {
        let mut pilot = Pilot::new(rig, mission);
        let sticks = rig.airframe.sticks;
        let mut converter = Converter::new(sticks.min, sticks.max, rig.output.bits);
        let readback_noise = rig.output.readback_noise_fraction * (sticks.max - sticks.min);
        let (mut records, mut pins) = (Vec::new(), Vec::new());
        let (mut told, mut free_s) = (0, 0.0_f64);
        for index in 0..iterations {
            let scheduled_s = index as f64 * rig.control_loop.period_s;
            // An iteration that was held up holds up the next; none is left out.
            let started_s =
                scheduled_s.max(free_s) + timing::lateness_s(index, self.lab.loop_fault(), timing);
            self.advance(started_s);
            while let Some(frame) = self.frames.get(told).filter(|frame| frame.arrived_s <= started_s) {
                let sample = self.sample(frame, readback);
                if let Some(z_m) = frame.z_m {
                    pilot.observe(sample.exposed_at.seconds(), z_m);
                }
                records.push(Record::Position(sample));
                told += 1;
            }
            let spent_s = |random: &mut Random, usual_s: f64| usual_s * random::uniform(random, 0.8, 1.4);
            let sense_s = spent_s(timing, 2e-4);
            let control_s = spent_s(timing, 5e-5);
            let actuate_s = spent_s(timing, 1.2e-3);
            let started = Time::from_seconds(started_s);
            let (state, asked) = pilot.decide(started);
            let written_s = started_s + sense_s + control_s + 0.5 * actuate_s;
            let ended_s = started_s + sense_s + control_s + actuate_s;
            self.advance(written_s);
            let session_min = self.world.setting.begins_min + written_s / 60.0;
            let pin = converter.write(asked.throttle, session_min, self.lab.output_fault());
            self.edges.push_back((self.lab.heard_at(written_s), pin));
            pins.push([written_s, asked.throttle, pin]);

            let mut measured = |x: f64| x + readback_noise * random::normal(readback);
            let measured = Sticks {
                throttle: measured(pin),
                pitch: measured(asked.pitch),
                roll: measured(asked.roll),
                yaw: measured(asked.yaw),
            };
            records.push(Record::ControlState(state));
            records.push(Record::Command(Command { time: Time::from_seconds(written_s), sticks: asked }));
            let ended = Time::from_seconds(ended_s);
            let readback = Readback { device_time: ended, sticks: measured, faults: Faults::default() };
            records.push(Record::Readback(ReadbackAt { time: ended, readback }));
            records.push(Record::Tick(Tick {
                index,
                scheduled: Time::from_seconds(scheduled_s),
                started,
                sense_s,
                control_s,
                actuate_s,
                overrun: ended_s - scheduled_s > rig.control_loop.period_s,
            }));
            free_s = ended_s;
        }
        // The tracker is heard out, however late it is.
        self.advance(self.exposure_s(self.frame_count));
        for frame in &self.frames[told..] {
            records.push(Record::Position(self.sample(frame, readback)));
        }
        (records, pins)
    }

    fn exposure_s(&self, frame: usize) -> f64 {
        self.first_exposure_s + frame as f64 * self.frame_s
    }

    fn advance(&mut self, to_s: f64) {
        loop {
            let exposure_s = if self.frames.len() < self.frame_count {
                self.exposure_s(self.frames.len())
            } else {
                f64::INFINITY
            };
            let edge_s = self.edges.front().map_or(f64::INFINITY, |(at_s, _)| *at_s);
            let next_s = to_s.min(exposure_s).min(edge_s);
            self.world.advance(next_s);
            if edge_s <= next_s
                && let Some((_, pin)) = self.edges.pop_front()
            {
                self.world.heard = pin;
            } else if exposure_s <= next_s {
                let (z_m, load) = (self.world.altitude_m(), self.world.load());
                let frame =
                    self.lab.camera.expose(&mut self.camera_state, exposure_s, z_m, load, &mut self.tracker);
                self.frames.push(frame);
            } else {
                return;
            }
        }
    }

    /// A frame as the tracker tells it; sideways it sees noise alone.
    fn sample(&self, frame: &Frame, random: &mut Random) -> PositionSample {
        let camera = &self.lab.camera;
        let arrived_at = Time::from_seconds(frame.arrived_s);
        let mut sideways = || camera.rounded(camera.noise_m * random::normal(random));
        let beside_m = [sideways(), sideways()];
        let (position_m, status) = match frame.z_m {
            Some(z_m) => ([beside_m[0], beside_m[1], z_m], TrackStatus::Found),
            None => ([0.0; 3], TrackStatus::Lost),
        };
        PositionSample {
            exposed_at: arrived_at.shifted(-camera.believed_latency_s),
            arrived_at,
            position_m,
            status,
            ..Default::default()
        }
    }
}
