use std::{
    io::{self, Read, Write},
    os::unix::fs::symlink,
    path::{Path, PathBuf},
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use firmware_proto::{ArmState, BoardFrame, Command, DELIMITER, Decoder, MAX_WIRE_LEN};
use serialport::{SerialPort, TTYPort};

use super::{Board, LinkFaults, Moment, board::foreign, faults::Wire};
use crate::DacError;

/// How often the board looks at its clock when nothing arrives and nothing is due. Each look wakes a processor, which others need, and in a
/// user-mode kernel it is dear.
const TURN: Duration = Duration::from_millis(20);
/// How long a host that does not read is waited for.
const PATIENCE: Duration = Duration::from_millis(1);

/// A [`Board`] behind a pseudo terminal, on a thread of its own. Dropping it unplugs it for good.
#[derive(Debug)]
pub struct EmulatedPsoc5 {
    path: PathBuf,
    history: Arc<Mutex<Vec<Moment>>>,
    stopping: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl EmulatedPsoc5 {
    /// Starts a board. With `link`, the port is always found there, also after it was unplugged and plugged in again (a pty's own
    /// name changes).
    pub fn start(faults: LinkFaults, seed: u64, link: Option<&Path>) -> Result<Self, DacError> {
        let failed = |action| move |error: io::Error| DacError::System { action, detail: error.to_string() };
        let (master, name) = open_pty().map_err(failed("make a pseudo terminal"))?;
        let path = link.map_or_else(|| PathBuf::from(&name), Path::to_owned);
        if let Some(link) = link {
            point(link, &name).map_err(failed("make the link to the port"))?;
        }
        let history = Arc::new(Mutex::new(Vec::new()));
        let stopping = Arc::new(AtomicBool::new(false));
        let emulation = Emulation {
            master: Some(master),
            link: link.map(Path::to_owned),
            faults,
            board: Board::new(seed, faults.dac_lag_s, faults.dac_offset_v),
            decoder: Decoder::new(),
            to_board: Wire::new(faults, seed, 1),
            to_host: Wire::new(faults, seed, 2),
            frame: Vec::with_capacity(MAX_WIRE_LEN),
            started: Instant::now(),
            armed_us: None,
            unplugged: false,
            sagged: false,
            history: Arc::clone(&history),
            stopping: Arc::clone(&stopping),
        };
        let thread = thread::Builder::new()
            .name("emulated psoc5".to_owned())
            .spawn(|| emulation.run())
            .map_err(failed("start the emulated board"))?;
        Ok(Self { path, history, stopping, thread: Some(thread) })
    }

    /// The port to connect to.
    pub fn port(&self) -> &Path {
        &self.path
    }

    /// Everything that changed the outputs so far, oldest first.
    pub fn history(&self) -> Vec<Moment> {
        self.history.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

impl Drop for EmulatedPsoc5 {
    fn drop(&mut self) {
        self.stopping.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// The board's side of a pty, and the other side's name. That side is not kept open here, so that it is closed when the host closes it.
fn open_pty() -> io::Result<(TTYPort, String)> {
    let (master, host) = TTYPort::pair()?;
    let name = host.name().ok_or_else(|| io::Error::other("the pseudo terminal has no name"))?;
    Ok((master, name))
}

fn point(link: &Path, name: &str) -> io::Result<()> {
    match std::fs::read_link(link) {
        Ok(_) => std::fs::remove_file(link)?,
        Err(error) if error.kind() == io::ErrorKind::NotFound => {}
        // What is no link is somebody's file.
        Err(_) => return Err(io::ErrorKind::AlreadyExists.into()),
    }
    symlink(name, link)
}

struct Emulation {
    /// Absent while unplugged.
    master: Option<TTYPort>,
    link: Option<PathBuf>,
    faults: LinkFaults,
    board: Board,
    decoder: Decoder<Command>,
    to_board: Wire,
    to_host: Wire,
    /// Bytes since the last delimiter.
    frame: Vec<u8>,
    started: Instant,
    armed_us: Option<u64>,
    unplugged: bool,
    sagged: bool,
    history: Arc<Mutex<Vec<Moment>>>,
    stopping: Arc<AtomicBool>,
}

impl Emulation {
    fn run(mut self) {
        while !self.stopping.load(Ordering::Relaxed) {
            self.listen();
            let now_us = self.now_us();
            self.board.pass(now_us);
            self.misfortunes(now_us);
            if !self.stalled(now_us) {
                while let Some(bytes) = self.to_board.take(now_us) {
                    self.receive(now_us, &bytes);
                }
            }
            // First, so that whoever has an answer finds in the history what it answers.
            self.tell();
            while let Some(bytes) = self.to_host.take(self.now_us()) {
                self.send(&bytes);
            }
        }
        if let Some(link) = &self.link {
            let _ = std::fs::remove_file(link);
        }
    }

    fn now_us(&self) -> u64 {
        self.started.elapsed().as_micros() as u64
    }

    /// Waits for bytes, no longer than until something else is due.
    fn listen(&mut self) {
        let now_us = self.now_us();
        let wait =
            self.due_us(now_us).map_or(TURN, |due_us| Duration::from_micros(due_us - now_us).min(TURN));
        let Some(master) = &mut self.master else { return thread::sleep(wait) };
        let _ = master.set_timeout(wait);
        let mut bytes = [0; 512];
        match master.read(&mut bytes) {
            Ok(read) => {
                for &byte in &bytes[..read] {
                    self.frame.push(byte);
                    if byte == DELIMITER || self.frame.len() > 4 * MAX_WIRE_LEN {
                        self.to_board.put(now_us, std::mem::take(&mut self.frame));
                    }
                }
            }
            Err(error) if error.kind() == io::ErrorKind::TimedOut => {}
            // Nobody has the port open.
            Err(_) => thread::sleep(wait),
        }
    }

    /// When something happens next that no byte from the host tells of, and not before now.
    fn due_us(&self, now_us: u64) -> Option<u64> {
        // What arrives while the board hangs waits for the end of that, which a turn finds soon enough.
        let arriving_us = if self.stalled(now_us) { None } else { self.to_board.due_us() };
        let LinkFaults { brown_out, unplug, .. } = self.faults;
        let gone = unplug.filter(|_| !self.unplugged).map(|(at_s, _)| at_s);
        let back = unplug.filter(|_| self.master.is_none()).and_then(|(at_s, for_s)| Some(at_s + for_s?));
        let misfortunes = [brown_out.filter(|_| !self.sagged), gone, back].into_iter().flatten();
        let of_flight_us = |at_s: f64| Some(self.armed_us? + (at_s * 1e6) as u64 + 1);
        [arriving_us, self.to_host.due_us(), self.board.due_us()]
            .into_iter()
            .flatten()
            .chain(misfortunes.filter_map(of_flight_us))
            .min()
            .map(|due_us| due_us.max(now_us))
    }

    fn receive(&mut self, now_us: u64, bytes: &[u8]) {
        for &byte in bytes {
            let Some(outcome) = self.decoder.push(byte) else { continue };
            let (answer, at_us) = match (outcome, self.faults.protocol_version) {
                (Ok(frame), Some(version)) => (Some(foreign(version, frame.sequence)), now_us),
                (Ok(frame), None) => {
                    let (answer, at_us) = self.board.carry_out(now_us, &frame);
                    (Some(answer), at_us)
                }
                (Err(error), _) => (BoardFrame::refusing(error, now_us), now_us),
            };
            if let Some(answer) = answer {
                let mut wire = [0; MAX_WIRE_LEN];
                // The buffer is as long as any frame.
                let len = answer.encode(&mut wire).unwrap_or(0);
                self.to_host.put(at_us, wire[..len].to_vec());
            }
        }
        if self.board.state() == ArmState::Armed {
            self.armed_us.get_or_insert(now_us);
        }
    }

    fn send(&mut self, bytes: &[u8]) {
        if let Some(master) = &mut self.master {
            // A host that does not read loses the answer, as from a board whose buffer is full.
            let _ = master.set_timeout(PATIENCE);
            let _ = master.write_all(bytes);
        }
    }

    /// Seconds since the board was first armed.
    fn flight_s(&self, now_us: u64) -> Option<f64> {
        Some((now_us - self.armed_us?) as f64 / 1e6)
    }

    fn stalled(&self, now_us: u64) -> bool {
        match (self.faults.stall, self.flight_s(now_us)) {
            (Some((at_s, for_s)), Some(t_s)) => (at_s..at_s + for_s).contains(&t_s),
            _ => false,
        }
    }

    fn misfortunes(&mut self, now_us: u64) {
        let Some(t_s) = self.flight_s(now_us) else { return };
        if self.faults.brown_out.is_some_and(|at_s| t_s >= at_s) && !self.sagged {
            self.sagged = true;
            self.board.brown_out(now_us);
        }
        let Some((at_s, for_s)) = self.faults.unplug else { return };
        if t_s >= at_s && !self.unplugged {
            self.unplugged = true;
            self.master = None;
            self.to_board.clear();
            self.to_host.clear();
            self.frame.clear();
        }
        if for_s.is_some_and(|for_s| t_s >= at_s + for_s)
            && self.master.is_none()
            && let Ok((master, name)) = open_pty()
        {
            let linked = self.link.as_deref().map_or(Ok(()), |link| point(link, &name));
            if linked.is_ok() {
                self.master = Some(master);
                self.decoder = Decoder::new();
            }
        }
    }

    fn tell(&mut self) {
        let news = self.board.take_history();
        if !news.is_empty() {
            self.history.lock().unwrap_or_else(PoisonError::into_inner).extend(news);
        }
    }
}
