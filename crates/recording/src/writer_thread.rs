//! The thread that takes records off the queue and writes them.

use std::{
    collections::BTreeMap,
    fs::File,
    io::{self, BufWriter, Write},
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering},
    },
    thread,
    time::{Duration, Instant},
};

use bench_device::Time;
use rtrb::Consumer;

use crate::{Options, Record, images::Incoming, session::DROPPED, writer::MessageWriter};

/// How long the thread sleeps when nothing wakes it; a record waits no longer than this before it is encoded.
const POLL: Duration = Duration::from_millis(20);

/// What a recording is written to.
pub(crate) trait Output: Write + Send + 'static {
    /// Has all that was flushed put on disk.
    fn sync(&mut self) -> io::Result<()>;
}

impl Output for BufWriter<File> {
    fn sync(&mut self) -> io::Result<()> {
        match self.get_ref().sync_all() {
            // Pipes and the like cannot be synced.
            Err(error) if error.kind() == io::ErrorKind::InvalidInput => Ok(()),
            result => result,
        }
    }
}

/// How a recording ends.
#[derive(Clone, Copy, Debug)]
#[repr(u8)]
pub(crate) enum Closing {
    /// Closed, whole.
    Finish = 1,
    /// Left open with all that was recorded.
    Abandon = 2,
}

/// What the loop and the thread tell each other beside the records.
#[derive(Debug, Default)]
pub(crate) struct Shared {
    /// The thread has met an error.
    pub failed: AtomicBool,
    /// Zero, or a [`Closing`].
    closing: AtomicU8,
    dropped: AtomicU64,
}

impl Shared {
    /// Tells the thread to end. To be called after the last record was queued.
    pub fn close(&self, how: Closing, dropped: u64) {
        self.dropped.store(dropped, Ordering::Relaxed);
        // Released, so that the thread sees the number above and all that was queued before.
        self.closing.store(how as u8, Ordering::Release);
    }

    fn closing(&self) -> Option<Closing> {
        match self.closing.load(Ordering::Acquire) {
            0 => None,
            how if how == Closing::Finish as u8 => Some(Closing::Finish),
            _ => Some(Closing::Abandon),
        }
    }
}

/// What was written in all.
#[derive(Debug)]
pub(crate) struct Written {
    pub messages: u64,
    pub bytes: u64,
}

pub(crate) struct WriterThread<W: Write> {
    queue: Consumer<Record>,
    views: Incoming,
    /// Records taken off the queue.
    taken: u64,
    shared: Arc<Shared>,
    /// The first error, once there was one: from then on records are taken off the queue and thrown away.
    messages: io::Result<MessageWriter<W>>,
    flush_interval_s: f64,
    sync_on_finish: bool,
    /// The message time from which on a flush precedes the next message. Message times alone decide, so that the same
    /// records give the same bytes.
    flush_due: Option<Time>,
    flush_after: Option<Duration>,
    unflushed_since: Option<Instant>,
}

impl<W: Output> WriterThread<W> {
    pub fn new(
        queue: Consumer<Record>,
        views: Incoming,
        shared: Arc<Shared>,
        messages: MessageWriter<W>,
        options: &Options,
    ) -> Self {
        Self {
            queue,
            views,
            taken: 0,
            shared,
            messages: Ok(messages),
            flush_interval_s: options.flush_interval_s,
            sync_on_finish: options.sync_on_finish,
            flush_due: None,
            flush_after: options.flush_after,
            unflushed_since: None,
        }
    }

    /// Writes until told to close; nothing was finished where the recording was left open. The error is the first that
    /// was met.
    pub fn run(mut self) -> io::Result<Option<Written>> {
        loop {
            // Read before the queue is emptied: all that was recorded before closing is then in it.
            let closing = self.shared.closing();
            while let Ok(record) = self.queue.pop() {
                self.write_views();
                self.write(&record);
                self.taken += 1;
            }
            self.write_views();
            match closing {
                Some(Closing::Finish) => return self.finish().map(Some),
                Some(Closing::Abandon) => return self.abandon().map(|()| None),
                None => self.flush_by_the_clock(),
            }
            thread::park_timeout(POLL);
        }
    }

    fn write(&mut self, record: &Record) {
        let time = record.time();
        let flush = self.flush_due.is_some_and(|due| time >= due);
        if flush {
            self.flush();
        }
        if flush || self.flush_due.is_none() {
            self.flush_due = Some(time.shifted(self.flush_interval_s));
        }
        if self.flush_after.is_some() {
            self.unflushed_since.get_or_insert_with(Instant::now);
        }
        self.attempt(|messages| messages.write(record));
    }

    /// Writes the views that were given before any record that is still to come.
    fn write_views(&mut self) {
        while let Some(view) = self.views.next(self.taken) {
            self.attempt(|messages| messages.write_view(&view));
            self.views.give_back(view.rgb);
        }
    }

    fn flush(&mut self) {
        self.unflushed_since = None;
        self.attempt(MessageWriter::flush);
    }

    fn flush_by_the_clock(&mut self) {
        if let (Some(after), Some(since)) = (self.flush_after, self.unflushed_since)
            && since.elapsed() >= after
        {
            self.flush();
        }
    }

    /// Does something with the file unless it failed before.
    fn attempt(&mut self, act: impl FnOnce(&mut MessageWriter<W>) -> io::Result<()>) {
        if let Ok(messages) = &mut self.messages
            && let Err(error) = act(messages)
        {
            self.shared.failed.store(true, Ordering::Relaxed);
            self.messages = Err(error);
        }
    }

    fn finish(self) -> io::Result<Written> {
        let dropped = self.shared.dropped.load(Ordering::Relaxed).to_string();
        let end = BTreeMap::from([(DROPPED.to_owned(), dropped)]);
        let (messages, bytes, mut output) = self.messages?.finish(end)?;
        output.flush()?;
        if self.sync_on_finish {
            output.sync()?;
        }
        Ok(Written { messages, bytes })
    }

    fn abandon(mut self) -> io::Result<()> {
        self.flush();
        self.messages.map(drop)
    }
}
