use std::{
    io,
    sync::Arc,
    thread,
    time::{Duration, Instant},
};

use bench_device::Time;
use bench_kinect::{
    Frame,
    render::{Pose, Renderer, Settings, scene::Scene},
};
use bench_rig::Rig;
use nalgebra::Vector3;

use crate::{Shutter, settings::calibration};

/// Ticks from one frame to the next.
pub const PERIOD_TICKS: u32 = 2_000_000;
/// Depth is exposed later than colour, ticks: 1 ms.
const LAG_TICKS: u32 = 60_000;
const FRAMES: u32 = 6;

/// A few frames, shown over and over. Frame number n has the time stamp n x [`PERIOD_TICKS`], so who receives it knows which it is, until
/// the stamps wrap after 71 s; as 2^32 is no multiple of the period, what comes then is told by counting on.
pub struct Reel(Vec<Frame>);

impl Reel {
    /// The marker at six places before a room with red distractors, as the rig's camera sees it.
    pub fn new(rig: &Rig, seed: u64) -> io::Result<Self> {
        let mut renderer =
            Renderer::new(calibration(rig)?, &Scene::with_distractors(), Settings::default(), seed);
        let frames = (0..FRAMES)
            .map(|i| {
                let place =
                    Vector3::new(0.1 * f64::from(i), 0.1 * f64::from(i % 3) - 0.1, 0.3 + 0.1 * f64::from(i));
                let mut frame = Frame::default();
                renderer.render(Time::ZERO, Some(&Pose::at_rest(Time::ZERO, place)), &mut frame);
                frame
            })
            .collect();
        Ok(Self(frames))
    }

    /// What the frame with a number holds.
    pub fn content(&self, number: u64) -> &Frame {
        &self.0[(number % u64::from(FRAMES)) as usize]
    }

    /// The frame with a number.
    pub fn frame(&self, number: u64) -> Frame {
        let mut frame = self.content(number).clone();
        // Wrapping is what the device's counter does.
        frame.colour_ticks = (number * u64::from(PERIOD_TICKS)) as u32;
        frame.depth_ticks = frame.colour_ticks.wrapping_add(LAG_TICKS);
        frame
    }

    /// Which frame has a time stamp near `ticks`, of those not far from number `near`.
    pub fn number(ticks: u32, near: u64) -> u64 {
        let apart = ticks.wrapping_sub((near * u64::from(PERIOD_TICKS)) as u32).cast_signed();
        let frames = (f64::from(apart) / f64::from(PERIOD_TICKS)).round() as i64;
        near.saturating_add_signed(frames)
    }

    /// Shows it on a thread of its own, 30 frames a second, for ever.
    pub fn run(self, shutter: Shutter) {
        thread::spawn(move || {
            let period = Duration::from_nanos(1_000_000_000 / 30);
            let began = Instant::now();
            for number in 0.. {
                let due = began + period * u32::try_from(number).unwrap_or(u32::MAX);
                thread::sleep(due.saturating_duration_since(Instant::now()));
                shutter.release(&Arc::new(self.frame(number)));
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_is_known_by_its_time_stamp_across_the_wrap() {
        for number in [0, 1, 2147, 2148, 5000, 18_000] {
            let ticks = (number * u64::from(PERIOD_TICKS)) as u32;
            assert_eq!(Reel::number(ticks, number.saturating_sub(100)), number);
            assert_eq!(Reel::number(ticks.wrapping_add(LAG_TICKS), number + 900), number);
        }
    }
}
