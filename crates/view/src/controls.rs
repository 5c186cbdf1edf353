use std::sync::{
    Arc,
    atomic::{AtomicBool, Ordering},
};

use rtrb::{Consumer, Producer, RingBuffer};

/// Altitudes that may wait for the loop.
const ALTITUDES: usize = 16;

/// What the page asks of a flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Ask {
    /// Throttle to rest.
    Stop,
    /// Hold this altitude, m.
    Altitude(f64),
}

/// The loop's end of what the page commands. Neither allocates nor locks.
#[derive(Debug)]
pub struct Controls {
    stop: Arc<AtomicBool>,
    altitudes: Consumer<f64>,
}

impl Controls {
    /// What is asked for next; STOP comes before all else, and stays.
    pub fn next_ask(&mut self) -> Option<Ask> {
        if self.stopped() { Some(Ask::Stop) } else { self.altitudes.pop().ok().map(Ask::Altitude) }
    }

    /// Whether STOP was pressed.
    pub fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// The page's end.
pub(crate) struct Commands {
    stop: Arc<AtomicBool>,
    altitudes: Producer<f64>,
}

impl Commands {
    pub(crate) fn stop(&self) {
        self.stop.store(true, Ordering::Relaxed);
    }

    /// False when the loop has not taken those before.
    pub(crate) fn altitude(&mut self, altitude_m: f64) -> bool {
        self.altitudes.push(altitude_m).is_ok()
    }
}

pub(crate) fn channel() -> (Commands, Controls) {
    let stop = Arc::new(AtomicBool::new(false));
    let (producer, consumer) = RingBuffer::new(ALTITUDES);
    (Commands { stop: Arc::clone(&stop), altitudes: producer }, Controls { stop, altitudes: consumer })
}
