use super::{DriverError, packet::Stream};

/// A way to a device: what the driver needs of the USB. libusb is one ([`super::open`]), an emulated device within the process
/// another.
pub trait Transport: Send {
    /// A vendor request to the device on endpoint 0, with data.
    fn write(&mut self, request: u8, value: u16, index: u16, data: &[u8]) -> Result<(), TransportError>;

    /// A vendor request to the device on endpoint 0 that is answered with data; returns how much.
    fn read(
        &mut self,
        request: u8,
        value: u16,
        index: u16,
        buffer: &mut [u8],
    ) -> Result<usize, TransportError>;

    /// From now on takes packets of both streams, from a thread of its own, until stopped or dropped.
    fn start(&mut self, packets: Box<dyn Packets>) -> Result<(), TransportError>;

    /// Takes no more packets; returns once the last has been handed over.
    fn stop(&mut self);
}

/// Takes the packets of both streams, in the order in which they came. Must neither block nor panic.
pub trait Packets: Send {
    /// A packet, empty ones included.
    fn packet(&mut self, stream: Stream, packet: &[u8]);

    /// The device is gone: nothing comes any more.
    fn gone(&mut self);
}

/// What can go wrong on the USB.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum TransportError {
    /// The device was unplugged.
    Gone,
    /// It did not answer in time.
    TimedOut,
    /// It refuses the request.
    Refused,
    /// Anything else, in the USB library's words.
    Other(String),
}

impl TransportError {
    /// The driver's error for a command.
    pub(super) fn of(self, command: &'static str) -> DriverError {
        match self {
            Self::Gone => DriverError::Gone,
            Self::TimedOut => DriverError::NoAnswer { command },
            Self::Refused => DriverError::BadAnswer { command, detail: "it refuses the request".to_owned() },
            Self::Other(detail) => DriverError::BadAnswer { command, detail },
        }
    }
}
