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
    assembly::{Assembler, Counts},
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
    let collector = Collector {
        assemblers: Stream::ALL.map(Assembler::new),
        clocks: [HostClock::default(), HostClock::default()],
        building: Vec::with_capacity(BUILDING + 1),
        free: Vec::with_capacity(FRAMES),
        statistics: Statistics::default(),
        spare,
        out,
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
    building: Vec<Building>,
    /// Frames given up, to be used again.
    free: Vec<Frame>,
    statistics: Statistics,
    spare: Consumer<Frame>,
    out: Producer<Frame>,
    shared: Arc<Shared>,
    now: Now,
}

/// A frame, one image of which may be missing.
struct Building {
    frame: Frame,
    has: [bool; 2],
    /// Device time of the image that came first.
    ticks: u32,
}

impl Packets for Collector {
    fn packet(&mut self, stream: Stream, packet: &[u8]) {
        let Self { assemblers, clocks, building, free, statistics, spare, out, shared, now } = self;
        let which = stream as usize;
        let mut images = 0;
        assemblers[which].packet(packet, |image| {
            images += 1;
            let arrived_at = clocks[which].arrived(image.ticks, now());
            let place = building.iter().position(|frame| {
                let apart = image.ticks.wrapping_sub(frame.ticks).cast_signed();
                !frame.has[which] && apart.unsigned_abs() <= SAME_FRAME_TICKS
            });
            let place = if let Some(place) = place {
                place
            } else {
                if building.len() == BUILDING {
                    statistics.unpaired += 1;
                    free.push(building.remove(0).frame);
                }
                let Some(mut frame) = free.pop().or_else(|| spare.pop().ok()) else {
                    statistics.overrun += 1;
                    return;
                };
                frame.arrived_at = arrived_at;
                building.push(Building { frame, has: [false; 2], ticks: image.ticks });
                building.len() - 1
            };
            let Building { frame, has, .. } = &mut building[place];
            has[which] = true;
            frame.arrived_at = frame.arrived_at.max(arrived_at);
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
                for Building { frame, .. } in building.drain(..place) {
                    statistics.unpaired += 1;
                    free.push(frame);
                }
                let Building { frame, .. } = building.remove(0);
                // There is room for all frames that there are.
                let _ = out.push(frame);
                statistics.frames += 1;
            }
        });
        if images > 0 {
            statistics.streams = [assemblers[0].counts(), assemblers[1].counts()];
            statistics.drift = clocks[which].drift();
            *shared.statistics.lock().unwrap_or_else(PoisonError::into_inner) = *statistics;
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
