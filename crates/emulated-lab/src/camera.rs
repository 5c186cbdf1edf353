//! The Kinect's two devices on the USB.

use std::{
    sync::{
        Arc, Mutex, PoisonError,
        mpsc::{Receiver, Sender, channel},
    },
    thread,
    time::{Duration, Instant},
};

use bench_kinect::{
    Frame,
    usb::{
        Blocks, Model, Stream,
        emulator::{Camera, Foot, MICROFRAME_S, PacketFaults, Transmitter},
    },
};
use bench_rig::Depth;
use bench_usb_lab::{Bus, Descriptors, Device, Setup, Speed, Stall, Urb};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::{Faults, Shutter};

/// Microsoft.
const VENDOR: u16 = 0x045e;
/// What a Kinect of model 1414 says of itself.
const CAMERA: u16 = 0x02ae;
const MOTOR: u16 = 0x02b0;
const VERSION: u16 = 0x010b;
/// The camera's serial number.
pub const SERIAL: &str = "A00EMULATED0001A";

/// Interrupt, bulk, isochronous endpoints in a descriptor's terms; two packets of 960 bytes a microframe.
const ISOCHRONOUS: u8 = 1;
const TWICE_960: u16 = 0x0bc0;
/// A bus that is behind by more does not catch up: what should have been sent meanwhile is lost to nobody, as no transfer waited for it.
const BEHIND: Duration = Duration::from_millis(50);

/// The camera: its commands on endpoint 0, a thread for each stream.
pub struct CameraDevice {
    camera: Arc<Mutex<Camera>>,
    streams: [Sender<(Urb, Bus)>; 2],
}

impl CameraDevice {
    /// A camera of model 1414 with a depth camera's constants, which sends what the shutter releases.
    pub fn new(depth: &Depth, shutter: &Shutter, faults: Faults, seed: u64) -> Self {
        let camera = Arc::new(Mutex::new(Camera::new(Model::Xbox1414, Blocks::of(depth))));
        let streams = Stream::ALL.map(|stream| {
            let (sender, transfers) = channel();
            let packets = PacketFaults { loss: faults.loss, cut: 0.0 };
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            rng.set_stream(16 + stream as u64);
            let line = Line {
                stream,
                camera: Arc::clone(&camera),
                transmitter: Transmitter::new(stream, packets, seed),
                shots: shutter.subscribe(),
                waiting: None,
                faults,
                rng,
                ran: None,
            };
            // Ends when the device is unplugged, and with it the transfers' way.
            thread::spawn(move || line.run(&transfers));
            sender
        });
        Self { camera, streams }
    }
}

/// One stream's way to the host.
struct Line {
    stream: Stream,
    camera: Arc<Mutex<Camera>>,
    transmitter: Transmitter,
    shots: Receiver<Arc<Frame>>,
    /// The frame to be sent next, and not before when: jitter may hold it back.
    waiting: Option<(Instant, Arc<Frame>)>,
    faults: Faults,
    rng: ChaCha8Rng,
    /// Since when the stream runs.
    ran: Option<Instant>,
}

impl Line {
    /// A transfer takes as long as it has packets, a microframe each, and is full of what the camera sent meanwhile.
    fn run(mut self, transfers: &Receiver<(Urb, Bus)>) {
        let mut ends = Instant::now();
        let mut bytes = Vec::new();
        while let Ok((urb, bus)) = transfers.recv() {
            ends += Duration::from_secs_f64(MICROFRAME_S) * urb.packets.len() as u32;
            let now = Instant::now();
            if ends > now {
                thread::sleep(ends - now);
            } else if now - ends > BEHIND {
                ends = now;
            }
            bytes.clear();
            self.look(ends);
            let mut lengths = Vec::with_capacity(urb.packets.len());
            for _ in &urb.packets {
                if !self.transmitter.busy()
                    && let Some((_, frame)) = self.waiting.take_if(|(at, _)| *at <= ends)
                {
                    self.transmitter.load(&frame);
                }
                lengths.push(self.transmitter.microframe(&mut bytes));
            }
            let mut rest = bytes.as_slice();
            let packets: Vec<&[u8]> = lengths
                .into_iter()
                .map(|length| {
                    let (packet, behind) = rest.split_at(length);
                    rest = behind;
                    packet
                })
                .collect();
            bus.stream(&urb, &packets);
        }
    }

    /// Takes frames that have come, if there is somebody to send them to.
    fn look(&mut self, now: Instant) {
        let runs = self.camera.lock().unwrap_or_else(PoisonError::into_inner).runs(self.stream);
        if runs {
            self.ran.get_or_insert(now);
        } else {
            self.ran = None;
            self.transmitter.halt();
            self.waiting = None;
        }
        let stalls = self.ran.is_some_and(|since| {
            let running_s = now.saturating_duration_since(since).as_secs_f64();
            (self.faults.stall_at_s..self.faults.stall_at_s + self.faults.stall_s).contains(&running_s)
        });
        if stalls {
            self.transmitter.halt();
            self.waiting = None;
        }
        while let Ok(frame) = self.shots.try_recv() {
            if runs && !stalls {
                let late_s = self.rng.random::<f64>() * self.faults.jitter_s.max(0.0);
                // A camera does not keep what it had no time to send.
                self.waiting = Some((now + Duration::from_secs_f64(late_s), frame));
            }
        }
    }
}

impl Device for CameraDevice {
    fn descriptors(&self) -> Descriptors {
        let mut body = Descriptors::interface(0, 2, 0xff, 0, 0).to_vec();
        for stream in Stream::ALL {
            body.extend(Descriptors::endpoint(stream.endpoint(), ISOCHRONOUS, TWICE_960, 1));
        }
        Descriptors {
            device: Descriptors::device_of_version(0, VENDOR, CAMERA, VERSION),
            configuration: Descriptors::configuration(1, &body),
            strings: ["Microsoft", "Xbox NUI Camera", SERIAL].map(str::to_owned).to_vec(),
        }
    }

    fn speed(&self) -> Speed {
        Speed::High
    }

    fn control(&mut self, setup: Setup, data: &[u8]) -> Result<Vec<u8>, Stall> {
        let mut camera = self.camera.lock().unwrap_or_else(PoisonError::into_inner);
        match (setup.request_type, setup.request) {
            (0x40, 0) => {
                camera.take(data);
                Ok(Vec::new())
            }
            (0xc0, 0) => Ok(camera.give()),
            _ => Err(Stall),
        }
    }

    fn transfer(&mut self, urb: Urb, bus: &Bus) {
        let stream =
            Stream::ALL.iter().find(|stream| urb.to_host && stream.endpoint() == 0x80 | urb.endpoint);
        match stream {
            Some(stream) => _ = self.streams[*stream as usize].send((urb, bus.clone())),
            None => _ = bus.stall(&urb),
        }
    }
}

/// The motor.
#[derive(Default)]
pub struct FootDevice(Foot);

impl Device for FootDevice {
    fn descriptors(&self) -> Descriptors {
        Descriptors {
            device: Descriptors::device_of_version(0, VENDOR, MOTOR, 0x0105),
            configuration: Descriptors::configuration(1, &Descriptors::interface(0, 0, 0xff, 0, 0)),
            strings: ["Microsoft", "Xbox NUI Motor", ""].map(str::to_owned).to_vec(),
        }
    }

    fn speed(&self) -> Speed {
        Speed::Full
    }

    fn control(&mut self, setup: Setup, _: &[u8]) -> Result<Vec<u8>, Stall> {
        match setup.request_type {
            0x40 if self.0.take(setup.request, setup.value) => Ok(Vec::new()),
            0xc0 => self.0.give(setup.request).ok_or(Stall),
            _ => Err(Stall),
        }
    }

    fn transfer(&mut self, urb: Urb, bus: &Bus) {
        bus.stall(&urb);
    }
}
