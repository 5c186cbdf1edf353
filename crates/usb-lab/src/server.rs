//! Serves one device to the kernel, over one socket.

use std::{
    collections::HashSet,
    io::{self, Write},
    net::Shutdown,
    os::{fd::AsRawFd, unix::net::UnixStream},
    sync::{Arc, Mutex, PoisonError},
    thread,
};

use crate::{Device, Setup, Urb, wire, wire::Request};

/// "Broken pipe": an endpoint that stalls.
const EPIPE: i32 = 32;

const VHCI: &str = "/sys/devices/platform/vhci_hcd.0";

/// The way back to the kernel. Copies belong to the same device.
#[derive(Clone, Debug)]
pub struct Bus(Arc<Mutex<Wire>>);

#[derive(Debug)]
struct Wire {
    stream: UnixStream,
    /// Transfers that the kernel waits for.
    pending: HashSet<u32>,
}

impl Bus {
    fn new(stream: UnixStream) -> Self {
        Self(Arc::new(Mutex::new(Wire { stream, pending: HashSet::new() })))
    }

    /// Completes a transfer: to the host, with `data`; from the host, with as many bytes taken as were sent. False: the kernel has taken it
    /// back, and nothing has arrived.
    pub fn complete(&self, urb: &Urb, data: &[u8]) -> bool {
        let data = &data[..data.len().min(urb.length as usize)];
        let actual = if urb.to_host { data.len() as u32 } else { urb.length };
        self.answer(urb, &wire::submitted(urb, 0, actual, if urb.to_host { data } else { &[] }))
    }

    /// Completes an isochronous transfer to the host, a packet each of its slots; missing ones are empty.
    pub fn stream(&self, urb: &Urb, packets: &[&[u8]]) -> bool {
        self.answer(urb, &wire::streamed(urb, packets))
    }

    /// Fails a transfer: the endpoint stalls.
    pub fn stall(&self, urb: &Urb) -> bool {
        self.answer(urb, &wire::submitted(urb, -EPIPE, 0, &[]))
    }

    fn answer(&self, urb: &Urb, reply: &[u8]) -> bool {
        let mut wire = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        // A kernel that has hung up takes nothing more, which the reading side notices.
        wire.pending.remove(&urb.sequence) && wire.stream.write_all(reply).is_ok()
    }

    fn begin(&self, urb: &Urb) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).pending.insert(urb.sequence);
    }

    fn unlink(&self, sequence: u32, victim: u32) -> io::Result<()> {
        let mut wire = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let was_pending = wire.pending.remove(&victim);
        wire.stream.write_all(&wire::unlinked(sequence, was_pending))
    }
}

/// Answers the kernel until it hangs up.
pub(crate) fn serve(mut stream: UnixStream, device: &mut dyn Device) -> io::Result<()> {
    let bus = Bus::new(stream.try_clone()?);
    loop {
        match Request::read(&mut stream) {
            Ok(Request::Unlink { sequence, victim }) => bus.unlink(sequence, victim)?,
            Ok(Request::Submit(urb)) => {
                bus.begin(&urb);
                if urb.endpoint == 0 { control(device, &urb, &bus) } else { device.transfer(urb, &bus) }
            }
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => return Ok(()),
            Err(error) => return Err(error),
        }
    }
}

fn control(device: &mut dyn Device, urb: &Urb, bus: &Bus) {
    let setup = Setup::from(urb.setup);
    let [index, kind] = setup.value.to_le_bytes();
    let answer = match (setup.request_type, setup.request) {
        // Get descriptor.
        (0x80, 6) => device.descriptors().get(kind, index),
        // Get status of device, interface, endpoint.
        (0x80..=0x82, 0) => Some(vec![0, 0]),
        // Get configuration, get interface.
        (0x80, 8) => Some(vec![1]),
        (0x81, 10) => Some(vec![0]),
        // Set address, configuration, interface; clear feature.
        (0, 5 | 9) | (1, 11) | (0..=2, 1) => Some(Vec::new()),
        _ => device.control(setup, &urb.data).ok(),
    };
    match answer {
        Some(data) => bus.complete(urb, &data),
        None => bus.stall(urb),
    };
}

/// A device that is plugged into the kernel. Dropping it unplugs it.
#[derive(Debug)]
pub struct Plug {
    port: u8,
    stream: UnixStream,
}

impl Plug {
    /// Plugs a device into a port of `vhci_hcd`, 0 to 7. The kernel then enumerates it in its own time.
    pub fn insert(port: u8, mut device: Box<dyn Device>) -> io::Result<Self> {
        let (kernel, ours) = UnixStream::pair()?;
        let stream = ours.try_clone()?;
        // Bus 1; device numbers are 1 and up.
        let number = 1 << 16 | (u32::from(port) + 1);
        let speed = device.speed() as u32;
        let request = format!("{port} {} {number} {speed}", kernel.as_raw_fd());
        std::fs::write(format!("{VHCI}/attach"), request)
            .map_err(|error| io::Error::other(format!("cannot plug into port {port} of {VHCI}: {error}")))?;
        thread::Builder::new().name(format!("usb port {port}")).spawn(move || {
            if let Err(error) = serve(ours, device.as_mut()) {
                eprintln!("usb port {port}: {error}");
            }
        })?;
        Ok(Self { port, stream })
    }
}

impl Drop for Plug {
    fn drop(&mut self) {
        // Either alone would do; the kernel frees the port sooner when told.
        let _ = self.stream.shutdown(Shutdown::Both);
        let _ = std::fs::write(format!("{VHCI}/detach"), self.port.to_string());
    }
}
