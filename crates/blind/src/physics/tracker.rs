//! The camera and what it says of the altitude.

use rand_distr::{Distribution, Gamma, StudentT};

use crate::random::{Random, exponential, happens, normal, uniform};

/// What goes wrong between exposure and arrival.
#[derive(Clone, Debug)]
pub(crate) enum TrackerFault {
    /// Every frame is late.
    Late { extra_s: f64 },
    /// Lateness that runs up and falls back, as two clocks beat.
    Beat { mean_s: f64, frames: f64 },
    /// Frames wait in a queue (gamma distribution).
    Queue { mean_s: f64, shape: f64 },
    /// Some frames are held up for a fixed time.
    HeldUp { probability: f64, wait_s: f64 },
    /// Wrong scale and origin.
    Scale { error: f64, bias_m: f64 },
    /// Wrong scale and origin, with a lens that bends.
    Lens { error: f64, bias_m: f64, bend_per_m: f64 },
    /// Noise with heavy tails (Student's t, four degrees of freedom).
    HeavyTails { sigma_m: f64 },
    /// Noise that remembers some frames.
    Wander { sigma_m: f64, frames: f64 },
    /// Frames are lost in bursts of random length, any length up to twice the mean.
    Bursts { probability: f64, mean_frames: f64 },
    /// Frames are lost whenever something passes by, every so often.
    Occlusions { probability: f64, mean_frames: f64 },
    /// Now and then a place far off (Laplace distribution).
    Strays { probability: f64, sigma_m: f64 },
    /// Now and then another mark is taken for the marker, always at the same place beside it.
    WrongMark { probability: f64, offset_m: f64 },
    /// Latency grows through the flight: outside the library.
    GrowingLatency { extra_s_per_min: f64 },
    /// Altitude ripples with altitude: outside the library.
    Ripple { amplitude_m: f64, wavelength_m: f64 },
    /// The marker moves in the image as the motors work: outside the library.
    Shaken { gain_m: f64 },
}

/// The tracker that the rig describes, with its true numbers.
#[derive(Clone, Debug)]
pub(crate) struct Camera {
    pub latency_s: f64,
    /// What the tracker takes for its latency, s.
    pub believed_latency_s: f64,
    pub noise_m: f64,
    pub resolution_m: f64,
    pub dropout_probability: f64,
    pub fault: Option<TrackerFault>,
}

/// One sigma of arrival times by the bus alone, s.
pub(crate) const BUS_JITTER_S: f64 = 0.001;

/// What the camera remembers between frames.
#[derive(Clone, Debug, Default)]
pub(crate) struct CameraState {
    count: f64,
    last_arrival_s: f64,
    wander_m: f64,
    blind_frames: f64,
}

/// One frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    /// When it was really exposed, s.
    pub exposed_s: f64,
    /// When it reached the loop, s.
    pub arrived_s: f64,
    /// Lateness that a fault put in, s.
    pub extra_s: f64,
    /// Thrust over weight while it was exposed.
    pub load: f64,
    /// Altitude as told, m; absent when the marker was lost.
    pub z_m: Option<f64>,
}

impl CameraState {
    /// A camera that has run for a while, no one knows how long.
    pub(crate) fn some_time(random: &mut Random) -> Self {
        Self { count: uniform(random, 0.0, 1e5).floor(), ..Self::default() }
    }
}

impl Camera {
    /// Altitude as a sound camera with this fault's optics tells it.
    pub(crate) fn distorted(&self, z_m: f64, load: f64) -> f64 {
        match self.fault {
            Some(TrackerFault::Scale { error, bias_m }) => z_m * (1.0 + error) + bias_m,
            Some(TrackerFault::Lens { error, bias_m, bend_per_m }) => {
                z_m * (1.0 + error + bend_per_m * (z_m - 0.5)) + bias_m
            }
            Some(TrackerFault::Ripple { amplitude_m, wavelength_m }) => {
                z_m + amplitude_m * (std::f64::consts::TAU * z_m / wavelength_m).sin()
            }
            Some(TrackerFault::Shaken { gain_m }) => z_m + gain_m * (load - 1.0),
            _ => z_m,
        }
    }

    /// What a fault of latency or optics would change in the mean of frames that a sound camera took of a flight.
    pub(crate) fn mean_change(&self, frames: &[Frame], altitude_m: impl Fn(f64) -> f64) -> Vec<f64> {
        let change = |(count, frame): (usize, &Frame)| {
            // A frame that takes longer to arrive was exposed earlier than it is believed to be.
            let extra_s = self.mean_lateness_s(count as f64, frame.exposed_s);
            let told_m = self.distorted(altitude_m(frame.exposed_s - extra_s), frame.load);
            told_m - altitude_m(frame.exposed_s)
        };
        frames.iter().enumerate().map(change).collect()
    }

    fn mean_lateness_s(&self, count: f64, t_s: f64) -> f64 {
        match self.fault {
            Some(TrackerFault::Late { extra_s }) => extra_s,
            Some(TrackerFault::Beat { mean_s, frames }) => 2.0 * mean_s * (count / frames).fract(),
            Some(TrackerFault::GrowingLatency { extra_s_per_min }) => extra_s_per_min * t_s / 60.0,
            _ => 0.0,
        }
    }

    pub(crate) fn expose(
        &self,
        state: &mut CameraState,
        exposed_s: f64,
        z_m: f64,
        load: f64,
        random: &mut Random,
    ) -> Frame {
        state.count += 1.0;
        let extra_s = self.lateness_s(state, exposed_s, random);
        let bus_s = BUS_JITTER_S * normal(random).clamp(-3.0, 3.0);
        // Frames do not overtake one another.
        let arrived_s = (exposed_s + self.latency_s + extra_s + bus_s).max(state.last_arrival_s + 1e-4);
        state.last_arrival_s = arrived_s;
        let noise_m = self.noise_m * normal(random) + self.more_noise_m(state, random);
        let told_m = self.distorted(z_m, load) + noise_m;
        let lost = happens(random, self.dropout_probability) | self.lost(state, random);
        let z_m = (!lost).then(|| self.rounded(told_m));
        Frame { exposed_s, arrived_s, extra_s, load, z_m }
    }

    pub(crate) fn rounded(&self, z_m: f64) -> f64 {
        if self.resolution_m > 0.0 { (z_m / self.resolution_m).round() * self.resolution_m } else { z_m }
    }

    fn lateness_s(&self, state: &CameraState, t_s: f64, random: &mut Random) -> f64 {
        match self.fault {
            Some(TrackerFault::Late { extra_s }) => extra_s,
            Some(TrackerFault::Beat { mean_s, frames }) => 2.0 * mean_s * (state.count / frames).fract(),
            Some(TrackerFault::Queue { mean_s, shape }) => {
                // Shape and scale are above zero by construction.
                Gamma::new(shape, mean_s / shape).map_or(mean_s, |gamma| gamma.sample(random))
            }
            Some(TrackerFault::HeldUp { probability, wait_s }) if happens(random, probability) => wait_s,
            Some(TrackerFault::GrowingLatency { extra_s_per_min }) => extra_s_per_min * t_s / 60.0,
            _ => 0.0,
        }
    }

    fn more_noise_m(&self, state: &mut CameraState, random: &mut Random) -> f64 {
        match self.fault {
            Some(TrackerFault::HeavyTails { sigma_m }) => {
                // Four degrees of freedom have a variance of two.
                let t = StudentT::new(4.0).map_or(0.0, |student| student.sample(random));
                sigma_m * t / std::f64::consts::SQRT_2
            }
            Some(TrackerFault::Wander { sigma_m, frames }) => {
                let keep = (-1.0 / frames).exp();
                state.wander_m =
                    keep * state.wander_m + sigma_m * (1.0 - keep * keep).sqrt() * normal(random);
                state.wander_m
            }
            Some(TrackerFault::Strays { probability, sigma_m }) if happens(random, probability) => {
                let side = if happens(random, 0.5) { 1.0 } else { -1.0 };
                side * exponential(random) * sigma_m / std::f64::consts::SQRT_2
            }
            Some(TrackerFault::WrongMark { probability, offset_m }) if happens(random, probability) => {
                offset_m
            }
            _ => 0.0,
        }
    }

    fn lost(&self, state: &mut CameraState, random: &mut Random) -> bool {
        let begins = match self.fault {
            Some(TrackerFault::Bursts { probability, mean_frames }) => {
                state.blind_frames <= 0.0 && happens(random, probability / mean_frames)
            }
            Some(TrackerFault::Occlusions { probability, mean_frames }) => {
                let every = (mean_frames / probability).round();
                state.count % every == (0.5 * every).floor()
            }
            _ => return false,
        };
        if begins {
            state.blind_frames = self.burst_frames(random);
        }
        state.blind_frames -= 1.0;
        state.blind_frames >= 0.0
    }

    fn burst_frames(&self, random: &mut Random) -> f64 {
        match self.fault {
            Some(TrackerFault::Bursts { mean_frames, .. }) => {
                uniform(random, 1.0, (2.0 * mean_frames - 1.0).max(1.01)).round()
            }
            Some(TrackerFault::Occlusions { mean_frames, .. }) => {
                (mean_frames + normal(random) * 0.2 * mean_frames).round().max(1.0)
            }
            _ => 0.0,
        }
    }
}
