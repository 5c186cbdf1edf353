//! The virtual airframe between the board's pins and the camera.

use std::{
    fmt::Write as _,
    fs::File,
    io::{self, BufRead, BufReader, Write},
    path::{Path, PathBuf},
    sync::{
        Arc,
        mpsc::{Receiver, RecvTimeoutError, Sender, channel},
    },
    thread,
    time::{Duration, Instant},
};

use bench_device::{Sticks, Time};
use bench_kinect::{
    Frame,
    render::{Pose, Renderer, Settings, scene::Scene},
};
use bench_plant::lab::{Exposures, Lab, SharedWorld};
use bench_rig::Rig;

use crate::{Shutter, settings::calibration};

/// How long the world stands still at most.
const STEP: Duration = Duration::from_millis(2);
/// A depth image is on its way for as long, s: 242 microframes. The rest of the rig's latency passes before it is sent.
const TRANSPORT_S: f64 = 242.0 * 125e-6;

/// The pins of a board, as its firmware for Linux tells them: lines `<us> pin <channel> <uV>` on a pipe.
pub struct Pins(Receiver<(usize, f64)>);

impl Pins {
    /// Makes the pipe, and listens.
    pub fn listen(pipe: &Path) -> io::Result<Self> {
        let mode = rustix::fs::Mode::RUSR | rustix::fs::Mode::WUSR;
        rustix::fs::mknodat(rustix::fs::CWD, pipe, rustix::fs::FileType::Fifo, mode, 0)?;
        // Open for writing too, so that a board that goes is not the end.
        let lines = BufReader::new(File::options().read(true).write(true).open(pipe)?);
        let (sender, pins) = channel();
        thread::spawn(move || tell(lines, &sender));
        Ok(Self(pins))
    }
}

fn tell(lines: impl BufRead, pins: &Sender<(usize, f64)>) {
    for line in lines.lines().map_while(Result::ok) {
        if let Some(pin) = parse_pin(&line)
            && pins.send(pin).is_err()
        {
            return;
        }
    }
}

/// Channel and volts of a line that tells of a pin.
fn parse_pin(line: &str) -> Option<(usize, f64)> {
    let mut words = line.split_whitespace().skip(1);
    let (Some("pin"), Some(channel), Some(microvolts)) = (words.next(), words.next(), words.next()) else {
        return None;
    };
    let channel = channel.parse().ok().filter(|channel| *channel < 4)?;
    Some((channel, f64::from(microvolts.parse::<i32>().ok()?) * 1e-6))
}

/// A flight, by the clock.
pub struct Flight {
    world: SharedWorld,
    exposures: Exposures,
    renderer: Renderer,
    truth: Option<File>,
    hidden_while: Option<PathBuf>,
}

impl Flight {
    /// An airframe at rest before the camera of a rig. `truth` is a file for what really happens; while there is a file
    /// `hidden_while`, the camera does not see the airframe.
    pub fn new(
        mut rig: Rig,
        seed: u64,
        truth: Option<&Path>,
        hidden_while: Option<PathBuf>,
    ) -> io::Result<Self> {
        let renderer =
            Renderer::new(calibration(&rig)?, &Scene::with_distractors(), Settings::default(), seed);
        rig.tracker.latency_s.value = (rig.tracker.latency_s.value - TRANSPORT_S).max(0.0);
        let lab = Lab::new(&rig, seed).map_err(io::Error::other)?;
        let mut truth = truth.map(File::create).transpose()?;
        if let Some(file) = &mut truth {
            file.write_all(b"time_s,x_m,y_m,z_m,throttle_v\n")?;
        }
        let (world, exposures) = (lab.world.clone(), lab.world.into_exposures());
        Ok(Self { world, exposures, renderer, truth, hidden_while })
    }

    /// Flies for ever: pins move the airframe, each exposure is rendered and released.
    pub fn run(mut self, pins: &Pins, shutter: &Shutter) -> io::Result<()> {
        let began = Instant::now();
        let mut sticks = [0.0; 4];
        loop {
            let pin = match pins.0.recv_timeout(STEP) {
                Ok(pin) => Some(pin),
                Err(RecvTimeoutError::Timeout) => None,
                Err(RecvTimeoutError::Disconnected) => return Ok(()),
            };
            let now = Time::from_seconds(began.elapsed().as_secs_f64());
            self.world.with(|world| world.advance_to(now));
            // A command sets four pins at once.
            for (channel, volts) in pin.into_iter().chain(pins.0.try_iter()) {
                sticks[channel] = volts;
            }
            self.world.with(|world| world.set_pins(Sticks::from_array(sticks)));
            self.write_truth(sticks[0])?;
            while let Some(exposure) = self.exposures.poll() {
                let pose = Pose {
                    time: exposure.exposed_at,
                    position_m: exposure.position_m,
                    velocity_m_s: exposure.velocity_m_s,
                    attitude: exposure.attitude,
                    body_rate_rad_s: exposure.body_rate_rad_s,
                };
                let hidden = self.hidden_while.as_ref().is_some_and(|file| file.exists());
                let mut frame = Frame::default();
                self.renderer.render(pose.time, (!hidden).then_some(&pose), &mut frame);
                shutter.release(&Arc::new(frame));
            }
        }
    }

    fn write_truth(&mut self, throttle_v: f64) -> io::Result<()> {
        let mut rows = String::new();
        self.world.drain_truth(|state| {
            let (t, p) = (state.time.seconds(), state.position_m);
            // Writing to a String cannot fail.
            let _ = writeln!(rows, "{t:.4},{:.5},{:.5},{:.5},{throttle_v:.4}", p.x, p.y, p.z);
        });
        match &mut self.truth {
            Some(file) if !rows.is_empty() => file.write_all(rows.as_bytes()),
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pins_are_read_from_the_boards_trace_and_the_rest_of_it_is_passed_over() {
        assert_eq!(parse_pin("1234 pin 2 -16000"), Some((2, -0.016)));
        for other in ["1234 dac 2 16000", "1 applied", "", "1 pin 4 0", "1 pin 0 x", "1 pin 0"] {
            assert_eq!(parse_pin(other), None, "{other}");
        }
    }
}
