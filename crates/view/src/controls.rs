use std::sync::{
    Arc,
    atomic::{AtomicBool, Ordering},
};

use rtrb::{Consumer, Producer, RingBuffer};

/// How much may wait for the loop.
const ASKS: usize = 16;

/// What the page asks of a flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Ask {
    /// Throttle to rest.
    Stop,
    /// Hold this altitude, m.
    Altitude(f64),
    /// Go on with the mission's landing.
    Land,
}

/// The loop's end of what the page commands. Neither allocates nor locks.
#[derive(Debug)]
pub struct Controls {
    stop: Arc<AtomicBool>,
    asks: Consumer<Ask>,
}

impl Controls {
    /// What is asked for next; STOP comes before all else, and stays until nothing flies.
    pub fn next_ask(&mut self) -> Option<Ask> {
        if self.stopped() { Some(Ask::Stop) } else { self.asks.pop().ok() }
    }

    /// Whether STOP was pressed.
    pub fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// The page's end.
pub(crate) struct Commands {
    stop: Arc<AtomicBool>,
    asks: Producer<Ask>,
}

impl Commands {
    pub(crate) fn stop(&self) {
        self.stop.store(true, Ordering::Relaxed);
    }

    /// Takes STOP back, once nothing flies.
    pub(crate) fn forget_stop(&self) {
        self.stop.store(false, Ordering::Relaxed);
    }

    /// False when the loop has not taken those before.
    pub(crate) fn ask(&mut self, ask: Ask) -> bool {
        self.asks.push(ask).is_ok()
    }
}

pub(crate) fn channel() -> (Commands, Controls) {
    let stop = Arc::new(AtomicBool::new(false));
    let (producer, consumer) = RingBuffer::new(ASKS);
    (Commands { stop: Arc::clone(&stop), asks: producer }, Controls { stop, asks: consumer })
}
