//! Isochronous transfers through libusb's C interface: the one place of this crate with unsafe code, as `rusb` has no safe call for them.
//!
//! A thread owns all transfers with their buffers and handles libusb's events. libusb calls [`finished`] for a transfer from whatever
//! thread handles events (a control transfer's may do so too), one at a time; the lock makes that sure on this side. Buffers and
//! transfers are freed once every transfer has been reported finished for the last time.
#![expect(unsafe_code, reason = "rusb has no isochronous transfers")]

use std::{
    os::raw::{c_int, c_uint, c_void},
    panic::{AssertUnwindSafe, catch_unwind},
    ptr, slice,
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
        mpsc,
    },
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use rusb::{Context, DeviceHandle, UsbContext, constants, ffi};

use super::{Packets, Stream, TransportError, packet::PACKET};

/// Transfers that wait at a time, a stream, and packets of each: 32 ms of them, in pieces of 2 ms.
const TRANSFERS: usize = 16;
const PACKETS: usize = 16;
/// The same and the buffer's length, as C counts.
const C_PACKETS: c_int = 16;
const C_BUFFER: c_int = 16 * 1920;
const _: () = assert!(C_PACKETS as usize == PACKETS && C_BUFFER as usize == PACKETS * PACKET);

/// How long events are waited for before looking whether to stop; stopping wakes the thread anyway.
const LOOK: Duration = Duration::from_millis(100);
/// Cancelled transfers come back within milliseconds.
const CANCELLING: Duration = Duration::from_secs(5);

/// Running transfers of both streams. Dropping ends them.
pub(super) struct Transfers {
    stop: Arc<AtomicBool>,
    context: Context,
    thread: Option<JoinHandle<()>>,
}

impl Transfers {
    /// Submits them, and from then on hands over packets.
    pub fn start(
        handle: Arc<DeviceHandle<Context>>,
        packets: Box<dyn Packets>,
    ) -> Result<Self, TransportError> {
        let stop = Arc::new(AtomicBool::new(false));
        let context = handle.context().clone();
        let (started, starts) = mpsc::channel();
        let flag = Arc::clone(&stop);
        let thread = thread::Builder::new()
            .name("kinect".to_owned())
            .spawn(move || {
                let mut flight = Flight::new(handle, packets);
                let outcome = flight.take_off();
                let flies = outcome.is_ok();
                let _ = started.send(outcome);
                flight.run(&flag, flies);
            })
            .map_err(|error| TransportError::Other(format!("cannot start a thread: {error}")))?;
        let transfers = Self { stop, context, thread: Some(thread) };
        let ended = || TransportError::Other("the thread of the transfers ended".to_owned());
        starts.recv().map_err(|_| ended())??;
        Ok(transfers)
    }
}

impl Drop for Transfers {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Release);
        self.context.interrupt_handle_events();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// What the callback works with.
struct Shared(Mutex<State>);

struct State {
    packets: Box<dyn Packets>,
    /// Transfers that libusb has.
    in_flight: usize,
    stopping: bool,
    gone: bool,
}

impl Shared {
    fn lock(&self) -> std::sync::MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What a transfer's `user_data` points to.
struct User {
    shared: Arc<Shared>,
    stream: Stream,
}

/// A transfer and what it refers to.
struct Slot {
    transfer: *mut ffi::libusb_transfer,
    /// These two are referred to by the transfer alone while libusb has it.
    _user: Arc<User>,
    _buffer: Vec<u8>,
}

/// All transfers; stays on its thread.
struct Flight {
    handle: Arc<DeviceHandle<Context>>,
    shared: Arc<Shared>,
    slots: Vec<Slot>,
}

impl Flight {
    fn new(handle: Arc<DeviceHandle<Context>>, packets: Box<dyn Packets>) -> Self {
        let state = State { packets, in_flight: 0, stopping: false, gone: false };
        Self { handle, shared: Arc::new(Shared(Mutex::new(state))), slots: Vec::new() }
    }

    /// Makes and submits the transfers; on an error some may be under way.
    fn take_off(&mut self) -> Result<(), TransportError> {
        for stream in Stream::ALL {
            for _ in 0..TRANSFERS {
                let transfer = self.slot(stream)?;
                // Counted before, as it may be reported at once.
                self.shared.lock().in_flight += 1;
                // SAFETY: the transfer was filled by `slot`, is not submitted, and lives, with its buffer and user data, in `self.slots`
                // until `run` has seen it reported for the last time.
                let status = unsafe { ffi::libusb_submit_transfer(transfer) };
                if status != 0 {
                    self.shared.lock().in_flight -= 1;
                    return Err(refused(status));
                }
            }
        }
        Ok(())
    }

    fn slot(&mut self, stream: Stream) -> Result<*mut ffi::libusb_transfer, TransportError> {
        let user = Arc::new(User { shared: Arc::clone(&self.shared), stream });
        let mut buffer = vec![0_u8; PACKETS * PACKET];
        // SAFETY: no requirements; null is looked for.
        let transfer = unsafe { ffi::libusb_alloc_transfer(C_PACKETS) };
        if transfer.is_null() {
            return Err(TransportError::Other("out of memory".to_owned()));
        }
        // SAFETY: the transfer was allocated for so many packets. The handle is open for as long as `self.handle` lives; the buffer is
        // as long as is said; buffer and user data are on the heap, so they stay where they are when their owners move into `self.slots`.
        unsafe {
            ffi::libusb_fill_iso_transfer(
                transfer,
                self.handle.as_raw(),
                stream.endpoint(),
                buffer.as_mut_ptr(),
                C_BUFFER,
                C_PACKETS,
                finished,
                Arc::as_ptr(&user).cast_mut().cast::<c_void>(),
                0,
            );
            ffi::libusb_set_iso_packet_lengths(transfer, PACKET as c_uint);
        }
        self.slots.push(Slot { transfer, _user: user, _buffer: buffer });
        Ok(transfer)
    }

    /// Handles events until asked to stop, or the device is gone, and every transfer is back.
    fn run(self, stop: &AtomicBool, flies: bool) {
        let mut cancelled: Option<Instant> = None;
        loop {
            let mut state = self.shared.lock();
            if state.in_flight == 0 {
                break;
            }
            if cancelled.is_none() && (stop.load(Ordering::Acquire) || !flies || state.gone) {
                state.stopping = true;
                // Cancelling takes libusb's locks, and a callback, which has those, takes ours.
                drop(state);
                for slot in &self.slots {
                    // SAFETY: a transfer of ours that is not freed; one that is not under way is refused by libusb.
                    unsafe { ffi::libusb_cancel_transfer(slot.transfer) };
                }
                cancelled = Some(Instant::now());
            } else {
                drop(state);
            }
            if cancelled.is_some_and(|since| since.elapsed() > CANCELLING) {
                // libusb still has some: what they refer to must not go.
                std::mem::forget(self);
                return;
            }
            if self.handle.context().handle_events(Some(LOOK)).is_err() {
                // Nothing to be done about it here; not to spin is all.
                thread::sleep(Duration::from_millis(1));
            }
        }
        for slot in &self.slots {
            // SAFETY: none is in flight, so libusb has none of them, and each is freed once.
            unsafe { ffi::libusb_free_transfer(slot.transfer) };
        }
    }
}

/// libusb's report of a transfer.
extern "system" fn finished(transfer: *mut ffi::libusb_transfer) {
    // A panic must not leave through C; there is none in what is called, and if there were one, its transfer would stay away.
    let _ = catch_unwind(AssertUnwindSafe(|| {
        // SAFETY: libusb hands over a transfer that `slot` filled and that is not freed while any is in flight; its user data is the `User` in the same
        // slot, which is only ever read.
        let (user, status) = unsafe { (&*(*transfer).user_data.cast::<User>(), (*transfer).status) };
        let mut state = user.shared.lock();
        if status == constants::LIBUSB_TRANSFER_COMPLETED {
            // SAFETY: as above; libusb does not touch a transfer that it has reported until it is submitted again, below.
            unsafe { hand_over(transfer, user.stream, state.packets.as_mut()) };
        }
        let gone = status == constants::LIBUSB_TRANSFER_NO_DEVICE;
        if !gone && !state.stopping && status != constants::LIBUSB_TRANSFER_CANCELLED {
            // SAFETY: it has been reported, so it is ours, filled as before.
            let status = unsafe { ffi::libusb_submit_transfer(transfer) };
            if status == 0 {
                return;
            }
        }
        state.in_flight -= 1;
        // One that cannot be submitted again is no better than none.
        if !state.stopping && !state.gone {
            state.gone = true;
            state.packets.gone();
        }
    }));
}

/// Hands over the packets of a transfer that is complete.
///
/// # Safety
/// The transfer must be one that [`Flight::slot`] filled, reported and not submitted again.
unsafe fn hand_over(transfer: *mut ffi::libusb_transfer, stream: Stream, packets: &mut dyn Packets) {
    // SAFETY: the transfer was allocated with `PACKETS` descriptors behind it, which libusb has written; the pointer is made from the
    // transfer's, not from a reference to the field, which has length zero.
    let (descriptors, buffer) = unsafe {
        let first = ptr::addr_of!((*transfer).iso_packet_desc).cast::<ffi::libusb_iso_packet_descriptor>();
        (slice::from_raw_parts(first, PACKETS), slice::from_raw_parts((*transfer).buffer, PACKETS * PACKET))
    };
    for (descriptor, packet) in descriptors.iter().zip(buffer.chunks_exact(PACKET)) {
        // A packet with an error is a lost one, which the next one's number shows.
        if descriptor.status == constants::LIBUSB_TRANSFER_COMPLETED {
            packets.packet(stream, &packet[..(descriptor.actual_length as usize).min(PACKET)]);
        }
    }
}

fn refused(status: c_int) -> TransportError {
    match status {
        constants::LIBUSB_ERROR_NO_DEVICE => TransportError::Gone,
        constants::LIBUSB_ERROR_NO_MEM => {
            let detail =
                "the kernel has no memory for it; see /sys/module/usbcore/parameters/usbfs_memory_mb";
            TransportError::Other(detail.to_owned())
        }
        // What the kernel says of a bus without bandwidth comes out of libusb as this.
        constants::LIBUSB_ERROR_IO | constants::LIBUSB_ERROR_OTHER => {
            TransportError::Other("the bus has no room for its transfers".to_owned())
        }
        status => TransportError::Other(format!("libusb's error {status}")),
    }
}
