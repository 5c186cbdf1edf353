use std::{
    cell::RefCell,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc,
    },
    time::Duration,
};

use bench_dac::{Calibration, DacError, Identity, LinkCounts, Psoc5, Safe};
use bench_device::{Clock, DeviceError, PositionSample, PositionSource, Time, VoltageOutput};
use bench_kinect::{
    Frame, TrackedFrames,
    track::{Sighting, Tracker},
    usb::{self, Blocks, DriverError, Kinect, Settings, Statistics, Wanted},
};
use bench_recording::{Event, EventText, Level, Record, Recorder};
use bench_rig::{Bench, Calibration as CameraCalibration, Mission, Rig};
use bench_run::{
    Directive, Ending, Flown, Granted, Loopback, LoopbackOutput, Progress, Sink as _, StopReason, Tee,
    WallClock, await_marker, drain_truth, fly_guarded,
};
use bench_view::{Controls, Frames};
use rtrb::Producer;
use tokio::sync::mpsc::UnboundedSender;

use crate::{
    live::{Ends, directive},
    seen::Watch,
};

/// How long the tracker may take to see the marker before arming, s.
const MARKER_PATIENCE_S: f64 = 3.0;

/// How long a port that went away in flight is waited for, to see that the outputs are at zero.
const RETURN_PATIENCE: Duration = Duration::from_secs(5);
const ZERO_PATIENCE: Duration = Duration::from_millis(500);

/// What the loop's thread works with.
pub struct LoopThread {
    pub port: String,
    pub rig: Rig,
    pub seed: u64,
    /// How a real airframe is seen; `None` where it is virtual.
    pub seeing: Option<Seeing>,
    /// Where its frames are shown, and what else the live page has of the flight.
    pub frames: Option<Frames>,
    pub ends: Option<Ends>,
    pub stop: Arc<AtomicBool>,
    pub progress: Producer<Progress>,
}

/// What is flown, and what the page asks of it meanwhile.
struct Flies {
    mission: Mission,
    controls: Option<Controls>,
}

/// Which Kinect sees the airframe, and how.
#[derive(Clone)]
pub struct Seeing {
    pub wanted: Wanted,
    pub settings: Settings,
    pub calibration: CameraCalibration,
}

/// The Kinect that sees.
pub struct Sees {
    pub model: String,
    pub serial: String,
    pub blocks: Blocks,
}

impl std::fmt::Display for Sees {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}, serial number {}", self.model, self.serial)
    }
}

/// What became of its frames.
pub struct Saw {
    pub statistics: Statistics,
    pub watch: Watch,
}

/// The board is there and calibrated, and the Kinect where one is needed.
pub struct Ready {
    pub granted: Granted,
    pub identity: Identity,
    pub calibration: Calibration,
    pub sees: Option<Sees>,
}

impl Ready {
    /// What was checked, a line each.
    pub fn in_words(&self, port: &str) -> Vec<String> {
        let checked =
            if self.sees.is_some() { "in the board's memory, outputs checked at zero" } else { "measured" };
        let board = [
            format!("{port}: {}; {}", self.identity, self.granted),
            format!("loop from outputs to inputs, {checked}: {}", self.calibration),
        ];
        board.into_iter().chain(self.sees.as_ref().map(ToString::to_string)).collect()
    }
}

/// Why a device is not ready.
#[derive(Debug)]
pub enum NotReady {
    Board(DacError),
    Kinect(DriverError),
}

impl std::fmt::Display for NotReady {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Board(error) => error.fmt(f),
            Self::Kinect(error) => error.fmt(f),
        }
    }
}

/// What the loop's thread is told next.
pub enum Order {
    Fly(Recorder, Mission),
}

/// The flight is over, and the throttle at rest.
pub struct Landed {
    /// The flight, or why it did not begin.
    pub outcome: Result<Flown, NotArmed>,
    pub safe: Safe,
    pub counts: LinkCounts,
    pub saw: Option<Saw>,
    pub recorder: Recorder,
}

impl Landed {
    /// Why another order may come: the marker was not seen, so nothing was armed, and the devices are as they were.
    pub fn missed_marker(&self) -> Option<&NotArmed> {
        self.outcome.as_ref().err().filter(|error| matches!(error, NotArmed::NoMarker))
    }
}

/// Why the outputs were not armed.
#[derive(Debug)]
pub enum NotArmed {
    Board(DacError),
    Kinect(DriverError),
    Tracker(DeviceError),
    NoMarker,
    Effects(bench_plant::effects::EffectError),
    Stopped,
}

impl std::fmt::Display for NotArmed {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Board(error) => error.fmt(f),
            Self::Kinect(error) => error.fmt(f),
            Self::Tracker(error) => error.fmt(f),
            Self::NoMarker => write!(
                f,
                "the tracker has not seen the marker for {MARKER_PATIENCE_S} s; put the airframe where the camera sees it"
            ),
            Self::Effects(error) => error.fmt(f),
            Self::Stopped => write!(f, "asked to stop"),
        }
    }
}

impl LoopThread {
    /// Flies when it is told to. Where the marker is not seen it waits for another order, which it learns not to come when the
    /// orders' sender is dropped.
    pub fn run(
        mut self,
        ready: &mpsc::Sender<Result<Ready, NotReady>>,
        orders: &mpsc::Receiver<Order>,
        landed: &UnboundedSender<Landed>,
    ) {
        // Before port and Kinect are opened: their threads inherit the priority.
        let granted = Granted::ask();
        let (mut board, kinect) = match self.connect() {
            Ok((board, kinect)) => {
                let sees = kinect.as_ref().map(|kinect| Sees {
                    model: kinect.model().to_string(),
                    serial: kinect.serial().to_owned(),
                    blocks: kinect.blocks().clone(),
                });
                let (identity, calibration) = (board.identity(), board.calibration());
                let _ = ready.send(Ok(Ready { granted, identity, calibration, sees }));
                (board, kinect)
            }
            Err(error) => {
                let _ = ready.send(Err(error));
                return;
            }
        };
        let Some((kinect, seeing)) = kinect.zip(self.seeing.take()) else {
            while let Ok(order) = orders.recv() {
                let (mut flies, mut sink) = self.take_order(order);
                let outcome = self.fly_virtual(WallClock::start(), &mut board, &mut flies, &mut sink);
                let safe = make_safe(&mut board, &outcome);
                let recorder = self.take_back(flies, sink);
                let over = Landed { outcome, safe, counts: board.counts(), saw: None, recorder };
                if !told(landed, over) {
                    return;
                }
            }
            return;
        };
        // Who has a page sees the scene before START; without one the frames begin with the flight.
        let watches = self.ends.is_some();
        let mut order = None;
        if !watches {
            let Ok(given) = orders.recv() else { return };
            order = Some(given);
        }
        let clock = WallClock::start();
        let watched = RefCell::new(Watch::default());
        let mut frames = self.frames.take();
        let watch = |frame: &Frame, tracker: &Tracker, sighting: &Sighting| {
            watched.borrow_mut().see(frame, tracker, sighting);
            if let Some(frames) = &mut frames {
                frames.see(frame, tracker, sighting);
            }
        };
        let latency_s = self.rig.tracker.latency_s.value;
        let streaming = match kinect.stream(seeing.settings, move || clock.now()) {
            Ok(streaming) => streaming,
            Err(error) => {
                // It is told when it is to fly.
                let Some(order) = order.or_else(|| orders.recv().ok()) else { return };
                let (flies, sink) = self.take_order(order);
                let outcome = Err(NotArmed::Kinect(error));
                let safe = make_safe(&mut board, &outcome);
                let recorder = self.take_back(flies, sink);
                told(landed, Landed { outcome, safe, counts: board.counts(), saw: None, recorder });
                return;
            }
        };
        let mut tracker = TrackedFrames::new(streaming, Tracker::new(&seeing.calibration), latency_s, watch);
        while let Some(order) = order.take().or_else(|| look_until_ordered(clock, &mut tracker, orders)) {
            let (mut flies, mut sink) = self.take_order(order);
            // What was seen before START is no part of the flight, whose time begins here.
            watched.take();
            let mut since = Since { origin: clock.now(), source: &mut tracker };
            let ends = (&mut board, &mut since);
            let outcome = self.fly(WallClock::start(), ends, &mut flies, &mut sink, Psoc5::arm, |_| {});
            // Before the Kinect is closed, which may take its time.
            let safe = make_safe(&mut board, &outcome);
            let saw = Some(Saw { statistics: tracker.frames().statistics(), watch: watched.take() });
            let recorder = self.take_back(flies, sink);
            let over = Landed { outcome, safe, counts: board.counts(), saw, recorder };
            if over.missed_marker().is_none() {
                drop(tracker);
                told(landed, over);
                return;
            }
            told(landed, over);
        }
    }

    /// What a flight needs of an order, and of the page.
    fn take_order(&mut self, Order::Fly(recorder, mission): Order) -> (Flies, Tee<Recorder>) {
        let (watcher, controls) = self.ends.take().map(|ends| (ends.watcher, ends.controls)).unzip();
        (Flies { mission, controls }, Tee::new(recorder, watcher))
    }

    /// The recorder of a flight that is over; what the page has of it is kept for another.
    fn take_back(&mut self, flies: Flies, sink: Tee<Recorder>) -> Recorder {
        let (recorder, watcher) = sink.into_parts();
        self.ends = watcher.zip(flies.controls).map(|(watcher, controls)| Ends { watcher, controls });
        recorder
    }

    /// Kinect first: it moves nothing.
    fn connect(&self) -> Result<(Psoc5, Option<Kinect>), NotReady> {
        let kinect = self.seeing.as_ref().map(|seeing| usb::open(&seeing.wanted));
        let kinect = kinect.transpose().map_err(NotReady::Kinect)?;
        let mut board = Psoc5::connect(&self.port, &self.rig).map_err(NotReady::Board)?;
        let checked = if self.rig.bench == Bench::Transmitter {
            board.check_at_zero()
        } else {
            board.calibrate().map(|_| ())
        };
        checked.map_err(NotReady::Board)?;
        Ok((board, kinect))
    }

    fn fly_virtual(
        &mut self,
        clock: WallClock,
        board: &mut Psoc5,
        flies: &mut Flies,
        sink: &mut Tee<Recorder>,
    ) -> Result<Flown, NotArmed> {
        let lab = Loopback::new(&self.rig, self.seed, clock).map_err(NotArmed::Effects)?;
        let (mut output, mut tracker) = lab.ends(board);
        let world = output.world();
        let arm = |output: &mut LoopbackOutput<'_, Psoc5>| output.inner().arm();
        self.fly(clock, (&mut output, &mut tracker), flies, sink, arm, |sink| drain_truth(&world, sink))
    }

    /// Waits for the marker, arms, flies; `each` is called every iteration.
    fn fly<V: VoltageOutput>(
        &mut self,
        mut clock: WallClock,
        (output, tracker): (&mut V, &mut impl PositionSource),
        flies: &mut Flies,
        sink: &mut Tee<Recorder>,
        arm: impl FnOnce(&mut V) -> Result<(), DacError>,
        mut each: impl FnMut(&mut Tee<Recorder>),
    ) -> Result<Flown, NotArmed> {
        let seen = await_marker(&mut clock, tracker, MARKER_PATIENCE_S).map_err(NotArmed::Tracker)?;
        let pressed = flies.controls.as_ref().is_some_and(Controls::stopped);
        if pressed || self.stop.load(Ordering::Relaxed) {
            return Err(NotArmed::Stopped);
        }
        if !seen {
            return Err(NotArmed::NoMarker);
        }
        arm(output).map_err(NotArmed::Board)?;
        let text = EventText::from("armed").unwrap_or_default();
        sink.take(Record::Event(Event { time: clock.now(), level: Level::Info, text }));
        let (stop, progress) = (&self.stop, &mut self.progress);
        let ends = (&mut clock, output, tracker);
        Ok(fly_guarded(ends, &self.rig, &flies.mission, sink, |now, sink| {
            each(sink);
            // A screen that is behind misses an iteration.
            let _ = progress.push(*now);
            if stop.load(Ordering::Relaxed) {
                return Directive::Stop(StopReason::Asked);
            }
            directive(flies.controls.as_mut())
        }))
    }
}

/// Positions in the time of a clock that began at `origin` of the source's.
struct Since<'a, P> {
    origin: Time,
    source: &'a mut P,
}

impl<P: PositionSource> PositionSource for Since<'_, P> {
    fn poll(&mut self) -> Result<Option<PositionSample>, DeviceError> {
        let since = |time: Time| Time::from_nanos(time.nanos().saturating_sub(self.origin.nanos()));
        let sample = self.source.poll()?;
        Ok(sample.map(|sample| PositionSample {
            exposed_at: since(sample.exposed_at),
            arrived_at: since(sample.arrived_at),
            ..sample
        }))
    }
}

/// How often frames are looked at before START, s.
const LOOKS_S: f64 = 0.01;

/// Has frames tracked, and so shown, until there is an order; `None` when none will come. A Kinect that fails meanwhile fails again when it
/// is to fly, where it is told.
fn look_until_ordered(
    mut clock: WallClock,
    tracker: &mut impl PositionSource,
    orders: &mpsc::Receiver<Order>,
) -> Option<Order> {
    loop {
        match orders.try_recv() {
            Ok(order) => return Some(order),
            Err(mpsc::TryRecvError::Disconnected) => return None,
            Err(mpsc::TryRecvError::Empty) => {}
        }
        while tracker.poll().is_ok_and(|sample| sample.is_some()) {}
        let next = clock.now().shifted(LOOKS_S);
        if clock.wait_until(next).is_err() {
            return orders.recv().ok();
        }
    }
}

/// Tells that a flight is over; whether another order may come.
fn told(landed: &UnboundedSender<Landed>, over: Landed) -> bool {
    let again = over.missed_marker().is_some();
    landed.send(over).is_ok() && again
}

fn make_safe(board: &mut Psoc5, outcome: &Result<Flown, NotArmed>) -> Safe {
    let vanished = matches!(
        outcome,
        Ok(Flown { ending: Ending::Fault(DeviceError::Gone { device, .. }), .. }) if *device != usb::DEVICE
    );
    board.make_safe(if vanished { RETURN_PATIENCE } else { ZERO_PATIENCE })
}
