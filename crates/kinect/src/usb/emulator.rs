//! A Kinect's side of the USB: answers commands, cuts frames into packets. Knows neither kernel nor time: who plugs it in says when a
//! microframe passes. [`Cable`] connects it to the driver within a process.

use std::{
    collections::BTreeMap,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::frame::{Frame, pack_depth};

use super::{
    Blocks, Led, Model, Packets, Stream, Transport, TransportError,
    control::{Command, Message, parse_command, reply},
    driver::{COLOUR_STREAM, DEPTH_STREAM, SHUTTER_UNIT_S},
    packet::Header,
};

/// Length of a microframe, in which each stream has room for one packet, s.
pub const MICROFRAME_S: f64 = 125e-6;
/// Microframes from one frame to the next, at 30 Hz.
pub const MICROFRAMES: usize = 267;

/// The camera's commands and registers.
#[derive(Clone, Debug)]
pub struct Camera {
    model: Model,
    blocks: Blocks,
    registers: BTreeMap<u16, u16>,
    cmos: BTreeMap<u16, u16>,
    reply: Vec<u8>,
    /// How often "not yet" is said before a reply, as a real one does.
    not_yet: u32,
    said: u32,
}

impl Camera {
    /// A camera after its reset.
    pub fn new(model: Model, blocks: Blocks) -> Self {
        // The colour sensor chooses exposure and white balance by itself.
        let cmos = BTreeMap::from([(0x106, 0x4002), (0x09, 300)]);
        Self { model, blocks, registers: BTreeMap::new(), cmos, reply: Vec::new(), not_yet: 1, said: 0 }
    }

    /// Takes a command. What is none is not answered, as by a real one.
    pub fn take(&mut self, data: &[u8]) {
        self.reply.clear();
        self.said = 0;
        let Ok(message) = parse_command(data) else { return };
        if let Some(payload) = self.answer(message) {
            self.reply = reply(message.command, message.tag, &payload);
        }
    }

    /// Gives the reply; nothing while there is none.
    pub fn give(&mut self) -> Vec<u8> {
        if self.said < self.not_yet {
            self.said += 1;
            return Vec::new();
        }
        std::mem::take(&mut self.reply)
    }

    fn answer(&mut self, message: Message<'_>) -> Option<Vec<u8>> {
        let payload: Vec<u16> =
            message.payload.as_chunks().0.iter().map(|bytes| u16::from_le_bytes(*bytes)).collect();
        let known = [
            Command::ReadRegister,
            Command::WriteRegister,
            Command::FixedParameters,
            Command::AlgorithmParameters,
            Command::Cmos,
        ];
        let which = known.into_iter().find(|known| *known as u16 == message.command)?;
        let words = |words: &[u16]| Some(words.iter().flat_map(|word| word.to_le_bytes()).collect());
        match (which, payload.as_slice()) {
            (Command::ReadRegister, [register, ..]) => {
                words(&[0, self.registers.get(register).copied().unwrap_or(0)])
            }
            (Command::WriteRegister, [register, value, ..]) => {
                self.registers.insert(*register, *value);
                words(&[0])
            }
            (Command::FixedParameters | Command::AlgorithmParameters, payload) => {
                self.blocks.answer(message.command, payload, self.model)
            }
            (Command::Cmos, [count, register, value, ..]) => {
                let place = register & 0x7fff;
                if register & 0x8000 != 0 {
                    self.cmos.insert(place, *value);
                }
                words(&[*count, *register, self.cmos.get(&place).copied().unwrap_or(0)])
            }
            _ => None,
        }
    }

    /// Whether a stream is switched on.
    pub fn runs(&self, stream: Stream) -> bool {
        let register = match stream {
            Stream::Colour => COLOUR_STREAM,
            Stream::Depth => DEPTH_STREAM,
        };
        self.registers.get(&register).is_some_and(|value| *value != 0)
    }

    /// Exposure of a row, s; `None` when the device chooses it.
    pub fn exposure_s(&self) -> Option<f64> {
        let chooses = self.cmos.get(&0x106).is_none_or(|switches| switches & 0x4000 != 0);
        (!chooses).then(|| f64::from(self.cmos.get(&0x09).copied().unwrap_or(0)) * SHUTTER_UNIT_S)
    }

    /// Whether the device chooses the white balance.
    pub fn balances(&self) -> bool {
        self.cmos.get(&0x106).is_none_or(|switches| switches & 2 != 0)
    }
}

/// The motor's device.
#[derive(Clone, Debug, Default)]
pub struct Foot {
    halves: i8,
    led: u16,
}

impl Foot {
    /// Carries out a vendor request from the host; false for one that it does not know.
    pub fn take(&mut self, request: u8, value: u16) -> bool {
        match request {
            0x31 => self.halves = (value as u8).cast_signed().clamp(-62, 62),
            0x06 => self.led = value,
            _ => return false,
        }
        true
    }

    /// Answers a vendor request to the host.
    pub fn give(&self, request: u8) -> Option<Vec<u8>> {
        // At rest, the head tilted by what the motor was told.
        let tilt = f64::from(self.halves) / 2.0;
        let (sin, cos) = tilt.to_radians().sin_cos();
        let [up, ahead] = [cos, sin].map(|g| ((819.0 * g).round() as i16).to_be_bytes());
        let limit = u8::from(self.halves.abs() == 62);
        let state = [0, 0, 0, 0, up[0], up[1], ahead[0], ahead[1], self.halves.cast_unsigned(), limit];
        (request == 0x32).then(|| state.to_vec())
    }

    /// Whether the lamp shows this.
    pub fn shows(&self, led: Led) -> bool {
        self.led == led as u16
    }
}

/// What goes wrong on the way of a stream's packets.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PacketFaults {
    /// Probability that a packet is lost.
    pub loss: f64,
    /// Probability that its end is missing.
    pub cut: f64,
}

/// Cuts frames into a stream's packets.
#[derive(Clone, Debug)]
pub struct Transmitter {
    stream: Stream,
    image: Box<[u8]>,
    /// The next packet; at the end when nothing is to be sent.
    index: usize,
    sequence: u8,
    ticks: u32,
    faults: PacketFaults,
    rng: ChaCha8Rng,
}

impl Transmitter {
    /// One with nothing to send.
    pub fn new(stream: Stream, faults: PacketFaults, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(stream as u64);
        Self {
            stream,
            image: vec![0; stream.image_bytes()].into_boxed_slice(),
            index: stream.packets(),
            sequence: 0,
            ticks: 0,
            faults,
            rng,
        }
    }

    /// Whether a frame is being sent.
    pub fn busy(&self) -> bool {
        self.index < self.stream.packets()
    }

    /// The frame to send next; one that is being sent ends where it is.
    pub fn load(&mut self, frame: &Frame) {
        match self.stream {
            Stream::Colour => {
                self.image.copy_from_slice(&frame.colour);
                self.ticks = frame.colour_ticks;
            }
            Stream::Depth => {
                // Both lengths are right by construction.
                let _ = pack_depth(&frame.depth, &mut self.image);
                self.ticks = frame.depth_ticks;
            }
        }
        self.index = 0;
    }

    /// Stops sending.
    pub fn halt(&mut self) {
        self.index = self.stream.packets();
    }

    /// The packet of a microframe is put behind what is in `out`; nothing when there is none to send, or it is lost. Returns its length.
    pub fn microframe(&mut self, out: &mut Vec<u8>) -> usize {
        if !self.busy() {
            return 0;
        }
        let (place, position) = (self.stream.place(self.index), self.stream.position(self.index));
        let header = Header { position, sequence: self.sequence, ticks: self.ticks };
        self.index += 1;
        self.sequence = self.sequence.wrapping_add(1);
        // Both are drawn for every packet, so that the one does not shift the other.
        let lost = self.rng.random::<f64>() < self.faults.loss;
        let cut = self.rng.random::<f64>() < self.faults.cut;
        if lost {
            return 0;
        }
        let begin = out.len();
        out.extend(header.bytes(self.stream, place.len()));
        out.extend(&self.image[place]);
        if cut {
            out.truncate(begin + (out.len() - begin) / 2);
        }
        out.len() - begin
    }
}

/// A camera and the driver on the two ends of a cable, within a process: the driver's [`Transport`] on the one end, [`Cable::carry`] on
/// the other.
#[derive(Clone)]
pub struct Cable(Arc<Mutex<Ends>>);

struct Ends {
    camera: Camera,
    transmitters: [Transmitter; 2],
    packets: Option<Box<dyn Packets>>,
    plugged: bool,
}

impl Cable {
    /// Plugs a camera in.
    pub fn new(camera: Camera, faults: PacketFaults, seed: u64) -> Self {
        let transmitters = Stream::ALL.map(|stream| Transmitter::new(stream, faults, seed));
        Self(Arc::new(Mutex::new(Ends { camera, transmitters, packets: None, plugged: true })))
    }

    fn ends(&self) -> MutexGuard<'_, Ends> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The camera as it is now.
    pub fn camera(&self) -> Camera {
        self.ends().camera.clone()
    }

    /// Sends a frame, a microframe at a time, which `pass` is told of before it.
    pub fn carry(&self, frame: &Frame, mut pass: impl FnMut()) {
        let ends = &mut *self.ends();
        let mut packet = Vec::new();
        for (stream, transmitter) in Stream::ALL.into_iter().zip(&mut ends.transmitters) {
            if ends.camera.runs(stream) {
                transmitter.load(frame);
            }
        }
        for _ in 0..MICROFRAMES {
            pass();
            for (stream, transmitter) in Stream::ALL.into_iter().zip(&mut ends.transmitters) {
                packet.clear();
                transmitter.microframe(&mut packet);
                if let Some(packets) = &mut ends.packets {
                    packets.packet(stream, &packet);
                }
            }
        }
    }

    /// Pulls the plug.
    pub fn unplug(&self) {
        let ends = &mut *self.ends();
        ends.plugged = false;
        if let Some(packets) = &mut ends.packets {
            packets.gone();
        }
    }
}

impl Transport for Cable {
    fn write(&mut self, _: u8, _: u16, _: u16, data: &[u8]) -> Result<(), TransportError> {
        let mut ends = self.ends();
        if !ends.plugged {
            return Err(TransportError::Gone);
        }
        ends.camera.take(data);
        Ok(())
    }

    fn read(&mut self, _: u8, _: u16, _: u16, buffer: &mut [u8]) -> Result<usize, TransportError> {
        let mut ends = self.ends();
        if !ends.plugged {
            return Err(TransportError::Gone);
        }
        let reply = ends.camera.give();
        let length = reply.len().min(buffer.len());
        buffer[..length].copy_from_slice(&reply[..length]);
        Ok(length)
    }

    fn start(&mut self, packets: Box<dyn Packets>) -> Result<(), TransportError> {
        let mut ends = self.ends();
        if !ends.plugged {
            return Err(TransportError::Gone);
        }
        ends.packets = Some(packets);
        Ok(())
    }

    fn stop(&mut self) {
        self.ends().packets = None;
    }
}
