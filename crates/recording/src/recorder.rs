use std::{
    fmt::Write as _,
    fs::File,
    io::{self, BufWriter},
    path::{Path, PathBuf},
    sync::{Arc, atomic::Ordering},
    thread::{self, JoinHandle},
    time::Duration,
};

use bench_device::Time;
use rtrb::{Producer, PushError, RingBuffer};

use crate::{
    Event, EventText, Images, Level, Observer, Record, RecordingError, Session,
    images::{self, Counts},
    writer::MessageWriter,
    writer_thread::{Closing, Output, Shared, WriterThread, Written},
};

/// How long a full queue is left to the writer before it is tried again.
const FULL_QUEUE_POLL: Duration = Duration::from_micros(50);

/// How a [`Recorder`] works.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Time between two flushes by the messages' own times, s, above 0: what a crash may cost.
    pub flush_interval_s: f64,
    /// Also flush when messages have waited so long by the wall clock. With it, bytes no longer repeat.
    pub flush_after: Option<Duration>,
    /// How many records may wait for the writer, 1 or more.
    pub queue_capacity: usize,
    /// What happens to a record that finds the queue full.
    pub when_full: WhenFull,
    /// Whether [`Recorder::finish`] waits until the file is on disk (`fsync`), safe from a loss of power.
    pub sync_on_finish: bool,
}

/// What happens to a record that finds the queue full.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WhenFull {
    /// The caller waits for the writer: for simulations, whose time can wait.
    Block,
    /// It is dropped, counted, and told as an event as soon as there is room: for loops in real time.
    Drop,
}

impl Options {
    /// For simulations: nothing is lost, bytes repeat. What a crash or a loss of power costs can be flown again, so chunks
    /// are long and nothing waits for the disk.
    pub const SIMULATION: Self = Self {
        flush_interval_s: 5.0,
        flush_after: None,
        queue_capacity: 2048,
        when_full: WhenFull::Block,
        sync_on_finish: false,
    };

    /// For loops in real time: never waits, flushes also when messages cease, and is on disk when it is closed.
    pub const REAL_TIME: Self = Self {
        flush_interval_s: 0.5,
        flush_after: Some(Duration::from_millis(500)),
        queue_capacity: 4096,
        when_full: WhenFull::Drop,
        sync_on_finish: true,
    };
}

/// Takes records from a loop and writes them on a thread of its own.
///
/// Create it before raising the calling thread's priority: threads inherit it.
#[derive(Debug)]
pub struct Recorder {
    queue: Producer<Record>,
    shared: Arc<Shared>,
    counts: Arc<Counts>,
    /// Records handed over.
    given: u64,
    images: Option<Images>,
    writer: Option<JoinHandle<io::Result<Option<Written>>>>,
    path: PathBuf,
    when_full: WhenFull,
    dropped: u64,
    dropped_told: u64,
    /// Records until the writer is woken again.
    until_wake: usize,
    wake_every: usize,
}

/// What a finished recording holds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finished {
    /// MCAP messages, those for viewers included.
    pub messages: u64,
    /// Records that found the queue full.
    pub dropped: u64,
    /// Views that found theirs full.
    pub dropped_views: u64,
    /// Size of the file.
    pub bytes: u64,
    /// Where it is.
    pub path: PathBuf,
}

impl Recorder {
    /// Creates the file (an existing one is replaced), writes the session into it, and starts the writer.
    pub fn create(
        path: impl AsRef<Path>,
        session: &Session,
        options: Options,
    ) -> Result<Self, RecordingError> {
        Self::create_observed(path, session, options, None)
    }

    /// The same, with somebody who sees each message when it is written.
    pub fn create_observed(
        path: impl AsRef<Path>,
        session: &Session,
        options: Options,
        observer: Option<Box<dyn Observer>>,
    ) -> Result<Self, RecordingError> {
        let path = path.as_ref();
        options.check()?;
        let failed = |action| move |source| RecordingError::Io { action, path: path.to_owned(), source };
        let file = File::create(path).map_err(failed("create"))?;
        Self::start(BufWriter::new(file), path, session, options, observer).map_err(failed("write"))
    }

    fn start(
        output: impl Output,
        path: &Path,
        session: &Session,
        options: Options,
        observer: Option<Box<dyn Observer>>,
    ) -> io::Result<Self> {
        let messages = MessageWriter::start(output, session, observer)?;
        let (producer, consumer) = RingBuffer::new(options.queue_capacity);
        let (views, incoming) = images::queue();
        let (shared, counts) = (Arc::new(Shared::default()), Arc::new(Counts::default()));
        let writer = WriterThread::new(consumer, incoming, Arc::clone(&shared), messages, &options);
        let writer = thread::Builder::new().name("recorder".to_owned()).spawn(|| writer.run())?;
        // Often enough that the writer is done before the queue is full.
        let wake_every = (options.queue_capacity / 4).max(1);
        Ok(Self {
            queue: producer,
            shared,
            images: Some(views.start(Arc::clone(&counts), writer.thread().clone(), options.when_full)),
            counts,
            given: 0,
            writer: Some(writer),
            path: path.to_owned(),
            when_full: options.when_full,
            dropped: 0,
            dropped_told: 0,
            until_wake: wake_every,
            wake_every,
        })
    }

    /// Hands a record to the writer. Never allocates and never locks; waits only when the queue is full and the options
    /// say so. What goes wrong in the writer shows in [`Recorder::failed`] and [`Recorder::finish`].
    pub fn record(&mut self, record: impl Into<Record>) {
        let record = record.into();
        if self.dropped > self.dropped_told {
            self.tell_dropped(record.time());
        }
        if !self.push(record) {
            self.dropped += 1;
        }
    }

    /// What takes views of frames to the writer, for whoever draws them; `None` once it was taken.
    pub fn images(&mut self) -> Option<Images> {
        self.images.take()
    }

    /// Whether the writer has failed, so that nothing more is recorded. The reason is told by [`Recorder::finish`].
    pub fn failed(&self) -> bool {
        self.shared.failed.load(Ordering::Relaxed) || self.queue.is_abandoned()
    }

    /// How many records found the queue full so far.
    pub fn dropped(&self) -> u64 {
        self.dropped
    }

    /// Writes what is still queued, closes the file with its summary and indexes, and has it put on
    /// disk if the options say so.
    pub fn finish(mut self) -> Result<Finished, RecordingError> {
        let path = std::mem::take(&mut self.path);
        match self.close(Closing::Finish) {
            Some(Ok(Ok(Some(written)))) => Ok(Finished {
                messages: written.messages,
                dropped: self.dropped,
                dropped_views: self.counts.dropped.load(Ordering::Relaxed),
                bytes: written.bytes,
                path,
            }),
            Some(Ok(Err(source))) => Err(RecordingError::Io { action: "write", path, source }),
            Some(Ok(Ok(None)) | Err(_)) | None => Err(RecordingError::WriterPanicked { path }),
        }
    }

    /// Has the writer end and waits for it; `None` if it was ended before.
    fn close(&mut self, how: Closing) -> Option<thread::Result<io::Result<Option<Written>>>> {
        let writer = self.writer.take()?;
        self.shared.close(how, self.dropped);
        writer.thread().unpark();
        Some(writer.join())
    }

    /// Puts a record into the queue; false if there was no room.
    fn push(&mut self, mut record: Record) -> bool {
        while let Err(PushError::Full(returned)) = self.queue.push(record) {
            record = returned;
            self.wake_writer();
            // A writer that is gone would never make room.
            if self.when_full == WhenFull::Drop || self.queue.is_abandoned() {
                return false;
            }
            thread::sleep(FULL_QUEUE_POLL);
        }
        self.given += 1;
        self.counts.records.store(self.given, Ordering::Relaxed);
        self.until_wake -= 1;
        if self.until_wake == 0 {
            self.wake_writer();
        }
        true
    }

    fn wake_writer(&mut self) {
        self.until_wake = self.wake_every;
        if let Some(writer) = &self.writer {
            writer.thread().unpark();
        }
    }

    fn tell_dropped(&mut self, time: Time) {
        let mut text = EventText::new();
        let since = self.dropped - self.dropped_told;
        // The text is shorter than an event holds, whatever the number.
        let _ = write!(text, "recorder: {since} records dropped, the queue was full");
        if self.push(Event { time, level: Level::Warning, text }.into()) {
            self.dropped_told = self.dropped;
        }
    }
}

impl Drop for Recorder {
    /// Without [`Recorder::finish`] the file keeps what was recorded but stays open: nothing takes it for whole.
    fn drop(&mut self) {
        // An error or a panic of the writer has nowhere to go from here; the file shows that it was not closed.
        let _ = self.close(Closing::Abandon);
    }
}

impl Options {
    fn check(&self) -> Result<(), RecordingError> {
        if !(self.flush_interval_s > 0.0 && self.flush_interval_s.is_finite()) {
            return Err(RecordingError::BadOption {
                option: "flush_interval_s",
                value: self.flush_interval_s.to_string(),
                expected: "a time above 0 s",
            });
        }
        if self.queue_capacity == 0 {
            return Err(RecordingError::BadOption {
                option: "queue_capacity",
                value: self.queue_capacity.to_string(),
                expected: "1 or more",
            });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::{
        io::{self, Write},
        path::Path,
        sync::{Arc, Mutex, MutexGuard, PoisonError},
        thread,
    };

    use bench_device::Time;

    use super::{Options, Recorder, WhenFull};
    use crate::{Battery, Mode, RecordingError, Session, writer_thread::Output};

    /// An output in memory that can be held up, and that is full at some size.
    #[derive(Clone)]
    struct Disk {
        bytes: Arc<Mutex<Vec<u8>>>,
        size: usize,
        /// How long the file was each time that it was put on disk.
        synced: Arc<Mutex<Vec<usize>>>,
    }

    impl Disk {
        fn of_size(size: usize) -> Self {
            Self { bytes: Arc::default(), size, synced: Arc::default() }
        }

        /// What is on the disk; holds up the writer as long as it is kept.
        fn bytes(&self) -> MutexGuard<'_, Vec<u8>> {
            self.bytes.lock().unwrap_or_else(PoisonError::into_inner)
        }

        fn recorder(&self, options: Options) -> Recorder {
            Recorder::start(self.clone(), Path::new("disk.mcap"), &Session::new(Mode::Sim), options, None)
                .unwrap()
        }
    }

    impl Write for Disk {
        fn write(&mut self, data: &[u8]) -> io::Result<usize> {
            let mut bytes = self.bytes();
            if bytes.len() + data.len() > self.size {
                return Err(io::ErrorKind::StorageFull.into());
            }
            bytes.extend_from_slice(data);
            Ok(data.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    impl Output for Disk {
        fn sync(&mut self) -> io::Result<()> {
            self.synced.lock().unwrap().push(self.bytes().len());
            Ok(())
        }
    }

    fn battery(second: u32) -> Battery {
        Battery { time: Time::from_seconds(f64::from(second)), voltage_v: 3.7, current_a: None }
    }

    /// The messages of a file without an end.
    fn messages(bytes: &[u8]) -> Vec<mcap::Message<'_>> {
        let options = mcap::read::Options::IgnoreEndMagic.into();
        mcap::MessageStream::new_with_options(bytes, options).unwrap().map_while(Result::ok).collect()
    }

    #[test]
    fn a_disk_that_fills_up_is_told_and_the_file_does_not_look_whole() {
        for when_full in [WhenFull::Block, WhenFull::Drop] {
            let disk = Disk::of_size(10_000);
            let mut recorder = disk.recorder(Options { when_full, ..Options::SIMULATION });
            // The loop goes on whatever happens to the disk.
            for second in 0.. {
                recorder.record(battery(second));
                if recorder.failed() {
                    break;
                }
            }
            recorder.record(battery(0));
            match recorder.finish() {
                Err(RecordingError::Io { source, .. }) => {
                    assert_eq!(source.kind(), io::ErrorKind::StorageFull);
                }
                other => panic!("{other:?}"),
            }
            assert!(!disk.bytes().ends_with(mcap::MAGIC));
        }
    }

    #[test]
    fn a_closed_file_is_put_on_disk_whole_unless_it_can_be_flown_again() {
        for (options, times) in [(Options::REAL_TIME, 1), (Options::SIMULATION, 0)] {
            let disk = Disk::of_size(usize::MAX);
            let mut recorder = disk.recorder(options);
            recorder.record(battery(0));
            recorder.finish().unwrap();
            let whole = disk.bytes();
            assert!(whole.ends_with(mcap::MAGIC));
            assert_eq!(*disk.synced.lock().unwrap(), vec![whole.len(); times]);
        }
    }

    #[test]
    fn what_finds_no_room_is_counted_and_told_in_the_recording() {
        let disk = Disk::of_size(usize::MAX);
        let capacity = 4;
        let options = Options { queue_capacity: capacity, flush_after: None, ..Options::REAL_TIME };
        let mut recorder = disk.recorder(options);
        let hold_up = disk.bytes();
        for second in 0..100 {
            recorder.record(battery(second));
        }
        // Each second is flushed, so the writer got stuck with the second record at the latest.
        let dropped = recorder.dropped();
        assert!(dropped >= 100 - 4 - 2, "{dropped}");
        drop(hold_up);
        while recorder.queue.slots() < capacity {
            thread::yield_now();
        }
        recorder.record(battery(100));
        let finished = recorder.finish().unwrap();
        assert_eq!(finished.dropped, dropped);

        let bytes = disk.bytes();
        let messages = messages(&bytes);
        let events: Vec<_> = messages.iter().filter(|m| m.channel.topic == "/bench/event").collect();
        assert_eq!(events.len(), 1);
        let text = String::from_utf8_lossy(&events[0].data);
        assert!(text.contains(&format!("{dropped} records dropped")), "{text}");
        assert_eq!(messages.len() as u64, 101 - dropped + 1);
    }

    #[test]
    fn all_that_is_older_than_the_flush_interval_is_in_the_file_while_it_is_open() {
        let disk = Disk::of_size(usize::MAX);
        let mut recorder = disk.recorder(Options { flush_interval_s: 10.0, ..Options::SIMULATION });
        for second in 0..=25 {
            recorder.record(battery(second));
        }
        // The message of 20 s has all before it flushed, as soon as the writer comes to it.
        let flushed = loop {
            let count = messages(&disk.bytes()).len();
            if count >= 20 {
                break count;
            }
            thread::yield_now();
        };
        assert_eq!(flushed, 20);
        drop(recorder);
        assert_eq!(messages(&disk.bytes()).len(), 26);
    }
}
