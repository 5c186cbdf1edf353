//! A serial port on the USB: a CDC-ACM device, which Linux shows as `/dev/ttyACM0`, over any stream of bytes.

use std::{
    collections::VecDeque,
    io::{Read, Write},
    sync::{Arc, Mutex, PoisonError},
    thread,
};

use crate::{Bus, Descriptors, Device, Setup, Speed, Stall, Urb};

/// Endpoints: notifications, which never come; bytes to the host; bytes from the host.
const NOTIFY: u8 = 1;
const TO_HOST: u8 = 2;
const FROM_HOST: u8 = 3;

/// Requests of the class (USB CDC PSTN 1.2, table 13).
const SET_LINE_CODING: u8 = 0x20;
const GET_LINE_CODING: u8 = 0x21;
const SET_CONTROL_LINE_STATE: u8 = 0x22;
const SEND_BREAK: u8 = 0x23;

/// The port.
pub struct SerialPort {
    output: Box<dyn Write + Send>,
    state: Arc<Mutex<State>>,
    line_coding: Vec<u8>,
}

#[derive(Default)]
struct State {
    /// Bytes that the host has not asked for yet.
    bytes: VecDeque<u8>,
    /// What the host asks to be told, oldest first.
    reads: VecDeque<(Urb, Bus)>,
}

impl SerialPort {
    /// A port: what is read from `input` goes to the host, what the host sends is written to `output`. Input is read on a thread of its
    /// own, which ends with it.
    pub fn new(mut input: impl Read + Send + 'static, output: impl Write + Send + 'static) -> Self {
        let state = Arc::new(Mutex::new(State::default()));
        let feed = Arc::clone(&state);
        thread::spawn(move || {
            let mut bytes = [0; 4096];
            while let Ok(read @ 1..) = input.read(&mut bytes) {
                let mut state = feed.lock().unwrap_or_else(PoisonError::into_inner);
                state.bytes.extend(&bytes[..read]);
                state.pump();
            }
        });
        // 115,200 baud, 1 stop bit, no parity, 8 bits.
        let line_coding = vec![0x00, 0xC2, 0x01, 0x00, 0, 0, 8];
        Self { output: Box::new(output), state, line_coding }
    }
}

impl State {
    fn pump(&mut self) {
        while !self.bytes.is_empty() {
            let Some((urb, bus)) = self.reads.pop_front() else { return };
            let count = self.bytes.len().min(urb.length as usize);
            let chunk: Vec<u8> = self.bytes.iter().copied().take(count).collect();
            // What was taken back in the meantime leaves the bytes to the next.
            if bus.complete(&urb, &chunk) {
                self.bytes.drain(..count);
            }
        }
    }
}

impl Device for SerialPort {
    fn descriptors(&self) -> Descriptors {
        let mut body = Vec::new();
        // Communication: abstract control model, with its functional descriptors (header, call management, capabilities, union).
        body.extend(Descriptors::interface(0, 1, 2, 2, 1));
        body.extend([5, 0x24, 0x00, 0x10, 0x01]);
        body.extend([5, 0x24, 0x01, 0x00, 1]);
        body.extend([4, 0x24, 0x02, 0x02]);
        body.extend([5, 0x24, 0x06, 0, 1]);
        body.extend(Descriptors::endpoint(0x80 | NOTIFY, 3, 8, 10));
        body.extend(Descriptors::interface(1, 2, 10, 0, 0));
        body.extend(Descriptors::endpoint(0x80 | TO_HOST, 2, 64, 0));
        body.extend(Descriptors::endpoint(FROM_HOST, 2, 64, 0));
        Descriptors {
            // Cypress, and the number of its USB-UART example.
            device: Descriptors::device(2, 0x04b4, 0xf232),
            configuration: Descriptors::configuration(2, &body),
            strings: vec!["bench".to_owned(), "PSoC5 (emulated)".to_owned(), "0001".to_owned()],
        }
    }

    fn speed(&self) -> Speed {
        Speed::Full
    }

    fn control(&mut self, setup: Setup, data: &[u8]) -> Result<Vec<u8>, Stall> {
        match (setup.request_type, setup.request) {
            (0x21, SET_LINE_CODING) => {
                self.line_coding = data.to_vec();
                Ok(Vec::new())
            }
            (0xA1, GET_LINE_CODING) => Ok(self.line_coding.clone()),
            (0x21, SET_CONTROL_LINE_STATE | SEND_BREAK) => Ok(Vec::new()),
            _ => Err(Stall),
        }
    }

    fn transfer(&mut self, urb: Urb, bus: &Bus) {
        match (urb.to_host, urb.endpoint) {
            // Kept for ever: there is never anything to notify.
            (true, NOTIFY) => {}
            (true, TO_HOST) => {
                let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
                state.reads.push_back((urb, bus.clone()));
                state.pump();
            }
            (false, FROM_HOST) => {
                let taken = self.output.write_all(&urb.data).and_then(|()| self.output.flush());
                if taken.is_ok() {
                    bus.complete(&urb, &[])
                } else {
                    bus.stall(&urb)
                };
            }
            _ => _ = bus.stall(&urb),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::{
        io::{Read, Write},
        os::unix::net::UnixStream,
    };

    use super::*;
    use crate::server::serve;

    /// The kernel's side of the wire.
    struct Kernel(UnixStream, u32);

    impl Kernel {
        /// A serial port whose other end is the stream returned.
        fn with_port() -> (Self, UnixStream) {
            let (kernel, ours) = UnixStream::pair().unwrap();
            let (program, device_end) = UnixStream::pair().unwrap();
            let mut device = SerialPort::new(device_end.try_clone().unwrap(), device_end);
            thread::spawn(move || serve(ours, &mut device));
            (Self(kernel, 0), program)
        }

        fn request(&mut self, words: [u32; 10], setup: [u8; 8], data: &[u8]) -> u32 {
            self.1 += 1;
            let mut bytes: Vec<u8> = words.into_iter().flat_map(u32::to_be_bytes).collect();
            bytes[4..8].copy_from_slice(&self.1.to_be_bytes());
            bytes.extend(setup);
            bytes.extend(data);
            self.0.write_all(&bytes).unwrap();
            self.1
        }

        fn submit(&mut self, endpoint: u8, to_host: bool, length: u32, setup: [u8; 8], data: &[u8]) -> u32 {
            let words = [1, 0, 0, u32::from(to_host), u32::from(endpoint), 0, length, 0, u32::MAX, 0];
            self.request(words, setup, data)
        }

        fn unlink(&mut self, victim: u32) -> u32 {
            self.request([2, 0, 0, 0, 0, victim, 0, 0, 0, 0], [0; 8], &[])
        }

        /// Number, status and data of the next answer.
        fn answer(&mut self) -> (u32, i32, Vec<u8>) {
            let mut header = [0; 48];
            self.0.read_exact(&mut header).unwrap();
            let word = |at: usize| u32::from_be_bytes(header[at..at + 4].try_into().unwrap());
            let length = if word(0) == 3 { word(24) } else { 0 };
            // What was sent is not sent back.
            let to_host = word(4) % 2 == 1;
            let mut data = vec![0; if to_host { length as usize } else { 0 }];
            self.0.read_exact(&mut data).unwrap();
            (word(4), word(20).cast_signed(), data)
        }
    }

    #[test]
    fn the_kernel_finds_a_serial_port_of_the_right_class() {
        let (mut kernel, _program) = Kernel::with_port();
        kernel.submit(0, true, 18, [0x80, 6, 0, 1, 0, 0, 18, 0], &[]);
        let (_, status, device) = kernel.answer();
        assert_eq!((status, device.len(), device[4]), (0, 18, 2));
        kernel.1 += 1;
        kernel.submit(0, true, 255, [0x80, 6, 0, 2, 0, 0, 255, 0], &[]);
        let (_, _, configuration) = kernel.answer();
        let total = usize::from(u16::from_le_bytes([configuration[2], configuration[3]]));
        assert_eq!(total, configuration.len());
        // Lengths lead from one descriptor to the next, exactly to the end.
        let mut at = 0;
        while at < total {
            at += usize::from(configuration[at]);
        }
        assert_eq!(at, total);
    }

    #[test]
    fn bytes_go_through_and_survive_a_read_that_was_taken_back() {
        let (mut kernel, mut program) = Kernel::with_port();
        // Number 1 waits; it is taken back before anything comes.
        let first = kernel.submit(TO_HOST, true, 64, [0; 8], &[]);
        let unlink = kernel.unlink(first);
        assert_eq!(kernel.answer(), (unlink, -104, Vec::new()));
        program.write_all(b"not lost").unwrap();
        let second = kernel.submit(TO_HOST, true, 64, [0; 8], &[]);
        assert_eq!(kernel.answer(), (second, 0, b"not lost".to_vec()));
        let sent = kernel.submit(FROM_HOST, false, 5, [0; 8], b"hello");
        let mut received = [0; 5];
        program.read_exact(&mut received).unwrap();
        assert_eq!((&received, kernel.answer()), (b"hello", (sent, 0, Vec::new())));
        // What is over cannot be taken back.
        let late = kernel.unlink(sent);
        assert_eq!(kernel.answer(), (late, 0, Vec::new()));
    }
}
