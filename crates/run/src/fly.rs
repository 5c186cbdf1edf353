use std::fmt::Write as _;

use bench_control::{Controller, Landed};
use bench_device::{Clock, DeviceError, PositionSource, Time, VoltageOutput};
use bench_recording::{Command, Event, EventText, Level, ReadbackAt, Record, Tick};
use bench_rig::{Mission, Phase, Rig};

use crate::{
    Sink, StopReason, Summary,
    safety::Guard,
    summary::{FlightLog, LogEntry},
};

/// How a flight ended.
#[derive(Clone, Debug, PartialEq)]
pub enum Ending {
    /// The mission was flown to its end.
    Complete,
    /// A safety stop: the throttle went to rest first.
    Stopped(StopReason),
    /// A device failed; the throttle was sent to rest as far as the output still took it.
    Fault(DeviceError),
    /// The program itself failed, with these words; the throttle was sent to rest. Only where [`crate::fly_guarded`] flew.
    Panicked(String),
}

/// A flight that is over.
#[derive(Clone, Debug, PartialEq)]
pub struct Flown {
    /// How it ended.
    pub ending: Ending,
    /// What it achieved.
    pub summary: Summary,
}

/// Where a flight is, once an iteration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// Since the beginning.
    pub now: Time,
    /// What the controller is doing.
    pub phase: Phase,
    /// Predicted altitude, m.
    pub altitude_m: f64,
    /// Throttle asked for, in the rig's actuation unit.
    pub throttle: f64,
    /// Start of the iteration after its schedule, s.
    pub lateness_s: f64,
    /// From handing the outputs over to having them read back, s; `None` when that did not come in time.
    pub round_trip_s: Option<f64>,
}

/// What who watches a flight wants of it, once an iteration. From a `bool`: true goes on, false stops.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Directive {
    /// Go on as planned.
    GoOn,
    /// Throttle to rest.
    Stop(StopReason),
    /// Go on with holds at this altitude, m, within the rig's envelope.
    FlyAt(f64),
    /// Go on with the mission's landing.
    Land,
}

impl From<bool> for Directive {
    fn from(go_on: bool) -> Self {
        if go_on { Self::GoOn } else { Self::Stop(StopReason::Asked) }
    }
}

/// How long the loop goes on after the mission, so that the last positions still arrive, s.
const TAIL_S: f64 = 0.5;

/// Flies `mission` on three ends from the clock's present instant on, telling `sink` everything. `each` is called at the end of every iteration, with the
/// sink for what only the caller knows (a simulation's true state); what it returns is heeded
/// from the next iteration on, and recorded as an event.
///
/// No iteration allocates or locks, as long as the ends and the sink do not.
pub fn fly<C: Clock, V: VoltageOutput, P: PositionSource, S: Sink, D: Into<Directive>>(
    (clock, output, tracker): (&mut C, &mut V, &mut P),
    rig: &Rig,
    mission: &Mission,
    sink: &mut S,
    mut each: impl FnMut(&Progress, &mut S) -> D,
) -> Flown {
    let mut flight = Flight::new(rig, mission, clock.now());
    loop {
        let started = clock.wait_until(flight.scheduled);
        if let Some(ending) = flight.go_on(started, (clock, output, tracker), sink, &mut each) {
            return flight.over(ending);
        }
    }
}

/// The state of one flight.
pub(crate) struct Flight {
    controller: Controller,
    guard: Guard,
    log: FlightLog,
    period: Time,
    scheduled: Time,
    index: u64,
    phase: Option<Phase>,
    stopped: Option<StopReason>,
    finished_at: Option<Time>,
}

impl Flight {
    /// A flight that begins now.
    pub(crate) fn new(rig: &Rig, mission: &Mission, now: Time) -> Self {
        Self {
            controller: Controller::beginning_at(rig, mission, now),
            guard: Guard::new(rig.safety),
            log: FlightLog::with_capacity(rig, mission),
            period: Time::from_seconds(rig.control_loop.period_s),
            scheduled: now,
            index: 0,
            phase: None,
            stopped: None,
            finished_at: None,
        }
    }

    /// When the next iteration is due.
    pub(crate) fn scheduled(&self) -> Time {
        self.scheduled
    }

    /// The iteration that was waited for, and what who watches wants after it; returns how the flight ended, if it did.
    pub(crate) fn go_on<C: Clock, V: VoltageOutput, P: PositionSource, S: Sink, D: Into<Directive>>(
        &mut self,
        started: Result<Time, DeviceError>,
        (clock, output, tracker): (&mut C, &mut V, &mut P),
        sink: &mut S,
        each: &mut impl FnMut(&Progress, &mut S) -> D,
    ) -> Option<Ending> {
        let done = started.and_then(|started| self.iterate(started, clock, output, tracker, sink));
        let (progress, finished) = match done {
            Ok(done) => done,
            Err(error) => {
                // The output may be what failed; there is nothing more to be done for it.
                let _ = output.write(self.controller.at_rest());
                event(sink, clock.now(), Level::Error, format_args!("{error}"));
                return Some(Ending::Fault(error));
            }
        };
        let now = progress.now;
        match each(&progress, sink).into() {
            Directive::GoOn => {}
            Directive::Stop(reason) => self.stop(reason, now, sink),
            Directive::FlyAt(altitude_m) => self.fly_at(altitude_m, now, sink),
            Directive::Land => self.land(now, sink),
        }
        let is_over = finished && now.since_s(*self.finished_at.get_or_insert(now)) >= TAIL_S;
        is_over.then(|| self.stopped.map_or(Ending::Complete, Ending::Stopped))
    }

    /// What the flight achieved.
    pub(crate) fn over(self, ending: Ending) -> Flown {
        Flown { ending, summary: self.log.summarise() }
    }

    /// One iteration: returns where the flight is, and whether the mission is over.
    fn iterate<C: Clock, V: VoltageOutput, P: PositionSource>(
        &mut self,
        started: Time,
        clock: &mut C,
        output: &mut V,
        tracker: &mut P,
        sink: &mut impl Sink,
    ) -> Result<(Progress, bool), DeviceError> {
        while let Some(sample) = tracker.poll()? {
            self.controller.observe(&sample);
            self.guard.observe(&sample);
            self.log.observe(&sample);
            sink.take(Record::Position(sample));
        }
        let sensed = clock.now();
        let decision = self.controller.decide(started);
        let decided = clock.now();
        output.write(decision.sticks)?;
        let written = clock.now();
        let readback = output.read_back()?;
        let ended = clock.now();

        let late_s = ended.since_s(self.scheduled);
        let overrun = late_s > self.period.seconds();
        sink.take(Record::ControlState(decision.state));
        sink.take(Record::Command(Command { time: written, sticks: decision.sticks }));
        if let Some(readback) = readback {
            self.guard.observe_readback(started, &readback);
            sink.take(Record::Readback(ReadbackAt { time: ended, readback }));
        }
        sink.take(Record::Tick(Tick {
            index: self.index,
            scheduled: self.scheduled,
            started,
            sense_s: sensed.since_s(started),
            control_s: decided.since_s(sensed),
            actuate_s: ended.since_s(decided),
            overrun,
        }));
        self.log.decided(LogEntry {
            time: started,
            phase: decision.state.phase,
            setpoint_m: decision.state.setpoint_m,
            lateness_s: started.since_s(self.scheduled),
            actuate_s: ended.since_s(decided),
            answered: readback.is_some(),
            overrun,
        });
        if self.phase != Some(decision.state.phase) {
            self.phase = Some(decision.state.phase);
            event(sink, started, Level::Info, format_args!("phase {}", decision.state.phase));
        }
        if let Some(reason) = self.guard.check(started, decision.state.phase, overrun) {
            self.stop(reason, started, sink);
        }
        let scheduled = self.scheduled;
        self.schedule_next(ended);
        let progress = Progress {
            now: started,
            phase: decision.state.phase,
            altitude_m: decision.state.estimate_m[2],
            throttle: decision.sticks.throttle,
            lateness_s: started.since_s(scheduled),
            round_trip_s: readback.is_some().then(|| ended.since_s(decided)),
        };
        Ok((progress, decision.finished))
    }

    /// The next tick of the grid that is not past: a tick that was missed is left out, not caught up with.
    fn schedule_next(&mut self, ended: Time) {
        let period = self.period.nanos();
        let passed = ended.nanos().saturating_sub(self.scheduled.nanos()) / period;
        let on_time = ended.nanos() == self.scheduled.nanos() + passed * period;
        let ahead = if on_time && passed > 0 { passed } else { passed + 1 };
        self.index += ahead;
        self.scheduled = Time::from_nanos(self.scheduled.nanos() + ahead * period);
    }

    fn fly_at(&mut self, altitude_m: f64, now: Time, sink: &mut impl Sink) {
        match self.controller.fly_at(altitude_m, now) {
            Ok(()) => event(sink, now, Level::Info, format_args!("asked to hold {altitude_m:.3} m")),
            Err(refused) => {
                event(
                    sink,
                    now,
                    Level::Warning,
                    format_args!("asked to hold {altitude_m:.3} m, refused: {refused}"),
                );
            }
        }
    }

    fn land(&mut self, now: Time, sink: &mut impl Sink) {
        let words = match self.controller.land_now() {
            Ok(Landed::Begins) => "asked to land",
            Ok(Landed::Already) => "asked to land, which it does already",
            Ok(Landed::Stands) => "asked to land while it stands: the mission is over",
            Err(refused) => {
                return event(sink, now, Level::Warning, format_args!("asked to land, refused: {refused}"));
            }
        };
        event(sink, now, Level::Info, format_args!("{words}"));
    }

    /// The first reason to stop is the one that counts.
    fn stop(&mut self, reason: StopReason, now: Time, sink: &mut impl Sink) {
        if self.stopped.is_none() {
            self.stopped = Some(reason);
            self.controller.abort();
            event(sink, now, Level::Error, format_args!("stopped: {reason}"));
        }
    }
}

fn event(sink: &mut impl Sink, time: Time, level: Level, words: std::fmt::Arguments<'_>) {
    let mut text = EventText::new();
    // A text that is too long is cut, which is better than none.
    let _ = text.write_fmt(words);
    sink.take(Record::Event(Event { time, level, text }));
}
