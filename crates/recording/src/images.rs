//! How drawn views reach the writer: a queue of their own beside that of the records, with buffers that come back.

use std::{
    io,
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
    thread::{self, Thread},
    time::Duration,
};

use bench_device::Time;
use rtrb::{Consumer, Producer, PushError, RingBuffer};

use crate::{ViewerChannel, WhenFull};

/// Views that may wait for the writer. Three belong to one frame.
const CAPACITY: usize = 12;
/// How long a full queue is left to the writer before it is tried again.
const FULL_QUEUE_POLL: Duration = Duration::from_micros(200);

/// A view of a frame, as it is handed over.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct View {
    /// [`ViewerChannel::Full`], [`ViewerChannel::Red`] or [`ViewerChannel::Depth`].
    pub channel: ViewerChannel,
    /// When the frame was exposed.
    pub exposed_at: Time,
    /// When it reached the loop: its place in the recording.
    pub arrived_at: Time,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Red, green, blue of each pixel, row by row: three times width times height bytes.
    pub rgb: Vec<u8>,
}

/// Hands views to the recorder's thread, which compresses and writes them: [`crate::Recorder::images`].
///
/// A view gets its place in the recording by the records that were handed over before it. Where one thread gives records and views, as
/// in a simulation, the bytes of the recording repeat.
#[derive(Debug)]
pub struct Images {
    queue: Producer<Queued>,
    returned: Consumer<Vec<u8>>,
    counts: Arc<Counts>,
    writer: Thread,
    when_full: WhenFull,
}

/// A view, and how many records were handed over before it.
#[derive(Debug)]
pub(crate) struct Queued {
    pub after: u64,
    pub view: View,
}

/// What the ends of both queues tell each other.
#[derive(Debug, Default)]
pub(crate) struct Counts {
    /// Records handed over.
    pub records: AtomicU64,
    /// Views that found the queue full.
    pub dropped: AtomicU64,
}

/// The writer's end.
pub(crate) struct Incoming {
    queue: Consumer<Queued>,
    returned: Producer<Vec<u8>>,
}

/// The ends of the queue, but for the thread that is to be woken.
pub(crate) struct Waiting {
    queue: Producer<Queued>,
    returned: Consumer<Vec<u8>>,
}

pub(crate) fn queue() -> (Waiting, Incoming) {
    let (queue, incoming) = RingBuffer::new(CAPACITY);
    let (back, returned) = RingBuffer::new(CAPACITY);
    (Waiting { queue, returned }, Incoming { queue: incoming, returned: back })
}

impl Waiting {
    pub fn start(self, counts: Arc<Counts>, writer: Thread, when_full: WhenFull) -> Images {
        Images { queue: self.queue, returned: self.returned, counts, writer, when_full }
    }
}

impl Images {
    /// A buffer to draw into, with whatever is in it: one that the writer is done with, or a new one as long as there is none.
    pub fn buffer(&mut self) -> Vec<u8> {
        self.returned.pop().unwrap_or_default()
    }

    /// Hands over a view by moving it. False where it is dropped, as the writer is behind and the recorder may not wait for it; its
    /// buffer is then lost to the pool.
    pub fn give(&mut self, view: View) -> bool {
        let mut queued = Queued { after: self.counts.records.load(Ordering::Relaxed), view };
        // A writer that is gone would never make room.
        while !self.queue.is_abandoned() {
            match self.queue.push(queued) {
                Ok(()) => return true,
                Err(PushError::Full(returned)) => queued = returned,
            }
            self.writer.unpark();
            if self.when_full == WhenFull::Drop {
                break;
            }
            thread::sleep(FULL_QUEUE_POLL);
        }
        self.counts.dropped.fetch_add(1, Ordering::Relaxed);
        false
    }

    /// How many views found the queue full so far.
    pub fn dropped(&self) -> u64 {
        self.counts.dropped.load(Ordering::Relaxed)
    }
}

impl Incoming {
    /// The next view that was given before more records than these were.
    pub fn next(&mut self, records: u64) -> Option<View> {
        let due = self.queue.peek().is_ok_and(|queued| queued.after <= records);
        if due { self.queue.pop().ok().map(|queued| queued.view) } else { None }
    }

    /// Gives a view's buffer back.
    pub fn give_back(&mut self, buffer: Vec<u8>) {
        // Views whose buffers did not come from here may outnumber the pool's places.
        drop(self.returned.push(buffer));
    }
}

/// A view as PNG.
pub(crate) fn png(view: &View) -> io::Result<Vec<u8>> {
    let [width, height] = view.size;
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_compression(png::Compression::Fast);
    let mut writer = encoder.write_header().map_err(io::Error::other)?;
    writer.write_image_data(&view.rgb).map_err(io::Error::other)?;
    writer.finish().map_err(io::Error::other)?;
    Ok(bytes)
}
