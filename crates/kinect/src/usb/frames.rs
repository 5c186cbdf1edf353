//! From packets to frames: images assembled, paired, stamped, and handed to who flies without a lock.

use std::sync::{
    Arc, Mutex, PoisonError,
    atomic::{AtomicBool, Ordering},
};

use bench_device::{DeviceError, Time};
use rtrb::{Consumer, Producer, RingBuffer};

use crate::frame::{Frame, FrameSource, TICKS_PER_S, unpack_depth};

use super::{
    Packets,
    assembly::{Assembler, Counts, Image},
    clock::HostClock,
    packet::Stream,
};

/// Two images whose device times differ by more than half a frame do not belong together.
const SAME_FRAME_TICKS: u32 = (TICKS_PER_S / 60.0) as u32;
/// Frames that are passed around. Some wait for their other image, one is looked at, the rest wait to be.
const FRAMES: usize = 8;
/// As many frames may wait for their other image: streams that are delayed unequally overlap.
const BUILDING: usize = 3;
/// A Kinect that gives no frame for so long is not there, s.
pub const SILENCE_S: f64 = 2.0;

/// What a [`DeviceError`] calls it.
pub const DEVICE: &str = "the Kinect";

/// What became of the stream so far.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Statistics {
    /// Of colour and of depth.
    pub streams: [Counts; 2],
    /// Frames handed on, of both images.
    pub frames: u64,
    /// Images that had no partner.
    pub unpaired: u64,
    /// Images for which there was no room, as nobody took the frames before.
    pub overrun: u64,
    /// How much faster the host's clock runs than the device's, parts in one.
    pub drift: f64,
}

#[derive(Debug, Default)]
struct Shared {
    gone: AtomicBool,
    statistics: Mutex<Statistics>,
}

/// The host's time, from the origin that frames' arrival counts from.
pub type Now = Arc<dyn Fn() -> Time + Send + Sync>;

/// The two ends of the way of frames: packets go in, frames come out.
pub(super) fn channel(now: Now) -> (Collector, Frames) {
    let (out, arrived) = RingBuffer::new(FRAMES);
    let (mut spares, spare) = RingBuffer::new(FRAMES);
    for _ in 0..FRAMES {
        // The buffer holds as many.
        let _ = spares.push(Frame::default());
    }
    let shared = Arc::new(Shared::default());
    let pairs = Pairs {
        building: Vec::with_capacity(BUILDING),
        free: Vec::with_capacity(FRAMES),
        spare,
        out,
        frames: 0,
        unpaired: 0,
        overrun: 0,
    };
    let collector = Collector {
        assemblers: Stream::ALL.map(Assembler::new),
        clocks: [HostClock::default(), HostClock::default()],
        pairs,
        shared: Arc::clone(&shared),
        now: Arc::clone(&now),
    };
    let last = now();
    (collector, Frames { arrived, spares, current: None, shared, last, now })
}

/// Takes packets, on the transport's thread. Allocates nothing once it is made.
pub(super) struct Collector {
    assemblers: [Assembler; 2],
    clocks: [HostClock; 2],
    pairs: Pairs,
    shared: Arc<Shared>,
    now: Now,
}

/// Brings colour and depth of one exposure together.
struct Pairs {
    building: Vec<Building>,
    /// Frames given up, to be used again.
    free: Vec<Frame>,
    spare: Consumer<Frame>,
    out: Producer<Frame>,
    frames: u64,
    unpaired: u64,
    overrun: u64,
}

/// A frame, one image of which may be missing.
struct Building {
    frame: Frame,
    has: [bool; 2],
    /// Device time of the image that came first.
    ticks: u32,
}

impl Pairs {
    /// Puts an image into its frame, and hands the frame on when it has both.
    fn take(&mut self, stream: Stream, image: &mut Image<'_>, arrived_at: Time) {
        let which = stream as usize;
        let Some(place) = self.frame_of(which, image.ticks) else {
            self.overrun += 1;
            return;
        };
        let Building { frame, has, .. } = &mut self.building[place];
        frame.arrived_at = if has.contains(&true) { frame.arrived_at.max(arrived_at) } else { arrived_at };
        has[which] = true;
        match stream {
            Stream::Colour => {
                std::mem::swap(image.data, &mut frame.colour);
                std::mem::swap(image.received, &mut frame.colour_valid);
                frame.colour_ticks = image.ticks;
            }
            Stream::Depth => {
                // Both lengths are right by construction.
                let _ = unpack_depth(image.data, &mut frame.depth);
                std::mem::swap(image.received, &mut frame.depth_valid);
                frame.depth_ticks = image.ticks;
            }
        }
        if *has == [true; 2] {
            // Frames leave in order: what is older and still waits will not be completed any more.
            for Building { frame, .. } in self.building.drain(..place) {
                self.unpaired += 1;
                self.free.push(frame);
            }
            // There is room for all frames that there are.
            let _ = self.out.push(self.building.remove(0).frame);
            self.frames += 1;
        }
    }

    /// Where the frame is that an image belongs to, a new one if need be; nothing when there is no frame left.
    fn frame_of(&mut self, which: usize, ticks: u32) -> Option<usize> {
        let waits = |frame: &Building| {
            let apart = ticks.wrapping_sub(frame.ticks).cast_signed();
            !frame.has[which] && apart.unsigned_abs() <= SAME_FRAME_TICKS
        };
        if let Some(place) = self.building.iter().position(waits) {
            return Some(place);
        }
        if self.building.len() == BUILDING {
            self.unpaired += 1;
            self.free.push(self.building.remove(0).frame);
        }
        let frame = self.free.pop().or_else(|| self.spare.pop().ok())?;
        self.building.push(Building { frame, has: [false; 2], ticks });
        Some(self.building.len() - 1)
    }
}

impl Packets for Collector {
    fn packet(&mut self, stream: Stream, packet: &[u8]) {
        let Self { assemblers, clocks, pairs, shared, now } = self;
        let clock = &mut clocks[stream as usize];
        let mut images = 0;
        assemblers[stream as usize].packet(packet, |mut image| {
            images += 1;
            let arrived_at = clock.arrived(image.ticks, now());
            pairs.take(stream, &mut image, arrived_at);
        });
        if images > 0 {
            let Pairs { frames, unpaired, overrun, .. } = *pairs;
            let streams = [assemblers[0].counts(), assemblers[1].counts()];
            let statistics = Statistics { streams, frames, unpaired, overrun, drift: clock.drift() };
            *shared.statistics.lock().unwrap_or_else(PoisonError::into_inner) = statistics;
        }
    }

    fn gone(&mut self) {
        self.shared.gone.store(true, Ordering::Release);
    }
}

/// Gives frames, on the thread of who flies. Neither locks nor allocates.
pub(super) struct Frames {
    arrived: Consumer<Frame>,
    spares: Producer<Frame>,
    current: Option<Frame>,
    shared: Arc<Shared>,
    last: Time,
    now: Now,
}

impl Frames {
    pub fn statistics(&self) -> Statistics {
        *self.shared.statistics.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub fn is_gone(&self) -> bool {
        self.shared.gone.load(Ordering::Acquire)
    }
}

impl FrameSource for Frames {
    fn poll_frame(&mut self) -> Result<Option<&Frame>, DeviceError> {
        if let Some(frame) = self.current.take() {
            // There is room for all frames that there are.
            let _ = self.spares.push(frame);
        }
        let now = (self.now)();
        if let Ok(frame) = self.arrived.pop() {
            self.last = now;
            return Ok(Some(self.current.insert(frame)));
        }
        if self.is_gone() {
            let detail = "it was unplugged, or its power supply was".to_owned();
            return Err(DeviceError::Gone { device: DEVICE, detail });
        }
        let waited_s = now.since_s(self.last);
        if waited_s > SILENCE_S {
            return Err(DeviceError::TimedOut { device: DEVICE, waited_s });
        }
        Ok(None)
    }
}
