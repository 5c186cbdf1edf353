//! The first process of a kernel whose USB has a lab on it: see the library.

use std::{
    io,
    path::{Path, PathBuf},
    process::{Command, ExitCode, Stdio},
    sync::Mutex,
    thread,
};

use bench_emulated_lab::{CameraDevice, Flight, FootDevice, Pins, Reel, Settings, Shutter};
use bench_usb_lab::{Device, acm::SerialPort, guest};

/// Where the board tells its pins; `/run` is the guest's own.
const PIPE: &str = "/run/board-pins";

fn main() -> ExitCode {
    let lab = Mutex::new(None);
    let make = move |port| {
        let mut lab = lab.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let lab = match lab.as_mut() {
            Some(lab) => lab,
            // Not before: the guest's file systems are mounted by then.
            None => lab.insert(Lab::new()?),
        };
        lab.device(port)
    };
    match guest::main(Box::new(make)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("emulated-lab: {error}");
            ExitCode::FAILURE
        }
    }
}

/// What there is.
struct Lab {
    work: PathBuf,
    settings: Settings,
    depth: bench_rig::Depth,
    shutter: Shutter,
}

impl Lab {
    fn new() -> io::Result<Self> {
        let work = PathBuf::from(std::env::var("USB_LAB_WORK").map_err(io::Error::other)?);
        let settings = Settings::read(&work)?;
        let rig = settings.lab_rig()?;
        let depth = rig.calibration.as_ref().map(|calibration| calibration.depth).unwrap_or_default();
        let shutter = Shutter::default();
        if settings.board.is_some() {
            let pins = Pins::listen(Path::new(PIPE))?;
            let (seed, truth, frames) = (settings.seed, settings.truth.clone(), shutter.clone());
            let hidden_while = settings.hidden_while.clone();
            thread::spawn(move || {
                let flown = Flight::new(rig, seed, truth.as_deref(), hidden_while)
                    .and_then(|flight| flight.run(&pins, &frames));
                if let Err(error) = flown {
                    eprintln!("emulated-lab: the flight ended: {error}");
                }
            });
        } else {
            Reel::new(&rig, settings.seed)?.run(shutter.clone());
        }
        Ok(Self { work, settings, depth, shutter })
    }

    fn device(&self, port: u8) -> io::Result<Box<dyn Device>> {
        let Settings { faults, seed, board, .. } = &self.settings;
        match (port, board) {
            (0, _) => Ok(Box::new(CameraDevice::new(&self.depth, &self.shutter, *faults, *seed))),
            (1, _) => Ok(Box::new(FootDevice::default())),
            (2, Some(board)) => self.board(board),
            _ => Err(io::Error::other(format!("there is nothing for port {port}"))),
        }
    }

    /// The board's firmware, started anew each time that it is plugged in.
    fn board(&self, program: &Path) -> io::Result<Box<dyn Device>> {
        let mut child = Command::new(program)
            .current_dir(&self.work)
            .env("BOARD_TRACE", PIPE)
            .env("BOARD_CALIBRATED", "1")
            .env("BOARD_DRIFT_UV", format!("{:.0}", 1e6 * self.settings.board_drift_v))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|error| io::Error::other(format!("cannot run {}: {error}", program.display())))?;
        let gone = || io::Error::other("the program has no standard input and output");
        let (input, output) = (child.stdout.take().ok_or_else(gone)?, child.stdin.take().ok_or_else(gone)?);
        Ok(Box::new(SerialPort::new(input, output)))
    }
}
