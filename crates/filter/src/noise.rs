//! What disturbs the model and blurs the tracker, and the effects that are seen in this noise alone.

use bench_plant::effects::{LIBRARY, Shows, Spread};
use bench_rig::{GRAVITY_M_S2, Rig};
use bench_statistics::FAR_SIGMAS;

use crate::law::Point;

/// Process noise near the ground, m/s^2 per root Hz.
const NEAR_GROUND_ACCELERATION: f64 = 0.024; // physics
/// Spread of speed when the airframe leaves the ground, m/s.
const LIFT_OFF_M_S: f64 = 0.04; // physics

/// What disturbs the model, and what blurs the tracker.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// White acceleration, m/s^2 per root Hz.
    pub acceleration: f64,
    /// Random walk of the trim acceleration, m/s^2 per root s.
    pub trim_walk: f64,
    /// Prior of the trim acceleration of a flight, m/s^2.
    pub trim: f64,
    /// One sigma of the turbulence's acceleration, an Ornstein-Uhlenbeck process, m/s^2.
    pub turbulence: f64,
    /// Its correlation time, s.
    pub turbulence_time_s: f64,
    /// One sigma of a measurement, rounding included, m.
    pub measurement_m: f64,
    /// One sigma of the exposures' times beyond what is known of them, s.
    pub jitter_s: f64,
    /// Share of measurements that show a wrong place.
    pub outlier_probability: f64,
    /// One sigma of wrong places about the right one, m.
    pub outlier_m: f64,
    /// Share of frames that are lost, in logs that hold the newest frame: measurements are older than they seem, or those of the
    /// iteration before.
    pub stale_probability: f64,
    /// How many are lost in a row, on average.
    pub stale_frames: f64,
    /// One sigma of the vertical speed felt on board, m/s; 0 where it is not used.
    pub velocity_m_s: f64,
    /// The same of the acceleration, m/s^2.
    pub acceleration_m_s2: f64,
    /// White acceleration besides, near the ground, whose effect has a kink: m/s^2 per root Hz.
    pub near_ground: f64,
    /// Spread of the vertical speed when the airframe leaves the ground, m/s.
    pub lift_off_m_s: f64,
}

impl Noise {
    /// What a rig says of it, and what is ordinary where it says nothing.
    pub fn nominal(rig: &Rig) -> Self {
        let rounding = rig.tracker.resolution_m / 12_f64.sqrt(); // unit
        Self {
            acceleration: rig.disturbance.white_m_s2_per_root_hz.unwrap_or(0.004), // physics
            trim_walk: rig.disturbance.trim_walk_m_s2_per_root_s.unwrap_or(0.004), // physics
            trim: rig.disturbance.trim_m_s2.unwrap_or(0.05),                       // physics
            turbulence: rig.disturbance.turbulence_m_s2.unwrap_or(0.022),          // physics
            turbulence_time_s: rig.disturbance.turbulence_time_s.unwrap_or(0.7),   // physics
            measurement_m: rig.tracker.noise_m.hypot(rounding).max(1e-4),          // numerical
            jitter_s: rig.disturbance.timing_s.unwrap_or(0.0),
            outlier_probability: rig.disturbance.outlier_probability.unwrap_or(0.0),
            outlier_m: rig.disturbance.outlier_m.unwrap_or(0.0),
            stale_probability: 0.0,
            stale_frames: 1.0,
            velocity_m_s: rig.disturbance.velocity_noise_m_s.unwrap_or(0.0),
            acceleration_m_s2: rig.disturbance.acceleration_noise_m_s2.unwrap_or(0.0),
            near_ground: NEAR_GROUND_ACCELERATION,
            lift_off_m_s: LIFT_OFF_M_S,
        }
    }

    /// The same noise, stronger by a factor: what a flight keeps is no noise.
    #[must_use]
    pub fn times(&self, factor: f64) -> Self {
        Self {
            acceleration: self.acceleration * factor,
            turbulence: self.turbulence * factor,
            measurement_m: self.measurement_m * factor,
            outlier_m: self.outlier_m * factor,
            ..*self
        }
    }
}

/// What is slower than this is a drift, not a gust, s.
const LONGEST_GUST_S: f64 = 4.0;
/// Share of wrong places beyond which they are no exception.
const MOST_OUTLIERS: f64 = 0.1;
/// Spread of the charge drawn before a flight, minutes of hover.
const DRAWN_BEFORE_MIN: f64 = 0.3;

/// The kind of spread in which an effect of the library is seen, if it is seen in noise alone.
pub fn spread(effect: usize) -> Option<Spread> {
    match LIBRARY[effect].signature.shows {
        Shows::Spread(spread) => Some(spread),
        _ => None,
    }
}

/// Whether an effect of the library is seen in the noise alone.
pub fn is_random(effect: usize) -> bool {
    spread(effect).is_some()
}

/// Noise with what a point's effects add.
pub fn added(point: &Point, noise: &Noise, rig: &Rig) -> Noise {
    let mut noise = *noise;
    for (effect, values) in point.acting() {
        if LIBRARY[*effect].signature.fades {
            // How full the battery was before the flight is not known.
            noise.trim = noise.trim.hypot(GRAVITY_M_S2 * values[0] * DRAWN_BEFORE_MIN);
        }
        match spread(*effect) {
            Some(Spread::MeasurementNoise) => noise.measurement_m = noise.measurement_m.hypot(values[0]),
            Some(Spread::LostFrames) => {
                [noise.stale_probability, noise.stale_frames] = [values[0], values[1]];
            }
            Some(Spread::LateFrames) => noise.jitter_s = noise.jitter_s.hypot(values[0]),
            // Wrong places are few, and far off against the noise: else it is noise.
            Some(Spread::WrongPlaces) => {
                noise.outlier_probability = (noise.outlier_probability + values[0]).min(MOST_OUTLIERS);
                noise.outlier_m = values[1].max(FAR_SIGMAS * noise.measurement_m).max(noise.outlier_m);
            }
            Some(Spread::Turbulence) => {
                // Wind of deviation sigma acts through the drag.
                let [sigma_m_s, correlation_s] = [values[0], values[1].min(LONGEST_GUST_S)];
                let per_wind = rig.airframe.drag_n_s_per_m.value / rig.airframe.mass_kg.value;
                noise.turbulence = noise.turbulence.hypot(sigma_m_s * per_wind);
                noise.turbulence_time_s = correlation_s;
            }
            None => {}
        }
    }
    noise
}
