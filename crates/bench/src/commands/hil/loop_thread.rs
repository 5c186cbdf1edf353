use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc,
    },
    time::Duration,
};

use bench_dac::{Calibration, DacError, Identity, LinkCounts, Psoc5, Safe};
use bench_device::{Clock, DeviceError};
use bench_recording::{Event, EventText, Level, Recorder};
use bench_rig::{Mission, Rig};
use bench_run::{
    Ending, Flown, Granted, Loopback, Progress, WallClock, await_marker, drain_truth, fly_guarded,
};
use rtrb::Producer;
use tokio::sync::oneshot;

/// How long the tracker may take to see the marker before arming, s.
const MARKER_PATIENCE_S: f64 = 3.0;

/// How long a port that went away in flight is waited for, to see that the outputs are at zero.
const RETURN_PATIENCE: Duration = Duration::from_secs(5);
const ZERO_PATIENCE: Duration = Duration::from_millis(500);

/// What the loop's thread works with.
pub struct LoopThread {
    pub port: String,
    pub rig: Rig,
    pub mission: Mission,
    pub seed: u64,
    pub stop: Arc<AtomicBool>,
    pub progress: Producer<Progress>,
}

/// The board is there and calibrated.
pub struct Ready {
    pub granted: Granted,
    pub identity: Identity,
    pub calibration: Calibration,
}

/// What the loop's thread is told next.
pub enum Order {
    Fly(Recorder),
}

/// The flight is over, and the throttle at rest.
pub struct Landed {
    /// The flight, or why it did not begin.
    pub outcome: Result<Flown, NotArmed>,
    pub safe: Safe,
    pub counts: LinkCounts,
    pub recorder: Recorder,
}

/// Why the outputs were not armed.
#[derive(Debug)]
pub enum NotArmed {
    Board(DacError),
    Tracker(DeviceError),
    NoMarker,
    Effects(bench_plant::effects::EffectError),
    Stopped,
}

impl std::fmt::Display for NotArmed {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Board(error) => error.fmt(f),
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
    pub fn run(
        mut self,
        ready: &mpsc::Sender<Result<Ready, DacError>>,
        orders: &mpsc::Receiver<Order>,
        landed: oneshot::Sender<Landed>,
    ) {
        // Before the port is opened: its thread inherits the priority.
        let granted = Granted::ask();
        let connected = Psoc5::connect(&self.port, &self.rig)
            .and_then(|mut board| board.calibrate().map(|calibration| (board, calibration)));
        let mut board = match connected {
            Ok((board, calibration)) => {
                let _ = ready.send(Ok(Ready { granted, identity: board.identity(), calibration }));
                board
            }
            Err(error) => {
                let _ = ready.send(Err(error));
                return;
            }
        };
        let Ok(Order::Fly(mut recorder)) = orders.recv() else { return };
        let outcome = self.fly(&mut board, &mut recorder);
        let vanished = matches!(&outcome, Ok(Flown { ending: Ending::Fault(DeviceError::Gone { .. }), .. }));
        let safe = board.make_safe(if vanished { RETURN_PATIENCE } else { ZERO_PATIENCE });
        let counts = board.counts();
        let _ = landed.send(Landed { outcome, safe, counts, recorder });
    }

    fn fly(&mut self, board: &mut Psoc5, recorder: &mut Recorder) -> Result<Flown, NotArmed> {
        let mut clock = WallClock::start();
        let lab = Loopback::new(&self.rig, self.seed, clock).map_err(NotArmed::Effects)?;
        let (mut output, mut tracker) = lab.ends(board);
        let world = output.world();
        let seen = await_marker(&mut clock, &mut tracker, MARKER_PATIENCE_S).map_err(NotArmed::Tracker)?;
        if !seen {
            return Err(NotArmed::NoMarker);
        }
        if self.stop.load(Ordering::Relaxed) {
            return Err(NotArmed::Stopped);
        }
        output.inner().arm().map_err(NotArmed::Board)?;
        recorder.record(Event {
            time: clock.now(),
            level: Level::Info,
            text: EventText::from("armed").unwrap_or_default(),
        });
        let (stop, progress) = (&self.stop, &mut self.progress);
        let ends = (&mut clock, &mut output, &mut tracker);
        Ok(fly_guarded(ends, &self.rig, &self.mission, recorder, |now, recorder| {
            drain_truth(&world, recorder);
            // A screen that is behind misses an iteration.
            let _ = progress.push(*now);
            !stop.load(Ordering::Relaxed)
        }))
    }
}
