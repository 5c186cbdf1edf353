//! Any replies to the driver's commands: no panic, no wait without end, and constants that depths can be computed from or none at all.

#![no_main]

use bench_kinect::usb::{
    Kinect, Model, Packets, Transport, TransportError,
    control::{parse_command, parse_reply, reply},
};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| {
    if let Ok(message) = parse_reply(input) {
        assert_eq!(reply(message.command, message.tag, message.payload), input);
    }
    let _ = parse_command(input);
    for sealed in [false, true] {
        let device = Device {
            replies: input.split(|byte| *byte == 0xfe).map(<[u8]>::to_vec).collect(),
            sealed,
            asked: vec![],
        };
        if let Ok(kinect) = Kinect::new(Box::new(device), None, Model::Xbox1414, String::new()) {
            let blocks = kinect.blocks();
            for length in
                [blocks.emitter_distance_cm, blocks.reference_distance_cm, blocks.reference_pixel_cm]
            {
                assert!(length.is_finite() && length > 0.0);
            }
        }
    }
});

/// Answers with pieces of the input, as they are or with the header that the driver waits for.
struct Device {
    replies: Vec<Vec<u8>>,
    sealed: bool,
    asked: Vec<u8>,
}

impl Transport for Device {
    fn write(&mut self, _: u8, _: u16, _: u16, data: &[u8]) -> Result<(), TransportError> {
        self.asked = data.to_vec();
        Ok(())
    }

    fn read(&mut self, _: u8, _: u16, _: u16, buffer: &mut [u8]) -> Result<usize, TransportError> {
        let mut bytes =
            self.replies.pop().filter(|bytes| !bytes.is_empty()).ok_or(TransportError::TimedOut)?;
        if self.sealed {
            let asked = parse_command(&self.asked).map_err(|_| TransportError::Refused)?;
            // Short inputs stand for long blocks.
            bytes.resize(bytes.len().max(330), bytes[0]);
            bytes = reply(asked.command, asked.tag, &bytes);
        }
        // All of it would say "not yet", and be waited for.
        let length = bytes.len().min(buffer.len() - 1);
        buffer[..length].copy_from_slice(&bytes[..length]);
        Ok(length)
    }

    fn start(&mut self, _: Box<dyn Packets>) -> Result<(), TransportError> {
        Err(TransportError::Refused)
    }

    fn stop(&mut self) {}
}
