//! One blocking thread a port: it writes a command, reads until its answer has come, and hands that back.
//!
//! Two bounded lock-free queues and the parking of threads join it to the caller, so that nothing on the caller's side allocates or
//! locks. The thread inherits the caller's scheduling: connect from the loop's thread, once that has its priority.

use std::{
    io::{self, Read, Write},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread::{self, JoinHandle, Thread},
    time::{Duration, Instant},
};

use firmware_proto::{Answer, BoardFrame, DELIMITER, Decoder, FrameError, HostFrame, MAX_WIRE_LEN};
use rtrb::{Consumer, Producer, RingBuffer};
use serialport::{ClearBuffer, SerialPort, TTYPort};

use crate::{DacError, ports};

/// One on its way, one that is given up while the thread still waits for it, and room.
const QUEUE: usize = 4;

/// How long the caller waits beyond the thread's own time-out.
const GRACE: Duration = Duration::from_millis(20);

/// How often an idle thread looks up; it is woken for work.
const IDLE: Duration = Duration::from_millis(200);

#[derive(Debug)]
pub struct Link {
    requests: Producer<Request>,
    replies: Consumer<Reply>,
    closing: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    number: u64,
}

#[derive(Debug)]
struct Request {
    number: u64,
    frame: HostFrame,
    timeout: Duration,
    waiter: Thread,
}

#[derive(Debug)]
struct Reply {
    number: u64,
    outcome: Outcome,
}

/// How an exchange went.
#[derive(Clone, Copy, Debug)]
pub struct Outcome {
    pub result: Result<Exchange, LinkError>,
    /// Intact answers that nobody waited for any more.
    pub stale: u32,
    /// Stretches of bytes that were no frame.
    pub corrupt: u32,
}

/// An answer, and the times between which the board gave it.
#[derive(Clone, Copy, Debug)]
pub struct Exchange {
    pub answer: Answer,
    pub sent: Instant,
    pub received: Instant,
}

/// Why there is no answer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LinkError {
    /// None came in time. `garbage` is what came instead.
    Timeout { garbage: Option<FrameError> },
    /// The port went away.
    Unplugged(io::ErrorKind),
}

/// A command on its way.
#[derive(Clone, Copy, Debug)]
pub struct Pending {
    number: u64,
    until: Instant,
}

impl Link {
    /// Opens a port and starts its thread.
    pub fn open(port: &str) -> Result<Self, DacError> {
        let mut tty = open(port)?;
        let gone =
            |error: &io::Error| DacError::Unplugged { port: port.to_owned(), detail: error.to_string() };
        // What an earlier user left is thrown away here, and cut off in the board by a delimiter.
        let _ = tty.clear(ClearBuffer::All);
        tty.write_all(&[DELIMITER]).map_err(|error| gone(&error))?;
        let (requests, incoming) = RingBuffer::new(QUEUE);
        let (outgoing, replies) = RingBuffer::new(QUEUE);
        let closing = Arc::new(AtomicBool::new(false));
        let io = IoThread {
            tty,
            requests: incoming,
            replies: outgoing,
            decoder: Decoder::new(),
            closing: Arc::clone(&closing),
        };
        let thread =
            thread::Builder::new().name("serial".to_owned()).spawn(|| io.run()).map_err(|error| {
                DacError::System { action: "start the port's thread", detail: error.to_string() }
            })?;
        Ok(Self { requests, replies, closing, thread: Some(thread), number: 0 })
    }

    /// Sends a command. `None`: the thread has not caught up with earlier ones, and this one was not sent.
    pub fn send(&mut self, frame: HostFrame, timeout: Duration) -> Option<Pending> {
        self.number += 1;
        let request = Request { number: self.number, frame, timeout, waiter: thread::current() };
        self.requests.push(request).ok()?;
        self.thread.as_ref()?.thread().unpark();
        Some(Pending { number: self.number, until: Instant::now() + timeout + GRACE })
    }

    /// Waits for the answer to a command.
    pub fn receive(&mut self, pending: Pending) -> Outcome {
        loop {
            while let Ok(reply) = self.replies.pop() {
                if reply.number == pending.number {
                    return reply.outcome;
                }
            }
            let left = pending.until.saturating_duration_since(Instant::now());
            if left.is_zero() || self.replies.is_abandoned() {
                let result = Err(LinkError::Timeout { garbage: None });
                return Outcome { result, stale: 0, corrupt: 0 };
            }
            thread::park_timeout(left);
        }
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        self.closing.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            // It ends after one time-out at the most; a panic there has been told by the runtime.
            let _ = thread.join();
        }
    }
}

/// Opens a port, or says why not.
fn open(port: &str) -> Result<TTYPort, DacError> {
    // The system's errors for "no such port" and "in use" are the same to serialport; the first is asked here.
    if !std::path::Path::new(port).exists() {
        return Err(DacError::NotThere { port: port.to_owned(), others: ports::in_words() });
    }
    let builder = serialport::new(port, 115_200).timeout(Duration::from_millis(50));
    TTYPort::open(&builder).map_err(|error| {
        let port = port.to_owned();
        match error.kind() {
            serialport::ErrorKind::NoDevice => {
                let holder = ports::holder(&port).unwrap_or_else(|| "another program".to_owned());
                DacError::Busy { port, holder }
            }
            serialport::ErrorKind::Io(io::ErrorKind::PermissionDenied) => DacError::Denied { port },
            serialport::ErrorKind::Io(io::ErrorKind::NotFound) => {
                DacError::NotThere { port, others: ports::in_words() }
            }
            _ => DacError::CannotOpen { port, detail: error.to_string() },
        }
    })
}

struct IoThread {
    tty: TTYPort,
    requests: Consumer<Request>,
    replies: Producer<Reply>,
    decoder: Decoder<Answer>,
    closing: Arc<AtomicBool>,
}

impl IoThread {
    fn run(mut self) {
        loop {
            match self.requests.pop() {
                Ok(request) => {
                    let outcome = self.exchange(&request);
                    // Full only when the caller has given up on as many answers; then this one is no news either.
                    let _ = self.replies.push(Reply { number: request.number, outcome });
                    request.waiter.unpark();
                }
                Err(_) if self.closing.load(Ordering::Acquire) => return,
                Err(_) => thread::park_timeout(IDLE),
            }
        }
    }

    fn exchange(&mut self, request: &Request) -> Outcome {
        let mut outcome = Outcome { result: Err(LinkError::Timeout { garbage: None }), stale: 0, corrupt: 0 };
        let sent = Instant::now();
        let until = sent + request.timeout;
        let mut wire = [0; MAX_WIRE_LEN];
        // The buffer is as long as any frame.
        let len = request.frame.encode(&mut wire).unwrap_or(0);
        if let Err(error) = self.write(&wire[..len], request.timeout) {
            outcome.result = Err(error);
            return outcome;
        }
        let mut garbage = None;
        loop {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                outcome.result = Err(LinkError::Timeout { garbage });
                return outcome;
            }
            let mut bytes = [0; 256];
            let read = match self.read(&mut bytes, left) {
                Ok(read) => read,
                Err(error) => {
                    outcome.result = Err(error);
                    return outcome;
                }
            };
            for &byte in &bytes[..read] {
                match self.decoder.push(byte) {
                    None => {}
                    Some(Ok(BoardFrame { sequence, body })) if sequence == request.frame.sequence => {
                        outcome.result = Ok(Exchange { answer: body, sent, received: Instant::now() });
                    }
                    Some(Ok(_)) => outcome.stale += 1,
                    Some(Err(error)) => {
                        outcome.corrupt += 1;
                        garbage = Some(error);
                    }
                }
            }
            if outcome.result.is_ok() {
                return outcome;
            }
        }
    }

    fn write(&mut self, bytes: &[u8], timeout: Duration) -> Result<(), LinkError> {
        let _ = self.tty.set_timeout(timeout);
        match self.tty.write_all(bytes) {
            Ok(()) => Ok(()),
            Err(error) if error.kind() == io::ErrorKind::TimedOut => {
                Err(LinkError::Timeout { garbage: None })
            }
            Err(error) => Err(LinkError::Unplugged(error.kind())),
        }
    }

    /// Bytes that came in time; none when none did.
    fn read(&mut self, bytes: &mut [u8], timeout: Duration) -> Result<usize, LinkError> {
        let _ = self.tty.set_timeout(timeout);
        match self.tty.read(bytes) {
            Ok(0) => Err(LinkError::Unplugged(io::ErrorKind::UnexpectedEof)),
            Ok(read) => Ok(read),
            Err(error) if matches!(error.kind(), io::ErrorKind::TimedOut | io::ErrorKind::Interrupted) => {
                Ok(0)
            }
            Err(error) => Err(LinkError::Unplugged(error.kind())),
        }
    }
}
