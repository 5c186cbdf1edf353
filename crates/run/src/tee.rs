use std::{
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
    thread,
    time::Duration,
};

use bench_recording::{Record, WhenFull};
use rtrb::{Consumer, Producer, PushError, RingBuffer};

use crate::Sink;

/// How long a full queue is left to who watches before it is tried again, where the flight can wait.
const FULL_QUEUE_POLL: Duration = Duration::from_micros(50);

/// A sink that also hands each record to somebody who watches. Neither allocates nor locks of its own.
#[derive(Debug)]
pub struct Tee<S> {
    sink: S,
    watcher: Option<Watcher>,
}

/// The flight's end of a bounded queue of records.
#[derive(Debug)]
pub struct Watcher {
    queue: Producer<Record>,
    missed: Arc<AtomicU64>,
    when_full: WhenFull,
}

impl Watcher {
    /// A queue for so many records: the flight's end, the other one, and how many records the other one missed. A flight in real time
    /// drops what finds no room; one in lockstep may wait.
    pub fn new(capacity: usize, when_full: WhenFull) -> (Self, Consumer<Record>, Arc<AtomicU64>) {
        let (queue, records) = RingBuffer::new(capacity);
        let missed = Arc::new(AtomicU64::new(0));
        (Self { queue, missed: Arc::clone(&missed), when_full }, records, missed)
    }
}

impl Sink for Watcher {
    fn take(&mut self, mut record: Record) {
        while let Err(PushError::Full(returned)) = self.queue.push(record) {
            record = returned;
            // Who watches no more would never make room.
            if self.when_full == WhenFull::Drop || self.queue.is_abandoned() {
                self.missed.fetch_add(1, Ordering::Relaxed);
                return;
            }
            thread::sleep(FULL_QUEUE_POLL);
        }
    }
}

impl<S: Sink> Tee<S> {
    /// `sink` gets every record; `watcher`, if there is one, what it has room for.
    pub fn new(sink: S, watcher: Option<Watcher>) -> Self {
        Self { sink, watcher }
    }

    /// The sink, once nothing more comes.
    pub fn into_inner(self) -> S {
        self.sink
    }

    /// The sink and who watches, for another flight.
    pub fn into_parts(self) -> (S, Option<Watcher>) {
        (self.sink, self.watcher)
    }
}

impl<S: Sink> Sink for Tee<S> {
    fn take(&mut self, record: Record) {
        self.sink.take(record);
        if let Some(watcher) = &mut self.watcher {
            watcher.take(record);
        }
    }
}

#[cfg(test)]
mod tests {
    use bench_device::Time;
    use bench_recording::Battery;

    use super::*;

    fn battery(second: u64) -> Record {
        Battery { time: Time::from_nanos(second), voltage_v: 3.7, current_a: None }.into()
    }

    #[test]
    fn who_watches_too_slowly_misses_records_and_the_sink_none() {
        let (watcher, mut records, missed) = Watcher::new(4, WhenFull::Drop);
        let mut tee = Tee::new(Vec::new(), Some(watcher));
        for second in 0..10 {
            tee.take(battery(second));
        }
        assert_eq!(missed.load(Ordering::Relaxed), 6);
        assert_eq!(records.pop(), Ok(battery(0)));
        tee.take(battery(10));
        assert_eq!(missed.load(Ordering::Relaxed), 6);
        drop(records);
        tee.take(battery(11));
        assert_eq!(tee.into_inner(), (0..12).map(battery).collect::<Vec<_>>());
    }

    #[test]
    fn a_flight_that_can_wait_does_so_until_nobody_watches() {
        let (watcher, mut records, missed) = Watcher::new(4, WhenFull::Block);
        let mut tee = Tee::new(Vec::new(), Some(watcher));
        let watches = thread::spawn(move || {
            let mut seen = Vec::new();
            while seen.len() < 90 {
                match records.pop() {
                    Ok(record) => seen.push(record),
                    Err(_) => thread::yield_now(),
                }
            }
            seen
        });
        (0..100).for_each(|second| tee.take(battery(second)));
        assert_eq!(watches.join().unwrap(), (0..90).map(battery).collect::<Vec<_>>());
        assert!(missed.load(Ordering::Relaxed) <= 10);
        assert_eq!(tee.into_inner().len(), 100);
    }
}
